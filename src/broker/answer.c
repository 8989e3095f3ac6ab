/* answer.c - actions, replies, errors and queue documents, as proto/PROTOCOL.md sections 3 and 5 */
#include "broker/state.h"
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void core_act(struct core *c, struct action action)
{
    if (c->out.count == c->out.room) {
        c->out.room = c->out.room ? 2 * c->out.room : 32;
        c->out.items = regrab(c->out.items, c->out.room * sizeof *c->out.items);
    }
    c->out.items[c->out.count++] = action;
}

void core_log(struct core *c, const char *format, ...)
{
    char *line = NULL;
    va_list args;

    va_start(args, format);
    if (vasprintf(&line, format, args) < 0)
        abort();
    va_end(args);
    core_act(c, (struct action) { .type = ACT_LOG, .header = line });
}

void core_timer(struct core *c, int64_t when_ns, enum timer what, int64_t order, int64_t extra)
{
    if (!heap_push(&c->timers, (struct heap_item) { when_ns, order, (void *)(intptr_t)extra, what }))
        abort();
}

void job_ident(const struct core *c, const struct job *job, char out[9])
{
    ident_text(out, c->settings.secret, job->id);
}

void input_ident(const struct core *c, const struct input *input, char out[9])
{
    ident_text(out, ~c->settings.secret, input->id);
}

struct reply reply_to(const struct event *e, const struct wire_request *r)
{
    struct reply reply = { .peer = e->peer, .verb = r->verb };

    snprintf(reply.id, sizeof reply.id, "%s", r->id);
    return reply;
}

cJSON *answer_new(const struct reply *reply)
{
    cJSON *header = cJSON_CreateObject();

    cJSON_AddRawToObject(header, "id", reply->id);
    cJSON_AddStringToObject(header, "verb", wire_verb_name(reply->verb));
    return header;
}

void answer_send(struct core *c, const struct reply *reply, cJSON *header, struct blob *body)
{
    char *text = reply->peer == 0 ? NULL : json_print(header);

    cJSON_Delete(header);
    if (text == NULL) {
        blob_drop(body);
        return;
    }
    c->replies++;
    c->bytes_out += (int64_t)(strlen(text) + (body == NULL ? 0 : body->size));
    core_act(c, (struct action) { .type = ACT_SEND, .peer = reply->peer, .verb = "REPLY", .header = text, .body = body });
}

void answer_error(struct core *c, const struct reply *reply, const struct modal_error *err, cJSON *detail)
{
    if (reply->peer == 0) {
        cJSON_Delete(detail);
        return;
    }
    c->rejects[err->status]++;
    core_act(c, (struct action) { .type = ACT_SEND, .peer = reply->peer, .verb = "ERROR",
                                  .header = wire_error_header(reply->id, wire_verb_name(reply->verb), err, detail) });
}

void answer_fail(struct core *c, const struct reply *reply, enum modal_status status, const char *field, cJSON *detail,
                 const char *format, ...)
{
    struct modal_error err = { .status = status };
    va_list args;

    va_start(args, format);
    vsnprintf(err.message, sizeof err.message, format, args);
    va_end(args);
    snprintf(err.field, sizeof err.field, "%s", field);
    answer_error(c, reply, &err, detail);
}

/* A key whose job is gone.  Until that is committed a restart could bring the job back, so nothing is said yet. */
bool answer_expired(struct core *c, const struct reply *reply, const struct tombstone *stone)
{
    if (stone == NULL)
        return false;
    if (stone->committed)
        answer_fail(c, reply, MODAL_EXPIRED, "key", NULL, "the job of this key is past its retention or was deleted; use a new key");
    else
        answer_fail(c, reply, MODAL_BUSY, "key", answer_number("retry_after_s", 0.05), "the job of this key is being deleted");
    return true;
}

cJSON *answer_number(const char *key, double value)
{
    cJSON *detail = cJSON_CreateObject();

    cJSON_AddNumberToObject(detail, key, value);
    return detail;
}

static void add_time(cJSON *object, const char *key, int64_t utc_ns)
{
    if (utc_ns != 0)
        cJSON_AddNumberToObject(object, key, (double)(utc_ns / 1000000) / 1000);
}

/* How many ready jobs of its user start before it; -1 beyond what is worth counting. */
static int position_of(const struct job *job)
{
    const struct heap *ready = &job->user->ready;
    int ahead = 0;
    int64_t key = job->submitted_ns - job->priority * 60 * SECOND;

    if (ready->count > 1000)
        return -1;
    for (size_t i = 0; i < ready->count; i++)
        ahead += ready->items[i].key < key || (ready->items[i].key == key && ready->items[i].order < job->id);
    return ahead;
}

static void add_failure(cJSON *object, const struct failure *failure)
{
    cJSON *error = cJSON_AddObjectToObject(object, "error");

    cJSON_AddStringToObject(error, "code", modal_status_code(failure->status));
    cJSON_AddStringToObject(error, "message", failure->message);
    if (failure->field != NULL)
        cJSON_AddStringToObject(error, "field", failure->field);
    if (failure->detail != NULL)
        cJSON_AddRawToObject(error, "detail", failure->detail);
}

void doc_write(const struct core *c, cJSON *object, const struct job *job, bool position)
{
    char ident[9];

    job_ident(c, job, ident);
    cJSON_AddStringToObject(object, "job", ident);
    if (job->key != NULL)
        cJSON_AddStringToObject(object, "key", job->key);
    else
        cJSON_AddNullToObject(object, "key");
    cJSON_AddStringToObject(object, "kind", job->kind);
    cJSON_AddStringToObject(object, "state", job_states[job->shown]);
    cJSON_AddNumberToObject(object, "attempts", job->shown_attempts);
    cJSON_AddNumberToObject(object, "priority", job->priority);
    add_time(object, "submitted", job->submitted_ns);
    if (job->shown_attempts > 0 && job->shown != JOB_QUEUED)
        add_time(object, "started", job->started_ns);
    if (job_state_final(job->shown))
        add_time(object, "finished", job->finished_ns);
    if (job->shown == JOB_QUEUED && position) {
        int ahead = position_of(job);
        if (ahead >= 0)
            cJSON_AddNumberToObject(object, "position", ahead);
        else
            cJSON_AddNullToObject(object, "position");
    }
    if (job->shown == JOB_RUNNING && job->progress != NULL)
        cJSON_AddRawToObject(object, "progress", job->progress);
    if (job->cached)
        cJSON_AddTrueToObject(object, "cached");
    if (job->shown == JOB_DONE)
        cJSON_AddNumberToObject(object, "bytes", (double)job->result_bytes);
    if (job->failure != NULL && job_state_final(job->shown))
        add_failure(object, job->failure);
}

void answer_doc(struct core *c, const struct reply *reply, const struct job *job, int duplicate, struct blob *body)
{
    cJSON *header;

    if (reply->peer == 0) {
        blob_drop(body);
        return;
    }
    header = answer_new(reply);
    doc_write(c, header, job, true);
    if (duplicate >= 0)
        cJSON_AddBoolToObject(header, "duplicate", duplicate);
    if (reply->verb == WIRE_DELETE)
        cJSON_AddTrueToObject(header, "deleted");
    answer_send(c, reply, header, body);
}
