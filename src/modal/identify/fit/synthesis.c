/*
 * synthesis.c - signals rebuilt from exponents
 *
 * Eqs. (26)-(30) of the paper solve normal equations for each of the p phases of the period.  All
 * phases and signals share one basis, Q_k = V D_k, so one factorisation serves: with h[k + l p, s]
 * in column (k, s) of Y and rho_j^l in V,
 *
 *     b = V^+ Y,   fit = Re(V b),                                                               (1)
 *
 * columns scaled to largest magnitude 1 (growth cannot overflow) and then to unit norm; V^+ by SVD,
 * P the left singular vectors above rounding: b = Z S^{-1} (P^T Y), fit = P (P^T Y).  Y is read
 * twice and never copied.  A real negative multiplier has the one column (-1)^l |rho|^l; cosine and
 * sine would be parallel there.
 *
 * Of many poles in noise R and V^+ Y come of sums in closed form (gram.h), which read Y alone; and
 * of a long record V = Q R by doubling (doubling.h), and (1) is of R and Q^T Y in place of V and Y:
 * neither V nor Q is formed, and the fit, where it is wanted, is made pole by pole.
 */
#include "modal/identify/fit/synthesis.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/doubling.h"
#include "modal/identify/fit/gram.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/powers.h"
#include "modal/linalg/svd.h"

enum { BLOCK = 64 };   /* channels at a time */

/* The real basis, L x order, columns scaled; real and (minus) imaginary part of a pair adjacent. */
static void synthesis_basis(const double complex *lambda, int count, double tau,
                            struct matrix *basis, double *reference)
{
    int column = 0, L = basis->m;

    for (int j = 0; j < count; j++) {
        enum pole_kind kind = pole_kind(lambda[j], tau);
        double a = creal(lambda[j]) * tau, b = cimag(lambda[j]) * tau,
               *x = basis->x + (size_t)column * basis->ld;
        /* ln of the largest entry, that the column is divided by: growth ends at 1 */
        reference[j] = a > 0 ? a * (L - 1) : 0;
        powers_of(kind, a, b, L, x, basis->ld);
        column += kind == POLE_PAIR ? 2 : 1;
    }
}

void synthesis_done(struct synthesis *s)
{
    free(s->coefficient);
    free(s->reference);
    free(s->channel_residual);
    memset(s, 0, sizeof *s);
}

/* The factored basis: P (L x rank), and W = D Z S^{-1} (order x rank), so that the real unknowns
 * are W P^T Y. */
struct factors { struct matrix P, W; double *norm, *s, *zt; };

static void factors_done(struct factors *f)
{
    free(f->P.x);
    free(f->W.x);
    free(f->norm);
    free(f->s);
    free(f->zt);
}

/* BASIS is that of ROWS rows, or its triangle. */
static enum modal_status factorise(struct matrix *basis, int rows, struct factors *f,
                                   struct synthesis *out, struct modal_error *err)
{
    int L = basis->m, n = basis->n, k = L < n ? L : n;
    struct matrix ZT = { k, n, k > 0 ? k : 1, NULL };
    double floor;
    enum modal_status rc;

    f->P = matrix_new(L, k);
    f->W = matrix_new(n, k);
    f->norm = malloc(sizeof(double) * (n + 1));
    f->s = malloc(sizeof(double) * (k + 1));
    ZT.x = f->zt = malloc(sizeof(double) * ((size_t)k * n + 1));
    if (f->P.x == NULL || f->W.x == NULL || f->norm == NULL || f->s == NULL || f->zt == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for %d rows and %d unknowns",
                          L, n);
    for (int j = 0; j < n; j++) {
        double *a = basis->x + (size_t)j * basis->ld;
        /* unit columns: equilibrated, their condition is within sqrt(n) of the least */
        f->norm[j] = safe_norm(a, L);
        for (int i = 0; i < L && f->norm[j] > 0; i++)
            a[i] /= f->norm[j];
    }
    rc = svd_thin(basis, f->s, &f->P, &ZT, err);
    if (rc != MODAL_OK || k == 0)
        return rc;
    /* below it a direction of V is rounding, and its coefficient any number */
    floor = (rows > n ? rows : n) * DBL_EPSILON * f->s[0];
    for (out->rank = 0; out->rank < k && f->s[out->rank] > floor; )
        out->rank++;
    for (int r = 0; r < out->rank; r++)
        for (int j = 0; j < n; j++)
            f->W.x[j + (size_t)r * f->W.ld] =
                /* Z S^{-1} of (1), the columns' scale undone */
                f->norm[j] > 0 ? f->zt[r + (size_t)j * k] / f->s[r] / f->norm[j] : 0;
    return MODAL_OK;
}

static void store_coefficients(const double complex *lambda, double tau, const double *x, int ldx,
                               int first, int width, struct synthesis *out)
{
    for (int c = 0; c < width; c++)
        for (int j = 0, column = 0; j < out->poles; j++) {
            const double *at = x + column + (size_t)c * ldx;
            bool pair = pole_kind(lambda[j], tau) == POLE_PAIR;
            out->coefficient[j + (size_t)(first + c) * out->poles] =
                /* columns Re z^l and -Im z^l: b_r Re - b_i Im = Re(b z^l) */
                pair ? CMPLX(at[0], at[1]) : at[0];
            column += pair ? 2 : 1;
        }
}

/* One block of channels: coefficients, residual norms, and the fit where wanted. */
static void fit_block(const double complex *lambda, double tau, const struct matrix *Y, int first,
                      int width, const struct factors *f, double *work, struct matrix *fit,
                      struct synthesis *out)
{
    int L = Y->m, r = out->rank, n = out->order;
    double *C = work, *x = C + (size_t)r * width, *E = x + (size_t)n * width;
    const double *y = Y->x + (size_t)first * Y->ld;

    memset(x, 0, sizeof *x * n * width);
    memset(E, 0, sizeof *E * L * width);
    if (r > 0) {
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, r, width, L, 1, f->P.x, f->P.ld, y,
                    Y->ld, 0, C, r);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, width, r, 1, f->W.x, f->W.ld, C,
                    r, 0, x, n);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, L, width, r, 1, f->P.x, f->P.ld, C,
                    r, 0, E, L);
    }
    store_coefficients(lambda, tau, x, n, first, width, out);
    for (int c = 0; c < width; c++) {
        double *e = E + (size_t)c * L;
        const double *h = y + (size_t)c * Y->ld;
        if (fit != NULL)
            memcpy(fit->x + (size_t)(first + c) * fit->ld, e, sizeof *e * L);
        for (int l = 0; l < L; l++)
            /* by the samples: |y|^2 - |P^T y|^2 would have half of the digits */
            e[l] = h[l] - e[l];
        out->channel_residual[first + c] = safe_norm(e, L);
    }
}

/* ---- without the basis ---- */

/* The poles per row, and the triangle of their basis. */
struct laid { enum pole_kind *kind; int *column; double *a, *b; struct matrix R; };

static void laid_done(struct laid *t)
{
    free(t->kind), free(t->column), free(t->a), free(t->R.x);
}

/* Of N columns; R is yet to be made. */
static enum modal_status laid_new(const double complex *lambda, int count, double tau, int n,
                                  struct laid *t, struct doubling_poles *poles,
                                  struct modal_error *err)
{
    size_t most = (size_t)count + 1, order = (size_t)n;

    *t = (struct laid) { .R = { n, n, n, NULL } };
    t->kind = malloc(most * sizeof *t->kind), t->column = malloc(most * sizeof *t->column);
    t->a = malloc(2 * most * sizeof *t->a), t->R.x = malloc(order * order * sizeof *t->R.x);
    if (t->kind == NULL || t->column == NULL || t->a == NULL || t->R.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for order %d", n);
    t->b = t->a + count;
    for (int j = 0, c = 0; j < count; j++) {
        t->kind[j] = pole_kind(lambda[j], tau), t->column[j] = c;
        t->a[j] = creal(lambda[j]) * tau, t->b[j] = cimag(lambda[j]) * tau;
        c += pole_order(lambda[j], tau);
    }
    *poles = (struct doubling_poles) { count, n, t->kind, t->column, t->a, t->b };
    return MODAL_OK;
}

/* The fit, of the coefficients in S, pole by pole. */
static enum modal_status rebuild(const double complex *lambda, double tau,
                                 const struct synthesis *s, struct matrix *fit,
                                 struct modal_error *err)
{
    int L = s->rows, S = s->channels;
    double *basis = malloc(2 * (size_t)L * sizeof *basis),
        *x = malloc(2 * (size_t)S * sizeof *x);
    bool room = basis != NULL && x != NULL;

    for (int c = 0; c < S && room; c++)
        memset(fit->x + (size_t)c * (size_t)fit->ld, 0, (size_t)L * sizeof *fit->x);
    for (int j = 0; j < s->poles && room; j++) {
        enum pole_kind kind = pole_kind(lambda[j], tau);
        int n = kind == POLE_PAIR ? 2 : 1;
        powers_of(kind, creal(lambda[j]) * tau, cimag(lambda[j]) * tau, L, basis, L);
        for (int c = 0; c < S; c++) {
            double complex z = s->coefficient[j + (size_t)c * (size_t)s->poles];
            x[c] = creal(z), x[c + S] = cimag(z);
        }
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, L, S, n, 1, basis, L, x, S, 1,
                    fit->x, fit->ld);
    }
    free(basis), free(x);
    return room ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for a fit of "
                                        "%d rows", L);
}

/* ---- many poles ---- */

/* By sums; *told: whether they tell enough. */
static enum modal_status fit_sums(const double complex *lambda, double tau, const struct matrix *Y,
                                  struct matrix *fit, struct synthesis *s, bool *told,
                                  struct modal_error *err)
{
    int n = s->order, S = Y->n;
    struct factors f = { { 0 }, { 0 }, NULL, NULL, NULL };
    struct doubling_poles poles;
    struct laid t = { 0 };
    double *C = malloc((2 * (size_t)n + 1) * (size_t)S * sizeof *C), *Z = C + (size_t)n * S;
    struct gram *g = gram_new(Y->m, s->poles, n, false);
    enum modal_status rc = laid_new(lambda, s->poles, tau, n, &t, &poles, err);

    if (rc == MODAL_OK && (g == NULL || C == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for order %d", n);
    *told = rc == MODAL_OK && gram_factor(g, &poles, true, t.R.x)
         && gram_project(g, Y, t.R.x, C, Z, Z + (size_t)n * S);
    if (*told)
        rc = factorise(&t.R, Y->m, &f, s, err);
    *told &= rc == MODAL_OK && s->rank == n;
    for (int j = 0; j < s->poles && *told; j++)
        s->reference[j] = fmax(t.a[j], 0) * (Y->m - 1);
    for (int c = 0; c < S && *told; c++)
        s->channel_residual[c] = sqrt(fmax(Z[(size_t)n * S + c], 0));
    if (*told)
        store_coefficients(lambda, tau, C, n, 0, S, s);
    if (*told && fit != NULL)
        rc = rebuild(lambda, tau, s, fit, err);
    gram_free(g), free(C);
    factors_done(&f), laid_done(&t);
    return rc;
}

/* ---- long records ---- */

/* The triangle of a basis of many rows, and what projects on it. */
struct tall { struct doubling *doubling; struct laid laid; };

static void tall_done(struct tall *t)
{
    doubling_free(t->doubling);
    laid_done(&t->laid);
}

/* Of L rows of N columns, for one column of data at a time, or of the blocks that have it. */
static enum modal_status tall_new(const double complex *lambda, int count, double tau, int L,
                                  int n, struct compressed *blocks, struct tall *t,
                                  struct modal_error *err)
{
    struct doubling_poles poles;
    enum modal_status rc = laid_new(lambda, count, tau, n, &t->laid, &poles, err);

    if (rc == MODAL_OK && blocks != NULL && !compressed_holds(blocks, &poles))
        rc = compressed_about(blocks, &poles, err);
    t->doubling = rc == MODAL_OK ? doubling_new(L, n, 1, blocks) : NULL;
    if (rc == MODAL_OK && t->doubling == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for %d rows, order %d", L, n);
    return rc == MODAL_OK ? doubling_factor(t->doubling, &poles, t->laid.R.x, err) : rc;
}

/* One channel: coefficients and what is left. */
static enum modal_status fit_column(const double complex *lambda, double tau,
                                    const struct matrix *Y, int c, struct tall *t,
                                    const struct factors *f, double *work, struct synthesis *out,
                                    struct modal_error *err)
{
    int n = out->order, r = out->rank;
    double *Z = work, *C = Z + n, *x = C + n, rest2 = 0, lost;
    enum modal_status rc = doubling_project(t->doubling, Y, c, 1, Z, &rest2, err);

    if (rc != MODAL_OK)
        return rc;
    cblas_dgemv(CblasColMajor, CblasTrans, n, r, 1, f->P.x, n, Z, 1, 0, C, 1);
    cblas_dgemv(CblasColMajor, CblasNoTrans, n, r, 1, f->W.x, n, C, 1, 0, x, 1);
    cblas_dgemv(CblasColMajor, CblasNoTrans, n, r, -1, f->P.x, n, C, 1, 1, Z, 1);
    lost = cblas_dnrm2(n, Z, 1);                        /* what lies in parallel columns */
    /* what Q does not hold, and what of Q^T y the factors do not */
    out->channel_residual[c] = hypot(sqrt(rest2), lost);
    store_coefficients(lambda, tau, x, n, c, 1, out);
    return MODAL_OK;
}

static enum modal_status fit_tall(const double complex *lambda, double tau, const struct matrix *Y,
                                  struct compressed *blocks, struct matrix *fit,
                                  struct synthesis *s, struct modal_error *err)
{
    struct factors f = { { 0 }, { 0 }, NULL, NULL, NULL };
    struct tall t = { 0 };
    double *work = malloc(3 * (size_t)s->order * sizeof *work);
    enum modal_status rc = tall_new(lambda, s->poles, tau, Y->m, s->order, blocks, &t, err);

    if (rc == MODAL_OK && work == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for order %d", s->order);
    for (int j = 0; j < s->poles; j++)
        s->reference[j] = fmax(creal(lambda[j]), 0) * tau * (Y->m - 1);
    if (rc == MODAL_OK)
        rc = factorise(&t.laid.R, Y->m, &f, s, err);
    for (int c = 0; c < Y->n && rc == MODAL_OK; c++)
        rc = fit_column(lambda, tau, Y, c, &t, &f, work, s, err);
    if (rc == MODAL_OK && fit != NULL)
        rc = rebuild(lambda, tau, s, fit, err);
    free(work);
    factors_done(&f);
    tall_done(&t);
    return rc;
}

/* ---- products ---- */

/* e^w - 1, to its own digits where w is small. */
static double complex exp_less_one(double complex w)
{
    double a = creal(w), b = cimag(w), half = sin(0.5 * b);

    return CMPLX(expm1(a) * cos(b) - 2 * half * half, exp(a) * sin(b));
}

/* e^{-scale} sum_{l < L} e^{(a + ib) l} = e^{-scale} (e^{wL} - 1) / (e^w - 1), from the end where
 * it grows; scale is at least what the last one has grown to. */
static double complex sum_of_powers(double a, double b, int L, double scale)
{
    /* whole turns a row are none: else L of their rounding */
    double complex w = CMPLX(a, remainder(b, 2 * M_PI)), first = -scale, below;

    if (a > 0)
        first += (L - 1) * w, w = -w;
    below = exp_less_one(w);
    return cexp(first) * (below == 0 ? L : exp_less_one(L * w) / below);
}

/* lambda tau, its phase 0 or half a turn where the pole is no pair. */
static double complex row_of_pole(double complex lambda, double tau)
{
    enum pole_kind kind = pole_kind(lambda, tau);
    double turn = kind == POLE_NEGATIVE ? M_PI : 0;

    return CMPLX(creal(lambda) * tau, kind == POLE_PAIR ? cimag(lambda) * tau : turn);
}

/* Of the columns of two poles, per row at a + ib: those of the first down, 2 x 2; of a pole that is
 * no pair the second means nothing. */
static void multiply_columns(const double complex *z, int L, double scale, double *G)
{
    double complex sum = sum_of_powers(creal(z[0] + z[1]), cimag(z[0] + z[1]), L, scale),
        less = sum_of_powers(creal(z[0] + z[1]), cimag(z[0] - z[1]), L, scale);

    /* Re x Re y = Re(xy + x conj y) / 2, and so on; columns are Re and -Im */
    G[0] = 0.5 * creal(less + sum), G[3] = 0.5 * creal(less - sum);
    G[1] = -0.5 * cimag(sum + less), G[2] = 0.5 * cimag(less - sum);
}

void synthesis_products(const double complex *lambda, int count, double tau, int L, double *G)
{
    int n = poles_order(lambda, count, tau);

    for (int j = 0, column = 0; j < count; column += pole_order(lambda[j], tau), j++)
        for (int i = 0, row = 0; i <= j; row += pole_order(lambda[i], tau), i++) {
            double complex z[2] = { row_of_pole(lambda[i], tau), row_of_pole(lambda[j], tau) };
            double part[4], scale = (L - 1) * (fmax(creal(z[0]), 0) + fmax(creal(z[1]), 0));
            multiply_columns(z, L, scale, part);
            for (int q = 0; q < pole_order(lambda[j], tau); q++)
                for (int p = 0; p < pole_order(lambda[i], tau); p++) {
                    size_t to = (size_t)(row + p), at = (size_t)(column + q);
                    G[to + at * (size_t)n] = G[at + to * (size_t)n] = part[p + 2 * q];
                }
        }
}

/* ---- all ---- */

static enum modal_status fit_rows(const double complex *lambda, double tau, const struct matrix *Y,
                                  struct matrix *fit, struct synthesis *s,
                                  struct modal_error *err)
{
    int n = s->order, L = Y->m;
    struct matrix basis = matrix_new(L, n);
    struct factors f = { { 0 }, { 0 }, NULL, NULL, NULL };
    double *work = malloc(sizeof *work * BLOCK * ((size_t)2 * n + L + 1));
    enum modal_status rc = MODAL_OK;

    if (basis.x == NULL || work == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for %d rows, order %d", L, n);
    if (rc == MODAL_OK) {
        synthesis_basis(lambda, s->poles, tau, &basis, s->reference);
        rc = factorise(&basis, L, &f, s, err);
    }
    for (int first = 0; first < Y->n && rc == MODAL_OK; first += BLOCK)
        fit_block(lambda, tau, Y, first, Y->n - first < BLOCK ? Y->n - first : BLOCK, &f, work,
                  fit, s);
    factors_done(&f);
    free(work);
    free(basis.x);
    return rc;
}

/* By sums where that costs less and tells enough, else by doubling, or by rows. */
static enum modal_status fit_cheaply(const double complex *lambda, double tau,
                                     const struct matrix *Y, struct compressed *blocks,
                                     struct matrix *fit, struct synthesis *s,
                                     struct modal_error *err)
{
    bool told = false;
    enum modal_status rc = MODAL_OK;

    if (blocks == NULL && gram_pays(Y->m, s->order, Y->n))
        rc = fit_sums(lambda, tau, Y, fit, s, &told, err);
    if (rc != MODAL_OK || told)
        return rc;
    return doubling_pays(Y->m, s->order, Y->n) ? fit_tall(lambda, tau, Y, blocks, fit, s, err)
                                               : fit_rows(lambda, tau, Y, fit, s, err);
}

static enum modal_status fit_any(const double complex *lambda, int count, double tau,
                                 const struct matrix *Y, struct compressed *blocks,
                                 struct matrix *fit, struct synthesis *out,
                                 struct modal_error *err)
{
    struct synthesis s = { .poles = count, .order = poles_order(lambda, count, tau),
                           .rows = Y->m, .channels = Y->n };
    enum modal_status rc;

    s.coefficient = calloc((size_t)count * Y->n + 1, sizeof *s.coefficient);
    s.reference = calloc((size_t)count + 1, sizeof *s.reference);
    s.channel_residual = calloc((size_t)Y->n + 1, sizeof *s.channel_residual);
    if (s.coefficient == NULL || s.reference == NULL || s.channel_residual == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for %d poles in %d channels",
                        count, Y->n);
    else
        rc = fit_cheaply(lambda, tau, Y, blocks, fit, &s, err);
    if (rc == MODAL_OK) {
        s.residual = safe_norm(s.channel_residual, Y->n);
        *out = s;
        memset(&s, 0, sizeof s);
    }
    synthesis_done(&s);
    return rc;
}

enum modal_status synthesis_fit(const double complex *lambda, int count, double tau,
                                const struct matrix *Y, struct matrix *fit, struct synthesis *out,
                                struct modal_error *err)
{
    return fit_any(lambda, count, tau, Y, NULL, fit, out, err);
}

enum modal_status synthesis_fit_blocks(const double complex *lambda, int count, double tau,
                                       struct compressed *blocks, struct synthesis *out,
                                       struct modal_error *err)
{
    return fit_any(lambda, count, tau, &blocks->Y, blocks, NULL, out, err);
}
