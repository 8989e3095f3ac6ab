/* numpy.h - NumPy's files: NPY, one array; NPZ, arrays in a zip, stored or deflated
 *
 * Little or big endian, in C's or Fortran's order, of versions 1 to 3; integers, booleans, and
 * floats of 4 or 8 bytes.  An NPZ file of less than 4 GB (no zip64 in its directory).
 */
#ifndef CTL_FILES_NUMPY_H
#define CTL_FILES_NUMPY_H
#include "bytes.h"
#include "ctl/signals.h"

/* By the first bytes: NPY's own, or those of a zip. */
bool npy_is(const unsigned char *head, size_t length);
/* Is it a zip? */
bool npz_is(const unsigned char *head, size_t length);

/* FILE into *OUT (signals_done frees it).  MODAL_BAD_INPUT, field "file": damaged, cut, or sizes
 * that contradict each other; "dataset": see arrays.h. */
enum modal_status npy_read(struct bytes file, const char *path,
                           const struct signals_options *options, struct signals *out,
                           struct modal_error *err);
enum modal_status npz_read(struct bytes file, const char *path,
                           const struct signals_options *options, struct signals *out,
                           struct modal_error *err);
#endif
