/*
 * libslow.c - preloaded: a sync takes at least $SYNC_US microseconds, as on a disk that does what
 * it says (F8)
 *
 * The disks of virtual machines often answer a sync in less than any medium can: what is gained by
 * syncing seldom does not show there.
 */
#include <dlfcn.h>
#include <stdint.h>
#include <stdlib.h>
#include <time.h>

static int64_t now_ns(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

static int slowly(const char *name, int fd)
{
    const char *text = getenv("SYNC_US");
    int64_t end = now_ns() + (text != NULL ? atol(text) : 0) * INT64_C(1000), left;
    int (*real)(int), rc;

    *(void **)&real = dlsym(RTLD_NEXT, name);
    rc = real(fd);
    if ((left = end - now_ns()) > 0)
        nanosleep(&(struct timespec) { left / 1000000000, left % 1000000000 }, NULL);
    return rc;
}

int fsync(int fd)
{
    return slowly("fsync", fd);
}

int fdatasync(int fd)
{
    return slowly("fdatasync", fd);
}
