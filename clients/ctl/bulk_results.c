/*
 * bulk_results.c - `results --from LIST.jsonl`: what became of the jobs of a list
 *
 * A line of the list is a submission, as `submit --from` takes it, or what that said of it, which
 * has "job".  Each gives one line {"line", "job", "result"} or {"line", "job", "error"}, in the
 * list's order; with --csv the table of each result, one below the other, and errors on stderr.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "field.h"
#include "outcome.h"
#include "remote.h"
#include "result_lines.h"
#include "signals.h"
#include "verbs.h"

enum { LIST_BYTES_MOST = 1 << 28 };      /* as bulk.c */

struct report { const struct args *args; struct link *link; struct result_lines lines; };

/* How the job of LINE is called. */
static void name_of(const struct report *r, const char *line, const cJSON *object, long number,
                    char name[WIRE_KEY_MOST + 8])
{
    const char *job = field_word(object, "job", NULL), *key = field_word(object, "key", NULL);
    char own[WIRE_KEY_MOST + 1];

    if (job == NULL && key == NULL)
        bulk_key(r->args->from, number, line, own);
    snprintf(name, WIRE_KEY_MOST + 8, "%s%.*s", job != NULL ? "" : "key:", WIRE_KEY_MOST,
             job != NULL ? job : key != NULL ? key : own);
}

static enum modal_status fetch_line(struct report *r, const char *line, long number,
                                    struct modal_error *err)
{
    cJSON *object = NULL, *result = NULL, *detail = NULL;
    char name[WIRE_KEY_MOST + 8], *text = NULL;
    size_t length = 0;
    enum modal_status rc = json_read(line, strlen(line), &object, err);

    if (rc != MODAL_OK)
        return rc;
    name_of(r, line, object, number, name);
    rc = client_result(r->link, name, "document", remote_answer_by(remote_deadline(r->args)), &text,
                       &length, NULL, &detail, err);
    if (rc == MODAL_OK)
        rc = json_read(text, length, &result, err);
    if (rc == MODAL_OK)
        rc = result_lines_add(&r->lines, number, name, result, err);
    if (rc != MODAL_OK && rc != MODAL_NO_SERVER && rc != MODAL_IO)
        rc = result_lines_fail(&r->lines, number, name, detail, err);
    free(text);
    cJSON_Delete(object);
    cJSON_Delete(result);
    cJSON_Delete(detail);
    return rc;
}

static enum modal_status fetch_all(struct report *r, struct modal_error *err)
{
    char *text = NULL, *rest, *line;
    size_t length = 0;
    long number = 0;
    enum modal_status rc = signals_read_text(r->args->from, LIST_BYTES_MOST, &text, &length, err);

    for (rest = text; rc == MODAL_OK && (line = strsep(&rest, "\n")) != NULL;) {
        number++;
        if (line[strspn(line, " \t\r")] != 0)
            rc = fetch_line(r, line, number, err);
        if (rc != MODAL_OK && err->field[0] == 0)
            snprintf(err->field, sizeof err->field, "line[%ld]", number);
    }
    free(text);
    return rc;
}

int run_results(const struct verb *verb, const struct args *args)
{
    struct report r = { .args = args, .lines.csv = args->csv };
    struct modal_error err = { 0 };
    enum modal_status rc;

    (void)verb;
    if (args->from == NULL || args->local || (args->csv && args->json))
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "arguments", "results are a daemon's, of a "
                              "list; accepted: results --from LIST.jsonl [--csv]");
    else
        rc = remote_open(args, &r.link, &err);
    if (rc == MODAL_OK)
        rc = fetch_all(&r, &err);
    link_close(r.link);
    return rc == MODAL_OK ? r.lines.status : outcome_failure(args->json, &err, NULL);
}
