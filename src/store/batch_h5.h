/* batch_h5.h - the HDF5 layout of a batch, made in an open file; shared by the spool and the
 * clients' writer
 *
 * Debian's HDF5 is not thread-safe: every use of it is between batch_h5_lock and batch_h5_unlock.
 */
#ifndef STORE_BATCH_H5_H
#define STORE_BATCH_H5_H
#include <hdf5.h>
#include "base/error.h"
#include "base/json.h"
#include "store/identity.h"

/* also silences HDF5's own error printing and its loading of filters */
void batch_h5_lock(void);
void batch_h5_unlock(void);

/*
 * Make the dataset of SHAPE in FILE: `signals` or `scene`, contiguous, its space allocated now and
 * not filled, with the attributes `dt`, `period`, `units`, `channels` and those of ATTRIBUTES (an
 * object, or NULL).  The caller closes *SET.
 */
enum modal_status batch_h5_make(hid_t file, const struct input_shape *shape,
                                const cJSON *attributes, hid_t *set, struct modal_error *err);
#endif
