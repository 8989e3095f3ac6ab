/*
 * hangup.c - see hangup.h: epoll_wait as libzmq's I/O thread calls it
 *
 * A connection's input stops when its pipe to the loop is full (ZMQ_RCVHWM): libzmq 4.3.4 no longer
 * asks for EPOLLIN then.  A hang-up comes unasked.  libzmq takes it for input, finds that input is
 * stopped, and sets `_io_error` of the connection (stream_engine_base.cpp, in_event_internal, the
 * only place that sets it); out_event asserts that it is not set, but is called for heartbeats, for
 * the answer to a PING among what is read on (restart_input), and by epoll: the process ends.
 * (https://github.com/zeromq/libzmq/issues/4364.)  So a connection whose input is stopped must not
 * hear of a hang-up:
 *
 *   - epoll_ctl (hold.c) has the descriptor for an event's data, and marks where input is not asked
 *     for; epoll_wait gives libzmq's own pointer back.
 *   - A marked event's hang-up is dropped; where output is asked for, it is said to be possible:
 *     the write then fails, and libzmq asks for it no more.  What asks for neither is
 *     edge-triggered: its hang-up comes once, and the thread sleeps.
 *   - An unmarked one's becomes EPOLLIN, once.  libzmq would call in_event for the hang-up and
 *     again for the input, and the first call may stop it.  Between epoll_wait and that one call
 *     nothing else can: input is stopped by input alone.
 *
 * The end is not lost: when the loop has taken what was sent, libzmq asks for EPOLLIN again, the
 * event is level-triggered as before, and the rest is read up to the end of the file.  A pipe that
 * nobody will ever read is ended by the heartbeat's time limit, which any message decoded would
 * have cancelled.  A connection is only ever accepted here, never made: one that connects waits for
 * EPOLLOUT alone, and is told so as well.  Nothing else in this process uses epoll (zmq_poll is
 * poll(2)).
 *
 * What is still to be taken of such a connection is taken in its turn, but for questions: nobody
 * reads the answer (accept_gone).
 *
 * Who hangs up while he is held (hold.h) is read to his end, and held no more.
 *
 * Other ways: without heartbeats, or with a patched out_event (not Debian's); ZMQ_RCVHWM 0, where
 * input never stops and a connection's memory has no bound; a front of our own for ZMTP and CURVE,
 * which would be a second library to keep.
 */
#include "broker/shell/hangup.h"
#include "broker/shell/accept.h"
#include "broker/shell/hold.h"
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/epoll.h>
#include <sys/syscall.h>
#include <unistd.h>

static atomic_long kept;

long hangup_kept(void)
{
    return atomic_load(&kept);
}

/* What libzmq is to hear of EVENT; 0: nothing. */
static uint32_t heard(const struct epoll_event *event)
{
    uint32_t events = event->events & ~(uint32_t)(EPOLLHUP | EPOLLERR);

    if (events == event->events || (event->data.u64 & HOLD_OURS) == 0)
        return event->events;
    if ((event->data.u64 & HOLD_NO_INPUT) == 0)
        return events | EPOLLIN;
    if (hold_end((int)(uint32_t)event->data.u64))
        return events;
    accept_hung_up((int)(uint32_t)event->data.u64);
    atomic_fetch_add_explicit(&kept, 1, memory_order_relaxed);
    return event->data.u64 & HOLD_OUTPUT ? events | EPOLLOUT : events;
}

int epoll_wait(int epoll, struct epoll_event *events, int most, int timeout)
{
    int count = (int)syscall(SYS_epoll_wait, epoll, events, most, timeout), n = 0;

    for (int i = 0; i < count; i++) {
        uint64_t data = events[i].data.u64;
        uint32_t left = heard(&events[i]);
        if (left == 0)
            continue;
        events[n].data.u64 = 0;
        events[n].data.ptr = data & HOLD_OURS ? hold_pointer((int)(uint32_t)data)
                                              : (void *)(uintptr_t)data;
        events[n++].events = left;
    }
    return count < 0 ? count : n;
}
