/*
 * jobs.c - the one place where jobs move, and where they come from and go to
 *
 * A move is decided in memory at once, in one order, and shown once the ledger has it.  So the
 * first decision wins, and since the ledger applies them in the same order, the first committed
 * edge does.
 */
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    RETAINED_A_STEP = 1000,                   /* jobs that go in a step, which stays short */
    RETAIN_PAUSE_NS = 20 * 1000 * 1000,       /* so 50,000 a second: more than can be submitted */
};

static bool has_key(const void *value, const void *key)
{
    return strcmp(((const struct job *)value)->key, key) == 0;
}

/* By key also one whose row is not committed yet: only SUBMIT may see it. */
struct job *job_find(const struct core *c, struct user *user, const struct wire_job *ref)
{
    struct job *job = ref->key != NULL
                          ? map_find(&user->keys, map_hash_text(ref->key), has_key, ref->key)
                          : job_by_id(c, ident_number(c->settings.secret, ref->id));

    return job == NULL || job->user != user || job->deleting || job->hidden ? NULL : job;
}

struct job *job_new(struct core *c, struct user *user, int64_t id)
{
    struct job *job = region_grab(&c->region, sizeof *job);

    job->id = id;
    job->user = user;
    job->slot = -1;
    job->max_attempts = WIRE_ATTEMPTS_DEFAULT;
    return job;
}

void job_index(struct core *c, struct job *job)
{
    if (!map_put(&c->jobs->all, map_hash_number((uint64_t)job->id), job)
        || (job->key != NULL && !map_put(&job->user->keys, map_hash_text(job->key), job)))
        abort();
    user_add_job(job->user, job);
}

/* ---- results that may answer again ----------------------------------------------------------- */

struct cache_key { const struct user *user; const uint8_t *content, *settings; };

static uint64_t cache_hash(const uint8_t content[32], const uint8_t settings[32])
{
    return map_hash(content, 32) * 31 + map_hash(settings, 32);
}

static bool has_result(const void *value, const void *key)
{
    const struct job *job = value;
    const struct cache_key *k = key;

    return job->user == k->user && memcmp(job->input->content, k->content, 32) == 0
        && memcmp(job->settings, k->settings, 32) == 0;
}

struct job *job_cached(struct core *c, struct user *user, const uint8_t content[32],
                       const uint8_t settings[32])
{
    struct cache_key key = { user, content, settings };

    return map_find(&c->jobs->results, cache_hash(content, settings), has_result, &key);
}

void job_index_result(struct core *c, struct job *job)
{
    if (job->indexed || job->input == NULL
        || job_cached(c, job->user, job->input->content, job->settings) != NULL)
        return;
    job->indexed = true;
    if (!map_put(&c->jobs->results, cache_hash(job->input->content, job->settings), job))
        abort();
}

static void job_unindex(struct core *c, struct job *job)
{
    if (job->indexed)
        map_remove(&c->jobs->results, cache_hash(job->input->content, job->settings), job);
    job->indexed = false;
}

/* ---- moves ----------------------------------------------------------------------------------- */

/* Of ERR; DETAIL (or NULL) is taken. */
static struct failure *failure_new(const struct modal_error *err, cJSON *detail)
{
    struct failure *f = grab(sizeof *f);

    /* no descriptor was left: to a job that is an error of input or output */
    f->status = err->status == MODAL_BUSY ? MODAL_IO : err->status;
    f->message = grab_text(err->message);
    f->field = err->field[0] != 0 ? grab_text(err->field) : NULL;
    f->detail = detail == NULL ? NULL : json_print(detail);
    cJSON_Delete(detail);
    return f;
}

void failure_free(struct failure *f)
{
    if (f == NULL)
        return;
    free(f->message);
    free(f->field);
    free(f->detail);
    free(f);
}

static void move_row(struct transaction *t, const struct job *job)
{
    const struct failure *f = job->failure;
    struct ledger_change *change = transaction_add(t, LEDGER_JOB_MOVE);

    change->job = (struct job_record) {
        .id = job->id, .state = job->state, .attempts = job->attempts, .crashes = job->crashes,
        .submitted_ns = job->submitted_ns, .started_ns = job->started_ns,
        .finished_ns = job->finished_ns, .cpu_ns = job->cpu_ns, .result_bytes = job->result_bytes,
        .output = job->output == NULL ? 0 : job->output->id, .cached = job->cached };
    if (f == NULL)
        return;
    change->job.error_code = modal_status_code(f->status);
    change->job.error_message = transaction_text(t, f->message);
    change->job.error_field = transaction_text(t, f->field);
    change->job.error_detail = transaction_text(t, f->detail);
    change->job.stderr_text = transaction_text(t, job->stderr_text);
}

/* The numbered event of an edge, committed with it. */
void job_event(struct core *c, struct job *job, struct transaction *t,
               const struct failure *failure, enum job_state to)
{
    struct ledger_change *change = transaction_add(t, LEDGER_EVENT_PUT);
    struct json_text text = { 0 };
    struct after *after = transaction_after(t, AFTER_EVENT);
    char ident[9];

    job_ident(c, job, ident);
    json_text_open(&text, NULL);
    json_text_string(&text, "event", "state");
    json_text_string(&text, "job", ident);
    json_text_string(&text, "key", job->key);
    json_text_string(&text, "kind", job->kind);
    json_text_string(&text, "state", job_states[to]);
    json_text_number(&text, "attempts", job->attempts);
    if (job->cached)
        json_text_bool(&text, "cached", true);
    if (failure != NULL) {
        json_text_open(&text, "error");
        json_text_string(&text, "code", modal_status_code(failure->status));
        json_text_string(&text, "message", failure->message);
        json_text_close(&text);
    }
    after->text = text_end(&text);
    after->value = c->next_event;
    after->ns = c->now.utc_ns;
    after->job = job;
    after->to = to;
    change->event = (struct event_record) {
        .number = c->next_event++, .ns = c->now.utc_ns, .job = job->id,
        .user = transaction_text(t, job->user->name), .topic = "job",
        .text = transaction_text(t, after->text) };
}

void job_count(struct core *c, const struct job *job, int more)
{
    if (job->hidden)
        return;
    job->user->states[job->state] += more;
    if (job->kind_row >= 0)
        c->jobs->kind_counts[job->kind_row] += more;
}

void job_count_queued(const struct job *job, int more)
{
    job->user->queued += more;
    if (job->input != NULL && input_is_large(job->input))
        job->user->queued_large += more;
}

static void count_move(struct core *c, struct job *job, enum job_state to)
{
    c->jobs->state_counts[job->state]--;
    c->jobs->state_counts[to]++;
    job->user->states[job->state] -= !job->hidden;
    job->user->states[to] += !job->hidden;
    job_count_queued(job, (to == JOB_QUEUED) - (job->state == JOB_QUEUED));
    job->user->running += (to == JOB_RUNNING) - (job->state == JOB_RUNNING);
}

void job_move(struct core *c, struct job *job, enum job_state to, struct transaction *t)
{
    enum job_state from = job->state;
    struct after *after;

    if (!ledger_moves[from][to])
        abort();                                   /* a bug: no such edge in the table */
    if (t == NULL)
        t = transaction_new();
    count_move(c, job, to);
    job->state = to;
    job->ready = false;
    job->ending = ENDING_NONE;
    if (to == JOB_RUNNING)
        job->started_ns = c->now.utc_ns;
    if (job_state_final(to))
        job->finished_ns = c->now.utc_ns;
    move_row(t, job);
    if (from == JOB_RUNNING)
        user_note(job->user, t);
    job_event(c, job, t, job->failure, to);
    after = transaction_after(t, AFTER_SHOW);
    after->job = job;
    after->from = from;
    after->to = to;
    after->attempts = job->attempts;
    transaction_join(t, job->asks);
    job->asks = NULL;
    job->last = t;
    core_commit(c, t);
}

void job_fail(struct core *c, struct job *job, enum job_state to, const struct modal_error *err,
              cJSON *detail)
{
    failure_free(job->failure);
    job->failure = failure_new(err, detail);
    job_move(c, job, to, NULL);
}

/* Remember the order of ending, for retention. */
void job_note_end(struct core *c, struct job *job)
{
    if (c->jobs->ended_count == c->jobs->ended_room) {
        size_t keep = c->jobs->ended_count - c->jobs->ended_first;
        if (c->jobs->ended_first > keep)
            memmove(c->jobs->ended, c->jobs->ended + c->jobs->ended_first,
                    keep * sizeof *c->jobs->ended);
        else {
            c->jobs->ended_room = c->jobs->ended_room ? 2 * c->jobs->ended_room : 256;
            c->jobs->ended = regrab(c->jobs->ended, c->jobs->ended_room * sizeof *c->jobs->ended);
            memmove(c->jobs->ended, c->jobs->ended + c->jobs->ended_first,
                    keep * sizeof *c->jobs->ended);
        }
        c->jobs->ended_first = 0;
        c->jobs->ended_count = keep;
    }
    c->jobs->ended[c->jobs->ended_count++] = job->id;
    job->user->ended += !job->hidden;
}

/* What the last attempt of JOB took, where it had one: seconds from its start to its end. */
static void write_cost(const struct job *job, char *text, size_t size)
{
    *text = 0;
    if (job->started_ns > 0 && job->finished_ns >= job->started_ns && !job->cached)
        snprintf(text, size, " wall_s=%.3f cpu_s=%.3f",
                 (double)(job->finished_ns - job->started_ns) / SECOND,
                 (double)job->cpu_ns / SECOND);
}

/* The line that is written most often: put together, not formatted. */
void job_log_edge(struct core *c, const struct job *job, const char *from, enum job_state to,
                  uint64_t peer)
{
    const bool failed = job_state_final(to) && job->failure != NULL;
    char ident[9], attempts[16], cost[64] = "";
    const char *const parts[] = {
        "level=info event=edge job=", ident, " user=", job->user->name, " kind=", job->kind,
        " from=", from, " to=", job_states[to], " attempts=", attempts, cost,
        failed ? " code=" : "", failed ? modal_status_code(job->failure->status) : "" };
    enum { PARTS = sizeof parts / sizeof *parts };
    size_t lengths[PARTS], length = 1;
    char *line, *end;

    job_ident(c, job, ident);
    snprintf(attempts, sizeof attempts, "%d", job->attempts);
    if (job_state_final(to))
        write_cost(job, cost, sizeof cost);
    for (int i = 0; i < PARTS; i++)
        length += lengths[i] = strlen(parts[i]);
    line = end = grab(length);
    for (int i = 0; i < PARTS; i++)
        end = mempcpy(end, parts[i], lengths[i]);
    core_act(c, (struct action) { .type = ACT_LOG, .header = line, .peer = peer });
}

void job_shown(struct core *c, const struct after *after)
{
    struct job *job = after->job;

    job->shown = after->to;
    job->shown_attempts = after->attempts;
    job_log_edge(c, job, job_states[after->from], after->to, 0);
    if (job->shown == JOB_DONE && !job->cached) {
        c->jobs->result_total += (int64_t)job->result_bytes;
        job->user->bytes += (int64_t)job->result_bytes;
        job_index_result(c, job);
    }
    if (job->shown == JOB_QUEUED && after->from == JOB_DEAD)
        job_enqueue(c, job);
    if (!job_state_final(job->shown) || job->state != job->shown)
        return;
    job_note_end(c, job);
    if (job->shown != JOB_DEAD) {
        region_drop(job->options);
        job->options = NULL;
    }
    free(job->progress);
    free(job->stderr_text);
    job->progress = job->stderr_text = NULL;
    wait_answer(c, job);
}

/* Ready now, or at its time. */
void job_enqueue(struct core *c, struct job *job)
{
    int64_t wait_ns = job->not_before_ns > c->now.utc_ns ? job->not_before_ns - c->now.utc_ns : 0;

    if (wait_ns > 0) {
        core_timer(c, c->now.mono_ns + wait_ns, TIMER_START, job->id, 0);
        return;
    }
    if (job->ready || job->state != JOB_QUEUED)
        return;
    job->ready = true;
    if (!heap_push(&job->user->ready,
                   (struct heap_item) {
                       .key = job->submitted_ns - job->priority * 60 * SECOND,
                       .order = job->id }))
        abort();
}

void job_expired(struct core *c, int64_t id, enum timer what, int64_t extra)
{
    struct job *job = job_by_id(c, id);
    struct modal_error err;

    if (job == NULL || !job->committed)
        return;
    if (what == TIMER_START) {
        job_enqueue(c, job);
        return;
    }
    if (what == TIMER_DEADLINE && job->state == JOB_QUEUED) {
        modal_fail(&err, MODAL_DEADLINE, "the deadline passed while the job was queued");
        job_fail(c, job, JOB_FAILED, &err, NULL);
        return;
    }
    if (job->state != JOB_RUNNING || job->ending != ENDING_NONE
        || (what == TIMER_RUN_LIMIT && job->attempts != extra))
        return;
    job->ending = what == TIMER_DEADLINE ? ENDING_DEADLINE : ENDING_RUN_LIMIT;
    worker_kill(c, job->slot);
}

/* ---- going ----------------------------------------------------------------------------------- */

static void drop_share(struct core *c, int64_t source)
{
    struct job *root = source == 0 ? NULL : job_by_id(c, source);

    if (root != NULL && --root->shares == 0 && root->hidden)
        job_remove(c, root, NULL);
}

/* What its result counts against `result_bytes`: another's, shown again, counts once. */
static int64_t bytes_counted(const struct job *job)
{
    return job->shown == JOB_DONE && !job->cached ? (int64_t)job->result_bytes : 0;
}

/* Delete row, result and, when nobody else names them, input and output; a key leaves
 * a tombstone. */
void job_remove(struct core *c, struct job *job, const struct reply *reply)
{
    struct transaction *t = transaction_new();
    struct after *after;
    bool was_hidden = job->hidden;

    if (job->key != NULL && !was_hidden) {
        struct tombstone_record *stone = &transaction_add(t, LEDGER_TOMBSTONE_PUT)->tombstone;
        *stone = (struct tombstone_record) {
            .user = transaction_text(t, job->user->name), .key = transaction_text(t, job->key),
            .job = job->id, .expired_ns = c->now.utc_ns };
        memcpy(stone->fingerprint, job->fingerprint, 32);
    }
    /* others show its result: the row stays, unseen */
    if (job->shares > 0) {
        struct job_record *row = &transaction_add(t, LEDGER_JOB_LIMITS)->job;
        *row = (struct job_record) { .id = job->id, .priority = job->priority,
                                     .tag = "{\"hidden\":true}" };
        job_count(c, job, -1);
        job->hidden = true;
    } else {
        transaction_add(t, LEDGER_JOB_DELETE)->id = job->id;
        job->deleting = true;
        c->jobs->result_leaving += bytes_counted(job);
    }
    job_unindex(c, job);
    job->user->ended -= !was_hidden;
    if (job->key != NULL && !was_hidden) {
        map_remove(&job->user->keys, map_hash_text(job->key), job);
        user_bury(job->user, job->key, job->fingerprint, c->now.utc_ns);
        tombstones_trim(c, job->user, t);
    }
    after = after_new(AFTER_DELETE, reply);
    after->job = job;
    transaction_join(t, after);
    job->last = t;
    core_commit(c, t);
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

void job_forget(struct core *c, struct job *job)
{
    struct input *input = job->input, *output = job->cached ? NULL : job->output;
    int64_t source = job->source;

    c->jobs->state_counts[job->state]--;
    job_count(c, job, -1);
    if (job->state == JOB_QUEUED)
        job_count_queued(job, -1);
    c->jobs->result_total -= bytes_counted(job);
    c->jobs->result_leaving -= job->deleting ? bytes_counted(job) : 0;
    job->user->bytes -= bytes_counted(job);
    for (size_t i = 0; i < sizeof c->jobs->document_ring / sizeof *c->jobs->document_ring; i++)
        if (c->jobs->document_ring[i] == job)
            c->jobs->document_ring[i] = NULL;
    job_unindex(c, job);
    map_remove(&c->jobs->all, map_hash_number((uint64_t)job->id), job);
    if (job->key != NULL)
        map_remove(&job->user->keys, map_hash_text(job->key), job);
    user_drop_job(job->user, job);
    free_job(job);
    input_use(c, input, -1);
    input_use(c, output, -1);
    if (input != NULL && input->jobs == 0 && input->inline_data && input->committed)
        input_remove(c, input);
    drop_share(c, source);
}

/* May this ended job stay?  What is on its way out already makes room. */
static bool may_stay(const struct core *c, const struct job *job)
{
    return job->finished_ns + c->settings.result_age_ns >= c->now.utc_ns
        && c->jobs->result_total - c->jobs->result_leaving <= c->settings.result_bytes;
}

static void retire(struct core *c, struct job *job)
{
    core_log(c, "level=info event=retention user=%s kind=%s state=%s", job->user->name, job->kind,
             job_states[job->shown]);
    job_remove(c, job, NULL);
}

/* The oldest of all go, BUDGET at most; true: there are more. */
static bool retain_oldest(struct core *c, int *budget)
{
    while (c->jobs->ended_first < c->jobs->ended_count && (*budget)-- > 0) {
        struct job *job = job_by_id(c, c->jobs->ended[c->jobs->ended_first]);

        if (job != NULL && (may_stay(c, job) || (job->last != NULL && !job->deleting)))
            /* too young, or its latest edge is not committed yet */
            return false;
        c->jobs->ended_first++;
        if (job != NULL && !job->deleting && !job->hidden && job_state_final(job->shown))
            retire(c, job);
    }
    return c->jobs->ended_first < c->jobs->ended_count;
}

/* The same of USER's, where they are more than are kept of each: nobody's make others' go. */
static bool retain_of(struct core *c, struct user *user, int *budget)
{
    for (size_t i = 0; i < user->job_count && user->ended > c->settings.jobs_kept && *budget > 0;
         i++) {
        struct job *job = user->jobs[i];
        if (job == NULL || job->deleting || job->hidden || !job_state_final(job->shown)
            || job->last != NULL)
            continue;
        (*budget)--;
        retire(c, job);
    }
    return user->ended > c->settings.jobs_kept;
}

/* The oldest ended jobs go: past their age, while results take more bytes than they may, or past
 * what is kept of a user's.  A step stays short: what is left of them follows in the next, as soon
 * as the disk has taken these. */
void jobs_retain(struct core *c)
{
    int budget = c->uncommitted > RETAINED_A_STEP ? 0 : RETAINED_A_STEP;
    bool more = retain_oldest(c, &budget);

    for (size_t i = 0; i < c->user_count; i++)
        more |= retain_of(c, c->user_list[i], &budget);
    if (more && !c->jobs->retaining)
        core_timer(c, c->now.mono_ns + RETAIN_PAUSE_NS, TIMER_RETAIN, 0, 0);
    c->jobs->retaining |= more;
}

/* A committed job that is queued: ready, or at its time; its deadline is watched. */
void job_watch(struct core *c, struct job *job)
{
    if (job->deadline_ns > 0 && !job_state_final(job->state))
        core_timer(c,
                   c->now.mono_ns
                       + (job->deadline_ns > c->now.utc_ns ? job->deadline_ns - c->now.utc_ns : 0),
                   TIMER_DEADLINE, job->id, 0);
    if (job->state == JOB_QUEUED)
        job_enqueue(c, job);
}

/* Keep the last few documents at hand, so that who waits for one is answered from memory. */
void document_keep(struct core *c, struct job *job, struct blob *document)
{
    struct job **place = &c->jobs->document_ring[c->jobs->document_at];

    if (document->size > LEDGER_RESULT_INLINE_MOST)
        return;
    if (*place != NULL) {
        blob_drop((*place)->document);
        (*place)->document = NULL;
    }
    *place = job;
    c->jobs->document_at = (c->jobs->document_at + 1)
                           % (int)(sizeof c->jobs->document_ring / sizeof *c->jobs->document_ring);
    job->document = blob_share(document);
}

void documents_drop(struct core *c)
{
    for (size_t i = 0; i < sizeof c->jobs->document_ring / sizeof *c->jobs->document_ring; i++)
        if (c->jobs->document_ring[i] != NULL) {
            blob_drop(c->jobs->document_ring[i]->document);
            c->jobs->document_ring[i]->document = NULL;
            c->jobs->document_ring[i] = NULL;
        }
}

void jobs_init(struct core *c)
{
    c->jobs = grab(sizeof *c->jobs);
    c->jobs->next_job = c->jobs->next_wait = 1;
}

void jobs_done(struct core *c)
{
    struct jobs *jobs = c->jobs;
    struct asker *asker;
    struct job *job;
    size_t at = 0;

    while ((job = map_next(&jobs->all, &at)) != NULL)
        free_job(job);
    for (at = 0; (asker = map_next(&jobs->askers, &at)) != NULL;)
        free(asker);
    map_done(&jobs->all);
    map_done(&jobs->results);
    map_done(&jobs->waits);
    map_done(&jobs->askers);
    arena_free(jobs->kinds);
    free(jobs->asked.text);
    free(jobs->ended);
    free(jobs);
}
