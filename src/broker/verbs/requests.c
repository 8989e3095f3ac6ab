/* requests.c - what each verb does; one row a verb, in the order of PROTOCOL.md */
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include "broker/verbs/verbs.h"
#include "wire/frame.h"
#include <stdio.h>
#include <string.h>

static struct job *need_job(struct core *c, const struct request *q)
{
    struct job *job = job_find(c, q->user, &q->wire.job);
    const char *key = q->wire.job.key;

    if (job != NULL && job->committed)
        return job;
    if (key == NULL || !answer_expired(c, &q->reply, user_tombstone(q->user, key)))
        answer_fail(c, &q->reply, MODAL_NOT_FOUND, "job", NULL, "no such job of yours");
    return NULL;
}

static void on_hello(struct core *c, const struct request *q)
{
    cJSON *header, *limits, *detail;

    if (!q->wire.hello.speaks_ours) {
        detail = cJSON_CreateObject();
        cJSON_AddItemToArray(cJSON_AddArrayToObject(detail, "versions"),
                             cJSON_CreateString(WIRE_VERSION));
        answer_fail(c, &q->reply, MODAL_BAD_VERSION, "versions", detail,
                    "none of these versions is spoken here");
        return;
    }
    header = answer_new(&q->reply);
    cJSON_AddStringToObject(header, "version", WIRE_VERSION);
    cJSON_AddItemToArray(cJSON_AddArrayToObject(header, "versions"),
                         cJSON_CreateString(WIRE_VERSION));
    cJSON_AddStringToObject(header, "server", "modald " MODALD_VERSION);
    cJSON_AddStringToObject(header, "store", c->settings.store_id);
    cJSON_AddStringToObject(header, "start", c->settings.start_id);
    cJSON_AddStringToObject(header, "user", q->user->name);
    cJSON_AddStringToObject(header, "role", wire_roles[q->user->account->role]);
    cJSON_AddBoolToObject(header, "draining", c->draining || c->terminating);
    cJSON_AddNumberToObject(header, "time", (double)(c->now.utc_ns / 1000000) / 1000);
    limits = cJSON_AddObjectToObject(header, "limits");
    cJSON_AddNumberToObject(limits, "frames", WIRE_FRAMES_MOST);
    cJSON_AddNumberToObject(limits, "header", WIRE_HEADER_MOST);
    cJSON_AddNumberToObject(limits, "body", WIRE_BODY_MOST);
    cJSON_AddNumberToObject(limits, "chunk", WIRE_CHUNK_MOST);
    cJSON_AddNumberToObject(limits, "inline", WIRE_INLINE_MOST);
    cJSON_AddNumberToObject(limits, "window", (double)c->settings.window_bytes);
    cJSON_AddNumberToObject(limits, "input_bytes", (double)c->settings.input_bytes);
    cJSON_AddNumberToObject(limits, "queue_jobs", (double)c->settings.queue_jobs);
    cJSON_AddNumberToObject(limits, "timeout_s", WIRE_TIMEOUT_MOST);
    answer_send(c, &q->reply, header, NULL);
}

static void on_status(struct core *c, const struct request *q)
{
    answer_doc(c, &q->reply, q->job, -1, NULL);
}

/* ---- ending, again, forgetting --------------------------------------------------------------- */

static void ask(struct job *job, const struct reply *reply)
{
    struct after *after = after_new(AFTER_DOC, reply);

    after->job = job;
    if (job->last != NULL)
        transaction_join(job->last, after);
    else
        after_append(&job->asks, after);
}

static void audit(struct core *c, const struct user *user, const char *what, const struct job *job)
{
    char ident[9];

    job_ident(c, job, ident);
    core_log(c, "level=notice event=audit user=%s what=%s job=%s", user->name, what, ident);
}

static void on_cancel(struct core *c, const struct request *q)
{
    struct job *job = q->job;
    struct modal_error err;

    audit(c, q->user, "cancel", job);
    /* ended before: its doc says so, once it is committed */
    if (job_state_final(job->state)) {
        if (job->last != NULL)
            ask(job, &q->reply);
        else
            answer_doc(c, &q->reply, job, -1, NULL);
        return;
    }
    if (job->state == JOB_QUEUED) {
        modal_fail(&err, MODAL_CANCELLED, "cancelled while it was queued");
        job_fail(c, job, JOB_CANCELLED, &err, NULL);
        ask(job, &q->reply);
        return;
    }
    /* running: answered by the edge that its end makes */
    {
        struct after *after = after_new(AFTER_DOC, &q->reply);
        after->job = job;
        after_append(&job->asks, after);
    }
    if (job->ending == ENDING_NONE && job->slot >= 0 && !worker_is_finishing(c, job->slot)) {
        job->ending = ENDING_CANCEL;
        worker_kill(c, job->slot);
    }
}

static void on_retry(struct core *c, const struct request *q)
{
    struct job *job = q->job;

    if (job->state != JOB_DEAD || job->shown != JOB_DEAD) {
        answer_fail(c, &q->reply, MODAL_CONFLICT, "job", NULL,
                    "the job is %s; only a dead job can be tried again", job_states[job->shown]);
        return;
    }
    audit(c, q->user, "retry", job);
    failure_free(job->failure);
    job->failure = NULL;
    job->crashes = 0;
    job->user->ended--;
    job_move(c, job, JOB_QUEUED, NULL);
    ask(job, &q->reply);
}

static void on_delete(struct core *c, const struct request *q)
{
    struct job *job = q->job;

    if (job_state_final(job->state) && job->last != NULL) {
        answer_fail(c, &q->reply, MODAL_CONFLICT, "job", NULL,
                    "that the job is %s is not stored yet",
                    job->deleting || job->hidden ? "deleted" : job_states[job->state]);
        return;
    }
    if (!job_state_final(job->shown)) {
        answer_fail(c, &q->reply, MODAL_CONFLICT, "job", NULL, "the job is %s; cancel it first",
                    job_states[job->shown]);
        return;
    }
    audit(c, q->user, "delete", job);
    job_remove(c, job, &q->reply);
}

/* ---- waiting --------------------------------------------------------------------------------- */

static void on_wait(struct core *c, const struct request *q)
{
    struct wait wait = { .job = q->job, .reply = q->reply, .result = q->wire.wait.result,
                         .user = q->user };

    snprintf(wait.key, sizeof wait.key, "%s", q->event->key);
    if (job_state_final(q->job->shown) || q->wire.wait.timeout_s <= 0) {
        if (!wait.result || read_allows(c, q->user, &q->reply))
            wait_tell(c, &wait);
    } else if (q->user->waits >= WIRE_WAITS_MOST)
        answer_fail(c, &q->reply, MODAL_BUSY, "", answer_number("retry_after_s", 1),
                    "%d waits are open, at most %d", q->user->waits, WIRE_WAITS_MOST);
    else
        wait_begin(c, &wait, q->wire.wait.timeout_s);
}

/* ---- reading --------------------------------------------------------------------------------- */

static void own_error(struct core *c, const struct reply *reply, const struct job *job)
{
    struct modal_error err;
    cJSON *detail = cJSON_CreateObject();

    cJSON_AddStringToObject(detail, "state", job_states[job->shown]);
    modal_fail_field(&err, job->failure == NULL ? MODAL_INTERNAL : job->failure->status,
                     job->failure != NULL && job->failure->field != NULL ? job->failure->field : "",
                     "%s", job->failure == NULL ? "the job has no result" : job->failure->message);
    answer_error(c, reply, &err, detail);
}

/* A job that is not done has no document and no signals. */
static void answer_unfinished(struct core *c, const struct reply *reply, const struct job *job)
{
    if (job_state_final(job->shown))
        own_error(c, reply, job);
    else
        answer_fail(c, reply, MODAL_CONFLICT, "job", NULL, "the job is %s; it has no result yet",
                    job_states[job->shown]);
}

/* The task that reads INPUT, which may be NULL, for JOB, or where that is NULL for itself; NULL:
 * answered. */
static struct task *read_signals(struct core *c, const struct reply *reply, const struct job *job,
                                 const struct input *input, const char *part)
{
    struct task *task;

    if (input == NULL) {
        answer_fail(c, reply, MODAL_NOT_FOUND, "part", NULL, "the job made no signals");
        return NULL;
    }
    if (input->inline_data)
        return read_for(c, reply, job, TASK_READ_INPUT, input->id, part);
    task = read_for(c, reply, job, TASK_READ_SPOOL, input->id, part);
    task->begin = input->offset;
    task->total = input->bytes;
    task->crc = input->crc;
    return task;
}

/* A sealed input of the caller's; NULL: answered. */
static const struct input *input_named(struct core *c, const struct request *q)
{
    const struct input *input = input_by_id(c, ident_number(~c->settings.secret,
                                                            q->wire.result.upload));

    if (input != NULL && input->user == q->user && input->state == INPUT_SEALED && !input->going
        && input->committed)
        return input;
    answer_fail(c, &q->reply, MODAL_NOT_FOUND, "upload", NULL, "no such sealed input of yours");
    return NULL;
}

static struct task *read_input(struct core *c, const struct request *q)
{
    const struct input *input = input_named(c, q);

    return input == NULL ? NULL
                         : read_signals(c, &q->reply, NULL, input, wire_parts[WIRE_INPUT]);
}

static struct task *read_part(struct core *c, const struct request *q)
{
    const struct job *job = need_job(c, q);
    enum wire_part wanted = q->wire.result.part;
    const char *part = wire_parts[wanted];

    if (job == NULL)
        return NULL;
    if (wanted == WIRE_STDERR)
        return read_for(c, &q->reply, job, TASK_READ_STDERR, job->id, part);
    if (wanted != WIRE_INPUT && job->shown != JOB_DONE) {
        answer_unfinished(c, &q->reply, job);
        return NULL;
    }
    if (wanted == WIRE_DOCUMENT)
        return read_for(c, &q->reply, job, TASK_READ_RESULT,
                        job->source != 0 ? job->source : job->id, part);
    return read_signals(c, &q->reply, job, wanted == WIRE_INPUT ? job->input : job->output, part);
}

static void on_result(struct core *c, const struct request *q)
{
    struct task *task;

    if (!read_allows(c, q->user, &q->reply))
        return;
    task = q->wire.result.upload != NULL ? read_input(c, q) : read_part(c, q);
    if (task == NULL)
        return;
    task->offset = q->wire.result.offset;
    task->length = q->wire.result.length;
}

/* ---- LIST ---- */

static bool begins(const char *text, const char *with)
{
    return text != NULL && strncmp(text, with, strlen(with)) == 0;
}

static bool is_listed(const struct job *job, const struct wire_list *l)
{
    return job->committed && !job->deleting && !job->hidden
           && (l->state < 0 || (int)job->shown == l->state)
           && (l->kind == NULL || strcmp(job->kind, l->kind) == 0)
           && (l->key == NULL || begins(job->key, l->key))
           && (double)job->submitted_ns >= l->since * (double)SECOND;
}

/* The next of USER's jobs from *AT on, towards the newest or from there. */
static struct job *next_listed(const struct user *user, bool newest, size_t *at)
{
    struct job *job = NULL;

    while (job == NULL && (newest ? *at > 0 : *at < user->job_count))
        job = user->jobs[newest ? --*at : (*at)++];
    return job;
}

static void on_list(struct core *c, const struct request *q)
{
    const struct wire_list *l = &q->wire.list;
    const struct user *user = user_listed(c, &q->reply, q->user, q->wire.list.user);
    int64_t after = l->after == NULL ? 0 : ident_number(c->settings.secret, l->after);
    struct json_text page = { 0 };
    struct job *job;
    cJSON *header;
    char ident[9] = "", *text;
    size_t at;
    int count = 0;

    if (user == NULL)
        return;
    if (after < 0) {
        answer_fail(c, &q->reply, MODAL_BAD_INPUT, "after", NULL,
                    "after is no cursor of LIST; accepted: `next` of an earlier page");
        return;
    }
    json_text_open(&page, NULL);
    json_text_key(&page, "jobs");
    json_text_raw(&page, "[");
    at = !l->newest ? user_seek(user, after)
         : after > 0 ? user_seek(user, after - 1) : user->job_count;
    while (count < l->limit && (job = next_listed(user, l->newest, &at)) != NULL) {
        if (!is_listed(job, l))
            continue;
        json_text_open(&page, NULL);
        doc_write(c, &page, job, false);
        json_text_close(&page);
        job_ident(c, job, ident);
        count++;
    }
    json_text_raw(&page, "]");
    json_text_string(&page, "next", count == l->limit && next_listed(user, l->newest, &at) != NULL
                                        ? ident : NULL);
    text = text_end(&page);
    header = answer_new(&q->reply);
    cJSON_AddNumberToObject(header, "count", count);
    answer_send(c, &q->reply, header, blob_take(text, strlen(text)));
}

static void on_stats(struct core *c, const struct request *q)
{
    cJSON *header = answer_new(&q->reply);

    stats_write(c, q->user, q->user->account->role == WIRE_ROLE_ADMIN, header);
    answer_send(c, &q->reply, header, workers_names(c));
}

static void on_metrics(struct core *c, const struct request *q)
{

    answer_send(c, &q->reply, answer_new(&q->reply),
                metrics_text(c, q->user->account->role == WIRE_ROLE_ADMIN ? NULL : q->user));
}

static void add_limit(cJSON *object, const char *key, double value)
{
    if (value > 0)
        cJSON_AddNumberToObject(object, key, value);
    else
        cJSON_AddNullToObject(object, key);
}

static void on_whoami(struct core *c, const struct request *q)
{
    const struct user *user = q->user;
    cJSON *header = answer_new(&q->reply), *limits, *used;
    const struct allowance *most = &user->account->most;

    cJSON_AddStringToObject(header, "user", user->name);
    cJSON_AddStringToObject(header, "role", wire_roles[user->account->role]);
    limits = cJSON_AddObjectToObject(header, "limits");
    add_limit(limits, "queued", (double)most->queued);
    add_limit(limits, "running", (double)most->running);
    add_limit(limits, "bytes", (double)most->bytes);
    add_limit(limits, "cpu_s_day", most->cpu_s_day);
    add_limit(limits, "upload_bytes_s", most->upload_bytes_s);
    cJSON_AddNumberToObject(limits, "weight", user->account->weight);
    used = cJSON_AddObjectToObject(header, "used");
    cJSON_AddNumberToObject(used, "queued", (double)user->queued);
    cJSON_AddNumberToObject(used, "running", (double)user->running);
    cJSON_AddNumberToObject(used, "bytes", (double)user->bytes);
    cJSON_AddNumberToObject(used, "cpu_s_day",
                            user->cpu_day == c->now.utc_ns / DAY ? user->cpu_s : 0);
    answer_send(c, &q->reply, header, NULL);
}

/* Drained is remembered over a restart. */
static void set_drain(struct core *c, const struct request *q, bool draining)
{
    struct transaction *t = transaction_new();

    c->draining = draining;
    transaction_add(t, LEDGER_NOTE_PUT)->note =
        (struct note_record) { "daemon", "draining", draining ? "true" : NULL };
    transaction_join(t, after_new(AFTER_DRAIN, &q->reply));
    core_log(c, "level=notice event=audit user=%s what=%s", q->user->name,
             draining ? "drain" : "undrain");
    core_commit(c, t);
}

static void on_drain(struct core *c, const struct request *q)
{
    set_drain(c, q, true);
}

static void on_undrain(struct core *c, const struct request *q)
{
    set_drain(c, q, false);
}

static const struct {
    void (*handle)(struct core *c, const struct request *q);
    bool of_job;                          /* one that there is; else it is answered here */
} verbs[WIRE_VERB_COUNT] = {
    [WIRE_HELLO] = { on_hello },          [WIRE_UPLOAD] = { upload_request },
    [WIRE_SUBMIT] = { submit_request },   [WIRE_SUBMITS] = { submits_request },
    [WIRE_STATUS] = { on_status, true },  [WIRE_WAIT] = { on_wait, true },
    [WIRE_RESULT] = { on_result },  [WIRE_CANCEL] = { on_cancel, true },
    [WIRE_RETRY] = { on_retry, true },    [WIRE_DELETE] = { on_delete, true },
    [WIRE_LIST] = { on_list },            [WIRE_EVENTS] = { events_request },
    [WIRE_STATS] = { on_stats },          [WIRE_METRICS] = { on_metrics },
    [WIRE_WHOAMI] = { on_whoami },        [WIRE_DRAIN] = { on_drain },
    [WIRE_UNDRAIN] = { on_undrain },      [WIRE_STREAM] = { stream_request },
    [WIRE_STREAMS] = { streams_request },
};

/* An answer to what could not be read as a request, or may not be asked; the verb as it came,
 * where it came. */
static void refuse(struct core *c, const struct event *e, const struct modal_error *err)
{
    const char *id = e->message != NULL ? e->message->id : e->id;
    const char *verb = e->message != NULL ? e->message->verb : e->verb;
    cJSON *detail = NULL;

    if (err->status == MODAL_BAD_VERSION) {
        detail = cJSON_CreateObject();
        cJSON_AddItemToArray(cJSON_AddArrayToObject(detail, "versions"),
                             cJSON_CreateString(WIRE_VERSION));
    }
    if (err->status == MODAL_BUSY)
        detail = answer_number("retry_after_s", 0.1);
    c->counts.rejects[err->status]++;
    core_act(c, (struct action) {
        .type = ACT_SEND, .peer = e->peer, .verb = "ERROR",
        .header = wire_error_header(id, verb, err, detail) });
}

void request_handle(struct core *c, const struct event *e)
{
    struct request q = { .event = e, .user = user_of_key(c, e->key) };
    const struct user *user = q.user;
    struct modal_error err;

    if (e->message == NULL) {
        refuse(c, e, e->fault);
        return;
    }
    c->counts.bytes_in += (int64_t)e->message->body_bytes;
    if (user == NULL || !role_is_client(user->account->role)) {
        modal_fail(&err, MODAL_DENIED, "this key is not, or no longer, admitted");
        if (c->now.mono_ns >= c->next_denial_ns)       /* a flood of them is not one of the log */
            core_log(c, "level=notice event=audit user=- what=denied key=%s",
                     e->key[0] != 0 ? e->key : "-");
        c->next_denial_ns =
            c->now.mono_ns >= c->next_denial_ns ? c->now.mono_ns + SECOND : c->next_denial_ns;
        refuse(c, e, &err);
        return;
    }
    if (wire_request_read(e->message, &q.wire, &err) != MODAL_OK) {
        refuse(c, e, &err);
        return;
    }
    if (user->account->role < wire_verb_role(q.wire.verb)) {
        modal_fail(&err, MODAL_DENIED, "the role %s may not ask %s",
                   wire_roles[user->account->role], wire_verb_name(q.wire.verb));
        core_log(c, "level=notice event=audit user=%s what=denied verb=%s", user->name,
                 wire_verb_name(q.wire.verb));
        refuse(c, e, &err);
        return;
    }
    q.reply = reply_to(e, &q.wire);
    if (!verbs[q.wire.verb].of_job || (q.job = need_job(c, &q)) != NULL)
        verbs[q.wire.verb].handle(c, &q);
}
