/* widen.c - five doubts, each with the size of its error
 *
 * A fit to rounding is not doubted; but rounding errors are not white noise, and those of the fit
 * add to the data's: its standard errors grow by WIDEN_ROUNDING. Else:
 *
 *   colour   what the poles leave is not white: the standard error grows by its colour at the
 *            pole's frequency (colour.c)
 *   parts    half of the record has another exponent: the error is at least the difference
 *            (parts.c) whether the mode decays is not in doubt where the whole and both halves
 *            decay clearly by their own errors (GROWTH_NEVER), whatever their difference, unless
 *            one of the doubts below widens it further
 *   slow     what turns less than once in the record is told from an offset, a drift and other slow
 *            parts by the model alone: its error is at least its scatter (root mean square) over
 *            the orders that explain the record
 *   pairs    two strong poles nearer than half a beat over the record are told apart by the model
 *            alone; where one of the doubts above holds the model is not right, and either may be
 *            anywhere between them: the error is at least half their distance
 *   another  one more pole may be there that does not pay, or a line of a multiplier that has
 *            others (another.h): where noise would let the best gain so much in no more than a
 *            share DOUBTED of records, the error is that with it, and the difference; then the next
 *            beside it. Of a periodic system in noise that is white in all columns; of a constant
 *            one (widen_for_others) in all channels, whose price is far above what noise gives
 *
 * A difference counts from REFINE_CLEAR standard errors on: in ordinary noise fewer than one pole
 * in 300 has one.
 */
#include "modal/identify/ask/widen.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/answer/modes.h"
#include "modal/identify/fit/colour.h"
#include "modal/identify/fit/parts.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/order/another.h"
#include "modal/identify/order/order.h"

static const double
    DOUBTED = 0.05,                     /* of records: they have wider bars for nothing */
    DOUBTED_CONSTANT = 1e-3;            /* few: an update of a live window, which is asked no more
                                         * than judge_residual(), has the errors of a batch */
enum { OTHERS_MOST = 8 };               /* each costs a fit */

static bool at_rounding(const struct refine_data *d, double residual)
{
    return residual <= REFINE_EXACT * refine_norm(d);
}

/* Of what the poles leave: a factor for each frequency THETA. */
static enum modal_status colour_of(const struct refine_data *d, const struct poles *p,
                                   const double *theta, double *factor, struct modal_error *err)
{
    const struct matrix *Y = d->Y;
    struct matrix E = matrix_new(Y->m, Y->n);
    struct synthesis s = { 0 };
    enum modal_status rc;

    if (E.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "widen: no memory for residuals of %d signals",
                          Y->n);
    rc = synthesis_fit(p->lambda, p->count, p->tau, Y, &E, &s, err);
    for (int c = 0; c < Y->n && rc == MODAL_OK; c++)
        for (int l = 0; l < Y->m; l++)
            E.x[l + (size_t)c * (size_t)E.ld] -= Y->x[l + (size_t)c * (size_t)Y->ld];
    colour_leave_out(&E, Y, REFINE_EXACT);
    if (rc == MODAL_OK)
        rc = colour_factors(&E, theta, p->count, factor, err);
    synthesis_done(&s);
    free(E.x);
    return rc;
}

/* factor: a number for each pole. A very long record was asked when it was searched. */
static enum modal_status for_colour(const struct refine_data *d, const struct order_choice *choice,
                                    struct poles *p, double *factor, double *most,
                                    struct modal_error *err)
{
    const double *power = choice->rest.colour.power;
    double *theta = malloc(sizeof *theta * (size_t)p->count);
    enum modal_status rc = MODAL_OK;

    if (theta == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "widen: no memory for %d poles", p->count);
    for (int j = 0; j < p->count; j++)
        theta[j] = fabs(cimag(p->lambda[j])) * p->tau;
    if (power != NULL)
        colour_factors_of(power, COLOUR_ROWS, theta, p->count, factor);
    else
        rc = colour_of(d, p, theta, factor, err);
    for (int j = 0; j < p->count && rc == MODAL_OK; j++) {
        p->std_re[j] *= factor[j];
        p->std_im[j] *= factor[j];
        *most = fmax(*most, factor[j]);
    }
    free(theta);
    return rc;
}

static void at_least(struct poles *p, int j, double re, double im)
{
    /* an error that a doubt widened no longer says that the mode decays */
    if (re > p->std_re[j] && p->growth[j] == GROWTH_NEVER)
        p->growth[j] = GROWTH_UNSEEN;
    p->std_re[j] = re > p->std_re[j] ? re : p->std_re[j];
    p->std_im[j] = im > p->std_im[j] ? im : p->std_im[j];
}

/* A record too short to be halved cannot be asked; of few periods, where as few rows are free, that
 * is no reason to believe what is weak. */
static enum growth growth_of(const struct refine_data *d, const struct part_say *say,
                             double strength, bool decays, double factor)
{
    if (strength < 0)
        return d->phases > 1 ? GROWTH_UNASKED : GROWTH_EXACT;
    if (say->steady && (d->phases > 1 || d->omega > 0))
        return GROWTH_IN_HALVES;
    return say->grows                                          ? GROWTH_IN_HALF
        : say->re > 0 && decays && say->decay > REFINE_CLEAR * factor ? GROWTH_NEVER
                                                               : GROWTH_UNSEEN;
}

static enum modal_status for_parts(const struct refine_data *d, struct poles *p,
                                   const double *factor, double *strength, struct modal_error *err)
{
    struct part_say *say = calloc((size_t)p->count, sizeof *say);
    enum modal_status rc;

    if (say == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "widen: no memory for %d poles", p->count);
    rc = parts_ask(d, p->lambda, p->count, say, strength, err);
    for (int j = 0; j < p->count && rc == MODAL_OK; j++) {
        /* before its error is widened below */
        bool decays = creal(p->lambda[j]) + REFINE_CLEAR * p->std_re[j] < 0;
        at_least(p, j, say[j].re, say[j].im);
        p->growth[j] = growth_of(d, &say[j], *strength, decays, factor[j]);
    }
    free(say);
    return rc;
}

/* The pole of a fit nearest to lambda, of its kind, within a line's width of the record; -1: none.
 * */
static int nearest_in(const struct refined *f, double complex lambda, double width)
{
    int best = -1;

    for (int j = 0; j < f->poles; j++)
        if ((cimag(f->lambda[j]) != 0) == (cimag(lambda) != 0)
            && cabs(f->lambda[j] - lambda) < width
            && (best < 0 || cabs(f->lambda[j] - lambda) < cabs(f->lambda[best] - lambda)))
            best = j;
    return best;
}

/* Fits that explain about as much as the chosen one, whatever their order: what they leave is no
 * more than twice its rest, or a thousandth of all. */
static bool explains(const struct refined *f, double own, double all)
{
    return f->end != REFINE_DEGENERATE && f->residual <= fmax(2 * own, 1e-3 * all);
}

/* The scatter of slow pole j over the orders that explain the record. */
static void scatter(const struct order_choice *choice, double all, struct poles *p, int j,
                    double width)
{
    double own = choice->candidates[choice->chosen].fit.residual, re = 0, im = 0;
    int n = 0;

    for (int i = 0; i < choice->count; i++) {
        const struct refined *f = &choice->candidates[i].fit;
        int k =
            i != choice->chosen && explains(f, own, all) ? nearest_in(f, p->lambda[j], width) : -1;
        if (k < 0)
            continue;
        re += pow(creal(f->lambda[k] - p->lambda[j]), 2),
            im += pow(cimag(f->lambda[k] - p->lambda[j]), 2), n++;
    }
    if (n > 0)
        at_least(p, j, sqrt(re / n), sqrt(im / n));
}

static void for_slow(const struct refine_data *d, const struct order_choice *choice,
                     struct poles *p)
{
    double record = d->tau * d->Y->m, all = refine_norm(d);

    for (int j = 0; j < p->count; j++)
        /* less than a turn */
        if (cimag(p->lambda[j]) > 0 && cimag(p->lambda[j]) * record < 2 * M_PI)
            scatter(choice, all, p, j, M_PI / record);
}

static void for_pairs(const struct refine_data *d, struct poles *p)
{
    double width = M_PI / (d->tau * d->Y->m);      /* half a beat */

    for (int i = 0; i < p->count; i++)
        for (int j = 0; j < i; j++) {
            double apart = cabs(p->lambda[i] - p->lambda[j]);
            if (cimag(p->lambda[i]) == 0 || cimag(p->lambda[j]) == 0 || apart >= width)
                continue;
            at_least(p, i, apart / 2, apart / 2);
            at_least(p, j, apart / 2, apart / 2);
        }
}

/* The first poles by those of MORE; an error of what is real has no imaginary part. */
static void widen_by(const struct refined *more, struct poles *p)
{
    for (int j = 0; j < p->count; j++) {
        double complex apart = more->lambda[j] - p->lambda[j];
        double im = p->std_im[j] > 0 ? hypot(more->std_im[j], cimag(apart)) : 0;
        at_least(p, j, hypot(more->std_re[j], creal(apart)), im);
    }
}

/* By one pole more, and by the next beside that, while noise lets the best gain so much in less
 * than a share DOUBTED of records. */
static enum modal_status widen_one_by_one(const struct refine_data *d, const struct refined *fit,
                                          double doubted, struct poles *p, struct modal_error *err)
{
    struct another a = { 0 };
    bool found = fit->poles == p->count;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < OTHERS_MOST && found && rc == MODAL_OK; i++) {
        struct refined before = a.fit;
        rc = another_pole(d, before.poles > 0 ? &before : fit, &a, err);
        refined_done(&before);
        found = rc == MODAL_OK && a.chance < doubted;
        if (found)
            widen_by(&a.fit, p);
    }
    refined_done(&a.fit);
    return rc;
}

enum modal_status widen_for_others(const struct refine_data *d, const struct refined *fit,
                                   struct poles *p, struct modal_error *err)
{
    return refined_converged(fit) ? widen_one_by_one(d, fit, DOUBTED_CONSTANT, p, err) : MODAL_OK;
}

/* The five doubts, in their order. */
static enum modal_status doubt(const struct refine_data *d, const struct order_choice *choice,
                               struct poles *p, double *factor, struct widened *out,
                               struct modal_error *err)
{
    bool constant = p->shift == 1;
    enum modal_status rc = MODAL_OK;

    for (int j = 0; j < p->count; j++)
        factor[j] = 1;
    /* a band's filter colours what is left, and its rows are counted already */
    if (constant && !(d->share > 0))
        rc = for_colour(d, choice, p, factor, &out->colour, err);
    if (rc == MODAL_OK)
        rc = for_parts(d, p, factor, &out->contradiction, err);
    if (rc == MODAL_OK && constant)
        for_slow(d, choice, p);
    if (rc == MODAL_OK && constant && (out->colour > 1 || out->contradiction > 1))
        for_pairs(d, p);
    if (rc == MODAL_OK && (d->phases > 1 || d->omega > 0) && !(d->white > 0 && d->white < 1))
        rc = widen_one_by_one(d, &choice->candidates[choice->chosen].fit, DOUBTED, p, err);
    return rc;
}

enum modal_status widen_poles(const struct refine_data *d, const struct order_choice *choice,
                              struct poles *p, struct widened *out, struct modal_error *err)
{
    double *factor;
    enum modal_status rc;

    *out = (struct widened) { .colour = 1 };
    for (int j = 0; j < p->count; j++)
        p->growth[j] = GROWTH_EXACT;
    if (!p->refined || p->count == 0)
        return MODAL_OK;
    out->exact = at_rounding(d, choice->candidates[choice->chosen].fit.residual);
    if (out->exact) {
        for (int j = 0; j < p->count; j++)
            at_least(p, j, WIDEN_ROUNDING * p->std_re[j], WIDEN_ROUNDING * p->std_im[j]);
        return MODAL_OK;
    }
    factor = malloc(sizeof *factor * (size_t)p->count);
    if (factor == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "widen: no memory for %d poles", p->count);
    rc = doubt(d, choice, p, factor, out, err);
    free(factor);
    return rc;
}
