/* file_h5.h - an HDF5 file driver that reads and writes through file.h */
#ifndef STORE_FILE_H5_H
#define STORE_FILE_H5_H
#include <hdf5.h>
#include "base/error.h"

/* A file-access property list with the driver, to be closed by the caller; < 0 where HDF5 refuses.
 * Call it between batch_h5_lock and batch_h5_unlock.  Where THRESHOLD > 0, objects at least so
 * large begin at multiples of ALIGNMENT. */
hid_t file_h5_access(hsize_t threshold, hsize_t alignment);

/* What first went wrong in file.h since then: to be asked after the file is closed, in the same
 * section.  HDF5 is not told of failed writes (see file_h5.c): without asking, they go unnoticed.
 */
enum modal_status file_h5_status(struct modal_error *err);
#endif
