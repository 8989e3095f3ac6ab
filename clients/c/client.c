/* client.c - see client.h */
#include "client.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "base/crc32c.h"
#include "base/sha256.h"
#include "store/identity.h"
#include "wire/protocol.h"
#include "wire/request.h"

static const double wait_slice = 20, watched_slice = 0.5;    /* s of one WAIT */
static const double chunk_patience = 10;                     /* s without an answer to any chunk */

static double number(const cJSON *object, const char *key, double otherwise)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);

    return cJSON_IsNumber(item) ? item->valuedouble : otherwise;
}

/* A whole number that fits; OTHERWISE where OBJECT says none. */
static size_t count(const cJSON *object, const char *key, size_t otherwise)
{
    double n = number(object, key, -1);

    return n >= 0 && n <= (double)WIRE_INTEGER_MOST ? (size_t)n : otherwise;
}

static const char *text(const cJSON *object, const char *key)
{
    const char *s = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, key));

    return s ? s : "";
}

static void report(const struct client_progress *progress, const char *what, double fraction)
{
    if (progress != NULL && progress->tell != NULL)
        progress->tell(progress->context, what, fraction);
}

const void *client_input_bytes(const struct client_input *input, size_t *length)
{
    *length = input->upload  ? 0
              : input->batch ? input->batch->samples * input->batch->channels * sizeof(double)
                             : input->scene_length > 0 ? input->scene_length
                                                       : strlen(input->scene);
    return input->batch ? (const void *)input->batch->signals : input->scene;
}

/* The description of section 4, UPLOAD, into HEADER. */
static void describe(cJSON *header, const struct client_input *input)
{
    const struct batch *b = input->batch;
    struct wire_input w = { .content = WIRE_SCENE };
    cJSON *names = b && b->names
                     ? cJSON_CreateStringArray((const char **)b->names, (int)b->channels)
                     : NULL;

    if (b != NULL)
        w = (struct wire_input) { .content = WIRE_BATCH,
                                  .samples = b->samples,
                                  .channels = b->channels,
                                  .dt = b->dt,
                                  .period = b->period,
                                  .names = names,
                                  .units = b->units && b->units[0] ? b->units : NULL,
                                  .attributes = input->attributes };
    client_input_bytes(input, &w.bytes);
    if (b == NULL && input->upload == NULL)
        w.arrays = w.bytes - strlen(input->scene);
    wire_input_write(header, &w);
    if (b != NULL && b->names != NULL && names == NULL)
        json_put(header, "names", NULL);
    cJSON_Delete(names);
}

static void identity(const struct client_input *input, char sha256[65])
{
    struct input_shape shape = { .type = INPUT_SCENE };
    uint8_t digest[32];
    size_t length;
    const void *bytes = client_input_bytes(input, &length);

    if (input->sha256 != NULL) {
        snprintf(sha256, 65, "%s", input->sha256);
        return;
    }
    shape.length = length;
    if (input->batch != NULL)
        shape = (struct input_shape) { .type = INPUT_BATCH,
                                       .samples = input->batch->samples,
                                       .channels = input->batch->channels,
                                       .dt = input->batch->dt,
                                       .period = input->batch->period,
                                       .units = input->batch->units,
                                       .names = input->batch->names };
    identity_of(&shape, bytes, length, digest);
    sha256_hex(digest, sha256);
}

struct upload {
    char id[128];
    size_t total, present, credit;
    bool sealed;
};

static void take_upload(const cJSON *answer, struct upload *up)
{
    if (text(answer, "upload")[0] != 0)
        snprintf(up->id, sizeof up->id, "%s", text(answer, "upload"));
    up->present = count(answer, "present", up->present);
    up->credit = count(answer, "credit", up->credit);
    up->sealed = strcmp(text(answer, "state"), "sealed") == 0;
}

static cJSON *upload_header(const char *op, const char *id)
{
    cJSON *header = cJSON_CreateObject();

    json_put_string(header, "op", op);
    if (id != NULL)
        json_put_string(header, "upload", id);
    return header;
}

static enum modal_status begin(struct link *link, const struct client_input *input,
                               const char *sha256, double deadline, struct upload *up,
                               cJSON **detail, struct modal_error *err)
{
    cJSON *header = upload_header("begin", NULL), *answer = NULL;
    enum modal_status rc;

    json_put_string(header, "sha256", sha256);
    describe(header, input);
    rc = client_ask(link, "UPLOAD", header, deadline, &answer, NULL, detail, err);
    if (rc == MODAL_OK)
        take_upload(answer, up);
    cJSON_Delete(answer);
    return rc;
}

static enum modal_status send_chunk(struct link *link, const struct upload *up, size_t offset,
                                    const char *data, size_t length, double deadline,
                                    struct modal_error *err)
{
    cJSON *header = upload_header("chunk", up->id);
    int64_t id;

    json_put_number(header, "offset", (double)offset);
    json_put_number(header, "crc32c", crc32c(0, data, length));
    return link_send(
        link,
        &(struct link_ask) { .verb = "UPLOAD", .header = header, .body = data, .length = length },
        deadline, &id, err);
}

/* One message about our chunks into UP.  MODAL_NO_SERVER, MODAL_BUSY: begin again. */
static enum modal_status read_answer(struct link *link, struct upload *up, double deadline,
                                     cJSON **detail, struct modal_error *err)
{
    struct link_message message;
    enum modal_status rc = link_receive(link, fmin(deadline, link_now() + chunk_patience), &message,
                                        err);

    if (rc == MODAL_TIMEOUT && link_now() < deadline)
        return MODAL_NO_SERVER;
    if (rc != MODAL_OK)
        return rc;
    if (message.type == LINK_REPLY && strcmp(text(message.header, "upload"), up->id) == 0)
        take_upload(message.header, up);
    else if (message.type == LINK_ERROR && strcmp(text(message.header, "verb"), "UPLOAD") == 0)
        rc = link_error(&message, detail, err);
    link_message_done(&message);
    return rc;
}

/* Chunks from what is present to the end, as far ahead as the credit lets us. */
static enum modal_status send_chunks(struct link *link, const char *bytes, struct upload *up,
                                     const struct client_progress *progress, double deadline,
                                     cJSON **detail, struct modal_error *err)
{
    size_t sent = up->present;
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && up->present < up->total) {
        while (rc == MODAL_OK && sent < up->total) {
            size_t length = up->total - sent < WIRE_CHUNK_MOST ? up->total - sent : WIRE_CHUNK_MOST;
            if (sent > up->present && sent + length - up->present > up->credit)
                break;
            rc = send_chunk(link, up, sent, bytes + sent, length, deadline, err);
            sent += length;
        }
        if (rc == MODAL_OK)
            rc = read_answer(link, up, deadline, detail, err);
        report(progress, "upload", (double)up->present / (double)up->total);
    }
    return rc;
}

double client_pause(const cJSON *detail)
{
    return fmin(fmax(number(detail, "retry_after_s", 0.2), 0.01), 5);
}

static void sleep_as_told(const cJSON *detail)
{
    double s = client_pause(detail);
    struct timespec t = { (time_t)s, (long)(1e9 * (s - floor(s))) };

    nanosleep(&t, NULL);
}

static enum modal_status seal(struct link *link, const char *sha256, struct upload *up,
                              double deadline, cJSON **detail, struct modal_error *err)
{
    cJSON *header = upload_header("seal", up->id), *answer = NULL;

    json_put_string(header, "sha256", sha256);
    enum modal_status rc = client_ask(link, "UPLOAD", header, deadline, &answer, NULL, detail, err);
    cJSON_Delete(answer);
    return rc;
}

enum modal_status client_upload(struct link *link, const struct client_input *input,
                                const struct client_progress *progress, double deadline,
                                char id[128], cJSON **detail, struct modal_error *err)
{
    struct upload up = { 0 };
    const char *bytes = client_input_bytes(input, &up.total);
    char sha256[65];
    cJSON *why = NULL;
    enum modal_status rc = MODAL_OK;

    identity(input, sha256);
    while (rc == MODAL_OK) {
        rc = begin(link, input, sha256, deadline, &up, &why, err);
        if (rc == MODAL_OK && !up.sealed)
            rc = send_chunks(link, bytes, &up, progress, deadline, &why, err);
        if (rc == MODAL_OK)
            break;
        if ((rc != MODAL_BUSY && rc != MODAL_NO_SERVER) || link_now() >= deadline
            || link_lost(link))
            break;
        sleep_as_told(why);
        cJSON_Delete(why);
        why = NULL;
        rc = MODAL_OK;
    }
    if (rc == MODAL_OK && !up.sealed)
        rc = seal(link, sha256, &up, deadline, &why, err);
    if (rc == MODAL_OK)
        memcpy(id, up.id, sizeof up.id);
    if (detail != NULL && why != NULL)
        *detail = why;
    else
        cJSON_Delete(why);
    return rc;
}

cJSON *client_submit_header(const struct client_job *job, const struct client_input *input,
                            const char *upload)
{
    cJSON *header = cJSON_CreateObject(), *in = cJSON_CreateObject();

    json_put_string(header, "kind", job->kind);
    if (job->options != NULL && job->options->child != NULL)
        json_put(header, "options", cJSON_Duplicate(job->options, true));
    if (upload != NULL)
        json_put_string(in, "upload", upload);
    else if (input->upload != NULL)
        json_put_string(in, "upload", input->upload);
    else if (input->batch != NULL)
        describe(in, input);
    else
        json_put_string(in, "content", "scene");
    json_put(header, "input", in);
    if (job->key != NULL)
        json_put_string(header, "key", job->key);
    if (job->priority >= 0)
        json_put_number(header, "priority", job->priority);
    if (job->run_limit > 0)
        json_put_number(header, "run_limit_s", job->run_limit);
    if (job->deadline > 0)
        json_put_number(header, "deadline_s", job->deadline);
    if (job->fresh)
        json_put(header, "fresh", cJSON_CreateTrue());
    return header;
}

/* The answer's header as a document: without what belongs to the message. */
static cJSON *document(struct link_message *message)
{
    cJSON *doc = message->header;

    message->header = NULL;
    cJSON_DeleteItemFromObjectCaseSensitive(doc, "id");
    cJSON_DeleteItemFromObjectCaseSensitive(doc, "verb");
    return doc;
}

enum modal_status client_submit(struct link *link, const struct client_job *job,
                                const struct client_input *input,
                                const struct client_progress *progress, double deadline,
                                cJSON **doc, cJSON **detail, struct modal_error *err)
{
    struct link_ask ask = { .verb = "SUBMIT", .once = job->key == NULL };
    struct link_message answer;
    char upload[128];
    const void *bytes = client_input_bytes(input, &ask.length);
    bool small = ask.length <= WIRE_INLINE_MOST;
    enum modal_status rc = small
                             ? MODAL_OK
                             : client_upload(link, input, progress, deadline, upload, detail, err);

    if (rc != MODAL_OK)
        return rc;
    ask.header = client_submit_header(job, input, small ? NULL : upload);
    ask.body = small ? bytes : NULL;
    rc = link_question(link, &ask, deadline, &answer, detail, err);
    if (rc != MODAL_OK)
        return rc;
    if (text(answer.header, "job")[0] == 0)
        rc = modal_fail(err, MODAL_BAD_FRAME, "the daemon's answer to SUBMIT names no job");
    else
        *doc = document(&answer);
    link_message_done(&answer);
    return rc;
}

enum modal_status client_ask(struct link *link, const char *verb, cJSON *header, double deadline,
                             cJSON **answer, char **body, cJSON **detail, struct modal_error *err)
{
    struct link_message message;
    enum modal_status rc = link_question(link,
                                         &(struct link_ask) { .verb = verb, .header = header },
                                         deadline, &message, detail, err);

    if (rc != MODAL_OK)
        return rc;
    *answer = document(&message);
    if (body != NULL) {
        *body = message.body;
        message.body = NULL;
    }
    link_message_done(&message);
    return MODAL_OK;
}

static cJSON *job_header(const char *job)
{
    cJSON *header = cJSON_CreateObject();

    json_put_string(header, "job", job);
    return header;
}

enum modal_status client_do(struct link *link, const char *verb, const char *job, double deadline,
                            cJSON **doc, cJSON **detail, struct modal_error *err)
{
    return client_ask(link, verb, job_header(job), deadline, doc, NULL, detail, err);
}

bool client_ended(const cJSON *doc)
{
    static const char *const ends[] = { "done", "failed", "cancelled", "dead" };

    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++)
        if (strcmp(text(doc, "state"), ends[i]) == 0)
            return true;
    return false;
}

/* One WAIT of at most SLICE seconds. */
static enum modal_status wait_once(struct link *link, const char *job, double slice,
                                   double deadline, cJSON **doc, cJSON **detail,
                                   struct modal_error *err)
{
    struct link_ask ask = { .verb = "WAIT", .header = job_header(job), .patience = slice + 5 };
    struct link_message answer;
    enum modal_status rc;

    json_put_number(ask.header, "timeout_s", fmax(0, fmin(slice, deadline - link_now())));
    /* the daemon's timer ends first */
    rc = link_question(link, &ask, deadline + 1, &answer, detail, err);
    if (rc != MODAL_OK)
        return rc;
    cJSON_Delete(*doc);
    *doc = document(&answer);
    link_message_done(&answer);
    return MODAL_OK;
}

enum modal_status client_wait(struct link *link, const char *job,
                              const struct client_progress *progress, double deadline, cJSON **doc,
                              cJSON **detail, struct modal_error *err)
{
    double slice = progress != NULL && progress->tell != NULL ? watched_slice : wait_slice;
    enum modal_status rc;

    *doc = NULL;
    for (;;) {
        rc = wait_once(link, job, slice, deadline, doc, detail, err);
        if (rc != MODAL_OK || client_ended(*doc))
            return rc;
        report(progress, text(*doc, "state"),
             number(cJSON_GetObjectItemCaseSensitive(*doc, "progress"), "fraction", 0));
        if (link_now() >= deadline)
            return modal_fail(err, MODAL_TIMEOUT, "job %.64s is %s; not finished in time", job,
                              text(*doc, "state"));
    }
}

/* Bytes of WHAT (members of RESULT) from OFFSET on, up to one frame of them. */
static enum modal_status fetch(struct link *link, const cJSON *what, size_t offset,
                               double deadline, struct link_message *answer, cJSON **detail,
                               struct modal_error *err)
{
    cJSON *header = cJSON_Duplicate(what, true);

    json_put_number(header, "offset", (double)offset);
    return link_question(link, &(struct link_ask) { .verb = "RESULT", .header = header }, deadline,
                         answer, detail, err);
}

/* What has come of a part of a result: ALL has room for TOTAL bytes, MOST at most, and a zero
 * behind them, once the first answer has said how many these are. */
struct parts { char *all; size_t used, total, most; };

/* The bytes of ANSWER, which follow those before. */
static enum modal_status add_part(struct parts *parts, const struct link_message *answer,
                                  struct modal_error *err)
{
    const size_t total = count(answer->header, "total", SIZE_MAX);

    if (parts->all == NULL) {
        parts->total = total;
        if (total <= parts->most && (parts->all = malloc(total + 1)) == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "no memory for %zu bytes of a result", total);
    }
    if (parts->all == NULL || total != parts->total || answer->length > total - parts->used
        || (answer->length == 0 && total > 0))
        return modal_fail(err, MODAL_BAD_FRAME,
                          "the daemon's answer to RESULT has %zu bytes at %zu of %zu, which were "
                          "%zu before", answer->length, parts->used, total, parts->total);
    memcpy(parts->all + parts->used, answer->body ? answer->body : "", answer->length);
    parts->used += answer->length;
    return MODAL_OK;
}

/* All of WHAT, which is deleted. */
static enum modal_status fetch_all(struct link *link, cJSON *what, double deadline, char **bytes,
                                   size_t *length, cJSON **description, cJSON **detail,
                                   struct modal_error *err)
{
    struct parts parts = { .total = 1,          /* only signals are described */
                           .most = description != NULL ? SIZE_MAX - 1 : WIRE_DOCUMENT_MOST };
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && parts.used < parts.total) {
        struct link_message answer;
        rc = fetch(link, what, parts.used, deadline, &answer, detail, err);
        if (rc != MODAL_OK)
            break;
        rc = add_part(&parts, &answer, err);
        if (rc == MODAL_OK && description != NULL && *description == NULL)
            *description = cJSON_DetachItemFromObjectCaseSensitive(answer.header, "batch");
        link_message_done(&answer);
    }
    cJSON_Delete(what);
    if (rc != MODAL_OK) {
        free(parts.all);
        return rc;
    }
    parts.all[parts.total] = 0;
    *bytes = parts.all;
    *length = parts.total;
    return MODAL_OK;
}

enum modal_status client_result(struct link *link, const char *job, const char *part,
                                double deadline, char **bytes, size_t *length, cJSON **description,
                                cJSON **detail, struct modal_error *err)
{
    cJSON *what = job_header(job);

    json_put_string(what, "part", part);
    return fetch_all(link, what, deadline, bytes, length, description, detail, err);
}

enum modal_status client_stored(struct link *link, const char *upload, double deadline,
                                char **bytes, size_t *length, cJSON **description, cJSON **detail,
                                struct modal_error *err)
{
    cJSON *what = cJSON_CreateObject();

    json_put_string(what, "upload", upload);
    json_put_string(what, "part", "input");
    return fetch_all(link, what, deadline, bytes, length, description, detail, err);
}
