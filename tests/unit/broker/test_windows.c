/*
 * test_windows.c - what a live window's worker says, as one that was taken over might
 */
#include "check.h"
#include <stdlib.h>
#include <string.h>
#include "base/crc32c.h"
#include "broker/core/core.h"
#include "broker/core/state.h"
#include "wire/frame.h"

static struct core *core;
static struct transaction *waiting;
static char stream[9], attempt[32];
static int events;
static char last_event[4096];

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

static void carry_out(const struct action *a)
{
    if (a->type == ACT_COMMIT) {
        a->transaction->next = waiting;
        waiting = a->transaction;
        for (size_t i = 0; i < waiting->count; i++)
            if (waiting->changes[i].verb == LEDGER_EVENT_PUT) {
                events++;
                snprintf(last_event, sizeof last_event, "%s", waiting->changes[i].event.text);
            }
        return;
    }
    if (a->type == ACT_TASK) {
        task_free(a->task);
        return;
    }
    if (a->type == ACT_SEND)
        remember(a->header, "stream", stream, sizeof stream);
    if (a->type == ACT_WORKER && strcmp(a->verb, "RUN") == 0)
        remember(a->header, "attempt", attempt, sizeof attempt);
    free(a->header);
    blob_drop(a->body);
}

static const struct moment now = { 1000 * SECOND, INT64_C(1790000000) * SECOND };

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

static void say(const char *version, const char *verb, const char *header, const void *body,
                size_t size)
{
    const bool asks = strcmp(version, WIRE_VERSION) == 0;
    struct blob *blobs[1] = { body != NULL ? blob_copy(body, size) : NULL };
    struct wire_frame frames[4] = { { version, 7 }, { verb, strlen(verb) },
                                    { header, strlen(header) }, { body, size } };
    struct wire_message m;

    CHECK(wire_open(frames, body != NULL ? 4 : 3, version, asks, &m, NULL) == MODAL_OK);
    step((struct event) { .type = asks ? EVENT_REQUEST : EVENT_WORKER, .peer = asks, .key = "",
                          .message = &m, .body = blobs });
    wire_close(&m);
    blob_drop(blobs[0]);
}

static void start(void)
{
    static struct account account = { .key = "", .user = "one", .role = WIRE_ROLE_ADMIN,
                                      .weight = 1 };
    static const struct settings settings = { .accounts = &account, .account_count = 1,
        .workers = 1, .cores = 2, .queue_jobs = 20, .input_bytes = 1 << 22,
        .window_bytes = 1 << 20, .lease_ns = 5 * SECOND, .result_age_ns = 3600 * SECOND,
        .input_age_ns = 60 * SECOND, .tombstone_age_ns = 86400 * SECOND,
        .upload_idle_ns = 86400 * SECOND, .result_bytes = 1 << 30, .events_kept = 1024,
        .secret = 0x1234567 };
    double samples[8] = { 1, -1, 1, -1, 1, -1, 1, -1 };
    char header[200];

    core = core_new(&settings, now);
    carry_out_all(core_loaded(core, now));
    say(WIRE_WORKER, "READY", "{\"job\":\"\",\"attempt\":0,\"pid\":7}", NULL, 0);
    say(WIRE_VERSION, "STREAM", "{\"id\":1,\"op\":\"open\",\"name\":\"s\",\"channels\":1,"
        "\"dt\":0.5,\"window\":{\"samples\":8,\"hop\":8,\"options\":{}}}", NULL, 0);
    snprintf(header, sizeof header, "{\"id\":2,\"op\":\"push\",\"stream\":\"%s\",\"epoch\":0,"
             "\"first\":0,\"count\":8,\"crc32c\":%u}", stream,
             crc32c(0, samples, sizeof samples));
    say(WIRE_VERSION, "STREAM", header, samples, sizeof samples);
    CHECK(attempt[0] != 0);                       /* the worker has the window */
    events = 0;
}

/* The window's worker ends it with DOCUMENT. */
static void found(const char *document)
{
    char header[80];

    snprintf(header, sizeof header, "{\"job\":\"live\",\"attempt\":%s}", attempt);
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
