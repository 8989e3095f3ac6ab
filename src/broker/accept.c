/*
 * accept.c - see accept.h: what libzmq cannot limit, and what it ends the process for
 *
 * A connection that no descriptor is left for is one that was broken off: libzmq's listener of ipc takes EMFILE of accept4
 * for a fault of its own and aborts; its listener of tcp, and both for ECONNABORTED, try again at once, for as long as the
 * connection waits (libzmq 4.3.4, ipc_listener.cpp and tcp_listener.cpp): hence the nap, which those who are connected hardly
 * notice and a core does.  A function of the program comes before the C library's of the same name, for the libraries too:
 * accept4 and close, both called by libzmq for each connection.
 */
#include "broker/accept.h"
#include <errno.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

enum { TRACKED = 65536, OWN = 128 };         /* descriptors whose connections are counted; those kept for ourselves */

static _Atomic unsigned char counted[TRACKED];
static atomic_int open_now, most_open;
static atomic_long refused;

int accept_default(void)
{
    struct rlimit limit = { 0, 0 };
    long most;

    getrlimit(RLIMIT_NOFILE, &limit);
    most = limit.rlim_cur > TRACKED ? TRACKED : (long)limit.rlim_cur;
    return (int)(most > 2 * OWN ? most - OWN : most > 1 ? most / 2 : 1);
}

void accept_most(int most)
{
    int room = accept_default();

    atomic_store(&most_open, most > 0 && most < room ? most : room);
}

int accept_open(void)
{
    return atomic_load(&open_now);
}

long accept_refused(void)
{
    return atomic_load(&refused);
}

/* Whether LISTENER is the workers' private one, by its name. */
static bool for_workers(int listener)
{
    static const char name[] = "/workers.ipc";
    struct sockaddr_un at;
    socklen_t size = sizeof at;
    size_t length;

    memset(&at, 0, sizeof at);
    if (getsockname(listener, (struct sockaddr *)&at, &size) != 0 || at.sun_family != AF_UNIX)
        return false;
    length = strnlen(at.sun_path, sizeof at.sun_path);
    return length >= sizeof name - 1 && memcmp(at.sun_path + length - (sizeof name - 1), name, sizeof name - 1) == 0;
}

static int broken_off(void)
{
    nanosleep(&(struct timespec) { .tv_nsec = 50000 }, NULL);
    errno = ECONNABORTED;
    return -1;
}

int accept4(int fd, struct sockaddr *restrict address, socklen_t *restrict length, int flags)
{
    int most = atomic_load(&most_open), out = (int)syscall(SYS_accept4, fd, address, length, flags);

    if (out < 0)
        return errno == EMFILE ? broken_off() : out;
    if (most == 0 || out >= TRACKED || for_workers(fd))
        return out;
    if (atomic_load(&open_now) >= most) {
        syscall(SYS_close, out);
        atomic_fetch_add(&refused, 1);
        return broken_off();
    }
    counted[out] = 1;
    atomic_fetch_add(&open_now, 1);
    return out;
}

int close(int fd)
{
    if (fd >= 0 && fd < TRACKED && atomic_exchange(&counted[fd], 0) != 0)
        atomic_fetch_sub(&open_now, 1);
    return (int)syscall(SYS_close, fd);
}
