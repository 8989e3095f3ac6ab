/* sender.c - see sender.h */
#include "sender.h"
#include "connection.h"
#include "frames.h"
#include "messages.h"
#include "ring.h"
#include "spill.h"
#include <fcntl.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <sys/syscall.h>
#include <unistd.h>

static const double frame_age_most = 0.02;     /* s: then it goes out, full or not */
static const double idle_most = 0.005;         /* s between two looks, where nothing comes */

/* What came in.  True: something did. */
static bool receive_all(modald_stream *s)
{
    size_t taken = 0, cost = 1;

    if (s->socket == NULL && (now() < s->begin_at || !open_link(s)))
        return false;
    read_monitor(s);
    for (; cost > 0 && taken <= BACKLOG_MOST; taken += cost)
        cost = receive(s);
    if (taken > BACKLOG_MOST)
        s->pause = pause_most;
    if (s->lost || taken > BACKLOG_MOST)
        drop_link(s);
    return taken > 0;
}

/* Is everything that was pushed acknowledged? */
static bool drained(const modald_stream *s)
{
    return s->taken == atomic_load(&s->page->head) && s->build.count == 0 && s->frames == 0
        && !spilling(s);
}

/* One turn: what came in, what was pushed, what goes out.  True: something moved. */
static bool turn(modald_stream *s, bool flush)
{
    uint64_t before = s->taken;
    bool moved = receive_all(s);

    if (s->refused) { /* nobody wants them: the ring stays empty */
        release(s, s->taken = atomic_load(&s->page->head));
        return false;
    }
    build_frames(s);
    if (s->build.count > 0 && (flush || now() > s->build_since + frame_age_most))
        finish_build(s);
    spill_if_needed(s, false);
    fill_window(s);
    if (s->ready && !s->opened && !s->opening && (s->frames > 0 || flush)
        && now() >= s->quiet_until)
        send_open(s);
    if (s->opened)
        send_frames(s);
    if ((s->opening || s->flying > 0) && now() > s->asked_at + answer_patience)
        drop_link(s);
    return moved || s->taken != before;
}

static void finish(modald_stream *s, double until)
{
    while (!s->refused && now() < until && !(drained(s) && (s->closed || !s->seal))) {
        bool moved = turn(s, true);
        if (s->taken == atomic_load(&s->page->head))
            end_resampling(s);
        if (drained(s) && s->opened && !s->closing)
            send_close(s);
        if (!moved)
            sleep_for(moment);
    }
}

/* What could not be sent goes into the spill file. */
static void spill_unsent(modald_stream *s)
{
    if (s->refused || drained(s))
        return;
    do {
        finish_build(s);
        spill_if_needed(s, true);
        build_frames(s);
    } while (!s->spill_failed && s->spill_most > 0 && s->taken < atomic_load(&s->page->head));
    end_resampling(s);
    finish_build(s);
    spill_if_needed(s, true);
}

/* A table of descriptors of our own: stderr and the ring's lock from the host's, nothing on 0
 * and 1.  A kernel before 5.9 has no such call, and it is shared. */
static void unshare_descriptors(modald_stream *s)
{
    unsigned keep = s->ring_fd > 2 ? (unsigned)s->ring_fd : 2, unshare_too = 2;
    int null;

    if (syscall(SYS_close_range, keep + 1, ~0u, unshare_too) != 0)
        return;
    s->own_descriptors = true;
    if (keep > STDERR_FILENO + 1)
        syscall(SYS_close_range, 3u, keep - 1, 0u);
    null = open("/dev/null", O_RDWR | O_CLOEXEC);
    for (int fd = 0; fd < 3 && null >= 0; fd++)
        if (fd != null && (fd < 2 || fcntl(fd, F_GETFD) < 0))
            dup2(null, fd);
    if (null > 2)
        close(null);
}

/* The spill file goes when it is empty; else it is said where it is. */
static void end_spill(modald_stream *s)
{
    char text[700];
    bool left = spilling(s);

    if (s->spill_fd < 0)
        return;
    close(s->spill_fd);
    if (!left)
        unlink(s->spill_path);
    snprintf(text, sizeof text, "some samples could not be sent; `modalctl replay %s` sends them",
             s->spill_path);
    if (left)
        warn(s->name, text);
}

static void end_sending(modald_stream *s)
{
    uint64_t dropped = atomic_load(&s->dropped);
    char text[100];

    close_socket(s);
    snprintf(text, sizeof text, "%llu samples were dropped; the record shows the gap",
             (unsigned long long)dropped);
    if (dropped > 0)
        warn(s->name, text);
    end_spill(s);
    if (s->ring_fd >= 0)
        close(s->ring_fd);
}

static void *sender(void *argument)
{
    modald_stream *s = argument;
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    double idle = moment;

    uselocale(c);
    unshare_descriptors(s);
    sem_post(&s->begun);
    if (!connect_socket(s)) {
        s->refused = true;
        warn_once(s, "no socket to the daemon; the run goes on without it");
    }
    while (atomic_load(&s->stop) == 0) {
        bool moved = s->refused ? (release(s, s->taken = atomic_load(&s->page->head)), false)
                                : turn(s, false);
        idle = moved ? moment : fmin(2 * idle, idle_most);
        sleep_for(idle);
    }
    s->seal = atomic_load(&s->page->head) > 0;
    if (!s->refused) {
        finish(s, now() + s->close_wait);
        spill_unsent(s);
    }
    end_sending(s);
    uselocale(LC_GLOBAL_LOCALE);
    freelocale(c);
    atomic_store(&s->finished, true);
    return NULL;
}
