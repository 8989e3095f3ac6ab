/*
 * order.c - a ladder of orders, each candidate refined where it can win, decided by BIC
 *
 * The criterion is (7) of refine.c, with residuals floored at rounding: on perfect data it ends where the residual
 * reaches the floor, since more poles only cost.  The ladder has four passes.
 *
 * 1. Look at the fits of r = 1, 2, ... as the decomposition gives them, until ORDER_AHEAD rungs brought nothing, and no less far than `look`:
 *    where few channels show many modes no order below theirs need fit any better than one; nor before the best explains a good part (ORDER_POOR).  Where a signal is left with SPREAD times less than another, what is
 *    left of it may be no noise but the pencil's errors, which the noise of the other made: a rung that is the best so far is then taken a few steps at once.
 * 2. Refine: the least first, then its neighbours until two in a row lose on either side, and every other candidate whose unrefined BIC
 *    is within `reach` of the best.  A pencil's poles are within a small factor of the bound where the order is right
 *    (limits of accuracy: 1.05 to 4.2), so refining lowers the residual of a right order by little: by less than
 *
 *        reach = ORDER_REACH per datum.                                                              (1)
 *
 *    With few rows that bound fails (noise in H moves a pencil's poles by many standard errors): `thorough` refines all.
 * 3. Split: two poles much closer than the record resolves share one triplet, and the pencil finds one.  A pole lambda
 *    stands for a pair of neighbours where lambda +- i / (2 record), which span e^{lambda t} and, nearly, t e^{lambda t}, fit
 *    well enough to be worth refining.
 * 4. Simplify the winner: leave out the pole whose absence costs least, refine, keep if BIC falls, again.  A real pole that is
 *    zero within its error becomes a constant, with one parameter less, if BIC falls.
 *
 * Work is counted, never timed.  Each pass ends where `work` is spent, so that a long record of many modes ends with the best so far.
 */
#include "modal/identify/order.h"
#include "modal/identify/exponents.h"
#include "modal/linalg/svd.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LOOK_STEPS = 6 };
static const double WORSE = 1.5, SPREAD = 4;
static const double LOOK_SHARE = 0.5;      /* of the work, for pass 1 */

struct climb {
    const struct refine_data *data;
    const struct order_source *source;
    const struct order_options *opt;
    struct order_choice choice;
    int room;
    double complex *lambda;         /* source->most + 1 */
    bool *fixed;
};

static double bic_of(const struct climb *c, int i)
{
    return i < 0 ? HUGE_VAL : c->choice.candidates[i].fit.bic;
}

static int order_most(const struct climb *c)
{
    return c->opt->order_most > 0 && c->opt->order_most < c->data->Y->m ? c->opt->order_most : c->data->Y->m - 1;
}

/* Is SHARE of the work spent?  Asked where there is more to try. */
static bool spent(struct climb *c, double share)
{
    bool yes = c->opt->work > 0 && c->choice.work >= share * c->opt->work;

    c->choice.limited |= yes;
    return yes;
}

/* refine_poles within the work that is left; STEPS at most, 0: as many as the options say. */
static enum modal_status fit_steps(struct climb *c, const double complex *lambda, int count, const bool *fixed, bool refine, double rival, int steps,
                                   struct refined *fit, struct modal_error *err)
{
    struct refine_options opt = c->opt->refine;
    enum modal_status rc;

    if (steps > 0)
        opt.iterations = steps;

    opt.rival = rival;
    opt.work = c->opt->work > 0 ? fmax(c->opt->work - c->choice.work, DBL_MIN) : 0;
    if (!refine)
        opt.iterations = -1;
    rc = refine_poles(c->data, lambda, count, fixed, &opt, fit, err);
    if (rc == MODAL_OK) {
        c->choice.work += fit->work;
        c->choice.limited |= fit->end == REFINE_STOPPED;
    }
    return rc;
}

static enum modal_status fit_poles(struct climb *c, const double complex *lambda, int count, const bool *fixed, bool refine, double rival,
                                   struct refined *fit, struct modal_error *err)
{
    return fit_steps(c, lambda, count, fixed, refine, rival, 0, fit, err);
}

/* Fit COUNT poles, refined or not, and append the candidate; *at is its index, -1 where there is nothing to fit. */
static enum modal_status try_poles(struct climb *c, int r, const double complex *lambda, int count, const bool *fixed,
                                   bool refine, double rival, int *at, struct modal_error *err)
{
    struct order_candidate *k;
    enum modal_status rc;

    *at = -1;
    if (c->opt->cancelled != NULL && c->opt->cancelled(c->opt->context))
        return modal_fail(err, MODAL_CANCELLED, "cancelled at order %d", r);
    if (count < 1 || poles_order(lambda, count, c->data->tau) > order_most(c))
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
    rc = fit_poles(c, lambda, count, fixed, refine, rival, &k->fit, err);
    if (rc == MODAL_OK)
        *at = c->choice.count++;
    return rc;
}

/* Candidate I, looked at so far, refined in its place; a fit that refining made worse is kept as it was. */
static enum modal_status refine_candidate(struct climb *c, int i, double rival, struct modal_error *err)
{
    struct order_candidate *k = &c->choice.candidates[i];
    struct refined fit;
    enum modal_status rc;

    if (k->refined || k->fit.end == REFINE_DEGENERATE)
        return MODAL_OK;
    if (c->opt->cancelled != NULL && c->opt->cancelled(c->opt->context))
        return modal_fail(err, MODAL_CANCELLED, "cancelled at order %d", k->r);
    rc = fit_poles(c, k->fit.lambda, k->fit.poles, NULL, true, rival, &fit, err);
    if (rc != MODAL_OK)
        return rc;
    refined_done(&k->fit);
    k->fit = fit, k->refined = true;
    return MODAL_OK;
}

/* Candidate I, looked at, taken a few steps further: no longer as the pencil has it, not yet refined. */
static enum modal_status step_candidate(struct climb *c, int i, struct modal_error *err)
{
    struct order_candidate *k = &c->choice.candidates[i];
    struct refined fit;
    enum modal_status rc;

    if (k->fit.end == REFINE_DEGENERATE)
        return MODAL_OK;
    rc = fit_steps(c, k->fit.lambda, k->fit.poles, NULL, true, 0, LOOK_STEPS, &fit, err);
    if (rc != MODAL_OK)
        return rc;
    refined_done(&k->fit);
    k->fit = fit;
    return MODAL_OK;
}

/* Does the quietest signal hear SPREAD times less of what a fit leaves than the loudest? */
static bool uneven(const struct refined *fit)
{
    double least = HUGE_VAL, most = 0;

    for (int g = 0; g < fit->groups; g++) {
        if (!(fit->floor[g] > 0))
            continue;
        least = fmin(least, fit->noise[g]), most = fmax(most, fit->noise[g]);
    }
    return most > SPREAD * least;
}

/* Is there a reason to look at order r?  BEST is the index of the least so far, of order BEST_R; ALL the norm of the signals. */
static bool worth_a_look(const struct climb *c, int r, int best, int best_r, double all)
{
    return best < 0 || r <= best_r + ORDER_AHEAD || r <= c->opt->look || c->choice.candidates[best].fit.residual > ORDER_POOR * all;
}

/* Pass 1.  The index of the least. */
static enum modal_status look(struct climb *c, int *least, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    double all = safe_matrix_norm(c->data->Y);
    int best_r = 0;

    *least = -1;
    for (int r = 1; r <= c->source->most && worth_a_look(c, r, *least, best_r, all) && rc == MODAL_OK; r++) {
        int count = 0, at;
        if (c->opt->fixed > 0 && r != c->opt->fixed)
            continue;
        if (*least >= 0 && spent(c, LOOK_SHARE))
            break;
        rc = c->source->poles(c->source->context, r, c->lambda, &count, err);
        if (rc == MODAL_NO_CONVERGENCE) {       /* the factors of this order left the range of doubles: no candidate */
            rc = MODAL_OK;
            continue;
        }
        if (rc == MODAL_OK)
            rc = try_poles(c, r, c->lambda, count, NULL, false, 0, &at, err);
        if (rc == MODAL_OK && at >= 0 && bic_of(c, at) < bic_of(c, *least)) {
            *least = at, best_r = r;
            if (c->opt->refine.iterations >= 0 && uneven(&c->choice.candidates[at].fit))
                rc = step_candidate(c, at, err);
        }
    }
    return rc;
}

/* From `least` in direction `step`, until two refined neighbours in a row are worse than the best. */
static enum modal_status refine_side(struct climb *c, int looked, int step, int *best, struct modal_error *err)
{
    int lost = 0;
    double reach = ORDER_REACH * c->data->Y->m * c->data->Y->n;
    enum modal_status rc = MODAL_OK;

    for (int i = *best + step; i >= 0 && i < looked && lost < 2 && rc == MODAL_OK; i += step) {
        if (bic_of(c, i) > bic_of(c, *best) + fmax(reach, 100) && step < 0)
            break;
        if (spent(c, 1))
            break;
        rc = refine_candidate(c, i, bic_of(c, *best), err);
        bool wins = rc == MODAL_OK && bic_of(c, i) < bic_of(c, *best);
        lost = wins ? 0 : lost + 1;
        *best = wins ? i : *best;
    }
    return rc;
}

/* Pass 2. */
static enum modal_status refine_ladder(struct climb *c, int *best, struct modal_error *err)
{
    int looked = c->choice.count, least = *best;
    double reach = fmax(ORDER_REACH * c->data->Y->m * c->data->Y->n, 100);
    enum modal_status rc = refine_candidate(c, least, 0, err);

    for (int i = 0; i < looked && c->opt->thorough && rc == MODAL_OK && !spent(c, 1); i++) {
        rc = refine_candidate(c, i, bic_of(c, *best), err);
        if (rc == MODAL_OK && bic_of(c, i) < bic_of(c, *best))
            *best = i;
    }
    if (rc != MODAL_OK || c->opt->thorough)
        return rc;
    if (rc == MODAL_OK)
        rc = refine_side(c, looked, 1, best, err);
    if (rc == MODAL_OK)
        rc = refine_side(c, looked, -1, best, err);
    for (int i = 0; i < looked && rc == MODAL_OK; i++) {
        if (c->choice.candidates[i].refined || bic_of(c, i) > bic_of(c, *best) + reach || i > *best + 2)
            continue;
        if (spent(c, 1))
            break;
        rc = refine_candidate(c, i, bic_of(c, *best), err);
        if (rc == MODAL_OK && bic_of(c, i) < bic_of(c, *best))
            *best = i;
    }
    return rc;
}

/* Pass 3, for pole J of the best. */
static enum modal_status split_pole(struct climb *c, int j, int *best, struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    double apart = ORDER_SPLIT_HALF / (c->data->tau * c->data->Y->m), nyquist = M_PI / c->data->tau;
    double complex lambda = fit->lambda[j];
    struct refined looked;
    int n = fit->poles, at;
    bool worth;
    enum modal_status rc;

    if (cimag(lambda) <= 2 * apart || cimag(lambda) >= nyquist - 2 * apart || fit->order + 2 > order_most(c))
        return MODAL_OK;
    memcpy(c->lambda, fit->lambda, (size_t)n * sizeof *c->lambda);
    c->lambda[j] = lambda - I * apart, c->lambda[n] = lambda + I * apart;
    rc = fit_poles(c, c->lambda, n + 1, NULL, false, 0, &looked, err);
    if (rc != MODAL_OK)
        return rc;
    worth = looked.bic < bic_of(c, *best) + ORDER_SPLIT_REACH;
    refined_done(&looked);
    if (!worth)
        return MODAL_OK;
    rc = try_poles(c, 0, c->lambda, n + 1, NULL, true, bic_of(c, *best), &at, err);
    if (rc == MODAL_OK && at >= 0 && bic_of(c, at) < bic_of(c, *best))
        *best = at;
    return rc;
}

static enum modal_status split(struct climb *c, int *best, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    int poles = c->choice.candidates[*best].fit.poles;

    for (int j = 0; j < poles && j < c->source->most && rc == MODAL_OK && !spent(c, 1); j++)
        rc = split_pole(c, j, best, err);
    return rc;
}

/* The poles of candidate I but number J. */
static int without(const struct climb *c, int i, int j, double complex *lambda)
{
    const struct refined *fit = &c->choice.candidates[i].fit;
    int n = 0;

    for (int k = 0; k < fit->poles; k++)
        if (k != j)
            lambda[n++] = fit->lambda[k];
    return n;
}

/* Pass 4: poles left out one by one. */
static enum modal_status simplify(struct climb *c, int *best, struct modal_error *err)
{
    while (c->choice.candidates[*best].fit.poles > 1) {
        int poles = c->choice.candidates[*best].fit.poles, drop = -1, n, at;
        double least = HUGE_VAL;
        enum modal_status rc;
        for (int j = 0; j < poles; j++) {
            struct refined fit;
            if (spent(c, 1))
                return MODAL_OK;
            n = without(c, *best, j, c->lambda);
            rc = fit_poles(c, c->lambda, n, NULL, false, 0, &fit, err);
            if (rc != MODAL_OK)
                return rc;
            if (fit.bic < least)
                least = fit.bic, drop = j;
            refined_done(&fit);
        }
        /* refining recovers what the poles near the lost one can take over, at most a few units per parameter */
        if (drop < 0 || least > bic_of(c, *best) + fmax(ORDER_REACH * c->data->Y->m * c->data->Y->n, 100))
            return MODAL_OK;
        n = without(c, *best, drop, c->lambda);
        rc = try_poles(c, 0, c->lambda, n, NULL, true, bic_of(c, *best), &at, err);
        if (rc != MODAL_OK || at < 0 || !(bic_of(c, at) < bic_of(c, *best)))
            return rc;
        *best = at;
    }
    return MODAL_OK;
}

/* A pole that moves in the record and whose error exceeds its own size: the data do not say that it is there. -1: none. */
static int undetermined(const struct climb *c, const struct refined *fit)
{
    double record = c->data->tau * c->data->Y->m;
    int worst = -1;

    for (int j = 0; j < fit->poles; j++) {
        double size = cabs(fit->lambda[j]), error = hypot(fit->std_re[j], fit->std_im[j]);
        if (size * record > 3 && error > size && (worst < 0 || error > hypot(fit->std_re[worst], fit->std_im[worst])))
            worst = j;
    }
    return worst;
}

/* Pass 4: two poles that cancel each other fit a transient as t e^{lambda t} would, and mean nothing one by one: out with them, one at a
 * time, unless the fit is much the worse for it. */
static enum modal_status drop_undetermined(struct climb *c, int *best, struct modal_error *err)
{
    for (;;) {
        const struct refined *fit = &c->choice.candidates[*best].fit;
        double residual = fit->residual;
        int drop = undetermined(c, fit), n, at;
        enum modal_status rc;
        if (drop < 0 || fit->poles < 2 || spent(c, 1))
            return MODAL_OK;
        n = without(c, *best, drop, c->lambda);
        rc = try_poles(c, 0, c->lambda, n, NULL, true, 0, &at, err);
        if (rc != MODAL_OK || at < 0 || !(c->choice.candidates[at].fit.residual < WORSE * residual))
            return rc;
        *best = at;
    }
}

/* Pass 4: the slowest real pole as a constant. */
static enum modal_status pin_offset(struct climb *c, int *best, struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    double record = c->data->tau * c->data->Y->m;
    int slow = -1, n, at;
    enum modal_status rc;

    for (int j = 0; j < fit->poles; j++)
        if (pole_kind(fit->lambda[j], c->data->tau) == POLE_REAL && (slow < 0 || fabs(creal(fit->lambda[j])) < fabs(creal(fit->lambda[slow]))))
            slow = j;
    if (slow < 0 || !(fabs(creal(fit->lambda[slow])) <= fmax(4 * fit->std_re[slow], 1e-9 / record)) || spent(c, 1))
        return MODAL_OK;
    c->lambda[0] = 0;
    n = 1 + without(c, *best, slow, c->lambda + 1);
    memset(c->fixed, 0, (size_t)n * sizeof *c->fixed);
    c->fixed[0] = true;
    rc = try_poles(c, 0, c->lambda, n, c->fixed, true, 0, &at, err);
    if (rc == MODAL_OK && at >= 0 && bic_of(c, at) <= bic_of(c, *best))
        *best = at, c->choice.offset = true;
    return rc;
}

/* Passes 2 to 4. */
static enum modal_status improve(struct climb *c, int *best, struct modal_error *err)
{
    bool fixed = c->opt->fixed > 0;
    enum modal_status rc = refine_ladder(c, best, err);

    if (rc == MODAL_OK && !fixed)
        rc = split(c, best, err);
    if (rc == MODAL_OK && !fixed)
        rc = simplify(c, best, err);
    if (rc == MODAL_OK && !fixed && c->choice.candidates[*best].refined)
        rc = drop_undetermined(c, best, err);
    if (rc == MODAL_OK && !c->opt->no_offset)
        rc = pin_offset(c, best, err);
    return rc;
}

/* The winner taken to its minimum, if the ladder was not cut short; a few evaluations, which are not counted among the search's. */
static enum modal_status settle(struct climb *c, int best, struct modal_error *err)
{
    struct order_candidate *k = &c->choice.candidates[best];
    struct refine_options opt = { .equal_noise = c->opt->refine.equal_noise, .settle = true };
    struct refined fit;
    enum modal_status rc;

    if (!k->refined || k->fit.end != REFINE_CONVERGED || c->opt->refine.iterations < 0 || c->choice.limited)
        return MODAL_OK;
    memset(c->fixed, 0, (size_t)k->fit.poles * sizeof *c->fixed);
    c->fixed[0] = c->choice.offset;
    rc = refine_poles(c->data, k->fit.lambda, k->fit.poles, c->fixed, &opt, &fit, err);
    if (rc != MODAL_OK)
        return rc;
    refined_done(&k->fit);
    k->fit = fit;
    return MODAL_OK;
}

enum modal_status order_choose(const struct refine_data *data, const struct order_source *source,
                               const struct order_options *opt, struct order_choice *out, struct modal_error *err)
{
    struct order_options none = { .fixed = 0 };
    struct climb c = { .data = data, .source = source, .opt = opt != NULL ? opt : &none, .choice = { .chosen = -1 } };
    size_t most = 2 * (size_t)(source->most > 0 ? source->most : 0) + 2;   /* each pole split at most once */
    int best = -1;
    enum modal_status rc;

    c.lambda = calloc(most, sizeof *c.lambda), c.fixed = calloc(most, sizeof *c.fixed);
    if (c.lambda == NULL || c.fixed == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "order: no memory for order %d", source->most);
        goto out;
    }
    rc = look(&c, &best, err);
    c.choice.cut = c.opt->cut > 0 && best >= 0 && c.choice.candidates[best].r + ORDER_AHEAD > c.opt->cut;
    if (rc == MODAL_OK && best >= 0 && !c.choice.cut)
        rc = improve(&c, &best, err);
    if (rc == MODAL_OK && best >= 0)
        rc = settle(&c, best, err);
    if (rc != MODAL_OK)
        goto out;
    c.choice.chosen = best;
    *out = c.choice;
    c.choice = (struct order_choice) { 0 };
out:
    order_done(&c.choice);
    free(c.lambda), free(c.fixed);
    return rc;
}

void order_done(struct order_choice *choice)
{
    for (int i = 0; i < choice->count; i++)
        refined_done(&choice->candidates[i].fit);
    free(choice->candidates);
    *choice = (struct order_choice) { 0 };
}
