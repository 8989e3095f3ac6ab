/* folder.c - see folder.h */
#include "store/folder.h"
#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>
#include "base/sha256.h"
#include "store/file.h"

/* Why there is no folder PATH, which the configuration's key `data` wants: WHY is the system's. */
static enum modal_status refuse(const char *path, const struct modal_error *why,
                                struct modal_error *err)
{
    struct stat known;

    if (lstat(path, &known) == 0 && S_ISLNK(known.st_mode) && stat(path, &known) != 0)
        return modal_fail_field(err, why->status, "data", "%s is a link to nothing; accepted: a "
                                "folder, or the name of one to be made", path);
    if (stat(path, &known) == 0 && !S_ISDIR(known.st_mode))
        return modal_fail_field(err, why->status, "data", "%s is no folder; accepted: a folder, or "
                                "the name of one to be made", path);
    return modal_fail_field(err, why->status, "data", "the data folder cannot be made (%s); "
                            "accepted: a folder, or the name of one to be made in a folder that is "
                            "there and may be written", why->message);
}

enum modal_status folder_make(const char *dir, struct modal_error *err)
{
    static const char *const inside[] = { "", "/spool", "/results" };
    char path[4200];
    enum modal_status rc = MODAL_OK;
    struct modal_error why;

    for (size_t i = 0; rc == MODAL_OK && i < sizeof inside / sizeof *inside; i++) {
        snprintf(path, sizeof path, "%s%s", dir, inside[i]);
        rc = file_make_dir(path, 0750, &why);
    }
    if (rc != MODAL_OK)
        return refuse(path, &why, err);
    if (rc == MODAL_OK)
        rc = file_sync_dir(dir, err);
    snprintf(path, sizeof path, "%s/..", dir);
    return rc == MODAL_OK ? file_sync_dir(path, err) : rc;
}

/* A daemon that was killed holds its locks until its threads' writes have ended and a process that
 * it was starting has come to its exec, which closes them: who starts again at once waits for that,
 * a loaded disk's fsync, instead of being refused. */
enum {
    LOCK_TRIES    = 100,         /* 2 s in all */
    LOCK_PAUSE_NS = 20000000,   /* 20 ms: a start is not held up by more */
};

static bool lock_file(int fd)
{
    for (int tries = 1; flock(fd, LOCK_EX | LOCK_NB) < 0; tries++) {
        if (errno != EWOULDBLOCK || tries == LOCK_TRIES)
            return false;
        nanosleep(&(struct timespec) { .tv_nsec = LOCK_PAUSE_NS }, NULL);
    }
    return true;
}

enum modal_status folder_lock(const char *dir, int *lock, struct modal_error *err)
{
    char path[4200], pid[32];
    enum modal_status rc;

    snprintf(path, sizeof path, "%s/LOCK", dir);
    rc = file_open(path, O_RDWR | O_CREAT, 0640, lock, err);
    if (rc != MODAL_OK)
        return rc;
    if (!lock_file(*lock)) {
        size_t got = 0;
        file_read(*lock, pid, sizeof pid - 1, 0, &got, NULL);
        pid[got] = 0;
        return modal_fail(err, MODAL_BUSY, "the data folder %s is in use by the daemon with pid %d",
                          dir, atoi(pid));
    }
    snprintf(pid, sizeof pid, "%d\n", (int)getpid());
    rc = file_truncate(*lock, 0, err);
    if (rc == MODAL_OK)
        rc = file_write(*lock, pid, strlen(pid), 0, err);
    return rc == MODAL_STORAGE_FULL ? MODAL_OK : rc;     /* the pid is for people only */
}

/* A copy of the folder has the same store id: of all on this host, one may run.  All users of the
 * host can read the name, so it does not tell the id. */
enum modal_status folder_bind(const char *dir, const char *store, int *out,
                              struct modal_error *err)
{
    struct sockaddr_un name = { .sun_family = AF_UNIX };
    uint8_t digest[32];
    char hex[65];
    int length;

    snprintf(hex, sizeof hex, "name %s", store);
    sha256_of(hex, strlen(hex), digest);
    sha256_hex(digest, hex);
    length = snprintf(name.sun_path + 1, sizeof name.sun_path - 1, "modald-store-%.32s", hex);

    *out = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (*out < 0)
        return modal_fail(err, MODAL_IO, "socket: %s", strerror(errno));
    if (bind(*out, (struct sockaddr *)&name,
             (socklen_t)(offsetof(struct sockaddr_un, sun_path) + 1 + (size_t)length))
        == 0)
        return MODAL_OK;
    if (errno == EADDRINUSE)
        return modal_fail(err, MODAL_BUSY,
                          "the data folder %s is a copy of one whose daemon is running (store %s)",
                          dir, store);
    return modal_fail(err, MODAL_IO, "bind: %s", strerror(errno));
}
