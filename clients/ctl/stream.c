/* stream.c - `stream FILE|-` and `replay FILE`: what a simulation would do, from the command line
 *
 * `stream` pushes a batch's samples through the streaming client and says what the daemon tells of
 * the stream meanwhile, as `watch` does; at the end it says how many samples were acknowledged and
 * how many were dropped.  $MODALD_WINDOW, --window and --hop say the windows.  `-`: rows of
 * numbers from stdin (rows.h), each pushed as it comes.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "outcome.h"
#include "live_events.h"
#include "modald_stream.h"
#include "remote.h"
#include "rows.h"
#include "stored.h"
#include "verbs.h"

static const char *const verdicts[] = { "unknown", "stable", "unstable", "undecided" };

enum {
    WINDOW_LEAST = 64,                          /* samples: some periods of what is sampled well */
    WINDOW_USUAL = 2048,                        /* where the length of the stream is unknown */
    WINDOW_BYTES_MOST = 1 << 20,                /* proto/PROTOCOL.md, section 11 */
    ROWS_WAIT_MS = 50,                          /* until what was told is said again */
};
static const double live_patience = 5;          /* s without a new window, once all samples are
                                                   there */

struct live {
    struct live_events events;
    double window, hop;         /* 0: the environment's */
    const struct args *args;
};

/* Live windows: as asked for, else a quarter of the SAMPLES known to come (0: not known) every half
 * of that. */
static void set_window(modald_stream *s, struct live *live, size_t samples, size_t channels)
{
    const struct args *args = live->args;
    double most = floor((double)WINDOW_BYTES_MOST / (double)(sizeof(double) * channels));
    double window = samples > 0 ? fmax(WINDOW_LEAST, (double)samples / 4) : WINDOW_USUAL / 4;
    char *options;

    if (args->window == 0 && getenv("MODALD_WINDOW") != NULL)
        return;
    live->window = args->window > 0 ? args->window : floor(fmin(fmin(window, WINDOW_USUAL), most));
    live->hop = args->hop > 0 ? args->hop : fmax(1, floor(live->window / 2));
    options = args->options->child != NULL ? json_print(args->options) : NULL;
    modald_window(s, (long)live->window, (long)live->hop, options);
    free(options);
}

static void sleep_for(double seconds)
{
    struct timespec t = { (time_t)seconds, (long)(1e9 * (seconds - floor(seconds))) };

    if (seconds > 0)
        nanosleep(&t, NULL);
}

/* Wait while the ring is a quarter full: a file is not a simulation, nothing need be dropped. */
static void keep_up(modald_stream *s, struct live *live, double most)
{
    struct modald_report r;

    for (modald_get_report(s, &r); r.waiting > most; modald_get_report(s, &r)) {
        live_events_show(&live->events);
        sleep_for(0.001);
    }
}

static void push_all(modald_stream *s, const struct signals *in, const struct args *args,
                     struct live *live)
{
    size_t block = args->rate > 0 ? (size_t)fmax(1, args->rate / 100) : 256;

    for (size_t k = 0; k < in->samples; k++) {
        modald_push(s, in->x + k * in->channels);
        if ((k + 1) % block != 0)
            continue;
        keep_up(s, live, (double)(((size_t)2 << 20) / sizeof(double) / (in->channels + 2)));
        live_events_show(&live->events);
        sleep_for(args->rate > 0 ? (double)block / args->rate : 0);
    }
}

/* All samples acknowledged, then the windows that are still to come: the last rests on the last
 * whole hop. */
static void finish(modald_stream *s, struct live *live, double samples, struct modald_report *r)
{
    double until = link_now() + (live->args->timeout >= 0 ? live->args->timeout : 30), heard,
           sample = live->events.sample;
    double last = live->window > 0 && samples >= live->window
                      ? live->window + floor((samples - live->window) / live->hop) * live->hop - 1
                      : -2;

    for (modald_get_report(s, r); r->waiting > 0 && link_now() < until; modald_get_report(s, r)) {
        live_events_show(&live->events);
        sleep_for(0.005);
    }
    for (heard = link_now();
         r->refused == 0 && live->events.sample < last
         && link_now() < fmin(until, heard + live_patience);
         sample = live->events.sample) {
        live_events_show(&live->events);
        heard = live->events.sample > sample ? link_now() : heard;
        sleep_for(0.005);
    }
    live_events_finish(&live->events, fmin(until, link_now() + REMOTE_ANSWER_S));
}

static int print_end(modald_stream *s, struct live *live, size_t samples)
{
    struct modald_report r;
    bool all;

    finish(s, live, (double)samples, &r);
    all = r.acknowledged >= (double)samples && r.dropped == 0;
    cJSON *line = cJSON_CreateObject();
    json_set_number(line, "pushed", r.pushed);
    json_set_number(line, "acknowledged", r.acknowledged);
    json_set_number(line, "dropped", r.dropped);
    cJSON_AddStringToObject(line, "verdict", verdicts[modald_verdict(s)]);
    if (r.refused > 0) {
        struct modal_error why = {
            .status = MODAL_DENIED,
            .message = "the daemon refused the stream; the line on stderr says why"
        };
        cJSON *error = outcome_error(&why, NULL);
        cJSON_AddItemToObject(line, "error",
                              cJSON_DetachItemFromObjectCaseSensitive(error, "error"));
        cJSON_Delete(error);
    }
    if (live->args->json)
        outcome_json(line, NULL);
    else
        printf("%.0f samples, %.0f acknowledged, %.0f dropped; %s\n", r.pushed, r.acknowledged,
               r.dropped, verdicts[modald_verdict(s)]);
    cJSON_Delete(line);
    return r.refused > 0 ? 4 : all ? 0 : 3;
}

/* The streaming client takes its server and keys from the environment only; *LINK to the same. */
static enum modal_status set_environment(const struct args *args, struct link **link,
                                         struct modal_error *err)
{
    cJSON *hello = NULL;
    enum modal_status rc = remote_open(args, link, err);

    if (rc == MODAL_OK)
        rc = client_ask(*link, "HELLO", cJSON_CreateObject(), remote_deadline(args), &hello, NULL,
                        NULL, err);
    if (rc == MODAL_OK)
        setenv("MODALD_URL", link_endpoint(*link), 1);
    if (rc == MODAL_OK && args->keyfile != NULL)
        setenv("MODALD_KEYFILE", args->keyfile, 1);
    cJSON_Delete(hello);
    return rc;
}

static const char *stream_name(const struct args *args)
{
    const char *slash = strrchr(args->word[1], '/');

    return args->name                        ? args->name
           : strcmp(args->word[1], "-") == 0 ? "stdin"
           : slash                           ? slash + 1
                                             : args->word[1];
}

/* What IN says of itself, of whose SAMPLES it is known how many come (0: not known). */
static enum modal_status open_stream(const char *name, const struct signals *in, size_t samples,
                                     struct live *live, modald_stream **out,
                                     struct modal_error *err)
{
    *out = modald_open(name, (int)in->channels, in->dt);
    if (*out == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "name", "the stream cannot be opened; "
                                "accepted: a name of 1 to 128 bytes");
    modald_describe(*out, (const char *const *)in->names, in->units, in->period);
    set_window(*out, live, samples, in->channels);
    return MODAL_OK;
}

/* Push rows until the pipe ends; what is told of the stream is said between them, and while none
 * come. */
static enum modal_status push_rows(struct rows *rows, size_t channels, struct live *live,
                                   modald_stream *s, size_t *samples, struct modal_error *err)
{
    double *x = calloc(channels + 1, sizeof *x);
    enum rows_state state = ROWS_ROW;
    enum modal_status rc = x != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "no memory");

    while (rc == MODAL_OK && state != ROWS_END) {
        rc = rows_next(rows, x, ROWS_WAIT_MS, &state, err);
        if (rc == MODAL_OK && state == ROWS_ROW) {
            modald_push(s, x);
            ++*samples;
        }
        live_events_show(&live->events);
    }
    free(x);
    return rc;
}

static enum modal_status push_stdin(const struct args *args, const char *name, struct live *live,
                                    modald_stream **out, size_t *samples, struct modal_error *err)
{
    struct signals_options options = { .dt = args->dt, .ignore_time = args->ignore_time,
                                       .scale = args->scale };
    struct signals head = { 0 };
    struct rows *rows = NULL;
    enum modal_status rc = rows_open(STDIN_FILENO, "stdin", &options, &rows, &head, err);

    if (rc == MODAL_OK)
        rc = open_stream(name, &head, 0, live, out, err);
    if (rc == MODAL_OK) {
        push_all(*out, &head, args, live);
        *samples = head.samples;
        rc = push_rows(rows, head.channels, live, *out, samples, err);
    }
    rows_close(rows);
    signals_done(&head);
    return rc;
}

/* Open by a file's shape and push it. */
static enum modal_status push_file(const struct args *args, const char *name, struct live *live,
                                   modald_stream **out, size_t *samples, struct modal_error *err)
{
    struct signals_options options = { .dataset = args->dataset, .dt = args->dt,
                                       .ignore_time = args->ignore_time,
                                       .scale = args->scale };
    struct signals in = { 0 };
    enum modal_status rc = stored_stream(args->word[1]) != NULL
                               ? stored_read(args->word[1], args, &in, err)
                               : signals_read(args->word[1], &options, &in, err);

    if (rc == MODAL_OK)
        rc = open_stream(name, &in, in.samples, live, out, err);
    if (rc == MODAL_OK) {
        push_all(*out, &in, args, live);
        *samples = in.samples;
    }
    signals_done(&in);
    return rc;
}

int run_stream(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    const char *name = stream_name(args);
    struct live live = {
        .events = { .stream = name, .json = args->json, .sample = -1, .next = -1 }, .args = args,
    };
    modald_stream *s = NULL;
    size_t samples = 0;
    int status;
    enum modal_status rc = args->local ? modal_fail_field(&err, MODAL_BAD_INPUT, "local",
                                                          "stream needs a daemon")
                                       : set_environment(args, &live.events.link, &err);

    (void)verb;
    if (rc == MODAL_OK)
        rc = live_events_begin(&live.events, remote_deadline(args), &err);
    if (rc == MODAL_OK)
        rc = strcmp(args->word[1], "-") == 0 ? push_stdin(args, name, &live, &s, &samples, &err)
                                             : push_file(args, name, &live, &s, &samples, &err);
    status = rc == MODAL_OK ? print_end(s, &live, samples)
                            : outcome_failure(args->json, &err, NULL);
    if (rc == MODAL_OK)
        modald_close(s);
    else
        modald_abandon(s);
    link_close(live.events.link);
    return status;
}

int run_replay(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    char why[256] = "";
    double samples = 0;
    struct link *link = NULL;
    enum modal_status rc = set_environment(args, &link, &err);

    (void)verb;
    link_close(link);
    if (rc == MODAL_OK
        && !modald_replay(args->word[1], args->timeout >= 0 ? args->timeout : 60, &samples, why,
                          sizeof why))
        rc = strncmp(why, "not all", 7) == 0
                 ? modal_fail(&err, MODAL_TIMEOUT, "%s: %s", args->word[1], why)
                 : modal_fail_field(&err, MODAL_BAD_INPUT, "file", "%s: %s", args->word[1], why);
    if (rc != MODAL_OK)
        return outcome_failure(args->json, &err, NULL);
    cJSON *doc = cJSON_CreateObject();
    cJSON_AddStringToObject(doc, "file", args->word[1]);
    cJSON_AddNumberToObject(doc, "samples", samples);
    if (why[0] != 0)
        cJSON_AddStringToObject(doc, "note", why);
    if (args->json)
        outcome_json(doc, NULL);
    else
        printf("%.0f samples of %s acknowledged%s%s\n", samples, args->word[1],
               why[0] != 0 ? "; " : "", why);
    cJSON_Delete(doc);
    return 0;
}
