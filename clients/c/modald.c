/* modald.c - see modald.h; text at this face, cJSON behind it */
#include "modald.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include "base/sha256.h"
#include "client.h"
#include "store/identity.h"

struct modald { struct link *link; };

/* The end of each call: STATUS and what it says into ERROR. */
static int ended(enum modal_status rc, const struct modal_error *err, cJSON *detail,
                 struct modald_error *error)
{
    const cJSON *retry = cJSON_GetObjectItemCaseSensitive(detail, "retry_after_s");

    if (error != NULL && rc != MODAL_OK) {
        snprintf(error->code, sizeof error->code, "%s", modal_status_code(rc));
        snprintf(error->field, sizeof error->field, "%s", err->field);
        snprintf(error->message, sizeof error->message, "%s", err->message);
        error->retry_after = cJSON_IsNumber(retry) ? retry->valuedouble : 0;
    }
    cJSON_Delete(detail);
    return modal_status_exit(rc);
}

static double deadline_of(double timeout)
{
    return timeout >= 0 ? link_now() + timeout : INFINITY;
}

static enum modal_status print_into(const cJSON *doc, char **out, struct modal_error *err)
{
    if (out == NULL)
        return MODAL_OK;
    *out = json_print(doc);
    return *out ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "no memory for a document");
}

int modald_connect(const char *endpoint, const char *keyfile, struct modald **out,
                   struct modald_error *error)
{
    struct modald *connection = calloc(1, sizeof *connection);
    struct modal_error err = { 0 };
    enum modal_status rc = connection ? link_open(endpoint, keyfile, &connection->link, &err)
                                      : modal_fail(&err, MODAL_NO_MEMORY, "no memory");

    if (rc == MODAL_OK)
        *out = connection;
    else
        free(connection);
    return ended(rc, &err, NULL, error);
}

void modald_disconnect(struct modald *connection)
{
    if (connection != NULL)
        link_close(connection->link);
    free(connection);
}

static struct batch batch_of(const struct modald_batch *b)
{
    return (struct batch) { .samples = b->samples,
                            .channels = b->channels,
                            .signals = b->signals,
                            .dt = b->dt,
                            .period = b->period,
                            .names = b->names,
                            .units = b->units };
}

static enum modal_status submit(struct modald *connection, const struct modald_job *job,
                                const struct client_input *input, const char *key, double deadline,
                                cJSON **doc, cJSON **detail, struct modal_error *err)
{
    struct client_job ask = { .kind = job->kind ? job->kind : "identify",
                              .key = key,
                              .priority = job->priority > 0 ? job->priority : -1,
                              .run_limit = job->run_limit,
                              .deadline = job->deadline };
    cJSON *options = NULL;
    enum modal_status rc = MODAL_OK;

    if (job->options != NULL)
        rc = json_read(job->options, strlen(job->options), &options, err);
    if (rc == MODAL_OK && options != NULL && !cJSON_IsObject(options))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "options", "options must be a JSON object");
    ask.options = options;
    if (rc == MODAL_OK)
        rc = client_submit(connection->link, &ask, input, NULL, deadline, doc, detail, err);
    cJSON_Delete(options);
    return rc;
}

static int submit_and_print(struct modald *connection, const struct modald_job *job,
                            const struct client_input *input, double timeout, char **document,
                            struct modald_error *error)
{
    struct modal_error err = { 0 };
    cJSON *doc = NULL, *detail = NULL;
    enum modal_status rc = submit(connection, job, input, job->key, deadline_of(timeout), &doc,
                                  &detail, &err);

    if (rc == MODAL_OK)
        rc = print_into(doc, document, &err);
    cJSON_Delete(doc);
    return ended(rc, &err, detail, error);
}

int modald_submit(struct modald *connection, const struct modald_job *job,
                  const struct modald_batch *batch, double timeout, char **document,
                  struct modald_error *error)
{
    struct batch b = batch_of(batch);

    return submit_and_print(connection, job, &(struct client_input) { .batch = &b }, timeout,
                            document, error);
}

int modald_submit_scene(struct modald *connection, const struct modald_job *job, const char *scene,
                        double timeout, char **document, struct modald_error *error)
{
    return submit_and_print(connection, job, &(struct client_input) { .scene = scene }, timeout,
                            document, error);
}

int modald_upload(struct modald *connection, const struct modald_batch *batch, double timeout,
                  char sha256[65], struct modald_error *error)
{
    struct batch b = batch_of(batch);
    struct input_shape shape = { .type = INPUT_BATCH,
                                 .samples = b.samples,
                                 .channels = b.channels,
                                 .dt = b.dt,
                                 .period = b.period,
                                 .units = b.units,
                                 .names = b.names };
    struct client_input input = { .batch = &b, .sha256 = sha256 };
    struct modal_error err = { 0 };
    cJSON *detail = NULL;
    uint8_t digest[32];
    char id[128];
    enum modal_status rc;

    identity_of(&shape, b.signals, b.samples * b.channels * sizeof(double), digest);
    sha256_hex(digest, sha256);
    rc = client_upload(connection->link, &input, NULL, deadline_of(timeout), id, &detail, &err);
    return ended(rc, &err, detail, error);
}

static int ask_about(struct modald *connection, const char *verb, const char *job, double timeout,
                     char **document, struct modald_error *error)
{
    struct modal_error err = { 0 };
    cJSON *doc = NULL, *detail = NULL;
    enum modal_status rc = client_do(connection->link, verb, job, deadline_of(timeout), &doc,
                                     &detail, &err);

    if (rc == MODAL_OK)
        rc = print_into(doc, document, &err);
    cJSON_Delete(doc);
    return ended(rc, &err, detail, error);
}

int modald_status(struct modald *connection, const char *job, double timeout, char **document,
                  struct modald_error *error)
{
    return ask_about(connection, "STATUS", job, timeout, document, error);
}

int modald_cancel(struct modald *connection, const char *job, double timeout, char **document,
                  struct modald_error *error)
{
    return ask_about(connection, "CANCEL", job, timeout, document, error);
}

/* How an ended job ended, as a status. */
static enum modal_status outcome(const cJSON *doc, cJSON **detail, struct modal_error *err)
{
    const char *state = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(doc, "state"));
    struct link_message as_error = { .header = (cJSON *)doc };

    if (state != NULL && strcmp(state, "done") == 0)
        return MODAL_OK;
    if (cJSON_IsObject(cJSON_GetObjectItemCaseSensitive(doc, "error")))
        return link_error(&as_error, detail, err);
    return modal_fail(err, MODAL_CANCELLED, "the job is %s", state ? state : "in no state");
}

int modald_wait(struct modald *connection, const char *job, double timeout, char **document,
                struct modald_error *error)
{
    struct modal_error err = { 0 };
    cJSON *doc = NULL, *detail = NULL;
    enum modal_status rc = client_wait(connection->link, job, NULL, deadline_of(timeout), &doc,
                                       &detail, &err);

    if (rc == MODAL_OK)
        rc = outcome(doc, &detail, &err);
    if (doc != NULL && print_into(doc, document, &err) != MODAL_OK)
        rc = MODAL_NO_MEMORY;
    cJSON_Delete(doc);
    return ended(rc, &err, detail, error);
}

int modald_result(struct modald *connection, const char *job, double timeout, char **result,
                  struct modald_error *error)
{
    struct modal_error err = { 0 };
    cJSON *detail = NULL;
    size_t length;
    enum modal_status rc = client_result(connection->link, job, "document", deadline_of(timeout),
                                         result, &length, NULL, &detail, &err);

    return ended(rc, &err, detail, error);
}

/* A key of our own makes the submission safe to repeat after a lost connection. */
static void make_key(char key[40])
{
    unsigned char bytes[16] = { 0 };

    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes)
        memcpy(bytes, &(double) { link_now() }, sizeof(double));
    memcpy(key, "run-", 5);
    for (size_t i = 0; i < sizeof bytes; i++)
        snprintf(key + 4 + 2 * i, 3, "%02x", bytes[i]);
}

int modald_run(struct modald *connection, const struct modald_job *job,
               const struct modald_batch *batch, double timeout, char **result,
               struct modald_error *error)
{
    struct batch b = batch_of(batch);
    struct modal_error err = { 0 };
    cJSON *doc = NULL, *end = NULL, *detail = NULL;
    double deadline = deadline_of(timeout);
    char key[40];
    size_t length;
    enum modal_status rc;

    make_key(key);
    rc = submit(connection, job, &(struct client_input) { .batch = &b }, job->key ? job->key : key,
                deadline, &doc, &detail, &err);
    const char *id = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(doc, "job"));
    if (rc == MODAL_OK)
        rc = client_wait(connection->link, id ? id : "", NULL, deadline, &end, &detail, &err);
    if (rc == MODAL_OK)
        rc = outcome(end, &detail, &err);
    if (rc == MODAL_OK)
        rc = client_result(connection->link, id, "document", deadline, result, &length, NULL,
                           &detail, &err);
    cJSON_Delete(doc);
    cJSON_Delete(end);
    return ended(rc, &err, detail, error);
}

int modald_job_id(const char *document, char *id, size_t size)
{
    cJSON *doc = NULL;
    const char *job;

    if (document == NULL || json_read(document, strlen(document), &doc, NULL) != MODAL_OK)
        return MODALD_BAD_INPUT;
    job = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(doc, "job"));
    bool fits = job != NULL && strlen(job) < size;
    if (fits)
        memcpy(id, job, strlen(job) + 1);
    cJSON_Delete(doc);
    return fits ? MODALD_DONE : MODALD_BAD_INPUT;
}

void modald_free(char *text)
{
    free(text);
}
