/* identify_doubt.c - whether one set of exponents is the right model, and what is concluded */
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/ask/drift.h"
#include "modal/identify/identify_state.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ask/merge.h"
#include "modal/identify/ask/screen.h"
#include "modal/identify/ask/trend.h"
#include "modal/identify/ask/verdict.h"
#include "modal/identify/fit/stationary.h"
#include "modal/identify/linear/exponents.h"
#include "modal/numbers.h"

enum { NOISE_ROWS = 65536 };      /* asked whether they are noise: the first, where motion is */
static const double
    ORBIT_LEAST = 0.01;          /* of the energy: less may be what others leave */

/* A multiplier of 1 that is no offset, in a periodic system: the orbit itself. */
static bool has_orbit(const struct work *w, const struct identify_result *r)
{
    bool found = false;

    for (int i = 0; i < r->mode_count && r->period > 0 && !w->opt.difference; i++) {
        const struct identify_mode *m = &r->modes[i];
        double bar = fmax(1e-9,
                          fmin(0.05,
                               3
                                   * (isfinite(m->std_multiplier) ? m->std_multiplier
                                          : isfinite(m->bar)      ? m->bar
                                                                  : 0)));
        /* the orbit repeats after a period: its multiplier is 1 */
        found |= fabs(creal(m->multiplier) - 1) <= bar && cimag(m->multiplier) == 0
            && m->energy > ORBIT_LEAST;
    }
    return found;
}

/* Has the strongest pole a neighbour with a shape of its own?  Poles of one mode share it. */
static bool shapes_differ(const struct synthesis *f, const double complex *lambda)
{
    int at = -1, n = f->poles;
    double most = 0, one = 1, aa = 0;

    for (int j = 0; j < n; j++) {
        double size = cblas_dznrm2(f->channels, f->coefficient + j, n);
        if (cimag(lambda[j]) != 0 && size > most)
            at = j, most = size;
    }
    aa = most * most;
    for (int j = 0; j < n && at >= 0; j++) {
        double complex ab;
        double bb = cblas_dznrm2(f->channels, f->coefficient + j, n);
        if (j == at || fabs(cimag(lambda[j]) / cimag(lambda[at]) - 1) > TREND_CLOSE)
            continue;
        ab = numbers_row_dot(f->channels, f->coefficient + at, n, f->coefficient + j, n);
        /* the modal assurance criterion of two shapes */
        one = fmin(one, creal(ab * conj(ab)) / (aa * bb * bb));
    }
    return one < TREND_ONE_SHAPE;
}

/* Lines that the record resolves, in white noise, with shapes of their own: no one mode changes. */
static enum modal_status neighbours_beat(const struct work *w, bool *beat, struct modal_error *err)
{
    const struct poles *p = &w->poles;
    struct synthesis f = { 0 };
    enum modal_status rc;

    *beat = false;
    if (!w->choice.clean || w->choice.crowded || w->X->n < 2)
        return MODAL_OK;
    rc = work_fit_signals(w, p->lambda, p->count, w->X, &f, err);
    *beat = rc == MODAL_OK && shapes_differ(&f, p->lambda);
    synthesis_done(&f);
    return rc;
}

/* What a very long record's poles leave of it, where that was seen to be white noise when it was
 * searched; else 0. */
static double white_left(const struct work *w)
{
    if (!w->choice.clean || !w->choice.rest.known)
        return 0;
    /* trend_watch() need not read the rows again */
    return w->choice.candidates[w->choice.chosen].fit.residual / refine_norm(&w->data);
}

/* What noise drives for so long that no pole is worth its price. */
static void say_driven(struct identify_result *out)
{
    out->driven = true;
    identify_diagnose(out, "not_free_decay", -1, "no modes draw what stands above the noise, and "
                      "its spectrum is ragged: the response is driven; give response=ambient where "
                      "nobody measured the excitation, response=forced and its channels as inputs "
                      "where it was measured, or window a part after it has ended");
}

/* More modes than windows tell, where these said nothing. */
static enum modal_status doubt_many(const struct work *w, struct identify_result *out,
                                    struct modal_error *err)
{
    const struct poles *p = &w->poles;
    const struct refined *fit = w->choice.chosen >= 0
                              ? &w->choice.candidates[w->choice.chosen].fit : NULL;

    if (fit == NULL || p->count <= TREND_MODES || out->driven || !w->facts.converged)
        return MODAL_OK;
    return drift_watch(&w->data, p->lambda, p->count, fit->noise,
                       w->rec.shift_rad_s / (2 * M_PI), out, err);
}

/* Is one set of exponents the right model?  A mode that follows its amplitude is reported as one,
 * not as the crowd of poles that makes up for it. */
enum modal_status work_doubt(struct work *w, struct identify_result *out, struct modal_error *err)
{
    struct poles *p = &w->poles;
    struct trend_input in = { w->X,
                              w->rec.step,
                              w->rec.t0,
                              p->lambda,
                              p->count,
                              w->rec.shift_rad_s / (2 * M_PI),
                              w->opt.cancelled,
                              w->opt.context,
                              w->ragged,
                              white_left(w) };
    bool follows = false, beat;
    int said = out->diagnostic_count;
    enum modal_status rc;

    if (!w->refine || w->shift > 1 || w->rec.period > 0 || work_is_explained(w, out))
        return MODAL_OK;
    rc = neighbours_beat(w, &beat, err);
    if (rc == MODAL_OK && !beat)
        rc = trend_watch(&in, out, &follows, err);
    if (rc == MODAL_OK && out->diagnostic_count == said)
        rc = doubt_many(w, out, err);
    if (rc == MODAL_OK && follows && p->fit == NULL)
        rc = merge_crowds(&w->data, out->trend, out->trend_count, in.hertz, p, &w->facts.converged,
                          err);
    if (rc == MODAL_OK && follows)
        out->hankel_rank = poles_order(p->lambda, p->count, p->tau);
    if (rc == MODAL_OK && !beat && w->ragged > 0 && p->count == 0
        && out->diagnostic_count == said)
        say_driven(out);
    return rc;
}

/* Is the fit that shows growth one that may be drawing something else: not at its least, leaving
 * noise, in need of many growing modes, or of a crowd where one line that drifts may be? Of that,
 * shapes tell more than one signal does.  Few modes draw nothing else to rounding. */
static bool growth_is_doubtful(const struct work *w, const struct trend_input *in,
                               const struct identify_result *r)
{
    return !w->facts.doubt.exact
        && (!w->facts.converged || w->facts.doubt.colour > 1 || w->facts.doubt.contradiction > 1
            || verdict_crowd_grows(r)
            || (w->X->n < 2 && trend_crowds(in, r->modes[r->decides].exponent)));
}

/* Where it is, parts of the record must show growth for themselves. */
static enum modal_status confirm_growth(struct work *w, struct identify_result *out,
                                        struct modal_error *err)
{
    struct trend_input in = { w->X, w->rec.step, w->rec.t0, w->poles.lambda, w->poles.count,
                              w->rec.shift_rad_s / (2 * M_PI), w->opt.cancelled, w->opt.context,
                              0, 0 };
    bool shown = true;
    enum modal_status rc = MODAL_OK;

    if (out->verdict == VERDICT_UNSTABLE && w->refine && w->shift == 1 && w->rec.period <= 0
        && growth_is_doubtful(w, &in, out))
        rc = trend_growth(&in, out, &shown, err);
    if (rc != MODAL_OK || shown)
        return rc;
    out->verdict = VERDICT_UNDECIDED;
    w->facts.rejected = true;       /* of the growth that it is sure of nothing is seen in parts */
    identify_diagnose(
        out, "growth_unconfirmed", -1,
        "mode %d (%.5g Hz) grows in the fit to the whole record, which does not hold throughout, "
        "and no part of the record grows for itself: a motion set off anew (an impact, a load that "
        "changes) looks so, and one that is driven; there are no standard errors and no verdict; "
        "identify a part by `window`, or give response=ambient where it is excited all the time",
        out->decides, cabs(out->modes[out->decides].exponent) / (2 * M_PI));
    return MODAL_OK;
}

static bool says(const struct identify_result *r, const char *code)
{
    bool said = false;

    for (int i = 0; i < r->diagnostic_count; i++)
        said |= strcmp(r->diagnostics[i].code, code) == 0;
    return said;
}

/* What is asked whether it is noise, a row each *STEP seconds: under noise a periodic system is
 * stationary from period to period, at any phase, of which the strongest shows the most. */
static struct matrix noise_rows(const struct work *w, double *step)
{
    const struct matrix *Y = w->data.Y;
    struct matrix X = *w->X;
    int p = w->shift, best = 0;
    double most = -1;

    *step = w->rec.step;
    for (int k = 0; k < p && p > 1; k++) {
        double sum = 0;
        for (int c = k; c < Y->n; c += p)
            sum += cblas_ddot(Y->m, Y->x + (size_t)c * Y->ld, 1, Y->x + (size_t)c * Y->ld, 1);
        if (sum > most)
            most = sum, best = k;
    }
    if (p > 1) {
        X = (struct matrix) { Y->m, Y->n / p, Y->ld * p, Y->x + (size_t)best * Y->ld };
        *step = w->data.tau;
    }
    X.m = X.m < NOISE_ROWS ? X.m : NOISE_ROWS;
    return X;
}

/* The logarithms of the likelihoods of the first rows: each signal as stationary noise, and as that
 * beside the chosen poles, each number of which costs ln(rows)/2. */
static enum modal_status weigh_noise(const struct work *w, double *noise, double *modes,
                                     struct modal_error *err)
{
    const struct poles *p = &w->poles;
    double one, step;
    struct matrix X = noise_rows(w, &step), E;
    struct synthesis f = { 0 };
    int order = poles_order(p->lambda, p->count, step);
    enum modal_status rc = MODAL_OK;

    E = matrix_new(X.m, X.n);
    if (E.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d x %d", X.m, X.n);
    rc = synthesis_fit(p->lambda, p->count, step, &X, &E, &f, err);
    *noise = 0, *modes = -0.5 * order * (1 + X.n) * log(X.m);
    for (int c = 0; c < X.n && rc == MODAL_OK; c++) {
        const double *x = X.x + (size_t)c * (size_t)X.ld;
        double *e = E.x + (size_t)c * (size_t)E.ld;
        cblas_dscal(X.m, -1, e, 1);
        cblas_daxpy(X.m, 1, x, 1, e, 1);
        rc = stationary_likelihood(x, X.m, &one, err);
        if (rc == MODAL_OK && one == HUGE_VAL)     /* zero, a dead channel: it tells nothing */
            continue;
        *noise += one;
        if (rc == MODAL_OK)
            rc = stationary_likelihood(e, X.m, &one, err);
        *modes += one;
    }
    synthesis_done(&f);
    free(E.x);
    return rc;
}

/*
 * Where the chosen poles leave what is no white noise: is all of it likelier noise that passed a
 * filter?  Beside decaying modes there may be such noise, too; it is no free response where they
 * are not worth their price over it alone.  The multipliers of a periodic system may be so many
 * that they draw each phase; halves of the record tell then.
 */
static enum modal_status say_noise(const struct work *w, struct identify_result *out,
                                   struct modal_error *err)
{
    const struct widened *doubt = &w->facts.doubt;
    double noise = 0, modes = 0;
    enum modal_status rc;

    /* a stride, or a period of no whole number of samples: rows are no samples that follow */
    if (!w->refine || (w->shift > 1) != (w->rec.period > 0) || out->mode_count == 0 || out->driven
        || w->X->x == NULL || w->data.Y == NULL || says(out, "amplitude_dependent") || doubt->exact
        || !(doubt->colour > 1 || (w->shift > 1 && doubt->contradiction > 1)))
        return MODAL_OK;
    rc = weigh_noise(w, &noise, &modes, err);
    if (rc != MODAL_OK || modes > noise)
        return rc;
    out->driven = true;
    identify_diagnose(out, "not_free_decay", -1, "stationary noise through a filter is likelier "
                      "than these modes with such noise beside them: the response is driven, "
                      "of which there are no standard errors and no verdict; give response=ambient "
                      "where nobody measured the excitation, response=forced and its channels as "
                      "inputs where it was measured");
    return MODAL_OK;
}

/*
 * Is the model refuted, and not by what a mode's amplitude explains?  Halves of the record refute
 * it (parts.c), in one record of 10^6 that it is true of; errors widened to what they differ by
 * serve where all of it decays or something grows by those errors still.  Where that is open they
 * are the errors of a model that is not the record's: what is driven throughout is one.  Refuted it
 * is, too, where modes rebuild each window for itself, others in each (trend.c), and those of the
 * whole do not rebuild it: a swept sine is one, and damping that the sweep's envelope draws none.
 */
static bool is_rejected(const struct work *w, const struct identify_result *r)
{
    bool changes = says(r, "changes_in_record") && r->total_relative_error > TREND_REBUILT;

    return (changes || (w->facts.doubt.contradiction > 1 && r->verdict == VERDICT_UNDECIDED))
           && !r->driven && !says(r, "amplitude_dependent");
}

/* Where poles nearly coalesce their parts are far larger than their sum,
 * and so is what rounding leaves. */
static bool at_rounding_of_parts(const struct work *w, const struct identify_result *r)
{
    const double ROUNDINGS = 16;
    double parts = 0;

    for (int i = 0; i < r->mode_count; i++)
        parts += r->modes[i].amplitude * r->modes[i].amplitude;  /* as if they did not cancel */
    return w->choice.chosen >= 0 && w->choice.candidates[w->choice.chosen].fit.residual
        <= ROUNDINGS * DBL_EPSILON * sqrt(parts) * refine_norm(&w->data);
}

enum modal_status work_conclude(struct work *w, const struct batch *batch,
                                struct identify_result *out, struct modal_error *err)
{
    double duration = w->data.Y->m * w->tau;
    int decides;
    enum modal_status rc = verdict_clusters(out, duration, err);

    if (rc != MODAL_OK)
        return rc;
    w->facts.converged |= at_rounding_of_parts(w, out);
    if (w->refine && w->shift == 1 && w->rec.period <= 0)
        trend_mark_harmonics(out);
    verdict_stability(out, duration);
    if ((rc = confirm_growth(w, out, err)) != MODAL_OK)
        return rc;
    w->facts.rows = w->data.Y->m;
    w->facts.record = duration;
    w->facts.tau = w->tau;
    w->facts.orbit = has_orbit(w, out);
    w->facts.below = w->rec.below;
    if ((rc = say_noise(w, out, err)) != MODAL_OK)
        return rc;
    w->facts.rejected |= is_rejected(w, out);
    diagnose(out, &w->facts);
    screen_samples(batch, out);
    work_report_growth(w, out);
    work_report_grids(w, out);
    work_report_wild(w, out);
    work_report_steps(w, out);
    if (w->refine && w->shift == 1 && w->rec.period <= 0)
        trend_of_modes(w->X->m * w->rec.step, out);
    decides = out->decides;
    if (!w->facts.converged || out->driven || w->facts.rejected)
        verdict_withhold(out);
    if (w->facts.converged && !out->driven)
        out->decides = decides;     /* what leaves a rejected model's verdict open */
    return MODAL_OK;
}
