/*
 * daemon.c - see daemon.h
 *
 * One thread owns the core and all sockets; it never waits for a disk.  A round: wait, take in what came (a bounded
 * number from each source, so that none starves another), step the core for each, carry out what it asks for.
 */
#include "base/log.h"
#include "broker/shell/daemon.h"
#include "broker/shell/accept.h"
#include "broker/shell/hangup.h"
#include "broker/shell/intake.h"
#include "broker/shell/notify.h"
#include "broker/shell/peers.h"
#include "broker/shell/pool.h"
#include "broker/shell/queue.h"
#include "broker/shell/zap.h"
#include "store/file.h"
#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>

#define FLUSH_LEAST_NS 1000000          /* ns */
#define TRIM_AFTER_NS (2 * SECOND)      /* of rest: when the ledger has had its own */
#define STRANGERS_NS SECOND             /* between two lines on keys or connections refused */
#define ROUND_NS 5000000                /* of one source, whose next message waits for the others' */
/* Bytes of a frame's box beside its own: name, nonce, flags, authenticator. */
enum { CURVE_COST = 33 };
enum { ROUND = 128, FRAMES_TAKEN = WIRE_FRAMES_MOST + 1, POLL_MOST = 4 + SLOTS_MOST };

struct daemon {
    struct config *config;
    config_again *again;
    void *again_context;
    struct core *core;
    struct ledger *ledger;
    struct ledger_thread *ledger_thread;
    struct spool_threads *spool;
    struct done_queue done;
    struct pool pool;
    struct peers clients, workers;
    void *context, *client_socket, *worker_socket, *zap;
    int signals;
    char worker_endpoint[PATH_ROOM], worker_folder[PATH_ROOM], program[PATH_ROOM];
    bool stop, terminating, ready;
    int status;
    int64_t trim_ns;              /* when to give memory back; 0: nothing happened since */
    int64_t watchdog_ns, next_ping_ns, drain_until_ns, next_flush_ns, next_metrics_ns, next_strangers_ns, flush_wait_ns;
    struct zap_refused strangers;  /* not told yet */
    int64_t next_ended_ns;         /* when connections that were ended may be told of again */
    long ended_told;               /* of intake_ended */
    uint64_t taken, ended_until;   /* messages; by then all of those whose connections have ended
                                      are taken */
};

static int64_t clock_ns(clockid_t clock)
{
    struct timespec t;

    clock_gettime(clock, &t);
    return t.tv_sec * SECOND + t.tv_nsec;
}

static struct moment moment_now(void)
{
    return (struct moment) { clock_ns(CLOCK_MONOTONIC), clock_ns(CLOCK_REALTIME) };
}

/* One line of logfmt, with its time: written before the answer that it is about, unless it is one of the many. */
static void write_line(const char *text)
{
    static char stamp[48];                         /* of the millisecond `stamped`: only one thread writes lines */
    static int64_t stamped = -1;
    int64_t now = clock_ns(CLOCK_REALTIME), millisecond = now / 1000000;
    time_t seconds = now / SECOND;
    struct tm tm;

    if (millisecond != stamped) {
        char date[24];
        gmtime_r(&seconds, &tm);
        strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%S", &tm);
        snprintf(stamp, sizeof stamp, "time=%s.%03dZ ", date, (int)(millisecond % 1000));
        stamped = millisecond;
    }
    fputs(stamp, stderr);
    fputs(text, stderr);
    putc('\n', stderr);
    if (strncmp(text, "level=info", 10) != 0)
        fflush(stderr);
}

static void log_line(const char *format, ...) __attribute__((format(printf, 1, 2)));
static void log_line(const char *format, ...)
{
    va_list args;
    char *text;

    va_start(args, format);
    text = log_vtext(format, args);
    va_end(args);
    if (text == NULL)
        abort();
    write_line(text);
    free(text);
}

static void log_error(const char *event, const struct modal_error *err)
{
    log_line("level=error event=%s code=%s field=\"%s\" message=\"%s\"", event,
             modal_status_code(err->status), err->field, err->message);
}

/* ---- carrying out what the core asks for ------------------------------------------------------------------------ */

static void step(struct daemon *d, const struct event *event);

static void peer_changed(void *context, uint64_t number, enum peer_change change)
{
    static const enum event_type events[] = { [PEER_FULL] = EVENT_PEER_FULL, [PEER_READY] = EVENT_PEER_READY, [PEER_GONE] = EVENT_PEER_GONE };

    step(context, &(struct event) { .type = events[change], .peer = number });
}

static void spawn(struct daemon *d, int slot)
{
    struct modal_error err;

    if (pool_spawn(&d->pool, slot))
        return;
    modal_fail(&err, MODAL_IO, "cannot start %s: %s", d->program, strerror(errno));
    log_error("spawn", &err);
    step(d, &(struct event) { .type = EVENT_EXIT, .slot = slot, .status = 127 << 8, .stderr_text = "" });
}

static void to_worker(struct daemon *d, struct action *a)
{
    struct peer *peer = peers_by_number(&d->workers, d->pool.slots[a->slot].peer);

    if (peer == NULL) {
        free(a->header);
        blob_drop(a->body);
        return;
    }
    peers_send(&d->workers, peer, a->verb, a->header, a->body);
}

static void hand_over(struct daemon *d, struct action *a)
{
    if (a->slot >= 0)
        pool_hand(&d->pool, a->slot, a->header, a->descriptor);
    close(a->descriptor);
    free(a->header);
}

static void to_client(struct daemon *d, struct action *a)
{
    struct peer *peer = peers_by_number(&d->clients, a->peer);
    enum peer_change change;

    if (peer == NULL) {                            /* gone, which the core was told */
        free(a->header);
        blob_drop(a->body);
        return;
    }
    change = peers_send(&d->clients, peer, a->verb, a->header, a->body);
    if (change != PEER_SAME)
        peer_changed(d, a->peer, change);
}

static void carry_out(struct daemon *d, struct action *a)
{
    switch (a->type) {
    case ACT_SEND:   to_client(d, a); break;
    case ACT_COMMIT: ledger_thread_put(d->ledger_thread, a->transaction); break;
    case ACT_TASK:   spool_threads_put(d->spool, a->task); break;
    case ACT_WORKER: to_worker(d, a); break;
    case ACT_HAND:   hand_over(d, a); break;
    case ACT_SPAWN:  spawn(d, a->slot); break;
    case ACT_KILL:   pool_kill(&d->pool, a->slot); break;
    case ACT_LOG:    write_line(a->header); free(a->header); break;
    case ACT_STOP:   d->stop = true; d->status = a->slot; break;
    }
}

/* Actions may cause further steps, which reuse the core's list: take it first. */
static void carry_out_all(struct daemon *d, const struct actions *actions)
{
    struct action few[16], *own = few;
    size_t count = actions->count;

    if (count == 0)
        return;
    if (count > sizeof few / sizeof *few)
        own = grab(count * sizeof *own);
    memcpy(own, actions->items, count * sizeof *own);
    for (size_t i = 0; i < count; i++)
        carry_out(d, &own[i]);
    if (own != few)
        free(own);
}

static void step(struct daemon *d, const struct event *event)
{
    core_connections(d->core, accept_open(), accept_refused(), intake_ended(),
                     hangup_kept());
    if (event->type == EVENT_REQUEST || event->type == EVENT_COMMITTED || event->type == EVENT_TASK)
        d->trim_ns = clock_ns(CLOCK_MONOTONIC) + TRIM_AFTER_NS;
    carry_out_all(d, core_step(d->core, event, moment_now()));
}

/* ---- messages --------------------------------------------------------------------------------------------------- */

struct message_blob { struct blob blob; zmq_msg_t message; };

static void release_message(struct blob *blob)
{
    struct message_blob *m = (struct message_blob *)blob;

    zmq_msg_close(&m->message);
    free(m);
}

/* A received frame as a blob that keeps the message, without a copy. */
static struct blob *blob_of(zmq_msg_t *message)
{
    struct message_blob *m = grab(sizeof *m);

    zmq_msg_init(&m->message);
    zmq_msg_move(&m->message, message);
    m->blob = (struct blob) { zmq_msg_data(&m->message), zmq_msg_size(&m->message), 1, release_message };
    return &m->blob;
}

struct received {
    struct blob *frames[FRAMES_TAKEN + 1];     /* without the routing id; the last is never filled */
    int count;                                 /* of all frames, also those that were dropped */
    struct peer *peer;
    char key[KEY_TEXT];
};

/* Whose FRAME is, the first after ROUTING.  libzmq names no descriptor where the other end's
 * address was gone when it was accepted: who cannot be answered is not heard. */
static void note_sender(struct peers *peers, struct received *r, zmq_msg_t *routing,
                        zmq_msg_t *frame)
{
    const char *user = zmq_msg_gets(frame, "User-Id");
    int fd = zmq_msg_get(frame, ZMQ_SRCFD);

    if (user != NULL)
        snprintf(r->key, sizeof r->key, "%s", user);
    if (fd < 0)
        return;
    r->peer = peers_by_routing(peers, zmq_msg_data(routing), zmq_msg_size(routing), fd);
    intake_taken(fd);
}

static bool receive_frame(struct peers *peers, zmq_msg_t *frame)
{
    zmq_msg_init(frame);
    if (zmq_msg_recv(frame, peers->socket, ZMQ_DONTWAIT) >= 0)
        return true;
    zmq_msg_close(frame);
    return false;
}

/* The next message of PEERS' socket; false: none.  Frames over the limit are received and dropped one by one. */
static bool receive(struct peers *peers, struct received *r)
{
    zmq_msg_t routing, frame;
    bool more;

    memset(r, 0, sizeof *r);
    if (!receive_frame(peers, &routing))
        return false;
    more = zmq_msg_more(&routing);
    while (more && receive_frame(peers, &frame)) {
        if (r->count == 0)
            note_sender(peers, r, &routing, &frame);
        more = zmq_msg_more(&frame);
        if (r->count < FRAMES_TAKEN)
            r->frames[r->count] = blob_of(&frame);
        r->count++;
        zmq_msg_close(&frame);
    }
    zmq_msg_close(&routing);
    return true;
}

static void release(struct received *r)
{
    for (int i = 0; i < r->count && i < FRAMES_TAKEN; i++)
        blob_drop(r->frames[i]);
}

static enum modal_status open_message(const struct received *r, const char *version, bool needs_id, struct wire_message *out, struct modal_error *err)
{
    struct wire_frame frames[FRAMES_TAKEN];

    for (int i = 0; i < r->count && i < FRAMES_TAKEN; i++)
        frames[i] = (struct wire_frame) { r->frames[i]->data, r->frames[i]->size };
    return wire_open(frames, r->count < FRAMES_TAKEN ? r->count : FRAMES_TAKEN, version, needs_id, out, err);
}

/* Whether nothing but an answer would come of R, and nobody is there to read it: many such left by
 * connections that are gone must not make the others wait. */
static bool is_vain(const struct received *r)
{
    char verb[WIRE_VERB_MOST + 1] = "";
    int found;

    if (!accept_gone(r->peer->fd))
        return false;
    if (r->count < 2 || r->frames[1]->size > WIRE_VERB_MOST)
        return true;
    memcpy(verb, r->frames[1]->data, r->frames[1]->size);
    found = wire_verb_find(verb);
    return found < 0 || wire_verb_role((enum wire_verb)found) == WIRE_ROLE_READ;
}

static void from_client(struct daemon *d, struct received *r)
{
    struct wire_message message;
    struct modal_error err;
    enum modal_status rc;

    if (is_vain(r))
        return;
    rc = open_message(r, WIRE_VERSION, true, &message, &err);
    step(d, &(struct event) { .type = EVENT_REQUEST, .peer = r->peer->number, .key = r->key, .message = rc == MODAL_OK ? &message : NULL,
                              .verb = message.verb, .id = message.id, .fault = &err, .body = r->frames + 3 });
    wire_close(&message);
}

static void from_worker(struct daemon *d, struct received *r)
{
    struct wire_message message;
    struct modal_error err;
    double pid = 0;
    int slot;

    slot = pool_slot_of_peer(&d->pool, r->peer->number);
    if (open_message(r, WIRE_WORKER, false, &message, &err) != MODAL_OK) {
        if (slot >= 0)
            step(d, &(struct event) { .type = EVENT_WORKER, .slot = slot, .fault = &err });
        else
            log_error("worker_frame", &err);
        return;
    }
    if (slot < 0 && strcmp(message.verb, "READY") == 0 && json_get_number(message.header, "", "pid", 1, 4194304, &pid, NULL) == MODAL_OK) {
        slot = pool_slot_of_pid(&d->pool, (pid_t)pid);
        if (slot >= 0 && d->pool.slots[slot].peer == 0)
            d->pool.slots[slot].peer = r->peer->number;
        else
            slot = -1;
    }
    if (slot >= 0)
        step(d, &(struct event) { .type = EVENT_WORKER, .slot = slot, .message = &message, .body = r->frames + 3 });
    wire_close(&message);
}

static bool take_messages(struct daemon *d, struct peers *peers, void (*handle)(struct daemon *, struct received *))
{
    struct received r;
    int64_t now = clock_ns(CLOCK_MONOTONIC);

    for (int n = 0; n < ROUND && clock_ns(CLOCK_MONOTONIC) - now < ROUND_NS; n++) {
        bool got = receive(peers, &r);
        d->taken++;
        if (got && r.peer != NULL && r.count > 0)
            handle(d, &r);
        release(&r);
        if (!got)
            return false;
    }
    return true;                                   /* perhaps more */
}

/* ---- connections that have ended ------------------------------------------------------------- */

/* Whether there are connections that ended before now. */
static bool note_ended(struct daemon *d)
{
    if (d->ended_until != 0)
        return true;
    if (!accept_ended())
        return false;
    d->ended_until = d->taken + (INTAKE_WAITING + 1) * (uint64_t)(accept_open() + SLOTS_MOST);
    return true;
}

/* What they had sent is taken: at once where their sockets have nothing more (DRAINED), else once
 * each connection has had its turns (libzmq takes one message from each in turn).  What they waited
 * for ends, and their descriptors are free. */
static void forget_ended(struct daemon *d, bool drained)
{
    int fd;

    if (!drained && d->taken < d->ended_until)
        return;
    d->ended_until = 0;
    while ((fd = accept_next()) >= 0) {
        uint64_t number = peers_ended(&d->clients, fd);
        peers_ended(&d->workers, fd);
        accept_free(fd);
        if (number != 0)
            peer_changed(d, number, PEER_GONE);
    }
}

/* ---- threads, children, signals --------------------------------------------------------------------------------- */

static void take_done(struct daemon *d)
{
    struct transaction *transactions;
    struct task *tasks, *task;
    bool pinged, fatal;

    done_take(&d->done, &transactions, &tasks, &pinged, &fatal);
    if (fatal) {                                   /* nothing more is acknowledged; a restart replays */
        log_error("storage", &d->done.error);
        d->stop = true;
        d->status = 1;
        return;
    }
    if (pinged)
        notify_manager("WATCHDOG=1");
    if (transactions != NULL)
        step(d, &(struct event) { .type = EVENT_COMMITTED, .transaction = transactions });
    while ((task = tasks) != NULL) {
        tasks = task->next;
        step(d, &(struct event) { .type = EVENT_TASK, .task = task });
    }
}

static void take_children(struct daemon *d)
{
    const char *text;
    int status, slot;

    while ((slot = pool_reap(&d->pool, &status, &text)) >= 0)
        step(d, &(struct event) { .type = EVENT_EXIT, .slot = slot, .status = status, .stderr_text = text });
}

/* Endpoints stay as they are while it runs: whoever changed them is told. */
static void tell_of_endpoints(const struct config *old, const struct config *fresh)
{
    bool same = old->bind_count == fresh->bind_count && old->ipc_mode == fresh->ipc_mode;

    for (int i = 0; same && i < old->bind_count; i++)
        same = strcmp(old->bind[i], fresh->bind[i]) == 0;
    if (!same)
        log_line("level=warning event=reload_later key=bind message=\"endpoints and ipc_mode are taken at the next start\"");
}

static void reload(struct daemon *d)
{
    struct config *fresh = grab(sizeof *fresh);
    struct modal_error err;

    notify_manager("RELOADING=1");
    if (d->again(fresh, d->again_context, &err) != MODAL_OK)
        log_error("reload_refused", &err);         /* the old one stays */
    else {
        struct config old = *d->config;
        tell_of_endpoints(&old, fresh);
        d->config->settings = fresh->settings;
        d->config->accounts = fresh->accounts;
        d->config->account_count = fresh->account_count;
        d->config->workers = fresh->workers;
        d->config->drain_s = fresh->drain_s;
        d->config->connections = fresh->connections;
        accept_most(fresh->connections);
        fresh->accounts = NULL;
        snprintf(d->config->settings.dir, sizeof d->config->settings.dir, "%s", old.data);
        config_done(&old);
        step(d, &(struct event) { .type = EVENT_SETTINGS, .settings = &d->config->settings });
    }
    config_done(fresh);
    free(fresh);
    notify_manager("READY=1");
}

static void terminate(struct daemon *d)
{
    if (d->terminating) {
        log_line("level=notice event=stop reason=\"second signal\"");
        d->stop = true;
        return;
    }
    d->terminating = true;
    d->drain_until_ns = clock_ns(CLOCK_MONOTONIC) + (int64_t)(d->config->drain_s * 1e9);
    log_line("level=notice event=terminate");
    notify_manager("STOPPING=1\nSTATUS=draining");
    step(d, &(struct event) { .type = EVENT_TERMINATE });
}

static void take_signals(struct daemon *d)
{
    unsigned char number;

    while (read(d->signals, &number, 1) == 1) {
        if (number == SIGCHLD)
            take_children(d);
        else if (number == SIGHUP)
            reload(d);
        else
            terminate(d);
    }
}

/* Keys that are on no list, one line for all of a while: a flood of them is not one of the log. */
static void log_strangers(struct daemon *d)
{
    log_line("level=notice event=audit what=refused keys=%lld key=%s address=%s",
             (long long)d->strangers.count,
             d->strangers.key[0] != 0 ? d->strangers.key : "-", d->strangers.address);
    d->strangers.count = 0;
}

/* The same for connections that were ended for what they sent. */
static void log_ended(struct daemon *d)
{
    long ended = intake_ended();

    log_line("level=warning event=connections_ended count=%ld "
             "message=\"not ZMTP 3, or more bytes than messages hold; see section 8 of "
             "PROTOCOL.md\"",
             ended - d->ended_told);
    d->ended_told = ended;
}

/* ---- time ------------------------------------------------------------------------------------------------------- */

static void write_metrics(struct daemon *d)
{
    struct blob *text = metrics_text(d->core, NULL);
    struct modal_error err;
    char path[PATH_ROOM + 8];
    FILE *file;

    snprintf(path, sizeof path, "%s.tmp", d->config->metrics_file);
    file = fopen(path, "w");
    if (file == NULL || fchmod(fileno(file), 0640) != 0
        || fwrite(text->data, 1, text->size, file) != text->size || fflush(file) != 0
        || rename(path, d->config->metrics_file) != 0) {
        modal_fail(&err, MODAL_IO, "%s: %s", path, strerror(errno));
        log_error("metrics_file", &err);
    }
    if (file != NULL)
        fclose(file);
    blob_drop(text);
}

static void on_time(struct daemon *d)
{
    int64_t now = clock_ns(CLOCK_MONOTONIC);

    if (core_next_ns(d->core) <= now)
        step(d, &(struct event) { .type = EVENT_TIME });
    if (d->clients.blocked == NULL && d->workers.blocked == NULL) {
        d->flush_wait_ns = FLUSH_LEAST_NS;
        d->next_flush_ns = 0;
    } else if (now >= d->next_flush_ns) {          /* 1 ms while somebody reads, 100 ms for readers that stay away */
        bool moved = peers_flush(&d->clients, peer_changed, d);
        moved |= peers_flush(&d->workers, peer_changed, d);
        d->flush_wait_ns = moved ? FLUSH_LEAST_NS : d->flush_wait_ns < SECOND / 10 ? d->flush_wait_ns * 2 : SECOND / 10;
        d->next_flush_ns = now + d->flush_wait_ns;
    }
    if (d->watchdog_ns > 0 && now >= d->next_ping_ns) {
        d->next_ping_ns = now + d->watchdog_ns;
        ledger_thread_ping(d->ledger_thread);      /* answered through take_done: both threads live */
    }
    if (d->strangers.count > 0 && now >= d->next_strangers_ns) {
        d->next_strangers_ns = now + STRANGERS_NS;
        log_strangers(d);
    }
    if (intake_ended() > d->ended_told && now >= d->next_ended_ns) {
        d->next_ended_ns = now + STRANGERS_NS;
        log_ended(d);
    }
    if (d->config->metrics_file[0] != 0 && now >= d->next_metrics_ns) {
        d->next_metrics_ns = now + (int64_t)(d->config->metrics_s * 1e9);
        write_metrics(d);
    }
    if (d->trim_ns != 0 && now >= d->trim_ns) {
        d->trim_ns = 0;
        step(d, &(struct event) { .type = EVENT_REST });
        malloc_trim(0);
    }
    if (d->terminating && now >= d->drain_until_ns) {
        log_line("level=notice event=stop reason=\"drain time is over; running jobs start again at the next start\"");
        d->stop = true;
    }
}

static long wait_ms(const struct daemon *d)
{
    int64_t now = clock_ns(CLOCK_MONOTONIC), next = core_next_ns(d->core);

    if (d->clients.blocked != NULL || d->workers.blocked != NULL)
        next = d->next_flush_ns < next ? d->next_flush_ns : next;
    if (d->watchdog_ns > 0 && d->next_ping_ns < next)
        next = d->next_ping_ns;
    if (d->strangers.count > 0 && d->next_strangers_ns < next)
        next = d->next_strangers_ns;
    if (intake_ended() > d->ended_told && d->next_ended_ns < next)
        next = d->next_ended_ns;
    if (d->config->metrics_file[0] != 0 && d->next_metrics_ns < next)
        next = d->next_metrics_ns;
    if (d->trim_ns != 0 && d->trim_ns < next)
        next = d->trim_ns;
    if (d->terminating && d->drain_until_ns < next)
        next = d->drain_until_ns;
    if (next <= now)
        return 0;
    return (next - now) / 1000000 > 60000 ? 60000 : (long)((next - now + 999999) / 1000000);
}

/* ---- the loop --------------------------------------------------------------------------------------------------- */

static int poll_items(const struct daemon *d, zmq_pollitem_t items[POLL_MOST + 1], int slots[POLL_MOST + 1])
{
    int n = 0;

    items[n++] = (zmq_pollitem_t) { d->client_socket, 0, ZMQ_POLLIN, 0 };
    items[n++] = (zmq_pollitem_t) { d->worker_socket, 0, ZMQ_POLLIN, 0 };
    items[n++] = (zmq_pollitem_t) { NULL, d->done.wake, ZMQ_POLLIN, 0 };
    items[n++] = (zmq_pollitem_t) { NULL, d->signals, ZMQ_POLLIN, 0 };
    if (d->zap != NULL) {
        slots[n] = -1;
        items[n++] = (zmq_pollitem_t) { d->zap, 0, ZMQ_POLLIN, 0 };
    }
    for (int slot = 0; slot < SLOTS_MOST && n < POLL_MOST + 1; slot++)
        if (d->pool.slots[slot].pid > 0 && d->pool.slots[slot].stderr_fd >= 0) {
            slots[n] = slot;
            items[n++] = (zmq_pollitem_t) { NULL, d->pool.slots[slot].stderr_fd, ZMQ_POLLIN, 0 };
        }
    return n;
}

/* Of POLL's items those that are not messages. */
static void take_others(struct daemon *d, const zmq_pollitem_t *items, const int *slots, int n)
{
    if (items[2].revents != 0)
        take_done(d);
    if (items[3].revents != 0)
        take_signals(d);
    for (int i = 4; i < n; i++)
        if (items[i].revents != 0) {
            if (slots[i] < 0)
                zap_answer(d->zap, d->config->accounts, d->config->account_count, &d->strangers);
            else
                pool_read(&d->pool, slots[i]);
        }
}

static void loop(struct daemon *d)
{
    zmq_pollitem_t items[POLL_MOST + 1];
    int slots[POLL_MOST + 1];
    bool more = false;

    while (!d->stop) {
        int n = poll_items(d, items, slots);
        bool ended;

        fflush(stderr);                            /* one write for all edges of a round */
        if (zmq_poll(items, n, more ? 0 : wait_ms(d)) < 0 && errno != EINTR)
            break;
        take_others(d, items, slots, n);
        ended = note_ended(d);              /* before the messages: what they sent is among these */
        more = false;
        if (!d->stop && (ended || items[1].revents != 0))
            more |= take_messages(d, &d->workers, from_worker);
        if (!d->stop && (ended || items[0].revents != 0))
            more |= take_messages(d, &d->clients, from_client);
        if (ended && !d->stop)
            forget_ended(d, !more);
        if (!d->stop)
            on_time(d);
    }
}

/* ---- beginning and end ------------------------------------------------------------------------------------------ */

static bool set_int(void *socket, int option, int value)
{
    return zmq_setsockopt(socket, option, &value, sizeof value) == 0;
}

static void *router(struct daemon *d)
{
    void *socket = zmq_socket(d->context, ZMQ_ROUTER);
    int64_t frame = WIRE_BODY_MOST;
    bool ok = socket != NULL && set_int(socket, ZMQ_ROUTER_MANDATORY, 1)
        && set_int(socket, ZMQ_SNDHWM, 64) && set_int(socket, ZMQ_RCVHWM, INTAKE_WAITING)
        && set_int(socket, ZMQ_HANDSHAKE_IVL, 3000) && set_int(socket, ZMQ_LINGER, 200) && set_int(socket, ZMQ_HEARTBEAT_IVL, 10000)
        && set_int(socket, ZMQ_HEARTBEAT_TIMEOUT, 20000) && set_int(socket, ZMQ_BACKLOG, 1024)
        && zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &frame, sizeof frame) == 0;

    if (!ok && socket != NULL) {
        zmq_close(socket);
        socket = NULL;
    }
    return socket;
}

static enum modal_status guard_keys(struct daemon *d, struct modal_error *err)
{
    int64_t frame = WIRE_BODY_MOST + CURVE_COST;
    char public[41], secret[41];
    enum modal_status rc;

    if (d->config->server_key[0] == 0)
        return MODAL_OK;
    rc = config_server_keys(d->config, public, secret, err);
    if (rc != MODAL_OK)
        return rc;
    d->zap = zap_open(d->context);
    if (d->zap == NULL || !set_int(d->client_socket, ZMQ_CURVE_SERVER, 1) || zmq_setsockopt(d->client_socket, ZMQ_CURVE_SECRETKEY, secret, 40) != 0
        || zmq_setsockopt(d->client_socket, ZMQ_ZAP_DOMAIN, "modald", 6) != 0
        || zmq_setsockopt(d->client_socket, ZMQ_MAXMSGSIZE, &frame, sizeof frame) != 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "server_key", "CURVE cannot be used: %s", zmq_strerror(errno));
    explicit_bzero(secret, sizeof secret);
    return rc;
}

/* libzmq replaces the file of an ipc endpoint without asking: ask whether somebody listens. */
static bool somebody_listens(const char *path)
{
    struct sockaddr_un address = { .sun_family = AF_UNIX };
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    bool yes;

    if (fd < 0 || strlen(path) >= sizeof address.sun_path) {
        if (fd >= 0)
            close(fd);
        return false;
    }
    strcpy(address.sun_path, path);
    yes = connect(fd, (struct sockaddr *)&address, sizeof address) == 0;
    close(fd);
    return yes;
}

static enum modal_status bind_one(void *socket, const char *endpoint, int mode, struct modal_error *err)
{
    bool ipc = strncmp(endpoint, "ipc://", 6) == 0;
    mode_t mask;
    int rc;

    if (ipc && somebody_listens(endpoint + 6))
        return modal_fail_field(err, MODAL_BUSY, "bind", "%s: another daemon listens there", endpoint);
    mask = umask(0177);                            /* nobody else, until the mode is set */
    rc = zmq_bind(socket, endpoint);
    umask(mask);
    if (rc != 0)
        return modal_fail_field(err, MODAL_IO, "bind", "%s: %s", endpoint, zmq_strerror(errno));
    if (ipc && chmod(endpoint + 6, (mode_t)mode) != 0)
        return modal_fail_field(err, MODAL_IO, "bind", "%s: %s", endpoint, strerror(errno));
    return MODAL_OK;
}

/* Where workers connect: in the data folder; where its path is too long for a socket, in a folder of our own. */
static enum modal_status worker_place(struct daemon *d, struct modal_error *err)
{
    const char *runtime = getenv("XDG_RUNTIME_DIR");

    if (strlen(d->config->data) < 90) {
        snprintf(d->worker_endpoint, sizeof d->worker_endpoint, "ipc://%.90s/workers.ipc", d->config->data);
        return MODAL_OK;
    }
    snprintf(d->worker_folder, sizeof d->worker_folder, "%s/modald-XXXXXX", runtime != NULL && strlen(runtime) < 60 ? runtime : "/tmp");
    if (mkdtemp(d->worker_folder) == NULL)
        return modal_fail(err, MODAL_IO, "%s: %s", d->worker_folder, strerror(errno));
    snprintf(d->worker_endpoint, sizeof d->worker_endpoint, "ipc://%.100s/workers.ipc", d->worker_folder);
    return MODAL_OK;
}

static enum modal_status open_sockets(struct daemon *d, struct modal_error *err)
{
    enum modal_status rc;

    d->context = zmq_ctx_new();
    if (d->context == NULL || zmq_ctx_set(d->context, ZMQ_MAX_SOCKETS, 65535) != 0)
        return modal_fail(err, MODAL_INTERNAL, "no ZeroMQ context: %s", zmq_strerror(errno));
    d->client_socket = router(d);
    d->worker_socket = router(d);
    if (d->client_socket == NULL || d->worker_socket == NULL)
        return modal_fail(err, MODAL_INTERNAL, "no socket: %s", zmq_strerror(errno));
    d->clients = (struct peers) { .socket = d->client_socket, .version = WIRE_VERSION };
    d->workers = (struct peers) { .socket = d->worker_socket, .version = WIRE_WORKER };
    rc = guard_keys(d, err);
    if (rc == MODAL_OK)
        rc = worker_place(d, err);
    if (rc == MODAL_OK)
        rc = bind_one(d->worker_socket, d->worker_endpoint, 0600, err);
    return rc;
}

static enum modal_status bind_all(struct daemon *d, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < d->config->bind_count; i++)
        rc = bind_one(d->client_socket, d->config->bind[i], d->config->ipc_mode, err);
    return rc;
}

/* OpenBLAS has threads before main runs, so that no mask reaches all threads and a signalfd would miss signals: a handler
 * it is, in whichever thread, and a pipe. */
static int signal_pipe = -1;

static void on_signal(int number)
{
    unsigned char byte = (unsigned char)number;
    int saved = errno;

    if (write(signal_pipe, &byte, 1) < 0)
        errno = saved;                             /* full of signals that are still to be read */
    errno = saved;
}

static enum modal_status open_signals(struct daemon *d, struct modal_error *err)
{
    static const int numbers[] = { SIGTERM, SIGINT, SIGHUP, SIGCHLD };
    struct sigaction action = { .sa_handler = on_signal, .sa_flags = SA_RESTART };
    int fds[2];

    if (pipe2(fds, O_CLOEXEC | O_NONBLOCK) != 0)
        return modal_fail(err, MODAL_IO, "pipe: %s", strerror(errno));
    d->signals = fds[0];
    signal_pipe = fds[1];
    signal(SIGPIPE, SIG_IGN);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        sigaction(numbers[i], &action, NULL);
    return MODAL_OK;
}

static void raise_descriptors(void)
{
    struct rlimit limit;

    if (getrlimit(RLIMIT_NOFILE, &limit) == 0 && limit.rlim_cur < limit.rlim_max) {
        limit.rlim_cur = limit.rlim_max < 65536 ? limit.rlim_max : 65536;
        setrlimit(RLIMIT_NOFILE, &limit);
    }
}

/* A folder that was there before we came keeps its mode; whoever made it is told what it lets
 * others see. */
static void warn_of_others(const char *folder)
{
    struct stat known;

    if (stat(folder, &known) != 0 || (known.st_mode & 07) == 0)
        return;
    log_line("level=warning event=data_open mode=%04o data=%s "
             "message=\"the data folder is open to other users; accepted: 0750 or less\"",
             (unsigned)known.st_mode & 07777, folder);
}

/* Identifiers are mixed by the ledger's id; what HELLO tells of it is a way that does not lead
 * back, or a client could number his jobs and so count others'. */
static void name_store(struct settings *s, const char *ledger_id)
{
    char text[64];
    uint8_t digest[32];
    int length = snprintf(text, sizeof text, "modald/store/1 %s", ledger_id);

    sha256_of(ledger_id, strlen(ledger_id), digest);
    memcpy(&s->secret, digest, sizeof s->secret);
    sha256_of(text, (size_t)length, digest);
    for (size_t i = 0; i < 16; i++)
        snprintf(s->store_id + 2 * i, 3, "%02x", digest[i]);
}

static enum modal_status open_store(struct daemon *d, struct modal_error *err)
{
    struct settings *s = &d->config->settings;
    uint8_t start[8];
    char *path;
    enum modal_status rc = ledger_open(d->config->data, &d->ledger, err);

    if (rc != MODAL_OK)
        return rc;
    path = realpath(d->config->data, NULL);
    if (path == NULL)
        return modal_fail(err, MODAL_IO, "%s: %s", d->config->data, strerror(errno));
    snprintf(d->config->data, sizeof d->config->data, "%s", path);
    snprintf(s->dir, sizeof s->dir, "%s", path);
    free(path);
    warn_of_others(s->dir);
    name_store(s, ledger_store_id(d->ledger));
    if (getrandom(start, sizeof start, 0) != sizeof start)
        return modal_fail(err, MODAL_IO, "getrandom: %s", strerror(errno));
    for (size_t i = 0; i < sizeof start; i++)
        snprintf(s->start_id + 2 * i, 3, "%02x", start[i]);
    rc = reserve_hold(s->dir, RESERVE_BYTES, err);
    return rc == MODAL_STORAGE_FULL ? MODAL_OK : rc;     /* it is taken again once there is room */
}

/* Left by a crash between a file and its row, or a row's end and its file's: nobody was told of it, or it was to go. */
static void remove_orphan(void *context, enum spool_file what, int64_t id, uint64_t bytes, const char *path)
{
    struct daemon *d = context;

    if (what == SPOOL_OTHER || core_has_file(d->core, what, id) || file_unlink(path, NULL) != MODAL_OK)
        return;
    log_line("level=notice event=orphan_removed bytes=%llu file=%s", (unsigned long long)bytes,
             path);
}

static enum modal_status replay(struct daemon *d, struct modal_error *err)
{
    struct ledger_visitor visitor;
    enum modal_status rc;

    d->core = core_new(&d->config->settings, moment_now());
    core_visitor(d->core, &visitor);
    rc = ledger_load(d->ledger, &visitor, err);
    return rc == MODAL_OK ? spool_list(d->config->settings.dir, remove_orphan, d, err) : rc;
}

static enum modal_status start_threads(struct daemon *d, struct modal_error *err)
{
    if (!done_open(&d->done))
        return modal_fail(err, MODAL_IO, "eventfd: %s", strerror(errno));
    d->ledger_thread = ledger_thread_start(d->ledger, d->config->settings.dir, &d->done);
    d->spool = spool_threads_start(d->config->settings.dir, d->config->spool_threads, &d->done);
    if (d->ledger_thread == NULL || d->spool == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "the threads could not be started");
    return MODAL_OK;
}

static enum modal_status start_pool(struct daemon *d, struct modal_error *err)
{
    const struct config *c = d->config;

    for (int slot = 0; slot < SLOTS_MOST; slot++)
        d->pool.slots[slot].stderr_fd = d->pool.slots[slot].inputs = -1;
    if (c->worker_path[0] != 0)
        snprintf(d->program, sizeof d->program, "%s", c->worker_path);
    else if (!pool_find_program(d->program))
        return modal_fail_field(err, MODAL_BAD_INPUT, "worker_path", "no program modald-worker beside modald, nor in ../libexec/modald");
    d->pool.program = d->program;
    d->pool.endpoint = d->worker_endpoint;
    d->pool.data = c->settings.dir;
    d->pool.user = c->worker_user;
    d->pool.memory = c->worker_memory;
    d->pool.sandbox = c->sandbox;
    return MODAL_OK;
}

static enum modal_status begin(struct daemon *d, struct modal_error *err)
{
    enum modal_status rc = open_signals(d, err);

    raise_descriptors();
    accept_most(d->config->connections);
    if (rc == MODAL_OK)
        rc = open_store(d, err);
    if (rc == MODAL_OK)
        rc = open_sockets(d, err);
    if (rc == MODAL_OK)
        rc = start_pool(d, err);
    if (rc == MODAL_OK)
        rc = replay(d, err);
    if (rc == MODAL_OK)
        rc = start_threads(d, err);
    if (rc != MODAL_OK)
        return rc;
    accept_wake(d->done.wake);
    carry_out_all(d, core_loaded(d->core, moment_now()));
    return bind_all(d, err);
}

/* What the threads gave back too late: it is on disk, and the next start finds it there. */
static void drop_done(struct daemon *d)
{
    struct transaction *transactions, *t;
    struct task *tasks, *task;
    bool pinged, fatal;

    if (d->done.wake < 0)
        return;
    done_take(&d->done, &transactions, &tasks, &pinged, &fatal);
    while ((t = transactions) != NULL) {
        transactions = t->next;
        transaction_free(t);
    }
    while ((task = tasks) != NULL) {
        tasks = task->next;
        task_free(task);
    }
    done_close(&d->done);
}

static void end(struct daemon *d)
{
    pool_kill_all(&d->pool);
    if (d->client_socket != NULL)
        zmq_close(d->client_socket);
    if (d->worker_socket != NULL)
        zmq_close(d->worker_socket);
    if (d->zap != NULL)
        zmq_close(d->zap);
    if (d->context != NULL)
        zmq_ctx_term(d->context);
    if (d->worker_folder[0] != 0) {
        unlink(d->worker_endpoint + 6);
        rmdir(d->worker_folder);
    }
    spool_threads_stop(d->spool);
    ledger_thread_stop(d->ledger_thread);
    drop_done(d);
    if (d->core != NULL)
        core_free(d->core);
    if (d->ledger != NULL)
        ledger_close(d->ledger);
    peers_done(&d->clients);
    peers_done(&d->workers);
}

static void log_ready(const struct config *config)
{
    char *endpoints = grab_text(config->bind[0]);

    for (int i = 1; i < config->bind_count; i++) {
        char *longer = grab_format("%s,%s", endpoints, config->bind[i]);
        free(endpoints);
        endpoints = longer;
    }
    log_line("level=notice event=ready version=%s endpoint=%s data=%s workers=%d",
             MODALD_VERSION, endpoints, config->settings.dir, config->workers);
    free(endpoints);
}

int daemon_run(struct config *config, config_again *again, void *context)
{
    struct daemon *d = grab(sizeof *d);
    struct modal_error err;
    int status = 1;

    setvbuf(stderr, NULL, _IOFBF, 1 << 16);
    mallopt(M_ARENA_MAX, 2);
    mallopt(M_MMAP_THRESHOLD, 4 << 20);            /* frames come from the heap again and again, not from fresh zeroed pages */
    mallopt(M_TRIM_THRESHOLD, 64 << 20);
    *d = (struct daemon) { .config = config, .again = again, .again_context = context, .signals = -1 };
    d->done.wake = -1;
    if (begin(d, &err) != MODAL_OK) {
        log_error("start", &err);
        status = modal_status_exit(err.status) == 2 ? 2 : 1;
    } else {
        log_ready(config);
        d->watchdog_ns = notify_watchdog_ns();
        notify_manager("READY=1\nSTATUS=serving");
        loop(d);
        status = d->status;
        log_line("level=notice event=stopped");
    }
    end(d);
    fflush(stderr);
    free(d);
    config_done(config);
    return status;
}
