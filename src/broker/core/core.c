/* core.c - see core.h: taking over a ledger's rows, one step, and what follows a commit */
#include "broker/core/state.h"
#include "job/job.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HOUSEKEEPING_S = 10 };

struct core *core_new(const struct settings *settings, struct moment now)
{
    struct core *c = grab(sizeof *c);

    c->settings = *settings;
    c->now = now;
    c->started_ns = now.mono_ns;
    c->stones_end = &c->stones;
    c->next_job = c->next_input = c->next_event = c->next_wait = 1;
    users_configure(c);
    core_timer(c, now.mono_ns + HOUSEKEEPING_S * SECOND, TIMER_HOUSEKEEPING, 0, 0);
    return c;
}

/* ---- taking over ------------------------------------------------------------------------------------------------ */

static enum modal_status load_input(void *context, const struct input_record *r)
{
    struct core *c = context;
    struct input *input = input_load(c, r);

    if (r->id >= c->next_input)
        c->next_input = r->id + 1;
    if (input->state == INPUT_OPEN) {
        struct user *user = input->user;
        input->filling = filling_new(r->used_ns > r->created_ns ? r->used_ns : r->created_ns);
        input->filling->accepted = input->filling->durable = r->received;
        user->open = regrab(user->open, (size_t)(user->open_count + 1) * sizeof *user->open);
        user->open[user->open_count++] = input;
    }
    return MODAL_OK;
}

static void load_failure(struct job *job, const struct job_record *r)
{
    if (r->error_code == NULL)
        return;
    job->failure = grab(sizeof *job->failure);
    job->failure->status = modal_status_from_code(r->error_code);
    job->failure->message = grab_text(r->error_message != NULL ? r->error_message : "");
    job->failure->field = grab_text(r->error_field);
    job->failure->detail = grab_text(r->error_detail);
}

/* What the broker keeps in a job's tag. */
static void load_tag(struct job *job, const char *tag)
{
    cJSON *object = NULL;
    const char *settings = NULL, *source = NULL;

    if (tag == NULL || json_read(tag, strlen(tag), &object, NULL) != MODAL_OK)
        return;
    json_get_int(object, "", "max_attempts", 1, WIRE_ATTEMPTS_MOST, &job->max_attempts, NULL);
    json_get_bool(object, "", "hidden", &job->hidden, NULL);
    if (json_get_string(object, "", "settings", &settings, NULL) == MODAL_OK && settings != NULL)
        identity_from_hex(settings, job->settings);
    if (json_get_string(object, "", "source", &source, NULL) == MODAL_OK && source != NULL)
        job->source = strtoll(source, NULL, 10);
    cJSON_Delete(object);
}

/* What the row says, as it says it. */
static struct job *job_of_row(struct core *c, const struct job_record *r)
{
    struct job *job = job_new(c, user_get(c, r->user), r->id);
    const struct job_kind *kind = job_kind_find(r->kind);

    job->key = region_text(&c->region, r->key);
    job->kind = kind != NULL ? kind->name : arena_text(&c->kinds, r->kind);
    job->options = !job_state_final(r->state) || r->state == JOB_DEAD ? region_text(&c->region, r->options) : NULL;
    memcpy(job->fingerprint, r->fingerprint, 32);
    job->priority = r->priority;
    job->run_limit_ns = r->run_limit_ns;
    job->deadline_ns = r->deadline_ns;
    job->not_before_ns = r->not_before_ns;
    job->state = job->shown = r->state;
    job->attempts = job->shown_attempts = r->attempts;
    job->crashes = r->crashes;
    job->submitted_ns = r->submitted_ns;
    job->started_ns = r->started_ns;
    job->finished_ns = r->finished_ns;
    job->cpu_ns = r->cpu_ns;
    job->result_bytes = r->result_bytes;
    job->cached = r->cached;
    job->committed = true;
    load_failure(job, r);
    load_tag(job, r->tag);
    return job;
}

/* Its input, and the signals it made. */
static void load_inputs(struct core *c, struct job *job, const struct job_record *r)
{
    if (r->input >= c->next_input)                 /* an input that has gone since */
        c->next_input = r->input + 1;
    job->input = input_by_id(c, r->input);
    job->output = r->output == 0 ? NULL : input_by_id(c, r->output);
    if (job->input != NULL)
        job->input->jobs++;
    if (job->output != NULL && !job->cached)
        job->output->jobs++;
}

static void count_loaded(struct core *c, struct job *job)
{
    c->state_counts[job->state]++;
    job->user->queued += job->state == JOB_QUEUED;
    job->user->running += job->state == JOB_RUNNING;
    if (job->state != JOB_DONE || job->cached)
        return;
    c->result_total += (int64_t)job->result_bytes;
    job->user->bytes += (int64_t)job->result_bytes;
    if (!job->hidden)
        job_index_result(c, job);
}

static enum modal_status load_job(void *context, const struct job_record *r)
{
    struct core *c = context;
    struct job *job = job_of_row(c, r);

    if (r->id >= c->next_job)
        c->next_job = r->id + 1;
    load_inputs(c, job, r);
    if (job->hidden) {                             /* its key has a tombstone */
        region_drop(job->key);
        job->key = NULL;
    }
    job_index(c, job);
    count_loaded(c, job);
    if (job_state_final(job->state))
        job_note_end(c, job);
    return MODAL_OK;
}

/* A number that was a job's is never another's: somebody may still have its identifier. */
static void load_number(struct core *c, int64_t job)
{
    if (job >= c->next_job)
        c->next_job = job + 1;
}

static enum modal_status load_tombstone(void *context, const struct tombstone_record *r)
{
    struct core *c = context;

    struct user *user = user_get(c, r->user);

    user_bury(c, user, r->key, r->fingerprint, r->expired_ns);
    user_tombstone(user, r->key)->committed = true;
    load_number(c, r->job);
    return MODAL_OK;
}

static void load_upload_note(struct core *c, const struct note_record *r)
{
    struct input *input = input_by_id(c, strtoll(r->name, NULL, 10));
    cJSON *object = NULL;
    const char *key = NULL, *hash = NULL;

    if (input == NULL || input->filling == NULL || json_read(r->text, strlen(r->text), &object, NULL) != MODAL_OK)
        return;
    input->filling->aborting = cJSON_HasObjectItem(object, "output");     /* its worker is gone */
    json_get_string(object, "", "key", &key, NULL);
    json_get_string(object, "", "sha256", &hash, NULL);
    input->filling->key = grab_text(key);
    input->filling->has_declared = hash != NULL && identity_from_hex(hash, input->filling->declared);
    cJSON_Delete(object);
}

static enum modal_status load_note(void *context, const struct note_record *r)
{
    struct core *c = context;

    if (strcmp(r->topic, "upload") == 0)
        load_upload_note(c, r);
    if (strcmp(r->topic, "stream") == 0)
        stream_load_note(c, r);
    if (strcmp(r->topic, "cpu") == 0)
        user_load_note(c, r);
    if (strcmp(r->topic, "daemon") == 0 && strcmp(r->name, "draining") == 0)
        c->draining = true;
    return MODAL_OK;
}

static enum modal_status load_event(void *context, const struct event_record *r)
{
    struct core *c = context;

    if (r->number >= c->next_event)
        c->next_event = r->number + 1;
    c->last_event = c->next_event - 1;
    load_number(c, r->job);
    return MODAL_OK;
}

static enum modal_status load_segment(void *context, const struct segment_record *r)
{
    stream_load_segment(context, r);
    return MODAL_OK;
}

void core_visitor(struct core *core, struct ledger_visitor *out)
{
    *out = (struct ledger_visitor) { .context = core, .input = load_input, .job = load_job, .tombstone = load_tombstone,
                                     .note = load_note, .segment = load_segment, .event = load_event };
}

bool core_has_file(const struct core *c, enum spool_file what, int64_t id)
{
    const struct input *input = what == SPOOL_RESULT ? NULL : input_by_id(c, id);
    const struct job *job = what == SPOOL_RESULT ? job_by_id(c, id) : NULL;

    if (what == SPOOL_SAMPLES)
        return stream_is_open(c, id);
    if (what == SPOOL_RESULT)
        return job != NULL && job->state == JOB_DONE && job->result_bytes > LEDGER_RESULT_INLINE_MOST;
    return input != NULL && !input->inline_data && (what == SPOOL_SEALED || input->state == INPUT_OPEN);
}

/* A committed job that is queued: ready, or at its time; its deadline is watched. */
static void watch(struct core *c, struct job *job)
{
    if (job->deadline_ns > 0 && !job_state_final(job->state))
        core_timer(c, c->now.mono_ns + (job->deadline_ns > c->now.utc_ns ? job->deadline_ns - c->now.utc_ns : 0), TIMER_DEADLINE, job->id, 0);
    if (job->state == JOB_QUEUED)
        job_enqueue(c, job);
}

struct actions *core_loaded(struct core *c, struct moment now)
{
    size_t at = 0;
    struct job *job;
    struct input *input;

    c->out.count = 0;
    c->now = now;
    c->replay_s = (double)(now.mono_ns - c->started_ns) / 1e9;
    while ((job = map_next(&c->jobs, &at)) != NULL) {
        struct job *root = job->source == 0 ? NULL : job_by_id(c, job->source);
        if (root != NULL)
            root->shares++;
        if (job->state == JOB_RUNNING)             /* its worker ended with the daemon before */
            job_move(c, job, JOB_QUEUED, NULL);
        watch(c, job);
    }
    tombstones_sort(c);
    for (at = 0; (input = map_next(&c->inputs, &at)) != NULL;)
        if (input->filling != NULL && input->filling->aborting)
            upload_quiet(c, input);
    core_log(c, "level=notice event=replay jobs=%zu inputs=%zu queued=%lld", c->jobs.count, c->inputs.count, (long long)c->state_counts[JOB_QUEUED]);
    workers_fill(c);
    return &c->out;
}

/* ---- after a commit --------------------------------------------------------------------------------------------- */

/* Something was refused for want of BYTES of disk.  The log tells the edges, the metrics the
 * state in between. */
static void want_room(struct core *c, uint64_t bytes)
{
    c->room_found = false;
    c->room_wanted = bytes > c->room_wanted ? bytes : c->room_wanted;
    if (c->storage_full)
        return;
    c->storage_full = true;
    core_log(c, "level=warning event=storage_full needed=%llu "
             "message=\"submissions are refused for want of disk\"",
             (unsigned long long)bytes);
    core_timer(c, c->now.mono_ns + SECOND, TIMER_ROOM, 0, 0);
}

static void ask_for_room(struct core *c)
{
    struct task *task = grab(sizeof *task);

    task->type = TASK_ROOM;
    c->tasks++;
    core_act(c, (struct action) { .type = ACT_TASK, .task = task });
}

static void room_told(struct core *c, const struct task *task)
{
    bool enough = task->status == MODAL_OK && task->total >= c->room_wanted;

    if (!enough && !c->room_found) {
        core_timer(c, c->now.mono_ns + SECOND, TIMER_ROOM, 0, 0);
        return;
    }
    c->storage_full = c->room_found = false;
    c->room_wanted = 0;
    core_log(c, "level=notice event=storage_room free=%llu", (unsigned long long)task->total);
}

/* A result for which there was no room: the job, decided done, failed; who asked about it is told so. */
static void result_refused(struct core *c, struct transaction *t, struct job *job)
{
    struct modal_error err;

    for (struct after *after = t->after; after != NULL; after = after->next)
        if (after->type == AFTER_DOC) {
            struct after *again = after_new(AFTER_DOC, &after->reply);
            again->job = job;
            after_append(&job->asks, again);
        }
    c->state_counts[JOB_DONE]--;
    c->state_counts[JOB_RUNNING]++;
    job->user->running++;
    job->state = JOB_RUNNING;
    job->result_bytes = 0;
    input_use(c, job->output, -1);
    job->output = NULL;
    c->hold_until = c->now.mono_ns + 5 * SECOND;
    core_timer(c, c->hold_until, TIMER_WAIT, 0, 0);        /* a wake-up: no wait has number 0 */
    modal_fail(&err, MODAL_STORAGE_FULL, "the disk is full: there is no room for the result");
    job_fail(c, job, JOB_FAILED, &err, NULL);
}

static void refused(struct core *c, struct transaction *t)
{
    struct job *job = NULL;

    /* then the ledger's thread has its reserve back */
    want_room(c, RESERVE_LAST + RESERVE_LAST / 4);
    for (struct after *after = t->after; after != NULL; after = after->next)
        if (after->type == AFTER_SHOW && after->to == JOB_DONE) {
            result_refused(c, t, after->job);
            return;
        }

    c->storage_full_until = c->now.mono_ns + SECOND;
    for (struct after *after = t->after; after != NULL; after = after->next) {
        if (after->type == AFTER_STREAM)
            stream_refused(c, after, t);
        if (after->type != AFTER_SUBMIT && after->type != AFTER_REPEAT)
            continue;
        answer_fail(c, &after->reply, t->status, "", answer_number("retry_after_s", 5), "the job could not be stored: the disk is full");
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

    histogram_add(&c->submit_seconds, histogram_seconds, (double)(c->now.mono_ns - after->value) / 1e9);
    job->committed = job->input->committed = true;
    job->shown = after->to;
    job_log_edge(c, job, "-", after->to);
    answer_doc(c, &after->reply, job, false, NULL);
    input_trim(c, job->input);
    if (job_state_final(job->shown)) {
        region_drop(job->options);
        job->options = NULL;
        job_note_end(c, job);
    }
    watch(c, job);
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
    if (job->result_bytes > LEDGER_RESULT_INLINE_MOST && !job->cached) {
        struct task *task = grab(sizeof *task);
        task->type = TASK_REMOVE_RESULT;
        task->id = job->id;
        c->tasks++;
        core_act(c, (struct action) { .type = ACT_TASK, .task = task });
    }
    job_forget(c, job);
}

static void gone(struct core *c, struct input *input)
{
    if (input->filling != NULL)
        upload_gone(c, input);
    if (!input->inline_data) {
        struct task *task = grab(sizeof *task);
        task->type = TASK_REMOVE_INPUT;
        task->id = input->id;
        c->tasks++;
        core_act(c, (struct action) { .type = ACT_TASK, .task = task });
    }
    input_forget(c, input);
}

static void say_drain(struct core *c, const struct reply *reply)
{
    cJSON *header = answer_new(reply);

    cJSON_AddBoolToObject(header, "draining", c->draining);
    answer_send(c, reply, header, NULL);
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
    case AFTER_DRAIN:  say_drain(c, &after->reply); break;
    case AFTER_STREAM: stream_after(c, after, t); break;
    default:           upload_after(c, after, MODAL_OK);
    }
}

static void one_committed(struct core *c, struct transaction *t)
{
    c->uncommitted--;
    c->commits++;
    c->committed_changes += (int64_t)t->count;
    if (t->group > 0) {
        histogram_add(&c->commit_seconds, histogram_seconds, (double)t->took_ns / 1e9);
        histogram_add(&c->commit_transactions, histogram_numbers, (double)t->group);
        c->ledger_bytes = t->ledger_bytes;
    }
    for (struct after *after = t->after; after != NULL; after = after->next)
        if (after->job != NULL && after->job->last == t)
            after->job->last = NULL;
    if (t->status != MODAL_OK)
        refused(c, t);
    else {
        c->storage_full_until = 0;
        c->room_found |= t->refusable == FIRST_REFUSED;
        for (struct after *after = t->after; after != NULL; after = after->next)
            follow(c, after, t);
    }
    transaction_free(t);
}

static void committed(struct core *c, struct transaction *list)
{
    while (list != NULL) {
        struct transaction *t = list;
        list = t->next;
        one_committed(c, t);
    }
}

static uint64_t bytes_of(const struct task *task)
{
    return task->type == TASK_RESULT_PUT ? task->text->size
         : task->type != TASK_BEGIN && task->type != TASK_STREAM_SEAL ? 0
         : input_bytes(&task->shape);
}

/* An input larger than what is free, on a disk with room for others, makes no full disk. */
static void judge_room(struct core *c, const struct task *task)
{
    uint64_t bytes = bytes_of(task);

    if (task->status == MODAL_STORAGE_FULL && task->total < RESERVE_BYTES)
        want_room(c, bytes < RESERVE_BYTES ? bytes : RESERVE_BYTES);
    else if (task->status == MODAL_OK && task->type == TASK_BEGIN)
        c->room_found = true;
}

/* Where things lie is for the log; a client is told what is the matter. */
static void tell_failure(struct core *c, struct task *task)
{
    size_t length = strlen(c->settings.dir);
    uint64_t bytes = bytes_of(task);
    char *at;

    if (task->status == MODAL_CORRUPT || task->status == MODAL_IO)
        core_log(c, "level=error event=task code=%s id=%lld message=\"%s\"",
                 modal_status_code(task->status), (long long)task->id,
                 task->err.message);
    if (task->status == MODAL_STORAGE_FULL)
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
    judge_room(c, task);
    if (task->status != MODAL_OK)
        tell_failure(c, task);
    if (task->type == TASK_WRITE)
        histogram_add(&c->write_seconds, histogram_seconds, (double)task->took_ns / 1e9);
    switch (task->type) {
    case TASK_BEGIN: case TASK_RESUME: case TASK_WRITE: case TASK_SEAL: case TASK_CLOSE:
        upload_task_done(c, task);
        break;
    case TASK_REMOVE_INPUT: case TASK_REMOVE_RESULT: case TASK_REMOVE_SAMPLES:
        break;
    case TASK_STREAM_SEAL:
        stream_sealed(c, task);
        break;
    case TASK_SAMPLES_COMPARE:
        stream_compared(c, task);
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
        if (task->after->text == NULL)             /* nobody asked: a worker waits for it */
            job_input_read(c, task);
        else
            read_task_done(c, task);
    }
    task_free(task);
}

/* ---- a step ----------------------------------------------------------------------------------------------------- */

static void housekeeping(struct core *c)
{
    jobs_retain(c);
    inputs_retain(c);
    streams_retain(c);
    tombstones_retain(c);
    if (c->last_event > c->settings.events_kept && c->last_event / 1024 != c->pruned / 1024) {
        struct transaction *t = transaction_new();
        c->pruned = c->last_event;
        transaction_add(t, LEDGER_EVENTS_PRUNE)->id = c->last_event - c->settings.events_kept;
        core_commit(c, t);
    }
    core_timer(c, c->now.mono_ns + HOUSEKEEPING_S * SECOND, TIMER_HOUSEKEEPING, 0, 0);
}

static void run_timers(struct core *c)
{
    const struct heap_item *least;

    while ((least = heap_least(&c->timers)) != NULL && least->key <= c->now.mono_ns) {
        struct heap_item item = heap_pop(&c->timers);
        switch ((enum timer)item.what) {
        case TIMER_ROOM:   ask_for_room(c); break;
        case TIMER_WAIT:   wait_timeout(c, (uint64_t)item.order); break;
        case TIMER_HOUSEKEEPING: housekeeping(c); break;
        case TIMER_RETAIN: c->retaining = false; jobs_retain(c); break;
        case TIMER_LEASE: case TIMER_SPAWN: worker_timer(c, (enum timer)item.what, item.order); break;
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
    memcpy(c->settings.start_id, old.start_id, sizeof old.start_id);
    memcpy(c->settings.store_id, old.store_id, sizeof old.store_id);
    users_configure(c);
    events_revoke(c);
    waits_revoke(c);
    workers_fill(c);
    core_log(c, "level=notice event=reload accounts=%zu workers=%d", c->settings.account_count, c->settings.workers);
}

static void rest(struct core *c)
{
    struct input *input;
    size_t at = 0;

    while (c->cache_bytes > 0 && (input = map_next(&c->inputs, &at)) != NULL)
        if (input->committed)
            input_cache(c, input, NULL);
    documents_drop(c);
}

/* All running jobs have ended and everything is committed. */
static bool quiet(const struct core *c)
{
    for (int slot = 0; slot < c->slot_count; slot++)
        if (c->slots[slot].job != NULL)
            return false;
    return c->uncommitted == 0 && c->tasks == 0 && c->state_counts[JOB_RUNNING] == 0;
}

struct actions *core_step(struct core *c, const struct event *e, struct moment now)
{
    c->out.count = 0;
    c->now = now;
    switch (e->type) {
    case EVENT_REQUEST:    request_handle(c, e); break;
    case EVENT_PEER_FULL: case EVENT_PEER_READY: events_peer(c, e->peer, e->type); break;
    case EVENT_PEER_GONE:
        events_peer(c, e->peer, e->type);
        waits_gone(c, e->peer);
        break;
    case EVENT_COMMITTED:  committed(c, e->transaction); break;
    case EVENT_TASK:       task_done(c, e->task); break;
    case EVENT_WORKER:     worker_message(c, e); break;
    case EVENT_EXIT:       worker_exit(c, e->slot, e->status, e->stderr_text); break;
    case EVENT_TIME:       break;
    case EVENT_REST:       rest(c); break;
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
    c->connections = open;
    c->connections_refused = refused_count;
    c->connections_ended = ended;
    c->hangups_kept = hangups_kept;
}

int64_t core_next_ns(const struct core *c)
{
    const struct heap_item *least = heap_least(&c->timers);

    return least == NULL ? INT64_MAX : least->key;
}

void core_count(const struct core *c, struct core_counts *out)
{
    *out = (struct core_counts) { .uncommitted = c->uncommitted, .tasks = c->tasks, .draining = c->draining || c->terminating };
    memcpy(out->states, c->state_counts, sizeof out->states);
    for (int slot = 0; slot < c->slot_count; slot++)
        out->busy_workers += c->slots[slot].state == SLOT_BUSY;
}

/* ---- the end ---------------------------------------------------------------------------------------------------- */

static void free_user(struct user *user)
{
    struct tombstone *stone;
    size_t at = 0;

    while ((stone = map_next(&user->tombstones, &at)) != NULL) {
        free(stone->key);
        free(stone);
    }
    map_done(&user->tombstones);
    map_done(&user->keys);
    map_done(&user->inputs);
    map_done(&user->identities);
    heap_done(&user->ready);
    free(user->jobs);
    free(user->open);
    free(user);
}

static void free_job(struct job *job)
{
    while (job->waits != NULL) {
        struct wait *next = job->waits->next;
        free(job->waits);
        job->waits = next;
    }
    blob_drop(job->document);
    failure_free(job->failure);
    after_free(job->asks);
    region_drop(job->key);
    region_drop(job->options);
    free(job->progress);
    free(job->stderr_text);
    region_drop(job);
}

void core_free(struct core *c)
{
    size_t at = 0;
    struct job *job;
    struct input *input;
    struct asker *asker;

    while ((job = map_next(&c->jobs, &at)) != NULL)
        free_job(job);
    for (at = 0; (input = map_next(&c->inputs, &at)) != NULL;) {
        if (input->filling != NULL)
            upload_close(input->filling->upload);
        input_forget(c, input);
    }
    for (size_t i = 0; i < c->user_count; i++)
        free_user(c->user_list[i]);
    free(c->asked.text);
    for (int i = 0; i < RING; i++) {
        free(c->ring[i].user);
        free(c->ring[i].topic);
        free(c->ring[i].text);
    }
    while (c->streams != NULL) {
        struct stream *next = c->streams->next_stream;
        stream_free(c->streams);
        c->streams = next;
    }
    while (c->subscriptions != NULL) {
        struct subscription *next = c->subscriptions->next;
        free(c->subscriptions->stream);
        free(c->subscriptions);
        c->subscriptions = next;
    }
    while (c->answers != NULL)
        answers_free(c->answers);
    for (int i = 0; i < SLOTS_MOST; i++)
        free(c->slots[i].document);
    map_done(&c->jobs);
    map_done(&c->inputs);
    map_done(&c->users);
    map_done(&c->results);
    map_done(&c->waits);
    for (at = 0; (asker = map_next(&c->askers, &at)) != NULL;)
        free(asker);
    map_done(&c->askers);
    heap_done(&c->timers);
    region_close(&c->region);
    arena_free(c->kinds);
    free(c->user_list);
    free(c->accounts);
    free(c->ended);
    free(c->full);
    free(c->out.items);
    free(c);
}
