/* stored.c - see stored.h */
#include "stored.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "client.h"
#include "field.h"
#include "remote.h"

static const char prefix[] = "stream:";

enum { IDENT_LETTERS = 8 };          /* of a job's id, PROTOCOL.md section 5 */

const char *stored_stream(const char *word)
{
    size_t length = sizeof prefix - 1;

    return strncmp(word, prefix, length) == 0 ? word + length : NULL;
}

bool stored_is(const char *word)
{
    static const char letters[] = "0123456789abcdefghjkmnpqrstvwxyz";
    bool is_ident = strlen(word) == IDENT_LETTERS && strspn(word, letters) == IDENT_LETTERS;

    return stored_stream(word) != NULL || strncmp(word, "key:", 4) == 0
           || (is_ident && access(word, F_OK) != 0);
}

/* What the daemon holds says of itself what a file may leave open. */
static enum modal_status check(const char *word, const struct args *args, struct modal_error *err)
{
    const char *field = args->dt != 0     ? "dt"
                        : args->dataset   ? "dataset"
                        : args->ignore_time ? "ignore-time"
                        : args->scale != 0 ? "scale"
                                           : NULL;

    if (args->local)
        return modal_fail_field(err, MODAL_BAD_INPUT, "local", "\"%.140s\" lies with a daemon; "
                                "--local has none", word);
    if (field != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "--%s is for files; what a daemon "
                                "holds says it itself", field);
    return MODAL_OK;
}

/* The batch among PAGE, which begins with the newest. */
static enum modal_status choose(const cJSON *page, const char *name, char stored[STORED_NAME_ROOM],
                                struct modal_error *err)
{
    const cJSON *one;
    bool open = false;

    cJSON_ArrayForEach(one, cJSON_GetObjectItemCaseSensitive(page, "streams")) {
        if (strcmp(field_word(one, "state", ""), "sealed") != 0) {
            open = true;
            continue;
        }
        if (open)
            fprintf(stderr, "modalctl: stream %s is open anew: this is its record of before\n",
                    name);
        snprintf(stored, STORED_NAME_ROOM, "%s", field_word(one, "upload", ""));
        return MODAL_OK;
    }
    if (open)
        return modal_fail_field(err, MODAL_CONFLICT, "stream", "stream \"%.130s\" is open: it is a "
                                "batch once it is closed; `modalctl watch` shows its modes", name);
    return modal_fail_field(err, MODAL_NOT_FOUND, "stream", "no stream \"%.130s\" of yours is kept "
                            "here; `modalctl streams` lists them", name);
}

static enum modal_status find(struct link *link, const char *name, const struct args *args,
                              char stored[STORED_NAME_ROOM], struct modal_error *err)
{
    cJSON *header = cJSON_CreateObject(), *answer = NULL, *page = NULL;
    char *body = NULL;
    enum modal_status rc;

    cJSON_AddStringToObject(header, "name", name);
    cJSON_AddNumberToObject(header, "limit", 2);        /* one is open at most */
    rc = client_ask(link, "STREAMS", header, remote_answer_by(remote_deadline(args)), &answer,
                    &body, NULL, err);
    if (rc == MODAL_OK)
        rc = json_read(body ? body : "", body ? strlen(body) : 0, &page, err);
    if (rc == MODAL_OK)
        rc = choose(page, name, stored, err);
    cJSON_Delete(answer);
    cJSON_Delete(page);
    free(body);
    return rc;
}

enum modal_status stored_find(const char *name, const struct args *args,
                              char stored[STORED_NAME_ROOM], struct modal_error *err)
{
    struct link *link = NULL;
    enum modal_status rc = check(name, args, err);

    if (rc == MODAL_OK)
        rc = remote_open(args, &link, err);
    if (rc == MODAL_OK)
        rc = find(link, name, args, stored, err);
    link_close(link);
    return rc;
}

/* The part of JOB that is signals. */
static enum modal_status fetch_of_job(struct link *link, const char *job, double deadline,
                                      char **bytes, size_t *length, cJSON **description,
                                      struct modal_error *err)
{
    cJSON *doc = NULL;
    bool made = false;
    enum modal_status rc = client_do(link, "STATUS", job, deadline, &doc, NULL, err);

    if (rc == MODAL_OK)
        made = strcmp(field_word(doc, "kind", ""), "simulate") == 0;
    if (rc == MODAL_OK)
        rc = client_result(link, job, made ? "batch" : "input", deadline, bytes, length,
                           description, NULL, err);
    if (rc == MODAL_OK && strcmp(field_word(*description, "content", ""), "batch") != 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "job %.140s is of kind %s and ran "
                              "on a scene; accepted: a job that has signals", job,
                              field_word(doc, "kind", "-"));
    cJSON_Delete(doc);
    return rc;
}

static enum modal_status fetch(struct link *link, const char *word, const struct args *args,
                               char **bytes, size_t *length, cJSON **description,
                               struct modal_error *err)
{
    const char *name = stored_stream(word);
    double deadline = remote_answer_by(remote_deadline(args));
    char stored[STORED_NAME_ROOM];
    enum modal_status rc;

    if (name == NULL)
        return fetch_of_job(link, word, deadline, bytes, length, description, err);
    rc = find(link, name, args, stored, err);
    return rc == MODAL_OK
               ? client_stored(link, stored, deadline, bytes, length, description, NULL, err)
               : rc;
}

/* What DESCRIPTION and LENGTH bytes at *BYTES, which are moved, say together. */
static enum modal_status compose(cJSON *description, char **bytes, size_t length,
                                 struct signals *out, struct modal_error *err)
{
    const char *units = cJSON_GetStringValue(
        cJSON_GetObjectItemCaseSensitive(description, "units"));
    struct job_result read = { 0 };
    enum modal_status rc = remote_batch(description, bytes, length, &read, err);

    if (rc != MODAL_OK)
        return rc;
    *out = (struct signals) {
        .samples = read.batch.samples, .channels = read.batch.channels, .x = read.signals,
        .dt = read.batch.dt, .period = read.batch.period, .dt_from = "the daemon",
        .names = read.names, .units = units != NULL ? strdup(units) : NULL,
        .attributes = cJSON_DetachItemFromObjectCaseSensitive(description, "attributes") };
    return MODAL_OK;
}

enum modal_status stored_read(const char *word, const struct args *args, struct signals *out,
                              struct modal_error *err)
{
    struct link *link = NULL;
    cJSON *description = NULL;
    char *bytes = NULL;
    size_t length = 0;
    enum modal_status rc = check(word, args, err);

    if (rc == MODAL_OK)
        rc = remote_open(args, &link, err);
    if (rc == MODAL_OK)
        rc = fetch(link, word, args, &bytes, &length, &description, err);
    if (rc == MODAL_OK)
        rc = compose(description, &bytes, length, out, err);
    free(bytes);
    cJSON_Delete(description);
    link_close(link);
    return rc;
}
