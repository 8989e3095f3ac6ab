/* libclock.c - preloaded: the wall clock set forwards or back while a program runs, by the seconds
 * in the file $CLOCK_STEP (F15) */
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t which, struct timespec *t)
{
    static int (*real)(clockid_t, struct timespec *);
    static int file = -1;
    char text[32] = "";
    int rc;

    if (real == NULL)
        *(void **)&real = dlsym(RTLD_NEXT, "clock_gettime");
    if (file < 0 && getenv("CLOCK_STEP") != NULL)
        file = open(getenv("CLOCK_STEP"), O_RDONLY | O_CLOEXEC);
    rc = real(which, t);
    if (rc == 0 && which == CLOCK_REALTIME && file >= 0 &&
        pread(file, text, sizeof text - 1, 0) > 0)
        t->tv_sec += strtol(text, NULL, 10);
    return rc;
}
