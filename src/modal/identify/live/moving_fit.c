/*
 * moving_fit.c - variable projection on compressed rows
 *
 * The model, the weights, the criterion and the minimum are those of refine.c; equation numbers
 * without a letter are that file's.  Only the rows differ.  With Q^T Q = 1 and a basis [Phi D]
 * whose columns lie in the span of blockdiag(Q) within each block,
 *
 *     |y - Phi c|^2 = |Q^T y - Q^T Phi c|^2 + |y - Q Q^T y|^2,                                  (a)
 *
 * the last term free of the unknowns: the least-squares problem on blocks x k rows is that on
 * blocks x length rows.
 *
 * From a start that is near, undamped steps reach the minimum; each weighs the signals anew by the
 * residuals it found.  All but the first are shorter than what the span of the columns and their
 * first moments holds: with Z_i = (t - c)^i e^{lambda_0 t} and d = lambda - lambda_0,
 *
 *     e^{lambda t} = e^{d c} (Z_0 + d Z_1 + d^2 Z_2 / 2),
 *     (t - c) e^{lambda t} = e^{d c} (Z_1 + d Z_2),                                             (b)
 *
 * to x^3 / 6 and x^2 / 2, x = |d (t - c)|, so that after one factorisation of [Z_0 Z_1 Z_2 X]
 * further evaluations factor 3 q rows.  A derivative off by x^2 / 2 moves the minimum by that part
 * of a standard error.  Past x = SPAN the rows are factored anew.
 *
 * Leaving a pole j out raises the sum of squares of signal g by c^T (V V^T)^{-1} c, V being pole
 * j's rows of R11^{-1} and c its coefficients, exactly (before the others are refined again).  A
 * pole that becomes two neighbours spans, to first order, e^{lambda t} and t e^{lambda t}: what
 * that could gain is the part of y in the pole's columns of D, already in the factor.
 */
#include "modal/identify/live/moving_fit.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/linear/exponents.h"
#include "modal/linalg/qr.h"
#include "modal/numbers.h"

/* a gradient in standard errors: good enough where rounding allows no less than REFINE_SETTLED */
static const double NEAR = 1e-6;
static const double STEP_MOST = 30;                /* a longer first step: the start was not near */
static const double SPAN = 4e-5;                   /* x: x^2 / 2 is then 1e-9 of a standard error */
enum { STEPS = 14 };                     /* a fit that has not settled then is none */

/* ---- one evaluation ---- */

struct work {
    const struct moving_rows *rows;
    const struct moving_signals *y;
    int m, L, r, q, P;           /* rows, samples, signals, order, parameters */
    int moments, count;          /* moments: of the columns in A */
    enum pole_kind *kind;
    int *column, *first;
    double *scratch, *spare;   /* spare: columns for the imaginary parts that a real pole has not */
    double complex *base;        /* lambda_0 of (b); its references and centres */
    double *reference, *centre;
    double *A;                   /* m x (moments q + r): [Z_0 Z_1 .. X], reflected */
    double *B;                   /* depth x (2q + r): [Phi D X] in the span of Z, reflected */
    const double *T, *X;         /* the present triangle, its signals: in A or B */
    int ld, depth;               /* of T and X; rows of X above `below` */
    double *below;               /* r: sums of squares below them */
    double *C, *V;               /* q x r; q x q: inverse of R11 */
    double *stack, *J, *tau, *delta;
    double *weight, *energy, *rss, *floor2;
    double F, gradient, spent;
    bool look;
    struct workspace space;      /* of all these arrays */
};

static bool layout(struct work *w, const double complex *lambda)
{
    w->kind = workspace_room(&w->space, (size_t)w->count, sizeof *w->kind);
    w->column = workspace_room(&w->space, (size_t)w->count, sizeof *w->column);
    w->first = workspace_room(&w->space, (size_t)w->count, sizeof *w->first);
    if (w->space.failed)
        return false;
    for (int j = 0; j < w->count; j++) {
        w->kind[j] = pole_kind(lambda[j], w->rows->tau);
        w->column[j] = w->q;
        w->first[j] = lambda[j] == 0 ? -1 : w->P;
        w->q += w->kind[j] == POLE_PAIR ? 2 : 1;
        w->P += lambda[j] == 0 ? 0 : w->kind[j] == POLE_PAIR ? 2 : 1;
    }
    return true;
}

static bool allocate(struct work *w)
{
    size_t m = (size_t)w->m, q = (size_t)w->q, r = (size_t)w->r, P = (size_t)w->P + 1,
           most = w->look ? 1 : MOVING_MOMENTS, count = (size_t)w->count;
    const struct { double **x; size_t count; } filled[] = {
        { &w->scratch, moving_columns_scratch(w->rows) }, { &w->spare, most * m },
        { &w->A, m * (most * q + r) }, { &w->B, most * q * (2 * q + r) },
    }, zeros[] = {
        { &w->reference, count }, { &w->centre, count }, { &w->below, r }, { &w->C, q * r },
        { &w->V, q * q }, { &w->stack, (q * r + P) * P }, { &w->J, P * P },
        { &w->tau, (2 * q + r) * most }, { &w->delta, P }, { &w->weight, r }, { &w->energy, r },
        { &w->rss, r }, { &w->floor2, r },
    };

    w->base = workspace_room(&w->space, count, sizeof *w->base);
    for (size_t i = 0; i < sizeof filled / sizeof *filled; i++)
        *filled[i].x = workspace_room(&w->space, filled[i].count, sizeof(double));
    for (size_t i = 0; i < sizeof zeros / sizeof *zeros; i++)
        *zeros[i].x = workspace_zeros(&w->space, zeros[i].count, sizeof(double));
    return !w->space.failed;
}

static double freedom(const struct work *w)
{
    return (double)w->r * (w->L - w->q) - w->P;
}

static bool signal_at_rounding(const struct work *w, int g)
{
    return w->rss[g] <= w->L * w->floor2[g];
}

/* s^2 of (5), as refine.c: signals at rounding say nothing of the noise of others. */
static double variance(const struct work *w)
{
    double rounding = 0;
    int noisy = 0;

    for (int g = 0; g < w->r; g++) {
        noisy += !signal_at_rounding(w, g);
        rounding += signal_at_rounding(w, g) ? w->weight[g] * w->weight[g] * w->rss[g] : 0;
    }
    if (noisy == 0 || noisy == w->r)
        return fmax(w->F / fmax(freedom(w), 1), DBL_MIN);
    return fmax((w->F - rounding) / fmax(freedom(w) * noisy / w->r, 1), DBL_MIN);
}

/* (6) */
static void set_floor(struct work *w, const double complex *lambda)
{
    double most = 0;

    for (int j = 0; j < w->count; j++)
        most = fmax(most,           /* the fastest phase, or decay, a row */
                    (w->kind[j] == POLE_PAIR ? cimag(lambda[j]) : fabs(creal(lambda[j])))
                        * w->rows->tau);
    for (int g = 0; g < w->r; g++) {
        double x = cblas_dnrm2(w->m, w->y->X.x + (size_t)g * (size_t)w->y->X.ld, 1),
               f = (4 + most * w->L / 4) * DBL_EPSILON;
        w->energy[g] = x * x + w->y->outside2[g];
        w->floor2[g] = f * f * w->energy[g] / w->L;
    }
}

/* The weights of refine.c. */
static void set_weights(struct work *w)
{
    double own = freedom(w) / w->r, pooled = 0, live = 0;

    w->F = 0;
    for (int g = 0; g < w->r; g++) {
        pooled += fmax(w->rss[g], w->L * w->floor2[g]);
        live += w->energy[g] > 0;
    }
    for (int g = 0; g < w->r; g++) {
        double rest = own < REFINE_FREEDOM_LEAST ? pooled / fmax(live, 1)
                                                  : fmax(w->rss[g], w->L * w->floor2[g]);
        w->weight[g] = w->energy[g] > 0 ? 1 / sqrt(fmax(rest / fmax(own, 1), DBL_MIN)) : 0;
        w->F += w->weight[g] * w->weight[g] * w->rss[g];
    }
}

/* Whether Phi has full rank, by its triangle. */
static bool regular(const struct work *w)
{
    for (int j = 0; j < w->q; j++)
        if (qr_dependent(w->T + j * w->ld, j))
            return false;
    return true;
}

/* [Z_0 .. X] at LAMBDA, reflected; where MOMENTS are more than one the first 2q columns are Phi and
 * D at LAMBDA. */
static void factor(struct work *w, const double complex *lambda, int moments)
{
    int depth = moments * w->q;
    size_t m = (size_t)w->m;
    struct matrix A = { w->m, depth + w->r, w->m, w->A };

    for (int j = 0; j < w->count; j++) {
        struct moving_column c;
        for (int i = 0; i < moments; i++) {
            c.re[i] = w->A + (size_t)(i * w->q + w->column[j]) * m;
            c.im[i] = w->kind[j] == POLE_PAIR ? c.re[i] + m : w->spare + (size_t)i * m;
        }
        moving_columns(w->rows, lambda[j], moments, &c, w->scratch);
        w->base[j] = lambda[j], w->reference[j] = c.reference, w->centre[j] = c.centre;
    }
    for (int g = 0; g < w->r; g++)
        memcpy(w->A + (size_t)(depth + g) * m, w->y->X.x + (size_t)g * (size_t)w->y->X.ld,
               sizeof(double) * m);
    qr_reflect(&A, depth, w->tau);
    w->spent += (double)w->m * (depth + w->r) * (depth + w->r);
    w->moments = moments, w->T = w->A, w->X = w->A + (size_t)depth * m, w->ld = w->m,
    w->depth = depth;
    for (int g = 0; g < w->r; g++) {
        const double *x = w->X + (size_t)g * m + depth;
        /* what neither the moments nor Q hold: the same at every lambda in their span */
        w->below[g] = w->y->outside2[g] + cblas_ddot(w->m - depth, x, 1, x, 1);
    }
}

/* sum_i k_i Z_{from + i} of pole j, by (b), into column `to` of B; Z_i stands as (Re, -Im). */
static void combine(struct work *w, int j, const double complex *k, int terms, int from, int to)
{
    bool pair = w->kind[j] == POLE_PAIR;
    double *re = w->B + (size_t)to * (size_t)w->depth, *im = pair ? re + w->depth : w->spare;

    memset(re, 0, sizeof *re * (size_t)w->depth), memset(im, 0, sizeof *im * (size_t)w->depth);
    for (int i = 0; i < terms; i++) {
        int at = (from + i) * w->q + w->column[j], rows = at + (pair ? 2 : 1);
        const double *x = w->A + (size_t)at * (size_t)w->m, *y = x + w->m;
        cblas_daxpy(rows, creal(k[i]), x, 1, re, 1);
        if (!pair)
            continue;
        cblas_daxpy(rows, cimag(k[i]), y, 1, re, 1);
        cblas_daxpy(rows, creal(k[i]), y, 1, im, 1);
        cblas_daxpy(rows, -cimag(k[i]), x, 1, im, 1);
    }
}

/* [Phi D X] at LAMBDA from the triangle of Z, reflected. */
static void factor_near(struct work *w, const double complex *lambda)
{
    int q = w->q, depth = w->depth;
    struct matrix B = { depth, 2 * q + w->r, depth, w->B };

    for (int j = 0; j < w->count; j++) {
        double complex d = (lambda[j] - w->base[j]) * w->rows->tau,
                       scale = cexp(d * w->centre[j]
                                    - (moving_reference(w->rows, lambda[j]) - w->reference[j])),
                       /* e^{dc} times the series of e^{d(t - c)}; the columns' own sizes apart */
                       k[3] = { scale, scale * d, 0.5 * scale * d * d };
        combine(w, j, k, 3, 0, w->column[j]);
        combine(w, j, k, 2, 1, q + w->column[j]);  /* D about the centre: (t - c) e^{lambda t} */
    }
    for (int g = 0; g < w->r; g++)
        memcpy(w->B + (size_t)(2 * q + g) * (size_t)depth,
               w->A + (size_t)(depth + g) * (size_t)w->m, sizeof(double) * (size_t)depth);
    qr_reflect(&B, 2 * q, w->tau);
    w->spent += (double)depth * B.n * B.n;
    w->T = w->B, w->X = w->B + (size_t)(2 * q) * (size_t)depth, w->ld = depth;
}

/* Does (b) reach from the base to LAMBDA? */
static bool in_span(const struct work *w, const double complex *lambda)
{
    for (int j = 0; j < w->count && w->moments == MOVING_MOMENTS; j++)
        /* x at the row that is farthest from the centre */
        if (!(cabs(lambda[j] - w->base[j]) * w->rows->tau
                  * fmax(w->centre[j], w->L - 1 - w->centre[j])
              <= SPAN))
            return false;
    return w->moments == MOVING_MOMENTS;
}

/* Coefficients and sums of squares. */
static void solve(struct work *w)
{
    int q = w->q;

    for (int g = 0; g < w->r; g++) {
        const double *x = w->X + (size_t)g * (size_t)w->ld;
        memcpy(w->C + (size_t)g * (size_t)q, x, sizeof(double) * (size_t)q);
        w->rss[g] = cblas_ddot(w->depth - q, x + q, 1, x + q, 1) + w->below[g];  /* (a) */
    }
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, q, w->r, 1, w->T,
                w->ld, w->C, q);
}

/* The rows of (4) of signal g. */
static void signal_rows(struct work *w, int g)
{
    int q = w->q, n = w->ld, ld = q * w->r + w->P + 1;
    const double *R22 = w->T + q + (size_t)q * (size_t)n, *c = w->C + (size_t)g * (size_t)q,
                 *z = w->X + q + (size_t)g * (size_t)n;

    for (int j = 0; j < w->count; j++) {
        int i = w->column[j];
        const double *d1 = R22 + (size_t)i * (size_t)n, *d2 = d1 + n;
        double *x = w->stack + g * q + (size_t)(w->first[j] < 0 ? 0 : w->first[j]) * (size_t)ld,
               a = w->weight[g];
        for (int l = 0; w->first[j] >= 0 && l < q; l++) {
            /* (3) */
            x[l] =
                w->kind[j] == POLE_PAIR ? a * (c[i] * d1[l] + c[i + 1] * d2[l]) : a * c[i] * d1[l];
            if (w->kind[j] == POLE_PAIR)
                x[l + ld] = a * (c[i] * d2[l] - c[i + 1] * d1[l]);
        }
    }
    for (int l = 0; l < q; l++)
        w->stack[g * q + l + (size_t)w->P * (size_t)ld] = w->weight[g] * z[l];
}

/* R_J and g; the gradient in standard errors. */
static void linearise(struct work *w)
{
    int P = w->P + 1, ld = w->q * w->r + P;
    struct matrix A = { ld, P, ld, w->stack };

    memset(w->stack, 0, sizeof(double) * (size_t)ld * (size_t)P);
    for (int g = 0; g < w->r; g++)
        signal_rows(w, g);
    qr_reflect(&A, w->P, w->tau);
    matrix_copy(P, P, w->stack, ld, w->J, P);
    w->gradient = cblas_dnrm2(w->P, w->J + (size_t)w->P * (size_t)P, 1) / sqrt(variance(w));
}

/* False where Phi is singular. */
static bool evaluate(struct work *w, const double complex *lambda, int moments)
{
    if (in_span(w, lambda))
        factor_near(w, lambda);
    else
        factor(w, lambda, w->m < moments * w->q ? 2 : moments);
    if (!regular(w))
        return false;
    solve(w);
    set_weights(w);
    if (!w->look && w->P > 0)
        linearise(w);
    return true;
}

/* ---- steps ---- */

static bool newton(struct work *w)
{
    int P = w->P + 1;

    for (int i = 0; i < w->P; i++)
        if (!(fabs(w->J[i + i * P]) > DBL_MIN))  /* a parameter that no signal feels */
            return false;
    memcpy(w->delta, w->J + (size_t)w->P * (size_t)P, sizeof(double) * (size_t)w->P);
    cblas_dtrsv(CblasColMajor, CblasUpper, CblasNoTrans, CblasNonUnit, w->P, w->J, P, w->delta, 1);
    for (int i = 0; i < w->P; i++)
        if (!isfinite(w->delta[i]) || fabs(w->delta[i]) * w->L > REFINE_TURN_MOST / 2)
            return false;
    return true;
}

/* False where a pair would leave the open half plane. */
static bool take_step(const struct work *w, double complex *lambda)
{
    double tau = w->rows->tau;

    for (int j = 0; j < w->count; j++) {
        int p = w->first[j];
        double im = cimag(lambda[j]);
        if (p < 0)
            continue;
        if (w->kind[j] == POLE_PAIR)
            im += w->delta[p + 1] / tau;
        /* rad a row: a pair that turns less is none */
        if (w->kind[j] == POLE_PAIR && !(im * tau > REFINE_EXACT && im * tau < M_PI))
            return false;
        lambda[j] = CMPLX(creal(lambda[j]) + w->delta[p] / tau, im);
    }
    return true;
}

static bool is_last(const struct work *w, const double complex *lambda)
{
    double tau = w->rows->tau;

    for (int j = 0; j < w->count; j++) {
        int p = w->first[j];
        if (p >= 0 && fabs(w->delta[p]) > REFINE_SETTLED * fabs(creal(lambda[j])) * tau)
            return false;
        if (p >= 0 && w->kind[j] == POLE_PAIR
            && fabs(w->delta[p + 1]) > REFINE_SETTLED * cimag(lambda[j]) * tau)
            return false;
    }
    return true;
}

/* rad over the window, or e-folds */
static double longest_turn(const struct work *w)
{
    return w->L * numbers_largest(w->delta, (size_t)w->P);
}

static bool at_rounding(const struct work *w)
{
    for (int g = 0; g < w->r; g++)
        if (!signal_at_rounding(w, g))
            return false;
    return true;
}

/* The coefficients are those of the last evaluation, a last step before lambda at most. */
static void descend(struct work *w, struct moving_fit *f)
{
    double before = HUGE_VAL, now = HUGE_VAL;

    for (int i = 0; i < STEPS; i++) {
        if (!evaluate(w, f->lambda, i == 0 ? 2 : MOVING_MOMENTS) || !isfinite(w->gradient)
            || (i == 0 && w->gradient > STEP_MOST && !at_rounding(w)))
            return;
        f->settled = w->gradient <= REFINE_SETTLED
            || (w->gradient >= before && (w->gradient <= NEAR || at_rounding(w)));
        if (f->settled || w->gradient >= before || i == STEPS - 1 || !newton(w))
            return;
        /* quadratic near the end: what follows a step of 1e-10 is rounding.  So is half of a turn
         * of REFINE_TIED, by which coefficients of before a step are off, with as much gradient in
         * standard errors: each step leaves of it the same part, for the columns' change with the
         * residual is left out of (4) */
        f->settled = is_last(w, f->lambda)
            || (longest_turn(w) <= REFINE_TIED && w->gradient * (w->gradient / now) <= REFINE_TIED);
        if (!take_step(w, f->lambda) || f->settled)
            return;
        before = i > 0 ? now : HUGE_VAL, now = w->gradient;
    }
}

/* ---- what the fit says ---- */

/* (5), its diagonal. */
static void errors(struct work *w, struct moving_fit *f)
{
    int P = w->P + 1;
    double s = sqrt(variance(w)) / w->rows->tau;
    bool good = LAPACKE_dtrtri_work(LAPACK_COL_MAJOR, 'U', 'N', w->P, w->J, P) == 0;

    for (int j = 0; j < w->count; j++)
        for (int i = 0; i < 2; i++) {
            int p = w->first[j] + i;
            double *to = i == 0 ? &f->std_re[j] : &f->std_im[j];
            /* a row of R_J^{-1}, which is what (5) has on its diagonal */
            *to = w->first[j] < 0 || (i == 1 && w->kind[j] != POLE_PAIR) ? 0
                : !good ? NAN
                        : s * cblas_dnrm2(w->P - p, w->J + p + (size_t)p * (size_t)P, P);
        }
}

/* What signal g's sum of squares gains by pole j: c^T (V V^T)^{-1} c. */
static double share_of(const struct work *w, int j, int g)
{
    int q = w->q, i = w->column[j];
    const double *c = w->C + i + (size_t)g * (size_t)q;
    double a = cblas_ddot(q, w->V + i, q, w->V + i, q), b, d, e;

    if (w->kind[j] != POLE_PAIR)
        return c[0] * c[0] / a;
    b = cblas_ddot(q, w->V + i, q, w->V + i + 1, q),
    d = cblas_ddot(q, w->V + i + 1, q, w->V + i + 1, q);
    e = a * d - b * b;
    /* the 2 x 2 inverse written out */
    return (c[0] * c[0] * d - 2 * c[0] * c[1] * b + c[1] * c[1] * a) / e;
}

static double squared(double x)
{
    return x * x;
}

/* -2 ln(likelihood) of sum of squares FROM over that of TO, signal g, both floored as in (7). */
static double gain(const struct work *w, int g, double from, double to)
{
    double least = w->L * fmax(w->floor2[g], DBL_MIN);

    return w->energy[g] > 0 ? w->L * log(fmax(from, least) / fmax(to, least)) : 0;
}

/* Twice what the linear model promises. */
static double could_gain(const struct work *w)
{
    int P = w->P + 1;
    double g = cblas_dnrm2(w->P, w->J + (size_t)w->P * (size_t)P, 1), left = 1 - 2 * g * g / w->F,
           sum = 0;

    for (int i = 0; i < w->r; i++)
        sum += gain(w, i, w->rss[i], left > 0 ? left * w->rss[i] : 0);
    return left > 0 ? sum : HUGE_VAL;  /* the model promises more than there is: it says nothing */
}

/* What -2 ln(likelihood) would fall by, to first order, if pole j, which is fixed, were free: one
 * number moves c_g t e^{lambda t} in all signals. */
static double gain_if_free(const struct work *w, int j)
{
    int i = w->q + w->column[j];
    double d = w->T[i + (size_t)i * (size_t)w->ld], num = 0, den = 0;

    for (int g = 0; g < w->r; g++) {
        double x = w->weight[g] * w->C[w->column[j] + (size_t)g * (size_t)w->q] * d;
        num += x * w->weight[g] * w->X[i + (size_t)g * (size_t)w->ld], den += x * x;
    }
    return den > 0 ? num * num / den : 0;  /* a least-squares problem of one unknown */
}

static void weigh_poles(struct work *w, struct moving_fit *f)
{
    int q = w->q, live = 0;
    double ln_n;

    for (int g = 0; g < w->r; g++)
        live += w->energy[g] > 0;
    ln_n = log(fmax((double)w->L * live, 2));
    f->price = criterion_scarcity((double)live * q + w->P, (double)w->L * live) * ln_n;
    f->pair_price = f->price * 2 * (live + 1 + 1 / fmax(live, 1));
    f->least_drop = HUGE_VAL;
    matrix_copy(q, q, w->T, w->ld, w->V, q);
    if (LAPACKE_dtrtri_work(LAPACK_COL_MAJOR, 'U', 'N', q, w->V, q) != 0)
        f->settled = false;
    for (int j = 0; j < w->count; j++) {
        int i = w->column[j], n = w->kind[j] == POLE_PAIR ? 2 : 1;
        double drop = -0.5 * n * f->pair_price, split = 0;
        for (int g = 0; g < w->r; g++) {
            const double *z = w->X + q + i + (size_t)g * (size_t)w->ld;
            drop += gain(w, g, w->rss[g] + share_of(w, j, g), w->rss[g]);
            split += gain(w, g, w->rss[g], w->rss[g] - squared(z[0]) - (n > 1 ? squared(z[1]) : 0));
        }
        f->least_drop = fmin(f->least_drop, drop);
        if (w->first[j] < 0)
            f->most_free = fmax(f->most_free, gain_if_free(w, j));
        else
            f->most_split = fmax(f->most_split, split);
    }
}

/* ---- */

static bool fit_new(struct moving_fit *f, const struct work *w)
{
    size_t count = (size_t)w->count, r = (size_t)w->r;

    *f = (struct moving_fit) { .poles = w->count, .order = w->q, .signals = w->r,
                               .parameters = w->P };
    f->lambda = workspace_zeros(&f->space, count, sizeof *f->lambda);
    f->std_re = workspace_numbers(&f->space, count, 1);
    f->std_im = workspace_numbers(&f->space, count, 1);
    f->C = workspace_numbers(&f->space, (size_t)w->q, r);
    f->rss = workspace_numbers(&f->space, r, 1);
    f->floor2 = workspace_numbers(&f->space, r, 1);
    f->energy = workspace_numbers(&f->space, r, 1);
    return !f->space.failed;
}

void moving_fit_done(struct moving_fit *f)
{
    workspace_free(&f->space);
    *f = (struct moving_fit) { 0 };
}

enum what { FIT, LOOK, PROBE };

static void report(struct work *w, enum what what, struct moving_fit *f)
{
    size_t r = (size_t)w->r;

    memcpy(f->C, w->C, sizeof(double) * (size_t)w->q * r);
    memcpy(f->rss, w->rss, sizeof(double) * r);
    memcpy(f->floor2, w->floor2, sizeof(double) * r);
    memcpy(f->energy, w->energy, sizeof(double) * r);
    f->work = w->spent;
    if (what == LOOK)
        return;
    if (what == PROBE)
        f->could_gain = could_gain(w);
    else
        weigh_poles(w, f);
    errors(w, f);
}

static enum modal_status run(const struct moving_rows *rows, const struct moving_signals *signals,
                             const double complex *start, int count, enum what what,
                             struct moving_fit *out, struct modal_error *err)
{
    struct work w = { .rows = rows,
                      .y = signals,
                      .m = signals->X.m,
                      .L = moving_rows_samples(rows),
                      .r = signals->X.n,
                      .count = count,
                      .look = what == LOOK };
    struct moving_fit f = { 0 };
    enum modal_status rc = MODAL_OK;

    if (count < 1 || !layout(&w, start) || w.m != moving_rows_count(rows) || w.m < 2 * w.q + w.r) {
        rc = modal_fail(err, MODAL_BAD_INPUT, "moving_fit: %d rows for %d poles and %d signals",
                        w.m, count, w.r);
        goto out;
    }
    if (!allocate(&w) || !fit_new(&f, &w)) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving_fit: no memory for %d x %d", w.m,
                        2 * w.q + w.r);
        goto out;
    }
    memcpy(f.lambda, start, sizeof *start * (size_t)count);
    set_floor(&w, start);
    if (what != FIT)
        f.settled = evaluate(&w, f.lambda, what == LOOK ? 1 : 2);
    else
        descend(&w, &f);
    report(&w, what, &f);
    *out = f;
    f = (struct moving_fit) { 0 };
out:
    moving_fit_done(&f);
    workspace_free(&w.space);
    return rc;
}

enum modal_status moving_fit(const struct moving_rows *rows, const struct moving_signals *signals,
                             const double complex *start, int count, struct moving_fit *out,
                             struct modal_error *err)
{
    return run(rows, signals, start, count, FIT, out, err);
}

enum modal_status moving_look(const struct moving_rows *rows, const struct moving_signals *signals,
                              const double complex *lambda, int count, struct moving_fit *out,
                              struct modal_error *err)
{
    return run(rows, signals, lambda, count, LOOK, out, err);
}

enum modal_status moving_probe(const struct moving_rows *rows, const struct moving_signals *signals,
                               const double complex *lambda, int count, struct moving_fit *out,
                               struct modal_error *err)
{
    return run(rows, signals, lambda, count, PROBE, out, err);
}
