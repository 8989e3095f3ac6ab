/*
 * test_windows.c - whose turn a live window is, with workers that each take their time; and what a
 * worker says of one, as one that was taken over might
 */
#include "check.h"
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include "base/crc32c.h"
#include "broker/core/core.h"
#include "broker/core/state.h"
#include "wire/frame.h"

enum { WORKERS = 8 };

static struct core *core;
static struct transaction *waiting;
/* What each worker was last told to run. */
static struct run { char attempt[32], stream[32]; bool told; } runs[WORKERS];
static char stream[9];
static int events;
static char last_event[4096];
static bool window_noted;
static char last_verdict[32];      /* as it was noted of a batch */
static struct task *sealing;       /* until it is told done */

static void remember(const char *header, const char *name, char *out, size_t room)
{
    cJSON *read = cJSON_Parse(header);
    const cJSON *member = cJSON_GetObjectItemCaseSensitive(read, name);

    if (cJSON_IsString(member))
        snprintf(out, room, "%s", member->valuestring);
    else if (cJSON_IsNumber(member))
        snprintf(out, room, "%d", member->valueint);
    cJSON_Delete(read);
}

static void remember_run(const char *header, struct run *run)
{
    cJSON *read = cJSON_Parse(header);
    char *live = cJSON_PrintUnformatted(cJSON_GetObjectItemCaseSensitive(read, "live"));

    remember(header, "attempt", run->attempt, sizeof run->attempt);
    remember(live, "stream", run->stream, sizeof run->stream);
    run->told = true;
    free(live);
    cJSON_Delete(read);
}

static void carry_out(const struct action *a)
{
    if (a->type == ACT_COMMIT) {
        a->transaction->next = waiting;
        waiting = a->transaction;
        for (size_t i = 0; i < waiting->count; i++)
            if (waiting->changes[i].verb == LEDGER_EVENT_PUT) {
                events++;
                snprintf(last_event, sizeof last_event, "%s", waiting->changes[i].event.text);
            } else if (waiting->changes[i].verb == LEDGER_NOTE_PUT
                       && strcmp(waiting->changes[i].note.topic, "verdict") == 0)
                snprintf(last_verdict, sizeof last_verdict, "%s", waiting->changes[i].note.text);
            else if (waiting->changes[i].verb == LEDGER_NOTE_PUT
                     && strcmp(waiting->changes[i].note.topic, "window") == 0)
                window_noted = waiting->changes[i].note.text != NULL;
        return;
    }
    if (a->type == ACT_TASK && a->task->type == TASK_STREAM_SEAL) {
        CHECK(sealing == NULL);
        sealing = a->task;
        return;
    }
    if (a->type == ACT_TASK) {
        task_free(a->task);
        return;
    }
    if (a->type == ACT_SEND)
        remember(a->header, "stream", stream, sizeof stream);
    if (a->type == ACT_WORKER && strcmp(a->verb, "RUN") == 0)
        remember_run(a->header, &runs[a->slot]);
    free(a->header);
    blob_drop(a->body);
}

static struct moment now = { 1000 * SECOND, INT64_C(1790000000) * SECOND };

static void carry_out_all(const struct actions *list)
{
    struct action own[64];
    size_t count = list->count;

    CHECK(count <= 64);
    memcpy(own, list->items, count * sizeof *own);
    for (size_t i = 0; i < count; i++)
        carry_out(&own[i]);
}

static void step(struct event e)
{
    struct transaction *t;

    carry_out_all(core_step(core, &e, now));
    while ((t = waiting) != NULL) {
        waiting = t->next;
        t->next = NULL;
        t->status = MODAL_OK;
        carry_out_all(core_step(
            core, &(struct event) { .type = EVENT_COMMITTED, .transaction = t }, now));
    }
}

/* The worker of which say() says something. */
static int slot;

static void say(const char *version, const char *verb, const char *header, const void *body,
                size_t size)
{
    const bool asks = strcmp(version, WIRE_VERSION) == 0;
    struct blob *blobs[1] = { body != NULL ? blob_copy(body, size) : NULL };
    struct wire_frame frames[4] = { { version, 7 }, { verb, strlen(verb) },
                                    { header, strlen(header) }, { body, size } };
    struct wire_message m;

    CHECK(wire_open(frames, body != NULL ? 4 : 3, version, asks, &m, NULL) == MODAL_OK);
    step((struct event) { .type = asks ? EVENT_REQUEST : EVENT_WORKER, .peer = asks,
                          .slot = slot, .key = "", .message = &m, .body = blobs });
    wire_close(&m);
    blob_drop(blobs[0]);
}

/* A daemon of COUNT workers, all ready. */
static void start_workers(int count)
{
    static struct account account = { .key = "", .user = "one", .role = WIRE_ROLE_ADMIN,
                                      .weight = 1 };
    static struct settings settings = { .accounts = &account, .account_count = 1,
        .cores = 2, .queue_jobs = 20, .input_bytes = 1 << 22,
        .window_bytes = 1 << 20, .lease_ns = 5 * SECOND, .result_age_ns = 3600 * SECOND,
        .input_age_ns = 60 * SECOND, .tombstone_age_ns = 86400 * SECOND,
        .upload_idle_ns = 86400 * SECOND, .result_bytes = 1 << 30, .events_kept = 1024,
        .jobs_kept = 1 << 20,
        .secret = 0x1234567 };

    settings.workers = count;
    memset(runs, 0, sizeof runs);
    core = core_new(&settings, now);
    carry_out_all(core_loaded(core, now));
    for (slot = 0; slot < count; slot++)
        say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
    slot = 0;
}

/* Open stream NAME with a window of WINDOW samples every HOP; its ident is in `stream`. */
static void open_stream(const char *name, int window, int hop)
{
    char header[240];

    snprintf(header, sizeof header, "{\"id\":1,\"op\":\"open\",\"name\":\"%s\","
             "\"channels\":1,\"dt\":0.5,\"window\":{\"samples\":%d,\"hop\":%d,\"options\":{}}}",
             name, window, hop);
    say(WIRE_VERSION, "STREAM", header, NULL, 0);
}

static void push(const char *ident, int first, int count)
{
    double samples[64];
    char header[200];

    for (int i = 0; i < count; i++)
        samples[i] = (first + i) % 2 == 0 ? 1 : -1;
    snprintf(header, sizeof header, "{\"id\":2,\"op\":\"push\",\"stream\":\"%s\","
             "\"epoch\":0,\"first\":%d,\"count\":%d,\"crc32c\":%u}", ident, first, count,
             crc32c(0, samples, (size_t)count * sizeof *samples));
    say(WIRE_VERSION, "STREAM", header, samples, (size_t)count * sizeof *samples);
}

static void start(void)
{
    start_workers(1);
    open_stream("s", 8, 8);
    push(stream, 0, 8);
    CHECK(runs[0].told);                          /* the worker has the window */
    events = 0;
}

/* The stream is closed, and its samples are a batch. */
static void close_stream(void)
{
    char header[80];
    struct task *task;

    snprintf(header, sizeof header, "{\"id\":3,\"op\":\"close\",\"stream\":\"%s\"}", stream);
    say(WIRE_VERSION, "STREAM", header, NULL, 0);
    CHECK((task = sealing) != NULL);
    sealing = NULL;
    step((struct event) { .type = EVENT_TASK, .task = task });
}

/* The window's worker ends it with DOCUMENT. */
static void found(const char *document)
{
    char header[80];

    snprintf(header, sizeof header, "{\"job\":\"live\",\"attempt\":%s}",
             runs[slot].attempt);
    say(WIRE_WORKER, "DONE", header, document, strlen(document));
}

TEST(a_worker_that_tells_100000_births_of_tracks_makes_no_more_events_than_tracks_are_followed)
{
    char *document = malloc(32 + 100000 * 3), *at = document;

    CHECK(document != NULL);
    at += sprintf(at, "{\"track_edges\":[{}");
    for (int i = 1; i < 100000; i++)
        at += sprintf(at, ",{}");
    strcpy(at, "]}");
    start();
    found(document);
    CHECK(events == 1 + 512);
    free(document);
    core_free(core);
}

TEST(a_worker_cannot_put_another_streams_name_into_an_event_of_a_track)
{
    start();
    found("{\"track_edges\":[[1,2],7,{\"track\":3,\"stream\":\"other\",\"state\":\"born\"}]}");
    CHECK(events == 1 + 1);
    CHECK(strstr(last_event, "\"stream\":\"s\"") != NULL);
    CHECK(strstr(last_event, "other") == NULL && strstr(last_event, "\"track\":3") != NULL);
    core_free(core);
}

/* ---- turns ----------------------------------------------------------------------------------- */

enum {
    STREAMS_MOST = 400, WINDOW = 32, HOP = 2,
    COST = 5,             /* ticks of a worker for a window that it goes on with, on average */
    ANEW = 15 * COST,     /* for one that it has not */
    MEASURED = 120        /* hops, once each stream has had a window */
};

/* `worker`: where its window is; `had`: its windows since all of them have had one; `again`: those
 * of them that the same worker had as the one before. */
static struct simulated { char ident[9]; int sent, worker, had, again; } all[STREAMS_MOST];

/* Ticks that the run of the worker `slot` takes. */
static int begin_run(uint64_t *dice)
{
    const int which = atoi(runs[slot].stream) - 1;
    const bool again = which >= 0 && which < STREAMS_MOST && all[which].worker == slot;

    CHECK(which >= 0 && which < STREAMS_MOST);
    all[which].had++;
    all[which].again += again;
    all[which].worker = slot;
    *dice = *dice * 6364136223846793005u + 1442695040888963407u;
    return again ? COST - 1 + (int)((*dice >> 33) % 3) : ANEW;
}

/* The worker `slot` at TICK: it ends what it has had long enough, and begins what it is told. */
static void work(int tick, int *until, uint64_t *dice)
{
    if (runs[slot].told && *until <= tick && *until > 0) {
        runs[slot].told = false;
        found("{\"modes\":[]}");
        say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
        *until = 0;
    }
    if (runs[slot].told && *until == 0)
        *until = tick + begin_run(dice);
}

/* STREAMS that push HOP samples in every hop, each at its own time of it, for as many as HOPS;
 * their windows take LOAD times what the workers have. */
static void run_streams(int workers, int streams, double load, int hops)
{
    const int ticks = (int)(streams * COST / workers / load);
    int until[WORKERS] = { 0 };
    uint64_t dice = 88172645463325252u;

    for (int tick = 0; tick < hops * ticks; tick++, now.mono_ns += SECOND / 1000) {
        for (int k = 0; k < streams; k++)
            if ((tick + k) % ticks == 0) {
                push(all[k].ident, all[k].sent, HOP);
                all[k].sent += HOP;
            }
        for (slot = 0; slot < workers; slot++)
            work(tick, &until[slot], &dice);
        slot = 0;
    }
}

/* The least and the most windows that a stream had in MEASURED hops, and how many of all were gone
 * on with, once each has had one. */
static void measure_turns(int workers, int streams, double load, int *least, int *most,
                          double *kept)
{
    int told = 0, again = 0;
    char name[16];

    *least = INT_MAX;
    *most = 0;

    start_workers(workers);
    for (int k = 0; k < streams; k++) {
        snprintf(name, sizeof name, "s%d", k);
        open_stream(name, WINDOW, HOP);
        all[k] = (struct simulated) { .sent = WINDOW - HOP, .worker = -1 };
        memcpy(all[k].ident, stream, sizeof stream);
        push(stream, 0, WINDOW - HOP);
    }
    run_streams(workers, streams, load, 6 * ANEW / COST);
    for (int k = 0; k < streams; k++)
        all[k].had = all[k].again = 0;
    run_streams(workers, streams, load, MEASURED);
    for (int k = 0; k < streams; k++) {
        *least = all[k].had < *least ? all[k].had : *least;
        *most = all[k].had > *most ? all[k].had : *most;
        told += all[k].had;
        again += all[k].again;
    }
    *kept = (double)again / told;
    core_free(core);
}

TEST(streams_that_ask_for_three_times_what_workers_have_get_as_many_windows_each_to_a_fifth)
{
    static const int cases[][2] = { { 2, 400 }, { 8, 120 }, { 2, 20 } };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int least, most;
        double kept;
        measure_turns(cases[i][0], cases[i][1], 3, &least, &most, &kept);
        printf("%d workers, %d streams: %d to %d windows, gone on with %.3f\n", cases[i][0],
               cases[i][1], least, most, kept);
        CHECK(least > 0 && most <= 1.2 * least && kept >= 0.9);
    }
}

/* A window at either end of what is measured may be that of the hop before. */
TEST(streams_that_ask_for_seven_tenths_of_what_workers_have_get_every_window)
{
    static const int cases[][2] = { { 2, 400 }, { 8, 120 }, { 2, 20 } };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int least, most;
        double kept;
        measure_turns(cases[i][0], cases[i][1], 0.7, &least, &most, &kept);
        printf("%d workers, %d streams: %d to %d windows of %d, gone on with %.3f\n", cases[i][0],
               cases[i][1], least, most, MEASURED, kept);
        CHECK(least >= MEASURED - 1 && most <= MEASURED + 1);
    }
}

TEST(a_batch_has_the_verdict_of_a_window_that_ends_before_its_stream_is_closed_and_of_one_after)
{
    for (int late = 0; late < 2; late++) {
        start();
        last_verdict[0] = 0;
        if (late)
            close_stream();
        CHECK(last_verdict[0] == 0);
        found("{\"modes\":[],\"stability\":{\"stable\":false}}");
        CHECK(window_noted == !late);              /* of a closed one nothing is left behind */
        if (!late)
            close_stream();
        CHECK(strcmp(last_verdict, "unstable") == 0 && !window_noted);
        core_free(core);
    }
}
