/*
 * accept.c - see accept.h: what libzmq cannot limit, and what it ends the process for
 *
 * A connection that no descriptor is left for is one that was broken off: libzmq's listener of ipc
 * takes EMFILE of accept4 for a fault of its own and aborts; its listener of tcp, and both for
 * ECONNABORTED, try again at once, for as long as the connection waits (libzmq 4.3.4,
 * ipc_listener.cpp and tcp_listener.cpp): hence the nap, which those who are connected hardly
 * notice and a core does.  A function of the program comes before the C library's of the same
 * name, for the libraries too: accept4 and close, both called by libzmq for each connection.
 *
 * The loop takes a message from each connection in turn, also from those that have hung up: who
 * sends much, goes, and comes again would soon leave thousands of them behind, and everybody else
 * would wait for their turns.  While LEFT_MOST are to be worked off no other is accepted.
 *
 * Who has not even begun to speak has no place before one who may: where there are no more, the
 * connection that has been silent for longest ends (RIPE_MS at least, so that a handshake under way
 * is left alone), and who comes waits until its descriptor is free.  Else as many as there may be,
 * silent, would keep everybody else out for the three seconds that a handshake may take, and those
 * waiting behind them again.
 *
 * libzmq says of a message by which descriptor it came, and to nobody that a connection has ended:
 * close does.  A number that was given out again meanwhile would name another connection,
 * so that it is kept until the loop has taken what is left.
 */
#include "broker/shell/accept.h"
#include "broker/shell/intake.h"
#include <errno.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

enum { OWN = 128 };           /* descriptors kept for ourselves: files, pipes, libzmq's own */
enum { LEFT_MOST = 64 };    /* turns of the loop, of a microsecond each: a question takes as long */
enum { RIPE_MS = 100 };     /* of four ways of 25 ms, across a continent: CURVE's handshake */
enum { NONE = -1 };   /* no descriptor: these begin at 0 */

/* What a descriptor is.  ENDED: its connection is shut down,
 * and its number held until the loop is done with it. */
enum { OTHER, CLIENT, WORKER, ENDED_CLIENT, ENDED_WORKER };

static _Atomic unsigned char kinds[CONNECTIONS_TRACKED];
static atomic_bool hung_up[CONNECTIONS_TRACKED];
static atomic_int next_ended[CONNECTIONS_TRACKED];
static atomic_int last_ended = NONE;       /* a list through next_ended, to which any thread adds */
static int taken_up = NONE;                  /* the loop's part of it */
static atomic_int open_now, left_behind, most_open, wake_fd = NONE;
static atomic_int evicted = NONE;                /* ended for another, until accept_free */
static atomic_long refused;

/* Of the descriptors of this process, those that clients may have: the rest is for files, workers
 * and ourselves. */
static int accept_default(void)
{
    struct rlimit limit = { 0, 0 };
    long most;

    getrlimit(RLIMIT_NOFILE, &limit);
    most = limit.rlim_cur > CONNECTIONS_TRACKED ? CONNECTIONS_TRACKED : (long)limit.rlim_cur;
    return (int)(most > 2 * OWN ? most - OWN : most > 1 ? most / 2 : 1);
}

void accept_most(int most)
{
    int room = accept_default();

    atomic_store(&most_open, most > 0 && most < room ? most : room);
}

void accept_wake(int wake)
{
    atomic_store(&wake_fd, wake);
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
    return length >= sizeof name - 1
        && memcmp(at.sun_path + length - (sizeof name - 1), name, sizeof name - 1) == 0;
}

static int broken_off(void)
{
    nanosleep(&(struct timespec) { .tv_nsec = 50000 }, NULL);
    errno = ECONNABORTED;
    return -1;
}

/* FD is closed and the connection refused. */
static int refuse(int fd)
{
    syscall(SYS_close, fd);
    atomic_fetch_add(&refused, 1);
    return broken_off();
}

/* Whether a place will soon be free for who waits: that of a silent connection. */
static bool make_room(void)
{
    int silent;
    int64_t ms;

    if (atomic_load(&evicted) != NONE)
        return true;
    if (!intake_silent(&silent, &ms))
        return false;
    if (ms >= RIPE_MS) {
        atomic_store(&evicted, silent);
        atomic_fetch_add(&refused, 1);
        shutdown(silent, SHUT_RDWR);
    }
    return true;
}

int accept4(int fd, struct sockaddr *restrict address, socklen_t *restrict length, int flags)
{
    int most = atomic_load(&most_open), out;
    bool worker = for_workers(fd);

    if (!worker && (atomic_load(&left_behind) >= LEFT_MOST
                    || (most > 0 && atomic_load(&open_now) >= most && make_room())))
        return broken_off();                     /* it stays in the listener's queue */
    out = (int)syscall(SYS_accept4, fd, address, length, flags);
    if (out < 0 && errno == EMFILE) {
        make_room();
        return broken_off();
    }
    if (out < 0 || most == 0)
        return out;
    if (out >= CONNECTIONS_TRACKED || (!worker && atomic_load(&open_now) >= most))
        return refuse(out);
    intake_begin(out, !worker);
    atomic_store(&hung_up[out], false);
    atomic_store(&kinds[out], worker ? WORKER : CLIENT);
    if (!worker)
        atomic_fetch_add(&open_now, 1);
    return out;
}

void accept_hung_up(int fd)
{
    if (!atomic_exchange_explicit(&hung_up[fd], true, memory_order_relaxed))
        atomic_fetch_add(&left_behind, 1);
}

bool accept_gone(int fd)
{
    unsigned char kind = fd >= 0 && fd < CONNECTIONS_TRACKED
                             ? atomic_load_explicit(&kinds[fd], memory_order_relaxed) : OTHER;

    return kind == ENDED_CLIENT || kind == ENDED_WORKER
        || (kind != OTHER && atomic_load_explicit(&hung_up[fd], memory_order_relaxed));
}

/* To the list of the ended; the loop is woken for the first alone. */
static void note_ended(int fd)
{
    uint64_t one = 1;
    int last = atomic_load(&last_ended), wake = atomic_load(&wake_fd);

    do
        atomic_store(&next_ended[fd], last);
    while (!atomic_compare_exchange_weak(&last_ended, &last, fd));
    if (last == NONE && wake >= 0 && write(wake, &one, sizeof one) < 0)
        return;                                  /* it is readable already */
}

int close(int fd)
{
    unsigned char kind = fd >= 0 && fd < CONNECTIONS_TRACKED ? atomic_load(&kinds[fd]) : OTHER;

    if (kind != CLIENT && kind != WORKER)
        return (int)syscall(SYS_close, fd);
    shutdown(fd, SHUT_RDWR);
    intake_end(fd);
    if (atomic_load(&hung_up[fd]))
        atomic_fetch_sub(&left_behind, 1);
    atomic_store(&kinds[fd], kind == CLIENT ? ENDED_CLIENT : ENDED_WORKER);
    note_ended(fd);
    return 0;
}

bool accept_ended(void)
{
    if (taken_up == NONE)
        taken_up = atomic_exchange(&last_ended, NONE);
    return taken_up != NONE;
}

int accept_next(void)
{
    int fd = taken_up;

    if (fd != NONE)
        taken_up = atomic_load(&next_ended[fd]);
    return fd;
}

void accept_free(int fd)
{
    unsigned char kind = atomic_exchange(&kinds[fd], OTHER);

    syscall(SYS_close, fd);
    if (kind == ENDED_CLIENT)
        atomic_fetch_sub(&open_now, 1);
    if (atomic_load(&evicted) == fd)
        atomic_store(&evicted, NONE);
}
