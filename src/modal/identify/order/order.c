/*
 * order.c - a ladder of orders, each candidate refined where it can win, decided by BIC
 *
 * The criterion is (7) of refine.c, with residuals floored at rounding: on perfect data it ends
 * where the residual reaches the floor, since more poles only cost.  The ladder has four passes.
 *
 * 1. Look at the fits of r = 1, 2, ... as the decomposition gives them, until ORDER_AHEAD rungs
 *    brought nothing, and no less far than `look`:
 *    where few channels show many modes no order below theirs need fit any better than one; nor
 *    before the best explains a good part (ORDER_POOR).  Where a signal is left with SPREAD times
 *    less than another, what is left of it may be no noise but the pencil's errors, which the noise
 *    of the other made: a rung that is the best so far is then taken a few steps at once.
 * 2. Refine: the least first, then its neighbours until two in a row lose on either side, and every
 *    other candidate whose unrefined BIC is within `reach` of the best.  A pencil's poles are
 *    within a small factor of the bound where the order is right (limits of accuracy: 1.05 to 4.2),
 *    so refining lowers the residual of a right order by little: by less than
 *
 *        reach = ORDER_REACH per datum.                                                         (1)
 *
 *    With few rows that bound fails (noise in H moves a pencil's poles by many standard errors):
 *    `thorough` refines all, and then searches what the best leaves as below, from above: where the
 *    right order begins too far off to converge a lesser one leads there.
 * 3. Split: two poles much closer than the record resolves share one triplet, and the pencil finds
 *    one.  A pole lambda stands for a pair of neighbours where lambda +- i / (2 record), which span
 *    e^{lambda t} and, nearly, t e^{lambda t}, fit well enough to be worth refining.  A real pole
 *    may stand for a pair that decays about as fast as it turns.
 * 4. Simplify the winner: leave out the pole whose absence costs least, refine, keep if BIC falls,
 *    again.  A real pole that is zero within its error becomes a constant, with one parameter less,
 *    if BIC falls.
 *
 * From above (order_from_above). The ladder ends at a local minimum where any few of many modes
 * explain little: a rung is judged by a residual made of the modes that it lacks. So the whole
 * signal subspace comes first: the poles of all singular values above the edge of the noise
 * (pencil.h) and a few more, without those that do not pay for half of themselves (trim.c), all
 * refined at once, and weeded until each pays its price; what that leaves is searched by the same
 * pencil, and by filters for any decay where it sees nothing, until no more stands out of noise
 * (remainder.c). Where the model holds, the minimum that this reaches is the global one in
 * practice: it holds every mode above the edge, any mode below stands out of a white remainder,
 * and what does not pay has been left out with all others refitted. Where no constant modes and
 * white noise are the truth (a driven or nonlinear response) poles from above draw the noise, one
 * beside the other. So the answer counts as `clean` only where the fit converged and what it
 * leaves is white (colour.c), but for a pair that would not pay, and as `crowded` where two of its
 * poles are nearer than half a beat over the record, as those are that draw a mode whose frequency
 * drifts. What is not clean, or crowded, goes to the ladder, which is sparing; a crowd is believed
 * where the ladder leaves much more (ORDER_WORSE).
 *
 * An order that is told is searched for alike: where its directions reach down to the noise, modes
 * hide among them, poles of noise have their places and go nowhere. Those that pay are refined, and
 * what they leave shows the rest, which come in by their price, a few beyond the order and back to
 * it, or up to it whatever they pay.
 *
 * Of a periodic system (phases) rows are few, poles are near each other for all that, and none of
 * this settles the order at once: identify_periods.c goes down from pencils until three agree.
 * A pole more than there are may end beside one of them and share its amplitude; the least told
 * from its neighbour is left out and the rest refined, kept so where the criterion falls.
 *
 * Work is counted, never timed.  Each pass ends where `work` is spent, so that a long record of
 * many modes ends with the best so far.
 *
 * The search and its candidates are order_climb.c's; the way from above is order_above.c's, passes
 * 3 and 4 are order_improve.c's.
 */
#include "modal/identify/fit/colour.h"
#include "modal/identify/order/order_state.h"
#include "modal/identify/order/remainder.h"
#include "modal/identify/order/trim.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    LOOK_STEPS = 6,                 /* of a rung whose signals are left uneven */
    AROUND = 20                     /* orders looked at about an answer from above */
};
static const double SPREAD = 4;     /* between the least and the most that a fit leaves */

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

/* Is there a reason to look at order r?  BEST is the index of the least so far, of order BEST_R;
 * ALL the norm of the signals. */
static bool worth_a_look(const struct climb *c, int r, int best, int best_r, double all)
{
    return best < 0 || r <= best_r + ORDER_AHEAD || r <= c->opt->look
        || c->choice.candidates[best].fit.residual > ORDER_POOR * all;
}

/* Pass 1.  The index of the least. */
static enum modal_status look(struct climb *c, int *least, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    double all = refine_norm(c->data);
    int best_r = 0;

    *least = -1;
    for (int r = 1;
         r <= c->source->most && worth_a_look(c, r, *least, best_r, all) && rc == MODAL_OK; r++) {
        int count = 0, at;
        if (*least >= 0 && climb_spent(c, LOOK_SHARE))
            break;
        rc = c->source->poles(c->source->context, r, c->lambda, &count, err);
        /* the factors of this order left the range of doubles: no candidate */
        if (rc == MODAL_NO_CONVERGENCE) {
            rc = MODAL_OK;
            continue;
        }
        if (rc == MODAL_OK)
            rc = climb_try(c, r, c->lambda, count, NULL, false, 0, &at, err);
        /* of equal ones the lesser order */
        if (rc == MODAL_OK && at >= 0 && climb_bic(c, at) < climb_bic(c, *least)) {
            *least = at, best_r = r;
            if (c->opt->refine.iterations >= 0 && uneven(&c->choice.candidates[at].fit))
                rc = climb_steps(c, at, LOOK_STEPS, err);
        }
    }
    return rc;
}

/* The order that was told, in place of pass 1. Where more signals are seen it is theirs without
 * those that cost least: fewer directions are no span of any modes. (One fewer cuts a pair, which
 * is said.) Poles that others span, as of noise that decays at once, are left out. */
static enum modal_status look_at_told(struct climb *c, int *at, struct modal_error *err)
{
    const struct order_source *s = c->source;
    int told = c->opt->fixed, signals = s->signals < s->most ? s->signals : s->most, count = 0;
    bool more = signals > told + 1;
    struct trim_options opt = { .order = told };
    enum modal_status rc;

    *at = -1;
    if (s->known != NULL)
        return climb_try(c, told, s->known, s->known_count, NULL, false, 0, at, err);
    rc = s->poles(s->context, more ? signals : told, c->lambda, &count, err);
    if (rc == MODAL_OK && more && count > 0)
        rc = trim_poles(c->data, c->lambda, &count, &opt, &c->choice.work, err);
    if (rc == MODAL_OK)
        rc = climb_try(c, told, c->lambda, count, NULL, false, 0, at, err);
    if (rc != MODAL_OK || *at < 0 || c->choice.candidates[*at].fit.end != REFINE_DEGENERATE)
        return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
    refined_done(&c->choice.candidates[--c->choice.count].fit);
    rc = trim_poles(c->data, c->lambda, &count, &opt, &c->choice.work, err);
    return rc == MODAL_OK ? climb_try(c, told, c->lambda, count, NULL, false, 0, at, err) : rc;
}

/* The order that was told, in place of pass 2. Where its signals reach down to the noise a mode may
 * be missing, and what noise there is in its place leads no fit anywhere. */
static enum modal_status refine_told(struct climb *c, int *best, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (c->opt->refine.iterations >= 0 && (c->source->signals > 0 || c->source->known != NULL))
        rc = climb_complete(c, best, err);
    return rc == MODAL_OK ? climb_refine(c, *best, 0, err) : rc;
}

/* From `least` in direction `step`, until two refined neighbours in a row are worse than the best.
 * */
static enum modal_status refine_side(struct climb *c, int looked, int step, int *best,
                                     struct modal_error *err)
{
    int lost = 0;
    double reach = ORDER_REACH * c->data->Y->m * c->data->Y->n;
    enum modal_status rc = MODAL_OK;

    for (int i = *best + step; i >= 0 && i < looked && lost < 2 && rc == MODAL_OK; i += step) {
        if (climb_bic(c, i) > climb_bic(c, *best) + fmax(reach, 100) && step < 0)
            break;
        if (climb_spent(c, 1))
            break;
        rc = climb_refine(c, i, climb_bic(c, *best), err);
        bool wins = rc == MODAL_OK && climb_bic(c, i) < climb_bic(c, *best);
        /* one rung may lose to its neighbour by an odd pole alone: two end it */
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
    enum modal_status rc = climb_refine(c, least, 0, err);

    for (int i = 0; i < looked && c->opt->thorough && rc == MODAL_OK && !climb_spent(c, 1); i++) {
        rc = climb_refine(c, i, climb_bic(c, *best), err);
        if (rc == MODAL_OK && climb_bic(c, i) < climb_bic(c, *best))
            *best = i;
    }
    if (rc != MODAL_OK || c->opt->thorough)
        return rc;
    if (rc == MODAL_OK)
        rc = refine_side(c, looked, 1, best, err);
    if (rc == MODAL_OK)
        rc = refine_side(c, looked, -1, best, err);
    for (int i = 0; i < looked && rc == MODAL_OK; i++) {
        if (c->choice.candidates[i].refined || climb_bic(c, i) > climb_bic(c, *best) + reach
            || i > *best + 2)
            continue;
        if (climb_spent(c, 1))
            break;
        rc = climb_refine(c, i, climb_bic(c, *best), err);
        if (rc == MODAL_OK && climb_bic(c, i) < climb_bic(c, *best))
            *best = i;
    }
    return rc;
}

/* The winner taken to its minimum, if the ladder was not cut short; a few evaluations, which are
 * not counted among the search's. */
static enum modal_status settle(struct climb *c, int best, struct modal_error *err)
{
    struct order_candidate *k = &c->choice.candidates[best];
    /* no work limit, no rival: the answer is the minimum, the same from every start */
    struct refine_options opt = { .equal_noise = c->opt->refine.equal_noise, .settle = true };
    struct refined fit;
    enum modal_status rc;

    if (!k->refined || k->fit.end != REFINE_CONVERGED || c->opt->refine.iterations < 0
        || c->choice.limited)
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

/* Two pairs nearer than half a beat over the record? */
static bool unresolved(const struct climb *c, const struct refined *fit)
{
    double record = c->data->tau * c->data->Y->m;

    for (int i = 0; i < fit->poles; i++)
        for (int j = 0; j < i; j++)
            if (cimag(fit->lambda[i]) != 0 && cimag(fit->lambda[j]) != 0
                && cabs(fit->lambda[i] - fit->lambda[j]) * record < M_PI)  /* half a beat */
                return true;
    return false;
}

/* Is the best one set of modes, and what it leaves white noise, or no further from it than one pair
 * that does not pay makes it? */
static enum modal_status is_clean(struct climb *c, int best, bool *clean, struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[best].fit;
    struct matrix E = { 0 };
    double mean[COLOUR_LAGS], hidden = climb_pair_price(c, fit);
    enum modal_status rc;

    *clean = false;
    if (!refined_converged(fit) || c->choice.limited)
        return MODAL_OK;
    colour_left_by(fit->lambda, fit->poles, c->data->tau, c->data->Y->m, mean);
    if (c->data->blocks != NULL) {
        rc = climb_rest(c, best, err);
        *clean = rc == MODAL_OK && c->rest.known
              && colour_sum_white(&c->rest.colour, mean, hidden);
        return rc;
    }
    rc = remainder_of(c->data, fit, &E, err);
    *clean = rc == MODAL_OK && E.x != NULL && colour_white_about(&E, mean, hidden);
    free(E.x);
    return rc;
}

/* The orders around the answer as the decomposition has them, for what its poles do from one to
 * the next. */
static enum modal_status look_around(struct climb *c, int best, struct modal_error *err)
{
    int order = c->choice.candidates[best].fit.order, last = order + ORDER_AHEAD;
    enum modal_status rc = MODAL_OK;

    for (int r = last > AROUND ? last - AROUND : 1; r <= last && r <= c->source->most
         && rc == MODAL_OK && !climb_spent(c, LOOK_SHARE); r++) {
        int count = 0, at;
        rc = c->source->poles(c->source->context, r, c->lambda, &count, err);
        if (rc == MODAL_OK)
            rc = climb_try(c, r, c->lambda, count, NULL, false, 0, &at, err);
        else if (rc == MODAL_NO_CONVERGENCE)
            rc = MODAL_OK;
    }
    return rc;
}

static enum modal_status climb_new(struct climb *c, const struct refine_data *data,
                                   const struct order_source *source,
                                   const struct order_options *opt, struct modal_error *err)
{
    /* each pole split at most once, and more found in what they leave */
    size_t most = 2 * (size_t)(source->most > 0 ? source->most : 0) + 4 * MORE_MOST
                + 2 * (size_t)source->known_count;

    *c = (struct climb) { .data = data, .source = source, .opt = opt, .poles_most = (int)most,
                          .choice = { .chosen = -1 }, .rest_of = -1 };
    c->lambda = calloc(most, sizeof *c->lambda), c->fixed = calloc(most, sizeof *c->fixed);
    if (c->lambda == NULL || c->fixed == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "order: no memory for order %d", source->most);
    return MODAL_OK;
}

static void climb_done(struct climb *c)
{
    order_done(&c->choice);
    long_rest_done(&c->rest);
    free(c->lambda), free(c->fixed);
}

enum modal_status order_from_above(const struct refine_data *data,
                                   const struct order_source *source,
                                       const struct order_options *opt,
                                   struct order_choice *out, struct modal_error *err)
{
    struct climb c;
    int best = -1;
    bool clean = false;
    enum modal_status rc = climb_new(&c, data, source, opt, err);

    if (rc == MODAL_OK)
        rc = climb_descend(&c, &best, err);
    if (rc == MODAL_OK && best >= 0 && c.choice.candidates[best].refined)
        rc = climb_improve(&c, true, &best, err);
    if (rc == MODAL_OK && best >= 0)
        rc = settle(&c, best, err);
    if (rc == MODAL_OK && best >= 0)
        rc = is_clean(&c, best, &clean, err);
    if (rc == MODAL_OK && clean)
        rc = look_around(&c, best, err);
    if (rc == MODAL_OK) {
        c.choice.chosen = best, c.choice.clean = clean, c.choice.crowded = clean
            && unresolved(&c, &c.choice.candidates[best].fit);
        /* what work cut off is no loss where nothing is left to find */
        c.choice.limited &= !clean;
        c.choice.rest = c.rest, c.rest = (struct long_rest) { 0 };
        *out = c.choice;
        c.choice = (struct order_choice) { 0 };
    }
    climb_done(&c);
    return rc;
}

enum modal_status order_choose(const struct refine_data *data, const struct order_source *source,
                               const struct order_options *opt, struct order_choice *out,
                               struct modal_error *err)
{
    struct order_options none = { .fixed = 0 };
    struct climb c;
    int best = -1;
    enum modal_status rc = climb_new(&c, data, source, opt != NULL ? opt : &none, err);

    if (rc != MODAL_OK)
        goto out;
    rc = c.opt->fixed > 0 ? look_at_told(&c, &best, err) : look(&c, &best, err);
    c.choice.cut =
        c.opt->cut > 0 && best >= 0 && c.choice.candidates[best].r + ORDER_AHEAD > c.opt->cut;
    if (rc == MODAL_OK && best >= 0 && c.opt->fixed > 0)
        rc = refine_told(&c, &best, err);
    else if (rc == MODAL_OK && best >= 0 && !c.choice.cut)
        rc = refine_ladder(&c, &best, err);
    if (rc == MODAL_OK && best >= 0 && c.opt->thorough && c.opt->fixed == 0)
        rc = climb_search_remainder(&c, &best, err);
    if (rc == MODAL_OK && best >= 0 && !c.choice.cut)
        rc = climb_improve(&c, false, &best, err);
    if (rc == MODAL_OK && best >= 0)
        rc = settle(&c, best, err);
    if (rc != MODAL_OK)
        goto out;
    c.choice.chosen = best;
    *out = c.choice;
    c.choice = (struct order_choice) { 0 };
out:
    climb_done(&c);
    return rc;
}

void order_done(struct order_choice *choice)
{
    for (int i = 0; i < choice->count; i++)
        refined_done(&choice->candidates[i].fit);
    free(choice->candidates);
    long_rest_done(&choice->rest);
    *choice = (struct order_choice) { 0 };
}
