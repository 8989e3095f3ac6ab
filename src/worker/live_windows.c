/* live_windows.c - a small table, the oldest out; see live_windows.h */
#include "worker/live_windows.h"
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "job/live.h"
#include "wire/protocol.h"

/* Of a window: an int holds it; the daemon allows far less. */
enum { SAMPLES_MOST = 1000000000 };

struct window {
    char *stream;                 /* NULL: free */
    double epoch, next;           /* next: the index of the first sample that is not here */
    struct live *live;
    uint64_t used;
};

struct live_windows { struct window all[WINDOWS_MOST]; uint64_t runs; };

struct asked { const char *stream, *tracks; double epoch, to; int window, hop; };

struct live_windows *live_windows_new(void)
{
    return calloc(1, sizeof(struct live_windows));
}

static void forget(struct window *w)
{
    free(w->stream);
    live_free(w->live);
    *w = (struct window) { 0 };
}

void live_windows_free(struct live_windows *windows)
{
    for (int i = 0; windows != NULL && i < WINDOWS_MOST; i++)
        forget(&windows->all[i]);
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

/* The stream's place, or the one to be used for it. */
static struct window *place_of(struct live_windows *windows, const char *stream)
{
    struct window *oldest = &windows->all[0];

    for (int i = 0; i < WINDOWS_MOST; i++) {
        struct window *w = &windows->all[i];
        if (w->stream != NULL && strcmp(w->stream, stream) == 0)
            return w;
        if (w->used < oldest->used)
            oldest = w;
    }
    forget(oldest);
    return oldest;
}

static enum modal_status begin(struct window *w, const struct asked *a, const cJSON *options,
                               const struct batch *batch, struct modal_error *err)
{
    struct batch shape = *batch;
    enum modal_status rc;

    if (batch->samples != (size_t)a->window)
        return modal_fail_field(
            err, MODAL_NOT_FOUND, "live",
            "the samples before these %zu are not here; the whole window of %d is wanted",
            batch->samples, a->window);
    rc = live_new(options, &shape, a->hop, &w->live, err);
    if (rc == MODAL_OK && (w->stream = strdup(a->stream)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "windows: no memory");
    if (rc == MODAL_OK && a->tracks != NULL)
        rc = live_resume(w->live, a->tracks, err);
    w->epoch = a->epoch;
    return rc;
}

enum modal_status live_windows_run(struct live_windows *windows, const cJSON *live,
                                   const cJSON *options, const struct batch *batch,
                                   cJSON **document, struct modal_error *err)
{
    struct asked a = { 0 };
    struct window *w = NULL;
    enum modal_status rc = read_asked(live, &a, err);

    if (rc != MODAL_OK)
        return rc;
    w = place_of(windows, a.stream);
    if (w->stream != NULL
        && (w->epoch != a.epoch || w->next != a.to + 1 - (double)batch->samples
            || batch->samples >= (size_t)a.window))
        forget(w);
    if (w->stream == NULL)
        rc = begin(w, &a, options, batch, err);
    if (rc == MODAL_OK)
        rc = live_next(w->live, (uint64_t)a.epoch, (uint64_t)a.to, batch->signals, batch->samples,
                       document, err);
    w->next = a.to + 1;
    w->used = ++windows->runs;
    if (rc != MODAL_OK)
        forget(w);
    return rc;
}
