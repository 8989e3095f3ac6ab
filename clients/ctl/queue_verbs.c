/* queue_verbs.c - the verbs of the queue: one question, one document */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "outcome.h"
#include "field.h"
#include "job_line.h"
#include "remote.h"
#include "output.h"
#include "result_file.h"
#include "result_show.h"
#include "sbatch.h"
#include "show.h"
#include "sweep_point.h"
#include "store/batch_file.h"
#include "verbs.h"

enum { SUBMIT_WORDS = 3 };    /* submit KIND FILE */

/* What a verb of the queue works with; queue_end releases it and says how it ended. */
struct session {
    const struct args *args;
    struct link *link;
    double deadline;
    cJSON *doc, *detail;
    struct modal_error err;
};

static enum modal_status begin(struct session *s, const struct args *args)
{
    *s = (struct session) { .args = args, .deadline = remote_deadline(args) };
    if (args->local)
        return modal_fail_field(&s->err, MODAL_BAD_INPUT, "local",
                                "%s speaks of a daemon's queue; --local has none", args->word[0]);
    return remote_open(args, &s->link, &s->err);
}

static int end(struct session *s, enum modal_status rc, int status)
{
    if (rc != MODAL_OK)
        status = outcome_failure(s->args->json, &s->err, s->detail);
    cJSON_Delete(s->doc);
    cJSON_Delete(s->detail);
    link_close(s->link);
    return status;
}

static enum modal_status print_job(struct session *s)
{
    const cJSON *result = cJSON_GetObjectItemCaseSensitive(s->doc, "result");

    if (s->args->json)
        return outcome_json(s->doc, &s->err);
    job_line(stdout, s->doc);
    if (result != NULL)
        show_result(field_word(result, "kind", "-"), result);
    return MODAL_OK;
}

/* Why a document has no result: its own error, and where the daemon has none, one made from the
 * state. */
static void add_error(cJSON *doc, const struct modal_error *err, const cJSON *detail)
{
    cJSON *error;

    if (cJSON_HasObjectItem(doc, "error"))
        return;
    error = outcome_error(err, detail);
    cJSON_AddItemToObject(doc, "error", cJSON_DetachItemFromObjectCaseSensitive(error, "error"));
    cJSON_Delete(error);
}

/* Wait for JOB and complete its document; the exit status into *STATUS. */
static enum modal_status wait_for(struct session *s, const char *job, int *status)
{
    char name[160];
    cJSON *first = s->doc;
    enum modal_status rc;

    snprintf(name, sizeof name, "%s", job);
    rc = client_wait(s->link, name, remote_progress(), s->deadline, &s->doc, &s->detail, &s->err);
    if (s->doc == NULL)
        s->doc = first;
    else
        cJSON_Delete(first);
    if (rc == MODAL_OK && (rc = remote_job_error(s->doc, NULL, &s->err)) == MODAL_OK)
        rc = remote_add_result(s->link, s->doc, remote_answer_by(s->deadline), &s->detail, &s->err);
    *status = rc == MODAL_OK ? sweep_exit(cJSON_GetObjectItemCaseSensitive(s->doc, "result"))
                             : modal_status_exit(rc);
    if (rc == MODAL_OK || s->doc == NULL || rc == MODAL_NO_SERVER)
        return rc;
    add_error(s->doc, &s->err, s->detail);
    return MODAL_OK;
}

int run_wait(const struct verb *verb, const struct args *args)
{
    struct session s;
    int status = 0;
    enum modal_status rc = begin(&s, args);

    (void)verb;
    if (rc == MODAL_OK)
        rc = wait_for(&s, args->word[1], &status);
    if (rc == MODAL_OK)
        rc = print_job(&s);
    return end(&s, rc, status);
}

int run_queue(const struct verb *verb, const struct args *args)
{
    struct session s;
    int status = 0;
    enum modal_status rc = begin(&s, args);

    if (rc == MODAL_OK)
        rc = client_do(s.link, verb->asks, args->word[1], remote_answer_by(s.deadline), &s.doc,
                       &s.detail, &s.err);
    if (rc == MODAL_OK && args->wait)
        rc = wait_for(&s, args->word[1], &status);
    if (rc == MODAL_OK)
        rc = print_job(&s);
    return end(&s, rc, status);
}

/* Submit INPUT and, where asked to, wait. */
static int submit_input(const struct input *input, const struct args *args)
{
    struct client_input in = remote_input(input);
    struct client_job job = remote_job(input, args, NULL);
    struct session s;
    int status = 0;
    enum modal_status rc = begin(&s, args);

    if (rc == MODAL_OK)
        rc = client_submit(s.link, &job, &in, remote_progress(), remote_answer_by(s.deadline),
                           &s.doc, &s.detail, &s.err);
    if (rc == MODAL_OK && args->wait)
        rc = wait_for(&s, field_word(s.doc, "job", "-"), &status);
    if (rc == MODAL_OK)
        rc = print_job(&s);
    return end(&s, rc, status);
}

int submit_one(const char *kind, const char *of, const char *path, const struct args *args)
{
    struct modal_error err = { 0 };
    struct input input;
    int status;

    if (input_read(kind, of, path, args, &input, &err) != MODAL_OK)
        return outcome_failure(args->json, &err, NULL);
    status = submit_input(&input, args);
    input_done(&input);
    return status;
}

int run_submit(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };

    (void)verb;
    if (args->sbatch != NULL)
        return sbatch_list(args);
    if (args->from != NULL)
        return run_bulk(args);
    if (args->words < SUBMIT_WORDS
        || (args->words == 4 && strcmp(args->word[1], "tradeoff") != 0)) {
        modal_fail_field(&err, MODAL_BAD_INPUT, "arguments",
                         "submit takes KIND FILE, tradeoff OF FILE, or --from LIST.jsonl");
        return outcome_failure(args->json, &err, NULL);
    }
    return submit_one(args->word[1], args->words == 4 ? args->word[2] : NULL,
                      args->word[args->words - 1], args);
}

/* -O FILE: the signals of a simulate job as a batch. */
static enum modal_status save_signals(struct session *s, const char *job)
{
    struct job_result out = { 0 };
    enum modal_status rc = remote_signals(s->link, job, remote_answer_by(s->deadline), &out,
                                          &s->detail, &s->err);

    if (rc == MODAL_OK)
        rc = output_write(s->args->output, s->doc, &out.batch, &s->err);
    job_result_done(&out);
    return rc;
}

int run_result(const struct verb *verb, const struct args *args)
{
    struct session s;
    char *text = NULL;
    size_t length = 0;
    enum modal_status rc = begin(&s, args);

    (void)verb;
    if (rc == MODAL_OK)
        rc = output_check(args->output, &s.err);
    if (rc == MODAL_OK)
        rc = result_show_check(args, &s.err);
    if (rc == MODAL_OK)
        rc = client_result(s.link, args->word[1], "document", remote_answer_by(s.deadline), &text,
                           &length, NULL, &s.detail, &s.err);
    if (rc == MODAL_OK)
        rc = json_read(text, length, &s.doc, &s.err);
    if (rc == MODAL_OK && args->output != NULL)
        rc = !result_file_fits(s.doc) ? save_signals(&s, args->word[1])
           : output_write(args->output, s.doc, &(struct batch) { 0 }, &s.err);
    if (rc == MODAL_OK)
        rc = result_show(args, s.doc, NULL, &s.err);
    free(text);
    return end(&s, rc, rc == MODAL_OK ? sweep_exit(s.doc) : 0);
}

/* stderr of a worker that died of JOB */
int run_stderr(const struct verb *verb, const struct args *args)
{
    struct session s;
    char *text = NULL;
    size_t length = 0;
    enum modal_status rc = begin(&s, args);

    (void)verb;
    if (rc == MODAL_OK)
        rc = client_result(s.link, args->word[1], "stderr", remote_answer_by(s.deadline), &text,
                           &length, NULL, &s.detail, &s.err);
    if (rc == MODAL_OK && args->json) {
        s.doc = cJSON_CreateObject();
        cJSON_AddStringToObject(s.doc, "job", args->word[1]);
        cJSON_AddStringToObject(s.doc, "stderr", text);
        rc = outcome_json(s.doc, &s.err);
    } else if (rc == MODAL_OK) {
        fwrite(text, 1, length, stdout);
    }
    free(text);
    return end(&s, rc, 0);
}

/* "12h" before now, or a date of UTC with or without a time, into seconds of UTC. */
static enum modal_status read_since(const char *text, double *out, struct modal_error *err)
{
    static const struct { const char *unit; double seconds; } units[] = {
        { "s", 1 }, { "m", 60 }, { "h", 3600 }, { "d", 86400 },
    };
    static const char *const dates[] = { "%Y-%m-%dT%H:%M:%SZ", "%Y-%m-%dT%H:%M:%S",
                                         "%Y-%m-%dT%H:%M", "%Y-%m-%d" };
    char *end;
    double age = strtod(text, &end);

    for (size_t i = 0; end != text && age >= 0 && i < sizeof units / sizeof *units; i++)
        if (strcmp(end, units[i].unit) == 0) {
            *out = fmax(0, (double)time(NULL) - age * units[i].seconds);
            return MODAL_OK;
        }
    for (size_t i = 0; i < sizeof dates / sizeof *dates; i++) {
        struct tm parts = { 0 };
        const char *rest = strptime(text, dates[i], &parts);
        if (rest != NULL && *rest == '\0') {
            *out = fmax(0, (double)timegm(&parts));
            return MODAL_OK;
        }
    }
    return modal_fail_field(err, MODAL_BAD_INPUT, "since", "--since is \"%.60s\"; accepted: 90s, "
                            "30m, 12h, 7d, or a date of UTC such as 2026-11-22 or 2026-11-22T09:30",
                            text);
}

static cJSON *list_header(const struct args *args, double since)
{
    cJSON *header = cJSON_CreateObject();

    if (args->newest)
        cJSON_AddTrueToObject(header, "newest");
    if (args->user != NULL)
        cJSON_AddStringToObject(header, "user", args->user);
    if (args->key != NULL)
        cJSON_AddStringToObject(header, "key", args->key);
    if (since > 0)
        cJSON_AddNumberToObject(header, "since", since);

    if (args->state != NULL)
        cJSON_AddStringToObject(header, "state", args->state);
    if (args->kind != NULL)
        cJSON_AddStringToObject(header, "kind", args->kind);
    if (args->limit > 0)
        cJSON_AddNumberToObject(header, "limit", args->limit);
    if (args->after != NULL)
        cJSON_AddStringToObject(header, "after", args->after);
    return header;
}

int run_list(const struct verb *verb, const struct args *args)
{
    struct session s;
    cJSON *answer = NULL;
    const cJSON *job;
    char *body = NULL;
    double since = 0;
    enum modal_status rc = begin(&s, args);

    (void)verb;
    if (rc == MODAL_OK && args->since != NULL)
        rc = read_since(args->since, &since, &s.err);
    if (rc == MODAL_OK)
        rc = client_ask(s.link, "LIST", list_header(args, since), remote_answer_by(s.deadline),
                        &answer, &body, &s.detail, &s.err);
    if (rc == MODAL_OK)
        rc = json_read(body ? body : "", body ? strlen(body) : 0, &s.doc, &s.err);
    if (rc == MODAL_OK && args->json)
        rc = outcome_json(s.doc, &s.err);
    else if (rc == MODAL_OK) {
        if (isatty(STDOUT_FILENO))          /* a pipe gets the lines alone */
            job_line_heading(stdout);
        cJSON_ArrayForEach(job, cJSON_GetObjectItemCaseSensitive(s.doc, "jobs"))
            job_line(stdout, job);
        if (cJSON_IsString(cJSON_GetObjectItemCaseSensitive(s.doc, "next")))
            printf("more: --after %s\n", field_word(s.doc, "next", "-"));
    }
    cJSON_Delete(answer);
    free(body);
    return end(&s, rc, 0);
}

/* A document a person reads as indented lines. */
static void show_lines(const cJSON *object, int indent)
{
    const cJSON *item;

    cJSON_ArrayForEach(item, object) {
        char *value = cJSON_IsObject(item) ? NULL : json_print(item);
        printf("%*s%-*s%s\n", indent, "", 24 - indent, item->string ? item->string : "",
               value ? value : "");
        if (value == NULL)
            show_lines(item, indent + 2);
        free(value);
    }
}

int run_service(const struct verb *verb, const struct args *args)
{
    struct session s;
    enum modal_status rc = begin(&s, args);

    if (rc == MODAL_OK)
        rc = client_ask(s.link, verb->asks, cJSON_CreateObject(), remote_answer_by(s.deadline),
                        &s.doc, NULL, &s.detail, &s.err);
    if (rc == MODAL_OK && args->json)
        rc = outcome_json(s.doc, &s.err);
    else if (rc == MODAL_OK)
        show_lines(s.doc, 0);
    return end(&s, rc, 0);
}

int run_metrics(const struct verb *verb, const struct args *args)
{
    struct session s;
    char *body = NULL;
    enum modal_status rc = begin(&s, args);

    (void)verb;
    if (rc == MODAL_OK)
        rc = client_ask(s.link, "METRICS", cJSON_CreateObject(), remote_answer_by(s.deadline),
                        &s.doc, &body, &s.detail, &s.err);
    if (rc == MODAL_OK && args->json) {
        cJSON_AddStringToObject(s.doc, "metrics", body ? body : "");
        rc = outcome_json(s.doc, &s.err);
    } else if (rc == MODAL_OK) {
        fputs(body ? body : "", stdout);
    }
    free(body);
    return end(&s, rc, 0);
}
