/*
 * libcut.c - preloaded: another program shortens SQLite's log right after its $CUT_AT-th sync
 *
 * That is between the commit of a group and all that the daemon does next: nobody from outside
 * comes there but by luck.  $CUT_BYTES, at the end, go; CUT_BYTES all: everything.  CUT_KILL=1: the
 * process ends there too, as by kill -9.
 */
#include <dlfcn.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static atomic_long synced;

static bool is_log(int fd)
{
    char link[64], path[4096];
    ssize_t length;

    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    length = readlink(link, path, sizeof path);
    return length > 4 && memcmp(path + length - 4, "-wal", 4) == 0;
}

int fdatasync(int fd)
{
    const char *at = getenv("CUT_AT"), *bytes = getenv("CUT_BYTES"), *end = getenv("CUT_KILL");
    struct stat known;
    int (*real)(int), rc;

    *(void **)&real = dlsym(RTLD_NEXT, "fdatasync");
    rc = real(fd);
    if (at == NULL || !is_log(fd) || atomic_fetch_add(&synced, 1) + 1 != atol(at))
        return rc;
    if (bytes != NULL && fstat(fd, &known) == 0
        && ftruncate(fd, strcmp(bytes, "all") == 0 ? 0 : known.st_size - atol(bytes)) != 0)
        _exit(9);
    if (end != NULL)
        kill(getpid(), SIGKILL);
    return rc;
}
