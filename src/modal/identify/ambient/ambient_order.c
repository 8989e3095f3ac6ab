/*
 * ambient_order.c - as many pairs as pay
 *
 * Subspaces give a model of every order (subspace.h), nearly the likeliest of that order.  A pair
 * pays where its gain in the logarithm of the likelihood exceeds what chance alone would bring.
 * Were its place known, twice that gain would be chi-squared with 4 l degrees of freedom; it is
 * the best of as many places as there are lines.  With x = log(lines / ALARM),
 *
 *     P(chi2_d > d + 2 sqrt(d x) + 2 x) <= exp(-x)   [LM00, lemma 1],                           (1)
 *
 * so half of (1) is the price of a pair and ALARM the probability that a record gives one too many.
 * BIC's price, 2 l log(lines), asks more and sees fewer: it is no bound on false alarms but a
 * prior.  The order that pays best is fitted, and those above it; then any pair that is not worth
 * its price, the rest fitted anew, leaves.
 *
 * Of two modes that overlap the likelihood has a second summit, near a double pole, lower by as
 * little as 10 and with bars many times as long.  Where two are nearer than those errors, models of
 * more pairs are brought down to as many, and the highest summit is the answer.  Bins that suit the
 * poles of one are too wide to tell: what a model does not explain within a bin it is not charged
 * with.
 *
 * [LM00] Laurent and Massart, Annals of Statistics 28 (2000) 1302-1338.
 */
#include "modal/identify/ambient/ambient_order.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ambient/subspace.h"
#include "modal/identify/ambient/whittle_fit.h"

enum {
    LADDER = 30,                 /* pairs whose poles the ladder's bins suit */
    EACH_LEAST = 3,              /* numbers in a past for each state, */
    EACH = 4,                    /* and in one that is taken where there were fewer */
    PAST_BEST = 10,              /* orders, of two each, beyond the best so far */
    FINER = 8,                   /* times, where likelihoods far apart are compared */
    WIDEST = 48,                 /* the spectrum between the modes in so many bins at least */
    STEPS_TRIAL = 20,            /* of a fit that is one of many */
    ABOVE = 2,                   /* orders that are fitted beyond the best of the ladder's */
    ROUNDS = 12,                 /* of pairs that leave */
    CORRECTIONS = 2,             /* of what is seen; each leaves less than a tenth of the last */
    /* of all that are settled, as of a slow one */
    SETTLING_MOST = (CORRECTIONS + 1) * AMBIENT_STEPS_MOST
};
static const double
    ALARM = 0.01,                /* probability of a pair too many in a record, (1) */
    SHARE = 1. / 3,              /* of the distance to a pole: a bin's width; 1 % of what its lines
                                    tell is lost, for what varies within it is (share^2)/12 */
    GAIN_TRIAL = 0.5,            /* a step of less is not what a pair pays with */
    GAIN_LAST = 1e-2,            /* a seventh of one standard error, all unknowns together, */
    GAIN_EACH = 1e-3,            /* or of many pairs a twentieth of one of each */
    WORK_MOST = 6e9,             /* of all fits but the answer's, as whittle.h counts it: twenty
                                    seconds */
    WORK_SETTLING = 2.4e10;      /* of the answer's: three times the steps of a trial, and one more
                                    such for what leaves */

double ambient_price(int channels, int lines)
{
    double d = whittle_unknowns_of_mode(channels), x = log(lines / ALARM);

    return (d + 2 * sqrt(d * x) + 2 * x) / 2;
}

void ambient_search_done(struct ambient_search *a)
{
    bins_done(&a->bins);
    for (int i = 0; i < a->rungs; i++)
        free(a->rung[i].mode);
    free(a->model);
    memset(a, 0, sizeof *a);
}

struct search {
    const struct spectrum *s;
    const struct ambient_limits *limits;
    struct subspace from;
    struct whittle *trial;
    double price, work;
    int settling;                /* steps left of all that settle() may take, */
    double settling_work;        /* and work */
    int order;                   /* the ladder's best */
};

/* The bins that suit the poles of M, as they are seen by BY (NULL: as they are). */
static enum modal_status bins_for(const struct search *w, const struct whittle *m,
                                  const struct whittle *by, struct bins *out,
                                  struct modal_error *err)
{
    double complex poles[WHITTLE_MODES_MOST];
    enum modal_status rc;

    for (int k = 0; k < m->count; k++)
        poles[k] = m->mode[k].lambda;
    bins_done(out);
    rc = bins_make(w->s, poles, m->count, SHARE, WIDEST, out, err);
    if (rc == MODAL_OK && by != NULL)
        whittle_correct(by, out);
    return rc;
}

/* A fit that is one of many: one that will not come to what is NEEDED of its likelihood ends. */
static enum modal_status fit(struct search *w, struct whittle *m, struct bins *bins,
                             double needed, struct modal_error *err)
{
    struct whittle_limits limits = { GAIN_TRIAL, needed, STEPS_TRIAL, 0, false, &w->work,
                                     w->limits->cancelled, w->limits->context };

    return whittle_fit(m, bins, &limits, err);
}

static enum modal_status note(struct ambient_search *out, const struct whittle *m,
                              struct modal_error *err)
{
    struct ambient_rung *r = &out->rung[out->rungs];

    if (out->rungs > WHITTLE_MODES_MOST)
        return MODAL_OK;
    *r = (struct ambient_rung) { m->count, m->likelihood, NULL, m->converged };
    r->mode = malloc(sizeof *r->mode * ((size_t)m->count + 1));
    if (r->mode == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d modes", m->count);
    memcpy(r->mode, m->mode, sizeof *r->mode * (size_t)m->count);
    out->rungs++;
    return MODAL_OK;
}

/* ---- up ---- */

/* The ladder: the likelihood of every even order from FIRST on as subspaces have it, until it no
 * longer pays, in bins that suit the poles of so many PAIRS. */
static enum modal_status climb(struct search *w, struct ambient_search *a, int first, int pairs,
                               struct modal_error *err)
{
    struct whittle *t = w->trial;
    double best = -HUGE_VAL, score;
    int most = w->from.order < 2 * w->limits->most ? w->from.order : 2 * w->limits->most;
    enum modal_status rc = MODAL_OK;

    bins_done(&a->bins);
    if (subspace_model(&w->from, most < 2 * pairs ? most : 2 * pairs, t))
        rc = bins_for(w, t, NULL, &a->bins, err);
    else
        rc = bins_make(w->s, NULL, 0, SHARE, WIDEST * WIDEST, &a->bins, err);
    w->order = first;
    for (int n = first; n <= most && rc == MODAL_OK && n <= w->order + 2 * PAST_BEST; n += 2) {
        if (w->limits->cancelled != NULL && w->limits->cancelled(w->limits->context))
            return modal_fail(err, MODAL_CANCELLED, "identify: cancelled");
        if (!subspace_model(&w->from, n, t))
            continue;
        t->likelihood = whittle_likelihood(t, &a->bins);
        score = t->likelihood - w->price * n / 2;
        rc = note(a, t, err);
        if (score > best)
            best = score, w->order = n;
    }
    if (rc == MODAL_OK && !isfinite(best))
        return modal_fail_field(err, MODAL_NO_CONVERGENCE, "signals", "no order of the subspaces "
                                "of the record has a model; leave channels out that are sums of "
                                "others");
    return rc;
}

/* A past of more numbers in the place of W's; *longer: one that has a model of the best order. */
static enum modal_status lengthen(struct search *w, int side, bool *longer, struct modal_error *err)
{
    struct subspace from;
    enum modal_status rc = subspace_make(w->s, side, &from, err);

    *longer = rc == MODAL_OK && subspace_model(&from, w->order, w->trial);
    if (*longer) {
        subspace_done(&w->from);
        w->from = from;
    } else
        subspace_done(&from);
    /* the shorter one serves where the longer is singular */
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

/* The ladder; where a past has few numbers for each state of its best order, once more from that of
 * a longer one, but for the lower orders. */
static enum modal_status climb_all(struct search *w, struct ambient_search *a,
                                   struct modal_error *err)
{
    int order, first;
    bool longer = false;
    enum modal_status rc = subspace_make(w->s, SUBSPACE_SIDE, &w->from, err);

    if (rc == MODAL_OK)
        rc = climb(w, a, 0, LADDER, err);
    order = w->limits->fixed > 0 ? 2 * w->limits->fixed : w->order;
    if (rc == MODAL_OK && EACH_LEAST * order > SUBSPACE_SIDE)
        rc = lengthen(w, (int)fmin(EACH * order, SUBSPACE_SIDE_MOST), &longer, err);
    if (!longer)
        return rc;
    first = w->order > 2 * PAST_BEST ? w->order - 2 * PAST_BEST : 0;
    while (a->rungs > 0 && 2 * a->rung[a->rungs - 1].count >= first)
        free(a->rung[--a->rungs].mode);
    return climb(w, a, first, order / 2, err);
}

/* The order that was asked for: as many pairs of the least order that has them. */
static bool take_fixed(struct search *w, struct whittle *m)
{
    int pairs = w->limits->fixed;

    for (int n = pairs; n <= 2 * pairs && n <= w->from.order; n++)
        if (subspace_model(&w->from, n, m) && m->count == pairs)
            return true;
    return false;
}

/* The model of ORDER fitted; *gain: over the model as it was, in the same bins.  TO_PAY: only as
 * far as it may pay. */
static enum modal_status try_order(struct search *w, struct ambient_search *a, int order,
                                   bool to_pay, double *gain, struct modal_error *err)
{
    struct whittle *m = a->model, *t = w->trial;
    double needed;
    enum modal_status rc;

    *gain = -HUGE_VAL;
    if (order > w->from.order || order > 2 * w->limits->most
        || !subspace_model(&w->from, order, t))
        return MODAL_OK;
    rc = bins_for(w, t, m, &a->bins, err);
    if (rc != MODAL_OK)
        return rc;
    needed = whittle_likelihood(m, &a->bins) + w->price * (t->count - m->count);
    rc = fit(w, t, &a->bins, to_pay ? needed : -HUGE_VAL, err);
    *gain = t->likelihood - needed;
    return rc;
}

static enum modal_status climb_on(struct search *w, struct ambient_search *a,
                                  struct modal_error *err)
{
    double gain;
    enum modal_status rc = MODAL_OK;

    for (int more = 1; rc == MODAL_OK && more <= ABOVE; more++) {
        rc = try_order(w, a, w->order + 2 * more, true, &gain, err);
        if (rc == MODAL_OK && gain > 0) {
            *a->model = *w->trial;
            w->order += 2 * more, more = 0;
        }
    }
    return rc;
}

/* To the summit, and again as bins are seen by what was found. */
static enum modal_status settle(struct search *w, struct whittle *m, struct bins *bins,
                                struct modal_error *err)
{
    struct whittle_limits limits = { fmax(GAIN_LAST, GAIN_EACH * m->count), -HUGE_VAL,
                                     w->settling < AMBIENT_STEPS_MOST ? w->settling
                                                                      : AMBIENT_STEPS_MOST,
                                     CORRECTIONS, true, &w->settling_work, w->limits->cancelled,
                                     w->limits->context };
    enum modal_status rc = bins_for(w, m, m, bins, err);

    if (rc == MODAL_OK)
        rc = whittle_fit(m, bins, &limits, err);
    w->settling -= m->steps;
    return rc;
}

/* ---- down ---- */

static void leave_out(struct whittle *m, int k)
{
    m->count--;
    memmove(m->mode + k, m->mode + k + 1, sizeof *m->mode * (size_t)(m->count - k));
}

/* One pair that does not pay leaves; *less: there was one. */
static enum modal_status shrink(struct search *w, struct ambient_search *a, bool *less,
                                struct modal_error *err)
{
    struct whittle *m = a->model, *t = w->trial;
    enum modal_status rc = MODAL_OK;

    *less = false;
    for (int k = 0; rc == MODAL_OK && k < m->count && !*less; k++) {
        *t = *m;
        leave_out(t, k);
        w->work -= whittle_work(t, &a->bins);
        if (m->likelihood - whittle_likelihood(t, &a->bins) > AMBIENT_PATIENCE * w->price)
            continue;
        rc = fit(w, t, &a->bins, m->likelihood - w->price, err);
        *less = m->likelihood - t->likelihood < w->price;
    }
    if (rc == MODAL_OK && *less)
        *m = *t;
    return rc;
}

/* ---- round ---- */

/* Are two modes nearer each other than their own errors?  A double pole is not excluded then. */
static bool is_near_double(const struct whittle *m)
{
    for (int k = 0; k < m->count; k++)
        for (int i = 0; i < k; i++)
            if (cabs(m->mode[k].lambda - m->mode[i].lambda)
                < m->mode[k].std_decay + m->mode[i].std_decay)
                return true;
    return false;
}

/* *more: of the logarithm of the likelihood, of T than of M, in bins fine for both. */
static enum modal_status weigh(struct search *w, const struct whittle *m,
                               const struct whittle *t, double *more, struct modal_error *err)
{
    double complex poles[2 * WHITTLE_MODES_MOST];
    struct bins fine;
    enum modal_status rc;

    for (int k = 0; k < m->count; k++)
        poles[k] = m->mode[k].lambda;
    for (int k = 0; k < t->count; k++)
        poles[m->count + k] = t->mode[k].lambda;
    rc = bins_make(w->s, poles, m->count + t->count, SHARE / FINER, WIDEST * FINER, &fine, err);
    if (rc == MODAL_OK) {
        *more = whittle_likelihood(t, &fine) - whittle_likelihood(m, &fine);
        w->work -= whittle_work(t, &fine) + whittle_work(m, &fine);
        bins_done(&fine);
    }
    return rc;
}

/* The pair of M that tells least leaves; LESS: room for a model. */
static void drop_least(struct search *w, const struct bins *bins, struct whittle *m,
                       struct whittle *less)
{
    double best = -HUGE_VAL;
    int least = 0;

    for (int k = 0; k < m->count; k++) {
        double left;
        *less = *m;
        leave_out(less, k);
        left = whittle_likelihood(less, bins);
        w->work -= whittle_work(less, bins);
        if (left > best)
            best = left, least = k;
    }
    leave_out(m, least);
}

/* From the model of ORDER, of more pairs, down to as many: another summit may be higher; where the
 * work lasts, for what is not fitted is no summit. */
static enum modal_status descend(struct search *w, struct ambient_search *a, int order,
                                 struct modal_error *err)
{
    struct whittle *m = a->model, *t = w->trial, less;
    double more;
    enum modal_status rc = try_order(w, a, order, false, &more, err);

    if (rc != MODAL_OK || !isfinite(more))
        return rc;
    while (rc == MODAL_OK && t->count > m->count && w->work > 0) {
        drop_least(w, &a->bins, t, &less);
        rc = fit(w, t, &a->bins, -HUGE_VAL, err);
    }
    if (rc != MODAL_OK || w->work <= 0)
        return rc;
    rc = settle(w, t, &a->bins, err);
    if (rc == MODAL_OK)
        rc = weigh(w, m, t, &more, err);
    if (rc == MODAL_OK && t->converged && more > GAIN_TRIAL)
        *m = *t;
    return rc;
}

static enum modal_status go_round(struct search *w, struct ambient_search *a,
                                  struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int more = 1; rc == MODAL_OK && more <= ABOVE && w->work > 0; more++)
        rc = descend(w, a, 2 * (a->model->count + more), err);
    return rc == MODAL_OK ? bins_for(w, a->model, a->model, &a->bins, err) : rc;
}

static enum modal_status run(struct search *w, struct ambient_search *a, struct modal_error *err)
{
    bool changed = true;
    enum modal_status rc = climb_all(w, a, err);

    if (rc != MODAL_OK)
        return rc;
    if (w->limits->fixed > 0 && !take_fixed(w, a->model))
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed", "no model of the record has %d "
                                "pairs; give less, or record longer", w->limits->fixed);
    if (w->limits->fixed > 0)
        return settle(w, a->model, &a->bins, err);
    subspace_model(&w->from, w->order, a->model);
    rc = bins_for(w, a->model, a->model, &a->bins, err);
    if (rc == MODAL_OK)
        rc = fit(w, a->model, &a->bins, -HUGE_VAL, err);
    if (rc == MODAL_OK)
        rc = climb_on(w, a, err);
    for (int i = 0; rc == MODAL_OK && changed && i < ROUNDS; i++) {
        rc = settle(w, a->model, &a->bins, err);
        if (rc == MODAL_OK)
            rc = shrink(w, a, &changed, err);
    }
    return rc == MODAL_OK && is_near_double(a->model) ? go_round(w, a, err) : rc;
}

enum modal_status ambient_search(const struct spectrum *s, const struct ambient_limits *limits,
                                 struct ambient_search *out, struct modal_error *err)
{
    struct search w = { .s = s, .limits = limits, .trial = malloc(sizeof *w.trial),
                        .price = ambient_price(s->channels, s->lines), .work = WORK_MOST,
                        .settling = SETTLING_MOST,
                        .settling_work = limits->work > 0 ? limits->work : WORK_SETTLING };
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    out->model = calloc(1, sizeof *out->model);
    rc = w.trial != NULL && out->model != NULL
             ? run(&w, out, err)
             : modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for a model of spectra");
    out->limit = w.work <= 0 || w.settling <= 0 || w.settling_work <= 0
        || w.order / 2 >= limits->most;
    subspace_done(&w.from);
    free(w.trial);
    return rc;
}

enum modal_status ambient_refit(const struct spectrum *s, const struct ambient_limits *limits,
                                struct whittle *m, struct modal_error *err)
{
    struct search w = { .s = s, .limits = limits, .work = WORK_MOST };
    struct bins bins = { 0 };
    enum modal_status rc = bins_for(&w, m, m, &bins, err);

    if (rc == MODAL_OK)
        rc = fit(&w, m, &bins, -HUGE_VAL, err);
    bins_done(&bins);
    return rc;
}
