/*
 * live_windows.c - see live_windows.h
 *
 * Streams take turns, so that where they are more than are kept the one that was used longest ago
 * is the very one that comes next: a table that drops it finds none.  So whichever is dropped; of
 * N in turn some are there again, and one of a stream that has ended goes, too.
 */
#include "worker/live_windows.h"
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "job/live.h"
#include "wire/protocol.h"

/* Of a window: an int holds it; the daemon allows far less. */
enum { SAMPLES_MOST = 1000000000 };

struct window {
    char *stream;                 /* NULL: free */
    double epoch, next;           /* next: the index of the first sample that is not here */
    struct live *live;
    size_t bytes;
    int64_t took_ms;              /* the last one */
};

struct live_windows {
    struct window all[WINDOWS_MOST];      /* the first `count` of them are in use */
    int count;
    size_t bytes;                         /* of all */
    uint64_t dice;
};

struct asked { const char *stream, *tracks; double epoch, to; int window, hop; };

struct live_windows *live_windows_new(void)
{
    struct live_windows *windows = calloc(1, sizeof *windows);

    if (windows != NULL)
        windows->dice = 1;
    return windows;
}

/* The last one has its place then. */
static void forget(struct live_windows *windows, struct window *w)
{
    windows->bytes -= w->bytes;
    free(w->stream);
    live_free(w->live);
    *w = windows->all[--windows->count];
}

void live_windows_free(struct live_windows *windows)
{
    while (windows != NULL && windows->count > 0)
        forget(windows, &windows->all[0]);
    free(windows);
}

static enum modal_status read_asked(const cJSON *live, struct asked *a, struct modal_error *err)
{
    enum modal_status rc = json_need_string(live, "live", "stream", &a->stream, err);

    if (rc == MODAL_OK)
        rc = json_need_number(live, "live", "epoch", 0, WIRE_INTEGER_MOST, &a->epoch, err);
    if (rc == MODAL_OK)
        rc = json_need_number(live, "live", "to", 0, WIRE_INTEGER_MOST, &a->to, err);
    if (rc == MODAL_OK)
        rc = json_get_int(live, "live", "window", 1, SAMPLES_MOST, &a->window, err);
    if (rc == MODAL_OK)
        rc = json_get_int(live, "live", "hop", 0, SAMPLES_MOST, &a->hop, err);
    if (rc == MODAL_OK)
        rc = json_get_string(live, "live", "tracks", &a->tracks, err);
    return rc;
}

/* Its place; -1: it is not here. */
static int find(const struct live_windows *windows, const char *stream)
{
    for (int i = 0; i < windows->count; i++)
        if (strcmp(windows->all[i].stream, stream) == 0)
            return i;
    return -1;
}

/* Room for one more of BYTES (xorshift64*). */
static void make_room(struct live_windows *windows, size_t bytes)
{
    while (windows->count == WINDOWS_MOST
           || (windows->count > 0 && windows->bytes + bytes > WINDOWS_BYTES)) {
        windows->dice ^= windows->dice >> 12;
        windows->dice ^= windows->dice << 25;
        windows->dice ^= windows->dice >> 27;
        forget(windows, &windows->all[windows->dice * 0x2545f4914f6cdd1dULL
                                      % (uint64_t)windows->count]);
    }
}

/* *OUT is new; its samples are kept twice over (moving.h). */
static enum modal_status begin(struct live_windows *windows, const struct asked *a,
                               const cJSON *options, const struct batch *batch,
                               struct window **out, struct modal_error *err)
{
    const size_t sample = batch->channels * sizeof *batch->signals;
    struct window w = { .bytes = 2 * batch->samples * sample + WINDOW_BESIDES, .epoch = a->epoch };
    enum modal_status rc;

    if (batch->samples != (size_t)a->window)
        return modal_fail_field(
            err, MODAL_NOT_FOUND, "live",
            "the samples before these %zu are not here; the whole window of %d is wanted",
            batch->samples, a->window);
    make_room(windows, w.bytes);
    rc = live_new(options, batch, a->hop, &w.live, err);
    if (rc == MODAL_OK && (w.stream = strdup(a->stream)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "windows: no memory");
    if (rc == MODAL_OK && a->tracks != NULL)
        rc = live_resume(w.live, a->tracks, err);
    *out = &windows->all[windows->count++];      /* in any case, so that it is freed as all are */
    **out = w;
    windows->bytes += w.bytes;
    return rc;
}

/* W goes on with A: all of its window, or what follows on its samples. */
static enum modal_status go_on(struct window *w, const struct asked *a, const struct batch *batch,
                               struct modal_error *err)
{
    if (w->next != a->to + 1 - (double)batch->samples)
        live_skip(w->live);
    return a->tracks != NULL ? live_resume(w->live, a->tracks, err) : MODAL_OK;
}

/* The stream's, unless A is of another epoch, or BATCH too little to go on with; NULL: none. */
static struct window *find_for(struct live_windows *windows, const struct asked *a,
                               const struct batch *batch)
{
    const int at = find(windows, a->stream);
    struct window *w = at < 0 ? NULL : &windows->all[at];
    bool follows = w != NULL && w->next == a->to + 1 - (double)batch->samples;

    if (w == NULL || (w->epoch == a->epoch && (follows || batch->samples == (size_t)a->window)))
        return w;
    forget(windows, w);
    return NULL;
}

static int64_t now_ms(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

int64_t live_windows_took_ms(const struct live_windows *windows, const cJSON *live)
{
    struct asked a = { 0 };
    const int at = read_asked(live, &a, NULL) == MODAL_OK ? find(windows, a.stream) : -1;

    return at < 0 ? INT64_MAX : windows->all[at].took_ms;
}

enum modal_status live_windows_run(struct live_windows *windows, const cJSON *live,
                                   const cJSON *options, const struct batch *batch,
                                   cJSON **document, struct modal_error *err)
{
    const int64_t begun_ms = now_ms();
    struct asked a = { 0 };
    struct window *w = NULL;
    enum modal_status rc = read_asked(live, &a, err);

    if (rc != MODAL_OK)
        return rc;
    w = find_for(windows, &a, batch);
    rc = w != NULL ? go_on(w, &a, batch, err) : begin(windows, &a, options, batch, &w, err);
    if (rc == MODAL_OK)
        rc = live_next(w->live, (uint64_t)a.epoch, (uint64_t)a.to, batch->signals, batch->samples,
                       document, err);
    if (w != NULL && rc == MODAL_OK) {
        w->next = a.to + 1;
        w->took_ms = now_ms() - begun_ms;
    } else if (w != NULL)
        forget(windows, w);
    return rc;
}
