/* parts.c - the jackknife over halves of the record
 *
 * Standard errors from the Jacobian suppose that the model holds: constant exponents, white noise.
 * Where it does not - friction, drift, a transient of many modes - the poles make up for what is
 * missing and fit the whole to any accuracy; but no part of the record has them.
 *
 * A half is fitted with amplitudes of its own, first with the poles of the whole, then with poles
 * of its own that start there.  If the model holds, twice the logarithm of the ratio of likelihoods
 * is chi-square with P degrees of freedom, P the parameters of the poles [W38], so that
 *
 *     BIC(poles of the whole) - BIC(poles of its own)
 *         <= P + PARTS_DEVIATIONS sqrt(2 P) + PARTS_SLACK                                       (1)
 *
 * in all but one record of 10^6.  That holds of poles which the half shows.  One that is over
 * before the half begins, or begins after it, is free there to follow whatever noise comes
 * nearest, which wins more than chi-square says; so a pole stays where it is unless without it the
 * half's sum of squares (rise.h), in units of its noise, rises by more than its amplitudes win
 * from noise:
 *
 *     P + PARTS_DEVIATIONS sqrt(2 P) + PARTS_SLACK,   P two a column for a pair, one else.   (2)
 *
 * Where (1) fails, a pole whose own value differs by more than REFINE_CLEAR of its own standard
 * errors is contradicted, and by that difference.  Where the linear model at the start already
 * says that (1) will hold, the search ends there (refine.h, `rival`).
 *
 * What grows as a power of time, t^n, grows at n / t: in the middle of either half at 4 n / T and
 * at 4 n / (3 T). An exponent between them is off a third of itself in one half at least, which (1)
 * tells where that is more than the root of its right side in the half's standard errors: it is
 * steady, of both halves, where it grows by three times as many.
 *
 * [W38] Wilks, Ann. Math. Statist. 9 (1938) 60-62.
 */
#include "modal/identify/fit/parts.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/compressed.h"
#include "modal/identify/fit/rise.h"
#include "modal/identify/linear/exponents.h"

enum { ITERATIONS = 20 };                /* from the poles of the whole, which are near */

struct half {
    struct refine_data data;
    struct matrix Y;
    struct compressed *blocks;       /* owned, of a very long record; else NULL */
    struct refined own;
    bool *fixed;                     /* owned, per pole: at zero, or not shown: (2) */
    int free;                        /* poles that are not */
};

/* The right side of (1), and (2). */
static double allowed(double parameters)
{
    return parameters + PARTS_DEVIATIONS * sqrt(2 * parameters) + PARTS_SLACK;
}

static void half_done(struct half *h)
{
    compressed_free(h->blocks);
    refined_done(&h->own);
    free(h->fixed);
}

/* The first half of the rows of DATA, or the LATER one. */
static enum modal_status half_init(const struct refine_data *data, bool later, struct half *h,
                                   struct modal_error *err)
{
    int L = data->Y->m, rows = L / 2, first = later ? L - rows : 0;

    *h = (struct half) { .data = *data };
    h->Y = (struct matrix) { rows, data->Y->n, data->Y->ld, data->Y->x + first };
    if (data->blocks != NULL) {
        h->data.blocks = h->blocks = compressed_half(data->blocks, later);
        if (h->blocks == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "parts: no memory for %d rows", rows);
        h->Y = h->blocks->Y;
        first = L - h->Y.m;
    }
    h->data.Y = &h->Y;
    /* phases of later rows are known less well: (6) of refine.c */
    h->data.before += later ? first : 0;
    return MODAL_OK;
}

/* (1) of rise.h in units of the noise that is left, over all signals. */
static double shown(const struct projected *p, const double *rise)
{
    const struct criterion *k = &p->criterion;
    double sum = 0;

    for (int g = 0; g < k->groups; g++) {
        double noise = fmax(p->rss[g] / k->numbers, fmax(k->floor2[g], DBL_MIN));
        sum += k->energy[g] > 0 ? rise[g] / noise : 0;
    }
    return sum;
}

/* (2) of all poles, from their projection. */
static bool hold_unseen(struct half *h, const struct projected *p, const double complex *lambda,
                        int count)
{
    size_t q = (size_t)p->order, groups = (size_t)p->criterion.groups;
    double *room = malloc(sizeof *room * (q * (q + (size_t)p->columns) + 1)),
           *rise = malloc(sizeof *rise * (groups * (size_t)count + 1));
    bool ok = room != NULL && rise != NULL;

    if (ok && !p->degenerate
        && rise_without(p, p->order, lambda, count, h->data.tau, room, rise))
        for (int j = 0; j < count; j++)
            h->fixed[j] |= shown(p, rise + (size_t)j * groups)
                <= allowed(1.0 * p->columns * pole_order(lambda[j], h->data.tau));
    free(room), free(rise);
    return ok;
}

/* Which poles stay where they are. */
static enum modal_status hold(struct half *h, const double complex *lambda, int count,
                              struct modal_error *err)
{
    struct projected p = { 0 };
    enum modal_status rc;

    h->fixed = calloc((size_t)count, sizeof *h->fixed);
    if (h->fixed == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "parts: no memory for %d poles", count);
    for (int j = 0; j < count; j++)
        h->fixed[j] = lambda[j] == 0;
    rc = refine_project(&h->data, lambda, count, h->fixed, &p, err);
    if (rc == MODAL_OK && !hold_unseen(h, &p, lambda, count))
        rc = modal_fail(err, MODAL_NO_MEMORY, "parts: no memory for order %d", p.order);
    projected_done(&p);
    for (int j = 0; j < count; j++)
        h->free += !h->fixed[j];
    return rc;
}

static enum modal_status fit_half(const double complex *lambda, int count, struct half *h,
                                  struct modal_error *err)
{
    struct refine_options own = { .iterations = ITERATIONS,
                                  .work = REFINE_WORK_ASKED,
                                  /* descended only where it could contradict */
                                  .gain = allowed(2.0 * h->free) };

    return h->free == 0 ? MODAL_OK
                        : refine_poles(&h->data, lambda, count, h->fixed, &own, &h->own, err);
}

/* The left side of (1) over the right; 0 where there is nothing to compare. */
static double strength_of(const struct half *h)
{
    if (h->own.end == REFINE_DEGENERATE || !isfinite(h->own.bic))
        return 0;
    /* the prices cancel: what is left is -2 ln of the likelihoods' ratio */
    return fmax(0, (h->own.start_bic - h->own.bic) / allowed(h->own.parameters));
}

static double differs(double own, double whole, double std)
{
    double d = fabs(own - whole);

    return d > REFINE_CLEAR * std ? d : 0;
}

static void compare(const struct half *h, const double complex *lambda, int count, bool counts,
                    struct part_say *say)
{
    double told = 3 * sqrt(allowed(h->own.parameters));

    for (int j = 0; j < count && (h->own.end == REFINE_DEGENERATE || h->own.poles < count); j++)
        say[j].decay = -HUGE_VAL, say[j].steady = false;
    for (int j = 0; j < count && h->own.poles > 0; j++) {
        double complex own = h->own.lambda[j];
        if (h->fixed[j]) {
            say[j].decay = -HUGE_VAL, say[j].steady = false;    /* the half says nothing of it */
            continue;
        }
        if (counts) {
            /* the whole's own error is less than a half's: left out */
            say[j].re = fmax(say[j].re, differs(creal(own), creal(lambda[j]), h->own.std_re[j]));
            say[j].im = fmax(say[j].im, differs(cimag(own), cimag(lambda[j]), h->own.std_im[j]));
        }
        say[j].grows |= creal(own) > REFINE_CLEAR * h->own.std_re[j];
        say[j].steady &= !counts && creal(own) > told * h->own.std_re[j];
        say[j].decay =
            h->own.std_re[j] > 0 ? fmin(say[j].decay, -creal(own) / h->own.std_re[j]) : -HUGE_VAL;
    }
}

enum modal_status parts_ask(const struct refine_data *data, const double complex *lambda, int count,
                            struct part_say *say, double *strength, struct modal_error *err)
{
    int L = data->Y->m, rows = L / 2, order = poles_order(lambda, count, data->tau);
    enum modal_status rc = MODAL_OK;

    *strength = -1;
    for (int j = 0; j < count; j++)
        say[j] = (struct part_say) { .steady = true, .decay = HUGE_VAL };
    if (count == 0 || rows * (data->share > 0 ? data->share : 1) < 2 * order + PARTS_SPARE)
        return MODAL_OK;
    for (int later = 0; later < 2 && rc == MODAL_OK; later++) {
        struct half h;
        rc = half_init(data, later, &h, err);
        if (rc == MODAL_OK)
            rc = hold(&h, lambda, count, err);
        if (rc == MODAL_OK)
            rc = fit_half(lambda, count, &h, err);
        if (rc == MODAL_OK) {
            *strength = fmax(*strength, strength_of(&h));
            compare(&h, lambda, count, strength_of(&h) > 1, say);
        }
        half_done(&h);
    }
    return rc;
}
