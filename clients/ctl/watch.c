/* watch.c - events as they happen: one line each; ends with the job watched, at --timeout, or by a
 * signal */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "outcome.h"
#include "event_show.h"
#include "field.h"
#include "live_modes.h"
#include "live_plot.h"
#include "plot_file.h"
#include "remote.h"
#include "verbs.h"
#include "whole_file.h"

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

/* What is remembered of the events so far. */
struct seen {
    struct live_plot plot;
    struct live_modes modes;
    double next;
    bool ended;
    const char *awaited;        /* a stream of which nothing came yet; NULL: none, or it was said */
};

static const double silence = 2;       /* s without a word until it is said what is waited for */

/* Say one EVENT; `next` becomes the number to go on from. */
static enum modal_status write_event(struct link_message *message, const struct args *args,
                                     struct seen *seen, struct modal_error *err)
{
    static const char *const ends[] = { "done", "failed", "cancelled", "dead", "closed" };
    enum modal_status rc;

    seen->next = fmax(seen->next, field_number(message->header, "number", -1) + 1);
    if (args->words > 1 || args->name != NULL)         /* windows of one stream follow each other */
        live_modes_trend(&seen->modes, message->header);
    rc = event_show(message->header, args->json, err);
    if (rc == MODAL_OK && args->plot != NULL)
        rc = live_plot_add(&seen->plot, args->plot, message->header, err);
    if (rc == MODAL_OK && args->prometheus != NULL)
        rc = live_modes_prometheus(args->prometheus, message->header, err);
    for (size_t i = 0; args->words > 1 && i < sizeof ends / sizeof ends[0]; i++)
        seen->ended |= strcmp(field_word(message->header, "state", "-"), ends[i]) == 0;
    return rc;
}

/* Until the connection is lost (MODAL_NO_SERVER), the deadline, or the end of what is watched. */
static enum modal_status follow(struct link *link, const struct args *args, struct seen *seen,
                                double deadline, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && !seen->ended) {
        struct link_message message;
        double soon = link_now() + silence;
        bool early = seen->awaited != NULL && soon < deadline;
        rc = link_receive(link, early ? soon : deadline, &message, err);
        if (rc == MODAL_TIMEOUT && early) {
            fprintf(stderr, "modalctl: watch: nothing of a stream \"%s\" so far%s; "
                    "waiting for it\n", seen->awaited,
                    args->name == NULL ? ", and no job has that id" : "");
            seen->awaited = NULL;
            rc = MODAL_OK;
            continue;
        }
        if (rc != MODAL_OK)
            break;
        seen->awaited = NULL;
        if (message.type == LINK_EVENT)
            rc = write_event(&message, args, seen, err);
        link_message_done(&message);
    }
    return rc;
}

/* Whether ARGS ask for what there is; SEEN begins where they say. */
static enum modal_status can_watch(const struct args *args, struct seen *seen,
                                   struct modal_error *err)
{
    if (args->local)
        return modal_fail_field(err, MODAL_BAD_INPUT, "local", "watch needs a daemon");
    if (args->prometheus != NULL && args->words < 2 && args->name == NULL)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "prometheus",
            "--prometheus holds one stream's modes; accepted: watch STREAM, or --name STREAM");
    if (seen == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "watch: no memory for what was seen");
    seen->next = args->after ? strtod(args->after, NULL) : args->words > 1 ? 0 : -1;
    if (args->plot != NULL && plot_path_check(args->plot, err) != MODAL_OK)
        return MODAL_BAD_INPUT;
    if (whole_file_check(args->plot, "plot", err) != MODAL_OK)
        return MODAL_BAD_INPUT;
    return whole_file_check(args->prometheus, "prometheus", err);
}

int run_watch(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    struct link *link = NULL;
    cJSON *answer = NULL, *detail = NULL;
    double deadline = remote_deadline(args);
    bool stream = args->name != NULL;
    struct seen *seen = calloc(1, sizeof *seen);
    enum modal_status rc = can_watch(args, seen, &err);
    int status;

    (void)verb;
    if (rc == MODAL_OK) {
        seen->awaited = args->name;
        rc = remote_open(args, &link, &err);
    }
    while (rc == MODAL_OK && !seen->ended) {
        rc = client_ask(link, "EVENTS", subscription(args, stream, seen->next),
                        fmin(deadline, link_now() + 40), &answer, NULL, &detail, &err);
        if (rc == MODAL_NOT_FOUND && !stream && args->words > 1) {
            /* no job of that name: a stream's, which may be yet to come */
            stream = true;
            seen->awaited = args->word[1];
            rc = MODAL_OK;
            continue;
        }
        cJSON_Delete(answer);
        answer = NULL;
        if (rc == MODAL_OK)
            rc = follow(link, args, seen, deadline, &err);
        if (rc == MODAL_NO_SERVER && !link_lost(link) && link_now() < deadline)
            rc = MODAL_OK;                     /* subscribe again, from where we were */
    }
    if (rc == MODAL_TIMEOUT && args->words < 2)
        rc = MODAL_OK;                         /* watched as long as was asked */
    status = rc == MODAL_OK ? 0 : outcome_failure(args->json, &err, detail);
    cJSON_Delete(detail);
    link_close(link);
    free(seen);
    return status;
}
