/* top.c - verb `top`: queue, workers and streams on one screen, drawn anew every few seconds; once
 * where stdout is no terminal */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "field.h"
#include "job_line.h"
#include "outcome.h"
#include "remote.h"
#include "screen.h"
#include "streams.h"
#include "verbs.h"

enum {
    PRINTED_ROWS = 40,             /* of a picture on no screen: as long as a page */
    HEAD_ROWS = 6,                 /* of a picture beside the lines of streams and jobs */
    LISTED_MOST = 200,             /* more rows than a screen has */
    LISTS = 3                      /* of jobs: running, queued, ended */
};
static const double AGAIN_S = 2;   /* between two pictures: as fast as one looks */
static const double ANSWER_S = 2;  /* for an answer: a key is not kept waiting for longer */

/* What the daemon said. */
struct view { cJSON *who, *stats, *streams, *jobs[LISTS]; };

static void view_done(struct view *v)
{
    cJSON_Delete(v->who);
    cJSON_Delete(v->stats);
    cJSON_Delete(v->streams);
    for (int i = 0; i < LISTS; i++)
        cJSON_Delete(v->jobs[i]);
    *v = (struct view) { 0 };
}

/* The answer to VERB into *OUT: its header, or what its body is. */
static enum modal_status ask(struct link *link, const char *verb, cJSON *header, bool body,
                             cJSON **out, struct modal_error *err)
{
    cJSON *answer = NULL, *detail = NULL;
    char *text = NULL;
    enum modal_status rc = client_ask(link, verb, header, link_now() + ANSWER_S, &answer, &text,
                                      &detail, err);

    if (rc == MODAL_OK && body) {
        rc = json_read(text != NULL ? text : "", text != NULL ? strlen(text) : 0, out, err);
        cJSON_Delete(answer);
    } else {
        *out = answer;
    }
    free(text);
    cJSON_Delete(detail);
    return rc;
}

static cJSON *header_of(const struct args *args, const char *state, bool newest)
{
    cJSON *header = cJSON_CreateObject();

    cJSON_AddNumberToObject(header, "limit", LISTED_MOST);
    if (args->user != NULL)
        cJSON_AddStringToObject(header, "user", args->user);
    if (state != NULL)
        cJSON_AddStringToObject(header, "state", state);
    if (newest)
        cJSON_AddTrueToObject(header, "newest");
    return header;
}

static enum modal_status look(struct link *link, const struct args *args, struct view *v,
                              struct modal_error *err)
{
    static const char *const states[LISTS] = { "running", "queued", NULL };
    enum modal_status rc = ask(link, "WHOAMI", cJSON_CreateObject(), false, &v->who, err);

    if (rc == MODAL_OK)
        rc = ask(link, "STATS", cJSON_CreateObject(), false, &v->stats, err);
    if (rc == MODAL_OK)
        rc = ask(link, "STREAMS", header_of(args, NULL, false), true, &v->streams, err);
    for (int i = 0; rc == MODAL_OK && i < LISTS; i++)
        rc = ask(link, "LIST", header_of(args, states[i], states[i] == NULL), true, &v->jobs[i],
                 err);
    return rc;
}

static void put_head(FILE *to, const struct view *v)
{
    const cJSON *jobs = field_get(v->stats, "jobs"), *queue = field_get(v->stats, "queue"),
                *workers = field_get(v->stats, "workers"),
                *windows = field_get(v->stats, "streams");
    char up[STREAMS_AGE_ROOM], oldest[STREAMS_AGE_ROOM];

    streams_age(field_real(v->stats, "uptime_s"), up);
    streams_age(field_real(queue, "oldest_s"), oldest);
    fprintf(to, "modald up %s, for %s (%s)%s%s\n", up, field_word(v->who, "user", "-"),
            field_word(v->who, "role", "-"),
            cJSON_IsTrue(field_get(v->stats, "draining")) ? ", DRAINING" : "",
            cJSON_IsTrue(field_get(v->stats, "storage_full")) ? ", DISK FULL" : "");
    fprintf(to, "queue: %.0f queued (the oldest for %s), %.0f running; %.0f done, %.0f failed, "
            "%.0f dead\n", field_number(jobs, "queued", 0), oldest,
            field_number(jobs, "running", 0), field_number(jobs, "done", 0),
            field_number(jobs, "failed", 0), field_number(jobs, "dead", 0));
    fprintf(to, "workers: %.0f of %.0f busy, %.0f deaths; windows: %.0f told, %.0f skipped, %.0f "
            "waiting\n\n", field_number(workers, "busy", 0), field_number(workers, "total", 0),
            field_number(workers, "deaths", 0), field_number(windows, "windows", 0),
            field_number(windows, "skipped", 0), field_number(windows, "waiting", 0));
}

/* Has the job ended?  The first two lists have told the others. */
static bool is_over(const cJSON *job)
{
    return strcmp(field_word(job, "state", ""), "queued") != 0
           && strcmp(field_word(job, "state", ""), "running") != 0;
}

/* Jobs in ROWS lines at most: what runs, what is next, what ended last. */
static void put_jobs(FILE *to, const struct view *v, int rows)
{
    const cJSON *job;

    job_line_heading(to);
    for (int i = 0; i < LISTS; i++)
        cJSON_ArrayForEach(job, field_get(v->jobs[i], "jobs"))
            if ((i + 1 < LISTS || is_over(job)) && rows-- > 0)
                job_line(to, job);
}

/* A picture of ROWS lines, the caller's; NULL: no memory.  Streams have half of it where jobs fill
 * the rest. */
static char *draw(const struct view *v, int rows)
{
    const cJSON *one, *streams = field_get(v->streams, "streams");
    int left = rows > HEAD_ROWS + 2 ? rows - HEAD_ROWS : 2, most = left / 2;
    char *text = NULL;
    size_t size;
    FILE *to = open_memstream(&text, &size);

    if (to == NULL)
        return NULL;
    put_head(to, v);
    streams_heading(to);
    cJSON_ArrayForEach(one, streams)
        if (most-- > 0) {
            streams_line(to, one);
            left--;
        }
    fputc('\n', to);
    put_jobs(to, v, left);
    return fclose(to) == 0 ? text : NULL;
}

static enum modal_status print_once(const struct view *v, bool json, struct modal_error *err)
{
    cJSON *doc;
    char *text;
    enum modal_status rc;

    if (!json) {
        text = draw(v, PRINTED_ROWS);
        if (text == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "no memory for the picture");
        fputs(text, stdout);
        free(text);
        return MODAL_OK;
    }
    doc = cJSON_CreateObject();
    cJSON_AddItemReferenceToObject(doc, "stats", v->stats);
    cJSON_AddItemReferenceToObject(doc, "streams", (cJSON *)field_get(v->streams, "streams"));
    cJSON_AddItemReferenceToObject(doc, "running", (cJSON *)field_get(v->jobs[0], "jobs"));
    cJSON_AddItemReferenceToObject(doc, "queued", (cJSON *)field_get(v->jobs[1], "jobs"));
    cJSON_AddItemReferenceToObject(doc, "newest", (cJSON *)field_get(v->jobs[2], "jobs"));
    rc = outcome_json(doc, err);
    cJSON_Delete(doc);
    return rc;
}

/* Until `q`.  A daemon that is away is said, and asked again. */
static void watch(struct link *link, const struct args *args, struct view *v)
{
    struct modal_error err = { 0 };
    enum modal_status rc = MODAL_OK;

    screen_begin();
    do {
        int columns, rows;
        char *text;
        screen_size(&columns, &rows);
        text = rc == MODAL_OK ? draw(v, rows) : NULL;
        if (text != NULL)
            screen_show(text);
        else
            screen_show(err.message);
        free(text);
        if (screen_key(AGAIN_S) == 'q')
            break;
        view_done(v);
        rc = look(link, args, v, &err);
    } while (true);
    screen_end();
}

int run_top(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    struct link *link = NULL;
    struct view v = { 0 };
    enum modal_status rc = MODAL_OK;

    (void)verb;
    if (args->local)
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "local", "top looks at a daemon; --local has "
                              "none");
    if (rc == MODAL_OK)
        rc = remote_open(args, &link, &err);
    if (rc == MODAL_OK)
        rc = look(link, args, &v, &err);
    if (rc == MODAL_OK && isatty(STDOUT_FILENO) && isatty(STDIN_FILENO) && !args->json)
        watch(link, args, &v);
    else if (rc == MODAL_OK)
        rc = print_once(&v, args->json, &err);
    view_done(&v);
    link_close(link);
    return rc == MODAL_OK ? 0 : outcome_failure(args->json, &err, NULL);
}
