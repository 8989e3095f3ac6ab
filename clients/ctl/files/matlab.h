/* matlab.h - MATLAB's files of versions 5 to 7: arrays, compressed or not
 *
 * Version 7.3 is HDF5 and read by hdf5.h.  Matrices of real numbers are read; cells, structs,
 * texts, sparse and complex ones are only listed.
 */
#ifndef CTL_FILES_MATLAB_H
#define CTL_FILES_MATLAB_H
#include "bytes.h"
#include "ctl/signals.h"

/* By the version and order of bytes in its head, or the text that it begins with. */
bool matlab_is(const unsigned char *head, size_t length);
/* FILE into *OUT (signals_done frees it).  MODAL_BAD_INPUT, field "file": damaged or cut;
 * "dataset": see arrays.h. */
enum modal_status matlab_read(struct bytes file, const char *path,
                              const struct signals_options *options, struct signals *out,
                              struct modal_error *err);
#endif
