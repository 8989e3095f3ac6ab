/*
 * loop.c - one round after the other: what came, what the core says to it, what is due
 *
 * One thread owns the core and all sockets; it never waits for a disk.  A round: wait, take in
 * what came (a bounded number from each source, so that none starves another), step the core for
 * each, carry out what it asks for.
 */
#include "broker/shell/loop.h"
#include "broker/shell/accept.h"
#include "broker/shell/hangup.h"
#include "broker/shell/intake.h"
#include "broker/shell/log_out.h"
#include "broker/shell/notify.h"
#include "broker/verbs/verbs.h"
#include "store/file.h"
#include "wire/frame.h"
#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>

#define FLUSH_LEAST_NS 1000000          /* ns, between two tries of full pipes: no busy loop */
#define TRIM_AFTER_NS (2 * SECOND)      /* of rest: when the ledger has had its own */
#define TRIM_EVERY_NS (10 * SECOND)     /* of work: as often as what is past its age is freed */
enum { TRIM_SHARE = 1000 };             /* of the loop's time at most one part, in trimming */
#define MS INT64_C(1000000)              /* ns */
#define WAIT_MOST_MS 60000               /* a look now and then, though nothing is due */
#define STRANGERS_NS SECOND             /* between two lines on keys or connections refused */
/* of one source, whose next message waits for the others' */
#define ROUND_NS 5000000
enum {
    ROUND = 128,                             /* messages of one source before the others' */
    POLL_MOST = 6 + SLOTS_MOST,              /* sockets, threads, signals; stderr, the workers' */
};

/* ---- carrying out what the core asks for ----------------------------------------------------- */

static void step(struct daemon *d, const struct event *event);

static void peer_changed(void *context, uint64_t number, enum peer_change change)
{
    static const enum event_type events[] = {
        [PEER_FULL] = EVENT_PEER_FULL, [PEER_READY] = EVENT_PEER_READY,
        [PEER_GONE] = EVENT_PEER_GONE };

    step(context, &(struct event) { .type = events[change], .peer = number });
}

static void spawn(struct daemon *d, int slot)
{
    struct modal_error err;

    if (pool_spawn(&d->pool, slot))
        return;
    modal_fail(&err, MODAL_IO, "cannot start %s: %s", d->program, strerror(errno));
    loop_log_error("spawn", &err);
    step(d, &(struct event) {
                .type = EVENT_EXIT, .slot = slot, .status = 127 << 8, .stderr_text = "" });
}

/* A worker that has a RUN may speak of it at length. */
static void begin_run(struct peer *worker, const char *verb)
{
    if (strcmp(verb, "RUN") == 0)
        worker->said_long = 0;
}

static void to_worker(struct daemon *d, struct action *a)
{
    struct peer *peer = peers_by_number(&d->workers, d->pool.slots[a->slot].peer);

    if (peer == NULL) {
        free(a->header);
        blob_drop(a->body);
        return;
    }
    begin_run(peer, a->verb);
    peers_send(&d->workers, peer, a->verb, a->header, a->body);
}

/* Gone, what it had is not: the core is told. */
static void remote_changed(void *context, uint64_t number, enum peer_change change)
{
    if (change == PEER_GONE)
        step(context, &(struct event) { .type = EVENT_REMOTE_GONE, .peer = number });
}

static void to_remote(struct daemon *d, struct action *a)
{
    struct peer *peer = peers_by_number(&d->remotes, a->peer);

    if (peer == NULL) {
        free(a->header);
        blob_drop(a->body);
        return;
    }
    begin_run(peer, a->verb);
    remote_changed(d, a->peer, peers_send(&d->remotes, peer, a->verb, a->header, a->body));
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

static void log_for(struct daemon *d, struct action *a)
{
    char address[PEER_ADDRESS_MOST];
    char *line = a->header;

    if (a->peer != 0 && peers_address(&d->clients, a->peer, address, sizeof address)) {
        line = grab_format("%s peer=%s", a->header, address);
        free(a->header);
    }
    loop_write_line(line);
    free(line);
}

static void carry_out(struct daemon *d, struct action *a)
{
    switch (a->type) {
    case ACT_SEND:   to_client(d, a); break;
    case ACT_COMMIT: break;                        /* it is among those that went together */
    case ACT_TASK:   spool_threads_put(d->spool, a->task); break;
    case ACT_WORKER: to_worker(d, a); break;
    case ACT_REMOTE: to_remote(d, a); break;
    case ACT_HAND:   hand_over(d, a); break;
    case ACT_SPAWN:  spawn(d, a->slot); break;
    case ACT_KILL:   pool_kill(&d->pool, a->slot); break;
    case ACT_LOG:    log_for(d, a); break;
    case ACT_STOP:   d->stop = true; d->status = a->slot; break;
    }
}

/* The transactions of a step, behind those of the steps before it. */
static void gather(struct daemon *d, const struct action *actions, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (actions[i].type == ACT_COMMIT) {
            *(d->gathered == NULL ? &d->gathered : d->gathered_end) = actions[i].transaction;
            d->gathered_end = &actions[i].transaction->next;
            *d->gathered_end = NULL;
        }
}

/* What was gathered is one group, for which the ledger's thread is waked once, though it were at
 * rest.  One by one the first of them was a group of its own, and the others waited for its
 * sync. */
static void commit_gathered(struct daemon *d)
{
    if (d->gathered != NULL)
        ledger_thread_put(d->ledger_thread, d->gathered);
    d->gathered = NULL;
}

/* Actions may cause further steps, which reuse the core's list: take it first.  What it commits
 * goes before what they commit. */
void loop_carry_out(struct daemon *d, const struct actions *actions)
{
    struct action few[16], *own = few;
    size_t count = actions->count;

    if (count == 0)
        return;
    if (count > sizeof few / sizeof *few)
        own = grab(count * sizeof *own);
    memcpy(own, actions->items, count * sizeof *own);
    gather(d, own, count);
    if (!d->gathers)
        commit_gathered(d);
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
        d->trim_ns = loop_clock_ns(CLOCK_MONOTONIC) + TRIM_AFTER_NS;
    loop_carry_out(d, core_step(d->core, event, loop_now()));
}

/* ---- messages -------------------------------------------------------------------------------- */

/* Does VERB, as received_verb has it, change anything? */
static bool changes(int verb)
{
    return verb >= 0 && wire_verb_role((enum wire_verb)verb) != WIRE_ROLE_READ;
}

/* TURN's, who WAITED at the door; REFUSED, if it is not NULL, is all that comes of it. */
static void ask(struct daemon *d, struct received *r, uint64_t turn, bool waited,
                const struct modal_error *refused)
{
    struct wire_message message;
    struct modal_error err;
    enum modal_status rc = received_open(r, &message, &err);

    if (rc == MODAL_OK && refused != NULL)
        err = *refused;
    step(d, &(struct event) {
        .type = EVENT_REQUEST, .peer = r->number, .key = r->key,
        .message = rc == MODAL_OK && refused == NULL ? &message : NULL, .verb = message.verb,
        .id = message.id, .fault = &err, .body = r->frames + 3, .turn = turn,
        .waited = waited });
    wire_close(&message);
}

/* Where nothing but an answer would come of R and nobody is there to read it, nothing is done: many
 * such left by connections that are gone must not make the others wait. */
static void from_client(struct daemon *d, struct received *r)
{
    int verb = received_verb(r);
    uint64_t turn = changes(verb) ? core_turn(d->core, r->key, r->number) : 0;
    struct modal_error err;

    if (!changes(verb) && accept_gone(r->peer->fd))
        return;
    if (turn == 0 || (fair_queue_size(&d->door.waiting, turn) == 0 && core_admits(d->core, turn)
                      && !core_bars(d->core, turn)))
        ask(d, r, turn, false, NULL);
    else if (door_admits(&d->door, r, turn))
        door_put(&d->door, r, turn);
    else {
        modal_fail(&err, MODAL_BUSY, "%zu bytes of requests wait to be stored, at most %d, of "
                   "which each who waits may have an equal share", d->door.waiting.size, DOOR_MOST);
        ask(d, r, turn, true, &err);
    }
}

static bool may_enter(const void *core, uint64_t turn)
{
    return core_admits(core, turn);
}

/* Those who wait are let in, until the ledger has enough; true: there may be more. */
static bool let_in(struct daemon *d)
{
    int64_t now = loop_clock_ns(CLOCK_MONOTONIC);
    struct received r;
    uint64_t turn;

    while (!d->stop && core_lets_in(d->core) <= now && core_admits(d->core, 0)
           && door_take(&d->door, may_enter, d->core, &r, &turn)) {
        door_left(peers_by_number(&d->clients, r.number), &r);
        ask(d, &r, turn, true, NULL);
        received_release(&r);
        if (loop_clock_ns(CLOCK_MONOTONIC) - now >= ROUND_NS)
            return true;
    }
    return false;
}

static void from_worker(struct daemon *d, struct received *r)
{
    struct wire_message message;
    struct modal_error err;
    double pid = 0;
    int slot;

    if (received_untold(r))
        return;
    slot = pool_slot_of_peer(&d->pool, r->peer->number);
    if (received_open_worker(r, &message, &err) != MODAL_OK) {
        if (slot >= 0)
            step(d, &(struct event) { .type = EVENT_WORKER, .slot = slot, .fault = &err });
        else
            loop_log_error("worker_frame", &err);
        return;
    }
    if (slot < 0 && strcmp(message.verb, "READY") == 0
        && json_get_number(message.header, "", "pid", 1, 4194304, &pid, NULL) == MODAL_OK) {
        slot = pool_slot_of_pid(&d->pool, (pid_t)pid);
        if (slot >= 0 && d->pool.slots[slot].peer == 0)
            d->pool.slots[slot].peer = r->peer->number;
        else
            slot = -1;
    }
    if (slot >= 0)
        step(d,
             &(struct event) {
                 .type = EVENT_WORKER, .slot = slot, .message = &message, .body = r->frames + 3 });
    wire_close(&message);
}

static void from_remote(struct daemon *d, struct received *r)
{
    struct wire_message message;
    struct modal_error err;
    enum modal_status rc;

    if (received_untold(r))
        return;
    rc = received_open_worker(r, &message, &err);
    step(d, &(struct event) {
        .type = EVENT_REMOTE, .peer = r->peer->number, .key = r->key,
        .message = rc == MODAL_OK ? &message : NULL, .fault = &err, .body = r->frames + 3 });
    wire_close(&message);
}

static bool receive_all(struct daemon *d, struct peers *peers,
                        void (*handle)(struct daemon *, struct received *))
{
    struct received r;
    int64_t now = loop_clock_ns(CLOCK_MONOTONIC);

    for (int n = 0; n < ROUND && loop_clock_ns(CLOCK_MONOTONIC) - now < ROUND_NS; n++) {
        bool got = received_take(peers, &r);
        d->taken++;
        if (got && r.peer != NULL && r.count > 0)
            handle(d, &r);
        received_release(&r);
        if (!got)
            return false;
    }
    return true;                                   /* perhaps more */
}

/* Workers tell of several windows at once, which go to the ledger together. */
static bool receive_workers(struct daemon *d)
{
    bool more;

    d->gathers = true;
    more = receive_all(d, &d->workers, from_worker);
    d->gathers = false;
    commit_gathered(d);
    return more;
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
        uint64_t remote = peers_ended(&d->remotes, fd);
        peers_ended(&d->workers, fd);
        accept_free(fd);
        if (number != 0)
            peer_changed(d, number, PEER_GONE);
        if (remote != 0)
            remote_changed(d, remote, PEER_GONE);
    }
}

/* ---- threads, children, signals -------------------------------------------------------------- */

/* Those that are done, in their order, and others before the last; true: there are more. */
static bool handle_tasks(struct daemon *d)
{
    int64_t now = loop_clock_ns(CLOCK_MONOTONIC);
    struct task *task;

    while (!d->stop && (task = d->tasks) != NULL
           && loop_clock_ns(CLOCK_MONOTONIC) - now < ROUND_NS) {
        d->tasks = task->next;
        step(d, &(struct event) { .type = EVENT_TASK, .task = task });
    }
    return d->tasks != NULL;
}

static void handle_done(struct daemon *d)
{
    struct transaction *transactions;
    struct task *tasks, **end = &d->tasks;
    bool pinged, stuck, fatal;

    done_take(&d->done, &transactions, &tasks, &pinged, &stuck, &fatal);
    while (*end != NULL)
        end = &(*end)->next;
    *end = tasks;
    /* nothing more is acknowledged; a restart replays */
    if (fatal) {
        loop_log_error("storage", &d->done.error);
        d->stop = true;
        d->status = 1;
        return;
    }
    if (pinged)
        notify_manager("WATCHDOG=1");
    if (transactions != NULL)
        step(d, &(struct event) { .type = EVENT_COMMITTED, .transaction = transactions });
    if (stuck)
        step(d, &(struct event) { .type = EVENT_STUCK });
}

static void reap_children(struct daemon *d)
{
    const char *text;
    int status, slot;

    while ((slot = pool_reap(&d->pool, &status, &text)) >= 0)
        step(d, &(struct event) {
                    .type = EVENT_EXIT, .slot = slot, .status = status, .stderr_text = text });
}

/* Endpoints stay as they are while it runs: whoever changed them is told. */
static void tell_of_endpoints(const struct config *old, const struct config *fresh)
{
    bool same = old->bind_count == fresh->bind_count && old->ipc_mode == fresh->ipc_mode
                && old->worker_bind_count == fresh->worker_bind_count;

    for (int i = 0; same && i < old->bind_count; i++)
        same = strcmp(old->bind[i], fresh->bind[i]) == 0;
    for (int i = 0; same && i < old->worker_bind_count; i++)
        same = strcmp(old->worker_bind[i], fresh->worker_bind[i]) == 0;
    if (!same)
        loop_log("level=warning event=reload_later key=bind message=\"endpoints and ipc_mode are "
                 "taken at the next start\"");
}

static void reload(struct daemon *d)
{
    struct config *fresh = grab(sizeof *fresh);
    struct modal_error err;

    notify_manager("RELOADING=1");
    if (d->again(fresh, d->again_context, &err) != MODAL_OK)
        loop_log_error("reload_refused", &err);         /* the old one stays */
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
        loop_log("level=notice event=stop reason=\"second signal\"");
        d->stop = true;
        return;
    }
    d->terminating = true;
    d->drain_until_ns = loop_clock_ns(CLOCK_MONOTONIC) + (int64_t)(d->config->drain_s * 1e9);
    loop_log("level=notice event=terminate");
    notify_manager("STOPPING=1\nSTATUS=draining");
    step(d, &(struct event) { .type = EVENT_TERMINATE });
}

static void handle_signals(struct daemon *d)
{
    unsigned char number;

    while (read(d->signals, &number, 1) == 1) {
        if (number == SIGCHLD)
            reap_children(d);
        else if (number == SIGHUP)
            reload(d);
        else if (number == SIGTERM || number == SIGINT)
            terminate(d);
        else
            loop_log("level=warning event=signal number=%d message=\"%s: passed over; accepted: "
                     "SIGTERM, SIGINT and SIGHUP\"", number, strsignal(number));
    }
}

/* Keys that are on no list, one line for all of a while: a flood of them is not one of the log. */
static void log_strangers(struct daemon *d)
{
    loop_log("level=notice event=audit what=refused keys=%lld key=%s address=%s",
             (long long)d->strangers.count,
             d->strangers.key[0] != 0 ? d->strangers.key : "-", d->strangers.address);
    d->strangers.count = 0;
}

/* The same for connections that were ended for what they sent. */
static void log_ended(struct daemon *d)
{
    long ended = intake_ended();

    loop_log("level=warning event=connections_ended count=%ld "
             "message=\"not ZMTP 3, or more bytes than messages hold; see section 8 of "
             "PROTOCOL.md\"",
             ended - d->ended_told);
    d->ended_told = ended;
}

/* ---- time ------------------------------------------------------------------------------------ */

static void write_metrics(struct daemon *d)
{
    struct blob *text = metrics_text(d->core, NULL);
    struct modal_error err;
    char path[PATH_ROOM + 8];
    int fd = -1;
    enum modal_status rc;

    snprintf(path, sizeof path, "%s.tmp", d->config->metrics_file);
    rc = file_open(path, O_WRONLY | O_CREAT | O_TRUNC, 0640, &fd, &err);
    if (rc == MODAL_OK && fchmod(fd, 0640) != 0)
        rc = modal_fail(&err, MODAL_IO, "%s: %s", path, strerror(errno));
    if (rc == MODAL_OK)
        rc = file_write(fd, text->data, text->size, 0, &err);
    if (rc == MODAL_OK)
        rc = file_rename(path, d->config->metrics_file, &err);
    if (rc != MODAL_OK)
        loop_log_error("metrics_file", &err);
    if (fd >= 0)
        close(fd);
    blob_drop(text);
}

/* Does something wait for a reader? */
static bool is_blocked(const struct daemon *d)
{
    return d->clients.blocked != NULL || d->workers.blocked != NULL || d->remotes.blocked != NULL;
}

/* Memory that was freed goes back to the system, at rest and every so often: left to itself it is
 * the process's where anything above it is in use, and who is never at rest, being attacked, say,
 * would keep the most that he ever had at one time. */
static void give_back(struct daemon *d, int64_t now)
{
    int64_t begin;

    if (d->trim_ns == 0 || (now < d->trim_ns && now < d->next_trim_ns))
        return;
    if (now >= d->trim_ns) {
        d->trim_ns = 0;
        step(d, &(struct event) { .type = EVENT_REST });
    }
    begin = loop_clock_ns(CLOCK_THREAD_CPUTIME_ID);
    malloc_trim(0);
    d->next_trim_ns = now + TRIM_EVERY_NS
                    + TRIM_SHARE * (loop_clock_ns(CLOCK_THREAD_CPUTIME_ID) - begin);
}

static void on_time(struct daemon *d)
{
    int64_t now = loop_clock_ns(CLOCK_MONOTONIC);

    if (core_next_ns(d->core) <= now)
        step(d, &(struct event) { .type = EVENT_TIME });
    if (!is_blocked(d)) {
        d->flush_wait_ns = FLUSH_LEAST_NS;
        d->next_flush_ns = 0;
    /* 1 ms while somebody reads, 100 ms for readers that stay away */
    } else if (now >= d->next_flush_ns) {
        bool moved = peers_flush(&d->clients, peer_changed, d);
        moved |= peers_flush(&d->workers, peer_changed, d);
        moved |= peers_flush(&d->remotes, remote_changed, d);
        d->flush_wait_ns = moved                            ? FLUSH_LEAST_NS
                           : d->flush_wait_ns < SECOND / 10 ? d->flush_wait_ns * 2
                                                            : SECOND / 10;
        d->next_flush_ns = now + d->flush_wait_ns;
    }
    if (d->watchdog_ns > 0 && now >= d->next_ping_ns) {
        d->next_ping_ns = now + d->watchdog_ns;
        /* answered through take_done: both threads live */
        ledger_thread_ping(d->ledger_thread);
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
    if (now >= d->next_hear_ns) {
        d->next_hear_ns = now + DOOR_DEAF_NS;
        door_hear_all(&d->clients);
    }
    give_back(d, now);
    if (d->terminating && now >= d->drain_until_ns) {
        loop_log("level=notice event=stop reason=\"drain time is over; running jobs start again at "
                 "the next start\"");
        d->stop = true;
    }
}

static long wait_ms(const struct daemon *d)
{
    int64_t now = loop_clock_ns(CLOCK_MONOTONIC), next = core_next_ns(d->core), ms;

    if (is_blocked(d))
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
    if (d->door.waiting.size >= DOOR_OWN / 2 && d->next_hear_ns < next)
        next = d->next_hear_ns;
    if (d->door.waiting.size > 0 && core_lets_in(d->core) > now && core_lets_in(d->core) < next)
        next = core_lets_in(d->core);
    if (next <= now)
        return 0;
    ms = (next - now + MS - 1) / MS;
    return ms > WAIT_MOST_MS ? WAIT_MOST_MS : (long)ms;
}

/* ---- the loop -------------------------------------------------------------------------------- */

enum {
    AT_ZAP = -1,         /* in place of a slot: none's */
    AT_REMOTES = -2,     /* likewise, the socket of workers elsewhere */
    AT_LOG = -3,         /* likewise, stderr: only to wake, each round writes what it takes */
};

/* Nothing is read of clients then. */
static bool is_full(const struct daemon *d)
{
    return d->door.waiting.size > DOOR_FULL;
}

static int poll_items(const struct daemon *d, zmq_pollitem_t items[POLL_MOST + 1],
                      int slots[POLL_MOST + 1])
{
    int n = 0;

    items[n++] = (zmq_pollitem_t) { d->client_socket, 0, is_full(d) ? 0 : ZMQ_POLLIN, 0 };
    items[n++] = (zmq_pollitem_t) { d->worker_socket, 0, ZMQ_POLLIN, 0 };
    items[n++] = (zmq_pollitem_t) { NULL, d->done.wake, ZMQ_POLLIN, 0 };
    items[n++] = (zmq_pollitem_t) { NULL, d->signals, ZMQ_POLLIN, 0 };
    if (d->remote_socket != NULL) {
        slots[n] = AT_REMOTES;
        items[n++] = (zmq_pollitem_t) { d->remote_socket, 0, ZMQ_POLLIN, 0 };
    }
    if (d->zap != NULL) {
        slots[n] = AT_ZAP;
        items[n++] = (zmq_pollitem_t) { d->zap, 0, ZMQ_POLLIN, 0 };
    }
    if (log_out_waits()) {
        slots[n] = AT_LOG;
        items[n++] = (zmq_pollitem_t) { NULL, STDERR_FILENO, ZMQ_POLLOUT, 0 };
    }
    for (int slot = 0; slot < SLOTS_MOST && n < POLL_MOST + 1; slot++)
        if (d->pool.slots[slot].pid > 0 && d->pool.slots[slot].stderr_fd >= 0) {
            slots[n] = slot;
            items[n++] = (zmq_pollitem_t) { NULL, d->pool.slots[slot].stderr_fd, ZMQ_POLLIN, 0 };
        }
    return n;
}

/* As zmq_poll, with half its system calls: it asks twice what each socket has, by a call each,
 * before and after it has slept.  Here a socket that its descriptor says something of is taken to
 * have a message: who takes one finds out. */
static bool wait_for(zmq_pollitem_t *items, int n, long ms)
{
    struct pollfd of[POLL_MOST + 1];
    bool ready = false;

    for (int i = 0; i < n; i++) {
        size_t size = sizeof of[i].fd, events_size = sizeof(int);
        int events = 0;
        of[i] = (struct pollfd) {
            items[i].fd, items[i].events == ZMQ_POLLOUT ? POLLOUT : POLLIN, 0 };
        if (items[i].socket == NULL)
            continue;
        if (zmq_getsockopt(items[i].socket, ZMQ_EVENTS, &events, &events_size) < 0
            || zmq_getsockopt(items[i].socket, ZMQ_FD, &of[i].fd, &size) < 0)
            return errno == EINTR;
        if (items[i].events == 0)
            of[i].fd = -1;             /* ZMQ_EVENTS alone: it does what its peers ask of it */
        items[i].revents = (short)(events & items[i].events);
        ready |= items[i].revents != 0;
    }
    if (poll(of, (nfds_t)n, ready ? 0 : (int)ms) < 0)
        return errno == EINTR;
    for (int i = 0; i < n; i++)
        items[i].revents |= of[i].revents;
    return true;
}

/* Of POLL's items those that are not messages. */
static void handle_others(struct daemon *d, const zmq_pollitem_t *items, const int *slots, int n)
{
    if (items[2].revents != 0)
        handle_done(d);
    if (items[3].revents != 0)
        handle_signals(d);
    for (int i = 4; i < n; i++)
        if (items[i].revents != 0) {
            if (slots[i] == AT_ZAP)
                zap_answer(d->zap, d->config->accounts, d->config->account_count, &d->strangers);
            else if (slots[i] >= 0)
                pool_read(&d->pool, slots[i]);
        }
}

/* Has the socket of workers elsewhere something? */
static bool remotes_said(const zmq_pollitem_t *items, const int *slots, int n)
{
    for (int i = 4; i < n; i++)
        if (slots[i] == AT_REMOTES)
            return items[i].revents != 0;
    return false;
}

void loop_run(struct daemon *d)
{
    zmq_pollitem_t items[POLL_MOST + 1];
    int slots[POLL_MOST + 1];
    bool more = false;

    while (!d->stop) {
        bool ended;
        int n;

        loop_flush_log();                               /* one write for all edges of a round */
        n = poll_items(d, items, slots);
        if (!wait_for(items, n, more ? 0 : wait_ms(d)))
            break;
        handle_others(d, items, slots, n);
        ended = note_ended(d);              /* before the messages: what they sent is among these */
        more = false;
        if (!d->stop && (ended || items[1].revents != 0))
            more |= receive_workers(d);
        if (!d->stop && d->remote_socket != NULL && (ended || remotes_said(items, slots, n)))
            more |= receive_all(d, &d->remotes, from_remote);
        more |= handle_tasks(d);
        more |= let_in(d);
        if (!d->stop && !is_full(d) && (ended || items[0].revents != 0))
            more |= receive_all(d, &d->clients, from_client);
        if (ended && !d->stop)
            forget_ended(d, !more && !is_full(d));
        if (!d->stop)
            on_time(d);
    }
}
