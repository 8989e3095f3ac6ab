/*
 * ambient.c - the way from a batch to the modes that its spectra show
 *
 * The channels are combined to orthogonal signals of unit variance first (pod.h): the likelihood
 * does not change with coordinates, its numbers do.
 *
 * An error to be had [Au14]: of N_c cycles a damping ratio z is known to sqrt(z / (2 pi N_c)) at
 * best: the share ENOUGH of it takes so many more cycles as the square of its own share over that.
 *
 * [Au14] Au, Mechanical Systems and Signal Processing 48 (2014) 15-33.
 */
#include "modal/identify/ambient/ambient.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ambient/ambient_drift.h"
#include "modal/identify/ambient/ambient_free.h"
#include "modal/identify/ambient/ambient_lift.h"
#include "modal/identify/ambient/ambient_lines.h"
#include "modal/identify/ambient/ambient_order.h"
#include "modal/identify/ambient/ambient_steady.h"
#include "modal/identify/ambient/ambient_tones.h"
#include "modal/identify/ambient/ambient_wander.h"
#include "modal/identify/answer/modes.h"
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/ask/screen.h"
#include "modal/identify/ask/verdict.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/prepare/pod.h"
#include "modal/identify/prepare/record.h"
#include "modal/identify/prepare/response.h"
#include "modal/identify/prepare/turns.h"
#include "modal/linalg/svd.h"

enum {
    MAINS = 20,                  /* multiples */
    SEARCHES = 3,                /* more, each less the lines that the last one's modes show */
    SAMPLES_LEAST = 4 * AMBIENT_STEADY_UNITS    /* four to a unit have an energy */
};
static const double
    ENOUGH = 0.15,               /* of a damping ratio: what is known no better is hardly known */
    NARROW = 1,                  /* decay over the record: no wider than a line of it */
    SOUND = 0.5,                 /* of the least error that theory knows */
    GRID[] = { 50, 60 };         /* Hz */

struct work {
    struct identify_options opt;
    struct record rec;
    struct ambient_line line[AMBIENT_LINES_MOST];
    int line_count;
    int phases;                  /* samples a period, each a column of its own; 1: constant */
    bool periodic;
    double sample, span;         /* s a sample; that a multiplier is over: the period, or dt */
    double *longer;              /* of an azimuth: turns_lengths(); owned */
    bool meet[WHITTLE_MODES_MOST][WHITTLE_MODES_MOST];   /* by these, multipliers do */
    int locked;                  /* modes whose own does */
    struct matrix whole;         /* the first rows before lines were taken off; owned */
    struct pod pod;
    struct matrix Z;             /* signals of unit variance; the pod's memory */
    struct spectrum spectrum;
    struct ambient_search found;
    double step;                 /* s a sample of the spectrum */
    double *back;                /* from signals to columns of channels of unit rms */
    int broad;                   /* poles without a peak */
    size_t from, rows;           /* of the batch */
    double drift;                /* share of the mean square that moved too slowly to be told */
    double clock;
};

static const struct response_limits accepted = {
    .beside = "window, band, period, azimuth, detrend, scale, signals, pod.energy, pod.rank, "
              "shapes, rank.fixed, rank.most, threads",
    .signals_most = WHITTLE_CHANNELS_MOST, .modes_most = WHITTLE_MODES_MOST, .periodic = true
};

/* A constant less its mean is rounding. */
static void drop_constant(struct work *w, const struct batch *b)
{
    size_t first = (size_t)llround(w->rec.t0 / b->dt);

    for (int c = 0; c < w->rec.channels; c++) {
        const double *x = b->signals + first * b->channels + (size_t)w->rec.channel[c];
        int k = 1;
        while (k < w->rec.Y.m && x[(size_t)k * b->channels] == x[0])
            k++;
        if (k == w->rec.Y.m) {
            memset(w->rec.Y.x + (size_t)c * w->rec.Y.ld, 0, sizeof(double) * (size_t)k);
            w->rec.scale[c] = 0;
        }
    }
}

/* Lines off, and the samples of a period side by side, each in a column of its own. */
static enum modal_status take_lines(struct work *w, struct modal_error *err)
{
    struct matrix *Y = &w->rec.Y, lifted;
    int rows = Y->m / w->phases < AMBIENT_FREE_ROWS ? Y->m : AMBIENT_FREE_ROWS * w->phases;
    enum modal_status rc = ambient_lift(Y, rows, w->phases, &w->whole, err);

    if (rc == MODAL_OK)
        rc = ambient_lines_take(Y, w->line, &w->line_count, err);
    if (rc != MODAL_OK || !w->periodic)
        return rc;
    rc = ambient_lift(Y, Y->m, w->phases, &lifted, err);
    if (rc == MODAL_OK) {
        free(Y->x);
        *Y = lifted;
        w->rec.step *= w->phases;
    }
    return rc;
}

/* A period of whole samples; what repeats with it is an orbit, no mode. */
static enum modal_status read_period(struct work *w, const struct batch *batch,
                                     struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    w->periodic = w->rec.period > 0 || w->opt.azimuth != NULL;
    if (w->opt.azimuth != NULL || (w->periodic && w->rec.per_period == 0))
        rc = turns_even(&w->rec, batch, w->opt.azimuth, &w->longer, err);
    if (rc != MODAL_OK)
        return rc;
    w->phases = w->periodic ? w->rec.per_period : 1;
    w->sample = w->rec.step, w->span = w->periodic ? w->rec.period : w->rec.dt;
    if (!w->periodic)
        return MODAL_OK;
    ambient_lift_settle(&w->rec.Y, w->phases);
    return record_cut(&w->rec, w->rec.Y.m, w->opt.scale, err);
}

/* Without a drift channels are of unit rms again. */
static enum modal_status take_drift(struct work *w, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (w->rec.Y.m >= SAMPLES_LEAST)
        rc = ambient_drift_take(&w->rec.Y, &w->drift, err);
    return rc == MODAL_OK && w->drift > 0 ? record_cut(&w->rec, w->rec.Y.m, w->opt.scale, err) : rc;
}

/* The record as it is cut for free responses, but for the band, which spectra have themselves. */
static enum modal_status read_record(struct work *w, const struct batch *batch,
                                     struct modal_error *err)
{
    struct identify_options cut = w->opt;
    bool unasked = cut.detrend == DETREND_NONE;
    int *list;
    enum modal_status rc = turns_leave_azimuth(batch, &cut, &list, err);

    cut.band[0] = cut.band[1] = 0;
    if (unasked)
        cut.detrend = w->opt.detrend = DETREND_MEAN;
    if (rc == MODAL_OK)
        rc = record_make(batch, &cut, &w->rec, err);
    free(list);
    if (rc == MODAL_OK && w->rec.wide)
        rc = modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%d samples of %d channels are not "
                              "taken with response=ambient; name channels by `signals`, or give "
                              "`window`", w->rec.Y.m, w->rec.channels);
    if (rc == MODAL_OK) {
        w->from = (size_t)llround(w->rec.t0 / batch->dt), w->rows = (size_t)w->rec.Y.m;
        drop_constant(w, batch);
        if (unasked)
            rc = take_drift(w, err);
    }
    if (rc == MODAL_OK)
        rc = read_period(w, batch, err);
    if (rc == MODAL_OK && w->rec.Y.m / w->phases < SAMPLES_LEAST)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "signals", "signals: %d %s; response=ambient "
                              "needs at least %d", w->rec.Y.m / w->phases,
                              w->periodic ? "periods" : "samples", SAMPLES_LEAST);
    return rc == MODAL_OK ? take_lines(w, err) : rc;
}

/* Signals of unit variance z_j = sqrt(N) v_j, and the way back: y = sum_j u_j s_j / sqrt(N) z_j. */
static enum modal_status reduce(struct work *w, struct modal_error *err)
{
    /* of samples of one period, which tell nearly the same: fewer unknowns beside each mode */
    int most = w->periodic ? POD_CHANNELS_FEW : WHITTLE_CHANNELS_MOST;
    struct pod_options how = { w->opt.pod_energy, w->opt.pod_rank, most, NULL };
    int N = w->rec.Y.m, S = w->rec.Y.n, r;
    enum modal_status rc = pod_reduce(&w->rec.Y, &how, &w->pod, err);

    if (rc != MODAL_OK)
        return rc;
    w->pod.count = (int)fmin(w->pod.count, WHITTLE_CHANNELS_MOST);
    while (w->pod.count > 0 && !(w->pod.s[w->pod.count - 1] > 0))
        w->pod.count--;
    r = w->pod.count;
    if (r == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "signals: nothing moves but "
                                "lines of constant amplitude; accepted: at least one channel that "
                                "does");
    w->back = calloc((size_t)S * (size_t)r, sizeof *w->back);
    if (w->back == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d channels", S);
    w->Z = w->pod.signals;
    w->Z.n = r;
    for (int j = 0; j < r; j++) {
        double size = w->pod.s[j] / sqrt(N);
        cblas_dscal(N, 1 / size, w->Z.x + (size_t)j * w->Z.ld, 1);
        for (int c = 0; c < S; c++)
            w->back[c + (size_t)S * j] = w->pod.modes.x[c + (size_t)w->pod.modes.ld * j] * size;
    }
    return MODAL_OK;
}

/* ---- what was found ---- */

/* Where a drift was taken off, no line that it was in says anything. */
static int first_line(const struct work *w)
{
    return w->drift > 0 ? 1 + AMBIENT_DRIFT_LINES : 1;
}

/* Does the exponent make a peak among the lines, where the mode moves? */
static bool has_peak(const struct work *w, double complex lambda)
{
    double slowest = 2 * M_PI * first_line(w) / w->spectrum.samples;

    return 2 * creal(lambda) * creal(lambda) < creal(lambda * conj(lambda))
           && (w->periodic || cimag(lambda) * w->step >= slowest);
}

/* Is it in the band, and below the last line?  Periodic systems move where they move. */
static bool is_asked(const struct work *w, double complex lambda)
{
    double hertz = cimag(lambda) / (2 * M_PI), 
           last = 2 * M_PI * (w->spectrum.first + w->spectrum.lines - 1) / w->spectrum.samples;

    return w->periodic
           || (cimag(lambda) * w->step < last
               && (w->opt.band[1] == 0 || (hertz >= w->opt.band[0] && hertz <= w->opt.band[1])));
}

/* Is it no wider than a line of the record? */
static bool is_line(const struct work *w, double complex lambda)
{
    return -creal(lambda) * w->spectrum.samples < NARROW;
}

/* Is its error one that can be?  No record tells a decay a better than to sqrt(a / samples); what
 * says so fitted a line or two of the spectra, where they come near zero. */
static bool is_sound(const struct work *w, const struct whittle_mode *q)
{
    return !(q->std_decay * q->std_decay * w->spectrum.samples
             < -creal(q->lambda) * SOUND * SOUND);
}

/* The mains' frequency of which HERTZ is a multiple, to a line of the record; 0: none. */
static int mains_of(const struct work *w, double hertz)
{
    double record = w->rec.Y.m * w->rec.step;

    for (size_t g = 0; g < sizeof GRID / sizeof *GRID; g++) {
        double multiple = round(hertz / GRID[g]);
        if (multiple >= 1 && multiple <= MAINS && fabs(hertz - multiple * GRID[g]) * record < 1)
            return (int)GRID[g];
    }
    return 0;
}

/* The mains as a pair, too weak to be taken off first: it is left out of the modes, and told with
 * the lines. */
static bool take_mains(struct work *w, const struct whittle_mode *q, const struct identify_mode *m)
{
    double hertz = cabs(m->resolved) / (2 * M_PI);

    if (w->periodic || (is_sound(w, q) && !is_line(w, m->exponent * w->step))
        || mains_of(w, hertz) == 0 || w->line_count == AMBIENT_LINES_MOST)
        return false;
    w->line[w->line_count++] = (struct ambient_line) { hertz * w->sample,
                                                       m->amplitude * m->amplitude, NULL };
    return true;
}

/* The columns, channels of unit rms or their phases, that a mode moves, from its row over the
 * signals. */
static void to_columns(const struct work *w, const double complex *x, double complex *y)
{
    int S = w->rec.Y.n;

    for (int c = 0; c < S; c++) {
        y[c] = 0;
        for (int j = 0; j < w->Z.n; j++)
            y[c] += w->back[c + (size_t)S * j] * x[j];
    }
}

/* The mean square over all channels of the mode's part, of which phi row^T is half the covariance;
 * below zero where it takes from that of others. */
static double part_of(const struct work *w, const double complex *phi, const double complex *row)
{
    double sum = 0;
    int S = w->rec.Y.n;

    for (int c = 0; c < S; c++) {
        double complex a = 0, b = 0;
        for (int j = 0; j < w->Z.n; j++) {
            a += w->back[c + (size_t)S * j] * phi[j];
            b += w->back[c + (size_t)S * j] * row[j];
        }
        sum += 2 * creal(a * b);
    }
    return sum / S * w->spectrum.samples / w->rec.Y.m;
}

/* Does mode K, with those whose peaks overlap with its own, add to the mean square?  A mode does;
 * what takes from it draws the edge of a filter, or a gap in the excitation's spectrum. */
static bool adds(const struct whittle *fit, const double *part, int k)
{
    const struct whittle_mode *q = fit->mode;
    double sum = 0;

    for (int j = 0; j < fit->count; j++)
        /* as whittle_exponent() has it, turns are of either sign */
        if (fabs(fabs(cimag(q[j].lambda)) - fabs(cimag(q[k].lambda)))
            <= -creal(q[j].lambda) - creal(q[k].lambda))
            sum += part[j];
    return sum > 0;
}

static enum modal_status shape_of(const struct work *w, const double complex *moved,
                                  struct identify_mode *m, struct modal_error *err)
{
    int S = w->rec.channels;

    m->shape = malloc(sizeof *m->shape * (size_t)S);
    if (m->shape == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for a shape of %d channels",
                          S);
    for (int c = 0; c < S; c++)
        m->shape[c] = w->rec.scale[c]
            * ambient_lift_component(moved + (size_t)(w->phases * c), w->phases,
                                     m->resolved * w->span);
    modes_scale_shape(m, S);
    return MODAL_OK;
}

/* Where mode M of pair Q moves, and how; moved: room for as many numbers as columns. */
static enum modal_status resolve(const struct work *w, const struct whittle_mode *q,
                                 double complex *moved, struct identify_mode *m,
                                 struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    to_columns(w, q->phi, moved);
    for (int c = 0; c < w->rec.Y.n && cimag(q->lambda) < 0; c++)
        moved[c] = conj(moved[c]);
    if (w->periodic)
        rc = ambient_lift_resolve(moved, w->phases, w->rec.channels, w->span, m, err);
    if (rc == MODAL_OK && w->opt.shapes)
        rc = shape_of(w, moved, m, err);
    m->cycles = cabs(m->resolved) / (2 * M_PI) * w->rec.Y.m * w->rec.step;
    modes_spread_std(m, w->span, w->rec.Y.m * w->rec.step);
    m->bar = m->std_multiplier;
    return rc;
}

/* Of modes whose multipliers meet, no errors: with a bar of NAN such a mode leaves the verdict
 * undecided.  pair: of each mode of OUT; a pole without a peak has no slope that is a mode's. */
static void withhold_locked(struct work *w, const bool *peak, const int *pair,
                            struct identify_result *out)
{
    for (int i = 0; i < out->mode_count; i++) {
        struct identify_mode *m = &out->modes[i];
        bool locked = false;
        for (int k = pair[i], j = 0; j < w->found.model->count; j++)
            locked |= peak[j] && (w->meet[j][k] || w->meet[k][j]);
        if (locked) {
            m->std_re = m->std_im = m->std_multiplier = m->bar = NAN;
            m->std_frequency_hz = m->std_damping_ratio = NAN;
            w->locked++;
        }
    }
}

static enum modal_status report_modes(struct work *w, struct identify_result *out,
                                      struct modal_error *err)
{
    const struct whittle *fit = w->found.model;
    struct whittle_covariances v;
    double dt = w->step, part[WHITTLE_MODES_MOST];
    int pair[WHITTLE_MODES_MOST];
    bool peak[WHITTLE_MODES_MOST];
    double complex *moved = malloc(sizeof *moved * (size_t)w->rec.Y.n);
    enum modal_status rc = MODAL_OK;

    out->modes = calloc((size_t)fit->count + 1, sizeof *out->modes);
    if (out->modes == NULL || moved == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d modes", fit->count);
    whittle_covariances(fit, &v);
    for (int k = 0; k < fit->count; k++)
        part[k] = part_of(w, fit->mode[k].phi, v.row[k]);
    for (int k = 0; rc == MODAL_OK && k < fit->count; k++) {
        const struct whittle_mode *q = &fit->mode[k];
        struct identify_mode *m = &out->modes[out->mode_count];
        double complex lambda = whittle_exponent(q, w->spectrum.samples) / dt;
        *m = (struct identify_mode) {
            .exponent = lambda, .resolved = lambda, .multiplier = multiplier_of(lambda, w->span),
            .amplitude = sqrt(fmax(part[k], 0)), .persistence = NAN, .residual = NAN,
            .std_re = is_line(w, lambda * dt) || !is_sound(w, q) ? NAN : q->std_decay / dt,
            .std_im = is_sound(w, q) ? q->std_turn / dt : NAN, .runner_up = NAN };
        rc = resolve(w, q, moved, m, err);
        peak[k] = has_peak(w, m->resolved) && adds(fit, part, k);
        w->broad += !peak[k];
        if (rc != MODAL_OK || (peak[k] && is_asked(w, m->resolved) && !take_mains(w, q, m)))
            pair[out->mode_count++] = k;
        else
            free(m->harmonics), free(m->shape);
    }
    if (rc == MODAL_OK)
        withhold_locked(w, peak, pair, out);
    free(moved);
    if (rc == MODAL_OK)
        modes_rank(out);
    return rc;
}

/* The channels' own spectra against the model's, and their rms over all bins. */
static void compare(const struct work *w, struct identify_result *out, double *own, double *left)
{
    const struct bins *s = &w->found.bins;
    struct whittle_covariances v;
    double complex S[WHITTLE_CHANNELS_MOST * WHITTLE_CHANNELS_MOST];
    int l = w->Z.n, C = w->rec.Y.n;

    whittle_covariances(w->found.model, &v);
    for (int b = 0; b < s->count; b++) {
        const double complex *spectra = s->mean + (size_t)b * l * l;
        whittle_spectrum(w->found.model, &v, s, b, S);
        for (int c = 0; c < C; c++) {
            double seen = 0, model = 0;
            for (int j = 0; j < l; j++)
                for (int i = 0; i < l; i++) {
                    double weight = w->back[c + (size_t)C * i] * w->back[c + (size_t)C * j];
                    seen += weight * creal(spectra[i + l * j]);
                    model += weight * creal(S[i + l * j]);
                }
            own[c / w->phases] += s->lines[b] * seen * seen;
            left[c / w->phases] += s->lines[b] * (seen - model) * (seen - model);
        }
    }
    for (int c = 0; c < w->rec.channels; c++)
        out->relative_error[c] = own[c] > 0 ? sqrt(left[c] / own[c]) : NAN;
}

static enum modal_status report_spectra(struct work *w, struct identify_result *out,
                                        struct modal_error *err)
{
    int C = w->rec.channels;
    size_t n = (size_t)C;
    double *own = calloc(2 * n, sizeof *own), all = 0, left = 0;

    out->channel_count = C;
    out->channel = malloc(sizeof *out->channel * n);
    out->rms_error = malloc(sizeof *out->rms_error * n);
    out->relative_error = malloc(sizeof *out->relative_error * n);
    if (own == NULL || out->channel == NULL || out->rms_error == NULL
        || out->relative_error == NULL) {
        free(own);
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d channels", C);
    }
    memcpy(out->channel, w->rec.channel, sizeof *out->channel * n);
    compare(w, out, own, own + C);
    for (int c = 0; c < C; c++) {
        out->rms_error[c] = isnan(out->relative_error[c])
                                ? 0 : out->relative_error[c] * w->rec.scale[c];
        all += own[c], left += own[C + c];
    }
    out->total_relative_error = all > 0 ? sqrt(left / all) : NAN;
    free(own);
    return MODAL_OK;
}

static enum modal_status report_orders(struct work *w, struct identify_result *out,
                                       struct modal_error *err)
{
    const struct ambient_search *a = &w->found;
    int poles = 0, l = w->Z.n;

    for (int i = 0; i < a->rungs; i++)
        poles += a->rung[i].count;
    out->candidates = calloc((size_t)a->rungs + 1, sizeof *out->candidates);
    out->poles = calloc((size_t)poles + 1, sizeof *out->poles);
    if (out->candidates == NULL || out->poles == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d orders", a->rungs);
    for (int i = 0; i < a->rungs; i++) {
        const struct ambient_rung *r = &a->rung[i];
        double price = 2 * r->count * ambient_price(l, w->spectrum.lines);
        out->candidates[out->candidate_count++] = (struct identify_candidate) {
            2 * r->count, price - 2 * r->likelihood, NAN, true, r->converged,
            r->count == a->model->count };
        for (int k = 0; k < r->count; k++) {
            double complex z = whittle_exponent(&r->mode[k], w->spectrum.samples) / w->step;
            out->poles[out->pole_count++] = (struct identify_pole) { 2 * r->count, z, NAN, NAN,
                                                                     modes_nearest(out, z) };
        }
    }
    return MODAL_OK;
}

/* ---- what may be wrong ---- */

static void about_width(const struct work *w, struct identify_result *r, int i, int *narrow,
                        int *few)
{
    const struct identify_mode *m = &r->modes[i];
    double z = damping_ratio_of(m->resolved), hz = cabs(m->resolved) / (2 * M_PI);
    double share = m->std_damping_ratio / z, longer = share * share / (ENOUGH * ENOUGH);

    if (is_line(w, m->exponent * w->step)) {
        if ((*narrow)++ < IDENTIFY_TOLD)     /* modes */
            identify_diagnose(r, "narrow_line", -1, "mode %d (%.5g Hz) is no wider than a line of "
                              "the record: a rotating part, the mains or a limit cycle looks so, "
                              "and so does damping below %.2g; record longer, or leave it out by "
                              "`band`", i, hz,
                              NARROW / (2 * M_PI * hz * w->rec.Y.m * w->rec.step));
    } else if (share > ENOUGH && (*few)++ < IDENTIFY_TOLD)
        identify_diagnose(r, "too_few_cycles", -1, "mode %d (%.5g Hz) has %.0f cycles in the "
                          "record: its damping is known to %.0f %% only; %.0f %% take some %.3g "
                          "cycles, %.3g s", i, hz, m->cycles, 100 * share, 100 * ENOUGH,
                          m->cycles * longer, m->cycles * longer / hz);
}

static void about_modes(const struct work *w, struct identify_result *r)
{
    int few = 0, narrow = 0;

    for (int i = 0; i < r->mode_count; i++) {
        about_width(w, r, i, &narrow, &few);
        diagnose_near_nyquist(r, i, fabs(cimag(r->modes[i].resolved)) * w->sample / M_PI);
    }
}

/* Lines that were taken off; what may be the system's own, a limit cycle, leaves it undecided. */
static void about_lines(const struct work *w, struct identify_result *r)
{
    for (int i = 0; i < w->line_count; i++) {
        double hertz = w->line[i].frequency / w->sample, share = 100 * w->line[i].share;
        int mains = mains_of(w, hertz);
        if (mains > 0)
            identify_diagnose(r, "mains_line", -1, "a line of %.6g Hz, a multiple of %d Hz, %.2g "
                              "%% of the channels' mean square: mains, not a mode; it is left "
                              "out", hertz, mains, share);
        else
            identify_diagnose(r, "narrow_line", -1, "a line of %.6g Hz and constant amplitude, "
                              "%.2g %% of the channels' mean square: a rotating part or a limit "
                              "cycle, not a mode; it was taken off first, and no verdict is given, "
                              "for it does not decay", hertz, share);
        if (mains == 0)
            r->verdict = VERDICT_UNDECIDED;
    }
}

static void about_poles(const struct work *w, struct identify_result *r)
{
    const struct whittle *m = w->found.model;

    if (w->drift > 0)
        identify_diagnose(r, "drift", -1, "%.2g %% of the channels' mean square moves more slowly "
                          "than %d cycles in the record: taken off first, by a polynomial in time; "
                          "detrend=mean leaves it in", 100 * w->drift, AMBIENT_DRIFT_LINES);
    if (w->broad > 0)
        identify_diagnose(r, "coloured_excitation", -1, "%d pole%s without a peak: the spectrum "
                          "of the excitation or a filter's edge, or a motion damped beyond 70 %%; "
                          "fitted beside the modes and not counted among them", w->broad,
                          w->broad > 1 ? "s" : "");
    if (w->pod.count < w->rec.channels && w->pod.count == WHITTLE_CHANNELS_MOST)
        identify_diagnose(r, "channels_reduced", -1, "%d channels were reduced to their %d "
                          "strongest orthogonal signals, which hold %.4g %% of what they sum to; "
                          "weak modes may show better in a few channels named by `signals`",
                          w->rec.channels, w->pod.count, 100 * w->pod.energy);
    if (r->mode_count == 0)
        identify_diagnose(r, "no_modes", -1, "no mode stands above the noise: the spectra are "
                          "flat, or as broad as the excitation");
    diagnose_still_channels(r);
    if (w->found.limit)
        identify_diagnose(r, "order_work_limit", -1, "the search for modes ended at %d pairs, for "
                          "the work or the pairs that it may take: more may fit better; give "
                          "`band` to look at less, or name fewer channels by `signals`", m->count);
    if (w->locked > 0)
        identify_diagnose(r, "turns_lock", -1, "turns differ in length by %.2g %% rms, and where "
                          "they are some twice that beside the mean the multipliers of two modes "
                          "meet that move each other, or one and its own conjugate, by the slopes "
                          "that the record tells: of %d mode%s errors are unknown and no verdict "
                          "is given; give a `window` of steadier speed",
                          100 * cblas_dnrm2(w->Z.m, w->longer, 1) / sqrt(w->Z.m), w->locked,
                          w->locked > 1 ? "s" : "");
    if (!m->converged)
        identify_diagnose(r, "not_converged", -1, "the fit to the spectra did not converge: errors "
                          "are unknown and no verdict is given; give `band` to look at less, "
                          "or rank.fixed");
}

/* Is the record likelier free?  Asked only where something is to be said: where a mode's width
 * tells its damping, a free response has decayed or grown. */
static enum modal_status about_free(const struct work *w, struct identify_result *r,
                                    struct modal_error *err)
{
    struct ambient_free_input in = { &w->whole, &w->rec.Y, w->line_count, w->rec.step };
    int motions = 0;
    double left;
    enum modal_status rc = MODAL_OK;

    if (!r->driven && r->diagnostic_count > 0)
        rc = ambient_free(&in, &motions, &left, err);
    if (rc != MODAL_OK || motions == 0)
        return rc;
    r->driven = true;
    identify_diagnose(r, "not_ambient", -1, "%d decaying or growing motions rebuild the record but "
                      "for %.2g of its rms, likelier than noise is: a free response, not the "
                      "answer to a lasting excitation, of which there are no standard errors and "
                      "no verdict; give response=free", motions, left);
    return MODAL_OK;
}

/* ---- the way ---- */

static enum modal_status report_rank(struct work *w, struct identify_result *out,
                                     struct modal_error *err)
{
    int r = w->pod.count;

    out->singular = malloc(sizeof *out->singular * (size_t)r);
    if (out->singular == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d singular values", r);
    for (int j = 0; j < r; j++)
        out->singular[j] = w->pod.s[j] / w->pod.s[0];
    out->singular_count = out->pod_rank = r;
    out->hankel_rank = 2 * w->found.model->count;
    out->energy = w->pod.energy;
    out->rule = w->opt.rank.rule;
    out->period = w->opt.period = w->periodic ? w->span : 0;
    out->dt = w->sample;
    out->decimation = 1;
    out->shift = w->phases;
    out->samples = w->Z.m * w->phases;
    out->freedom = 2 * w->spectrum.lines - whittle_unknowns(w->found.model);
    w->opt.refine = CHOICE_YES;
    out->used = w->opt;
    out->used.channels = NULL, out->used.azimuth = NULL, out->used.clock = NULL;
    out->used.cancelled = NULL, out->used.context = NULL;
    return MODAL_OK;
}

/* Over all frequencies, whatever the band is. */
static enum modal_status about_all_time(const struct work *w, struct identify_result *out,
                                        struct modal_error *err)
{
    struct spectrum whole;
    struct ambient_steady_input in = { &w->Z, &w->spectrum, w->periodic ? NULL : &w->rec, w->back };
    enum modal_status rc;

    if (w->opt.band[1] == 0)
        return ambient_steady_tell(&in, out, err);
    rc = spectrum_make(&w->Z, first_line(w), 0, &whole, err);
    if (rc == MODAL_OK) {
        in.spectrum = &whole;
        rc = ambient_steady_tell(&in, out, err);
        spectrum_done(&whole);
    }
    return rc;
}

static enum modal_status conclude(struct work *w, const struct batch *batch,
                                  struct identify_result *out, struct modal_error *err)
{
    double record = w->rec.Y.m * w->rec.step;
    bool clipped;
    enum modal_status rc = verdict_clusters(out, record, err);

    if (rc != MODAL_OK)
        return rc;
    verdict_stability(out, record);
    about_lines(w, out);
    about_modes(w, out);
    about_poles(w, out);
    clipped = screen_rails(batch, w->from, w->rows, out);
    rc = about_all_time(w, out, err);
    if (rc == MODAL_OK)
        rc = about_free(w, out, err);
    if (!w->found.model->converged || out->driven || clipped)
        verdict_withhold(out);
    return rc;
}

/* Do turns differ by what a multiplier may show?  No mode moves by more than pi a row: a line of
 * the record is 1 / turns wide, and what moves by less is no wider for it. */
static bool wanders(const struct work *w)
{
    int turns = w->Z.m;
    double moved = M_PI * w->phases / sqrt(turns), line = 1. / turns;

    return w->longer != NULL && moved * cblas_dnrm2(turns, w->longer, 1) > line;
}

static enum modal_status follow_turns(struct work *w, struct modal_error *err)
{
    const struct identify_options *o = &w->opt;
    struct ambient_wander in = { &w->Z, w->longer, w->phases,
                                 ambient_price(w->Z.n, w->spectrum.lines), o->rank.fixed > 0,
                                 o->cancelled, o->context };

    return ambient_wander_fit(&in, w->found.model, w->meet, err);
}

static enum modal_status search(struct work *w, struct modal_error *err)
{
    const struct identify_options *o = &w->opt;
    int most = o->rank.most > 0 ? (o->rank.most + 1) / 2 : WHITTLE_MODES_MOST;
    struct ambient_limits limits = { (o->rank.fixed + 1) / 2,
                                     most < WHITTLE_MODES_MOST ? most : WHITTLE_MODES_MOST,
                                     o->cancelled, o->context, 0 };
    enum modal_status rc = spectrum_make(&w->Z, first_line(w), o->band[1] * w->rec.step,
                                         &w->spectrum, err);

    w->step = rc == MODAL_OK ? w->rec.step * w->rec.Y.m / w->spectrum.samples : NAN;
    if (rc == MODAL_OK)
        rc = ambient_search(&w->spectrum, &limits, &w->found, err);
    return rc == MODAL_OK && wanders(w) ? follow_turns(w, err) : rc;
}

/* Less the lines that stand beside the modes that were found, as long as there are any.  Of a
 * periodic system lines are what does not turn with it: those have no place among its lifted
 * spectra. */
static enum modal_status search_beside_lines(struct work *w, struct modal_error *err)
{
    bool changed = true;
    enum modal_status rc = search(w, err);

    /* what no second search settles on no third one will */
    for (int i = 0; rc == MODAL_OK && !w->periodic && i < SEARCHES && !(i > 0 && w->found.limit);
         i++) {
        struct ambient_tones_input in = { &w->rec.Y, &w->pod, &w->spectrum, w->found.model,
                                          &w->found.bins, w->opt.cancelled, w->opt.context };
        rc = ambient_tones_take(&in, w->line, &w->line_count, &changed, err);
        if (rc != MODAL_OK || !changed)
            break;
        ambient_search_done(&w->found);
        spectrum_done(&w->spectrum);
        pod_done(&w->pod);
        free(w->back);
        w->back = NULL;
        rc = reduce(w, err);
        if (rc == MODAL_OK)
            rc = search(w, err);
    }
    return rc;
}

enum modal_status ambient_identify(const struct batch *batch, const struct identify_options *opt,
                                   struct identify_result *out, struct modal_error *err)
{
    struct work w = { .opt = *opt };
    enum modal_status rc;

    response_stage(opt, &w.clock, NULL, out);
    if ((rc = response_check(batch, opt, &accepted, err)) == MODAL_OK)
        rc = read_record(&w, batch, err);
    response_stage(opt, &w.clock, "read", out);
    if (rc == MODAL_OK)
        rc = reduce(&w, err);
    response_stage(opt, &w.clock, "pod", out);
    if (rc == MODAL_OK)
        rc = search_beside_lines(&w, err);
    response_stage(opt, &w.clock, "refine", out);
    if (rc == MODAL_OK && (rc = report_modes(&w, out, err)) == MODAL_OK
        && (rc = report_spectra(&w, out, err)) == MODAL_OK
        && (rc = report_orders(&w, out, err)) == MODAL_OK
        && (rc = report_rank(&w, out, err)) == MODAL_OK)
        rc = conclude(&w, batch, out, err);
    response_stage(opt, &w.clock, "verdict", out);
    ambient_search_done(&w.found);
    spectrum_done(&w.spectrum);
    pod_done(&w.pod);
    ambient_lines_done(w.line, w.line_count);
    record_done(&w.rec);
    free(w.whole.x);
    free(w.longer);
    free(w.back);
    return rc;
}
