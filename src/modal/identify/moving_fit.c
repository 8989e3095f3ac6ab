/*
 * moving_fit.c - variable projection on compressed rows
 *
 * The model, the weights, the criterion and the minimum are those of refine.c; equation numbers without a letter are that file's.  Only the rows differ.  With
 * Q^T Q = 1 and a basis [Phi D] whose columns lie in the span of blockdiag(Q) within each block,
 *
 *     |y - Phi c|^2 = |Q^T y - Q^T Phi c|^2 + |y - Q Q^T y|^2,                                              (a)
 *
 * the last term free of the unknowns: the least-squares problem on blocks x k rows is that on blocks x length rows.  A block's columns are the first block's times a
 * power of z, so that one product with Q serves all blocks.
 *
 * From a start that is near, undamped steps reach the minimum; each weighs the signals anew by the residuals it found.
 *
 * Leaving a pole j out raises the sum of squares of signal g by c^T (V V^T)^{-1} c, V being pole j's rows of R11^{-1} and c its coefficients, exactly
 * (before the others are refined again).  A pole that becomes two neighbours spans, to first order, e^{lambda t} and t e^{lambda t}: what that could
 * gain is the part of y in the pole's columns of D, already in the factor.
 */
#include "modal/identify/moving_fit.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/exponents.h"
#include "modal/linalg/qr.h"

static const double SETTLED = 1e-10, NEAR = 1e-6;    /* gradients in standard errors: wanted; good enough where rounding allows no less */
static const double SCARCE_MOST = 0.95;             /* as refine.c */
static const double CLOSE = 1e-10;                  /* a step that is this part of every real and imaginary part is the last */
static const double STEP_MOST = 30;                 /* a longer first step: the start was not near */
enum { POWERS = 16, PIECE = 256 };                  /* PIECE: a multiple of POWERS */
enum { STEPS = 14, FREEDOM_LEAST = 30 };            /* FREEDOM_LEAST: as refine.c */

int moving_rows_count(const struct moving_rows *r)
{
    return r->lead + r->blocks * r->k + r->trail;
}

int moving_rows_samples(const struct moving_rows *r)
{
    return r->lead + r->blocks * r->length + r->trail;
}

/* ---- columns ---- */

struct column { double a, b, reference, centre; double *re, *im, *d_re, *d_im; double complex table[POWERS]; /* z^0 .. */ };

static void put(const struct column *c, int row, double complex v, double complex d)
{
    c->re[row] = creal(v), c->im[row] = -cimag(v);
    if (c->d_re != NULL)
        c->d_re[row] = creal(d), c->d_im[row] = -cimag(d);
}

/* z^l over the reference, l the sample's number in the window. */
static double complex power(const struct column *c, double l)
{
    double high = c->b * l, low = fma(c->b, l, -high), e = exp(c->a * l - c->reference);

    return e * CMPLX(cos(high) - low * sin(high), sin(high) + low * cos(high));
}

static void fill_table(struct column *c)
{
    struct column own = { .a = c->a, .b = c->b };

    for (int i = 0; i < POWERS; i++)
        c->table[i] = power(&own, i);
}

/* z^l over the reference for l = first .. first + count - 1: every POWERS-th exactly, times the table. */
static void powers(const struct column *c, double first, int count, double complex *z)
{
    for (int at = 0; at < count; at += POWERS) {
        double complex head = power(c, first + at);
        double x = creal(head), y = cimag(head);
        for (int i = 0; i < POWERS && at + i < count; i++)
            z[at + i] = CMPLX(x * creal(c->table[i]) - y * cimag(c->table[i]), x * cimag(c->table[i]) + y * creal(c->table[i]));
    }
}

static void put_samples(const struct column *c, int row, int first, int count)
{
    double complex z[PIECE];

    for (int at = 0; at < count; at += PIECE) {
        int n = count - at < PIECE ? count - at : PIECE;
        powers(c, first + at, n, z);
        for (int i = 0; i < n; i++)
            put(c, row + at + i, z[i], (first + at + i - c->centre) * z[i]);
    }
}

/* Q^T of z^l and l z^l, l = 0 .. length - 1, into E[0..k) and E[k..2k). */
static void project_powers(const struct moving_rows *r, const struct column *c, double complex *E)
{
    struct column own = *c;
    int n = r->length, k = r->k;
    double complex *z = E + 2 * k;                               /* n */
    double *x = (double *)(z + n), *p = x + 4 * n;               /* n x 4, then k x 4 */

    own.reference = 0;
    powers(&own, 0, n, z);
    for (int l = 0; l < n; l++)
        x[l] = creal(z[l]), x[l + n] = cimag(z[l]), x[l + 2 * n] = l * creal(z[l]), x[l + 3 * n] = l * cimag(z[l]);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, k, 4, n, 1, r->Q, n, x, n, 0, p, k);
    for (int i = 0; i < k; i++)
        E[i] = CMPLX(p[i], p[i + k]), E[i + k] = CMPLX(p[i + 2 * k], p[i + 3 * k]);
}

static void put_blocks(const struct moving_rows *r, const struct column *c, double complex *E)
{
    int k = r->k;

    project_powers(r, c, E);
    for (int j = 0; j < r->blocks; j++) {
        int at = r->lead + j * r->length;
        double complex z = power(c, at);
        for (int i = 0; i < k; i++)
            put(c, r->lead + j * k + i, z * E[i], z * (E[i + k] + (at - c->centre) * E[i]));
    }
}

static size_t scratch_of(const struct moving_rows *r)            /* complex numbers that put_blocks needs */
{
    return (size_t)(2 * r->k + 3 * r->length + 2 * r->k + 1);
}

static double fill_column(const struct moving_rows *r, double complex lambda, struct column *c, double complex *E)
{
    int L = moving_rows_samples(r);

    c->a = creal(lambda) * r->tau, c->b = cimag(lambda) * r->tau;
    c->reference = c->a > 0 ? c->a * (L - 1) : 0;
    c->centre = c->a == 0 ? 0.5 * (L - 1) : c->a > 0 ? L - 1 - fmin(0.5 * L, 1 / c->a) : fmin(0.5 * L, -1 / c->a);
    fill_table(c);
    put_samples(c, 0, 0, r->lead);
    if (r->blocks > 0)
        put_blocks(r, c, E);
    put_samples(c, r->lead + r->blocks * r->k, L - r->trail, r->trail);
    return c->reference;
}

double moving_column(const struct moving_rows *r, double complex lambda, double *re, double *im, double *d_re, double *d_im)
{
    struct column c = { .re = re, .im = im, .d_re = d_re, .d_im = d_im };
    double complex *E = malloc(sizeof *E * scratch_of(r));
    double reference = NAN;

    if (E != NULL)
        reference = fill_column(r, lambda, &c, E);
    free(E);
    return reference;
}

/* ---- one evaluation ---- */

struct work {
    const struct moving_rows *rows;
    const struct moving_signals *y;
    int m, L, r, q, P, n;        /* rows, samples, signals, order, parameters, columns of [Phi D X] */
    int count;
    enum pole_kind *kind;
    int *column, *first;
    double complex *E;
    double *spare;               /* a column for the imaginary parts that a real pole has not */
    double *A, *T;               /* [Phi D X], m x n; its triangle */
    double *C, *V;               /* q x r; q x q: inverse of R11 */
    double *stack, *J, *tau, *delta;
    double *weight, *energy, *rss, *floor2;
    double F, gradient, spent;
    bool look;
};

static void work_done(struct work *w)
{
    free(w->kind), free(w->column), free(w->first), free(w->E), free(w->spare), free(w->A), free(w->T), free(w->C), free(w->V);
    free(w->stack), free(w->J), free(w->tau), free(w->delta), free(w->weight), free(w->energy), free(w->rss), free(w->floor2);
}

static double *numbers(size_t m, size_t n)
{
    return calloc(m * n + 1, sizeof(double));
}

static bool layout(struct work *w, const double complex *lambda)
{
    w->kind = malloc(sizeof *w->kind * (size_t)w->count), w->column = malloc(sizeof *w->column * (size_t)w->count);
    w->first = malloc(sizeof *w->first * (size_t)w->count);
    if (w->kind == NULL || w->column == NULL || w->first == NULL)
        return false;
    for (int j = 0; j < w->count; j++) {
        w->kind[j] = pole_kind(lambda[j], w->rows->tau);
        w->column[j] = w->q;
        w->first[j] = lambda[j] == 0 ? -1 : w->P;
        w->q += w->kind[j] == POLE_PAIR ? 2 : 1;
        w->P += lambda[j] == 0 ? 0 : w->kind[j] == POLE_PAIR ? 2 : 1;
    }
    w->n = 2 * w->q + w->r;
    return true;
}

static bool allocate(struct work *w)
{
    size_t m = (size_t)w->m, n = (size_t)w->n, q = (size_t)w->q, r = (size_t)w->r, P = (size_t)w->P + 1;

    w->E = malloc(sizeof *w->E * scratch_of(w->rows));
    w->spare = numbers(2 * m, 1), w->A = numbers(m, n), w->T = numbers(n, n), w->C = numbers(q, r), w->V = numbers(q, q);
    w->stack = numbers(q * r + P, P), w->J = numbers(P, P), w->tau = numbers(P, 1), w->delta = numbers(P, 1);
    w->weight = numbers(r, 1), w->energy = numbers(r, 1), w->rss = numbers(r, 1), w->floor2 = numbers(r, 1);
    return w->E != NULL && w->spare != NULL && w->A != NULL && w->T != NULL && w->C != NULL && w->V != NULL && w->stack != NULL && w->J != NULL
        && w->tau != NULL && w->delta != NULL && w->weight != NULL && w->energy != NULL && w->rss != NULL && w->floor2 != NULL;
}

static double freedom(const struct work *w)
{
    return (double)w->r * (w->L - w->q) - w->P;
}

/* (6) */
static void set_floor(struct work *w, const double complex *lambda)
{
    double most = 0;

    for (int j = 0; j < w->count; j++)
        most = fmax(most, (w->kind[j] == POLE_PAIR ? cimag(lambda[j]) : fabs(creal(lambda[j]))) * w->rows->tau);
    for (int g = 0; g < w->r; g++) {
        double x = cblas_dnrm2(w->m, w->y->X.x + (size_t)g * (size_t)w->y->X.ld, 1), f = (4 + most * w->L / 4) * DBL_EPSILON;
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
        double rest = own < FREEDOM_LEAST ? pooled / fmax(live, 1) : fmax(w->rss[g], w->L * w->floor2[g]);
        w->weight[g] = w->energy[g] > 0 ? 1 / sqrt(fmax(rest / fmax(own, 1), DBL_MIN)) : 0;
        w->F += w->weight[g] * w->weight[g] * w->rss[g];
    }
}

/* [Phi D X] and its triangle; false where Phi is singular. */
static enum modal_status factor(struct work *w, const double complex *lambda, double *reference, bool *regular, struct modal_error *err)
{
    struct matrix A = { w->m, w->n, w->m, w->A }, T = { w->n, w->n, w->n, w->T };
    size_t m = (size_t)w->m;
    enum modal_status rc;

    for (int j = 0; j < w->count; j++) {
        double *re = w->A + (size_t)w->column[j] * m, *d = re + (size_t)w->q * m;
        bool pair = w->kind[j] == POLE_PAIR;
        struct column c = { .re = re, .im = pair ? re + m : w->spare, .d_re = d, .d_im = pair ? d + m : w->spare + m };
        reference[j] = fill_column(w->rows, lambda[j], &c, w->E);
    }
    for (int g = 0; g < w->r; g++)
        memcpy(w->A + (size_t)(2 * w->q + g) * m, w->y->X.x + (size_t)g * (size_t)w->y->X.ld, sizeof(double) * m);
    rc = qr_triangle(&A, &T, err);
    w->spent += (double)w->m * w->n * w->n;
    *regular = true;
    for (int j = 0; j < w->q; j++)
        *regular &= fabs(w->T[j + j * w->n]) > 32 * DBL_EPSILON * cblas_dnrm2(j + 1, w->T + j * w->n, 1);
    return rc;
}

/* Coefficients and sums of squares. */
static void solve(struct work *w)
{
    int q = w->q, n = w->n;

    for (int g = 0; g < w->r; g++) {
        const double *x = w->T + (size_t)(2 * q + g) * (size_t)n;
        double rest = cblas_dnrm2(q + g + 1, x + q, 1);
        memcpy(w->C + (size_t)g * (size_t)q, x, sizeof(double) * (size_t)q);
        w->rss[g] = rest * rest + w->y->outside2[g];
    }
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, q, w->r, 1, w->T, n, w->C, q);
}

/* The rows of (4) of signal g. */
static void signal_rows(struct work *w, int g)
{
    int q = w->q, n = w->n, ld = q * w->r + w->P + 1;
    const double *R22 = w->T + q + (size_t)q * (size_t)n, *c = w->C + (size_t)g * (size_t)q, *z = w->T + q + (size_t)(2 * q + g) * (size_t)n;

    for (int j = 0; j < w->count; j++) {
        int i = w->column[j];
        const double *d1 = R22 + (size_t)i * (size_t)n, *d2 = d1 + n;
        double *x = w->stack + g * q + (size_t)(w->first[j] < 0 ? 0 : w->first[j]) * (size_t)ld, a = w->weight[g];
        for (int l = 0; w->first[j] >= 0 && l < q; l++) {
            x[l] = w->kind[j] == POLE_PAIR ? a * (c[i] * d1[l] + c[i + 1] * d2[l]) : a * c[i] * d1[l];       /* (3) */
            if (w->kind[j] == POLE_PAIR)
                x[l + ld] = a * (c[i] * d2[l] - c[i + 1] * d1[l]);
        }
    }
    for (int l = 0; l < q; l++)
        w->stack[g * q + l + (size_t)w->P * (size_t)ld] = w->weight[g] * z[l];
}

/* R_J and g; the gradient in standard errors. */
static enum modal_status linearise(struct work *w, struct modal_error *err)
{
    int P = w->P + 1, m = w->q * w->r, ld = m + P;
    struct matrix A = { m > P ? m : P, P, ld, w->stack }, T = { P, P, P, w->J };
    enum modal_status rc;

    memset(w->stack, 0, sizeof(double) * (size_t)ld * (size_t)P);
    for (int g = 0; g < w->r; g++)
        signal_rows(w, g);
    rc = qr_triangle(&A, &T, err);
    w->gradient = cblas_dnrm2(w->P, w->J + (size_t)w->P * (size_t)P, 1) / sqrt(fmax(w->F / fmax(freedom(w), 1), DBL_MIN));
    return rc;
}

static enum modal_status evaluate(struct work *w, const double complex *lambda, double *reference, bool *regular, struct modal_error *err)
{
    enum modal_status rc = factor(w, lambda, reference, regular, err);

    if (rc != MODAL_OK || !*regular)
        return rc;
    solve(w);
    set_weights(w);
    return w->look || w->P == 0 ? MODAL_OK : linearise(w, err);
}

/* ---- steps ---- */

static bool newton(struct work *w)
{
    int P = w->P + 1;

    for (int i = 0; i < w->P; i++)
        if (!(fabs(w->J[i + i * P]) > DBL_MIN))
            return false;
    memcpy(w->delta, w->J + (size_t)w->P * (size_t)P, sizeof(double) * (size_t)w->P);
    cblas_dtrsv(CblasColMajor, CblasUpper, CblasNoTrans, CblasNonUnit, w->P, w->J, P, w->delta, 1);
    for (int i = 0; i < w->P; i++)
        if (!isfinite(w->delta[i]) || fabs(w->delta[i]) * w->L > 3)
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
        if (w->kind[j] == POLE_PAIR && !(im * tau > 1e-12 && im * tau < M_PI))
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
        if (p >= 0 && fabs(w->delta[p]) > CLOSE * fabs(creal(lambda[j])) * tau)
            return false;
        if (p >= 0 && w->kind[j] == POLE_PAIR && fabs(w->delta[p + 1]) > CLOSE * cimag(lambda[j]) * tau)
            return false;
    }
    return true;
}

static bool at_rounding(const struct work *w)
{
    for (int g = 0; g < w->r; g++)
        if (w->rss[g] > w->L * w->floor2[g])
            return false;
    return true;
}

/* The coefficients are those of the last evaluation, a last step before lambda at most. */
static enum modal_status descend(struct work *w, struct moving_fit *f, struct modal_error *err)
{
    double before = HUGE_VAL, now = HUGE_VAL;

    for (int i = 0; i < STEPS; i++) {
        bool regular;
        enum modal_status rc = evaluate(w, f->lambda, f->reference, &regular, err);
        if (rc != MODAL_OK || !regular || !isfinite(w->gradient) || (i == 0 && w->gradient > STEP_MOST && !at_rounding(w)))
            return rc;
        f->settled = w->gradient <= SETTLED || (w->gradient >= before && (w->gradient <= NEAR || at_rounding(w)));
        if (f->settled || w->gradient >= before || i == STEPS - 1 || !newton(w))
            return MODAL_OK;
        f->settled = is_last(w, f->lambda);
        if (!take_step(w, f->lambda) || f->settled)
            return MODAL_OK;
        before = i > 0 ? now : HUGE_VAL, now = w->gradient;
    }
    return MODAL_OK;
}

/* ---- what the fit says ---- */

/* (5), its diagonal. */
static void errors(struct work *w, struct moving_fit *f)
{
    int P = w->P + 1;
    double s = sqrt(fmax(w->F / fmax(freedom(w), 1), DBL_MIN)) / w->rows->tau;
    bool good = LAPACKE_dtrtri_work(LAPACK_COL_MAJOR, 'U', 'N', w->P, w->J, P) == 0;

    for (int j = 0; j < w->count; j++)
        for (int i = 0; i < 2; i++) {
            int p = w->first[j] + i;
            double *to = i == 0 ? &f->std_re[j] : &f->std_im[j];
            *to = w->first[j] < 0 || (i == 1 && w->kind[j] != POLE_PAIR) ? 0 : !good ? NAN : s * cblas_dnrm2(w->P - p, w->J + p + (size_t)p * (size_t)P, P);
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
    b = cblas_ddot(q, w->V + i, q, w->V + i + 1, q), d = cblas_ddot(q, w->V + i + 1, q, w->V + i + 1, q);
    e = a * d - b * b;
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
    double g = cblas_dnrm2(w->P, w->J + (size_t)w->P * (size_t)P, 1), left = 1 - 2 * g * g / w->F, sum = 0;

    for (int i = 0; i < w->r; i++)
        sum += gain(w, i, w->rss[i], left > 0 ? left * w->rss[i] : 0);
    return left > 0 ? sum : HUGE_VAL;
}

/* (8) of refine.c. */
static double scarcity(double unknowns, double numbers)
{
    double x = fmin(numbers > 0 ? unknowns / numbers : 0, SCARCE_MOST);

    return x > 0 ? -log1p(-x) / x : 1;
}

/* What -2 ln(likelihood) would fall by, to first order, if pole j, which is fixed, were free: one number moves c_g t e^{lambda t} in all signals. */
static double gain_if_free(const struct work *w, int j)
{
    int i = w->q + w->column[j];
    double d = w->T[i + (size_t)i * (size_t)w->n], num = 0, den = 0;

    for (int g = 0; g < w->r; g++) {
        double x = w->weight[g] * w->C[w->column[j] + (size_t)g * (size_t)w->q] * d;
        num += x * w->weight[g] * w->T[i + (size_t)(2 * w->q + g) * (size_t)w->n], den += x * x;
    }
    return den > 0 ? num * num / den : 0;
}

static void weigh_poles(struct work *w, struct moving_fit *f)
{
    int q = w->q, live = 0;
    double ln_n;

    for (int g = 0; g < w->r; g++)
        live += w->energy[g] > 0;
    ln_n = log(fmax((double)w->L * live, 2));
    f->price = scarcity((double)live * q + w->P, (double)w->L * live) * ln_n;
    f->pair_price = f->price * 2 * (live + 1 + 1 / fmax(live, 1));
    f->least_drop = HUGE_VAL;
    for (int j = 0; j < q; j++)
        memcpy(w->V + (size_t)j * (size_t)q, w->T + (size_t)j * (size_t)w->n, sizeof(double) * (size_t)q);
    if (LAPACKE_dtrtri_work(LAPACK_COL_MAJOR, 'U', 'N', q, w->V, q) != 0)
        f->settled = false;
    for (int j = 0; j < w->count; j++) {
        int i = w->column[j], n = w->kind[j] == POLE_PAIR ? 2 : 1;
        double drop = -0.5 * n * f->pair_price, split = 0;
        for (int g = 0; g < w->r; g++) {
            const double *z = w->T + q + i + (size_t)(2 * q + g) * (size_t)w->n;
            drop += gain(w, g, w->rss[g] + share_of(w, j, g), w->rss[g]);
            split += gain(w, g, w->rss[g], w->rss[g] - squared(z[0]) - (n > 1 ? squared(z[1]) : 0));
        }
        if (w->count > 1)
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

    *f = (struct moving_fit) { .poles = w->count, .order = w->q, .signals = w->r, .parameters = w->P };
    f->lambda = malloc(sizeof *f->lambda * (count + 1));
    f->std_re = numbers(count, 1), f->std_im = numbers(count, 1), f->reference = numbers(count, 1);
    f->C = numbers((size_t)w->q, r), f->rss = numbers(r, 1), f->floor2 = numbers(r, 1), f->energy = numbers(r, 1);
    return f->lambda != NULL && f->std_re != NULL && f->std_im != NULL && f->reference != NULL && f->C != NULL && f->rss != NULL && f->floor2 != NULL && f->energy != NULL;
}

void moving_fit_done(struct moving_fit *f)
{
    free(f->lambda), free(f->std_re), free(f->std_im), free(f->reference), free(f->C), free(f->rss), free(f->floor2), free(f->energy);
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
    f->rounding = at_rounding(w);
    f->work = w->spent;
    if (what == LOOK)
        return;
    if (what == PROBE)
        f->could_gain = could_gain(w);
    else
        weigh_poles(w, f);
    errors(w, f);
}

static enum modal_status run(const struct moving_rows *rows, const struct moving_signals *signals, const double complex *start, int count, enum what what,
                             struct moving_fit *out, struct modal_error *err)
{
    struct work w = { .rows = rows, .y = signals, .m = signals->X.m, .L = moving_rows_samples(rows), .r = signals->X.n, .count = count, .look = what == LOOK };
    struct moving_fit f = { 0 };
    enum modal_status rc = MODAL_OK;
    bool regular = true;

    if (count < 1 || !layout(&w, start) || w.m != moving_rows_count(rows) || w.m < w.n) {
        rc = modal_fail(err, MODAL_BAD_INPUT, "moving_fit: %d rows for %d poles and %d signals", w.m, count, w.r);
        goto out;
    }
    if (!allocate(&w) || !fit_new(&f, &w)) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving_fit: no memory for %d x %d", w.m, w.n);
        goto out;
    }
    memcpy(f.lambda, start, sizeof *start * (size_t)count);
    set_floor(&w, start);
    if (what != FIT)
        rc = evaluate(&w, f.lambda, f.reference, &regular, err), f.settled = regular;
    else
        rc = descend(&w, &f, err);
    if (rc != MODAL_OK)
        goto out;
    report(&w, what, &f);
    *out = f;
    f = (struct moving_fit) { 0 };
out:
    moving_fit_done(&f);
    work_done(&w);
    return rc;
}

enum modal_status moving_fit(const struct moving_rows *rows, const struct moving_signals *signals, const double complex *start, int count,
                             struct moving_fit *out, struct modal_error *err)
{
    return run(rows, signals, start, count, FIT, out, err);
}

enum modal_status moving_look(const struct moving_rows *rows, const struct moving_signals *signals, const double complex *lambda, int count,
                              struct moving_fit *out, struct modal_error *err)
{
    return run(rows, signals, lambda, count, LOOK, out, err);
}

enum modal_status moving_probe(const struct moving_rows *rows, const struct moving_signals *signals, const double complex *lambda, int count,
                               struct moving_fit *out, struct modal_error *err)
{
    return run(rows, signals, lambda, count, PROBE, out, err);
}
