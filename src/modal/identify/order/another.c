/*
 * another.c - see another.h
 *
 * A pole that is left out because it does not pay (criterion.h) may be there: what noise gives the
 * best of all poles in one of a thousand records at most, one with as much of the signals as that
 * gains no more.  The others then make up for it, by more than their errors say.
 *
 * Of n numbers, m of them free beside the fit, a pole that gains G of -2 ln(likelihood) takes
 *
 *     m (1 - e^{-G / n})                                                                        (1)
 *
 * of the noise's variance, (3) of criterion.c: chi-squared of k (S + 1) degrees of freedom in
 * noise, for k columns and their exponent.
 *
 * It is looked for among poles that decay by RATE_FIRST over the L rows, by factors RATE_RATIO from
 * there, that last, and that grow, half a line's width apart, and the refined fit goes on from the
 * best: of what those of the fit leave of each, as they take up most of what is quickly over. (2)
 * Where rows are many, that costs rows^2, and what decays within few of them matters little: the
 * best is that of remainder_peak().  Of a constant system it always is, and a fit is worth its work
 * only where noise has not as much in each record.
 *
 * Two poles within a beat over the record are told apart by the model alone, and that there is no
 * third by its price alone: what the record says of one there is no narrower than what was known
 * before, so that no price is due.  Of three the likelihood is so flat that standard errors say
 * nothing; but whether one has to grow it says: the least -2 ln(likelihood) of those that do not is
 * held against that of all,
 *
 *     min over Re(lambda) <= 0  -  min  <=  REFINE_CLEAR^2,                                    (3)
 *
 * the square of a normal deviate where it is quadratic; nor does any have to that does not grow by
 * its own errors in the fit of all.  Of a pole that grows, two lines without
 * damping take the place, a LINES of a beat to either side: they make any a cos(dt) + b sin(dt) of
 * its amplitude, which all that grows little does; and one line that of others that grow beside it.
 * What grows in the fit of the rest is (Re / its error)^2 above one that does not.
 */
#include "modal/identify/order/another.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/powers.h"
#include "modal/identify/order/remainder.h"
#include "modal/linalg/qr.h"

static const double
    RATE_FIRST = 2,              /* (2): slower ones last */
    RATE_RATIO = 2,              /* of one between two of them the nearer shows 0.97 */
    RATE_MOST = 1.5,             /* a row: what decays faster is one row */
    OWN = 0.03,                  /* of a pole's norm: what is left of less is one of the fit's */
    LINES = 0.125;               /* (3): half a radian and more over the record: told from one */

/* Of signal g the sum of squares that FIT leaves. */
static double left_of(const struct refine_data *d, const struct refined *fit, int g)
{
    double free_numbers = (double)d->Y->n * (d->Y->m - fit->order) - fit->parameters;

    return fit->noise[g] * fit->noise[g] * fmax(free_numbers / fit->groups, 1);
}

/* Has signal g more than rounding left? */
static bool tells(const struct refined *fit, int g)
{
    return fit->noise[g] > fit->floor[g];
}

/* The chance of OUT's fit by (1), beside FIT. */
static double chance_of(const struct refine_data *d, const struct refined *fit,
                        const struct refined *more)
{
    int phases = d->phases > 0 ? d->phases : 1, k = more->order - fit->order;
    double L = d->Y->m, S = 0, gain = 0, n, m;

    for (int g = 0; g < fit->groups; g++)
        if (tells(fit, g) && tells(more, g)) {
            S += phases;
            gain += L * phases * log(left_of(d, fit, g) / left_of(d, more, g));
        }
    n = L * S, m = n - S * fit->order - fit->parameters;
    return S == 0 || m <= 0 || !(gain > 0) ? 1
         : criterion_chance(S, n, m * -expm1(-gain / n), k);
}

/* What the poles leave, and where another is looked for in it. */
struct looking {
    const struct matrix *E;     /* L x S, of unit variance, free of Q */
    double *Q; int order;       /* L x order, orthonormal: the poles' basis */
    double *v, *w;              /* L x 2; order x 2 and S x 2, whichever is more */
    double most;                /* chi-squared */
    double complex best;        /* a row */
};

/* Of the two columns of l->v, or the one of a real pole, what Q leaves, orthonormal; how many. */
static int free_of_poles(struct looking *l, int columns)
{
    int L = l->E->m, count = 0;

    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, l->order, columns, L, 1, l->Q, L, l->v, L,
                0, l->w, l->order);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, L, columns, l->order, -1, l->Q, L, l->w,
                l->order, 1, l->v, L);
    for (int c = 0; c < columns; c++) {
        double *x = l->v + (size_t)c * (size_t)L, *to = l->v + (size_t)count * (size_t)L, norm;
        if (count > 0)
            cblas_daxpy(L, -cblas_ddot(L, l->v, 1, x, 1), l->v, 1, x, 1);
        norm = cblas_dnrm2(L, x, 1);
        if (norm < OWN)
            continue;
        cblas_dscal(L, 1 / norm, x, 1);
        memmove(to, x, sizeof *x * (size_t)L);
        count++;
    }
    return count;
}

/* The pole z a row: is it better than the best? */
static void look_at(struct looking *l, double complex z)
{
    int L = l->E->m, S = l->E->n, columns = cimag(z) == 0 || cimag(z) == M_PI ? 1 : 2;
    double chi2;

    powers_of(pole_kind(z, 1), creal(z), cimag(z), L, l->v, L);
    for (int c = 0; c < columns; c++) {
        double norm = cblas_dnrm2(L, l->v + (size_t)c * (size_t)L, 1);
        cblas_dscal(L, norm > 0 ? 1 / norm : 0, l->v + (size_t)c * (size_t)L, 1);
    }
    if (free_of_poles(l, columns) < columns)
        return;
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, S, columns, L, 1, l->E->x, l->E->ld, l->v,
                L, 0, l->w, S);
    chi2 = cblas_ddot(S * columns, l->w, 1, l->w, 1) / columns;
    if (chi2 > l->most)
        l->most = chi2, l->best = z;
}

/* (2), from growth to what is over in a row. */
static void look_all_over(struct looking *l)
{
    double L = l->E->m;

    for (double rate = -RATE_FIRST / L; rate < RATE_MOST;
         rate = rate < 0 ? 0 : rate == 0 ? RATE_FIRST / L : RATE_RATIO * rate) {
        double step = fmax(fabs(rate), M_PI / L) / 2;
        int most = (int)ceil(M_PI / step);
        for (int i = 0; i <= most; i++)
            look_at(l, CMPLX(-rate, i == most ? M_PI : i * step));
    }
}

/* The basis of FIT, orthonormal. */
static enum modal_status basis_of(const struct refine_data *d, const struct refined *fit, double *Q,
                                  struct modal_error *err)
{
    int L = d->Y->m, column = 0;
    struct matrix A = { L, fit->order, L, Q };

    for (int j = 0; j < fit->poles; j++) {
        enum pole_kind kind = pole_kind(fit->lambda[j], d->tau);
        powers_of(kind, creal(fit->lambda[j]) * d->tau, cimag(fit->lambda[j]) * d->tau, L,
                  Q + (size_t)column * (size_t)L, L);
        column += kind == POLE_PAIR ? 2 : 1;
    }
    return qr_orthonormal(&A, &(struct matrix) { 0 }, err);
}

/* Is each row a sample of a system without a period? */
static bool is_constant(const struct refine_data *d)
{
    return d->phases <= 1 && d->omega == 0;
}

/* The same of a constant system; 0, too, where noise has a peak like that in each record. */
static enum modal_status find_line(const struct refine_data *d, const struct refined *fit,
                                   const struct matrix *E, double complex *peak,
                                   struct modal_error *err)
{
    double chi2, S = 0;
    enum modal_status rc = remainder_peak(E, d->tau, peak, &chi2, err);

    for (int g = 0; g < fit->groups; g++)
        S += tells(fit, g);
    if (S == 0 || criterion_chance(S, S * E->m, chi2, 2) >= 1)
        *peak = 0;
    return rc;
}

/* *peak, in 1/s, of E; 0: there is none. */
static enum modal_status find_peak(const struct refine_data *d, const struct refined *fit,
                                   const struct matrix *E, double complex *peak,
                                   struct modal_error *err)
{
    size_t L = (size_t)E->m, S = (size_t)E->n, q = (size_t)fit->order;
    struct workspace space = { 0 };
    struct looking l = { .E = E, .order = fit->order, .Q = workspace_numbers(&space, L, q),
                         .v = workspace_numbers(&space, L, 2),
                         .w = workspace_numbers(&space, S > q ? S : q, 2) };
    double looks = 2 * 3 * E->m, chi2;       /* 2 L for each of three rates, and fewer of others */
    enum modal_status rc = workspace_check(&space, "another: no memory", err);

    /* multiplications of all looks at what is left, which is a part of the question */
    if (rc == MODAL_OK && looks * 2 * L * (2 * q + S) > REFINE_WORK_ASKED / 10) {
        rc = remainder_peak(E, d->tau, peak, &chi2, err);
    } else if (rc == MODAL_OK) {
        rc = basis_of(d, fit, l.Q, err);
        if (rc == MODAL_OK)
            look_all_over(&l);
        *peak = CMPLX(creal(l.best) / d->tau, cimag(l.best) / d->tau);
    }
    workspace_free(&space);
    return rc;
}

/* LAMBDA: the poles of FIT, and PEAK. */
static enum modal_status fit_with(const struct refine_data *d, const struct refined *fit,
                                  double complex peak, struct refined *more,
                                  struct modal_error *err)
{
    size_t n = (size_t)fit->poles;
    struct refine_options opt = { .work = REFINE_WORK_ASKED };
    double complex *lambda = malloc(sizeof *lambda * (n + 1));
    bool *fixed = calloc(n + 1, sizeof *fixed);
    enum modal_status rc = MODAL_OK;

    if (lambda == NULL || fixed == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "another: no memory for %d poles", fit->poles);
    } else {
        memcpy(lambda, fit->lambda, sizeof *lambda * n);
        lambda[n] = peak;
        for (size_t j = 0; j < n; j++)
            fixed[j] = fit->first[j] < 0;
        if (fit->order + 2 < d->Y->m && fit->order + 2 <= REFINE_ORDER_MOST)
            rc = refine_poles(d, lambda, (int)n + 1, fixed, &opt, more, err);
    }
    free(lambda), free(fixed);
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

/* A pair that would be real ends nowhere: it becomes so, where it is next to that; else *more is
 * none. */
static enum modal_status fit_real(const struct refine_data *d, const struct refined *fit,
                                  struct refined *more, struct modal_error *err)
{
    double complex last = more->lambda[fit->poles];
    double turn = cimag(last) * d->tau * d->Y->m, nyquist = M_PI * d->Y->m;
    bool real = turn < M_PI || nyquist - turn < M_PI;
    enum modal_status rc = MODAL_OK;

    refined_done(more);
    if (real)
        rc = fit_with(d, fit, CMPLX(creal(last), turn < M_PI ? 0 : M_PI / d->tau), more, err);
    if (more->poles > 0 && !refined_converged(more))
        refined_done(more);
    return rc;
}

/* Where the rest of FIT shows most of another; 0: nowhere. */
static enum modal_status look(const struct refine_data *data, const struct refined *fit,
                              double complex *peak, struct modal_error *err)
{
    struct matrix E = { 0 };
    enum modal_status rc = remainder_of(data, fit, &E, err);

    *peak = 0;
    if (rc == MODAL_OK && E.x != NULL)
        rc = is_constant(data) ? find_line(data, fit, &E, peak, err)
                               : find_peak(data, fit, &E, peak, err);
    free(E.x);
    return rc;
}

enum modal_status another_shows(const struct refine_data *data, const struct refined *fit,
                                bool *shows, struct modal_error *err)
{
    double complex peak;
    enum modal_status rc = look(data, fit, &peak, err);

    *shows = rc == MODAL_OK && peak != 0;
    return rc;
}

enum modal_status another_pole(const struct refine_data *data, const struct refined *fit,
                               struct another *out, struct modal_error *err)
{
    double complex peak;
    enum modal_status rc;

    *out = (struct another) { .chance = 1 };
    rc = look(data, fit, &peak, err);
    if (rc == MODAL_OK && peak != 0)
        rc = fit_with(data, fit, peak, &out->fit, err);
    if (rc == MODAL_OK && out->fit.poles > 0 && !refined_converged(&out->fit))
        rc = fit_real(data, fit, &out->fit, err);
    if (out->fit.poles > 0)
        out->chance = chance_of(data, fit, &out->fit);
    return rc;
}

/* What -2 ln(likelihood) of FIT is above that of MORE. */
static double gain_of(const struct refine_data *d, const struct refined *fit,
                      const struct refined *more)
{
    double gain = 0;

    for (int g = 0; g < fit->groups; g++)
        if (tells(fit, g) && tells(more, g))
            gain += d->Y->m * log(left_of(d, fit, g) / left_of(d, more, g));
    return gain;
}

static bool within_a_beat(const struct refine_data *d, double complex a, double complex b)
{
    return cimag(a) != 0 && cimag(b) != 0
        && fabs(cimag(a) - cimag(b)) * d->tau * d->Y->m < 2 * M_PI;
}

/* The poles of FIT, none about pole J growing, into LAMBDA; which of them are lines, into FIXED. */
static void undamp(const struct refine_data *d, const struct refined *fit, int j,
                   double complex *lambda, bool *fixed)
{
    double part = LINES * 2 * M_PI / (d->tau * d->Y->m);

    for (int k = 0; k < fit->poles; k++) {
        bool grows = creal(fit->lambda[k]) > 0
                  && within_a_beat(d, fit->lambda[k], fit->lambda[j]);
        lambda[k] = grows ? CMPLX(0, cimag(fit->lambda[k])) : fit->lambda[k];
        fixed[k] = grows || fit->first[k] < 0;
    }
    lambda[j] = CMPLX(0, cimag(fit->lambda[j]) - part);
    lambda[fit->poles] = CMPLX(0, cimag(fit->lambda[j]) + part);
    fixed[fit->poles] = true;
}

/* The left side of (3), of FIT's own poles, of STEADY, where none grows, and of FREE. */
static double cost_of(const struct refine_data *d, const struct refined *fit, int j,
                      const struct refined *steady, const struct refined *freed)
{
    double cost = fmax(gain_of(d, steady, fit),
                       freed->poles > 0 ? gain_of(d, steady, freed) : 0);

    for (int k = 0; k < steady->poles; k++)
        if (creal(steady->lambda[k]) > 0 && within_a_beat(d, steady->lambda[k], fit->lambda[j]))
            cost += pow(creal(steady->lambda[k]) / steady->std_re[k], 2);
    return cost;
}

/* Does a pole within a beat of LAMBDA grow by its own errors? */
static bool grows_about(const struct refine_data *d, const struct refined *freed,
                        double complex lambda)
{
    bool grows = !refined_converged(freed);

    for (int k = 0; k < freed->poles; k++)
        grows |= within_a_beat(d, freed->lambda[k], lambda)
              && creal(freed->lambda[k]) > REFINE_CLEAR * freed->std_re[k];
    return grows;
}

enum modal_status another_decays(const struct refine_data *data, const struct refined *fit, int j,
                                 bool *decays, struct modal_error *err)
{
    size_t n = (size_t)fit->poles + 1;
    struct refine_options opt = { .work = REFINE_WORK_ASKED };
    double complex *lambda = malloc(sizeof *lambda * n);
    bool *fixed = calloc(n, sizeof *fixed), crowd = false;
    struct refined steady = { 0 }, freed = { 0 };
    enum modal_status rc = MODAL_OK;

    *decays = false;
    for (int k = 0; k < fit->poles; k++)
        crowd |= k != j && within_a_beat(data, fit->lambda[k], fit->lambda[j]);
    if (lambda == NULL || fixed == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "another: no memory for %d poles", fit->poles);
    else if (crowd && fit->order + 2 < data->Y->m && fit->order + 2 <= REFINE_ORDER_MOST) {
        undamp(data, fit, j, lambda, fixed);
        rc = refine_poles(data, lambda, (int)n, fixed, &opt, &steady, err);
    }
    if (rc == MODAL_OK && refined_converged(&steady) && steady.poles > 0) {
        for (size_t k = 0; k < n; k++)
            fixed[k] = k + 1 < n && fit->first[k] < 0;
        rc = refine_poles(data, steady.lambda, (int)n, fixed, &opt, &freed, err);
        *decays = rc == MODAL_OK
               && (!grows_about(data, &freed, fit->lambda[j])
                   || cost_of(data, fit, j, &steady, &freed) <= REFINE_CLEAR * REFINE_CLEAR);
    }
    refined_done(&steady), refined_done(&freed);
    free(lambda), free(fixed);
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}
