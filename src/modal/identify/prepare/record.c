/*
 * record.c - from a batch to the record that is identified
 *
 * Everything done here maps exponentials to exponentials, so that no exponent is changed, only
 * amplitudes:
 *
 *   window, channels     rows and columns are cut
 *   detrend              mean or straight line subtracted (least squares)
 *   difference           d[k] = h(t_k + T) - h(t_k) removes any T-periodic part exactly and
 *                        multiplies each exp(lambda t) by exp(lambda T) - 1; with T/dt not an
 *                        integer h(t_k + T) is Lagrange's polynomial through the ten nearest
 *                        samples, itself a filter of fixed weights
 *   band                 a finite impulse response filter, evaluated only where all its inputs are
 *                        inside the record, mixed down and decimated
 *   scale                each channel divided by its rms, in two steps (largest magnitude, then
 *                        rms) so that 1e+-300 is harmless; or all by the largest rms, which keeps
 *                        their proportions, as the paper has it
 *
 * Band.  With w[m], m = 0..M-1, a Kaiser-windowed low-pass and fc the centre of the band,
 *
 *     z[q] = sum_m w[m] exp(i 2 pi fc (m - q D) dt + ...) x[q D + M-1-m],
 *     y[q] = Re z[q] exp(i 2 pi fi q D dt),                                                     (1)
 *
 * that is: filtered about fc, brought to zero, raised to fi = fs/(4D), the middle of the new
 * Nyquist band.  A component at f appears at f - fc + fi, its damping unchanged: one complex line
 * of z gives one real pair of y.  D is the largest decimation with fs/(4D) >= B, B the band's
 * width, so the filter may pass from one to zero between B/2 and fs/(4D).  Where the band reaches
 * down to its own image at negative frequencies the filter is a plain low-pass from 0 and nothing
 * is mixed.  Kaiser's formulas for the window: [OS89, sec. 7.4].
 *
 * [OS89] Oppenheim and Schafer, Discrete-Time Signal Processing, 1989.
 */
#include "modal/identify/prepare/record.h"
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/prepare/event.h"
#include "modal/identify/prepare/rounding.h"
#include "modal/identify/prepare/stuck.h"
#include "modal/linalg/svd.h"

enum { LAGRANGE = 10 };             /* points of the interpolation between samples */
enum { TILE = 32 };                 /* samples and channels that are turned at once */
static const double
    ATTENUATION = 90,               /* dB */
    ATTENUATION_LEAST = 30,         /* of a short record's filter: what is outside leaks by 3 % */
    KAISER_STEEP = 50;              /* from there on beta is linear in it [OS89] */
static const double INTEGER = 1e-6;      /* |T/dt - p| <= INTEGER * p counts as an integer */

const char *const identify_detrend_names[DETREND_COUNT + 1] = { "none", "mean", "linear", NULL };
const char *const identify_scale_names[SCALE_COUNT + 1] = { "rms", "common", NULL };

void record_done(struct record *r)
{
    free(r->Y.x);
    free(r->channel);
    free(r->scale);
    free(r->rms);
    free(r->below);
    wild_done(&r->stuck);
    memset(r, 0, sizeof *r);
}

static enum modal_status check_batch(const struct batch *b, struct modal_error *err)
{
    if (b->channels == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                "signals: no channels; at least 1 is needed");
    if (b->samples < IDENTIFY_SAMPLES_LEAST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                "signals: %zu samples; at least %d are needed%s", b->samples,
                                IDENTIFY_SAMPLES_LEAST, b->channels > b->samples
                                    ? "; rows are samples, columns are channels" : "");
    if (b->samples > INT32_MAX / 2 || b->channels > IDENTIFY_CHANNELS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "signals",
                                "signals: %zu samples of %zu channels; at most %d of %d",
                                b->samples, b->channels, INT32_MAX / 2, IDENTIFY_CHANNELS_MOST);
    if (!(b->dt >= 1 / RECORD_STEP_MOST && b->dt <= RECORD_STEP_MOST))
        return modal_fail_field(err, MODAL_BAD_INPUT, "dt",
                                "dt is %g s; accepted: a positive number from %g to %g", b->dt,
                                1 / RECORD_STEP_MOST, RECORD_STEP_MOST);
    return MODAL_OK;
}

static const char *channel_name(const struct batch *b, size_t c, char text[80])
{
    if (b->names != NULL && b->names[c] != NULL)
        snprintf(text, 80, "%zu (\"%.40s\")", c, b->names[c]);
    else
        snprintf(text, 80, "%zu", c);
    return text;
}

static enum modal_status check_samples(const struct batch *b, struct modal_error *err)
{
    char text[80];
    bool varies = false;

    for (size_t k = 0; k < b->samples; k++)
        for (size_t c = 0; c < b->channels; c++) {
            double x = b->signals[k * b->channels + c];
            if (!isfinite(x))
                return modal_fail_field(
                    err, MODAL_BAD_INPUT, "signals",
                    "signals: %s at sample %zu of channel %s; finite numbers are needed",
                    isnan(x) ? "NaN" : "infinity", k, channel_name(b, c, text));
            varies |= x != b->signals[c];
        }
    if (!varies)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                "signals: every channel is constant (channel %s, samples 0 to "
                                "%zu): there is no motion to identify",
                                channel_name(b, 0, text), b->samples - 1);
    return MODAL_OK;
}

static enum modal_status check_period(double period, double dt, double duration, const char *field,
                                      struct modal_error *err)
{
    if (period == 0)
        return MODAL_OK;
    if (!(period > 0) || !isfinite(period))
        return modal_fail_field(
            err, MODAL_BAD_INPUT, field,
            "a period of %g s; accepted: a positive number, or 0 for constant coefficients",
            period);
    if (period < dt * (1 - INTEGER))
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "a period of %g s, shorter than the "
                                "%g s from one sample to the next; accepted: %g to %g s, or 0 for "
                                "constant coefficients", period, dt, dt, duration / 2);
    if (period > duration / 2)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, field,
            "a period of %g s in a record of %g s; accepted: at most half the record", period,
            duration);
    return MODAL_OK;
}

/* Rows [first, last] of the window, to the nearest sample. */
static enum modal_status window_rows(const struct batch *b, const struct identify_options *opt,
                                     size_t *first, size_t *last, struct modal_error *err)
{
    double end = (b->samples - 1) * b->dt, t0 = opt->window[0], t1 = opt->window[1],
           /* seconds are written with some digits: 0.3 is a sample of dt = 0.1 */
           slack = 1e-9 * b->dt;

    *first = 0, *last = b->samples - 1;
    if ((t0 == 0 && t1 == 0) || t0 == WINDOW_AUTO)
        return MODAL_OK;
    if (!(t0 >= 0) || !(t1 > t0) || t0 > end)
        return modal_fail_field(err, MODAL_BAD_INPUT, "window",
                                "window [%g, %g] s of a record from 0 to %g s; accepted: 0 <= t0 < "
                                "t1, t0 within the record",
                                t0, t1, end);
    *first = (size_t)ceil((t0 - slack) / b->dt);
    if (t1 < end)
        *last = (size_t)floor((t1 + slack) / b->dt);
    if (*last < *first || *last - *first + 1 < IDENTIFY_SAMPLES_LEAST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "window",
                                "window [%g, %g] s holds fewer than %d samples", t0, t1,
                                IDENTIFY_SAMPLES_LEAST);
    return MODAL_OK;
}

static enum modal_status choose_channels(const struct batch *b, const struct identify_options *opt,
                                         struct record *r, struct modal_error *err)
{
    r->channels = opt->channels != NULL ? opt->channel_count : (int)b->channels;
    r->channel = malloc(sizeof *r->channel * (r->channels + 1));
    r->scale = calloc(r->channels + 1, sizeof *r->scale);
    r->below = calloc((size_t)r->channels + 1, sizeof *r->below);
    if (r->channel == NULL || r->scale == NULL || r->below == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "record: no memory for %d channels", r->channels);
    for (int c = 0; c < r->channels; c++) {
        r->channel[c] = opt->channels != NULL ? opt->channels[c] : c;
        if (r->channel[c] < 0 || (size_t)r->channel[c] >= b->channels)
            return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                    "channel %d of %zu; accepted: 0 to %zu", r->channel[c],
                                    b->channels, b->channels - 1);
    }
    return r->channels > 0 ? MODAL_OK
                           : modal_fail_field(err, MODAL_BAD_INPUT, "signals", "no channel chosen");
}

/* The part of rows [*first, *last] that is one free response is told, and taken where it was asked
 * for, or the record is very long; of other responses nobody looks for it unasked. Periodic systems
 * follow no recurrence of one sample to the next, and what is larger than memory is not read once
 * more. */
static enum modal_status propose(const struct batch *b, const struct identify_options *opt,
                                 struct record *r, size_t *first, size_t *last,
                                 struct modal_error *err)
{
    struct event_rows whole = { *first, *last }, part;
    bool named = opt->window[0] != 0 || opt->window[1] != 0, cut;
    enum modal_status rc;

    if (opt->period > 0 || (opt->period == 0 && b->period > 0) || b->release != NULL
        || (opt->response != RESPONSE_FREE && opt->window[0] != WINDOW_AUTO))
        return MODAL_OK;
    rc = event_find(b, r->channel, r->channels, whole, &part, &cut, err);
    if (rc != MODAL_OK || !cut)
        return rc;
    r->proposed[0] = (double)part.first * b->dt, r->proposed[1] = (double)part.last * b->dt;
    r->parted = opt->window[0] == WINDOW_AUTO
             || (!named && whole.last - whole.first >= RECORD_PARTED);
    if (r->parted)
        *first = part.first, *last = part.last;
    return MODAL_OK;
}

/* ROWS rows up to row END have been copied. */
static void give_back(const struct batch *b, size_t end, size_t rows)
{
    void (*give)(const void *, size_t) = b->release != NULL ? b->release : b->spare;

    if (give != NULL)
        give(b->signals + (end - rows) * b->channels, rows * b->channels * sizeof *b->signals);
}

/* Samples to columns: blocks, so that both sides stay in cache; what was copied is given back, a
 * million bytes at a time. */
static enum modal_status copy_columns(const struct batch *b, size_t first, size_t last,
                                      struct record *r, struct modal_error *err)
{
    int L = (int)(last - first + 1);
    size_t rows = 0, most = ((size_t)1 << 20) / (b->channels * sizeof(double)) + 1;

    r->Y = matrix_new(L, r->channels);
    if (r->Y.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "record: no memory for %d samples of %d channels",
                          L, r->channels);
    for (int k0 = 0; k0 < L; k0 += TILE) {
        for (int c0 = 0; c0 < r->channels; c0 += TILE)
            for (int c = c0; c < r->channels && c < c0 + TILE; c++)
                for (int k = k0; k < L && k < k0 + TILE; k++)
                    r->Y.x[k + (size_t)c * L] =
                        b->signals[(first + k) * b->channels + r->channel[c]];
        size_t tall = L - k0 < TILE ? (size_t)(L - k0) : TILE;
        rows += tall;
        if (rows >= most || k0 + TILE >= L)
            give_back(b, first + (size_t)k0 + tall, rows), rows = 0;
    }
    return MODAL_OK;
}

/* Samples that are stuck are mended where modes are searched for in samples that follow each other
 * by a recurrence. */
static enum modal_status mend(const struct batch *b, const struct identify_options *opt,
                              struct record *r, struct modal_error *err)
{
    double period = opt->period == 0 ? b->period : fmax(opt->period, 0);

    if (opt->method != IDENTIFY_AUTO || opt->refine == CHOICE_NO)
        return MODAL_OK;
    return stuck_mend(&r->Y, (int)ceil(fmin(period / b->dt, r->Y.m)), &r->stuck, err);
}

/* The line (or mean) of least squares taken out; about the middle, offset and slope are
 * independent. */
static void detrend_column(double *x, int L, enum identify_detrend what)
{
    double most = largest_magnitude(x, L), mean = 0, slope = 0, moment = 0;

    if (most == 0 || what == DETREND_NONE)
        return;
    for (int k = 0; k < L; k++)
        mean += x[k] / most / L;    /* most first: sums of numbers near DBL_MAX do not overflow */
    for (int k = 0; k < L && what == DETREND_LINEAR; k++) {
        double t = (k - 0.5 * (L - 1)) / L;  /* about the middle, of order 1 */
        slope += t * (x[k] / most);
        moment += t * t;
    }
    for (int k = 0; k < L; k++)
        x[k] = most
            * (x[k] / most - mean - (moment > 0 ? slope / moment * (k - 0.5 * (L - 1)) / L : 0));
}

void record_lagrange(double at, int count, double *w)
{
    for (int i = 0; i < count; i++) {
        w[i] = 1;
        for (int j = 0; j < count; j++)
            if (j != i)
                w[i] *= (at - j) / (i - j);
    }
}

static bool near_integer(double ratio, int *p)
{
    double nearest = nearbyint(ratio);

    *p = (int)nearest;
    return nearest >= 1 && fabs(ratio - nearest) <= INTEGER * nearest;
}

/* Columns shortened in place: row k becomes sum_i w[i] x[k + from + i] - x[k]. */
static enum modal_status difference(struct record *r, double period, struct modal_error *err)
{
    double ratio = period / r->step, w[LAGRANGE] = { 1 };
    int p, from, count = 1, L;

    if (near_integer(ratio, &p)) {
        from = p;
    } else {
        /* between samples: an interpolating polynomial, symmetric about the place */
        count = LAGRANGE;
        from = (int)floor(ratio) - LAGRANGE / 2 + 1;
        if (from < 0)
            from = 0;
        record_lagrange(ratio - from, LAGRANGE, w);
    }
    L = r->Y.m - from - count + 1;
    if (L < IDENTIFY_SAMPLES_LEAST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "difference",
                                "a difference over %g s leaves %d of %d samples", period, L,
                                r->Y.m);
    for (int c = 0; c < r->Y.n; c++) {
        double *x = r->Y.x + (size_t)c * r->Y.ld;
        for (int k = 0; k < L; k++) {
            double sum = 0;
            for (int i = 0; i < count; i++)
                sum += w[i] * x[k + from + i];
            x[k] = sum - x[k];
        }
    }
    r->Y.m = L;
    return MODAL_OK;
}

/* I0 by its power series: all terms positive. */
static double bessel_i0(double x)
{
    double term = 1, sum = 1;

    for (int k = 1; term > DBL_EPSILON * sum; k++) {
        term *= (x / 2 / k) * (x / 2 / k);
        sum += term;
    }
    return sum;
}

struct zoom {
    double centre, raise, cutoff, transition, attenuation;
    int decimation, taps;
    double *w;
};

/* Decimation, shifts and the filter of (1) for the band, on samples of rate fs. */
static enum modal_status plan_zoom(const double band[2], double fs, int L, struct zoom *z,
                                   struct modal_error *err)
{
    double width = band[1] - band[0], centre = 0.5 * (band[0] + band[1]), fd, A, beta, taps;
    double sum = 0;
    int most = L / 3;

    if (!(band[0] >= 0) || !(band[1] > band[0]) || band[1] > fs / 2)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "band",
            "band [%g, %g] Hz; accepted: 0 <= f1 < f2 <= %g (half the sampling rate)", band[0],
            band[1], fs / 2);
    if (!(fs / (4 * width) <= L))        /* compared before it is an int */
        return modal_fail_field(err, MODAL_BAD_INPUT, "band", "band [%g, %g] Hz, %.3g Hz wide, "
                                "would keep one of %d samples; accepted: a wider "
                                "band or a longer record", band[0], band[1], width, L);
    /* rate 4 widths: the band fills half of what is kept, the filter's edges the rest */
    z->decimation = (int)fmax(1, floor(fs / (4 * width)));
    fd = fs / z->decimation;
    if (centre - fd / 4 >= 0 && centre + fd / 4 <= fs / 2) {
        *z = (struct zoom) { centre, fd / 4, 0.5 * (width / 2 + fd / 4), fd / 4 - width / 2, 0,
                             z->decimation, 0, NULL };
    } else {
        z->decimation = (int)fmax(1, floor(fs / (4 * band[1])));
        fd = fs / z->decimation;
        *z = (struct zoom) { 0, 0, 0.5 * (band[1] + fd / 2), fd / 2 - band[1], 0, z->decimation, 0,
                             NULL };
    }
    if (z->decimation == 1 && (z->centre == 0 || width >= fs / 2)) {
        z->centre = z->raise = 0;
        return MODAL_OK;                             /* nothing to remove: only the report is cut */
    }
    /* M = (A - 7.95) / (2.285 dw) + 1; a short record gets a blunter filter */
    A = ATTENUATION;
    taps = ceil((A - 7.95) / (2.285 * 2 * M_PI * z->transition / fs)) + 1;
    z->taps = (int)fmin(taps, most);
    if (taps > most) {
        A = 2.285 * 2 * M_PI * z->transition / fs * (most - 1) + 7.95;
        if (A < ATTENUATION_LEAST)
            return modal_fail_field(err, MODAL_BAD_INPUT, "band",
                                    "band [%g, %g] Hz: %d samples are too few to filter it out; "
                                    "accepted: a wider band or a longer record",
                                    band[0], band[1], L);
    }
    z->attenuation = A;
    beta = A > KAISER_STEEP ? 0.1102 * (A - 8.7) : 0.5842 * pow(A - 21, 0.4) + 0.07886 * (A - 21);
    z->w = malloc(sizeof *z->w * z->taps);
    if (z->w == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "record: no memory for a filter of %d samples",
                          z->taps);
    for (int m = 0; m < z->taps; m++) {
        double t = m - 0.5 * (z->taps - 1), u = 2 * t / (z->taps - 1), x = 2 * z->cutoff / fs;
        z->w[m] = x * (t == 0 ? 1 : sin(M_PI * x * t) / (M_PI * x * t))
            * bessel_i0(beta * sqrt(fmax(0, 1 - u * u))) / bessel_i0(beta);
        sum += z->w[m];
    }
    for (int m = 0; m < z->taps; m++)
        z->w[m] /= sum;
    return MODAL_OK;
}

/* The filter's power gain for white noise. */
static double noise_gain(const struct zoom *z)
{
    double sum = 0;

    for (int m = 0; m < z->taps; m++)
        sum += z->w[m] * z->w[m];
    return sum;
}

/* (1), in place: row q reads rows >= q D only.  The factor 2 makes the amplitude that of the real
 * signal. */
static void zoom_column(double *x, int rows, const struct zoom *z, double dt, const double *c,
                        const double *s)
{
    for (int q = 0; q < rows; q++) {
        const double *at = x + (size_t)q * z->decimation;
        double re = 0, im = 0, angle;
        for (int m = 0; m < z->taps; m++) {
            re += c[m] * at[m];
            im += s[m] * at[m];
        }
        if (z->centre > 0) {
            angle = 2 * M_PI * fmod((z->raise - z->centre) * z->decimation * dt * q, 1);
            x[q] = 2 * (re * cos(angle) - im * sin(angle));
        } else {
            x[q] = re;
        }
    }
}

static enum modal_status zoom_record(struct record *r, const double band[2],
                                     struct modal_error *err)
{
    struct zoom z = { 0 };
    double *c = NULL, *s;
    enum modal_status rc = plan_zoom(band, 1 / r->step, r->Y.m, &z, err);
    int rows;

    if (rc != MODAL_OK || z.w == NULL)
        goto out;
    rows = (r->Y.m - z.taps) / z.decimation + 1;
    if (rows < IDENTIFY_SAMPLES_LEAST) {
        rc = modal_fail_field(
            err, MODAL_BAD_INPUT, "band",
            "band [%g, %g] Hz leaves %d samples; accepted: a wider band or a longer record",
            band[0], band[1], rows);
        goto out;
    }
    c = malloc(sizeof *c * 2 * z.taps);
    if (c == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "record: no memory for a filter of %d samples",
                        z.taps);
        goto out;
    }
    s = c + z.taps;
    for (int m = 0; m < z.taps; m++) {
        /* whole turns first: fmod is exact, a large angle's cosine is not */
        double angle = -2 * M_PI * fmod(z.centre * r->step * m, 1);
        c[m] = z.w[m] * cos(angle);
        s[m] = z.w[m] * sin(angle);
    }
    for (int j = 0; j < r->Y.n; j++) {
        double *x = r->Y.x + (size_t)j * r->Y.ld, before = safe_norm(x, r->Y.m) / sqrt(r->Y.m),
               after;
        zoom_column(x, rows, &z, r->step, c, s);
        after = safe_norm(x, rows) / sqrt(rows);
        if (after > 0)
            /* what the stopband lets through, all of the record at its worst, over what is kept */
            r->leak = fmax(r->leak, pow(10, -z.attenuation / 20) * (before / after));
    }
    r->Y.m = rows;
    r->step *= z.decimation;
    r->decimation = z.decimation;
    r->shift_rad_s = 2 * M_PI * (z.centre - z.raise);
    /* 2^2 for the factor of (1), half of it for the real part kept */
    r->gain = (z.centre > 0 ? 2 : 1) * noise_gain(&z);
    /* the part of the kept band that white noise fills: so many rows are independent */
    r->share = fmin(z.decimation * r->gain, 1);
out:
    free(c);
    free(z.w);
    return rc;
}

/* Largest magnitude, then rms: unit rms whatever the scale; a zero channel stays zero. */
static void scale_column(double *x, int L, double *scale)
{
    double most = largest_magnitude(x, L), rms;

    *scale = 0;
    if (most == 0)
        return;
    for (int k = 0; k < L; k++)
        x[k] /= most;
    rms = safe_norm(x, L) / sqrt(L);
    for (int k = 0; k < L; k++)
        x[k] /= rms;
    *scale = most * rms > 0 ? most * rms : most;
}

/* Bytes from which samples are read in order, whole: what may not fit into memory must not be read
 * across. */
static const double IN_ORDER = 1 << 30;

static bool is_wide(const struct batch *b, const struct identify_options *opt, double entries)
{
    bool periodic = opt->period > 0 || (opt->period == 0 && b->period > 0);

    return b->channels >= RECORD_WIDE_CHANNELS && entries >= RECORD_WIDE_ENTRIES
        && opt->channels == NULL && !opt->signals_all && opt->detrend == DETREND_NONE
        && !opt->difference && opt->band[0] == 0 && opt->band[1] == 0 && opt->stride <= 1
        && !periodic;
}

/* The view, its scales, and the checks that a copy gets from check_samples. */
static enum modal_status view_wide(const struct batch *b, size_t first, size_t last,
                                   struct record *r, struct modal_error *err)
{
    int L = (int)(last - first + 1), S = (int)b->channels;
    bool varies;
    enum modal_status rc;

    r->wide = true;
    r->Y = (struct matrix) { L, S, L, NULL };
    r->view = (struct wide) { b->signals + first * b->channels, b->channels, L, S, r->scale,
                               b->release != NULL || (double)L * S * sizeof(double) > IN_ORDER,
                               b->release, NULL };
    rc = wide_scales(&r->view, r->scale, &varies, err);
    if (rc == MODAL_OK && !varies)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                              "signals: every channel is constant (channel 0, samples 0 to %zu): "
                              "there is no motion to identify",
                              b->samples - 1);
    return rc;
}

/* Columns of unit rms brought back into proportion: the strongest keeps its rms of 1.  A wide
 * record is only told another scale. */
static enum modal_status share_scale(struct record *r, struct modal_error *err)
{
    size_t bytes = sizeof *r->rms * (size_t)r->channels;
    double most = largest_magnitude(r->scale, r->channels);

    if (r->wide && (r->rms = malloc(bytes)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "record: no memory for %d channels", r->channels);
    if (r->wide)
        r->view.rms = memcpy(r->rms, r->scale, bytes);
    for (int c = 0; c < r->channels; c++) {
        double part = r->scale[c] / most;
        for (int k = 0; !r->wide && k < r->Y.m; k++)
            r->Y.x[k + (size_t)c * r->Y.ld] *= part;
        if (r->scale[c] > 0)
            r->scale[c] = most;
    }
    return MODAL_OK;
}

double record_wide_size(const struct record *r, int c)
{
    return r->scale[c] > 0 ? wide_rms(&r->view, c) / r->scale[c] : 0;
}

/* The samples vary, and yet what was cut from them may be zero throughout. */
static enum modal_status check_something_left(const struct record *r,
                                              const struct identify_options *opt,
                                              struct modal_error *err)
{
    const char *field = opt->difference ? "difference"
        : opt->window[1] > 0            ? "window"
        : opt->channels != NULL         ? "signals"
        : opt->detrend != DETREND_NONE  ? "detrend"
                                        : "signals";

    if (largest_magnitude(r->scale, r->channels) > 0)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, field,
                            "%s leaves zero in every channel: there is no motion to identify",
                            field);
}

static void find_period(struct record *r, const struct identify_options *opt, const struct batch *b)
{
    int p;

    /* 0 asks the batch, a negative one denies what it says */
    r->period = opt->period < 0 ? 0 : opt->period > 0 ? opt->period : b->period;
    if (r->period > 0 && near_integer(r->period / r->step, &p))
        r->per_period = p;
}

enum modal_status record_cut(struct record *r, int rows, enum identify_scale how,
                             struct modal_error *err)
{
    bool varies;

    r->Y.m = rows;
    if (r->wide) {
        r->view.L = rows;
        return wide_scales(&r->view, how == SCALE_COMMON ? r->rms : r->scale, &varies, err);
    }
    for (int c = 0; how == SCALE_RMS && c < r->channels; c++) {
        double before = r->scale[c];
        scale_column(r->Y.x + (size_t)c * r->Y.ld, rows, &r->scale[c]);
        r->scale[c] *= before;
    }
    return MODAL_OK;
}

enum modal_status record_make(const struct batch *batch, const struct identify_options *opt,
                              struct record *out, struct modal_error *err)
{
    struct record r = { .step = batch->dt, .dt = batch->dt, .decimation = 1, .gain = 1 };
    double asked = opt->period > 0 ? opt->period : batch->period,
           duration = batch->samples * batch->dt;
    bool band = opt->band[0] != 0 || opt->band[1] != 0, wide;
    size_t first, last;
    enum modal_status rc = check_batch(batch, err);

    wide = rc == MODAL_OK && is_wide(batch, opt, (double)batch->samples * batch->channels);
    if (rc == MODAL_OK && !wide)
        rc = check_samples(batch, err);
    if (rc == MODAL_OK && (opt->period >= 0 || opt->difference))
        rc = check_period(asked, batch->dt, duration, "period", err);
    if (rc == MODAL_OK)
        rc = window_rows(batch, opt, &first, &last, err);
    if (rc == MODAL_OK)
        rc = choose_channels(batch, opt, &r, err);
    if (rc == MODAL_OK)
        rc = propose(batch, opt, &r, &first, &last, err);
    if (rc == MODAL_OK)
        rc = wide ? view_wide(batch, first, last, &r, err)
                  : copy_columns(batch, first, last, &r, err);
    if (rc == MODAL_OK && !wide)
        rc = mend(batch, opt, &r, err);
    if (rc != MODAL_OK)
        goto out;
    r.t0 = first * batch->dt;
    for (int c = 0; !wide && c < r.channels; c++)
        detrend_column(r.Y.x + (size_t)c * r.Y.ld, r.Y.m, opt->detrend);
    find_period(&r, opt, batch);
    if (opt->difference && asked <= 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "difference",
                              "there is no period to take differences over; give `period`");
    if (rc == MODAL_OK && r.period > 0)
        rc = check_period(r.period, batch->dt, r.Y.m * r.step, "window", err);
    if (rc == MODAL_OK && opt->difference)
        rc = difference(&r, asked, err);
    if (rc == MODAL_OK && band)
        rc = zoom_record(&r, opt->band, err);
    if (band)
        /* demodulated, a period later is another phase: lines one by one, folded */
        r.per_period = 0;
    for (int c = 0; rc == MODAL_OK && !wide && c < r.channels; c++)
        scale_column(r.Y.x + (size_t)c * r.Y.ld, r.Y.m, &r.scale[c]);
    if (rc == MODAL_OK)
        rc = check_something_left(&r, opt, err);
    if (rc == MODAL_OK)
        rc = rounding_channels(&r, err);
    if (rc == MODAL_OK && opt->scale == SCALE_COMMON)
        rc = share_scale(&r, err);
out:
    if (rc != MODAL_OK)
        record_done(&r);
    else
        *out = r;
    return rc;
}
