/*
 * moving.c - a window moves on by a hop; the answer is brought up to date, not found again
 *
 * Samples are reduced as they come.  Time is cut into blocks of B samples, and each full block Y_b,
 * B x S, is kept as
 *
 *     C_b = Q^T Y_b,   k x S,    and the norms of the columns of Y_b - Q C_b, what is left,     (1)
 *
 * Q, B x k, being an orthonormal basis of l^m e^{lambda_a l}, m < MOMENTS, at the poles lambda_a of
 * the last complete identification (the anchor).  A pole that has since moved by delta is in its
 * span up to |delta tau B / 2|^MOMENTS / MOMENTS!, and so is its derivative with one power less;
 * past a limit the anchor is moved to where the poles are now.  The Y_b of more than
 * POD_CHANNELS_FEW channels go through window_qr.c: the triangle R of the window's rows, and with
 * it their proper orthogonal modes (the right singular vectors of R times the channels' scales),
 * without ever subtracting a row.
 *
 * The least-squares problem of refine.c on L rows is then one on L k / B rows (moving_fit.c), begun
 * at the poles of the window before: a few steps to the same minimum that a batch of the window
 * ends in.  Its answer is taken if nothing says that a batch would choose other poles:
 *
 *   - the fit settles, each pole pays for itself by the same margin within which order.c would try
 *     without it, and no pole wants to be two, or what is left is so near rounding that only
 *     order.c's own look at two neighbours would have it so;
 *   - no other pair would: with E_c the residual, a pair at omega lowers -2 ln(likelihood) by
 *
 *         G(omega) = - sum_c L ln(1 - 2 |E_c(omega)|^2 / (L |e_c|^2)),                          (2)
 *
 *     looked at on all frequencies of the FFT, over the window, and over its first and last quarter
 *     and sixteenth, where a pair that decays or grows has its energy.  LIKELY of a pair's price in
 *     BIC is the alarm: half of it because a frequency between two bins shows as little as 0.4 of
 *     its power;
 *   - the residual is white by the tests of colour.c, the halves of the window do not contradict
 *     the whole (parts.c, its first look), and no other special case of order.c or verdict.c is
 *     near.
 *
 * A periodic system of a whole number of samples a period goes another way: its rows are periods,
 * few enough to be read whole, and modal_identify begins at the poles of the window before in place
 * of a search (identify_result, begun), with its own criteria for poles more, fewer and split, and
 * for noise that is not white.
 *
 * Otherwise the window is identified from nothing by modal_identify, so that in doubt the two agree
 * because they are one.  A change of order in mid-record is such a case, and is said.
 */
#include "modal/identify/live/moving_state.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/answer/modes.h"
#include "modal/identify/ask/trend.h"
#include "modal/identify/ask/verdict.h"
#include "modal/identify/ask/widen.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/prepare/grid.h"
#include "modal/identify/prepare/pod.h"
#include "modal/identify/prepare/rounding.h"
#include "modal/linalg/svd.h"

enum { GRID_LOOK = 24 };                         /* samples */
/* times the variance of rounding; identify_signals.c's own question is asked at 2 */
static const double GRID_NEAR = 4;
static const double
    ONCE = 1.001,                   /* turns in the window: what turns less is slow (widen.c) */
    CONSTANT = 0.3;                 /* decay over the window: an offset, as modes.c has it */

/* In the order of enum reason. */
static const char *const moving_reasons[] = {
    "first",          "options",   "not_settled",  "order_less", "order_more",
    "pole_splits",    "offset",    "undetermined", "not_white",  "channels_by_noise",
    "parts_disagree", "weak_mode", "quantised",    NULL
};

/* ---- life ---- */

void moving_free(struct moving *m)
{
    if (m == NULL)
        return;
    anchor_forget(m);
    for (int i = 0; i < 3; i++)
        if (m->plan[i] != NULL)
            fftw_destroy_plan(m->plan[i]);
    fftw_free(m->x), fftw_free(m->X);
    free(m->kept[0].V), free(m->kept[1].V);
    window_qr_free(m->all);
    free(m->blocks);
    free(m->rows);
    free(m);
}

/* Everything that record.c and identify.c do before the signals are fitted is here a scale: no
 * other preparation. */
static bool is_possible(const struct moving_options *o)
{
    const struct identify_options *i = &o->identify;
    bool whole = i->window[0] == 0 && i->window[1] == 0 && i->band[0] == 0 && i->band[1] == 0;

    return o->channels <= MOVING_CHANNELS_MOST && o->window > 2 * o->channels
        && i->response == RESPONSE_FREE && i->method == IDENTIFY_AUTO && i->channels == NULL
        && i->pod_energy == 0 && i->pod_rank == 0 && i->detrend == DETREND_NONE
        && i->scale == SCALE_RMS && i->rows == 0 && i->columns == 0 && i->stride <= 1 && whole
        && (i->period < 0 || (i->period == 0 && o->period == 0)) && !i->difference
        && i->refine != CHOICE_NO && (i->rank.rule == RANK_AUTO || i->rank.rule == RANK_FIXED)
        && i->target_error == 0 && i->target_seconds == 0;
}

enum modal_status moving_new(const struct moving_options *options, struct moving **out,
                             struct modal_error *err)
{
    struct moving *m;
    enum modal_status rc = MODAL_OK;

    if (options->channels < 1 || options->window < IDENTIFY_SAMPLES_LEAST)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "window",
            "a window of %d samples of %d channels; accepted: %d samples or more", options->window,
            options->channels, IDENTIFY_SAMPLES_LEAST);
    m = calloc(1, sizeof *m);
    if (m == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory");
    m->opt = *options;
    m->S = options->channels, m->L = options->window;
    m->possible = is_possible(options);
    m->room = 2 * (size_t)m->L + 1;
    m->rows = malloc(sizeof *m->rows * m->room * (size_t)m->S);
    if (m->rows == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY,
                        "moving: no memory for a window of %d samples of %d channels", m->L, m->S);
    if (rc == MODAL_OK && m->possible && moving_reduced(m))
        rc = window_qr_new(m->S, &m->all, err);
    if (rc != MODAL_OK)
        moving_free(m);
    else
        *out = m;
    return rc;
}

/* ---- channels by their noise, as identify_signals.c ---- */

static enum modal_status look_at_channels(struct job *j, const struct moving_fit *f,
                                          struct moving_fit *out, struct modal_error *err)
{
    int S = j->m->S, n = j->Y.m;
    double *x = malloc(sizeof *x * (size_t)S * (size_t)(n + 1));
    struct moving_signals y = { { n, S, n, x }, x + (size_t)n * (size_t)S };
    enum modal_status rc;

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", n, S);
    job_channels(j, &y.X, x + (size_t)n * (size_t)S);
    rc = moving_look(&j->rows, &y, f->lambda, f->poles, out, err);
    j->work += out->work;
    free(x);
    return rc;
}

/* Whether the channels are to be weighed; their weights. */
static enum modal_status weigh_channels(struct job *j, const struct moving_fit *f, bool *weighed,
                                        struct modal_error *err)
{
    int S = j->m->S;
    double least = HUGE_VAL, most = 0, total = 0, rest = 0;
    struct moving_fit look = { 0 };
    /* and where they are not, what the report needs */
    enum modal_status rc = look_at_channels(j, f, &look, err);

    *weighed = false;
    for (int c = 0; c < S && rc == MODAL_OK; c++) {
        double noise = fmax(sqrt(look.rss[c] / j->m->L), NOISE_QUIETEST);
        total += j->scale[c] > 0 ? j->m->L : 0, rest += look.rss[c];
        least = j->scale[c] > 0 ? fmin(least, noise) : least,
        most = j->scale[c] > 0 ? fmax(most, noise) : most;
    }
    if (rc == MODAL_OK && sqrt(rest) > REFINE_EXACT * sqrt(total) && most > NOISE_ALIKE * least) {
        *weighed = j->weighed = true;
        for (int c = 0; c < S; c++)
            /* as identify_signals.c: the quietest keeps its own */
            j->weight[c] = least / fmax(sqrt(look.rss[c] / j->m->L), NOISE_QUIETEST);
    }
    if (rc == MODAL_OK && !*weighed)
        j->channels = look;
    else
        moving_fit_done(&look);
    return rc;
}

static enum modal_status fit(struct job *j, const struct poles_of *start, bool modes,
                             struct moving_fit *out, enum reason *why, struct modal_error *err)
{
    struct moving_signals y;
    enum modal_status rc = job_signals(j, modes, err);

    y = (struct moving_signals) { j->X, j->outside2 };
    if (rc == MODAL_OK)
        rc = moving_fit(&j->rows, &y, start->lambda, start->count, out, err);
    j->work += out->work;
    if (rc == MODAL_OK)
        *why = judge_fit(j, out);
    if (rc == MODAL_OK && *why == POLE_SPLITS)
        rc = judge_split(j, out, why, err);
    return rc;
}

/* Signals, poles, and whether they stand. */
static enum modal_status fit_window(struct job *j, enum reason *why, struct modal_error *err)
{
    struct moving *m = j->m;
    bool weighed = false, before = m->first.count > 0;
    enum modal_status rc = fit(j, before ? &m->first : &m->own, moving_reduced(m),
                               before ? &j->first : &j->own, why, err);

    if (rc == MODAL_OK && *why == GOOD && moving_reduced(m)) {
        rc = weigh_channels(j, before ? &j->first : &j->own, &weighed, err);
        if (rc == MODAL_OK && weighed != before)  /* the choice itself is the batch's to make */
            *why = BY_NOISE;
        if (rc == MODAL_OK && *why == GOOD && before)
            rc = fit(j, &m->own, true, &j->own, why, err);
    }
    return rc;
}

/* ---- update, or from nothing ---- */

/* Does a batch do something beside the fit with these poles?  A crowd is looked at window by
 * window; what turns less than once in the window has the scatter over other orders for its error
 * (widen.c); a constant, 0, is an offset where it is the only slow pole, as modes.c has it. */
static bool special(const struct moving *m, const double complex *lambda, int count)
{
    double record = m->L * m->opt.dt;
    int constants = 0, slow = 0;

    for (int i = 0; i < count; i++) {
        int near = 0;
        for (int j = 0; j < count; j++)
            near += cimag(lambda[j]) > 0
                && fabs(cimag(lambda[j]) - cimag(lambda[i])) < TREND_CLOSE * cimag(lambda[i]);
        constants += lambda[i] == 0;
        slow += lambda[i] != 0 && cabs(lambda[i]) * record < 2 * CONSTANT;      /* hardly moves */
        /* its error would be its scatter over orders, of which an update has one */
        if (cimag(lambda[i]) > 0 && cimag(lambda[i]) * record < ONCE * 2 * M_PI)
            return true;
        if (near >= TREND_CROWD
            || (pole_kind(lambda[i], m->opt.dt) == POLE_REAL && lambda[i] != 0
                && fabs(creal(lambda[i])) * record < CONSTANT))
            return true;
    }
    return count == constants || constants > 1 || (constants > 0 && slow > 0);
}

static bool has_weak_mode(const struct identify_result *r)
{
    bool any = false;

    for (int i = 0; i < r->mode_count; i++)
        any |= r->modes[i].energy < VERDICT_WEAK;
    return any;
}

/* Does a mode grow beyond its errors beside another within a beat over the window?  The two may
 * draw it: a batch asks whether, with one more there, none need grow (another_decays()). */
static bool neighbour_grows(const struct moving *m, const struct identify_result *r)
{
    double beat = 2 * M_PI / (m->L * m->opt.dt);
    bool any = false;

    for (int i = 0; i < r->mode_count; i++)
        for (int j = 0; j < r->mode_count; j++) {
            const struct identify_mode *a = &r->modes[i], *b = &r->modes[j];
            any |= j != i && cimag(a->exponent) > 0 && cimag(b->exponent) > 0
                && creal(a->exponent) > REFINE_CLEAR * a->std_re
                && fabs(cimag(a->exponent) - cimag(b->exponent)) < beat;
        }
    return any;
}

/* Does a verdict of RESULT need what an update does not know?  A weak mode's say needs its
 * persistence, which only a ladder of orders knows; a crowd's growth parts of the window. */
static bool needs_more(const struct identify_result *r)
{
    return has_weak_mode(r) || verdict_crowd_grows(r);
}

static struct batch window_batch(const struct moving *m)
{
    return (struct batch) { .samples = (size_t)m->L,
                            .channels = (size_t)m->S,
                            .signals = moving_sample(m, m->next - (uint64_t)m->L),
                            .dt = m->opt.dt,
                            .period = m->opt.period };
}

/* A periodic system: from the poles of the window before, in periods (identify_periods.c). *why,
 * GOOD where they are the answer: else the result is none, or one that was searched for. */
static enum modal_status from_known(struct moving *m, struct identify_result *out,
                                    enum reason *why, struct modal_error *err)
{
    struct batch batch = window_batch(m);
    struct identify_options opt = m->opt.identify;
    struct identify_chosen known = { m->own.lambda, m->own.count };
    enum modal_status rc;

    opt.known = &known;
    rc = modal_identify(&batch, &opt, out, err);
    *why = GOOD;
    if (rc == MODAL_OK && (!out->begun || out->at_grid))
        *why = NOT_SETTLED;
    else if (rc == MODAL_OK && needs_more(out))
        *why = has_weak_mode(out) ? WEAK_MODE : UNDETERMINED;
    return rc;
}

/* The poles of RESULT, where the next window can begin at them. */
static enum modal_status keep_periodic(struct moving *m, const struct identify_result *result,
                                       struct modal_error *err)
{
    m->periodic = result->shift > 1;
    if (m->periodic && !poles_take(&m->own, result->chosen.lambda, result->chosen.count))
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d poles",
                          result->chosen.count);
    return MODAL_OK;
}

static enum modal_status from_nothing(struct moving *m, struct identify_result *out,
                                      struct modal_error *err)
{
    struct batch batch = window_batch(m);
    enum modal_status rc = modal_identify(&batch, &m->opt.identify, out, err);

    m->batches++;
    anchor_forget(m);
    m->reason = FIRST;
    if (rc != MODAL_OK || !m->possible)
        return rc == MODAL_OK ? keep_periodic(m, out, err) : rc;
    if (out->at_grid) {
        m->reason = GRID;
        return rc;
    }
    if (special(m, out->chosen.lambda, out->chosen.count)) {
        m->reason = out->chosen.count == 0 ? NOT_SETTLED : OFFSET;
        return rc;
    }
    if (!poles_take(&m->own, out->chosen.lambda, out->chosen.count)
        || !poles_take(&m->first, out->unweighed.lambda, out->unweighed.count)
        || anchor_set(m, &m->own, NULL) != MODAL_OK)
        anchor_forget(m);                  /* the answer stands; the next one is from nothing too */
    return MODAL_OK;
}

/* One try from the anchor as it is. */
static enum modal_status update(struct job *j, enum reason *why, struct modal_error *err)
{
    enum modal_status rc = job_take(j, err);

    if (rc == MODAL_OK
        && moving_rows_count(&j->rows)
            /* [Phi D X] needs as many rows */
            < 2 * poles_order(j->m->own.lambda, j->m->own.count, j->m->opt.dt) + j->m->S) {
        *why = OPTIONS;
        return MODAL_OK;
    }
    if (rc == MODAL_OK)
        rc = fit_window(j, why, err);
    return rc;
}

static bool below_rounding(const struct job *j)
{
    double most = largest_magnitude(j->scale, (size_t)j->m->S);

    for (int c = 0; c < j->m->S; c++)
        /* a batch may make it a zero channel: ten times before it does */
        if (j->scale[c] > 0 && j->scale[c] < 10 * ROUNDING_RATIO * most)
            return true;
    return false;
}

/* What widen.c does: nothing where the fit is exact, beside rounding; further from rounding a batch
 * may still see a pair in it. */
static enum modal_status doubt(struct job *j, enum reason *why, struct modal_error *err)
{
    struct moving_fit *f = &j->own;
    double rest = 0, all = 0;

    j->growth = calloc((size_t)f->poles + 1, sizeof *j->growth);
    if (j->growth == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d poles", f->poles);
    for (int g = 0; g < f->signals; g++)
        rest += f->rss[g], all += f->energy[g];
    j->exact = sqrt(rest) <= REFINE_EXACT * sqrt(all);
    for (int i = 0; i < f->poles; i++) {
        j->growth[i] = GROWTH_EXACT;
        f->std_re[i] *= j->exact ? WIDEN_ROUNDING : 1,
            f->std_im[i] *= j->exact ? WIDEN_ROUNDING : 1;
    }
    if (below_rounding(j))
        *why = OPTIONS;
    return *why != GOOD ? MODAL_OK : judge_residual(j, f, why, err);
}

/* Are the samples of a channel on a grid that what its fit leaves may be the rounding to?  A grid
 * shows in few samples, and is then asked for in all. */
static bool near_grid(const struct job *j, const struct moving_fit *f)
{
    const struct moving *m = j->m;
    const double *y = moving_sample(m, m->next - (uint64_t)m->L);

    for (int c = 0; c < m->S; c++) {
        double left = f->rss[c] / m->L * j->scale[c] * j->scale[c], step;
        int skip = m->L / GRID_LOOK > 1 ? m->L / GRID_LOOK : 1;
        if (j->scale[c] == 0 || grid_of(y + c, (size_t)(skip * m->S), m->L / skip).step == 0)
            continue;
        step = grid_of(y + c, (size_t)m->S, m->L < GRID_SAMPLES ? m->L : GRID_SAMPLES).step;
        if (left < GRID_NEAR * GRID_NOISE_MOST * step * step)
            return true;
    }
    return false;
}

static enum modal_status try_update(struct moving *m, struct job *j, enum reason *why,
                                    struct modal_error *err)
{
    enum modal_status rc = update(j, why, err);

    /* once more, from an anchor where the poles are now */
    if (rc == MODAL_OK && *why == GOOD && !anchor_is_near(m, &j->own)) {
        struct poles_of here = { j->own.lambda, j->own.poles };
        double work = j->work;
        rc = anchor_set(m, &here, err);
        job_done(j);
        *j = (struct job) { .m = m, .work = work };
        if (rc == MODAL_OK)
            rc = update(j, why, err);
    }
    if (rc == MODAL_OK && *why == GOOD && special(m, j->own.lambda, j->own.poles))
        *why = OFFSET;
    if (rc == MODAL_OK && *why == GOOD)
        rc = doubt(j, why, err);
    if (rc == MODAL_OK && *why == GOOD && moving_reduced(m) && j->weighed)
        rc = look_at_channels(j, &j->own, &j->channels, err);
    if (rc == MODAL_OK && *why == GOOD && near_grid(j, moving_reduced(m) ? &j->channels : &j->own))
        *why = GRID;
    return rc;
}

static enum modal_status identify_periodic(struct moving *m, struct identify_result *out,
                                           enum reason *why, struct modal_error *err)
{
    enum modal_status rc = from_known(m, out, why, err);

    if (rc != MODAL_OK)
        return rc;
    if (*why == WEAK_MODE || *why == UNDETERMINED) {
        identify_result_done(out);
        return from_nothing(m, out, err);
    }
    m->updates += *why == GOOD, m->batches += *why != GOOD;
    return keep_periodic(m, out, err);
}

/* A constant system: the update that J has tried, if WHY is GOOD. */
static enum modal_status conclude(struct moving *m, struct job *j, struct identify_result *out,
                                  enum reason *why, struct modal_error *err)
{
    enum modal_status rc = *why == GOOD ? moving_report(j, out, err) : MODAL_OK;

    if (rc == MODAL_OK && *why == GOOD && (needs_more(out) || neighbour_grows(m, out))) {
        *why = has_weak_mode(out) ? WEAK_MODE : UNDETERMINED;
        identify_result_done(out);
    }
    if (rc == MODAL_OK && *why != GOOD)
        return from_nothing(m, out, err);
    if (rc == MODAL_OK
        && (!poles_take(&m->own, j->own.lambda, j->own.poles)
            || !poles_take(&m->first, j->first.lambda, j->first.poles)))
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d poles", j->own.poles);
    m->updates += rc == MODAL_OK;
    return rc;
}

enum modal_status moving_identify(struct moving *m, struct identify_result *out,
                                  struct moving_cost *cost, struct modal_error *err)
{
    struct job j = { .m = m };
    enum reason why = m->possible ? (enum reason)m->reason : OPTIONS;
    enum modal_status rc = MODAL_OK;

    memset(out, 0, sizeof *out);
    if (moving_samples(m) < m->L)
        return modal_fail(err, MODAL_BAD_INPUT, "moving: %d of %d samples", moving_samples(m),
                          m->L);
    if (m->anchored)
        rc = try_update(m, &j, &why, err);
    if (m->periodic)
        rc = identify_periodic(m, out, &why, err);
    else if (m->anchored && rc == MODAL_OK)
        rc = conclude(m, &j, out, &why, err);
    else if (rc == MODAL_OK || rc == MODAL_NO_CONVERGENCE)
        rc = from_nothing(m, out, err);
    if (rc != MODAL_OK)
        identify_result_done(out);
    if (cost != NULL)
        *cost = (struct moving_cost) { why == GOOD, why == GOOD ? NULL : moving_reasons[why],
                                       why == GOOD ? j.work : 0, m->updates, m->batches };
    job_done(&j);
    return rc;
}
