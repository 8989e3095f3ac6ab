/* identify_poles.c - the chosen poles with their errors, and what the other orders show of them */
#include "modal/identify/identify_state.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ask/digits.h"
#include "modal/identify/ask/widen.h"
#include "modal/identify/fit/polish.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/order/another.h"

/* A step over all channels, in standard errors of all parameters. */
static const double
    STEP_SHORT = 8,                     /* up to it the linear model holds and one pass is enough
                                         * (from an efficient start it is a few); longer ones, where
                                         * channels of much noise spoilt the start, are repeated
                                         * while they shrink */
    STEP_MOST = 1e4;                    /* past it they are not believed */
enum {
    STEPS = 4,                          /* passes at most */
    TENTHS = 10                         /* of the columns, one is left out (projection.h) */
};
static const double
    EVALUATIONS = 8;                    /* of which a fit takes so many at least */

/* Steps over all channels until one is short; the last leaves its start in p->lambda and its end in
 * step->lambda.  Where they do not shrink the standard deviations are as long as the step that was
 * not believed. */
static enum modal_status step_wide(struct work *w, const bool *fixed, struct wide_step *step,
                                   struct modal_error *err)
{
    struct poles *p = &w->poles;
    double most = w->refine ? STEP_MOST : 0;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < STEPS && rc == MODAL_OK; i++) {
        rc = wide_refine(&w->rec.view, p->tau, p->lambda, p->count, fixed, most, step, err);
        if (rc != MODAL_OK || !step->taken || step->length <= STEP_SHORT)
            break;
        most = step->length / 2;    /* a step that does not halve does not converge within STEPS */
        memcpy(p->lambda, step->lambda, sizeof *p->lambda * p->count);
    }
    for (int j = 0; j < p->count && rc == MODAL_OK && w->refine && !step->taken; j++) {
        /* the distance to where the model points, at least */
        step->std_re[j] *= fmax(1, step->length);
        step->std_im[j] *= fmax(1, step->length);
    }
    return rc;
}

/* A wide batch: the step over all its channels, which also gives their coefficients. */
static enum modal_status refine_wide(struct work *w, struct modal_error *err)
{
    struct poles *p = &w->poles;
    int S = w->rec.channels, n = p->count;
    double *rest = calloc(S, sizeof *rest), *std = calloc(2 * (size_t)n + 1, sizeof *std), all = 0;
    double complex *lambda = calloc(n + 1, sizeof *lambda);
    bool *fixed = calloc(n + 1, sizeof *fixed);
    struct synthesis *f = &w->all;
    struct wide_step step = { lambda, std, std + n, NULL, rest, 0, false };
    enum modal_status rc;

    *f = (struct synthesis) { .poles = n, .order = poles_order(p->lambda, n, p->tau),
                              .rows = w->rec.Y.m, .channels = S };
    f->coefficient = step.coefficient = calloc((size_t)n * S + 1, sizeof *f->coefficient);
    f->channel_residual = calloc((size_t)S + 1, sizeof *f->channel_residual);
    f->reference = calloc(n + 1, sizeof *f->reference);
    if (rest == NULL || std == NULL || lambda == NULL || fixed == NULL || f->coefficient == NULL
        || f->channel_residual == NULL || f->reference == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles in %d channels", n,
                        S);
        goto out;
    }
    for (int j = 0; j < n; j++)
        fixed[j] = p->lambda[j] == 0;
    for (int c = 0; c < S && n == 0; c++)
        rest[c] = w->rec.scale[c];             /* no poles leave all of it */
    rc = n > 0 ? step_wide(w, fixed, &step, err) : MODAL_OK;
    for (int c = 0; rc == MODAL_OK && c < S; c++) {
        double over = w->rec.scale[c] > 0 ? 1 / w->rec.scale[c] : 0;
        for (int j = 0; j < n; j++)
            f->coefficient[j + (size_t)c * n] *= over;
        /* a norm of a channel of unit rms, from an rms in its unit */
        f->channel_residual[c] = rest[c] * over * sqrt(f->rows);
        all += f->channel_residual[c] * f->channel_residual[c];
    }
    f->residual = sqrt(all);
    for (int j = 0; rc == MODAL_OK && w->refine && j < n; j++)
        p->lambda[j] = lambda[j], p->std_re[j] = std[j], p->std_im[j] = std[n + j];
    p->fit = f;
out:
    free(rest), free(std), free(lambda), free(fixed);
    return rc;
}

/* At rounding, and yet a pole that is known to no more than nine digits: the arithmetic limits it,
 * not the data. */
static bool ill_determined(const struct work *w)
{
    const struct poles *p = &w->poles;
    bool ill = false;

    /* of a pole: nine digits are what a fit in double precision tells of any */
    for (int j = 0; j < p->count; j++)
        ill |= p->lambda[j] != 0 && !(p->std_re[j] <= REFINE_TIED * cabs(p->lambda[j]));
    return ill && w->refine && !w->rec.wide && w->data.omega == 0
        && w->choice.candidates[w->choice.chosen].fit.residual
        <= REFINE_EXACT * refine_norm(&w->data);
}

enum modal_status work_take_poles(struct work *w, struct modal_error *err)
{
    static const struct refined none = { 0 };
    const struct refined *fit =
        w->choice.chosen >= 0 ? &w->choice.candidates[w->choice.chosen].fit : &none;
    const struct matrix *VT = w->projected ? &w->projection.VT : &w->pencil.VT;
    struct poles *p = &w->poles;
    int n = fit->poles, r = w->rank < VT->m ? w->rank : VT->m;
    size_t room = (size_t)n;
    enum modal_status rc = MODAL_OK;

    *p = (struct poles) { .count = n, .shift = w->shift, .tau = w->tau, .refined = w->refine,
                          .tied = w->data.omega > 0 };
    p->lambda = workspace_room(&p->space, room, sizeof *p->lambda);
    p->std_re = workspace_numbers(&p->space, room, 1);
    p->std_im = workspace_numbers(&p->space, room, 1);
    p->bar = workspace_numbers(&p->space, room, 1);
    p->angle = workspace_numbers(&p->space, room, 1);
    p->growth = workspace_zeros(&p->space, room, sizeof *p->growth);
    if (p->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", n);
    for (int j = 0; j < n; j++) {
        p->lambda[j] = fit->lambda[j];
        /* the paper's procedure has no errors; its bars are p->bar */
        p->std_re[j] = w->refine ? fit->std_re[j] : NAN;
        p->std_im[j] = w->refine ? fit->std_im[j] : NAN;
        p->bar[j] = NAN;            /* nothing left out yet */
    }
    projection_angles(VT, r, fit->lambda, n, w->tau, p->angle);
    if (ill_determined(w))
        rc = polish_poles(&w->data, p->lambda, n, p->std_re, p->std_im, err);
    if (rc == MODAL_OK && w->projected && n > 0) {
        int columns = w->shift > 1 || w->projection.n < 2 * TENTHS ? 1
            : w->projection.n / TENTHS;
        rc = projection_bars(&w->projection, r, columns, w->tau, p->lambda, n, p->bar, err);
    }
    if (w->rec.wide && rc == MODAL_OK)
        rc = refine_wide(w, err);
    return rc;
}

/* Does pole j stay below half a step in every channel? */
static bool below_grid(const struct work *w, const struct synthesis *f, int j)
{
    for (int c = 0; c < w->rec.channels; c++) {
        double size = cabs(f->coefficient[j + (size_t)c * f->poles]) * w->rec.scale[c],
               step = w->grid[c].step;
        if (step == 0 ? w->rec.scale[c] > 0 : size > step / 2)
            return false;
    }
    return true;
}

/* Growth that rounding makes. */
static void doubt_growth_below_grid(struct work *w, const struct synthesis *f)
{
    struct poles *p = &w->poles;

    for (int j = 0; j < p->count; j++)
        /* half a step is what rounding alone may make */
        if (creal(p->lambda[j]) > 0 && below_grid(w, f, j))
            p->growth[j] = GROWTH_BELOW_GRID;
}

static enum modal_status weigh_by_digits(struct work *w, const struct batch *b,
                                         const struct synthesis *f, struct modal_error *err)
{
    struct poles *p = &w->poles;
    size_t first = (size_t)llround(w->rec.t0 / b->dt);
    struct digits_record r = { b->signals + first * b->channels,
                               b->channels,
                               work_rows_sent(w, b),
                               w->rec.channels,
                               b->dt,
                               w->rec.channel,
                               w->rec.scale,
                               w->grid };
    double *factor = malloc(sizeof *factor * (size_t)p->count);
    enum modal_status rc = factor == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", p->count)
        : digits_factors(&r, p->lambda, f, factor, err);

    for (int j = 0; j < p->count && rc == MODAL_OK; j++)
        p->std_re[j] *= factor[j], p->std_im[j] *= factor[j];
    free(factor);
    return rc;
}

/* In the channels themselves, of which the signals may lack what is weak in each. */
static enum modal_status widen_by_channels(struct work *w, struct modal_error *err)
{
    struct refine_data all = w->data;
    struct refine_options look = { .iterations = -1 }, end = { .work = REFINE_WORK_ASKED };
    struct poles *p = &w->poles;
    struct refined fit = { 0 };
    bool *fixed = calloc((size_t)p->count, sizeof *fixed), shows = false;
    enum modal_status rc = MODAL_OK;

    all.Y = &w->rec.Y;
    if (fixed == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", p->count);
    for (int j = 0; j < p->count; j++)
        fixed[j] = p->lambda[j] == 0;
    if (refine_work(&all, poles_order(p->lambda, p->count, p->tau))
        < REFINE_WORK_ASKED / EVALUATIONS)
        rc = refine_poles(&all, p->lambda, p->count, fixed, &look, &fit, err);
    if (rc == MODAL_OK && fit.poles > 0)
        rc = another_shows(&all, &fit, &shows, err);
    refined_done(&fit);
    if (rc == MODAL_OK && shows)
        rc = refine_poles(&all, p->lambda, p->count, fixed, &end, &fit, err);
    if (rc == MODAL_OK && shows)
        rc = widen_for_others(&all, &fit, p, err);
    refined_done(&fit);
    free(fixed);
    return rc;
}

/* Is it one set of constant modes in white noise, in memory?  What a grid or a filter leaves is not
 * white. */
static bool may_have_others(const struct work *w, bool rounded)
{
    return w->refine && w->shift == 1 && w->rec.period <= 0 && w->choice.clean && !rounded
        && !w->rec.wide && w->data.blocks == NULL && !(w->data.share > 0) && w->poles.count > 0
        && !w->facts.doubt.exact && w->opt.rank.rule == RANK_AUTO;
}

/* What grows by its errors, until one is found that must. */
static enum modal_status doubt_crowds(struct work *w, struct modal_error *err)
{
    struct poles *p = &w->poles;
    const struct refined *fit = w->choice.chosen >= 0
                              ? &w->choice.candidates[w->choice.chosen].fit : NULL;
    bool decays = fit != NULL && fit->poles == p->count && refined_converged(fit)
               && w->shift == 1 && w->rec.period <= 0 && !w->facts.doubt.exact;
    enum modal_status rc = MODAL_OK;

    for (int j = 0; j < p->count && decays && rc == MODAL_OK; j++) {
        if (!(creal(p->lambda[j]) > REFINE_CLEAR * p->std_re[j]))
            continue;
        rc = another_decays(&w->data, fit, j, &decays, err);
        if (decays)
            p->growth[j] = GROWTH_IN_CROWD;
    }
    return rc;
}

/* Standard errors by all that is doubted. */
enum modal_status work_widen(struct work *w, const struct batch *b,
                             const struct identify_result *out, struct modal_error *err)
{
    struct poles *p = &w->poles;
    struct synthesis own = { 0 };
    const struct synthesis *f = p->fit != NULL ? p->fit : &own;
    bool rounded = out->at_grid && w->shift == 1 && p->count > 0;
    enum modal_status rc = MODAL_OK;

    rc = work_widen_for_lacking(w, p, err);
    if (rc == MODAL_OK && rounded && p->fit == NULL)
        rc = work_fit_signals(w, p->lambda, p->count, &w->rec.Y, &own, err);
    if (rc == MODAL_OK && rounded)
        rc = weigh_by_digits(w, b, f, err);
    if (rc == MODAL_OK)
        rc = widen_poles(&w->data, &w->choice, p, &w->facts.doubt, err);
    if (rc == MODAL_OK && may_have_others(w, out->at_grid))
        rc = widen_by_channels(w, err);
    if (rc == MODAL_OK && rounded)
        doubt_growth_below_grid(w, f);
    /* what noise with a memory shows in the whole record it shows in half of it as well */
    for (int j = 0; j < p->count && w->facts.told > 0; j++)
        if (p->growth[j] == GROWTH_IN_HALF || p->growth[j] == GROWTH_IN_HALVES)
            p->growth[j] = GROWTH_UNSEEN;
    if (rc == MODAL_OK && w->refine)
        rc = doubt_crowds(w, err);
    synthesis_done(&own);
    return rc;
}

/* ---- what the ladder saw ---- */

static double pole_distance(double complex a, double complex b)
{
    return hypot(creal(a) - creal(b), fabs(cimag(a)) - fabs(cimag(b)));
}

/* The mode whose exponent a candidate's pole shows, within 1 % or five standard deviations; -1:
 * none. */
static int mode_of_pole(const struct work *w, const struct identify_result *r,
                        double complex lambda)
{
    double Omega = r->period > 0 ? 2 * M_PI / r->period : 0, nearest = HUGE_VAL;
    int which = -1;

    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        double std = m->std_re > 0 ? 5 * hypot(m->std_re, m->std_im) : 0,
               d = pole_distance(m->exponent, lambda);
        if (Omega > 0 && w->shift == 1) {
            /* exponents of a periodic system modulo i Omega */
            double im = remainder(cimag(lambda), Omega);
            d = pole_distance(m->exponent, CMPLX(creal(lambda), im));
        }
        if (d <= fmax(std, 0.01 * frequency_of(m->exponent)) && d < nearest)
            nearest = d, which = i;
    }
    return which;
}

enum modal_status work_report_ladder(struct work *w, struct identify_result *out,
                                     struct modal_error *err)
{
    const struct order_choice none = { .chosen = -1 }, *c = out->begun ? &none : &w->choice;
    int poles = 0, least = c->chosen >= 0 ? c->candidates[c->chosen].fit.order : 0;

    for (int i = 0; i < c->count; i++)
        poles += c->candidates[i].fit.poles;
    out->candidates = calloc(c->count + 1, sizeof *out->candidates);
    out->poles = calloc(poles + 1, sizeof *out->poles);
    if (out->candidates == NULL || out->poles == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d candidates", c->count);
    for (int i = 0; i < c->count; i++) {
        const struct refined *f = &c->candidates[i].fit;
        out->candidates[out->candidate_count++] =
            (struct identify_candidate){ f->order,
                                         f->bic,
                                         f->residual,
                                         c->candidates[i].refined && w->refine,
                                         refined_converged(f),
                                         i == c->chosen };
        for (int j = 0; j < f->poles; j++) {
            double complex z = f->lambda[j] + CMPLX(0, w->rec.shift_rad_s);
            out->poles[out->pole_count++] =
                (struct identify_pole){ f->order, z, w->refine ? f->std_re[j] : NAN,
                                        w->refine ? f->std_im[j] : NAN, mode_of_pole(w, out, z) };
        }
    }
    for (int m = 0; m < out->mode_count; m++) {
        int shown = 0, all = 0;
        for (int i = 0, at = 0; i < c->count; at += c->candidates[i++].fit.poles) {
            bool here = false;
            for (int j = 0; j < c->candidates[i].fit.poles; j++)
                here |= out->poles[at + j].mode == m;
            if (c->candidates[i].fit.order < least)
                continue;
            all++;
            shown += here;
        }
        /* orders below the chosen one may lack it, and rightly */
        out->modes[m].persistence = all > 1 ? (double)shown / all : NAN;
    }
    return MODAL_OK;
}
