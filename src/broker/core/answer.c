/* answer.c - actions, replies, errors and queue documents, as proto/PROTOCOL.md sections 3 and 5 */
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include "broker/core/slots.h"
#include "wire/frame.h"
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

static void answer_text(struct core *c, const struct reply *reply, char *text, struct blob *body)
{
    c->counts.replies++;
    c->counts.bytes_out += (int64_t)(strlen(text) + (body == NULL ? 0 : body->size));
    core_act(c, (struct action) {
        .type = ACT_SEND, .peer = reply->peer, .verb = "REPLY", .header = text, .body = body });
}

void answer_send(struct core *c, const struct reply *reply, cJSON *header, struct blob *body)
{
    char *text = reply->peer == 0 ? NULL : json_print(header);

    cJSON_Delete(header);
    if (text == NULL)
        blob_drop(body);
    else
        answer_text(c, reply, text, body);
}

/* ---- many answers in one --------------------------------------------------------------------- */

struct answers *answers_new(struct core *c, const struct reply *reply, int count)
{
    struct answers *all = grab(sizeof *all + (size_t)count * sizeof *all->parts);

    all->reply = *reply;
    all->count = all->missing = count;
    all->next = c->answers;
    all->link = &c->answers;
    if (all->next != NULL)
        all->next->link = &all->next;
    c->answers = all;
    return all;
}

void answers_free(struct answers *all)
{
    *all->link = all->next;
    if (all->next != NULL)
        all->next->link = all->link;
    for (int i = 0; i < all->count; i++)
        free(all->parts[i]);
    free(all);
}

/* The parts as {"jobs":[...]}, those of pushes as {"parts":[...]}. */
static struct blob *join(const struct answers *all)
{
    struct json_text t = { 0 };
    char *text;

    json_text_open(&t, NULL);
    json_text_key(&t, all->reply.verb == WIRE_SUBMITS ? "jobs" : "parts");
    json_text_raw(&t, "[");
    for (int i = 0; i < all->count; i++) {
        json_text_raw(&t, i > 0 ? "," : "");
        json_text_raw(&t, all->parts[i]);
    }
    json_text_raw(&t, "]");
    text = text_end(&t);
    return blob_take(text, strlen(text));
}

void answer_part(struct core *c, const struct reply *part, char *text)
{
    struct answers *all = part->all;
    cJSON *header;

    all->parts[part->place] = text;
    if (--all->missing > 0)
        return;
    header = answer_new(&all->reply);
    cJSON_AddNumberToObject(header, "count", all->count);
    answer_send(c, &all->reply, header, join(all));
    answers_free(all);
}

/* What was written, closed; out of memory ends the process, as everywhere here. */
char *text_end(struct json_text *t)
{
    json_text_close(t);
    if (t->failed)
        abort();
    return t->x;
}

void answer_error(struct core *c, const struct reply *reply, const struct modal_error *err,
                  cJSON *detail)
{
    if (reply->peer == 0) {
        cJSON_Delete(detail);
        return;
    }
    c->counts.rejects[err->status]++;
    if (reply->all != NULL) {
        answer_part(c, reply, wire_error_part(err, detail));
        return;
    }
    core_act(c, (struct action) { .type = ACT_SEND,
                                 .peer = reply->peer,
                                 .verb = "ERROR",
                                 .header = wire_error_header(reply->id, wire_verb_name(reply->verb),
                                                             err, detail) });
}

void answer_fail(struct core *c, const struct reply *reply, enum modal_status status,
                 const char *field, cJSON *detail, const char *format, ...)
{
    struct modal_error err = { .status = status };
    va_list args;

    va_start(args, format);
    vsnprintf(err.message, sizeof err.message, format, args);
    va_end(args);
    snprintf(err.field, sizeof err.field, "%s", field);
    answer_error(c, reply, &err, detail);
}

/* A key whose job is gone.  Until that is committed a restart could bring the job back, so nothing
 * is said yet. */
bool answer_expired(struct core *c, const struct reply *reply, const struct tombstone *stone)
{
    if (stone == NULL)
        return false;
    if (stone->committed)
        answer_fail(c, reply, MODAL_EXPIRED, "key", NULL,
                    "the job of this key is past its retention or was deleted; use a new key");
    else
        answer_fail(c, reply, MODAL_BUSY, "key", answer_number("retry_after_s", 0.05),
                    "the job of this key is being deleted");
    return true;
}

cJSON *answer_number(const char *key, double value)
{
    cJSON *detail = cJSON_CreateObject();

    cJSON_AddNumberToObject(detail, key, value);
    return detail;
}

static void add_time(struct json_text *t, const char *key, int64_t utc_ns)
{
    if (utc_ns != 0)
        json_text_number(t, key, (double)(utc_ns / 1000000) / 1000);
}

enum { COUNTED_MOST = 1000 };    /* ready jobs that a doc's position walks over */

/* How many ready jobs of its user start before it; -1 beyond what is worth counting. */
static int position_of(const struct job *job)
{
    const struct heap *ready = &job->user->ready;
    int ahead = 0;
    int64_t key = job->submitted_ns - job->priority * 60 * SECOND;

    if (ready->count > COUNTED_MOST)
        return -1;
    for (size_t i = 0; i < ready->count; i++)
        ahead += ready->items[i].key < key
                 || (ready->items[i].key == key && ready->items[i].order < job->id);
    return ahead;
}

static void add_failure(struct json_text *t, const struct failure *failure)
{
    json_text_open(t, "error");
    json_text_string(t, "code", modal_status_code(failure->status));
    json_text_string(t, "message", failure->message);
    if (failure->field != NULL)
        json_text_string(t, "field", failure->field);
    if (failure->detail != NULL) {
        json_text_key(t, "detail");
        json_text_raw(t, failure->detail);
    }
    json_text_close(t);
}

static void add_position(struct json_text *t, const struct job *job)
{
    int ahead = position_of(job);

    if (ahead >= 0)
        json_text_number(t, "position", ahead);
    else
        json_text_string(t, "position", NULL);
}

/* Who has a running job, and where. */
static void add_worker(const struct core *c, struct json_text *t, int slot)
{
    const struct remote *remote = c->slots->at[slot].remote;
    char name[NAME_MOST];

    snprintf(name, sizeof name, "local.%d", slot);
    json_text_open(t, "worker");
    json_text_string(t, "name", remote != NULL ? remote->name : name);
    json_text_string(t, "node", remote != NULL ? remote->node : c->settings.node);
    json_text_close(t);
}

void doc_write(const struct core *c, struct json_text *t, const struct job *job, bool position)
{
    char ident[9];

    job_ident(c, job, ident);
    json_text_string(t, "job", ident);
    json_text_string(t, "key", job->key);
    json_text_string(t, "kind", job->kind);
    json_text_string(t, "state", job_states[job->shown]);
    json_text_number(t, "attempts", job->shown_attempts);
    json_text_number(t, "priority", job->priority);
    add_time(t, "submitted", job->submitted_ns);
    if (job->shown_attempts > 0 && job->shown != JOB_QUEUED)
        add_time(t, "started", job->started_ns);
    if (job_state_final(job->shown))
        add_time(t, "finished", job->finished_ns);
    if (job->shown == JOB_QUEUED && position)
        add_position(t, job);
    if (job->shown == JOB_RUNNING && job->slot >= 0)
        add_worker(c, t, job->slot);
    if (job->shown == JOB_RUNNING && job->progress != NULL) {
        json_text_key(t, "progress");
        json_text_raw(t, job->progress);
    }
    if (job->cached)
        json_text_bool(t, "cached", true);
    if (job->shown == JOB_DONE)
        json_text_number(t, "bytes", (double)job->result_bytes);
    if (job->failure != NULL && job_state_final(job->shown))
        add_failure(t, job->failure);
}

/* Written without a tree: the answer that is given most often. */
void answer_doc(struct core *c, const struct reply *reply, const struct job *job, int duplicate,
                struct blob *body)
{
    struct json_text t = { 0 };

    if (reply->peer == 0) {
        blob_drop(body);
        return;
    }
    json_text_open(&t, NULL);
    if (reply->all == NULL) {
        json_text_key(&t, "id");
        json_text_raw(&t, reply->id);
        json_text_string(&t, "verb", wire_verb_name(reply->verb));
    }
    doc_write(c, &t, job, true);
    if (duplicate >= 0)
        json_text_bool(&t, "duplicate", duplicate);
    if (reply->verb == WIRE_DELETE)
        json_text_bool(&t, "deleted", true);
    if (reply->all != NULL)
        answer_part(c, reply, text_end(&t));
    else
        answer_text(c, reply, text_end(&t), body);
}
