/* streams.c - see streams.h */
#include "streams.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "field.h"
#include "outcome.h"
#include "remote.h"
#include "verbs.h"

void streams_age(double seconds, char text[STREAMS_AGE_ROOM])
{
    static const struct { double most, unit; const char *name; } units[] = {
        { 120, 1, "s" }, { 7200, 60, "min" }, { 172800, 3600, "h" }, { HUGE_VAL, 86400, "d" },
    };
    int i = 0;

    if (isnan(seconds)) {
        snprintf(text, STREAMS_AGE_ROOM, "-");
        return;
    }
    while (seconds >= units[i].most)
        i++;
    snprintf(text, STREAMS_AGE_ROOM, "%.0f %s", floor(fmax(seconds, 0) / units[i].unit),
             units[i].name);
}

void streams_heading(FILE *to)
{
    fprintf(to, "%-20s %-10s %-8s %8s %10s %10s %8s  %-10s %8s  %s\n", "name", "user", "state",
            "channels", "rate Hz", "samples", "lag", "verdict", "skipped", "age");
}

/* A whole number that may be absent. */
static void put_count(FILE *to, const cJSON *one, const char *key, int width)
{
    double count = field_real(one, key);

    if (isnan(count))
        fprintf(to, " %*s", width, "-");
    else
        fprintf(to, " %*.0f", width, count);
}

void streams_line(FILE *to, const cJSON *one)
{
    char age[STREAMS_AGE_ROOM], kept[STREAMS_AGE_ROOM];

    streams_age(field_real(one, "age_s"), age);
    streams_age(field_real(one, "kept_s"), kept);
    fprintf(to, "%-20s %-10s %-8s", field_word(one, "name", "-"), field_word(one, "user", "-"),
            field_word(one, "state", "-"));
    put_count(to, one, "channels", 8);
    fprintf(to, " %10.6g", 1 / field_real(one, "dt"));
    put_count(to, one, "samples", 10);
    put_count(to, one, "lag", 8);
    fprintf(to, "  %-10s", field_word(one, "verdict", "-"));
    put_count(to, one, "skipped", 8);
    fprintf(to, "  %s", age);
    if (cJSON_HasObjectItem(one, "kept_s"))
        fprintf(to, ", kept %s more", kept);
    fputc('\n', to);
}

static enum modal_status ask(const struct args *args, cJSON **page, cJSON **detail,
                             struct modal_error *err)
{
    cJSON *header = cJSON_CreateObject(), *answer = NULL;
    struct link *link = NULL;
    char *body = NULL;
    enum modal_status rc = remote_open(args, &link, err);

    if (args->words > 1)
        cJSON_AddStringToObject(header, "name", args->word[1]);
    if (args->user != NULL)
        cJSON_AddStringToObject(header, "user", args->user);
    if (args->limit > 0)
        cJSON_AddNumberToObject(header, "limit", args->limit);
    if (args->after != NULL)
        cJSON_AddStringToObject(header, "after", args->after);
    if (rc == MODAL_OK)
        rc = client_ask(link, "STREAMS", header, remote_answer_by(remote_deadline(args)), &answer,
                        &body, detail, err);
    else
        cJSON_Delete(header);
    if (rc == MODAL_OK)
        rc = json_read(body ? body : "", body ? strlen(body) : 0, page, err);
    cJSON_Delete(answer);
    free(body);
    link_close(link);
    return rc;
}

static void show(const cJSON *page)
{
    const cJSON *one, *next = cJSON_GetObjectItemCaseSensitive(page, "next");

    if (isatty(STDOUT_FILENO))                  /* a pipe gets the lines alone */
        streams_heading(stdout);
    cJSON_ArrayForEach(one, cJSON_GetObjectItemCaseSensitive(page, "streams"))
        streams_line(stdout, one);
    if (cJSON_IsString(next))
        printf("more: --after %s\n", next->valuestring);
}

int run_streams(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    cJSON *page = NULL, *detail = NULL;
    enum modal_status rc = MODAL_OK;
    int status;

    (void)verb;
    if (args->local)
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "local",
                              "streams are a daemon's; --local has none");
    if (rc == MODAL_OK)
        rc = ask(args, &page, &detail, &err);
    if (rc == MODAL_OK && args->json)
        rc = outcome_json(page, &err);
    else if (rc == MODAL_OK)
        show(page);
    status = rc == MODAL_OK ? 0 : outcome_failure(args->json, &err, detail);
    cJSON_Delete(page);
    cJSON_Delete(detail);
    return status;
}
