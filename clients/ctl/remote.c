/* remote.c - see remote.h */
#include "remote.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>
#include "progress.h"

enum modal_status remote_open(const struct args *args, struct link **out, struct modal_error *err)
{
    return link_open(args->server, args->keyfile, out, err);
}

double remote_deadline(const struct args *args)
{
    return args->timeout >= 0 ? link_now() + args->timeout : INFINITY;
}

double remote_answer_by(double deadline)
{
    return fmax(deadline, link_now() + REMOTE_ANSWER_S);
}

static void print_progress(void *context, const char *what, double fraction)
{
    (void)context;
    progress_tell(what, fraction);
}

const struct client_progress *remote_progress(void)
{
    static const struct client_progress shown = { print_progress, NULL };

    return &shown;
}

struct client_input remote_input(const struct input *input)
{
    return (struct client_input){ .batch = input->scene || input->stored[0] ? NULL : &input->batch,
                                  .attributes = input->signals.attributes,
                                  .scene = input->scene_text,
                                  .scene_length = input->scene_length, .sha256 = input->sha256,
                                  .upload = input->stored[0] ? input->stored : NULL };
}

struct client_job remote_job(const struct input *input, const struct args *args, const char *key)
{
    return (struct client_job){ .kind = input->kind->name, .options = input->options,
                                .key = key ? key : args->key, .priority = args->priority,
                                .run_limit = args->run_limit, .deadline = args->deadline };
}

static const char *state_of(const cJSON *doc)
{
    const char *state = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(doc, "state"));

    return state ? state : "";
}

enum modal_status remote_job_error(const cJSON *doc, cJSON **detail, struct modal_error *err)
{
    struct link_message as_error = { .header = (cJSON *)doc };

    if (strcmp(state_of(doc), "done") == 0)
        return MODAL_OK;
    if (cJSON_IsObject(cJSON_GetObjectItemCaseSensitive(doc, "error")))
        return link_error(&as_error, detail, err);
    return modal_fail(err,
                      strcmp(state_of(doc), "cancelled") == 0 ? MODAL_CANCELLED : MODAL_INTERNAL,
                      "the job is %s", state_of(doc));
}

static const char *job_of(const cJSON *doc)
{
    const char *job = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(doc, "job"));

    return job ? job : "";
}

/* The result document of JOB, read strictly. */
static enum modal_status fetch_document(struct link *link, const char *job, double deadline,
                                        cJSON **out, cJSON **detail, struct modal_error *err)
{
    char *text = NULL;
    size_t length = 0;
    enum modal_status rc = client_result(link, job, "document", deadline, &text, &length, NULL,
                                         detail, err);

    if (rc == MODAL_OK)
        rc = json_read(text, length, out, err);
    free(text);
    return rc;
}

enum modal_status remote_add_result(struct link *link, cJSON *doc, double deadline, cJSON **detail,
                                    struct modal_error *err)
{
    cJSON *result = NULL;
    enum modal_status rc = fetch_document(link, job_of(doc), deadline, &result, detail, err);

    if (rc == MODAL_OK)
        cJSON_AddItemToObject(doc, "result", result);
    return rc;
}

/* Samples, channels, dt, names of a description into OUT; they must fit LENGTH bytes. */
static enum modal_status read_description(const cJSON *description, size_t length,
                                          struct job_result *out, struct modal_error *err)
{
    double samples = 0, channels = 0, dt = 0, period = 0;
    const cJSON *names = cJSON_GetObjectItemCaseSensitive(description, "names");
    enum modal_status rc = json_need_number(description, "batch", "samples", 1, 1e15, &samples,
                                            err);

    if (rc == MODAL_OK)
        rc = json_need_number(description, "batch", "channels", 1, 1e15, &channels, err);
    if (rc == MODAL_OK)
        rc = json_need_number(description, "batch", "dt", 0, HUGE_VAL, &dt, err);
    if (rc == MODAL_OK)
        rc = json_get_number(description, "batch", "period", 0, HUGE_VAL, &period, err);
    if (rc != MODAL_OK)
        return rc;
    if (samples * channels * sizeof(double) != (double)length)
        return modal_fail(err, MODAL_BAD_FRAME, "%g x %g signals in %zu bytes", samples, channels,
                          length);
    out->batch = (struct batch){
        .samples = (size_t)samples, .channels = (size_t)channels, .dt = dt, .period = period
    };
    if (cJSON_GetArraySize(names) != (int)channels
        || (out->names = calloc((size_t)channels, sizeof *out->names)) == NULL)
        return MODAL_OK;
    for (int i = 0; i < (int)channels; i++) {
        const char *name = cJSON_GetStringValue(cJSON_GetArrayItem(names, i));
        out->names[i] = strdup(name ? name : "");
    }
    out->batch.names = (const char *const *)out->names;
    return MODAL_OK;
}

enum modal_status remote_batch(const cJSON *description, char **bytes, size_t length,
                               struct job_result *out, struct modal_error *err)
{
    enum modal_status rc = read_description(description, length, out, err);

    if (rc != MODAL_OK)
        return rc;
    out->signals = (double *)(void *)*bytes;            /* malloc'ed: aligned */
    out->batch.signals = out->signals;
    *bytes = NULL;
    return MODAL_OK;
}

enum modal_status remote_signals(struct link *link, const char *job, double deadline,
                                 struct job_result *out, cJSON **detail, struct modal_error *err)
{
    cJSON *description = NULL;
    char *bytes = NULL;
    size_t length = 0;
    enum modal_status rc = client_result(link, job, "batch", deadline, &bytes, &length,
                                         &description, detail, err);

    if (rc == MODAL_OK)
        rc = remote_batch(description, &bytes, length, out, err);
    free(bytes);
    cJSON_Delete(description);
    return rc;
}

/* Ours alone: so that the submission may be repeated after a lost connection. */
static void make_key(char key[48])
{
    unsigned char bytes[16];

    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes)
        memset(bytes, (int)getpid(), sizeof bytes);
    memcpy(key, "modalctl-", 10);
    for (size_t i = 0; i < sizeof bytes; i++)
        snprintf(key + 9 + 2 * i, 3, "%02x", bytes[i]);
}

enum modal_status remote_run(const struct input *input, const struct args *args,
                             struct job_result *out, cJSON **detail, struct modal_error *err)
{
    struct client_input in = remote_input(input);
    struct link *link = NULL;
    cJSON *doc = NULL, *ended = NULL;
    char key[48];
    double deadline = remote_deadline(args);
    enum modal_status rc = remote_open(args, &link, err);

    make_key(key);
    struct client_job job = remote_job(input, args, args->key ? NULL : key);
    if (rc == MODAL_OK)
        rc = client_submit(link, &job, &in, remote_progress(), remote_answer_by(deadline), &doc,
                           detail, err);
    if (rc == MODAL_OK)
        rc = client_wait(link, job_of(doc), remote_progress(), deadline, &ended, detail, err);
    progress_end();
    if (rc == MODAL_OK)
        rc = remote_job_error(ended, detail, err);
    if (rc == MODAL_OK)
        rc = fetch_document(link, job_of(doc), remote_answer_by(deadline), &out->result, detail,
                            err);
    if (rc == MODAL_OK && args->output != NULL)
        rc = remote_signals(link, job_of(doc), remote_answer_by(deadline), out, detail, err);
    cJSON_Delete(doc);
    cJSON_Delete(ended);
    link_close(link);
    return rc;
}
