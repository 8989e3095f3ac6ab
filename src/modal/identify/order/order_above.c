/* order_above.c - from the whole signal subspace downwards, and what that leaves searched for more
 * (order.c, from above) */
#include "modal/identify/linear/exponents.h"
#include "modal/identify/order/order_state.h"
#include "modal/identify/order/remainder.h"
#include "modal/identify/order/trim.h"
#include <stdlib.h>
#include <string.h>

enum { STEPS_BEFORE = 8 };          /* before the first weeding */
/* Of -2 ln(likelihood): models that differ by less are equally likely, and a search that brings no
 * more has ended. */
static const double NO_BETTER = 1;
/* Evaluations that the refinement from above may be expected to take. */
static const double EVALUATIONS = 16;

/* The poles of order r that pay for half of themselves, as they are. */
static enum modal_status look_at(struct climb *c, int r, int *at, struct modal_error *err)
{
    int count = 0;
    enum modal_status rc = c->source->poles(c->source->context, r, c->lambda, &count, err);

    *at = -1;
    if (rc == MODAL_NO_CONVERGENCE)             /* as in the ladder: no candidate */
        return MODAL_OK;
    /* listed by decay: the fastest go first */
    while (count > 1 && poles_order(c->lambda, count, c->data->tau) > climb_order_most(c))
        count--;
    if (rc == MODAL_OK && count > 0)
        rc = climb_trim(c, c->lambda, &count, ORDER_LOOK, 0, 0, err);
    return rc == MODAL_OK ? climb_try(c, r, c->lambda, count, NULL, false, 0, at, err) : rc;
}

/* Candidate *at taken a few steps, weeded, refined. */
static enum modal_status ripen(struct climb *c, int *at, struct modal_error *err)
{
    enum modal_status rc = climb_steps(c, *at, STEPS_BEFORE, err);

    if (rc == MODAL_OK)
        rc = climb_weed(c, 0, 0, at, err);
    return rc == MODAL_OK ? climb_refine(c, *at, 0, err) : rc;
}

/* COUNT poles in c->lambda: a candidate, weeded and refined, and the best where it is better. */
static enum modal_status join_poles(struct climb *c, int count, int *best, bool *better,
                                    struct modal_error *err)
{
    int at;
    enum modal_status rc;

    rc = climb_try(c, 0, c->lambda, count, NULL, false, 0, &at, err);
    if (rc != MODAL_OK || at < 0)
        return rc;
    rc = ripen(c, &at, err);
    /* a margin, or rounding of two equal fits would go on */
    if (rc == MODAL_OK && climb_bic(c, at) < climb_bic(c, *best) - NO_BETTER)
        *best = at, *better = true;
    return rc;
}

/* Poles in what the best leaves, E, or c->rest where data have blocks: those that a pencil shows;
 * where they are no good the one that it shows most of, PEAK. */
static enum modal_status add_poles(struct climb *c, const struct matrix *E, double complex peak,
                                   int *best, bool *better, struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    int count = fit->poles, more = 0, room = climb_order_most(c) - fit->order;
    enum modal_status rc;

    if (room < 1 || count + MORE_MOST > c->poles_most)
        return MODAL_OK;
    room = room < MORE_MOST ? room : MORE_MOST;
    rc = c->data->blocks != NULL
             ? long_rest_poles(c->data, fit, &c->rest, room, c->lambda + count, &more, err)
             : remainder_poles(E, c->data->tau, room, c->lambda + count, &more, err);
    more += count;
    memcpy(c->lambda, fit->lambda, (size_t)count * sizeof *c->lambda);
    while (more > count && poles_order(c->lambda, more, c->data->tau) > climb_order_most(c))
        more--;
    if (rc == MODAL_OK)
        rc = climb_trim(c, c->lambda, &more, ORDER_LOOK, 0, 0, err);
    if (rc == MODAL_OK && (more != count
                           || memcmp(c->lambda, fit->lambda, (size_t)more * sizeof *c->lambda)))
        rc = join_poles(c, more, best, better, err);
    fit = &c->choice.candidates[*best].fit;
    if (rc != MODAL_OK || *better
        || fit->order + pole_order(peak, c->data->tau) > climb_order_most(c))
        return rc;
    memcpy(c->lambda, fit->lambda, (size_t)count * sizeof *c->lambda);
    c->lambda[count] = peak;
    return join_poles(c, count + 1, best, better, err);
}

/* Poles in what the best leaves, if that could pay for a pair. */
static enum modal_status search_once(struct climb *c, int *best, bool *better,
                                     struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    double count = CRITERION_PLACES * (double)c->data->Y->m, chi2 = 0;
    double complex peak = 0;
    /* phases of a period hear each sample's noise but once */
    bool spreads = c->data->phases <= 1;
    struct matrix E = { 0 };
    struct colour_spread spread = { 0 };
    enum modal_status rc = remainder_of(c->data, fit, &E, err);

    if (rc == MODAL_OK && E.x != NULL)
        rc = remainder_peak(&E, c->data->tau, &peak, &chi2, err);
    if (rc == MODAL_OK && E.x != NULL && spreads)
        rc = colour_spread_of(&E, &spread, err);
    if (rc == MODAL_OK && E.x != NULL
        && chi2 > climb_worth_looking(c, fit, count, spreads ? &spread : NULL))
        rc = add_poles(c, &E, peak, best, better, err);
    free(E.x);
    return rc;
}

/* The same of data in blocks. */
static enum modal_status search_blocks(struct climb *c, int *best, bool *better,
                                       struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*best].fit;
    double count = CRITERION_PLACES * (double)c->data->Y->m;
    enum modal_status rc = climb_rest(c, *best, err);

    if (rc != MODAL_OK || !(c->rest.chi2 > climb_worth_looking(c, fit, count, &c->rest.spread)))
        return rc;
    return add_poles(c, NULL, CMPLX(0, c->rest.angle / c->data->tau), best, better, err);
}

enum modal_status climb_search_remainder(struct climb *c, int *best, struct modal_error *err)
{
    bool better = true;
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && better && !climb_spent(c, 1)) {
        better = false;
        rc = c->data->blocks != NULL ? search_blocks(c, best, &better, err)
                                     : search_once(c, best, &better, err);
    }
    return rc;
}

/* Multiplications of one evaluation of ORDER columns. Signals that no few modes make may be exact,
 * of a system that is not linear: those take a QR. */
static double evaluation_work(const struct climb *c, int order)
{
    double columns = 2.0 * order + c->data->Y->n;  /* [Phi D Y] of refine.c */

    return c->opt->many ? refine_work(c->data, order) : c->data->Y->m * columns * columns;
}

/* The poles that are known, as they are. */
static enum modal_status look_at_known(struct climb *c, int *best, struct modal_error *err)
{
    const struct order_source *s = c->source;
    int count = s->known_count;

    if (s->known == NULL || count < 1 || count > c->poles_most)
        return MODAL_OK;
    return climb_try(c, 0, s->known, count, NULL, false, 0, best, err);
}

enum modal_status climb_descend(struct climb *c, int *best, struct modal_error *err)
{
    const struct order_source *s = c->source;
    const int tops[] = { s->signals > 0 ? s->signals + ORDER_AHEAD : 0, c->opt->look, s->most };
    enum modal_status rc = look_at_known(c, best, err);
    double expected;
    int before = 0;

    for (size_t i = 0; i < sizeof tops / sizeof *tops && rc == MODAL_OK; i++) {
        int r = tops[i] < s->most ? tops[i] : s->most, at;
        if (r < 1 || r == before || (*best >= 0 && climb_spent(c, LOOK_SHARE)))
            continue;
        rc = look_at(c, r, &at, err);
        if (rc == MODAL_OK && at >= 0 && climb_bic(c, at) < climb_bic(c, *best))
            *best = at;
        before = r;
    }
    if (rc != MODAL_OK || *best < 0 || c->opt->refine.iterations < 0)
        return rc;
    /* nothing is begun that work would cut off half done */
    expected = EVALUATIONS * evaluation_work(c, c->choice.candidates[*best].fit.order);
    if (c->opt->work > 0 && c->choice.work + expected > c->opt->work)
        return MODAL_OK;                        /* more than there is to spend */
    rc = ripen(c, best, err);
    return rc == MODAL_OK ? climb_search_remainder(c, best, err) : rc;
}

/* What FIT leaves shows most of this: a pair, or a real pole where there is ROOM for no more. */
static enum modal_status most_shown(struct climb *c, const struct refined *fit, int room,
                                    double complex *lambda, int *count, struct modal_error *err)
{
    double chi2;
    struct matrix E = { 0 };
    enum modal_status rc = remainder_of(c->data, fit, &E, err);

    *count = 0;
    if (rc == MODAL_OK && E.x != NULL && room > 1) {
        rc = remainder_peak(&E, c->data->tau, lambda, &chi2, err);
        *count = 1;
    } else if (rc == MODAL_OK && E.x != NULL) {
        rc = remainder_poles(&E, c->data->tau, room, lambda, count, err);
    }
    free(E.x);
    return rc;
}

/* Candidate *at and what it leaves shows most of, whatever that pays, up to ORDER: as they are. */
static enum modal_status fill_up(struct climb *c, int order, int *at, struct modal_error *err)
{
    bool more = true;
    enum modal_status rc = MODAL_OK;

    while (more && rc == MODAL_OK && c->choice.candidates[*at].fit.order < order) {
        const struct refined *fit = &c->choice.candidates[*at].fit;
        int count = fit->poles, extra, next = -1;
        rc = most_shown(c, fit, order - fit->order, c->lambda + count, &extra, err);
        memcpy(c->lambda, fit->lambda, (size_t)count * sizeof *c->lambda);
        if (rc == MODAL_OK && extra > 0
            && poles_order(c->lambda, count + extra, c->data->tau) <= order)
            rc = climb_try(c, 0, c->lambda, count + extra, NULL, false, 0, &next, err);
        more = next >= 0 && c->choice.candidates[next].fit.end != REFINE_DEGENERATE;
        *at = more ? next : *at;
    }
    return rc;
}

/* Candidate *at without those that cost least down to ORDER, as they are. */
static enum modal_status cut_down(struct climb *c, int order, int *at, struct modal_error *err)
{
    const struct refined *fit = &c->choice.candidates[*at].fit;
    struct trim_options opt = { .order = order };
    int count = fit->poles;
    enum modal_status rc;

    if (fit->order <= order)
        return MODAL_OK;
    memcpy(c->lambda, fit->lambda, (size_t)count * sizeof *c->lambda);
    rc = trim_poles(c->data, c->lambda, &count, &opt, &c->choice.work, err);
    return rc == MODAL_OK ? climb_try(c, 0, c->lambda, count, NULL, false, 0, at, err) : rc;
}

/* Where it begins: *at, -1 where nothing is missing, or where as many directions stand out of noise
 * as a search may go up to: whatever it finds more is left, so it goes all that way, and all that
 * is cut off again (a response that is driven, whose poles need not pay). Of fewer, though they are
 * more than told, one may be of a constant, or of a mode whose place another has: what the poles
 * that pay leave shows which. */
static enum modal_status begin_told(struct climb *c, int told, int *at, struct modal_error *err)
{
    const struct order_candidate *k = &c->choice.candidates[told];
    const struct order_source *s = c->source;
    int count = k->fit.poles, all = s->signals + ORDER_AHEAD;
    enum modal_status rc;

    *at = -1;
    if (s->signals >= climb_order_most(c))
        return MODAL_OK;
    if (s->known == NULL && s->signals < c->opt->fixed)
        return look_at(c, all < s->most ? all : s->most, at, err);
    memcpy(c->lambda, k->fit.lambda, (size_t)count * sizeof *c->lambda);
    rc = climb_trim(c, c->lambda, &count, 1, 0, 0, err);
    return rc == MODAL_OK && count < k->fit.poles
               ? climb_try(c, k->r, c->lambda, count, NULL, false, 0, at, err) : rc;
}

enum modal_status climb_complete(struct climb *c, int *best, struct modal_error *err)
{
    int order = c->choice.candidates[*best].fit.order, at;
    enum modal_status rc = begin_told(c, *best, &at, err);

    if (rc != MODAL_OK || at < 0)
        return rc;
    rc = ripen(c, &at, err);
    if (rc == MODAL_OK)
        rc = climb_search_remainder(c, &at, err);
    if (rc == MODAL_OK)
        rc = cut_down(c, order, &at, err);
    if (rc == MODAL_OK)
        rc = fill_up(c, order, &at, err);
    if (rc == MODAL_OK && at >= 0 && c->choice.candidates[at].fit.order == order)
        *best = at;
    return rc;
}
