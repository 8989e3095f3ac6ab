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

static const double idle_most = 0.005;         /* s between two looks, where nothing comes */
/* s a stream: a look at one of a thousand takes some 0.4 us, for what it looks at is in the cache
 * no more, so that all looks together take a fiftieth of a processor. */
static const double look_pause = 20e-6;

static void take_in(struct link *l, modald_stream *s)
{
    int slot = 0;

    while (slot < l->slots && l->streams[slot] != NULL)
        slot++;
    l->slots += slot == l->slots;
    l->streams[slot] = s;
    s->slot = slot;
    s->refused = l->refused;
    begin_anew(s);
}

/* Streams that were opened.  A ring's file is opened here, where its descriptor is none of the
 * host's. */
static void greet(struct link *l)
{
    modald_stream *s = atomic_exchange(&l->arrived, NULL), *next;

    for (; s != NULL; s = next) {
        next = s->next;
        if (s->page != NULL || ring_open(s, s->ring_bytes, s->ring_file))
            take_in(l, s);
        sem_post(&s->begun);
    }
}

/* What came in.  True: something did. */
static bool receive_all(struct link *l)
{
    size_t most = BACKLOG_MOST + (size_t)l->slots * BACKLOG_EACH, taken = 0, cost = 1;

    if (l->socket == NULL && (l->refused || now() < l->begin_at || !open_link(l)))
        return false;
    read_monitor(l);
    for (; cost > 0 && taken <= most; taken += cost)
        cost = receive(l);
    if (taken > 0)
        l->heard_at = now();
    if (taken > most)
        l->pause = pause_most;
    if (l->lost || taken > most)
        drop_link(l);
    return taken > 0;
}

/* Is everything that was pushed acknowledged? */
static bool drained(const modald_stream *s)
{
    return s->taken == atomic_load(&s->page->head) && s->build.count == 0 && s->frames == 0
        && !spilling(s);
}

static bool is_over(const modald_stream *s)
{
    return s->refused || now() >= s->until || (drained(s) && (s->closed || !s->seal));
}

/* A question of S has no answer for too long: it is asked again, by another connection where this
 * one has said nothing since. */
static void ask_again(modald_stream *s)
{
    if (s->link->heard_at > s->asked_at && !is_overdue(s->link))
        begin_anew(s);
    else
        drop_link(s->link);
}

/* What was pushed to S, and what goes out of it.  True: something did. */
static bool serve(modald_stream *s)
{
    bool flush = s->until > 0, sent;

    if (s->refused) { /* nobody wants them: the ring stays empty */
        release(s, s->taken = atomic_load(&s->page->head));
        release_copied(s);
        return false;
    }
    rest_ring(s);
    build_frames(s);
    send_due(s, flush);
    spill_if_needed(s, false);
    fill_window(s);
    if (s->link->ready && !s->opened && !s->opening && (s->frames > 0 || flush)
        && now() >= s->quiet_until)
        send_open(s);
    sent = s->opened && send_frames(s);
    if ((s->opening || s->flying > 0) && now() > s->asked_at + answer_patience)
        ask_again(s);
    if (flush && s->taken == atomic_load(&s->page->head))
        end_resampling(s);
    if (flush && drained(s) && s->opened && !s->closing)
        send_close(s);
    return sent;
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

/* A table of descriptors of our own: stderr from the host's, nothing on 0 and 1.  A kernel before
 * 5.9 has no such call, and it is shared. */
static void unshare_descriptors(void)
{
    unsigned unshare_too = 2;
    int null;

    if (syscall(SYS_close_range, STDERR_FILENO + 1u, ~0u, unshare_too) != 0)
        return;
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

    spill_unsent(s);
    snprintf(text, sizeof text, "%llu samples were dropped; the record shows the gap",
             (unsigned long long)dropped);
    if (dropped > 0)
        warn(s->name, text);
    end_spill(s);
    if (s->ring_fd >= 0)
        close(s->ring_fd);
    begin_anew(s);
    set_name(s, "");
    s->link->streams[s->slot] = NULL;
    atomic_store(&s->finished, true);
}

/* S is closed: until when it is sent and sealed. */
static void begin_end(modald_stream *s)
{
    s->seal = atomic_load(&s->page->head) > 0;
    s->until = now() + (now() < s->link->vain_until ? 0 : s->close_wait);
}

/* S is given up: in vain, where it waited and nothing moved meanwhile. */
static void note_vain(const modald_stream *s)
{
    struct link *l = s->link;

    if (now() >= s->until && s->until > l->vain_until && l->moved_at < s->until - s->close_wait)
        l->vain_until = s->until + s->close_wait;
}

/* A look at S.  True: something moved. */
static bool look_at(modald_stream *s)
{
    bool sent;

    if (s->until == 0 && atomic_load(&s->stop) != 0)
        begin_end(s);
    if (s->until == 0)
        return serve(s);
    sent = !is_over(s) && serve(s);
    if (is_over(s)) {
        note_vain(s);
        end_sending(s);
    }
    return sent;
}

/* More of S than one frame waits for the daemon, or its opening does. */
static bool presses(const modald_stream *s)
{
    return s->opening || s->frames > 1;
}

/* One turn: what came in, then a look at every stream, first at those that had no turn when all
 * was asked that may be.  The pause until the next: short only where more may go out soon. */
static double turn(struct link *l, double idle)
{
    bool moved, closing = false, pressed = false;
    int streams = 0, first = l->start;

    l->start = 0;
    l->fast = false;
    moved = receive_all(l);
    for (int i = 0; i < l->slots; i++) {
        int slot = (first + i) % l->slots;
        if (l->streams[slot] == NULL)
            continue;
        streams++;
        moved |= look_at(l->streams[slot]);
        closing |= l->streams[slot] != NULL && l->streams[slot]->until > 0;
        pressed |= l->streams[slot] != NULL && presses(l->streams[slot]);
        if (l->start == 0 && l->asked >= ASKED_MOST)
            l->start = slot + 1;
    }
    send_together(l);
    while (l->slots > 0 && l->streams[l->slots - 1] == NULL)
        l->slots--;
    return closing ? moment
         : fmax(streams * look_pause,
                moved && (pressed || l->fast) ? moment : fmin(2 * idle, idle_most));
}

static void *sender(void *argument)
{
    struct link *l = argument;
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    double idle = moment;

    uselocale(c);
    unshare_descriptors();
    make_context(l);
    sem_post(&l->begun);
    if (!connect_socket(l)) {
        l->refused = true;
        warn_all(l, "no socket to the daemon; the run goes on without it");
    }
    while (!atomic_load(&l->stop) || l->slots > 0) {
        greet(l);
        idle = turn(l, idle);
        sleep_for(idle);
    }
    close_socket(l);
    uselocale(LC_GLOBAL_LOCALE);
    freelocale(c);
    return NULL;
}
