/* order_improve.c - the winner's poles one by one: as two, left out, as a constant (order.c, passes
 * 3 and 4) */
#include "modal/identify/linear/exponents.h"
#include "modal/identify/order/order_state.h"
#include "modal/identify/order/remainder.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* COUNT poles in c->lambda, refined into candidate *at where they come near the best's criterion as
 * they are put, before a step; else -1. */
static enum modal_status try_split(struct climb *c, int count, int best, int *at,
                                   struct modal_error *err)
{
    struct refined looked;
    bool worth;
    enum modal_status rc = climb_fit(c, c->lambda, count, NULL, false, 0, &looked, err);

    *at = -1;
    if (rc != MODAL_OK)
        return rc;
    worth = looked.bic < climb_bic(c, best) + ORDER_SPLIT_REACH;
    refined_done(&looked);
    return worth ? climb_try(c, 0, c->lambda, count, NULL, true, climb_bic(c, best), at, err)
                 : MODAL_OK;
}

/* Is candidate AT a better fit than the best, its pole J still what a real pole could stand for? A
 * pair that turns by a whole circle in its life 1 / |a| shows two columns to a pencil: one that
 * ends there went to a mode that is in the fit already, and splits it. */
static bool better_turned(const struct climb *c, int at, int j, int best)
{
    const struct refined *fit = &c->choice.candidates[at].fit;

    return climb_bic(c, at) < climb_bic(c, best) && refined_converged(fit)
           && cimag(fit->lambda[j]) <= 2 * M_PI * fabs(creal(fit->lambda[j]));
}

/* Pass 3: real pole J of the best as a pair. It is told from two real ones, and from t e^{at}, once
 * it turns by a radian in its life 1 / |a|: it starts there. */
static enum modal_status turn_pole(struct climb *c, int j, int *best, struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    double rate = fabs(creal(fit->lambda[j])), record = c->data->tau * c->data->Y->m;
    int n = fit->poles, at;
    enum modal_status rc;

    /* too slow to turn within the record, too fast for samples to show it */
    if (rate * record < M_PI || rate * c->data->tau > M_PI_2
        || fit->order + 1 > climb_order_most(c))
        return MODAL_OK;
    memcpy(c->lambda, fit->lambda, (size_t)n * sizeof *c->lambda);
    c->lambda[j] += I * rate;       /* a radian in its life */
    rc = try_split(c, n, *best, &at, err);
    if (rc == MODAL_OK && at >= 0 && better_turned(c, at, j, *best))
        *best = at;
    return rc;
}

/* Pass 3, for pole J of the best. */
static enum modal_status split_pole(struct climb *c, const struct matrix *E, int j, int *best,
                                    struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    double apart = ORDER_SPLIT_HALF / (c->data->tau * c->data->Y->m), nyquist = M_PI / c->data->tau;
    double complex lambda = fit->lambda[j];
    int n = fit->poles, at;
    double chi2 = HUGE_VAL;
    enum modal_status rc = MODAL_OK;

    if (pole_kind(lambda, c->data->tau) == POLE_REAL)
        return turn_pole(c, j, best, err);
    /* beside 0 or Nyquist one of the two would meet its own conjugate */
    if (cimag(lambda) <= 2 * apart || cimag(lambda) >= nyquist - 2 * apart
        || fit->order + 2 > climb_order_most(c) || n + 1 > c->poles_most)
        return MODAL_OK;
    if (E != NULL && c->data->blocks != NULL)
        chi2 = c->rest.beside[j];
    else if (E != NULL)
        rc = remainder_split(E, c->data->tau, lambda, false, &chi2, err);
    if (rc != MODAL_OK || !(chi2 > climb_worth_looking(c, fit, n, NULL)))
        return rc;
    memcpy(c->lambda, fit->lambda, (size_t)n * sizeof *c->lambda);
    /* e^{lambda t} cos and sin of t / (2 record): the span of e^{lambda t} and nearly t
     * e^{lambda t} */
    c->lambda[j] = lambda - I * apart, c->lambda[n] = lambda + I * apart;
    rc = try_split(c, n + 1, *best, &at, err);
    if (rc == MODAL_OK && at >= 0 && climb_bic(c, at) < climb_bic(c, *best))
        *best = at;
    return rc;
}

static enum modal_status split(struct climb *c, int *best, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    int poles = c->choice.candidates[*best].fit.poles;

    for (int j = 0; j < poles && j < c->source->most && rc == MODAL_OK && !climb_spent(c, 1); j++)
        rc = split_pole(c, NULL, j, best, err);
    return rc;
}

/* The same for those poles only beside which the remainder has what a second one could take. */
static enum modal_status split_seen(struct climb *c, int *best, struct modal_error *err)
{
    int poles = c->choice.candidates[*best].fit.poles, made = -1;
    struct matrix E = { 0 };
    enum modal_status rc = MODAL_OK;

    for (int j = 0; j < poles && rc == MODAL_OK && !climb_spent(c, 1); j++) {
        if (made != *best) {
            free(E.x), E.x = NULL;
            rc = c->data->blocks != NULL
                     ? climb_rest(c, *best, err)
                     : remainder_of(c->data, &c->choice.candidates[*best].fit, &E, err);
            made = *best;
        }
        if (rc == MODAL_OK && (c->data->blocks != NULL ? c->rest.known : E.x != NULL))
            rc = split_pole(c, &E, j, best, err);
    }
    free(E.x);
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

/* Pass 4: poles left out one by one. Refining recovers what the poles near the lost one can
 * take over, at most a few units per parameter. */
static enum modal_status simplify(struct climb *c, int *best, struct modal_error *err)
{
    return climb_weed(c, fmax(ORDER_REACH * c->data->Y->m * c->data->Y->n, 100), 1, best, err);
}

/* A pole that moves in the record and whose error exceeds its own size: the data do not say that it
 * is there. -1: none. */
static int undetermined(const struct climb *c, const struct refined *fit)
{
    double record = c->data->tau * c->data->Y->m;
    int worst = -1;

    for (int j = 0; j < fit->poles; j++) {
        double size = cabs(fit->lambda[j]), error = hypot(fit->std_re[j], fit->std_im[j]);
        /* slower ones may be constants, which pin_offset tells */
        if (size * record > ORDER_MOVED && error > size
            && (worst < 0 || error > hypot(fit->std_re[worst], fit->std_im[worst])))
            worst = j;
    }
    return worst;
}

/* Pass 4: two poles that cancel each other fit a transient as t e^{lambda t} would, and mean
 * nothing one by one: out with them, one at a time, unless the fit is much the worse for it. */
static enum modal_status drop_undetermined(struct climb *c, int *best, struct modal_error *err)
{
    for (;;) {
        const struct refined *fit = &c->choice.candidates[*best].fit;
        double residual = fit->residual;
        int drop = undetermined(c, fit), n, at;
        enum modal_status rc;
        if (drop < 0 || fit->poles < 2 || climb_spent(c, 1))
            return MODAL_OK;
        n = without(c, *best, drop, c->lambda);
        rc = climb_try(c, 0, c->lambda, n, NULL, true, 0, &at, err);
        if (rc != MODAL_OK || at < 0)
            return rc;
        if (!(c->choice.candidates[at].fit.residual < ORDER_WORSE * residual))
            return MODAL_OK;
        *best = at;
    }
}

/* The pole that is told least from its nearest neighbour; -1: all are told by REFINE_APART standard
 * errors or more. */
static int least_told(const struct refined *fit)
{
    /* errors over the distance: as many standard errors are no doubt two poles */
    double most = 1 / REFINE_APART;
    int at = -1;

    for (int j = 0; j < fit->poles; j++) {
        double error = hypot(fit->std_re[j], fit->std_im[j]);
        for (int k = 0; k < fit->poles; k++)
            if (k != j && error > most * cabs(fit->lambda[j] - fit->lambda[k]))
                most = error / cabs(fit->lambda[j] - fit->lambda[k]), at = j;
    }
    return at;
}

/* Pass 4: a pole more than there are sits beside one of them, with much of its amplitude: left out
 * it costs far more than its price until its neighbours are refined. Of a periodic system: of a
 * constant one neighbours may be a Jordan block, which two poles nearer than that stand for. */
static enum modal_status drop_beside(struct climb *c, int *best, struct modal_error *err)
{
    for (;;) {
        const struct refined *fit = &c->choice.candidates[*best].fit;
        int drop = least_told(fit), n, at;
        enum modal_status rc;
        if (drop < 0 || fit->poles < 2 || climb_spent(c, 1))
            return MODAL_OK;
        n = without(c, *best, drop, c->lambda);
        rc = climb_try(c, 0, c->lambda, n, NULL, true, climb_bic(c, *best), &at, err);
        if (rc != MODAL_OK || at < 0 || !(climb_bic(c, at) < climb_bic(c, *best)))
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
        if (pole_kind(fit->lambda[j], c->data->tau) == POLE_REAL
            && (slow < 0 || fabs(creal(fit->lambda[j])) < fabs(creal(fit->lambda[slow]))))
            slow = j;
    if (slow < 0 || !(fabs(creal(fit->lambda[slow])) <= fmax(4 * fit->std_re[slow], 1e-9 / record))
        || climb_spent(c, 1))
        return MODAL_OK;
    c->lambda[0] = 0;               /* the null exponent of an offset, first and fixed */
    n = 1 + without(c, *best, slow, c->lambda + 1);
    memset(c->fixed, 0, (size_t)n * sizeof *c->fixed);
    c->fixed[0] = true;
    rc = climb_try(c, 0, c->lambda, n, c->fixed, true, 0, &at, err);
    if (rc == MODAL_OK && at >= 0 && climb_bic(c, at) <= climb_bic(c, *best))
        *best = at, c->choice.offset = true;
    return rc;
}

enum modal_status climb_improve(struct climb *c, bool above, int *best, struct modal_error *err)
{
    bool fixed = c->opt->fixed > 0;
    enum modal_status rc = MODAL_OK;

    if (!fixed)
        rc = above ? split_seen(c, best, err) : split(c, best, err);
    if (rc == MODAL_OK && !fixed)
        rc = simplify(c, best, err);
    if (rc == MODAL_OK && !fixed && c->choice.candidates[*best].refined)
        rc = drop_undetermined(c, best, err);
    if (rc == MODAL_OK && above && !fixed && c->data->phases > 1
        && c->choice.candidates[*best].refined)
        rc = drop_beside(c, best, err);
    if (rc == MODAL_OK && !c->opt->no_offset)
        rc = pin_offset(c, best, err);
    return rc;
}
