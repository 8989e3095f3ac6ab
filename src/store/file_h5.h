/* file_h5.h - an HDF5 file driver that reads and writes through file.h */
#ifndef STORE_FILE_H5_H
#define STORE_FILE_H5_H
#include <hdf5.h>

/* A file-access property list with the driver, to be closed by the caller; < 0 where HDF5 refuses.  Call it between
 * batch_h5_lock and batch_h5_unlock.  Where THRESHOLD > 0, objects at least so large begin at multiples of ALIGNMENT. */
hid_t file_h5_access(hsize_t threshold, hsize_t alignment);
#endif
