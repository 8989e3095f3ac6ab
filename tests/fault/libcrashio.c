/*
 * libcrashio.c - an LD_PRELOAD shim that records every change to the files below $CRASHIO_DIR, with
 * its data, in order
 *
 * From the record $CRASHIO_LOG a generator builds the states a power cut may leave: what was
 * synced, and any of the rest.  One record:  u8 op, u8 0, u16 name length, u32 inode, u64 offset,
 * u64 length, name, data (of `w` and `a` only)
 *
 *     w write at offset    t truncate to offset  f reserve up to offset  s file synced  d directory
 *                          synced
 *     c name made (offset: 1 a directory)           u name removed  r renamed (data: the new name;
 *                                                   op carries it)
 *     a acknowledgement: what was written to descriptor 9
 *
 * Files are told by inode, names by path below the folder.  Shared memory (-shm) is rebuilt by
 * SQLite and left out.
 */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static int log_fd = -1;
static char root[4096];

#define REAL(NAME) ((__typeof__(&NAME))dlsym(RTLD_NEXT, #NAME))

__attribute__((constructor)) static void start(void)
{
    const char *path = getenv("CRASHIO_LOG"), *folder = getenv("CRASHIO_DIR");

    if (path == NULL || folder == NULL || realpath(folder, root) == NULL)
        return;
    log_fd = REAL(open)(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
}

static void record(char op, uint32_t inode, uint64_t offset, const char *name, const void *data,
                   uint64_t length)
{
    struct __attribute__((packed)) {
        uint8_t op, zero;
        uint16_t name;
        uint32_t inode;
        uint64_t offset, length;
    } head = {
        (uint8_t)op, 0,      (uint16_t)(name != NULL ? strlen(name) : 0),
        inode,       offset, data != NULL ? length : 0,
    };
    struct iovec parts[3] = { { &head, sizeof head },
                              { (void *)(uintptr_t)name, head.name },
                              { (void *)(uintptr_t)data, head.length } };
    ssize_t total = (ssize_t)(sizeof head + head.name + head.length);

    if (writev(log_fd, parts, 3) != total)
        abort();
}

/* The path of NAME below the folder, or NULL: not ours. */
static const char *below(const char *name, char full[4096])
{
    char folder[4096], resolved[4096];
    const char *slash = strrchr(name, '/');
    size_t length = strlen(root);

    if (log_fd < 0)
        return NULL;
    snprintf(folder, sizeof folder, "%.*s",
             slash == NULL   ? 1
             : slash == name ? 1
                             : (int)(slash - name),
             slash == NULL ? "." : name);
    if (realpath(folder, resolved) == NULL || strncmp(resolved, root, length) != 0 ||
        (resolved[length] != 0 && resolved[length] != '/'))
        return NULL;
    snprintf(full, 4096, "%.2000s%s%.1000s", resolved[length] != 0 ? resolved + length + 1 : "",
             resolved[length] != 0 ? "/" : "", slash == NULL ? name : slash + 1);
    return strstr(full, "-shm") == NULL ? full : NULL;
}

/* The inode behind FD where its file lies below the folder, else 0; *NAME its path (may be NULL).
 */
static uint32_t ours(int fd, char *name)
{
    char link[64], path[4096], full[4096];
    struct stat known;
    ssize_t length;

    if (log_fd < 0 || fstat(fd, &known) < 0 || (!S_ISREG(known.st_mode) && !S_ISDIR(known.st_mode)))
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    length = readlink(link, path, sizeof path - 1);
    if (length < 0)
        return 0;
    path[length] = 0;
    if (S_ISDIR(known.st_mode)) {
        size_t base = strlen(root);
        if (strncmp(path, root, base) != 0 || (path[base] != 0 && path[base] != '/'))
            return 0;
        if (name != NULL)
            snprintf(name, 4096, "%s", path[base] != 0 ? path + base + 1 : "");
        return (uint32_t)known.st_ino;
    }
    return below(path, full) != NULL ? (uint32_t)known.st_ino : 0;
}

static void locked(char op, uint32_t inode, uint64_t offset, const char *name, const void *data,
                   uint64_t length)
{
    pthread_mutex_lock(&mutex);
    record(op, inode, offset, name, data, length);
    pthread_mutex_unlock(&mutex);
}

static int open_any(int at, const char *path, int flags, mode_t mode)
{
    char full[4096];
    const char *name = at == AT_FDCWD ? below(path, full) : NULL;
    struct stat known;
    int was = name != NULL && stat(path, &known) == 0;
    int fd = REAL(openat)(at, path, flags, mode);

    if (fd < 0 || name == NULL || fstat(fd, &known) < 0 || !S_ISREG(known.st_mode))
        return fd;
    if (!was)
        locked('c', (uint32_t)known.st_ino, 0, name, NULL, 0);
    else if (flags & O_TRUNC)
        locked('t', (uint32_t)known.st_ino, 0, NULL, NULL, 0);
    return fd;
}

static mode_t mode_of(int flags, va_list arguments)
{
    return flags & (O_CREAT | (O_TMPFILE & ~O_DIRECTORY)) ? va_arg(arguments, mode_t) : 0;
}

#define OPEN(NAME)                                           \
    int NAME(const char *path, int flags, ...)               \
    {                                                        \
        va_list arguments;                                   \
        mode_t mode;                                         \
        va_start(arguments, flags);                          \
        mode = mode_of(flags, arguments);                    \
        va_end(arguments);                                   \
        return open_any(AT_FDCWD, path, flags, mode);        \
    }
OPEN(open)
OPEN(open64)

ssize_t write(int fd, const void *data, size_t length)
{
    uint32_t inode = ours(fd, NULL);
    off_t at = inode != 0 ? lseek(fd, 0, SEEK_CUR) : 0;
    ssize_t done = REAL(write)(fd, data, length);

    if (done > 0 && fd == 9 && log_fd >= 0)
        locked('a', 0, 0, NULL, data, (uint64_t)done);
    else if (done > 0 && inode != 0)
        locked('w', inode, (uint64_t)at, NULL, data, (uint64_t)done);
    return done;
}

static ssize_t written(int fd, const void *data, ssize_t done, off_t offset)
{
    uint32_t inode = ours(fd, NULL);

    if (done > 0 && inode != 0)
        locked('w', inode, (uint64_t)offset, NULL, data, (uint64_t)done);
    return done;
}

ssize_t pwrite(int fd, const void *data, size_t length, off_t offset)
{
    return written(fd, data, REAL(pwrite)(fd, data, length, offset), offset);
}

ssize_t pwrite64(int fd, const void *data, size_t length, off64_t offset)
{
    return written(fd, data, REAL(pwrite64)(fd, data, length, offset), offset);
}

static int sized(char op, int fd, int rc, off_t length)
{
    uint32_t inode = ours(fd, NULL);

    if (rc == 0 && inode != 0)
        locked(op, inode, (uint64_t)length, NULL, NULL, 0);
    return rc;
}

int ftruncate(int fd, off_t length) { return sized('t', fd, REAL(ftruncate)(fd, length), length); }
int ftruncate64(int fd, off64_t length)
{
    return sized('t', fd, REAL(ftruncate64)(fd, length), length);
}
int posix_fallocate(int fd, off_t offset, off_t length)
{
    return sized('f', fd, REAL(posix_fallocate)(fd, offset, length), offset + length);
}
int posix_fallocate64(int fd, off64_t offset, off64_t length)
{
    return sized('f', fd, REAL(posix_fallocate64)(fd, offset, length), offset + length);
}

static int synced(int fd, int rc)
{
    char name[4096];
    struct stat known;
    uint32_t inode = ours(fd, name);

    if (rc == 0 && inode != 0 && fstat(fd, &known) == 0)
        locked(S_ISDIR(known.st_mode) ? 'd' : 's', inode, 0, S_ISDIR(known.st_mode) ? name : NULL,
               NULL, 0);
    return rc;
}

int fsync(int fd) { return synced(fd, REAL(fsync)(fd)); }
int fdatasync(int fd) { return synced(fd, REAL(fdatasync)(fd)); }

int rename(const char *from, const char *to)
{
    char a[4096], b[4096];
    const char *x = below(from, a), *y = below(to, b);
    int rc = REAL(rename)(from, to);

    if (rc == 0 && x != NULL && y != NULL)
        locked('r', 0, 0, x, y, strlen(y));
    return rc;
}

int unlink(const char *path)
{
    char full[4096];
    const char *name = below(path, full);
    int rc = REAL(unlink)(path);

    if (rc == 0 && name != NULL)
        locked('u', 0, 0, name, NULL, 0);
    return rc;
}

int mkdir(const char *path, mode_t mode)
{
    char full[4096];
    const char *name = below(path, full);
    int rc = REAL(mkdir)(path, mode);

    if (rc == 0 && name != NULL)
        locked('c', 0, 1, name, NULL, 0);
    return rc;
}
