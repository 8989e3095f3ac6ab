/*
 * file_h5.c - HDF5's files through the fault points of file.h
 *
 * A driver of HDF5's virtual file layer holds two addresses: `eoa`, the end of what the library has
 * allocated, and `eof`, the end of what is in the file.  The file is made long enough when it is
 * closed.
 *
 * A write that fails while HDF5 (1.10) closes a file leaves it half open, to crash when the library
 * ends.  So a failed write is kept here, the library goes on as if it had passed, and
 * file_h5_status tells after the file is closed.
 */
#include "store/file_h5.h"
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "store/file.h"

#define ADDRESS_MOST (((haddr_t)1 << 62) - 1)

struct h5_file {
    H5FD_t base;      /* HDF5's; first */
    int fd;
    haddr_t eoa, eof;
    dev_t device;
    ino_t inode;
};

/* the first since file_h5_access; under batch_h5_lock, as all of HDF5 */
static struct modal_error failed;

static enum modal_status note_failure(enum modal_status rc, const struct modal_error *err)
{
    /* H5Fcreate tries what is there first */
    if (rc != MODAL_OK && rc != MODAL_NOT_FOUND && failed.status == MODAL_OK)
        failed = *err;
    return rc;
}

static H5FD_t *h5_open(const char *name, unsigned flags, hid_t access, haddr_t most)
{
    struct h5_file *file = calloc(1, sizeof *file);
    int how = (flags & H5F_ACC_RDWR ? O_RDWR : O_RDONLY) | (flags & H5F_ACC_TRUNC ? O_TRUNC : 0)
              | (flags & H5F_ACC_CREAT ? O_CREAT : 0) | (flags & H5F_ACC_EXCL ? O_EXCL : 0);
    struct modal_error err;
    struct stat known;

    (void)access;
    (void)most;
    if (file == NULL
        || note_failure(file_open(name, how, 0640, &file->fd, &err), &err) != MODAL_OK) {
        free(file);
        return NULL;
    }
    if (fstat(file->fd, &known) == 0) {
        file->eof = (haddr_t)known.st_size;
        file->device = known.st_dev;
        file->inode = known.st_ino;
    }
    return &file->base;
}

static herr_t h5_close(H5FD_t *base)
{
    struct h5_file *file = (struct h5_file *)base;

    close(file->fd);
    free(file);
    return 0;
}

static int h5_compare(const H5FD_t *a, const H5FD_t *b)
{
    const struct h5_file *x = (const struct h5_file *)a, *y = (const struct h5_file *)b;

    if (x->device != y->device)
        return x->device < y->device ? -1 : 1;
    return x->inode == y->inode ? 0 : x->inode < y->inode ? -1 : 1;
}

static herr_t h5_query(const H5FD_t *base, unsigned long *flags)
{
    (void)base;
    *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA
             | H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
    return 0;
}

static haddr_t h5_get_eoa(const H5FD_t *base, H5FD_mem_t type)
{
    (void)type;
    return ((const struct h5_file *)base)->eoa;
}

static herr_t h5_set_eoa(H5FD_t *base, H5FD_mem_t type, haddr_t address)
{
    (void)type;
    ((struct h5_file *)base)->eoa = address;
    return 0;
}

static haddr_t h5_get_eof(const H5FD_t *base, H5FD_mem_t type)
{
    (void)type;
    return ((const struct h5_file *)base)->eof;
}

/* Past the end there are zeros. */
static herr_t h5_read(H5FD_t *base, H5FD_mem_t type, hid_t plan, haddr_t address, size_t size,
                      void *buffer)
{
    struct modal_error err;
    size_t got = 0;

    (void)type;
    (void)plan;
    if (note_failure(file_read(((struct h5_file *)base)->fd, buffer, size, address, &got, &err),
                     &err)
        != MODAL_OK)
        return -1;
    memset((char *)buffer + got, 0, size - got);
    return 0;
}

static herr_t h5_write(H5FD_t *base, H5FD_mem_t type, hid_t plan, haddr_t address, size_t size,
                       const void *buffer)
{
    struct h5_file *file = (struct h5_file *)base;
    struct modal_error err;

    (void)type;
    (void)plan;
    note_failure(file_write(file->fd, buffer, size, address, &err), &err);
    if (address + size > file->eof)
        file->eof = address + size;
    return 0;
}

static herr_t h5_truncate(H5FD_t *base, hid_t plan, hbool_t closing)
{
    struct h5_file *file = (struct h5_file *)base;
    struct modal_error err;

    (void)plan;
    (void)closing;
    if (file->eoa == file->eof)
        return 0;
    note_failure(file_truncate(file->fd, file->eoa, &err), &err);
    file->eof = file->eoa;
    return 0;
}

static const H5FD_class_t driver = {
    .name = "modald",
    .maxaddr = ADDRESS_MOST,
    .fc_degree = H5F_CLOSE_WEAK,
    .open = h5_open,
    .close = h5_close,
    .cmp = h5_compare,
    .query = h5_query,
    .get_eoa = h5_get_eoa,
    .set_eoa = h5_set_eoa,
    .get_eof = h5_get_eof,
    .read = h5_read,
    .write = h5_write,
    .truncate = h5_truncate, .fl_map = H5FD_FLMAP_DICHOTOMY,
};

hid_t file_h5_access(hsize_t threshold, hsize_t alignment)
{
    static hid_t id = H5I_INVALID_HID;
    hid_t access = H5Pcreate(H5P_FILE_ACCESS);

    failed.status = MODAL_OK;
    if (id < 0)
        id = H5FDregister(&driver);
    if (access >= 0
        && (id < 0 || H5Pset_driver(access, id, NULL) < 0
            || H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_V18) < 0
            || (threshold > 0 && H5Pset_alignment(access, threshold, alignment) < 0))) {
        H5Pclose(access);
        return H5I_INVALID_HID;
    }
    return access;
}

enum modal_status file_h5_status(struct modal_error *err)
{
    return failed.status == MODAL_OK ? MODAL_OK
                                     : modal_fail(err, failed.status, "%s", failed.message);
}
