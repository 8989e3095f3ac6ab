/* Tests as well: window_turns.c */
/*
 * test_windows.c - whose turn a live window is, with workers that each take their time; and what a
 * worker says of one, as one that was taken over might
 */
#include "check.h"
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "base/crc32c.h"
#include "broker/core/core.h"
#include "broker/core/slots.h"
#include "broker/core/state.h"
#include "wire/frame.h"

enum { WORKERS = 8, RUNS_MOST = 80 };

static struct core *core;
static struct transaction *waiting;
/* What each worker was told to run and has not ended yet, the oldest first. */
static struct run { char attempt[32], stream[32]; } runs[WORKERS][RUNS_MOST];
static int told[WORKERS];
static char stream[9];
static int events, heard;          /* heard: EVENTs to subscribers */
/* Of each subscription its EVENTs and the number of the last; of each topic, by its first letter,
 * its events. */
static int heard_by[5000], events_of[256];
static int64_t heard_last[5000];
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
    free(live);
    cJSON_Delete(read);
}

/* No number comes twice, nor before a smaller one. */
static void hear(const char *header)
{
    char subscription[24] = "0", number[24] = "0";
    int by;

    remember(header, "subscription", subscription, sizeof subscription);
    remember(header, "number", number, sizeof number);
    by = atoi(subscription);
    CHECK(by > 0 && by < 5000 && atoll(number) > heard_last[by]);
    heard_last[by] = atoll(number);
    heard_by[by]++;
    heard++;
}

/* Of a stream with NOTES_MOST beside it at most the notes that were committed last: how it was
 * opened, and of its windows. */
enum { NOTES_MOST = 8 };
static struct note { char name[24], text[400]; } notes[2][NOTES_MOST];
static bool notes_kept;

static void keep_note(const struct note_record *r)
{
    const int kind = strcmp(r->topic, "window") == 0;
    int at = 0;

    if (!kind && strcmp(r->topic, "stream") != 0)
        return;
    while (at < NOTES_MOST && notes[kind][at].name[0] != 0
           && strcmp(notes[kind][at].name, r->name) != 0)
        at++;
    CHECK(at < NOTES_MOST);
    snprintf(notes[kind][at].name, sizeof notes[kind][at].name, "%s", r->name);
    snprintf(notes[kind][at].text, sizeof notes[kind][at].text, "%s", r->text ? r->text : "");
}

static void carry_out(const struct action *a)
{
    if (a->type == ACT_COMMIT) {
        a->transaction->next = waiting;
        waiting = a->transaction;
        for (size_t i = 0; i < waiting->count; i++)
            if (waiting->changes[i].verb == LEDGER_EVENT_PUT) {
                events++;
                events_of[(unsigned char)waiting->changes[i].event.topic[0]]++;
                snprintf(last_event, sizeof last_event, "%s", waiting->changes[i].event.text);
            } else if (notes_kept && waiting->changes[i].verb == LEDGER_NOTE_PUT)
                keep_note(&waiting->changes[i].note);
            else if (waiting->changes[i].verb == LEDGER_NOTE_PUT
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
    if (a->type == ACT_SEND && strcmp(a->verb, "EVENT") == 0)
        hear(a->header);
    else if (a->type == ACT_SEND)
        remember(a->header, "stream", stream, sizeof stream);
    if (a->type == ACT_WORKER && strcmp(a->verb, "RUN") == 0) {
        CHECK(told[a->slot] < RUNS_MOST);
        remember_run(a->header, &runs[a->slot][told[a->slot]++]);
    }
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

/* All of COUNT workers are ready. */
static void be_ready(int count)
{
    for (slot = 0; slot < count; slot++)
        say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
    slot = 0;
}

/* A daemon of COUNT workers, none ready, that has the notes that are kept. */
static void start_daemon(int count)
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

    struct ledger_visitor visitor;

    settings.workers = count;
    memset(told, 0, sizeof told);
    memset(heard_by, 0, sizeof heard_by);
    memset(heard_last, 0, sizeof heard_last);
    memset(events_of, 0, sizeof events_of);
    core = core_new(&settings, now);
    core_visitor(core, &visitor);
    for (int i = 0; notes_kept && i < 2 * NOTES_MOST; i++) {
        const struct note *note = &notes[i / NOTES_MOST][i % NOTES_MOST];
        const char *topic = i < NOTES_MOST ? "stream" : "window";
        if (note->name[0] != 0)
            visitor.note(visitor.context,
                         &(struct note_record) { topic, note->name, note->text });
    }
    carry_out_all(core_loaded(core, now));
}

static void start_workers(int count)
{
    start_daemon(count);
    be_ready(count);
}

/* Open stream NAME with a window of WINDOW samples every HOP; its ident is in `stream`. */
static void open_stream(const char *name, int window, int hop)
{
    char header[600];

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
    snprintf(header, sizeof header, "{\"id\":2,\"op\":\"push\",\"stream\":\"%.8s\","
             "\"epoch\":0,\"first\":%d,\"count\":%d,\"crc32c\":%u}", ident, first, count,
             crc32c(0, samples, (size_t)count * sizeof *samples));
    say(WIRE_VERSION, "STREAM", header, samples, (size_t)count * sizeof *samples);
}

/* COUNT streams named s0 .., whose idents are in IDENTS, each with a window's samples. */
static void open_full(int count, char idents[][9])
{
    char name[16];

    for (int k = 0; k < count; k++) {
        snprintf(name, sizeof name, "s%d", k);
        open_stream(name, 8, 2);
        memcpy(idents[k], stream, sizeof stream);
        push(stream, 0, 8);
    }
}

static void start(void)
{
    start_workers(1);
    open_stream("s", 8, 8);
    push(stream, 0, 8);
    CHECK(told[0] == 1);                          /* the worker has the window */
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

/* The window's worker ends it with DOCUMENT, after so long, which it tells where that is not 0. */
static double cpu_s;

static void found(const char *document)
{
    char header[80];

    snprintf(header, sizeof header, "{\"job\":\"live\",\"attempt\":%s,\"cpu_s\":%g}",
             runs[slot][0].attempt, cpu_s);
    memmove(runs[slot], runs[slot] + 1, (size_t)--told[slot] * sizeof *runs[slot]);
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

/* The worker ends the first that it has, and is idle then, or goes on. */
static void end_one(void)
{
    found("{\"modes\":[]}");
    say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
}

static void end_all(void)
{
    while (told[slot] > 0)
        end_one();
}

/* ---- subscribers ----------------------------------------------------------------------------- */

static void subscribe(const char *name)
{
    char header[80];

    snprintf(header, sizeof header, "{\"id\":4,\"stream\":\"%s\"}", name);
    say(WIRE_VERSION, "EVENTS", header, NULL, 0);
}

/* Of COUNT subscriptions one is of the stream that has windows: processor's ns of each of these,
 * the least of three times 200. */
static double window_ns(int count)
{
    double least = HUGE_VAL;
    char name[24], ident[9];
    int sent = 8;

    start_workers(1);
    open_stream("s", 8, 2);
    memcpy(ident, stream, sizeof stream);
    for (int k = 1; k < count; k++) {
        snprintf(name, sizeof name, "other%d", k);
        subscribe(name);
    }
    subscribe("s");
    push(ident, 0, 8);
    found("{\"modes\":[]}");
    for (int repeat = 0; repeat < 3; repeat++) {
        const clock_t from = clock();
        heard = 0;
        for (int k = 0; k < 200; k++, sent += 2) {
            say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
            push(ident, sent, 2);
            found("{\"modes\":[]}");
        }
        least = fmin(least, (double)(clock() - from) / CLOCKS_PER_SEC * 1e9 / 200);
        CHECK(heard == 200);
    }
    core_free(core);
    return least;
}

/* 0.25 us for each of the others made three times as much of it. */
TEST(what_a_window_costs_does_not_grow_with_the_subscriptions_of_other_streams)
{
    const double few = window_ns(40), many = window_ns(4000);

    printf("%.0f ns a window beside 40 subscriptions, %.0f beside 4000\n", few, many);
    CHECK(many < 2 * few);
}

/* Subscription 1 is of `t` as it goes on, 2 of `s`, made in the middle, from the first event on. */
TEST(who_subscribes_to_one_of_two_streams_is_told_each_of_its_events_once_and_in_order)
{
    char s[9], other[9];

    start_workers(1);
    open_stream("s", 8, 2);
    memcpy(s, stream, sizeof stream);
    open_stream("t", 8, 2);
    memcpy(other, stream, sizeof stream);
    subscribe("t");
    push(s, 0, 8);
    push(other, 0, 8);
    for (int k = 0; k < 200; k++) {
        if (k == 100)
            say(WIRE_VERSION, "EVENTS", "{\"id\":5,\"stream\":\"s\",\"from\":1}", NULL, 0);
        end_all();
        push(s, 8 + 2 * k, 2);
        if (k % 3 == 0)
            push(other, 8 + 2 * (k / 3), 2);
    }
    end_all();
    CHECK(events_of['s'] == 201 && events_of['t'] == 1 + 67);
    CHECK(heard_by[1] == events_of['t'] && heard_by[2] == events_of['s']);
    core_free(core);
}

/* ---- ahead ----------------------------------------------------------------------------------- */

/* Of windows of 1 ms each more than 20 ms are ahead of a worker, of 30 ms one, behind the one that
 * it works on. */
TEST(a_worker_has_its_next_windows_while_it_works_on_one_as_many_as_last_20_ms)
{
    static const struct { double cpu_s; int told; } cases[] = { { 0.001, 21 }, { 0.03, 2 } };
    char idents[40][9];

    events = 0;
    for (size_t i = 0; i < 2; i++) {
        cpu_s = cases[i].cpu_s;
        start_workers(1);
        open_full(40, idents);
        end_all();
        for (int k = 0; k < 40; k++)
            push(idents[k], 8, 2);
        CHECK(told[0] >= cases[i].told && told[0] <= cases[i].told + 1);
        end_all();
        CHECK(events == 80);
        events = 0;
        core_free(core);
    }
    cpu_s = 0;
}

/* The worker of slot 0 is another, and ready; what it had is in DIED, how many that were. */
static int die(struct run died[RUNS_MOST])
{
    const int had = told[0];

    memcpy(died, runs[0], (size_t)had * sizeof *died);
    told[0] = 0;
    step((struct event) { .type = EVENT_EXIT, .slot = 0, .status = 9, .stderr_text = "" });
    now.mono_ns += 10 * SECOND;
    step((struct event) { .type = EVENT_TIME });
    say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
    return had;
}

/* What a worker had done it may not have told: which of those that it had has killed it, nobody
 * knows. */
TEST(of_a_worker_that_dies_each_window_that_it_had_goes_to_the_next_with_no_other_beside_it)
{
    struct run had[RUNS_MOST], again[RUNS_MOST];
    char idents[3][9];
    int count;

    events = 0;
    start_workers(1);
    open_full(3, idents);
    CHECK(told[0] == 2);
    count = die(had);
    CHECK(events == 0 && count == 2);
    for (int k = 0; k < 3; k++) {
        CHECK(told[0] == 1);
        end_one();
    }
    CHECK(events == 3);
    count = die(again);
    CHECK(count == 0);
    for (int k = 0; k < 3; k++)
        push(idents[k], 8, 2);
    CHECK(told[0] == 2);                           /* that is past */
    core_free(core);
}

/* Its first worker has told nothing of the one before it. */
TEST(a_window_that_kills_workers_behind_others_at_first_is_told_worker_died_after_the_third)
{
    struct run had[RUNS_MOST];
    char idents[3][9], killer[32];
    int alone = 0, deaths = 0;

    events = 0;
    start_workers(1);
    open_full(3, idents);
    CHECK(told[0] == 2);
    memcpy(killer, runs[0][1].stream, sizeof killer);
    for (; deaths < 10 && events < 3; deaths++) {
        const int count = die(had);
        alone += count == 1;
        while (told[0] > 0 && strcmp(runs[0][0].stream, killer) != 0)
            end_one();
    }
    CHECK(deaths == 3 && alone == 2 && events == 3 && strstr(last_event, "worker_died") != NULL);
    core_free(core);
}

/* Twice by itself, and then behind another: a fourth worker would be lost to it. */
TEST(a_window_whose_worker_died_though_it_had_no_other_has_none_beside_it_with_the_next)
{
    struct run had[RUNS_MOST];
    char idents[1][9];

    start_workers(1);
    open_full(1, idents);
    CHECK(told[0] == 1 && die(had) == 1 && told[0] == 1);
    open_stream("another", 8, 2);
    push(stream, 0, 8);
    CHECK(told[0] == 1);
    end_one();
    CHECK(told[0] == 1);                           /* the other, by itself as it came */
    core_free(core);
}

/* It would be sent a megabyte as often as it likes, and nobody told. */
TEST(a_worker_that_asks_again_for_a_window_that_it_has_whole_is_ended)
{
    char header[120];

    start_workers(1);
    open_stream("s", 8, 8);
    push(stream, 0, 8);
    CHECK(told[0] == 1);
    snprintf(header, sizeof header, "{\"job\":\"live\",\"attempt\":%s,\"error\":"
             "{\"code\":\"not_found\",\"field\":\"live\"}}", runs[0][0].attempt);
    say(WIRE_WORKER, "FAILED", header, NULL, 0);
    CHECK(told[0] == 1 && core->slots->at[0].state == SLOT_KILLED);
    core_free(core);
}

/* BEAT after BEAT, and no READY: the slot was gone, and no line told so. */
TEST(a_worker_that_has_ended_its_work_and_asks_for_none_is_ended_after_its_lease)
{
    start_workers(1);
    open_stream("s", 8, 8);
    push(stream, 0, 8);
    found("{}");
    CHECK(core->slots->at[0].state == SLOT_TAKEN);
    for (int k = 0; k < 11; k++) {
        now.mono_ns += SECOND;
        say(WIRE_WORKER, "BEAT", "{}", NULL, 0);
        step((struct event) { .type = EVENT_TIME });
    }
    CHECK(core->slots->at[0].state == SLOT_KILLED);
    core_free(core);
}

/* Its second window's cost is not known before it was done, and was taken for one that no other may
 * take: a free worker rested for as long as the window before it went on, 60 s at most. */
TEST(a_second_window_behind_one_that_hangs_is_taken_by_a_worker_that_is_free)
{
    char idents[3][9];

    start_daemon(2);
    slot = 0;
    say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
    cpu_s = 0.03;                         /* one is ahead of its turn */
    open_full(3, idents);
    for (int k = 0; k < 3; k++) {
        found("{}");
        say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
    }
    for (int k = 0; k < 3; k++)
        push(idents[k], 8, 2);
    slot = 1;
    say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
    CHECK(told[0] == 2 && told[1] == 1);
    cpu_s = 0;
    core_free(core);
}

/* The lease counts from READY, not from when it was begun. */
TEST(a_worker_that_is_ready_late_in_its_lease_is_not_ended_for_want_of_a_beat)
{
    start_daemon(1);
    now.mono_ns += 4 * SECOND;
    be_ready(1);
    now.mono_ns += 2 * SECOND;
    step((struct event) { .type = EVENT_TIME });
    CHECK(core->slots->at[0].state == SLOT_IDLE);
    core_free(core);
}

/* 1 ms each, from nothing too: as many are ahead as of those that it goes on with. */
TEST(a_worker_that_is_new_has_as_many_windows_ahead_as_last_20_ms_by_what_they_took_anew_before)
{
    char idents[40][9];

    cpu_s = 0.001;
    start_workers(1);
    open_full(40, idents);
    end_all();
    step((struct event) { .type = EVENT_EXIT, .slot = 0, .status = 9, .stderr_text = "" });
    now.mono_ns += 10 * SECOND;
    step((struct event) { .type = EVENT_TIME });
    say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
    for (int k = 0; k < 40; k++)
        push(idents[k], 8, 2);
    CHECK(told[0] >= 21 && told[0] <= 22);
    end_all();
    core_free(core);
    cpu_s = 0;
}

/* Of two jobs each, by the configuration: it is stopped by these, and takes its windows along. */
TEST(a_worker_is_not_stopped_for_the_windows_that_it_has_had)
{
    start_workers(1);
    core->settings.worker_jobs = 2;
    open_stream("s", 8, 2);
    push(stream, 0, 8);
    for (int k = 0; k < 10; k++) {
        CHECK(told[0] == 1);
        end_all();
        push(stream, 8 + 2 * k, 2);
    }
    CHECK(told[0] == 1 && core->slots->at[0].state == SLOT_BUSY);
    core_free(core);
}

/* Four windows of 0.6 s at one worker, and 1 s until the next: the fourth would be left out. */
TEST(a_free_worker_takes_what_another_would_not_do_before_the_next_is_due)
{
    char idents[4][9];

    cpu_s = 0.6;
    start_workers(2);
    slot = 1;
    open_stream("other", 8, 8);
    push(stream, 0, 8);                            /* the first has it ... */
    slot = 0;
    CHECK(told[0] == 1 && told[1] == 0);
    open_full(4, idents);                          /* ... and these are shared by both */
    while (told[0] + told[1] > 0)
        for (slot = 0; slot < 2; slot++)
            end_all();
    slot = 0;
    for (int k = 0; k < 4; k++)
        push(idents[k], 8, 2);
    CHECK(told[0] > 0 && told[1] > 0 && told[0] + told[1] == 4);
    core_free(core);
    cpu_s = 0;
}

/* ---- turns ----------------------------------------------------------------------------------- */

enum {
    STREAMS_MOST = 400, WINDOW = 32, HOP = 2,
    COST = 5,             /* ticks of a worker for a window that it goes on with, on average */
    ANEW = 15 * COST,     /* for one that it has not */
    MEASURED = 120        /* hops, once each stream has had a window */
};

/* `worker`: where its window is; `had`: its windows since all of them have had one; `again`: those
 * of them that the same worker had as the one before; `times`: COST that they take, 0 is one. */
static struct simulated { char ident[9]; int sent, worker, had, again, times; } all[STREAMS_MOST];

/* Ticks for a window that a worker has not; 0: as many as for one that it goes on with. */
static int anew = ANEW;
static int64_t left_out;           /* while it was measured */
static int took[WORKERS];           /* ticks of the run that each has */
static bool costs_vary;            /* by a factor of 41, and are COST on average */

/* Ticks that the run of the worker `slot` takes. */
static int begin_run(uint64_t *dice)
{
    const int which = atoi(runs[slot][0].stream) - 1;
    const bool again = which >= 0 && which < STREAMS_MOST && all[which].worker == slot,
               dear = !again && anew > 0;
    int times;

    CHECK(which >= 0 && which < STREAMS_MOST);
    times = all[which].times > 0 ? all[which].times : 1;
    all[which].had++;
    all[which].again += again;
    all[which].worker = slot;
    *dice = *dice * 6364136223846793005u + 1442695040888963407u;
    if (!dear && costs_vary)
        return (*dice >> 33) % 10 < 9 ? COST - 4 : COST + 36;
    return times * (dear ? anew : COST) + (dear ? 0 : (int)((*dice >> 33) % 3) - 1);
}

/* The worker `slot` at TICK: it ends what it has had long enough, and begins what it is told. */
static void work(int tick, int *until, uint64_t *dice)
{
    if (told[slot] > 0 && *until <= tick && *until > 0) {
        cpu_s = took[slot] / 1000.0;
        found("{\"modes\":[]}");
        say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
        *until = 0;
    }
    if (told[slot] > 0 && *until == 0)
        *until = tick + (took[slot] = begin_run(dice));
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
    int had = 0, again = 0;
    int64_t before;
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
    before = core->slots->windows_skipped;
    run_streams(workers, streams, load, MEASURED);
    for (int k = 0; k < streams; k++) {
        *least = all[k].had < *least ? all[k].had : *least;
        *most = all[k].had > *most ? all[k].had : *most;
        had += all[k].had;
        again += all[k].again;
    }
    *kept = (double)again / had;
    left_out = core->slots->windows_skipped - before;
    cpu_s = 0;
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

/* Nine of ten windows cost 1, the tenth 41.  Where one that is not gone on with costs 75, workers
 * that took what was late of others were late by that themselves: 0.087 were left out.  The others
 * cost the same for any worker, who yet rested while others had less than a hop to do: 0.045. */
TEST(where_costs_vary_moving_windows_saves_more_than_it_takes_and_thinning_stays_fair)
{
    check_slow();
    static const struct { int workers, streams, anew; double load, most; } cases[] = {
        { 8, 120, ANEW, 0.7, 0.03 }, { 2, 100, 0, 0.9, 0.02 }, { 2, 50, 0, 1.2, 0.25 } };

    costs_vary = true;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int least, most;
        double kept, lost;
        anew = cases[i].anew;
        measure_turns(cases[i].workers, cases[i].streams, cases[i].load, &least, &most, &kept);
        lost = (double)left_out / (cases[i].streams * MEASURED);
        printf("%d workers, %d streams, load %g: %d to %d windows, gone on with %.3f, %.4f left "
               "out\n", cases[i].workers, cases[i].streams, cases[i].load, least, most, kept,
               lost);
        CHECK(lost <= cases[i].most && most <= 1.5 * least);
    }
    anew = ANEW;
    costs_vary = false;
}

/* TICKS in which COUNT streams push at HOPS and WORKERS work. */
static void run_uneven(int workers, int count, const int *hops, int ticks)
{
    int until[WORKERS] = { 0 };
    uint64_t dice = 88172645463325252u;

    for (int tick = 0; tick < ticks; tick++, now.mono_ns += SECOND / 1000) {
        for (int k = 0; k < count; k++)
            if (tick % hops[k] == 0) {
                push(all[k].ident, all[k].sent, HOP);
                all[k].sent += HOP;
            }
        for (slot = 0; slot < workers; slot++)
            work(tick, &until[slot], &dice);
        slot = 0;
    }
}

static void open_uneven(int count)
{
    char name[16];

    for (int k = 0; k < count; k++) {
        snprintf(name, sizeof name, "s%d", k);
        open_stream(name, WINDOW, HOP);
        all[k] = (struct simulated) { .sent = 0, .worker = -1 };
        memcpy(all[k].ident, stream, sizeof stream);
    }
}

/* Windows that STREAMS have in as many ticks as a mean stream takes for MEAN, where they ask for
 * three times what WORKERS have, and take 1 to KINDS times COST by turns; the same again before. */
static void measure_few(int workers, int streams, int kinds, int mean, int *least, int *most)
{
    int work = 0, hops;
    char name[16];

    start_workers(workers);
    for (int k = 0; k < streams; k++) {
        snprintf(name, sizeof name, "s%d", k);
        open_stream(name, WINDOW, HOP);
        all[k] = (struct simulated) { .sent = WINDOW - HOP, .worker = -1, .times = 1 + k % kinds };
        memcpy(all[k].ident, stream, sizeof stream);
        push(stream, 0, WINDOW - HOP);
        work += 1 + k % kinds;
    }
    hops = (int)(3.0 * mean * work / streams);     /* run_streams takes streams for COST each */
    run_streams(workers, streams, 3, hops / 2);
    for (int k = 0; k < streams; k++)
        all[k].had = 0;
    run_streams(workers, streams, 3, hops);
    *least = INT_MAX, *most = 0;
    for (int k = 0; k < streams; k++) {
        *least = all[k].had < *least ? all[k].had : *least;
        *most = all[k].had > *most ? all[k].had : *most;
    }
    cpu_s = 0;
    core_free(core);
}

/* A worker with one stream beside one with two: the one had twice the windows of each of these, for
 * good, and so two beside four.  What a move waits for comes to it, twice what it takes more, and
 * what others have meanwhile. */
TEST(of_few_streams_none_has_more_than_one_and_a_half_times_the_windows_of_another_for_long)
{
    static const struct { int workers, streams, kinds; } cases[] = {
        { 2, 3, 1 }, { 3, 5, 1 }, { 3, 10, 1 }, { 8, 12, 1 }, { 4, 5, 2 } };
    const int moved = 3 * (ANEW - COST) / COST;

    check_slow();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int least, most;
        measure_few(cases[i].workers, cases[i].streams, cases[i].kinds, 400, &least, &most);
        printf("%d workers, %d streams of %d kinds: %d to %d windows\n", cases[i].workers,
               cases[i].streams, cases[i].kinds, least, most);
        CHECK(most <= 1.5 * least + moved);
    }
}

/* A stream that takes all of its worker's time, and now and then leaves a window out, and one that
 * takes a third of the other's, which has nothing to do then: with both it would have more than
 * time.  Taken there once as much was left out as that takes, each was moved all the time. */
TEST(two_streams_that_have_a_worker_each_stay_there_though_windows_are_left_out)
{
    static const int hops[] = { COST, 3 * COST };

    start_workers(2);
    open_uneven(2);
    run_uneven(2, 2, hops, 200 * ANEW);
    printf("%d of %d windows, %d of %d anew\n", all[0].had, 200 * ANEW / COST,
           all[0].had - all[0].again, all[1].had - all[1].again);
    CHECK(all[0].had - all[0].again == 1 && all[1].had - all[1].again == 1);
    cpu_s = 0;
    core_free(core);
}

/* WORKERS of which the first has two streams and the second one. */
static void start_crowded(int workers)
{
    static const int first[] = { 0, 0, 1 };

    start_daemon(workers);
    open_uneven(3);
    for (int k = 0; k < 3; k++) {
        slot = first[k];
        say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
        push(all[k].ident, 0, WINDOW);
        CHECK(told[slot] == 1);
        cpu_s = ANEW / 1000.0;
        found("{\"modes\":[]}");
        all[k].worker = slot;
        all[k].sent = WINDOW;
    }
    be_ready(workers);
}

/* The first worker's two take more than all of its time; the second has as much to do as that
 * leaves no room for one more; the third rests. */
TEST(a_worker_that_rests_takes_one_of_two_that_have_too_little_time_whoever_asks_beside_it)
{
    static const int hops[] = { 8, 8, 7 };

    start_crowded(3);
    run_uneven(3, 3, hops, 10000);
    CHECK(all[0].worker + all[1].worker == 0 + 2 && all[2].worker == 1);
    cpu_s = 0;
    core_free(core);
}

/* What a stream asked for that is closed is not asked for any more, though it was just now. */
TEST(a_worker_whose_stream_is_closed_takes_one_of_two_that_have_too_little_time)
{
    static const int hops[] = { 8, 8, 6 };

    start_crowded(2);
    run_uneven(2, 3, hops, 10000);
    CHECK(all[0].worker == 0 && all[1].worker == 0 && all[2].worker == 1);
    memcpy(stream, all[2].ident, sizeof stream);
    close_stream();
    run_uneven(2, 2, hops, 1000);
    CHECK(all[0].worker != all[1].worker);
    cpu_s = 0;
    core_free(core);
}

/* Of 0.3 that the worker has to do, what comes each 600 ms takes 100 in a row; the first stream's
 * next window is due after 40. */
TEST(a_stream_of_short_hops_waits_for_no_turn_of_those_that_have_time_and_none_is_left_out)
{
    enum { SLOW = 20, EACH = 600, SHORT = 40 };
    int until = 0;
    char name[16];
    uint64_t dice = 88172645463325252u;

    anew = 0;
    start_workers(1);
    for (int k = 0; k <= SLOW; k++) {
        snprintf(name, sizeof name, "s%d", k);
        open_stream(name, WINDOW, HOP);
        all[k] = (struct simulated) { .sent = 0, .worker = -1 };
        memcpy(all[k].ident, stream, sizeof stream);
    }
    for (int tick = 0; tick < 40 * EACH; tick++, now.mono_ns += SECOND / 1000) {
        for (int k = 0; k <= SLOW; k++)
            if (tick % (k == 0 ? SHORT : EACH) == 0) {
                push(all[k].ident, all[k].sent, HOP);
                all[k].sent += HOP;
            }
        slot = 0;
        work(tick, &until, &dice);
    }
    CHECK(all[0].had >= 40 * EACH / SHORT - WINDOW / HOP && all[SLOW].had >= 24);
    printf("%lld left out\n", (long long)core->slots->windows_skipped);
    CHECK(core->slots->windows_skipped == 0);
    anew = ANEW;
    cpu_s = 0;
    core_free(core);
}

/* ---- all at once ----------------------------------------------------------------------------- */

enum { TOGETHER = 40, HOP_SAMPLES = 16 };

/* TOGETHER streams that push a sample each at the same ticks, for HOPS hops; in one of PERIOD, from
 * its middle on, workers begin nothing for PAUSE of a hop. */
static void run_together(int workers, double load, int hops, int period, double pause)
{
    const int ticks = (int)(TOGETHER * COST / workers / load / HOP_SAMPLES);
    const int hop = ticks * HOP_SAMPLES;
    int until[WORKERS] = { 0 };
    uint64_t dice = 88172645463325252u;

    for (int tick = 0; tick < hops * hop; tick++, now.mono_ns += SECOND / 1000) {
        const int within = (tick + hop / 2) % (period * hop);
        for (int k = 0; k < TOGETHER; k++)
            if (tick % ticks == 0)
                push(all[k].ident, all[k].sent++, 1);
        for (slot = 0; slot < workers && within >= pause * hop; slot++)
            work(tick, &until[slot], &dice);
        slot = 0;
    }
}

/* Workers have 0.7 of a hop to do in each.  All due at its beginning, the last would wait for 0.7
 * of it, and be left out where nothing is begun for 0.6. */
TEST(of_streams_that_begin_together_no_window_is_left_out_where_workers_pause_for_0_6_of_a_hop)
{
    int64_t skipped;
    char name[16];

    start_workers(2);
    for (int k = 0; k < TOGETHER; k++) {
        snprintf(name, sizeof name, "s%d", k);
        open_stream(name, WINDOW, HOP_SAMPLES);
        all[k] = (struct simulated) { .sent = 0, .worker = -1 };
        memcpy(all[k].ident, stream, sizeof stream);
    }
    run_together(2, 0.7, 40, 41, 0);
    skipped = core->slots->windows_skipped;
    for (int k = 0; k < TOGETHER; k++)
        all[k].had = 0;
    run_together(2, 0.7, 60, 6, 0.6);
    for (int k = 0; k < TOGETHER; k++)
        CHECK(all[k].had >= 59 && all[k].had <= 61);
    printf("%lld left out\n", (long long)(core->slots->windows_skipped - skipped));
    CHECK(core->slots->windows_skipped == skipped);
    core_free(core);
}

/* ---- a restart ------------------------------------------------------------------------------- */

/* Six streams wait for one worker, which has ended three of their second windows; started again, it
 * is ready when all wait. */
TEST(when_the_daemon_starts_again_who_had_no_window_in_a_round_has_one_before_those_who_had)
{
    char idents[6][9], had[3][32];

    memset(notes, 0, sizeof notes);
    notes_kept = true;
    cpu_s = 0.03;
    start_workers(1);
    open_full(6, idents);
    end_all();
    for (int k = 0; k < 6; k++)
        push(idents[k], 8, 2);
    for (int k = 0; k < 3; k++) {
        memcpy(had[k], runs[0][0].stream, sizeof had[k]);
        end_one();
    }
    core_free(core);
    start_daemon(1);
    for (int k = 0; k < 6; k++)
        push(idents[k], 10, 12);                   /* of each one is left out */
    be_ready(1);
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++)
            CHECK(strcmp(runs[0][0].stream, had[i]) != 0);
        end_one();
    }
    end_all();
    core_free(core);
    cpu_s = 0;
    notes_kept = false;
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
