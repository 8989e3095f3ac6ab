/*
 * order_climb.c - candidates of one search: fitted, refined, weeded, within its work; and the price
 * of another
 *
 * [LM00] Laurent and Massart, Ann. Statist. 28 (2000) 1302-1338.
 */
#include "modal/identify/linear/exponents.h"
#include "modal/identify/order/order_state.h"
#include "modal/identify/order/trim.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

double climb_bic(const struct climb *c, int i)
{
    return i < 0 ? HUGE_VAL : c->choice.candidates[i].fit.bic;
}

int climb_order_most(const struct climb *c)
{
    return c->opt->order_most > 0 && c->opt->order_most < c->data->Y->m ? c->opt->order_most
                                                                        : c->data->Y->m - 1;
}

bool climb_spent(struct climb *c, double share)
{
    bool yes = c->opt->work > 0 && c->choice.work >= share * c->opt->work;

    c->choice.limited |= yes;
    return yes;
}

/* refine_poles within the work that is left; STEPS at most, 0: as many as the options say. */
static enum modal_status fit_steps(struct climb *c, const double complex *lambda, int count,
                                   const bool *fixed, bool refine, double rival, int steps,
                                   struct refined *fit, struct modal_error *err)
{
    struct refine_options opt = c->opt->refine;
    enum modal_status rc;

    if (steps > 0)
        opt.iterations = steps;

    opt.rival = rival;
    /* 0 would be no limit */
    opt.work = c->opt->work > 0 ? fmax(c->opt->work - c->choice.work, DBL_MIN) : 0;
    if (!refine)
        opt.iterations = -1;        /* an evaluation, no step: the fit as these poles have it */
    rc = refine_poles(c->data, lambda, count, fixed, &opt, fit, err);
    if (rc == MODAL_OK) {
        c->choice.work += fit->work;
        c->choice.limited |= fit->end == REFINE_STOPPED;  /* work ended it, not the fit */
    }
    return rc;
}

enum modal_status climb_fit(struct climb *c, const double complex *lambda, int count,
                            const bool *fixed, bool refine, double rival, struct refined *fit,
                            struct modal_error *err)
{
    return fit_steps(c, lambda, count, fixed, refine, rival, 0, fit, err);
}

enum modal_status climb_try(struct climb *c, int r, const double complex *lambda, int count,
                            const bool *fixed, bool refine, double rival, int *at,
                            struct modal_error *err)
{
    struct order_candidate *k;
    enum modal_status rc;

    *at = -1;
    if (c->opt->cancelled != NULL && c->opt->cancelled(c->opt->context))
        return modal_fail(err, MODAL_CANCELLED, "cancelled at order %d", r);
    if (count < 1 || poles_order(lambda, count, c->data->tau) > climb_order_most(c))
        return MODAL_OK;
    if (c->choice.count == c->room) {
        int room = c->room * 2 + 16;
        k = realloc(c->choice.candidates, sizeof *k * (size_t)room);
        if (k == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "order: no memory for %d candidates", room);
        c->choice.candidates = k, c->room = room;
    }
    k = &c->choice.candidates[c->choice.count];
    *k = (struct order_candidate) { .r = r, .refined = refine };
    rc = climb_fit(c, lambda, count, fixed, refine, rival, &k->fit, err);
    if (rc == MODAL_OK)
        *at = c->choice.count++;
    return rc;
}

enum modal_status climb_refine(struct climb *c, int i, double rival, struct modal_error *err)
{
    struct order_candidate *k = &c->choice.candidates[i];
    struct refined fit;
    enum modal_status rc;

    if (k->refined || k->fit.end == REFINE_DEGENERATE)
        return MODAL_OK;
    if (c->opt->cancelled != NULL && c->opt->cancelled(c->opt->context))
        return modal_fail(err, MODAL_CANCELLED, "cancelled at order %d", k->r);
    /* no pole is fixed: an offset is pinned last, by order_improve.c */
    rc = climb_fit(c, k->fit.lambda, k->fit.poles, NULL, true, rival, &fit, err);
    if (rc != MODAL_OK)
        return rc;
    refined_done(&k->fit);
    k->fit = fit, k->refined = true;
    return MODAL_OK;
}

enum modal_status climb_steps(struct climb *c, int i, int steps, struct modal_error *err)
{
    struct order_candidate *k = &c->choice.candidates[i];
    struct refined fit;
    enum modal_status rc;

    if (k->fit.end == REFINE_DEGENERATE)
        return MODAL_OK;
    rc = fit_steps(c, k->fit.lambda, k->fit.poles, NULL, true, 0, steps, &fit, err);
    if (rc != MODAL_OK)
        return rc;
    refined_done(&k->fit);
    k->fit = fit;
    return MODAL_OK;
}

enum modal_status climb_trim(struct climb *c, double complex *lambda, int *count, double share,
                             double reach, int most, struct modal_error *err)
{
    struct trim_options opt = { .share = share, .reach = reach, .most = most };

    return trim_poles(c->data, lambda, count, &opt, &c->choice.work, err);
}

enum modal_status climb_weed(struct climb *c, double reach, int most, int *best,
                             struct modal_error *err)
{
    for (;;) {
        const struct refined *fit = &c->choice.candidates[*best].fit;
        int count = fit->poles, at;
        enum modal_status rc;
        if (climb_spent(c, 1))
            return MODAL_OK;
        memcpy(c->lambda, fit->lambda, (size_t)count * sizeof *c->lambda);
        /* share 1: the whole price, where looking asks for half */
        rc = climb_trim(c, c->lambda, &count, 1, reach, most, err);
        if (rc != MODAL_OK || count == fit->poles)
            return rc;
        rc = climb_try(c, 0, c->lambda, count, NULL, true, reach > 0 ? climb_bic(c, *best) : 0, &at,
                       err);
        /* not <= : NAN does not win, nor a tie, which would go round for ever */
        if (rc != MODAL_OK || at < 0 || !(climb_bic(c, at) < climb_bic(c, *best)))
            return rc;
        *best = at;
    }
}

double climb_pair_price(const struct climb *c, const struct refined *fit)
{
    const struct refine_data *d = c->data;
    int phases = d->phases > 0 ? d->phases : 1;
    /* samples of a signal: each phase of a period is a column */
    double n = (double)d->Y->m * phases;
    struct criterion k = { fit->groups, phases, n, n * (d->share > 0 ? d->share : 1), d->exact,
                           fit->noise, fit->floor, d->white };

    int apart = poles_apart(fit->lambda, fit->poles, d->tau, d->Y->m);

    /* a pair has two columns, and two real exponents */
    return criterion_price(&k, apart + 1, fit->order + 2, fit->parameters + 2)
         - criterion_price(&k, apart, fit->order, fit->parameters);
}

enum modal_status climb_rest(struct climb *c, int at, struct modal_error *err)
{
    enum modal_status rc;

    if (c->rest_of == at)
        return MODAL_OK;
    long_rest_done(&c->rest);
    rc = long_rest_look(c->data, &c->choice.candidates[at].fit, c->opt->seen, &c->rest, err);
    c->rest_of = rc == MODAL_OK ? at : -1;
    return rc;
}

/* What must be seen of another pole before it is tried: half of its price, or more than white noise
 * shows in COUNT places. A sum of a_i times chi-squared of one degree each is above sum a_i + 2
 * sqrt(x sum a_i^2) + 2 x max a_i with less than e^-x [LM00], here 1 / COUNT; a_i are the
 * eigenvalues of the columns' correlations, each twice. What it then pays is another matter.
 * Of data that are renewed: both, for chance was looked at before, and what chance shows of many
 * columns is half of the price by itself. */
double climb_worth_looking(const struct climb *c, const struct refined *fit, double count,
                           const struct colour_spread *spread)
{
    /* d: a pair takes two numbers of each column, its amplitude */
    double d = 2.0 * c->data->Y->n, x = log(fmax(count, 2)),
           square = spread != NULL ? fmax(2 * spread->square, d) : d,
           largest = spread != NULL ? spread->largest : 1;

    /* noise: what the best of COUNT places may show, by the bound above */
    double share = ORDER_LOOK * climb_pair_price(c, fit),
           noise = d + 2 * sqrt(square * x) + 2 * largest * x;

    return c->opt->renewed ? fmax(share, noise) : fmin(share, noise);
}
