/*
 * file.c - system calls on files, each with its fault point; see file.h
 *
 * Every call asks `fault` first: it counts, and where a rule says so gives the errno to fail with,
 * or a way to misbehave. Without MODALD_FAULTS it is a constant and disappears.
 */
#include "store/file.h"
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "store/file_fault.h"

static enum modal_status fail(struct modal_error *err, enum file_call call, const char *path,
                              int error)
{
    static const struct { int error; enum modal_status status; } table[] = {
        { ENOSPC, MODAL_STORAGE_FULL }, { EDQUOT, MODAL_STORAGE_FULL },
        { EFBIG, MODAL_STORAGE_FULL },  { EMFILE, MODAL_BUSY },
        { ENFILE, MODAL_BUSY },         { ENOENT, MODAL_NOT_FOUND },
    };
    enum modal_status status = MODAL_IO;

    for (size_t i = 0; i < sizeof table / sizeof *table; i++)
        if (table[i].error == error)
            status = table[i].status;
    return modal_fail(err, status, "%s %s: %s", file_calls[call], path, strerror(error));
}

/* The path behind a descriptor, for messages only. */
static const char *path_of(int fd, char path[4096])
{
    char link[64];
    ssize_t length;

    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    length = readlink(link, path, 4095);
    if (length < 0)
        snprintf(path, 4096, "descriptor %d", fd);
    else
        path[length] = 0;
    return path;
}

static enum modal_status fail_fd(struct modal_error *err, enum file_call call, int fd, int error)
{
    char path[4096];

    return fail(err, call, path_of(fd, path), error);
}

/* Run CALL (an expression that is -1 with errno set on failure) until it is not interrupted; its
 * errno, or 0. */
#define TRY(WHICH, CALL)                                                     \
    ({                                                                       \
        int error_;                                                          \
        do {                                                                 \
            struct file_fault fault_ = file_fault_next(WHICH);               \
            error_ = fault_.error != 0 ? fault_.error : (CALL) < 0 ? errno : 0; \
            file_fault_after(fault_);                                        \
        } while (error_ == EINTR);                                           \
        error_;                                                              \
    })

static enum modal_status fail_other(const char *path, struct modal_error *err)
{
    return modal_fail(err, MODAL_IO, "%s is no file; accepted: a file, no link, device, FIFO, "
                      "socket or folder in its place", path);
}

enum modal_status file_open(const char *path, int flags, mode_t mode, int *fd,
                            struct modal_error *err)
{
    int got = -1;
    int alone = (flags & O_ACCMODE) == O_RDONLY ? 0 : O_NOFOLLOW;
    int error = TRY(FILE_OPEN, got = open(path, flags | alone | O_CLOEXEC | O_NONBLOCK, mode));
    struct stat known;

    if (error == ENXIO || error == ELOOP)       /* a socket, a FIFO that nobody reads; a link */
        return fail_other(path, err);
    if (error != 0)
        return fail(err, FILE_OPEN, path, error);
    if (fstat(got, &known) == 0 && !S_ISREG(known.st_mode)
        && !((flags & O_DIRECTORY) != 0 && S_ISDIR(known.st_mode))) {
        close(got);
        return fail_other(path, err);
    }
    *fd = got;
    return MODAL_OK;
}

/* One transfer: bytes moved, or -1 with *ERROR.  A `short` fault halves it. */
static ssize_t transfer(enum file_call call, int fd, void *data, size_t length, uint64_t offset,
                        int *error)
{
    struct file_fault fault = file_fault_next(call);
    ssize_t moved = -1;

    if (fault.cut && length > 1)
        length /= 2;
    if (fault.error == 0)
        moved = call == FILE_PWRITE ? pwrite(fd, data, length, (off_t)offset)
                                    : pread(fd, data, length, (off_t)offset);
    *error = fault.error != 0 ? fault.error : errno;
    file_fault_after(fault);
    return moved;
}

enum modal_status file_write(int fd, const void *data, size_t length, uint64_t offset,
                             struct modal_error *err)
{
    const char *p = data;
    int error;

    while (length > 0) {
        ssize_t moved = transfer(FILE_PWRITE, fd, (void *)(uintptr_t)p, length, offset, &error);
        if (moved < 0 && error == EINTR)
            continue;
        if (moved <= 0)
            return fail_fd(err, FILE_PWRITE, fd, moved == 0 ? ENOSPC : error);
        p += moved;
        length -= (size_t)moved;
        offset += (uint64_t)moved;
    }
    return MODAL_OK;
}

enum modal_status file_read(int fd, void *data, size_t length, uint64_t offset, size_t *got,
                            struct modal_error *err)
{
    size_t done = 0;
    int error;

    while (done < length) {
        ssize_t moved = transfer(FILE_PREAD, fd, (char *)data + done, length - done, offset + done,
                                 &error);
        if (moved < 0 && error == EINTR)
            continue;
        if (moved < 0)
            return fail_fd(err, FILE_PREAD, fd, error);
        if (moved == 0)
            break;
        done += (size_t)moved;
    }
    *got = done;
    return MODAL_OK;
}

enum modal_status file_sync(int fd, struct modal_error *err)
{
    int error = TRY(FILE_FDATASYNC, fdatasync(fd));

    return error == 0 ? MODAL_OK : modal_fail(err, MODAL_IO, "fdatasync: %s", strerror(error));
}

enum modal_status file_sync_begin(int fd, uint64_t offset, uint64_t length, struct modal_error *err)
{
    int error;

    if (length == 0)                               /* which would mean all of the file */
        return MODAL_OK;
    do
        error = sync_file_range(fd, (off_t)offset, (off_t)length, SYNC_FILE_RANGE_WRITE) < 0
                    ? errno : 0;
    while (error == EINTR);
    /* only advice: file_sync does it all */
    if (error == ENOSYS || error == EINVAL || error == ESPIPE || error == EPERM)
        return MODAL_OK;
    return error == 0 ? MODAL_OK
                      : modal_fail(err, MODAL_IO, "sync_file_range: %s", strerror(error));
}

enum modal_status file_sync_dir(const char *path, struct modal_error *err)
{
    int fd = -1, error;
    enum modal_status rc = file_open(path, O_RDONLY | O_DIRECTORY, 0, &fd, err);

    if (rc != MODAL_OK)
        return rc;
    error = TRY(FILE_FSYNC, fsync(fd));
    close(fd);
    return error == 0 ? MODAL_OK : modal_fail(err, MODAL_IO, "fsync %s: %s", path, strerror(error));
}

enum modal_status file_truncate(int fd, uint64_t length, struct modal_error *err)
{
    int error = TRY(FILE_FTRUNCATE, ftruncate(fd, (off_t)length));

    return error == 0 ? MODAL_OK : fail_fd(err, FILE_FTRUNCATE, fd, error);
}

/* posix_fallocate gives its error as its value */
static int reserve(int fd, uint64_t length)
{
    int error = posix_fallocate(fd, 0, (off_t)length);

    errno = error;
    return error == 0 ? 0 : -1;
}

enum modal_status file_reserve(int fd, uint64_t length, struct modal_error *err)
{
    int error = length == 0 ? 0 : TRY(FILE_FALLOCATE, reserve(fd, length));

    return error == 0 ? MODAL_OK : fail_fd(err, FILE_FALLOCATE, fd, error);
}

enum modal_status file_rename(const char *from, const char *to, struct modal_error *err)
{
    int error = TRY(FILE_RENAME, rename(from, to));

    return error == 0 ? MODAL_OK : fail(err, FILE_RENAME, from, error);
}

enum modal_status file_unlink(const char *path, struct modal_error *err)
{
    int error = TRY(FILE_UNLINK, unlink(path));

    return error == 0 || error == ENOENT ? MODAL_OK : fail(err, FILE_UNLINK, path, error);
}

enum modal_status file_make_dir(const char *path, mode_t mode, struct modal_error *err)
{
    struct stat known;
    int error = TRY(FILE_MKDIR, mkdir(path, mode));

    if (error == EEXIST && stat(path, &known) == 0 && S_ISDIR(known.st_mode))
        return MODAL_OK;
    return error == 0 ? MODAL_OK : fail(err, FILE_MKDIR, path, error);
}

static enum modal_status put_tmp(const char *tmp, const void *data, size_t length, mode_t mode,
                                 struct modal_error *err)
{
    int fd = -1;
    enum modal_status rc = file_open(tmp, O_WRONLY | O_CREAT | O_TRUNC, mode, &fd, err);

    if (rc == MODAL_OK)
        rc = file_write(fd, data, length, 0, err);
    if (rc == MODAL_OK)
        rc = file_sync(fd, err);
    if (fd >= 0)
        close(fd);
    return rc;
}

static enum modal_status sync_parent(const char *path, struct modal_error *err)
{
    char dir[4096];
    const char *slash = strrchr(path, '/');

    snprintf(dir, sizeof dir, "%.*s", slash == NULL || slash == path ? 1 : (int)(slash - path),
             slash == NULL ? "." : path);
    return file_sync_dir(dir, err);
}

enum modal_status file_put(const char *path, const void *data, size_t length, mode_t mode,
                           struct modal_error *err)
{
    char tmp[4096];
    enum modal_status rc;

    if (snprintf(tmp, sizeof tmp, "%s.tmp", path) >= (int)sizeof tmp)
        return modal_fail(err, MODAL_TOO_LARGE, "the path %.60s... is longer than %zu bytes", path,
                          sizeof tmp - 5);
    rc = put_tmp(tmp, data, length, mode, err);
    if (rc == MODAL_OK)
        rc = file_rename(tmp, path, err);
    if (rc == MODAL_OK)
        return sync_parent(path, err);
    file_unlink(tmp, NULL);
    return rc;
}

static enum modal_status get_open(int fd, const char *path, size_t most, char **data,
                                  size_t *length, struct modal_error *err)
{
    struct stat known;
    enum modal_status rc;
    char *text;
    size_t got;

    if (fstat(fd, &known) < 0)
        return fail(err, FILE_PREAD, path, errno);
    if (known.st_size < 0 || (uint64_t)known.st_size > most)
        return modal_fail(err, MODAL_TOO_LARGE, "%s has %lld bytes, at most %zu are read", path,
                          (long long)known.st_size, most);
    text = malloc((size_t)known.st_size + 1);
    if (text == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for the %lld bytes of %s",
                          (long long)known.st_size, path);
    rc = file_read(fd, text, (size_t)known.st_size, 0, &got, err);
    if (rc != MODAL_OK) {
        free(text);
        return rc;
    }
    text[got] = 0;
    *data = text;
    *length = got;
    return MODAL_OK;
}

enum modal_status file_get(const char *path, size_t most, char **data, size_t *length,
                           struct modal_error *err)
{
    int fd = -1;
    enum modal_status rc = file_open(path, O_RDONLY, 0, &fd, err);

    if (rc == MODAL_OK) {
        rc = get_open(fd, path, most, data, length, err);
        close(fd);
    }
    return rc;
}
