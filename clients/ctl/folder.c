/* folder.c - `fsck`, `dump`, `backup`: a data folder on this machine, beside its daemon or without
 * one */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>
#include "outcome.h"
#include "store/backup.h"
#include "store/check.h"
#include "store/dump.h"
#include "verbs.h"

/* DIR is --data, else the first of at least WORDS words behind the verb. */
static const char *folder_of(const struct args *args, int words, struct modal_error *err)
{
    const char *dir = args->data != NULL ? args->data : args->words > words ? args->word[1] : NULL;

    if (dir == NULL) {
        modal_fail_field(err, MODAL_BAD_INPUT, "data",
                         "which data folder? accepted: its path, or --data DIR");
    } else if (access(dir, R_OK | X_OK) != 0) {
        modal_fail_field(err, MODAL_BAD_INPUT, "data", "%s: %s", dir, strerror(errno));
        return NULL;
    }
    return dir;
}

static void add_problem(void *context, const char *line)
{
    cJSON_AddItemToArray(context, cJSON_CreateString(line));
}

static void print_problem(void *context, const char *line)
{
    (void)context;
    printf("%s\n", line);
}

static cJSON *report_json(const char *dir, const struct check_report *report, cJSON *problems)
{
    const struct { const char *name; int64_t value;
    } counts[] = {
        { "jobs", report->jobs },
        { "inputs", report->inputs },
        { "results", report->results },
        { "chunks", report->chunks },
        { "tombstones", report->tombstones },
        { "bytes", report->bytes },
        { "orphans", report->orphans },
    };
    cJSON *document = cJSON_CreateObject();

    cJSON_AddStringToObject(document, "folder", dir);
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
        cJSON_AddNumberToObject(document, counts[i].name, (double)counts[i].value);
    cJSON_AddItemToObject(document, "problems", problems);
    if (report->problems > 0) {
        cJSON *error = cJSON_AddObjectToObject(document, "error");
        cJSON_AddStringToObject(error, "code", modal_status_code(MODAL_CORRUPT));
        cJSON_AddStringToObject(error, "message",
                                "the data folder is damaged; `problems` says where");
    }
    return document;
}

int run_fsck(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    struct check_report report;
    const char *dir = folder_of(args, 1, &err);
    cJSON *problems = cJSON_CreateArray();

    (void)verb;
    if (dir == NULL
        || check_folder(dir, args->json ? add_problem : print_problem, problems, &report, &err)
               != MODAL_OK) {
        cJSON_Delete(problems);
        return outcome_failure(args->json, &err, NULL);
    }
    if (args->json) {
        cJSON *document = report_json(dir, &report, problems);
        outcome_json(document, NULL);
        cJSON_Delete(document);
    } else {
        printf("%s: %" PRId64 " problems; %" PRId64 " jobs, %" PRId64 " inputs in %" PRId64
               " chunks, %" PRId64 " results, %" PRId64 " bytes read, %" PRId64
               " files left over\n",
               dir, report.problems, report.jobs, report.inputs, report.chunks, report.results,
               report.bytes, report.orphans);
        cJSON_Delete(problems);
    }
    return report.problems > 0 ? 1 : 0;
}

static void print_line(void *context, const char *json)
{
    (void)context;
    puts(json);
}

int run_dump(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    const char *dir = folder_of(args, 1, &err);

    (void)verb;
    if (dir == NULL || dump_folder(dir, print_line, NULL, &err) != MODAL_OK)
        return outcome_failure(args->json, &err, NULL);
    return 0;
}

int run_backup(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    const char *to = args->word[args->words - 1], *dir = folder_of(args, 2, &err);
    cJSON *document;

    (void)verb;
    if (dir == NULL || backup_folder(dir, to, &err) != MODAL_OK)
        return outcome_failure(args->json, &err, NULL);
    document = cJSON_CreateObject();
    cJSON_AddStringToObject(document, "folder", dir);
    cJSON_AddStringToObject(document, "to", to);
    if (args->json)
        outcome_json(document, NULL);
    else
        printf("%s is a copy of %s, to be started with modald --data %s\n", to, dir, to);
    cJSON_Delete(document);
    return 0;
}
