/* refine.c - variable projection on the exponents
 *
 * With the basis Phi(lambda), L x q, of synthesis.h (for a pair the columns Re z^l and -Im z^l, for
 * a real multiplier z^l; z = e^{lambda tau}) and weights w_c = 1 / sigma_c the data are fitted by
 *
 *     min over lambda, C of  F = sum_c w_c^2 |y_c - Phi c_c|^2.                                 (1)
 *
 * C is linear: C = R11^{-1} Q1^T Y from Phi = Q1 R11 [GP73].  What is left is P y_c, P = I - Q1
 * Q1^T, and its derivative in a parameter alpha is, after Kaufman [K75] (the term dropped is of the
 * size of the residual),
 *
 *     d(P y_c) = -P (dPhi / dalpha) c_c.                                                        (2)
 *
 * Every derivative of Phi lies in the columns D = diag(l) Phi:  for c = b_r, b_i of a pair,
 *
 *     d/d(Re): b_r D_1 + b_i D_2,      d/d(Im): -b_i D_1 + b_r D_2,                             (3)
 *
 * so one QR of [Phi D] gives all:  P D = Q2 R22, and the least-squares problem for the step delta
 *
 *     min sum_c w_c^2 |Q2^T y_c - R22 K_c delta|^2,   K_c from (3),                             (4)
 *
 * has q rows a channel instead of L.  With few channels Y joins the QR, [Phi D Y]: Q^T Y is then
 * part of the triangle and the residuals are norms of what lies below it; with many, Q is formed
 * and Y read once, panel by panel; of a long record neither is made (doubling.h).  It is reduced to
 * a triangle R_J panel by panel (never J^T J), and damped after Levenberg and Marquardt with
 * Nielsen's rule for the damping [N99].  Since sum of squares of Q2 Q2^T is what (4) sees, with s^2
 * = F / (degrees of freedom),
 *
 *     covariance = s^2 (R_J^T R_J)^{-1}                                                         (5)
 *
 * (and more where amplitudes are little above their own noise, refine_covariance.c) is the
 * Cramer-Rao bound of white Gaussian noise at the residual's own level, amplitudes and
 * phases unknown; a step is small against the standard errors of every combination of parameters at
 * once when |R_J delta| <= 1e-3 s.
 *
 * The sigma_c are unknown too: each signal's comes from its own residual, and (1) is solved again
 * until they settle, which is maximum likelihood and costs nothing against knowing them (the
 * information matrix is block diagonal).  Where a signal leaves too few degrees of freedom for
 * that, all share one.  Signals that carry less noise then weigh more.
 *
 * Rounding.  A phase theta l is known to theta l DBL_EPSILON / 2, so the residual of perfect data
 * is not DBL_EPSILON but about
 *
 *     floor = (4 + theta L / 4) DBL_EPSILON rms(y)                                              (6)
 *
 * (in a late part of a record, L plus twice the rows before it).
 *
 * Below it nothing is signal, nor below the grid that the samples were rounded to (`least`). The
 * larger one bounds sigma_c in the weights and the residuals in the criterion (criterion.c),
 * which compares one fit with another.
 *
 * Growth: columns are divided by their largest entry, and |Re lambda| tau L stays below
 * GROWTH_MOST, so nothing overflows.
 *
 * [GP73] Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432.  [K75] Kaufman, BIT 15 (1975)
 * 49-57.
 * [N99]  Nielsen, IMM-REP-1999-05, Technical University of Denmark.
 */
#include "modal/identify/fit/refine.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine_state.h"
#include "modal/linalg/svd.h"

static bool refined_new(struct refined *r, const struct work *w)
{
    size_t count = (size_t)w->count, n = (size_t)w->parameters, groups = (size_t)w->groups;

    *r = (struct refined) { .poles = w->count, .order = w->order, .parameters = w->parameters,
                            .groups = w->groups };
    r->lambda = workspace_zeros(&r->space, count, sizeof *r->lambda);
    r->first = workspace_zeros(&r->space, count, sizeof *r->first);
    r->turn = workspace_zeros(&r->space, count, sizeof *r->turn);
    r->covariance = workspace_numbers(&r->space, n, n);
    r->std_re = workspace_numbers(&r->space, count, 1);
    r->std_im = workspace_numbers(&r->space, count, 1);
    r->noise = workspace_numbers(&r->space, groups, 1);
    r->floor = workspace_numbers(&r->space, groups, 1);
    return !r->space.failed;
}

void refined_done(struct refined *r)
{
    workspace_free(&r->space);
    *r = (struct refined) { 0 };
}

bool refined_converged(const struct refined *r)
{
    return r->end == REFINE_CONVERGED || r->end == REFINE_ROUNDING;
}

/* Columns of Y that are there. */
static double live_columns(const struct work *w)
{
    int live = 0;

    for (int g = 0; g < w->groups; g++)
        live += w->weight[g] > 0;
    return (double)live * w->phases;
}

static void report(const struct work *w, const struct search *s, double tau, struct refined *r)
{
    double own = fmax(refine_freedom(w) / w->groups, 1), total = 0, dearer;
    bool known = !s->now.degenerate, errors = known && !w->look;

    memcpy(r->first, w->first, (size_t)w->count * sizeof *r->first);
    memcpy(r->turn, w->turn, (size_t)w->count * sizeof *r->turn);
    refine_covariance(w, &s->now, live_columns(w), tau, r->covariance);
    for (int j = 0; j < w->count; j++) {
        int p = w->first[j], P = w->parameters;
        double b = w->kind[j] == POLE_PAIR ? s->at.b[j] / tau
            : w->kind[j] == POLE_NEGATIVE  ? M_PI / tau
                                           : 0;
        if (p >= 0 && errors)
            r->lambda[j] = CMPLX(s->at.a[j] / tau, b);
        r->std_re[j] = p < 0 ? 0 : errors ? sqrt(r->covariance[p + p * P]) : NAN;
        r->std_im[j] = p < 0 || w->kind[j] != POLE_PAIR || w->turn[j] == 0 ? 0
            : errors                                    ? sqrt(r->covariance[p + 1 + (p + 1) * P])
                                                        : NAN;
    }
    for (int g = 0; g < w->groups; g++) {
        r->noise[g] = known ? sqrt(s->now.rss[g] / own) : NAN;
        r->floor[g] = sqrt(w->floor2[g]);
        total += s->now.rss[g];
    }
    r->residual = known ? sqrt(total) : NAN;
    dearer = known ? refine_dearer(w, r->lambda, tau) : 0;
    r->bic = known ? refine_worth(w, s->now.rss, 1) + dearer : HUGE_VAL;
    r->start_bic += dearer;
    r->iterations = s->iterations, r->evaluations = s->evaluations;
    r->work = w->spent;
}

enum modal_status refine_check(const struct refine_data *d, const double complex *start, int count,
                               struct modal_error *err)
{
    int phases = d->phases > 0 ? d->phases : 1, order = 0;

    if (d->Y->m < 2 || d->Y->n < 1 || !(d->tau > 0) || d->Y->n % phases != 0)
        return modal_fail(err, MODAL_BAD_INPUT, "refine: %d rows, %d columns, %d phases, step %g",
                          d->Y->m, d->Y->n, phases, d->tau);
    for (int j = 0; j < count; j++) {
        if (!isfinite(creal(start[j])) || !isfinite(cimag(start[j])))
            return modal_fail(err, MODAL_BAD_INPUT, "refine: pole %d is not finite", j);
        order += pole_order(start[j], d->tau);
    }
    if (count < 1 || order > REFINE_ORDER_MOST || order >= d->Y->m)
        return modal_fail(err, MODAL_BAD_INPUT,
                          "refine: order %d; accepted: 1 to %d and below the %d rows", order,
                          REFINE_ORDER_MOST, d->Y->m);
    return MODAL_OK;
}

/* Sum of squares of the steps from row to row. */
static double swing(const double *y, int L)
{
    double sum = 0;

    for (int l = 1; l < L; l++)
        sum += (y[l] - y[l - 1]) * (y[l] - y[l - 1]);
    return sum;
}

/* Energies, and (6).  A part at angle theta steps by 2 sin(theta / 2) of its size: theta of a
 * signal is that of all its parts, by their energies, and the same whatever poles are tried. */
static void set_energy(struct work *w)
{
    double n = (double)w->L * w->phases;

    for (int c = 0; c < w->S; c++) {
        const struct compressed *b = w->data->blocks;
        const double *y = w->Y->x + (size_t)c * (size_t)w->Y->ld;
        double r = b != NULL ? sqrt(b->energy[c]) : cblas_dnrm2(w->L, y, 1);
        w->energy[c / w->phases] += r * r;
        w->floor2[c / w->phases] += b != NULL ? b->swing[c] : swing(y, w->L);
    }
    for (int g = 0; g < w->groups; g++) {
        double chord = w->energy[g] > 0 ? sqrt(w->floor2[g] / w->energy[g]) : 0,
               theta = 2 * asin(fmin(chord / 2, 1));
        double f = (4 + theta * (w->L + 2.0 * w->data->before) / 4) * DBL_EPSILON;
        w->floor2[g] = f * f * w->energy[g] / n;
        w->lowest[g] = w->data->least != NULL ? fmax(w->floor2[g],
                                                     w->data->least[g]) : w->floor2[g];
    }
}

/* Of data that were checked. */
static struct work work_of(const struct refine_data *data, int count, const bool *fixed, bool look)
{
    int phases = data->phases > 0 ? data->phases : 1;

    return (struct work) { .data = data, .Y = data->Y, .L = data->Y->m, .S = data->Y->n,
                           .count = count, .fixed = fixed, .phases = phases,
                           .groups = data->Y->n / phases, .look = look };
}

static enum modal_status no_memory(const struct work *w, struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for %d x %d, order %d", w->L, w->S,
                      w->order);
}

/* The poles, checked; room for their fit, *S at LAMBDA.  The caller frees W, on failure
 * too. */
static enum modal_status begin(struct work *w, struct search *s, const double complex *lambda,
                               struct modal_error *err)
{
    enum modal_status rc = refine_check(w->data, lambda, w->count, err);

    if (rc != MODAL_OK)
        return rc;
    if (!refine_layout(w, lambda) || !refine_allocate(w, true) || !refine_search_new(s, w))
        return no_memory(w, err);
    set_energy(w);
    for (int j = 0; j < w->count; j++) {
        double a = creal(lambda[j]) * w->data->tau;
        s->at.a[j] = w->first[j] < 0 ? a : refine_guard(w, a);
        s->at.b[j] = cimag(lambda[j]) * w->data->tau;
    }
    return MODAL_OK;
}

enum modal_status refine_poles(const struct refine_data *data, const double complex *start,
                               int count, const bool *fixed, const struct refine_options *options,
                               struct refined *out, struct modal_error *err)
{
    struct refine_options opt = options != NULL ? *options : (struct refine_options) { 0 };
    struct work w = work_of(data, count, fixed, opt.iterations < 0);
    struct search s = { 0 };
    struct refined r = { 0 };
    enum modal_status rc = begin(&w, &s, start, err);

    if (rc == MODAL_OK && !refined_new(&r, &w))
        rc = no_memory(&w, err);
    if (rc != MODAL_OK)
        goto out;
    memcpy(r.lambda, start, (size_t)count * sizeof *start);
    rc = refine_search(&w, &s, &opt, &r, &r.end, err);
    if (rc == MODAL_OK && w.phases > 1 && s.beside && !s.now.degenerate)
        rc = refine_evaluate(&w, &s.at, &s.next, err);             /* for the errors of `now` */
    if (rc != MODAL_OK)
        goto out;
    report(&w, &s, data->tau, &r);
    *out = r;
    r = (struct refined) { 0 };
out:
    refined_done(&r);
    refine_free(&w);
    return rc;
}

double refine_column_norm(const struct refine_data *data, int c)
{
    const struct compressed *b = data->blocks;
    const struct matrix *Y = data->Y;

    return b != NULL && b->Y.x == Y->x && b->Y.m == Y->m
               ? sqrt(b->energy[c]) : safe_norm(Y->x + (size_t)c * (size_t)Y->ld, Y->m);
}

double refine_norm(const struct refine_data *data)
{
    double norm = 0;

    for (int c = 0; c < data->Y->n; c++)
        norm = hypot(norm, refine_column_norm(data, c));
    return norm;
}

double refine_work(const struct refine_data *data, int order)
{
    int L = data->Y->m, S = data->Y->n;
    double columns = 2.0 * order + S;

    return gram_pays(L, order, S) ? gram_work(L, order, S) : L * columns * columns;
}

void projected_done(struct projected *p)
{
    workspace_free(&p->space);
    *p = (struct projected) { 0 };
}

static bool projected_new(struct projected *p, const struct work *w)
{
    size_t q = (size_t)w->order, groups = (size_t)w->groups;

    *p = (struct projected) { .order = w->order, .parameters = w->parameters, .columns = w->S };
    p->R = workspace_numbers(&p->space, q, q);
    p->Z = workspace_numbers(&p->space, q, (size_t)w->S);
    p->rss = workspace_numbers(&p->space, groups, 1);
    p->energy = workspace_numbers(&p->space, groups, 1);
    p->lowest = workspace_numbers(&p->space, groups, 1);
    return !p->space.failed;
}

/* What the evaluation left, into *p. */
static void projected_take(struct projected *p, const struct work *w, const struct evaluation *e)
{
    size_t bytes = (size_t)w->groups * sizeof *p->rss;

    memcpy(p->R, w->R, (size_t)w->order * (size_t)w->order * sizeof *p->R);
    memcpy(p->rss, e->rss, bytes), memcpy(p->energy, w->energy, bytes),
        memcpy(p->lowest, w->lowest, bytes);
    p->criterion = refine_criterion(w);
    p->criterion.energy = p->energy, p->criterion.floor2 = p->lowest;
    p->degenerate = e->degenerate;
    p->work = w->spent;
}

enum modal_status refine_project(const struct refine_data *data, const double complex *lambda,
                                 int count, const bool *fixed,
                                 struct projected *out, struct modal_error *err)
{
    struct work w = work_of(data, count, fixed, true);
    struct search s = { 0 };
    struct projected p = { 0 };
    enum modal_status rc = begin(&w, &s, lambda, err);

    if (rc == MODAL_OK && !projected_new(&p, &w))
        rc = no_memory(&w, err);
    if (rc != MODAL_OK)
        goto out;
    for (int g = 0; g < w.groups; g++)
        w.weight[g] = 1;
    w.all = p.Z;
    rc = refine_evaluate(&w, &s.at, &s.now, err);
    if (rc == MODAL_OK && data->blocks != NULL)
        rc = refine_hold(&w, &s.at, err);
    if (rc != MODAL_OK)
        goto out;
    projected_take(&p, &w, &s.now);
    *out = p;
    p = (struct projected) { 0 };
out:
    projected_done(&p);
    refine_free(&w);
    return rc;
}

void refined_std(const struct refined *r, int pole, double *frequency_hz,
                 double *damping_ratio)
{
    double re = creal(r->lambda[pole]), im = cimag(r->lambda[pole]), w = hypot(re, im);
    double vr = r->std_re[pole] * r->std_re[pole], vi = r->std_im[pole] * r->std_im[pole],
           cross = 0;
    int p = r->first[pole], n = r->parameters;

    if (p >= 0 && p + 1 < n && r->std_im[pole] > 0)
        cross = r->turn[pole] * r->covariance[p + (p + 1) * n];
    /* d|lambda| = (re dre + im dim) / |lambda| */
    *frequency_hz = w > 0
        ? sqrt(fmax(re * re * vr + im * im * vi + 2 * re * im * cross, 0)) / w / (2 * M_PI)
        : sqrt(vr) / (2 * M_PI);
    /* d(-re/|lambda|) = (-im^2 dre + re im dim) / |lambda|^3 */
    *damping_ratio = w > 0 ? fabs(im)
            * sqrt(fmax(im * im * vr + re * re * vi - 2 * re * im * cross, 0)) / (w * w * w)
                           : NAN;
}
