/* watch.c - events as they happen: one line each; ends with the job watched, at --timeout, or by a signal */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "answer.h"
#include "field.h"
#include "live_plot.h"
#include "remote.h"
#include "verbs.h"

/* f, zeta and their bars of each mode of a stream's window */
static void show_modes(const cJSON *event)
{
    const cJSON *mode;

    cJSON_ArrayForEach(mode, cJSON_GetObjectItemCaseSensitive(event, "modes")) {
        const cJSON *std = cJSON_GetObjectItemCaseSensitive(mode, "std");
        printf("  %.6g Hz +- %.1e  zeta %.5g +- %.1e", field_number(mode, "frequency_hz", NAN),
               field_number(std, "frequency_hz", NAN), field_number(mode, "damping_ratio", NAN), field_number(std, "damping_ratio", NAN));
    }
}

static void show_alarm(const cJSON *event)
{
    const cJSON *mode = cJSON_GetObjectItemCaseSensitive(event, "mode"), *std = cJSON_GetObjectItemCaseSensitive(mode, "std");

    if (cJSON_HasObjectItem(event, "rule"))
        printf(" %s", field_word(event, "rule", "-"));
    if (mode != NULL)
        printf("  %.6g Hz  zeta %.5g +- %.1e", field_number(mode, "frequency_hz", NAN), field_number(mode, "damping_ratio", NAN), field_number(std, "damping_ratio", NAN));
}

static void show_event(const cJSON *event)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(event, "error");

    printf("%8.0f  %-8s %-20s", field_number(event, "number", NAN), field_word(event, "event", "-"),
           field_word(event, "stream", field_word(event, "job", "-")));
    if (cJSON_HasObjectItem(event, "state"))
        printf(" %s", field_word(event, "state", "-"));
    show_modes(event);
    show_alarm(event);
    if (error != NULL)
        printf("  %s: %s", field_word(error, "code", "-"), field_word(error, "message", "-"));
    putchar('\n');
    fflush(stdout);
}

static cJSON *subscription(const struct args *args, bool stream, double from)
{
    cJSON *header = cJSON_CreateObject();

    if (args->words > 1)
        cJSON_AddStringToObject(header, stream ? "stream" : "job", args->word[1]);
    else if (args->name != NULL)
        cJSON_AddStringToObject(header, "stream", args->name);
    if (from >= 0)
        cJSON_AddNumberToObject(header, "from", from);
    return header;
}

/* Say one EVENT; *NEXT becomes the number to go on from. */
static enum modal_status say(struct link_message *message, const struct args *args, struct live_plot *plot, double *next, bool *ended, struct modal_error *err)
{
    static const char *const ends[] = { "done", "failed", "cancelled", "dead", "closed" };
    enum modal_status rc = MODAL_OK;

    cJSON_DeleteItemFromObjectCaseSensitive(message->header, "subscription");
    *next = fmax(*next, field_number(message->header, "number", -1) + 1);
    if (args->json)
        rc = answer_json(message->header, err);
    else
        show_event(message->header);
    if (rc == MODAL_OK && args->plot != NULL)
        rc = live_plot_add(plot, args->plot, message->header, err);
    for (size_t i = 0; args->words > 1 && i < sizeof ends / sizeof ends[0]; i++)
        *ended |= strcmp(field_word(message->header, "state", "-"), ends[i]) == 0;
    return rc;
}

/* Until the connection is lost (MODAL_NO_SERVER), the deadline, or the end of what is watched. */
static enum modal_status follow(struct link *link, const struct args *args, struct live_plot *plot, double deadline, double *next, bool *ended, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && !*ended) {
        struct link_message message;
        rc = link_receive(link, deadline, &message, err);
        if (rc != MODAL_OK)
            break;
        if (message.type == LINK_EVENT)
            rc = say(&message, args, plot, next, ended, err);
        link_message_done(&message);
    }
    return rc;
}

int run_watch(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    struct link *link = NULL;
    cJSON *answer = NULL, *detail = NULL;
    double deadline = remote_deadline(args), next = args->after ? strtod(args->after, NULL) : args->words > 1 ? 0 : -1;
    bool ended = false, stream = args->name != NULL;
    struct live_plot *plot = calloc(1, sizeof *plot);
    enum modal_status rc = args->local ? modal_fail_field(&err, MODAL_BAD_INPUT, "local", "watch needs a daemon") : remote_open(args, &link, &err);
    int status;

    (void)verb;
    if (plot == NULL)
        rc = modal_fail(&err, MODAL_NO_MEMORY, "watch: no memory for a picture");
    while (rc == MODAL_OK && !ended) {
        rc = client_ask(link, "EVENTS", subscription(args, stream, next), fmin(deadline, link_now() + 40), &answer, NULL, &detail, &err);
        if (rc == MODAL_NOT_FOUND && !stream && args->words > 1) {
            stream = true;                     /* no job of that name: a stream's, which may be yet to come */
            rc = MODAL_OK;
            continue;
        }
        cJSON_Delete(answer);
        answer = NULL;
        if (rc == MODAL_OK)
            rc = follow(link, args, plot, deadline, &next, &ended, &err);
        if (rc == MODAL_NO_SERVER && !link_lost(link) && link_now() < deadline)
            rc = MODAL_OK;                     /* subscribe again, from where we were */
    }
    if (rc == MODAL_TIMEOUT && args->words < 2)
        rc = MODAL_OK;                         /* watched as long as was asked */
    status = rc == MODAL_OK ? 0 : answer_failure(args->json, &err, detail);
    cJSON_Delete(detail);
    link_close(link);
    free(plot);
    return status;
}
