/* hdf5.h - a user's HDF5 file, or MATLAB's of version 7.3, by store/batch_file.h
 *
 * Which dataset are the signals, and what says their step, is as in arrays.h; a `dt`, `fs` or `Fs`
 * may also be an attribute of the dataset or of the root.  MATLAB's matrices lie column by column
 * there and are turned.
 */
#ifndef CTL_FILES_HDF5_H
#define CTL_FILES_HDF5_H
#include <stdbool.h>
#include "ctl/signals.h"

/* By the signature, which may have a user block of 512, 1024 or 2048 bytes before it. */
bool hdf5_is(const unsigned char *head, size_t length);
enum { HDF5_HEAD_BYTES = 2048 + 8 };      /* the last such place and the signature in it */

/* PATH into *OUT (signals_done frees it, whatever came of it).  Fails as batch_file_map and
 * arrays_pick do. */
enum modal_status hdf5_read(const char *path, const struct signals_options *options,
                            struct signals *out, struct modal_error *err);
#endif
