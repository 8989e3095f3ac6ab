/* frames.c - see frames.h */
#include "frames.h"
#include "ring.h"
#include "spill.h"
#include "base/crc32c.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

/* Of a step: a host's time that is a multiple of dt but for its rounding is on the grid. */
static const double grid_slack = 1e-9;
static const double frame_age_most = 0.05;     /* s */
enum { RMS_LEAST = 8 };          /* samples beyond which their rms is a scale for the error */

static bool frames_new(modald_stream *s)
{
    size_t sample = bytes_of(s, 1);

    s->frame_samples = sample < FRAME_BYTES ? FRAME_BYTES / sample : 1;
    if (!loans_new(s, bytes_of(s, s->frame_samples)))
        return false;
    for (int i = 0; i < HISTORY; i++)
        if ((s->history[i].y = malloc(sample)) == NULL)
            return false;
    s->rms = calloc((size_t)s->channels, sizeof *s->rms);
    s->sample = calloc((size_t)s->channels, sizeof *s->sample);
    return s->rms && s->sample;
}

/* The frame being built into the window, or, while spilling, into the file; false: no room for it
 * now. */
static bool finish_build(modald_stream *s)
{
    if (s->build.count == 0)
        return true;
    if (!spilling(s) && s->frames == WINDOW)
        return false;
    s->build.crc = crc32c(0, s->build.data, bytes_of(s, s->build.count));
    s->build.ring_end = s->taken;
    s->build.id = 0;
    s->build.acknowledged = false;
    if (spilling(s)) {
        if (!spill_write(s, &s->build))
            return false;
        release(s, s->taken);
    } else {
        *frame_at(s, s->frames++) = s->build;
        s->build.data = NULL;
    }
    s->build.count = 0;
    return true;
}

/* One sample of equal steps into the frame being built; false: no room, nothing was changed. */
static bool add_sample(modald_stream *s, uint64_t index, const double *y)
{
    bool fits = s->build.count > 0 && index == s->build.first + s->build.count
             && s->build.count < s->frame_samples;

    if (!fits) {
        if (!finish_build(s)
            || (s->build.data == NULL && (s->build.data = loan_take(s)) == NULL))
            return false;
        s->build.first = index;
        s->build_since = now();
    }
    memcpy(s->build.data + s->build.count++ * (size_t)s->channels, y,
           (size_t)s->channels * sizeof *y);
    return true;
}

/* (1) at T through the first N of the history. */
static double interpolate(const modald_stream *s, int n, int channel, double t)
{
    double sum = 0;

    for (int j = 0; j < n; j++) {
        double w = 1;
        for (int m = 0; m < n; m++)
            if (m != j)
                w *= (t - s->history[m].t) / (s->history[j].t - s->history[m].t);
        sum += w * s->history[j].y[channel];
    }
    return sum;
}

static void resample_at(modald_stream *s, double t)
{
    for (int c = 0; c < s->channels; c++) {
        double y = interpolate(s, s->points, c, t),
               coarse = interpolate(s, s->points > 2 ? s->points - 1 : s->points, c, t);
        s->sample[c] = y;
        s->rms[c] += (y * y - s->rms[c]) / (double)(s->rms_count + 1);
        double error = fabs(y - coarse) / sqrt(s->rms[c] > 0 ? s->rms[c] : 1);
        if (s->rms_count > RMS_LEAST && error > s->resampling_error)
            s->resampling_error = error;
    }
    s->rms_count++;
}

/* The grid's samples up to UNTIL from the history; false: no room, asked again later. */
static bool resample(modald_stream *s, double until)
{
    double slack = grid_slack * s->dt;

    while ((double)s->next_grid * s->dt <= until + slack) {
        resample_at(s, (double)s->next_grid * s->dt);
        if (!add_sample(s, s->next_grid, s->sample))
            return false;
        s->next_grid++;
    }
    return true;
}

static void add_point(modald_stream *s, double t, const double *y)
{
    if (s->points == HISTORY) {
        struct point oldest = s->history[0];
        memmove(s->history, s->history + 1, (HISTORY - 1) * sizeof *s->history);
        s->history[HISTORY - 1] = oldest;
        s->points--;
    }
    s->history[s->points].t = t;
    memcpy(s->history[s->points++].y, y, (size_t)s->channels * sizeof *y);
}

/* A sample at time T of its own.  The grid is filled up to the last but one point, so that (1) has
 * a point beyond. */
static bool add_uneven(modald_stream *s, double t, const double *y)
{
    /* a repeat, or back in time: begin anew */
    if (s->points > 0 && t <= s->history[s->points - 1].t) {
        if (s->points > 1 && !resample(s, s->history[s->points - 1].t))
            return false;
        s->points = 0;
    }
    if (s->points == 0)
        s->next_grid = (uint64_t)fmax(0, ceil(t / s->dt - grid_slack));
    if (s->points == HISTORY && !resample(s, s->history[HISTORY - 2].t))
        return false;
    add_point(s, t, y);
    return true;
}

/* Slots into frames while there is room. */
static void build_frames(modald_stream *s)
{
    uint64_t head = atomic_load_explicit(&s->page->head, memory_order_acquire);

    while (s->taken < head && may_copy(s)) {
        const double *at = slot_at(s, s->taken);
        uint64_t index;
        memcpy(&index, at, sizeof index);
        if (!(isnan(at[1]) ? add_sample(s, index, at + 2) : add_uneven(s, at[1], at + 2)))
            break;
        s->taken++;
    }
    release_copied(s);
}

/* The rest of an uneven record: its last point has none beyond. */
static void end_resampling(modald_stream *s)
{
    if (s->points > 1)
        resample(s, s->history[s->points - 1].t);
    s->points = 0;
}

/* Not for its age where much is under way: frames of a few samples each would fill the window, and
 * what came behind them spill. */
static bool is_due(modald_stream *s)
{
    double t;

    if (bytes_of(s, s->build.count) >= FRAME_ENOUGH || overflows(s))
        return true;
    if (s->frames > 0)
        return false;
    t = now();
    if (t > s->build_since + frame_age_most)
        s->link->beat = t;
    return s->build_since < s->link->beat;
}

static bool send_due(modald_stream *s, bool all)
{
    return s->build.count > 0 && (all || is_due(s)) && finish_build(s);
}

/* The daemon does not keep up, and from now on everything goes through the file. */
static void spill_if_needed(modald_stream *s, bool all)
{
    if (spilling(s) || s->spill_most == 0 || s->frames == 0 || s->spill_failed
        || (!all && !overflows(s)))
        return;
    for (int i = 0; i < s->frames; i++) {
        struct frame *f = frame_at(s, i);
        if (!spill_write(s, f))
            return;
        release(s, f->ring_end);
        f->ring_end = 0;
    }
    s->spill_read = s->spill_end;
}

static void fill_window(modald_stream *s)
{
    while (s->frames < WINDOW && s->spill_fd >= 0) {
        struct frame *f = frame_at(s, s->frames);
        f->data = loan_take(s);
        if (f->data == NULL || !spill_next(s, f)) {
            loan_put(s, f->data);
            return;
        }
        s->frames++;
    }
}

/* What a burst took and is spare again goes back to the system, but for a few. */
static void shrink(modald_stream *s)
{
    int kept = s->spares < LOANS_KEPT ? s->spares : LOANS_KEPT;

    if (s->spares_least + LOANS_KEPT + 1 >= s->spares)
        return;
    for (int i = s->spares_least; i < s->spares - kept; i++)
        if (atomic_load_explicit(&loan_of(s->spare[i])->holders, memory_order_acquire) == 0)
            madvise(loan_of(s->spare[i]), s->loans->stride, MADV_DONTNEED);
    s->spares_least = s->spares;
}

/* Frames acknowledged from the front on leave the window, their slots or file space with them. */
static void retire(modald_stream *s)
{
    while (s->frames > 0 && frame_at(s, 0)->acknowledged) {
        struct frame *f = frame_at(s, 0);
        if (f->ring_end > 0)
            release(s, f->ring_end);
        if (f->file_end > s->spill_acknowledged)
            s->spill_acknowledged = f->file_end;
        atomic_fetch_add_explicit(&s->acknowledged, f->count, memory_order_relaxed);
        loan_put(s, f->data);
        *f = (struct frame) { 0 };
        s->first_frame = (s->first_frame + 1) % WINDOW;
        s->frames--;
        s->retired++;
    }
    if (s->frames == 0 || s->retired >= WINDOW) {   /* a fast stream has always some in flight */
        shrink(s);
        s->retired = 0;
    }
    spill_drained(s);
}
