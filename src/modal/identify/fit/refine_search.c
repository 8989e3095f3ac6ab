/* refine_search.c - the descent to the minimum of refine.c's (1), and its weights */
#include "modal/identify/fit/refine_state.h"
#include "modal/identify/linear/exponents.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double
    DECAY_MOST = 36,                /* ln of the fastest decay in one step: below it a column is its
                                     * first entry */
    WEIGHTS_SETTLED = 0.02;         /* of a weight, from one round to the next */
enum {
    ITERATIONS = 60,                /* where the options name none */
    FAILURES_MOST = 12,             /* of steps in a row */
    ROUNDING_FAILURES = 3,          /* after so many F's rounding is looked at */
    SETTLE_STEPS = 16,              /* to the minimum itself: the gradient falls with each */
    ROUNDS = 30                     /* of weights */
};

struct criterion refine_criterion(const struct work *w)
{
    double n = (double)w->L * w->phases;

    return (struct criterion) { w->groups, w->phases, n, refine_rows(w) * w->phases, w->data->exact,
                                w->energy, w->lowest, w->data->white };
}

static bool is_rounding(const struct work *w, const struct evaluation *e)
{
    for (int g = 0; g < w->groups; g++)
        if (!refine_at_rounding(w, e, g))
            return false;
    return true;
}

/* Weights from residuals; an all-zero signal has none.  Returns the largest relative change. */
static double set_weights(struct work *w, const double *rss, bool equal)
{
    double n = (double)w->L * w->phases, own = refine_freedom(w) / w->groups;
    double change = 0, pooled = 0, share = 0;

    for (int g = 0; g < w->groups; g++) {
        pooled += fmax(rss[g], n * w->lowest[g]);
        share += w->energy[g] > 0;
    }
    for (int g = 0; g < w->groups; g++) {
        double alone = fmax(rss[g], n * w->lowest[g]);
        /* chi-squared of 30 has a spread of a quarter: less tells signals apart by chance */
        double rest = equal || own < REFINE_FREEDOM_LEAST ? pooled / fmax(share, 1) : alone;
        double weight = w->energy[g] > 0 ? 1 / sqrt(fmax(rest / fmax(own, 1), DBL_MIN)) : 0;
        if (w->energy[g] > 0)
            change = fmax(change, w->weight[g] > 0 ? fabs(weight / w->weight[g] - 1) : 1);
        w->weight[g] = weight;
    }
    return change;
}

/* A = [R_J; 0], 2 n x n, and delta = [g; 0]. */
static void linear_model(int n, const double *T, double *A, double *delta)
{
    memset(A, 0, 2 * (size_t)n * (size_t)n * sizeof *A);
    memset(delta, 0, 2 * (size_t)n * sizeof *delta);
    for (int j = 0; j < n; j++)
        memcpy(A + j * 2 * n, T + j * (n + 1), (size_t)(j + 1) * sizeof *A);
    memcpy(delta, T + n * (n + 1), (size_t)n * sizeof *delta);
}

/* min |[R_J; sqrt(mu) diag] delta - [g; 0]|. False where it has no solution. */
static bool solve_damped(int n, double mu, double *A, double *delta)
{
    int ld = 2 * n;

    for (int j = 0; j < n; j++) {
        double norm = cblas_dnrm2(n, A + j * ld, 1);
        /* Marquardt's scaling: mu is a part of each column's own square */
        A[n + j + j * ld] = sqrt(mu) * (norm > 0 ? norm : 1);
    }
    /* by QR of R_J over the damping: J^T J would square the condition */
    if (LAPACKE_dgels(LAPACK_COL_MAJOR, 'N', ld, n, 1, A, ld, delta, ld) != 0)
        return false;
    for (int i = 0; i < n; i++)
        if (!isfinite(delta[i]))
            return false;
    return true;
}

bool refine_undamped_step(int n, const double *T, double *A, double *delta)
{
    linear_model(n, T, A, delta);
    return solve_damped(n, 0, A, delta);
}

/*
 * Of two pairs that overlap the data tell the mean m of the exponents and the square s of half
 * their difference d: what they are together is an even function of d, whose derivative in d is 0
 * at d = 0, where a descent in the exponents themselves would end.  Steps of such are steps of m
 * and s,
 *
 *     d(lambda_1), d(lambda_2) = dm +- ds / (2 d),   then   m + dm +- sqrt(s + ds).             (8)
 *
 * So it is where their amplitudes are alike, as they become for any motion (A + B t) e^{m t} as d
 * vanishes, A +- B / (2 d). Of a strong one and a weak one the strong one itself is told, and they
 * are stepped as they are.
 */
static double complex half_apart(const struct point *at, int i, int j)
{
    return CMPLX(at->a[i] - at->a[j], at->b[i] - at->b[j]) / 2;
}

static bool overlap(const struct work *w, const struct point *at, int i, int j)
{
    double wide = fmax(2 * M_PI / w->L, fmin(fabs(at->a[i]), fabs(at->a[j])));

    return cabs(half_apart(at, i, j)) * 2 < wide;
}

/* By their columns of R_J, to a factor of two. */
static bool alike(const struct work *w, const struct evaluation *e, int i, int j)
{
    int n = w->parameters + 1;
    double one = cblas_dnrm2(n, e->T + w->first[i] * n, 1),
           other = cblas_dnrm2(n, e->T + w->first[j] * n, 1);

    return fmax(one, other) < 2 * fmin(one, other);
}

/* Has pole J two parameters of its own? */
static bool is_free_pair(const struct work *w, int j)
{
    return w->kind[j] == POLE_PAIR && w->first[j] >= 0 && w->turn[j] == 1 && !w->tied;
}

/* s->partner: of each pole the nearest that it overlaps, each in one pair; -1: none. */
static void find_partners(const struct work *w, struct search *s)
{
    for (int i = 0; i < w->count; i++)
        s->partner[i] = -1;
    for (int i = 0; i < w->count; i++) {
        int best = -1;
        if (!is_free_pair(w, i) || s->partner[i] >= 0)
            continue;
        for (int j = i + 1; j < w->count; j++)
            if (is_free_pair(w, j) && s->partner[j] < 0
                && overlap(w, &s->at, i, j) && half_apart(&s->at, i, j) != 0
                && alike(w, &s->now, i, j)
                && (best < 0 || cabs(half_apart(&s->at, i, j))
                                    < cabs(half_apart(&s->at, i, best))))
                best = j;
        s->partner[i] = best;
        if (best >= 0)
            s->partner[best] = i;
    }
}

/* Two columns of N numbers, of Re and Im, times the complex number F. */
static void turn_columns(int n, double *re, double *im, double complex f)
{
    for (int k = 0; k < n; k++) {
        double x = re[k] * creal(f) + im[k] * cimag(f);
        im[k] = im[k] * creal(f) - re[k] * cimag(f);
        re[k] = x;
    }
}

/* R_J by (8): of a pair's columns, those of m and of s. */
static void to_means(const struct work *w, const struct search *s)
{
    int n = w->parameters;

    for (int i = 0; i < w->count; i++) {
        int j = s->partner[i];
        if (j < i)
            continue;
        double *one = s->A + w->first[i] * 2 * n, *other = s->A + w->first[j] * 2 * n;
        for (int c = 0; c < 2; c++, one += 2 * n, other += 2 * n)
            for (int k = 0; k < n; k++) {
                double x = one[k];
                one[k] = x + other[k], other[k] = x - other[k];
            }
        turn_columns(n, other - 4 * n, other - 2 * n, 1 / (2 * half_apart(&s->at, i, j)));
    }
}

/* Steps of exponents from those of m and s: LINEAR, or as far as they go. */
static void from_means(const struct work *w, const struct search *s, bool linear,
                       const double *delta, double *out)
{
    memcpy(out, delta, (size_t)w->parameters * sizeof *out);
    for (int i = 0; i < w->count; i++) {
        int j = s->partner[i];
        if (j < i)
            continue;
        const double *m = delta + w->first[i], *t = delta + w->first[j];
        double complex d = half_apart(&s->at, i, j), ds = CMPLX(t[0], t[1]), half = ds / (2 * d);
        if (!linear) {
            double complex root = csqrt(d * d + ds);
            half = (creal(root * conj(d)) < 0 ? -root : root) - d;
        }
        out[w->first[i]] = m[0] + creal(half), out[w->first[i] + 1] = m[1] + cimag(half);
        out[w->first[j]] = m[0] - creal(half), out[w->first[j] + 1] = m[1] - cimag(half);
    }
}

/* |g|^2 - |g - R_J delta|^2: what (4) promises. */
static double promised(int n, const double *T, const double *delta)
{
    double sum = 0;

    for (int i = 0; i < n; i++) {
        double x = 0, g = T[i + n * (n + 1)];
        for (int j = i; j < n; j++)
            x += T[i + j * (n + 1)] * delta[j];
        sum += x * (2 * g - x);     /* g^2 - (g - x)^2, without cancelling */
    }
    return sum;
}

double refine_guard(const struct work *w, double a)
{
    return fmin(fmax(a, -DECAY_MOST), EXPONENT_MOST / w->L);    /* over the record: finite */
}

static bool at_guard(const struct work *w, const struct point *at)
{
    for (int j = 0; j < w->count; j++)
        if (w->first[j] >= 0 && (at->a[j] <= -DECAY_MOST || at->a[j] >= EXPONENT_MOST / w->L))
            return true;
    return false;
}

/* A line that passes 0 or Nyquist would go on as its mirror, and its multiplier's other lines would
 * not: such a step goes half of the way at most. */
static double tied_scale(const struct work *w, const struct point *from, const double *delta,
                         double scale)
{
    for (int j = 0; j < w->count && w->tied; j++) {
        double step = w->first[j] >= 0 && w->kind[j] == POLE_PAIR && w->turn[j] != 0
                    ? w->turn[j] * delta[w->first[j] + 1] : 0;
        double way = step < 0 ? from->b[j] : M_PI - from->b[j];
        if (fabs(step) * scale > way / 2)
            scale = way / 2 / fabs(step);
    }
    return scale;
}

/* No step turns a phase over the record by more than a few radians: another line is another
 * minimum. */
void refine_take_step(const struct work *w, const struct point *from, const double *delta,
                      struct point *to)
{
    double most = 0, scale;

    for (int i = 0; i < w->parameters; i++)
        most = fmax(most, fabs(delta[i]) * w->L);
    scale = most > REFINE_TURN_MOST ? REFINE_TURN_MOST / most : 1;
    scale = tied_scale(w, from, delta, scale);
    for (int j = 0; j < w->count; j++) {
        int p = w->first[j];
        to->a[j] = from->a[j], to->b[j] = from->b[j];
        if (p < 0)
            continue;
        to->a[j] = refine_guard(w, from->a[j] + scale * delta[p]);
        if (w->kind[j] == POLE_PAIR && w->turn[j] != 0) {
            /* conjugates are the same pair */
            double b = fabs(from->b[j] + scale * w->turn[j] * delta[p + 1]);
            /* past Nyquist samples see the mirror */
            to->b[j] = fmin(b > M_PI ? fabs(2 * M_PI - b) : b, nextafter(M_PI, 0));
            to->b[j] = fmax(to->b[j], 1e-12);
        }
    }
}

bool refine_search_new(struct search *s, struct work *w)
{
    size_t n = (size_t)w->parameters, poles = (size_t)w->count, groups = (size_t)w->groups;
    struct point *points[] = { &s->at, &s->trial };
    struct evaluation *evaluations[] = { &s->now, &s->next };
    struct workspace *held = &w->held;

    s->A = workspace_numbers(held, 2 * n, n), s->delta = workspace_numbers(held, 2 * n, 1);
    s->step = workspace_numbers(held, n, 1);
    s->partner = workspace_zeros(held, poles, sizeof *s->partner);
    for (int i = 0; i < 2; i++) {
        points[i]->a = workspace_numbers(held, poles, 1);
        points[i]->b = workspace_numbers(held, poles, 1);
        evaluations[i]->rss = workspace_numbers(held, groups, 1);
        evaluations[i]->near = workspace_numbers(held, groups, 1);
        evaluations[i]->T = workspace_numbers(held, n + 1, n + 1);
    }
    return !held->failed;
}

static void swap_in(struct search *s)
{
    struct point p = s->at;
    struct evaluation e = s->now;

    s->at = s->trial, s->trial = p;
    s->now = s->next, s->next = e;
    s->beside = false;
}

/* The criterion, every residual times FACTOR, as if two real poles were a pair: what they cost must
 * not leap where they meet. */
double refine_worth(const struct work *w, const double *rss, double factor)
{
    struct criterion c = refine_criterion(w);

    return criterion_of(&c, rss, factor, (w->order + 1) / 2, w->order, w->parameters);
}

double refine_dearer(const struct work *w, const double complex *lambda, double tau)
{
    struct criterion c = refine_criterion(w);

    return criterion_price(&c, poles_apart(lambda, w->count, tau, w->L), w->order, w->parameters)
         - criterion_price(&c, (w->order + 1) / 2, w->order, w->parameters);
}

/* Is a signal left with little but the poles' errors?  Its residual may fall by any factor, and its
 * weight rise with it. */
static bool collapses(const struct work *w, const struct evaluation *e)
{
    for (int g = 0; g < w->groups; g++)
        /* half and more of it lies in the derivatives' span: the poles' errors made it */
        if (e->near[g] > 0.5 * e->rss[g] && !refine_at_rounding(w, e, g))
            return true;
    return false;
}

/*
 * The linear model (4) promises to lower F by |g|^2.  Where twice as much would leave the BIC above
 * the rival's, the rival has won.
 */
static bool hopeless(const struct work *w, const struct search *s, double rival)
{
    int n = w->parameters;
    /* twice: (2) leaves out a term of the residual's own size */
    double g = cblas_dnrm2(n, s->now.T + n * (n + 1), 1), left = 1 - 2 * g * g / s->now.F;

    return rival != 0 && left > 0 && !collapses(w, &s->now)
        && refine_worth(w, s->now.rss, left) > rival;
}

/* Levenberg-Marquardt's damping after Nielsen, and how often in a row it failed. */
struct damping { double mu, grow; int failures; };

static void damp_more(struct damping *d)
{
    /* doubling powers: 12 failures span 2^78 */
    d->mu = fmax(d->mu, 1e-12) * d->grow, d->grow *= 2, d->failures++;
}

/* GAIN: what F fell by over what was promised. */
static void damp_less(struct damping *d, double gain)
{
    /* Nielsen: a continuous rule, no more than a ninth at once */
    d->mu *= fmax(1.0 / 9, 1 - pow(2 * fmin(gain, 1) - 1, 3)), d->grow = 2, d->failures = 0;
}

/* |g|^2, what (4) could lower F by, is no more than F is known to: no step can be told from
 * another.  With the fit known to (6), e a number, and orthogonal to what it leaves, r, the square
 * of r is known to 2 |r| e + n e^2. */
static bool below_rounding(const struct work *w, const struct evaluation *e)
{
    int n = w->parameters;
    double g = cblas_dnrm2(n, e->T + n * (n + 1), 1), known = refine_rounding_part(w, e);

    for (int i = 0; i < w->groups; i++)
        known += w->weight[i] * w->weight[i]
            * (2 * sqrt(e->rss[i] * w->floor2[i]) + (double)w->L * w->phases * w->floor2[i]);
    return g * g <= known;
}

static enum refine_end at_rounding_end(const struct work *w, const struct evaluation *e)
{
    return is_rounding(w, e) ? REFINE_ROUNDING : REFINE_CONVERGED;
}

/* Is there a reason not to take another step? */
static bool ended(const struct work *w, const struct search *s, const struct refine_options *opt,
                  const struct damping *d, enum refine_end *end)
{
    int n = w->parameters;
    double step = opt->step > 0 ? opt->step : 1e-3;

    if (cblas_dnrm2(n, s->now.T + n * (n + 1), 1) <= step * sqrt(refine_variance(w, &s->now)))
        /* |R_J delta| <= 1e-3 s: a thousandth of a standard error in any direction */
        *end = REFINE_CONVERGED;
    else if (d->failures >= ROUNDING_FAILURES && below_rounding(w, &s->now))
        *end = at_rounding_end(w, &s->now);
    else if (d->failures > FAILURES_MOST)
        *end = REFINE_STALLED;
    else if (hopeless(w, s, opt->rival))
        *end = REFINE_HOPELESS;
    else if (opt->work > 0 && w->spent + w->cost > opt->work)
        *end = REFINE_STOPPED;
    else
        return false;
    return true;
}

/* The damped step tried, and taken where F falls.  *still: F fell by nothing that counts, and is
 * rounding. */
static enum modal_status try_step(struct work *w, struct search *s, struct damping *d, bool *still,
                                  struct modal_error *err)
{
    int n = w->parameters;
    double fall, promise;
    enum modal_status rc;

    s->iterations++, s->evaluations++;
    find_partners(w, s);
    linear_model(n, s->now.T, s->A, s->delta);
    to_means(w, s);
    if (!solve_damped(n, d->mu, s->A, s->delta)) {
        damp_more(d);
        return MODAL_OK;
    }
    from_means(w, s, true, s->delta, s->step);
    promise = promised(n, s->now.T, s->step);
    from_means(w, s, false, s->delta, s->step);
    refine_take_step(w, &s->at, s->step, &s->trial);
    rc = refine_evaluate(w, &s->trial, &s->next, err);
    s->beside = true;
    if (rc != MODAL_OK)
        return rc;
    fall = s->now.F - s->next.F;
    if (s->next.degenerate || !(fall > 0)) {  /* NAN too */
        damp_more(d);
        return MODAL_OK;
    }
    /* of F: what falls by less may be rounding */
    *still = fall <= REFINE_TIED * s->now.F && is_rounding(w, &s->next);
    swap_in(s);
    damp_less(d, fall / promise);
    return MODAL_OK;
}

/* Levenberg-Marquardt with the weights as they are. */
static enum modal_status descend(struct work *w, struct search *s, const struct refine_options *opt,
                                 enum refine_end *end, struct modal_error *err)
{
    int most = opt->iterations > 0 ? opt->iterations : ITERATIONS;
    struct damping d = { 1e-4, 2, 0 };  /* starts come near: a hundredth of each column's length */
    bool still = false;

    *end = REFINE_STALLED;
    while (s->iterations < most && !ended(w, s, opt, &d, end)) {
        enum modal_status rc = try_step(w, s, &d, &still, err);
        if (rc != MODAL_OK)
            return rc;
        if (still) {
            *end = REFINE_ROUNDING;
            break;
        }
    }
    return MODAL_OK;
}

static double gradient(const struct work *w, const struct evaluation *e)
{
    int n = w->parameters;

    return cblas_dnrm2(n, e->T + n * (n + 1), 1) / sqrt(refine_variance(w, e));
}

/*
 * To the minimum itself: whole steps, each with the weights of the residuals before it, until the
 * gradient is as small as asked for or as rounding lets it be.  Near the minimum F no longer tells
 * better from worse (its fall is the square of the step), the gradient does; weights and exponents
 * settle by turns, so it is compared with the one before the last.
 */
static enum modal_status settle(struct work *w, struct search *s, bool equal,
                                struct modal_error *err)
{
    double before = HUGE_VAL, now = HUGE_VAL;

    for (int i = 0; i < SETTLE_STEPS && now > REFINE_SETTLED; i++) {
        enum modal_status rc;
        double next;
        /* undamped: Gauss-Newton converges at the residual's rate near the minimum */
        if (!refine_undamped_step(w->parameters, s->now.T, s->A, s->delta))
            break;
        refine_take_step(w, &s->at, s->delta, &s->trial);
        set_weights(w, s->now.rss, equal);
        rc = refine_evaluate(w, &s->trial, &s->next, err);
        s->evaluations++, s->beside = true;
        if (rc != MODAL_OK || s->next.degenerate || (next = gradient(w, &s->next)) >= before)
            return rc;
        before = now, now = next;
        swap_in(s);
    }
    return MODAL_OK;
}

/* Descend, weigh anew, until the weights settle. */
enum modal_status refine_search(struct work *w, struct search *s,
                                const struct refine_options *asked, struct refined *r,
                                enum refine_end *end, struct modal_error *err)
{
    struct refine_options own = *asked, *opt = &own;
    enum modal_status rc;

    for (int g = 0; g < w->groups; g++)
        w->weight[g] = 1;
    rc = refine_evaluate(w, &s->at, &s->now, err);
    *end = REFINE_DEGENERATE;
    if (rc != MODAL_OK || s->now.degenerate)
        return rc;
    r->start = 0;
    for (int g = 0; g < w->groups; g++)
        r->start += s->now.rss[g];
    r->start = sqrt(r->start);
    r->start_bic = refine_worth(w, s->now.rss, 1);
    if (opt->gain > 0)
        /* given up where twice the promise does not reach it */
        opt->rival = r->start_bic - opt->gain;
    for (int round = 0; round < ROUNDS; round++) {
        if (set_weights(w, s->now.rss, opt->equal_noise) < WEIGHTS_SETTLED && round > 0)
            break;
        if (w->parameters == 0 || w->look) {
            *end = w->look ? REFINE_LOOKED : REFINE_CONVERGED;
            return MODAL_OK;
        }
        s->evaluations++;
        rc = refine_evaluate(w, &s->at, &s->now, err);    /* the triangle under the new weights */
        s->beside = false;
        if (rc != MODAL_OK)
            return rc;
        rc = descend(w, s, opt, end, err);
        if (rc != MODAL_OK || *end == REFINE_STALLED || *end == REFINE_HOPELESS
            || *end == REFINE_STOPPED)
            return rc;
    }
    if (at_guard(w, &s->at))
        *end = REFINE_BOUNDED;
    return opt->settle && *end == REFINE_CONVERGED ? settle(w, s, opt->equal_noise, err) : MODAL_OK;
}
