/* result_lines.c - see result_lines.h */
#include "result_lines.h"
#include <stdio.h>
#include "outcome.h"
#include "result_csv.h"

enum modal_status result_lines_add(struct result_lines *lines, long number, const char *name,
                                   cJSON *result, struct modal_error *err)
{
    enum modal_status rc;
    cJSON *doc;

    if (lines->csv) {
        rc = result_csv(stdout, result, name, !lines->begun, err);
        lines->begun = lines->begun || rc == MODAL_OK;
        return rc;
    }
    doc = cJSON_CreateObject();
    cJSON_AddNumberToObject(doc, "line", (double)number);
    cJSON_AddStringToObject(doc, "job", name);
    cJSON_AddItemReferenceToObject(doc, "result", result);
    rc = outcome_json(doc, err);
    cJSON_Delete(doc);
    return rc;
}

enum modal_status result_lines_fail(struct result_lines *lines, long number, const char *name,
                                    const cJSON *detail, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    cJSON *doc;

    lines->status = modal_status_exit(err->status);
    if (lines->csv) {
        fprintf(stderr, "modalctl: line %ld, %s: %s: %s\n", number, name,
                modal_status_code(err->status), err->message);
        return MODAL_OK;
    }
    doc = outcome_error(err, detail);
    cJSON_AddNumberToObject(doc, "line", (double)number);
    cJSON_AddStringToObject(doc, "job", name);
    rc = outcome_json(doc, err);
    cJSON_Delete(doc);
    return rc;
}
