/* step.c - one step of the core: an event to whom it concerns, what follows a commit, and what
 * is due */
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include "broker/verbs/verbs.h"
#include <string.h>



/* ---- after a commit -------------------------------------------------------------------------- */

/* A result for which there was no room: the job, decided done, failed; who asked about it is
 * told so. */
static void result_refused(struct core *c, struct transaction *t, struct job *job)
{
    struct modal_error err;

    for (struct after *after = t->after; after != NULL; after = after->next)
        if (after->type == AFTER_DOC) {
            struct after *again = after_new(AFTER_DOC, &after->reply);
            again->job = job;
            after_append(&job->asks, again);
        }
    c->jobs->state_counts[JOB_DONE]--;
    c->jobs->state_counts[JOB_RUNNING]++;
    job->user->states[JOB_DONE] -= !job->hidden;
    job->user->states[JOB_RUNNING] += !job->hidden;
    job->user->running++;
    job->state = JOB_RUNNING;
    job->result_bytes = 0;
    input_use(c, job->output, -1);
    job->output = NULL;
    c->disk.hold_until = c->now.mono_ns + 5 * SECOND;
    /* a wake-up: no wait has number 0 */
    core_timer(c, c->disk.hold_until, TIMER_WAIT, 0, 0);
    modal_fail(&err, MODAL_STORAGE_FULL, "the disk is full: there is no room for the result");
    job_fail(c, job, JOB_FAILED, &err, NULL);
}

static void task_done(struct core *c, struct task *task);

/* A task that had to wait for room, in vain. */
static void task_refused(struct core *c, struct after *after)
{
    struct task *task = after->task;

    after->task = NULL;
    task->status = modal_fail(&task->err, MODAL_STORAGE_FULL, "the disk is full");
    c->tasks++;
    task_done(c, task);
}

static void refused(struct core *c, struct transaction *t)
{
    struct job *job = NULL;

    /* then the ledger's thread has its reserve back */
    room_want(c, RESERVE_LAST + RESERVE_LAST / 4);
    for (struct after *after = t->after; after != NULL; after = after->next)
        if (after->type == AFTER_SHOW && after->to == JOB_DONE) {
            result_refused(c, t, after->job);
            return;
        }

    c->disk.full_until = c->now.mono_ns + SECOND;
    for (struct after *after = t->after; after != NULL; after = after->next) {
        if (after->type == AFTER_STREAM)
            stream_refused(c, after, t);
        if (after->type == AFTER_TASK)
            task_refused(c, after);
        if (after->type != AFTER_SUBMIT && after->type != AFTER_REPEAT)
            continue;
        answer_fail(c, &after->reply, t->status, "", answer_number("retry_after_s", 5),
                    "the job could not be stored: the disk is full");
        job = after->job;
    }
    if (job != NULL) {
        struct input *input = job->input;
        job_forget(c, job);
        if (!input->committed && input->jobs == 0)
            input_forget(c, input);
    }
}

static void entered(struct core *c, struct after *after)
{
    struct job *job = after->job;

    histogram_add(&c->counts.submit_seconds, histogram_seconds,
                  (double)(c->now.mono_ns - after->value) / 1e9);
    job->committed = job->input->committed = true;
    job->shown = after->to;
    job_log_edge(c, job, "-", after->to, after->reply.peer);
    answer_doc(c, &after->reply, job, false, NULL);
    input_trim(c, job->input);
    if (job_state_final(job->shown)) {
        region_drop(job->options);
        job->options = NULL;
        job_note_end(c, job);
    }
    job_watch(c, job);
}

static void removed(struct core *c, struct after *after)
{
    struct job *job = after->job;
    struct tombstone *stone = job->key == NULL ? NULL : user_tombstone(job->user, job->key);

    if (stone != NULL)
        stone->committed = true;
    answer_doc(c, &after->reply, job, -1, NULL);
    if (!job->deleting)
        return;
    if (job->result_bytes > LEDGER_RESULT_INLINE_MOST && !job->cached)
        core_task(c, task_new(TASK_REMOVE_RESULT, job->id), TURN_NOBODY);
    job_forget(c, job);
}

static void gone(struct core *c, struct input *input)
{
    if (input->filling != NULL)
        upload_gone(c, input);
    if (!input->inline_data)
        core_task(c, task_new(TASK_REMOVE_INPUT, input->id), TURN_NOBODY);
    input_forget(c, input);
}

static void answer_drain(struct core *c, const struct reply *reply)
{
    cJSON *header = answer_new(reply);

    cJSON_AddBoolToObject(header, "draining", c->draining);
    answer_send(c, reply, header, NULL);
}

/* Signals that a worker made are there, or failed: its job goes on. */
static void follow_outputs(struct core *c)
{
    struct after *after;

    while ((after = c->inputs->outputs) != NULL) {
        c->inputs->outputs = after->next;
        after->next = NULL;
        worker_output(c, after);
        after_free(after);
    }
}

static void follow(struct core *c, struct after *after, struct transaction *t)
{
    switch (after->type) {
    case AFTER_EVENT:  events_committed(c, after); break;
    case AFTER_SHOW:   job_shown(c, after); break;
    case AFTER_SUBMIT: entered(c, after); break;
    case AFTER_REPEAT: answer_doc(c, &after->reply, after->job, true, NULL); break;
    case AFTER_DOC:    answer_doc(c, &after->reply, after->job, -1, NULL); break;
    case AFTER_DELETE: removed(c, after); break;
    case AFTER_GONE:   gone(c, after->input); break;
    case AFTER_DRAIN:  answer_drain(c, &after->reply); break;
    case AFTER_STREAM: stream_after(c, after, t); break;
    case AFTER_TASK:
        core_task(c, after->task, after->task->fair.turn);
        after->task = NULL;
        break;
    default:
        upload_after(c, after);
        follow_outputs(c);
    }
}

static void one_committed(struct core *c, struct transaction *t)
{
    core_committed(c, t);
    c->counts.commits++;
    c->counts.committed_changes += (int64_t)t->count;
    if (t->group > 0) {
        histogram_add(&c->counts.commit_seconds, histogram_seconds, (double)t->took_ns / 1e9);
        histogram_add(&c->counts.commit_transactions, histogram_numbers, (double)t->group);
        c->counts.ledger_bytes = t->ledger_bytes;
    }
    for (struct after *after = t->after; after != NULL; after = after->next)
        if (after->job != NULL && after->job->last == t)
            after->job->last = NULL;
    if (t->status != MODAL_OK)
        refused(c, t);
    else {
        c->disk.full_until = 0;
        c->disk.found |= t->refusable == FIRST_REFUSED;
        for (struct after *after = t->after; after != NULL; after = after->next)
            follow(c, after, t);
    }
    transaction_free(t);
}

/* The ledger has no room for what must pass.  Whoever waits for that of a job is told, once, and
 * may ask again. */
static void stuck(struct core *c)
{
    room_want(c, RESERVE_LAST + RESERVE_LAST / 4);
    for (struct transaction *t = c->oldest; t != NULL; t = t->after_it)
        for (struct after *after = t->after; after != NULL; after = after->next) {
            bool asked = after->type == AFTER_DOC || after->type == AFTER_DELETE
                         || after->type == AFTER_DRAIN;
            if (!asked || after->reply.peer == 0)
                continue;
            answer_fail(c, &after->reply, MODAL_STORAGE_FULL, "", answer_number("retry_after_s", 5),
                        "the disk is full: this is done, but not stored yet, and undone should the "
                        "daemon end before there is room");
            after->reply = (struct reply) { .peer = 0 };
        }
}

static void committed(struct core *c, struct transaction *list)
{
    int64_t heavy = 0;

    while (list != NULL) {
        struct transaction *t = list;
        list = t->next;
        heavy += t->heavy;
        one_committed(c, t);
    }
    spell_take(&c->spell, heavy, c->now.mono_ns);
}

/* Where things lie is for the log; a client is told what is the matter. */
static void tell_failure(struct core *c, struct task *task)
{
    size_t length = strlen(c->settings.dir);
    uint64_t bytes = task_bytes(task);
    char *at;

    if (task->status == MODAL_CORRUPT || task->status == MODAL_IO)
        core_log(c, "level=error event=task code=%s id=%lld message=\"%s\"",
                 modal_status_code(task->status), (long long)task->id,
                 task->err.message);
    if (task->status == MODAL_STORAGE_FULL && !task->over_share)
        modal_fail(&task->err, MODAL_STORAGE_FULL, bytes == 0 ? "the disk is full"
                   : "the disk is full: there is no room for %llu bytes",
                   (unsigned long long)bytes);
    while (length > 0 && (at = strstr(task->err.message, c->settings.dir)) != NULL) {
        at[0] = '.';                               /* ./spool/7.part */
        memmove(at + 1, at + length, strlen(at + length) + 1);
    }
}

static void task_done(struct core *c, struct task *task)
{
    c->tasks--;
    room_judge(c, task);
    if (task->status != MODAL_OK)
        tell_failure(c, task);
    if (task->type == TASK_WRITE)
        histogram_add(&c->counts.write_seconds, histogram_seconds, (double)task->took_ns / 1e9);
    switch (task->type) {
    case TASK_BEGIN: case TASK_RESUME: case TASK_WRITE: case TASK_SEAL: case TASK_CLOSE:
        upload_task_done(c, task);
        follow_outputs(c);
        break;
    case TASK_REMOVE_INPUT: case TASK_REMOVE_RESULT: case TASK_REMOVE_SAMPLES:
        break;
    case TASK_STREAM_SEAL:
        stream_sealed(c, task);
        break;
    case TASK_SAMPLES_COMPARE:
        stream_compared(c, task);
        break;
    case TASK_SAMPLES_READ: case TASK_BATCH_READ:
        window_recalled(c, task);
        break;
    case TASK_RESULT_PUT:
        job_result_put(c, task);
        break;
    case TASK_READ_EVENTS:
        events_task_done(c, task);
        break;
    case TASK_ROOM:
        room_told(c, task);
        break;
    default:
        if (task->after->type == AFTER_PIECE)
            piece_read(c, task);
        else if (task->after->text == NULL)             /* nobody asked: a worker waits for it */
            job_input_read(c, task);
        else
            read_task_done(c, task);
    }
    task_free(task);
}

/* ---- a step ---------------------------------------------------------------------------------- */

static void housekeeping(struct core *c)
{
    jobs_retain(c);
    inputs_retain(c);
    uploads_retain(c);
    streams_retain(c);
    tombstones_retain(c);
    events_retain(c);
    core_timer(c, c->now.mono_ns + HOUSEKEEPING_S * SECOND, TIMER_HOUSEKEEPING, 0, 0);
}

static void run_timers(struct core *c)
{
    const struct heap_item *least;

    while ((least = heap_least(&c->timers)) != NULL && least->key <= c->now.mono_ns) {
        struct heap_item item = heap_pop(&c->timers);
        switch ((enum timer)item.what) {
        case TIMER_ROOM:   room_ask(c); break;
        case TIMER_WAIT:   wait_timeout(c, (uint64_t)item.order); break;
        case TIMER_HOUSEKEEPING: housekeeping(c); break;
        case TIMER_RETAIN: c->jobs->retaining = false; jobs_retain(c); break;
        case TIMER_LEASE:
        case TIMER_SPAWN:
        case TIMER_END:
            worker_timer(c, (enum timer)item.what, item.order);
            break;
        default:           job_expired(c, item.order, (enum timer)item.what, (intptr_t)item.value);
        }
    }
}

static void configure(struct core *c, const struct settings *settings)
{
    struct settings old = c->settings;

    c->settings = *settings;
    c->settings.secret = old.secret;
    memcpy(c->settings.dir, old.dir, sizeof old.dir);
    memcpy(c->settings.node, old.node, sizeof old.node);
    memcpy(c->settings.start_id, old.start_id, sizeof old.start_id);
    memcpy(c->settings.store_id, old.store_id, sizeof old.store_id);
    users_configure(c);
    events_revoke(c);
    waits_revoke(c);
    remotes_revoke(c);
    workers_fill(c);
    core_log(c, "level=notice event=reload accounts=%zu workers=%d", c->settings.account_count,
             c->settings.workers);
}

/* All running jobs have ended and everything is committed. */
static bool quiet(const struct core *c)
{
    return workers_idle(c) && c->uncommitted == 0 && c->tasks == 0
        && c->jobs->state_counts[JOB_RUNNING] == 0;
}

struct actions *core_step(struct core *c, const struct event *e, struct moment now)
{
    c->out.count = 0;
    c->now = now;
    switch (e->type) {
    case EVENT_REQUEST:
        c->asking = e->turn;
        c->waited = e->waited;
        if (!e->waited)
            spell_other(&c->spell, e->turn);
        request_handle(c, e);
        c->asking = 0;
        c->waited = false;
        break;
    case EVENT_PEER_FULL: case EVENT_PEER_READY: events_peer(c, e->peer, e->type); break;
    case EVENT_PEER_GONE:
        events_peer(c, e->peer, e->type);
        waits_gone(c, e->peer);
        break;
    case EVENT_COMMITTED:  committed(c, e->transaction); break;
    case EVENT_STUCK:      stuck(c); break;
    case EVENT_TASK:       task_done(c, e->task); break;
    case EVENT_WORKER:     worker_message(c, e); break;
    case EVENT_REMOTE:     remote_message(c, e); break;
    case EVENT_REMOTE_GONE: remote_gone(c, e->peer); break;
    case EVENT_EXIT:       worker_exit(c, e->slot, e->status, e->stderr_text); break;
    case EVENT_TIME:       break;
    case EVENT_REST:
        inputs_drop_cached(c);
        documents_drop(c);
        break;
    case EVENT_SETTINGS:   configure(c, e->settings); break;
    case EVENT_TERMINATE:  c->terminating = true; break;
    }
    run_timers(c);
    workers_schedule(c);
    events_pump(c);
    if (c->terminating && !c->stopped && quiet(c)) {
        c->stopped = true;
        core_act(c, (struct action) { .type = ACT_STOP, .slot = 0 });
    }
    return &c->out;
}

void core_connections(struct core *c, int64_t open, int64_t refused_count, int64_t ended,
                      int64_t hangups_kept)
{
    c->counts.connections = open;
    c->counts.connections_refused = refused_count;
    c->counts.connections_ended = ended;
    c->counts.hangups_kept = hangups_kept;
}

int64_t core_next_ns(const struct core *c)
{
    const struct heap_item *least = heap_least(&c->timers);

    return events_wait(c) ? 0 : least == NULL ? INT64_MAX : least->key;
}
