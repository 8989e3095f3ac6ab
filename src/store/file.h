/* file.h - the one place through which all file access of the store goes
 *
 * Each call is one system call, repeated after EINTR and completed after a short transfer, with an
 * error that names the path.  ENOSPC, EDQUOT and EFBIG are MODAL_STORAGE_FULL, ENOENT is
 * MODAL_NOT_FOUND, EMFILE and ENFILE are MODAL_BUSY, everything else MODAL_IO.  SQLite comes
 * through here too, by the VFS of file_vfs.c, and HDF5's writer by the driver of file_h5.c.
 *
 * In builds with MODALD_FAULTS the n-th call of a kind can be made to fail, by the environment or
 * by file_fault:
 *
 *     MODALD_FAULT=CALL:N:WHAT[,CALL:N:WHAT...]     CALL a name of file_calls or `any`; N counts
 *                                                   from 1, `N+` is N and all after
 *     WHAT  EIO ENOSPC EDQUOT EMFILE EACCES ENOENT    the call fails so and does nothing
 *           EINTR                                     it is interrupted once, and must be repeated
 *           short                                     a transfer moves half its bytes, and must be
 *                                                     completed
 *           kill                                      SIGKILL to this process before the call
 *           kill-after                                SIGKILL after it
 */
#ifndef STORE_FILE_H
#define STORE_FILE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>
#include "base/error.h"

enum file_call {
    FILE_OPEN, FILE_PREAD, FILE_PWRITE, FILE_FSYNC, FILE_FDATASYNC, FILE_FTRUNCATE, FILE_FALLOCATE,
    FILE_RENAME, FILE_UNLINK, FILE_MKDIR, FILE_CALL_COUNT
};
extern const char *const file_calls[FILE_CALL_COUNT];   /* "open", "pread", ... */

/* Open PATH with open(2)'s FLAGS (O_CLOEXEC is added) and MODE; the caller closes *FD.  What is no
 * file (with O_DIRECTORY: no folder), such as a FIFO, is MODAL_IO, and nobody waits for its other
 * end; nor, to write, is a link: what it leads to may be another's. */
enum modal_status file_open(const char *path, int flags, mode_t mode, int *fd,
                            struct modal_error *err);

/* All LENGTH bytes, at OFFSET. */
enum modal_status file_write(int fd, const void *data, size_t length, uint64_t offset,
                             struct modal_error *err);
/* Up to LENGTH bytes; *GOT is less only at the end of the file. */
enum modal_status file_read(int fd, void *data, size_t length, uint64_t offset, size_t *got,
                            struct modal_error *err);

/* Data and size on stable storage.  After a failure the file's state is unknown: never call it
 * again, end the process. */
enum modal_status file_sync(int fd, struct modal_error *err);
/* Let the disk begin with what was written to [OFFSET, OFFSET + LENGTH); nothing is durable before
 * file_sync, which then has less to wait for.  A failure is one of file_sync. */
enum modal_status file_sync_begin(int fd, uint64_t offset, uint64_t length,
                                  struct modal_error *err);
/* The directory's entries on stable storage: after a file is made, renamed or unlinked in it. */
enum modal_status file_sync_dir(const char *path, struct modal_error *err);

/* Make the file LENGTH bytes long, shorter or longer with zeros. */
enum modal_status file_truncate(int fd, uint64_t length, struct modal_error *err);
/* Reserve blocks for the first LENGTH bytes, extending the file: later writes there cannot meet a
 * full disk. */
enum modal_status file_reserve(int fd, uint64_t length, struct modal_error *err);
enum modal_status file_rename(const char *from, const char *to, struct modal_error *err);
/* A PATH that is not there is no error. */
enum modal_status file_unlink(const char *path, struct modal_error *err);
/* A folder that is there already is no error. */
enum modal_status file_make_dir(const char *path, mode_t mode, struct modal_error *err);

/* A whole file, durably and at once: written to PATH.tmp, synced, renamed, its folder synced. */
enum modal_status file_put(const char *path, const void *data, size_t length, mode_t mode,
                           struct modal_error *err);
/* A whole file of at most MOST bytes; the caller frees *DATA, which is followed by a zero byte. */
enum modal_status file_get(const char *path, size_t most, char **data, size_t *length,
                           struct modal_error *err);

enum { FILE_PAGE_DATA = 4088 };    /* bytes of a database's page before its checksum */

/* The name of SQLite's VFS that passes this place; registered at the first call. */
const char *file_vfs(void);
/* Whether the 4096 bytes of PAGE, from OFFSET of a database written through it, carry the right
 * checksum. */
bool file_vfs_page_good(const void *page, int64_t offset);

/* Set the fault of this process from TEXT as above, NULL for none, and restart the counts.  Without
 * MODALD_FAULTS it does nothing and returns false. */
bool file_fault(const char *text);
/* How many calls of CALL there were since the last file_fault (0 without MODALD_FAULTS). */
long file_fault_count(enum file_call call);

#endif
