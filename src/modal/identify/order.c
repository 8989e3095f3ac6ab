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
 * Work is counted, never timed.  Each pass ends where `work` is spent, so that a long record of
 * many modes ends with the best so far.
 *
 * [LM00] Laurent and Massart, Ann. Statist. 28 (2000) 1302-1338.
 */
#include "modal/identify/order.h"
#include "modal/identify/colour.h"
#include "modal/identify/exponents.h"
#include "modal/identify/remainder.h"
#include "modal/identify/trim.h"
#include "modal/linalg/svd.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LOOK_STEPS = 6 };
static const double SPREAD = 4;
static const double LOOK_SHARE = 0.5;      /* of the work, for pass 1 */

/* From above: steps before the first weeding, and directions looked for in what a fit leaves. */
enum { STEPS_BEFORE = 8, MORE_MOST = 16, AROUND = 20 };
/* Of a pole's price that it must pay before it is refined: what is left then is more than noise. */
static const double SHARE_LOOK = 0.5;
/* Of -2 ln(likelihood): models that differ by less are equally likely, and a search that brings no
 * more has ended. */
static const double NO_BETTER = 1;
/* Evaluations that the refinement from above may be expected to take. */
static const double EVALUATIONS = 16;

struct climb {
    const struct refine_data *data;
    const struct order_source *source;
    const struct order_options *opt;
    struct order_choice choice;
    int room;
    int poles_most;                 /* room in: */
    double complex *lambda;
    bool *fixed;
    struct long_rest rest;          /* of data in blocks: what candidate `rest_of` leaves */
    int rest_of;                    /* -1: none yet */
};

static double bic_of(const struct climb *c, int i)
{
    return i < 0 ? HUGE_VAL : c->choice.candidates[i].fit.bic;
}

static int order_most(const struct climb *c)
{
    return c->opt->order_most > 0 && c->opt->order_most < c->data->Y->m ? c->opt->order_most
                                                                        : c->data->Y->m - 1;
}

/* Is SHARE of the work spent?  Asked where there is more to try. */
static bool spent(struct climb *c, double share)
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

static enum modal_status fit_poles(struct climb *c, const double complex *lambda, int count,
                                   const bool *fixed, bool refine, double rival,
                                   struct refined *fit, struct modal_error *err)
{
    return fit_steps(c, lambda, count, fixed, refine, rival, 0, fit, err);
}

/* Fit COUNT poles, refined or not, and append the candidate; *at is its index, -1 where there is
 * nothing to fit. */
static enum modal_status try_poles(struct climb *c, int r, const double complex *lambda, int count,
                                   const bool *fixed, bool refine, double rival, int *at,
                                   struct modal_error *err)
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

/* Candidate I, looked at so far, refined in its place; a fit that refining made worse is kept as it
 * was. */
static enum modal_status refine_candidate(struct climb *c, int i, double rival,
                                          struct modal_error *err)
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

/* Candidate I, looked at, taken a few steps further: no longer as the pencil has it, not yet
 * refined. */
static enum modal_status step_candidate(struct climb *c, int i, int steps, struct modal_error *err)
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
    double all = safe_matrix_norm(c->data->Y);
    int best_r = 0;

    *least = -1;
    for (int r = 1;
         r <= c->source->most && worth_a_look(c, r, *least, best_r, all) && rc == MODAL_OK; r++) {
        int count = 0, at;
        if (c->opt->fixed > 0 && r != c->opt->fixed)
            continue;
        if (*least >= 0 && spent(c, LOOK_SHARE))
            break;
        rc = c->source->poles(c->source->context, r, c->lambda, &count, err);
        /* the factors of this order left the range of doubles: no candidate */
        if (rc == MODAL_NO_CONVERGENCE) {
            rc = MODAL_OK;
            continue;
        }
        if (rc == MODAL_OK)
            rc = try_poles(c, r, c->lambda, count, NULL, false, 0, &at, err);
        if (rc == MODAL_OK && at >= 0 && bic_of(c, at) < bic_of(c, *least)) {
            *least = at, best_r = r;
            if (c->opt->refine.iterations >= 0 && uneven(&c->choice.candidates[at].fit))
                rc = step_candidate(c, at, LOOK_STEPS, err);
        }
    }
    return rc;
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
        if (c->choice.candidates[i].refined || bic_of(c, i) > bic_of(c, *best) + reach
            || i > *best + 2)
            continue;
        if (spent(c, 1))
            break;
        rc = refine_candidate(c, i, bic_of(c, *best), err);
        if (rc == MODAL_OK && bic_of(c, i) < bic_of(c, *best))
            *best = i;
    }
    return rc;
}

/* ---- from above ---- */

static enum modal_status trim(struct climb *c, double complex *lambda, int *count, double share,
                              double reach, int most, struct modal_error *err)
{
    struct trim_options opt = { share, reach, most };

    return trim_poles(c->data, lambda, count, NULL, &opt, &c->choice.work, err);
}

/* The poles of order r that pay for half of themselves, as they are. */
static enum modal_status look_at(struct climb *c, int r, int *at, struct modal_error *err)
{
    int count = 0;
    enum modal_status rc = c->source->poles(c->source->context, r, c->lambda, &count, err);

    *at = -1;
    if (rc == MODAL_NO_CONVERGENCE)             /* as in the ladder: no candidate */
        return MODAL_OK;
    while (count > 1 && poles_order(c->lambda, count, c->data->tau) > order_most(c))
        count--;
    if (rc == MODAL_OK && count > 0)
        rc = trim(c, c->lambda, &count, SHARE_LOOK, 0, 0, err);
    return rc == MODAL_OK ? try_poles(c, r, c->lambda, count, NULL, false, 0, at, err) : rc;
}

/* Candidate *best without the poles that do not pay, MOST at a time (0: any number), refined, until
 * all do.  REACH: what refining may recover of a loss; where there is any, what cannot win is not
 * refined to its end. */
static enum modal_status weed(struct climb *c, double reach, int most, int *best,
                              struct modal_error *err)
{
    for (;;) {
        const struct refined *fit = &c->choice.candidates[*best].fit;
        int count = fit->poles, at;
        enum modal_status rc;
        if (spent(c, 1))
            return MODAL_OK;
        memcpy(c->lambda, fit->lambda, (size_t)count * sizeof *c->lambda);
        rc = trim(c, c->lambda, &count, 1, reach, most, err);
        if (rc != MODAL_OK || count == fit->poles)
            return rc;
        rc = try_poles(c, 0, c->lambda, count, NULL, true, reach > 0 ? bic_of(c, *best) : 0, &at,
                       err);
        if (rc != MODAL_OK || at < 0 || !(bic_of(c, at) < bic_of(c, *best)))
            return rc;
        *best = at;
    }
}

/* Candidate *at taken a few steps, weeded, refined. */
static enum modal_status ripen(struct climb *c, int *at, struct modal_error *err)
{
    enum modal_status rc = step_candidate(c, *at, STEPS_BEFORE, err);

    if (rc == MODAL_OK)
        rc = weed(c, 0, 0, at, err);
    return rc == MODAL_OK ? refine_candidate(c, *at, 0, err) : rc;
}

/* The price of one pair more than FIT has. */
static double pair_price(const struct climb *c, const struct refined *fit)
{
    const struct refine_data *d = c->data;
    int phases = d->phases > 0 ? d->phases : 1;
    double n = (double)d->Y->m * phases;
    struct criterion k = { fit->groups, phases, n, n * (d->share > 0 ? d->share : 1), fit->noise,
                           fit->floor };

    return criterion_price(&k, fit->order + 2, fit->parameters + 2)
         - criterion_price(&k, fit->order, fit->parameters);
}

/* COUNT poles in c->lambda: a candidate, weeded and refined, and the best where it is better. */
static enum modal_status join_poles(struct climb *c, int count, int *best, bool *better,
                                    struct modal_error *err)
{
    int at;
    enum modal_status rc;

    rc = try_poles(c, 0, c->lambda, count, NULL, false, 0, &at, err);
    if (rc != MODAL_OK || at < 0)
        return rc;
    rc = ripen(c, &at, err);
    if (rc == MODAL_OK && bic_of(c, at) < bic_of(c, *best) - NO_BETTER)
        *best = at, *better = true;
    return rc;
}

/* Poles in what the best leaves, E: those that a pencil shows; where they are no good the one that
 * E shows most of, PEAK. */
static enum modal_status add_poles(struct climb *c, const struct matrix *E, double complex peak,
                                   int *best, bool *better, struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    int count = fit->poles, more = 0, room = order_most(c) - fit->order;
    enum modal_status rc;

    if (room < 1 || count + MORE_MOST > c->poles_most)
        return MODAL_OK;
    rc = remainder_poles(E, c->data->tau, room < MORE_MOST ? room : MORE_MOST, c->lambda + count,
                         &more, err);
    more += count;
    memcpy(c->lambda, fit->lambda, (size_t)count * sizeof *c->lambda);
    while (more > count && poles_order(c->lambda, more, c->data->tau) > order_most(c))
        more--;
    if (rc == MODAL_OK)
        rc = trim(c, c->lambda, &more, SHARE_LOOK, 0, 0, err);
    if (rc == MODAL_OK && (more != count
                           || memcmp(c->lambda, fit->lambda, (size_t)more * sizeof *c->lambda)))
        rc = join_poles(c, more, best, better, err);
    fit = &c->choice.candidates[*best].fit;
    if (rc != MODAL_OK || *better || fit->order + pole_order(peak, c->data->tau) > order_most(c))
        return rc;
    memcpy(c->lambda, fit->lambda, (size_t)count * sizeof *c->lambda);
    c->lambda[count] = peak;
    return join_poles(c, count + 1, best, better, err);
}

/* c->rest is that of candidate AT. */
static enum modal_status look_at_rest(struct climb *c, int at, struct modal_error *err)
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
 * shows in COUNT places. Chi-squared of d degrees of freedom is above d + 2 sqrt(d x) + 2 x with
 * less than e^-x [LM00], here 1 / COUNT. What it then pays is another matter. */
static double worth_looking(const struct climb *c, const struct refined *fit, double count)
{
    double d = 2.0 * c->data->Y->n, x = log(fmax(count, 2));

    return fmin(SHARE_LOOK * pair_price(c, fit), d + 2 * sqrt(d * x) + 2 * x);
}

/* Poles in what the best leaves, if that could pay for a pair. */
static enum modal_status search_once(struct climb *c, int *best, bool *better,
                                     struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    double least = worth_looking(c, fit, REMAINDER_FILTERS * c->data->Y->m), chi2 = 0;
    double complex peak = 0;
    struct matrix E = { 0 };
    enum modal_status rc = MODAL_OK;

    if (c->data->blocks != NULL && ((rc = look_at_rest(c, *best, err)) != MODAL_OK
                                    || !(c->rest.chi2 > least)))
        return rc;
    rc = remainder_of(c->data, fit, &E, err);
    if (rc == MODAL_OK && E.x != NULL)
        rc = remainder_peak(&E, c->data->tau, &peak, &chi2, err);
    if (rc == MODAL_OK && chi2 > least)
        rc = add_poles(c, &E, peak, best, better, err);
    free(E.x);
    return rc;
}

/* As long as there are any. */
static enum modal_status search_remainder(struct climb *c, int *best, struct modal_error *err)
{
    bool better = true;
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && better && !spent(c, 1)) {
        better = false;
        rc = search_once(c, best, &better, err);
    }
    return rc;
}

/* Multiplications of one evaluation of ORDER columns. Signals that no few modes make may be exact,
 * of a system that is not linear: those take a QR. */
static double evaluation_work(const struct climb *c, int order)
{
    double columns = 2.0 * order + c->data->Y->n;

    return c->opt->many ? refine_work(c->data, order) : c->data->Y->m * columns * columns;
}

/* The poles that are known, as they are. */
static enum modal_status look_at_known(struct climb *c, int *best, struct modal_error *err)
{
    const struct order_source *s = c->source;
    int count = s->known_count;

    if (s->known == NULL || count < 1 || count > c->poles_most)
        return MODAL_OK;
    return try_poles(c, 0, s->known, count, NULL, false, 0, best, err);
}

/* The whole signal subspace, at the sizes that the singular values suggest; the best of them
 * refined, and completed. */
static enum modal_status descend(struct climb *c, int *best, struct modal_error *err)
{
    const struct order_source *s = c->source;
    const int tops[] = { s->signals > 0 ? s->signals + ORDER_AHEAD : 0, c->opt->look, s->most };
    enum modal_status rc = look_at_known(c, best, err);
    double expected;
    int before = 0;

    for (size_t i = 0; i < sizeof tops / sizeof *tops && rc == MODAL_OK; i++) {
        int r = tops[i] < s->most ? tops[i] : s->most, at;
        if (r < 1 || r == before || (*best >= 0 && spent(c, LOOK_SHARE)))
            continue;
        rc = look_at(c, r, &at, err);
        if (rc == MODAL_OK && at >= 0 && bic_of(c, at) < bic_of(c, *best))
            *best = at;
        before = r;
    }
    if (rc != MODAL_OK || *best < 0 || c->opt->refine.iterations < 0)
        return rc;
    expected = EVALUATIONS * evaluation_work(c, c->choice.candidates[*best].fit.order);
    if (c->opt->work > 0 && c->choice.work + expected > c->opt->work)
        return MODAL_OK;                        /* more than there is to spend */
    rc = ripen(c, best, err);
    return rc == MODAL_OK ? search_remainder(c, best, err) : rc;
}

/* Is candidate AT a better fit than the best, its pole J still what a real pole could stand for? A
 * pair that turns by a whole circle in its life 1 / |a| shows two columns to a pencil: one that
 * ends there went to a mode that is in the fit already, and splits it. */
static bool better_turned(const struct climb *c, int at, int j, int best)
{
    const struct refined *fit = &c->choice.candidates[at].fit;

    return bic_of(c, at) < bic_of(c, best) && refined_converged(fit)
           && cimag(fit->lambda[j]) <= 2 * M_PI * fabs(creal(fit->lambda[j]));
}

/* Pass 3: real pole J of the best as a pair. It is told from two real ones, and from t e^{at}, once
 * it turns by a radian in its life 1 / |a|: it starts there. */
static enum modal_status turn_pole(struct climb *c, int j, int *best, struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    double rate = fabs(creal(fit->lambda[j])), record = c->data->tau * c->data->Y->m;
    struct refined looked;
    int n = fit->poles, at;
    bool worth;
    enum modal_status rc;

    if (rate * record < M_PI || rate * c->data->tau > M_PI_2 || fit->order + 1 > order_most(c))
        return MODAL_OK;
    memcpy(c->lambda, fit->lambda, (size_t)n * sizeof *c->lambda);
    c->lambda[j] += I * rate;
    rc = fit_poles(c, c->lambda, n, NULL, false, 0, &looked, err);
    if (rc != MODAL_OK)
        return rc;
    worth = looked.bic < bic_of(c, *best) + ORDER_SPLIT_REACH;
    refined_done(&looked);
    if (!worth)
        return MODAL_OK;
    rc = try_poles(c, 0, c->lambda, n, NULL, true, bic_of(c, *best), &at, err);
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
    struct refined looked;
    int n = fit->poles, at;
    double chi2 = HUGE_VAL;
    bool worth;
    enum modal_status rc = MODAL_OK;

    if (pole_kind(lambda, c->data->tau) == POLE_REAL)
        return turn_pole(c, j, best, err);
    if (cimag(lambda) <= 2 * apart || cimag(lambda) >= nyquist - 2 * apart
        || fit->order + 2 > order_most(c) || n + 1 > c->poles_most)
        return MODAL_OK;
    if (E != NULL && c->data->blocks != NULL)
        chi2 = c->rest.beside[j];
    else if (E != NULL)
        rc = remainder_split(E, c->data->tau, lambda, &chi2, err);
    if (rc != MODAL_OK || !(chi2 > worth_looking(c, fit, n)))
        return rc;
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
        rc = split_pole(c, NULL, j, best, err);
    return rc;
}

/* The same for those poles only beside which the remainder has what a second one could take. */
static enum modal_status split_seen(struct climb *c, int *best, struct modal_error *err)
{
    int poles = c->choice.candidates[*best].fit.poles, made = -1;
    struct matrix E = { 0 };
    enum modal_status rc = MODAL_OK;

    for (int j = 0; j < poles && rc == MODAL_OK && !spent(c, 1); j++) {
        if (made != *best) {
            free(E.x), E.x = NULL;
            rc = c->data->blocks != NULL
                     ? look_at_rest(c, *best, err)
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
    return weed(c, fmax(ORDER_REACH * c->data->Y->m * c->data->Y->n, 100), 1, best, err);
}

/* A pole that moves in the record and whose error exceeds its own size: the data do not say that it
 * is there. -1: none. */
static int undetermined(const struct climb *c, const struct refined *fit)
{
    double record = c->data->tau * c->data->Y->m;
    int worst = -1;

    for (int j = 0; j < fit->poles; j++) {
        double size = cabs(fit->lambda[j]), error = hypot(fit->std_re[j], fit->std_im[j]);
        if (size * record > 3 && error > size
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
        if (drop < 0 || fit->poles < 2 || spent(c, 1))
            return MODAL_OK;
        n = without(c, *best, drop, c->lambda);
        rc = try_poles(c, 0, c->lambda, n, NULL, true, 0, &at, err);
        if (rc != MODAL_OK || at < 0)
            return rc;
        if (!(c->choice.candidates[at].fit.residual < ORDER_WORSE * residual))
            return MODAL_OK;
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
        || spent(c, 1))
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

/* Passes 3 and 4. */
static enum modal_status improve(struct climb *c, bool above, int *best, struct modal_error *err)
{
    bool fixed = c->opt->fixed > 0;
    enum modal_status rc = MODAL_OK;

    if (!fixed)
        rc = above ? split_seen(c, best, err) : split(c, best, err);
    if (rc == MODAL_OK && !fixed)
        rc = simplify(c, best, err);
    if (rc == MODAL_OK && !fixed && c->choice.candidates[*best].refined)
        rc = drop_undetermined(c, best, err);
    if (rc == MODAL_OK && !c->opt->no_offset)
        rc = pin_offset(c, best, err);
    return rc;
}

/* The winner taken to its minimum, if the ladder was not cut short; a few evaluations, which are
 * not counted among the search's. */
static enum modal_status settle(struct climb *c, int best, struct modal_error *err)
{
    struct order_candidate *k = &c->choice.candidates[best];
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
                && cabs(fit->lambda[i] - fit->lambda[j]) * record < M_PI)
                return true;
    return false;
}

/* Is the best one set of modes, and what it leaves white noise, or no further from it than one pair
 * that does not pay makes it? */
static enum modal_status is_clean(struct climb *c, int best, bool *clean, struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[best].fit;
    struct matrix E = { 0 };
    double mean[COLOUR_LAGS], hidden = pair_price(c, fit);
    enum modal_status rc;

    *clean = false;
    if (!refined_converged(fit) || c->choice.limited)
        return MODAL_OK;
    colour_left_by(fit->lambda, fit->poles, c->data->tau, c->data->Y->m, mean);
    if (c->data->blocks != NULL) {
        rc = look_at_rest(c, best, err);
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
         && rc == MODAL_OK && !spent(c, LOOK_SHARE); r++) {
        int count = 0, at;
        rc = c->source->poles(c->source->context, r, c->lambda, &count, err);
        if (rc == MODAL_OK)
            rc = try_poles(c, r, c->lambda, count, NULL, false, 0, &at, err);
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
        rc = descend(&c, &best, err);
    if (rc == MODAL_OK && best >= 0 && c.choice.candidates[best].refined)
        rc = improve(&c, true, &best, err);
    if (rc == MODAL_OK && best >= 0)
        rc = settle(&c, best, err);
    if (rc == MODAL_OK && best >= 0)
        rc = is_clean(&c, best, &clean, err);
    if (rc == MODAL_OK && clean)
        rc = look_around(&c, best, err);
    if (rc == MODAL_OK) {
        c.choice.chosen = best, c.choice.clean = clean, c.choice.crowded = clean
            && unresolved(&c, &c.choice.candidates[best].fit);
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
    rc = look(&c, &best, err);
    c.choice.cut =
        c.opt->cut > 0 && best >= 0 && c.choice.candidates[best].r + ORDER_AHEAD > c.opt->cut;
    if (rc == MODAL_OK && best >= 0 && !c.choice.cut)
        rc = refine_ladder(&c, &best, err);
    if (rc == MODAL_OK && best >= 0 && c.opt->thorough && c.opt->fixed == 0)
        rc = search_remainder(&c, &best, err);
    if (rc == MODAL_OK && best >= 0 && !c.choice.cut)
        rc = improve(&c, false, &best, err);
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
