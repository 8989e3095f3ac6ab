/*
 * hold.c - see hold.h: epoll_ctl as libzmq's I/O thread calls it
 *
 * libzmq may ask for a held connection's input as it likes: epoll does not hear of that, and recv
 * has nothing (intake.c).
 */
#include "broker/shell/hold.h"
#include "broker/shell/accept.h"
#include <pthread.h>
#include <stdatomic.h>
#include <stddef.h>
#include <sys/epoll.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Of each descriptor what libzmq asked for last, in which epoll; under `lock`, but for `held`,
 * which is changed under it alone. */
static struct watched {
    void *pointer;                              /* libzmq's; its I/O thread's */
    int epoll;
    uint32_t events;
    bool there;                                 /* in that epoll */
    bool free;                                  /* it has hung up: held no more */
    atomic_bool held;
} watched[CONNECTIONS_TRACKED];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

void *hold_pointer(int fd)
{
    return watched[fd].pointer;
}

/* WHAT, with FD's events as they are to be heard of. */
static int tell_epoll(int what, int fd)
{
    const struct watched *w = &watched[fd];
    struct epoll_event own = { .events = w->events };

    if (atomic_load(&w->held))
        own.events &= ~(uint32_t)EPOLLIN;
    own.data.u64 = HOLD_OURS | (uint64_t)fd;
    if ((own.events & EPOLLIN) == 0)
        own.data.u64 |= (own.events & EPOLLOUT) ? HOLD_NO_INPUT | HOLD_OUTPUT
                                                   : HOLD_NO_INPUT;
    if ((own.events & (EPOLLIN | EPOLLOUT)) == 0)
        own.events |= EPOLLET;
    return (int)syscall(SYS_epoll_ctl, w->epoll, what, fd, &own);
}

int epoll_ctl(int epoll, int what, int fd, struct epoll_event *event)
{
    struct watched *w;
    int rc;

    if (fd < 0 || fd >= CONNECTIONS_TRACKED)
        return (int)syscall(SYS_epoll_ctl, epoll, what, fd, event);
    w = &watched[fd];
    pthread_mutex_lock(&lock);
    w->there = what != EPOLL_CTL_DEL;
    if (what != EPOLL_CTL_MOD) {                /* the number may be another's next, read by recv */
        w->free = false;
        atomic_store(&w->held, false);
    }
    if (event == NULL || what == EPOLL_CTL_DEL)
        rc = (int)syscall(SYS_epoll_ctl, epoll, what, fd, event);
    else {
        w->pointer = event->data.ptr;
        w->epoll = epoll;
        w->events = event->events;
        rc = tell_epoll(what, fd);
    }
    pthread_mutex_unlock(&lock);
    return rc;
}

void hold_set(int fd, bool hold)
{
    struct watched *w;

    if (fd < 0 || fd >= CONNECTIONS_TRACKED)
        return;
    w = &watched[fd];
    pthread_mutex_lock(&lock);
    if (w->there && atomic_load(&w->held) != hold && !(hold && w->free)) {
        atomic_store(&w->held, hold);
        tell_epoll(EPOLL_CTL_MOD, fd);
    }
    pthread_mutex_unlock(&lock);
}

bool hold_is(int fd)
{
    return fd >= 0 && fd < CONNECTIONS_TRACKED && atomic_load(&watched[fd].held);
}

bool hold_end(int fd)
{
    const bool held = hold_is(fd);

    pthread_mutex_lock(&lock);
    watched[fd].free = true;
    pthread_mutex_unlock(&lock);
    hold_set(fd, false);
    return held;
}
