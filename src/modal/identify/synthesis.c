/*
 * synthesis.c - signals rebuilt from exponents
 *
 * Eqs. (26)-(30) of the paper solve normal equations for each of the p phases of the period.  All phases and signals share one basis, Q_k = V D_k, so one
 * factorisation serves: with h[k + l p, s] in column (k, s) of Y and rho_j^l in V,
 *
 *     b = V^+ Y,   fit = Re(V b),                                                                    (1)
 *
 * columns scaled to largest magnitude 1 (growth cannot overflow) and then to unit norm; V^+ by SVD, P the left singular vectors above rounding:
 * b = Z S^{-1} (P^T Y), fit = P (P^T Y).  Y is read twice and never copied.  A real negative multiplier has the one column
 * (-1)^l |rho|^l; cosine and sine would be parallel there.
 */
#include "modal/identify/synthesis.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/exponents.h"
#include "modal/identify/powers.h"
#include "modal/linalg/svd.h"

enum { BLOCK = 64 };   /* channels at a time */

void synthesis_basis(const double complex *lambda, int count, double tau, struct matrix *basis, double *reference)
{
    int column = 0, L = basis->m;

    for (int j = 0; j < count; j++) {
        enum pole_kind kind = pole_kind(lambda[j], tau);
        double a = creal(lambda[j]) * tau, b = cimag(lambda[j]) * tau, *x = basis->x + (size_t)column * basis->ld;
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

/* The factored basis: P (L x rank), and W = D Z S^{-1} (order x rank), so that the real unknowns are W P^T Y. */
struct factors { struct matrix P, W; double *norm, *s, *zt; };

static void factors_done(struct factors *f)
{
    free(f->P.x);
    free(f->W.x);
    free(f->norm);
    free(f->s);
    free(f->zt);
}

static enum modal_status factorise(struct matrix *basis, struct factors *f, struct synthesis *out, struct modal_error *err)
{
    int L = basis->m, n = basis->n, k = L < n ? L : n;
    struct matrix ZT = { k, n, k > 0 ? k : 1, NULL };
    double floor;
    enum modal_status rc;

    f->P = (struct matrix) { L, k, L, malloc(sizeof(double) * ((size_t)L * k + 1)) };
    f->W = (struct matrix) { n, k, n > 0 ? n : 1, malloc(sizeof(double) * ((size_t)n * k + 1)) };
    f->norm = malloc(sizeof(double) * (n + 1));
    f->s = malloc(sizeof(double) * (k + 1));
    ZT.x = f->zt = malloc(sizeof(double) * ((size_t)k * n + 1));
    if (f->P.x == NULL || f->W.x == NULL || f->norm == NULL || f->s == NULL || f->zt == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for %d rows and %d unknowns", L, n);
    for (int j = 0; j < n; j++) {
        double *a = basis->x + (size_t)j * basis->ld;
        f->norm[j] = safe_norm(a, L);
        for (int i = 0; i < L && f->norm[j] > 0; i++)
            a[i] /= f->norm[j];
    }
    rc = svd_thin(basis, f->s, &f->P, &ZT, err);
    if (rc != MODAL_OK || k == 0)
        return rc;
    floor = (L > n ? L : n) * DBL_EPSILON * f->s[0];
    for (out->rank = 0; out->rank < k && f->s[out->rank] > floor; )
        out->rank++;
    out->condition = f->s[k - 1] > 0 ? f->s[0] / f->s[k - 1] : HUGE_VAL;
    for (int r = 0; r < out->rank; r++)
        for (int j = 0; j < n; j++)
            f->W.x[j + (size_t)r * f->W.ld] = f->norm[j] > 0 ? f->zt[r + (size_t)j * k] / f->s[r] / f->norm[j] : 0;
    return MODAL_OK;
}

static void store_coefficients(const double complex *lambda, double tau, const double *x, int ldx, int first, int width,
                               struct synthesis *out)
{
    for (int c = 0; c < width; c++)
        for (int j = 0, column = 0; j < out->poles; j++) {
            const double *at = x + column + (size_t)c * ldx;
            bool pair = pole_kind(lambda[j], tau) == POLE_PAIR;
            out->coefficient[j + (size_t)(first + c) * out->poles] = pair ? CMPLX(at[0], at[1]) : at[0];
            column += pair ? 2 : 1;
        }
}

/* One block of channels: coefficients, residual norms, and the fit where wanted. */
static void fit_block(const double complex *lambda, double tau, const struct matrix *Y, int first, int width,
                      const struct factors *f, double *work, struct matrix *fit, struct synthesis *out)
{
    int L = Y->m, r = out->rank, n = out->order;
    double *C = work, *x = C + (size_t)r * width, *E = x + (size_t)n * width;
    const double *y = Y->x + (size_t)first * Y->ld;

    memset(x, 0, sizeof *x * n * width);
    memset(E, 0, sizeof *E * L * width);
    if (r > 0) {
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, r, width, L, 1, f->P.x, f->P.ld, y, Y->ld, 0, C, r);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, width, r, 1, f->W.x, f->W.ld, C, r, 0, x, n);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, L, width, r, 1, f->P.x, f->P.ld, C, r, 0, E, L);
    }
    store_coefficients(lambda, tau, x, n, first, width, out);
    for (int c = 0; c < width; c++) {
        double *e = E + (size_t)c * L;
        const double *h = y + (size_t)c * Y->ld;
        if (fit != NULL)
            memcpy(fit->x + (size_t)(first + c) * fit->ld, e, sizeof *e * L);
        for (int l = 0; l < L; l++)
            e[l] = h[l] - e[l];
        out->channel_residual[first + c] = safe_norm(e, L);
    }
}

enum modal_status synthesis_fit(const double complex *lambda, int count, double tau, const struct matrix *Y,
                                struct matrix *fit, struct synthesis *out, struct modal_error *err)
{
    int n = poles_order(lambda, count, tau), L = Y->m;
    struct synthesis s = { .poles = count, .order = n, .rows = L, .channels = Y->n, .condition = 1 };
    struct matrix basis = { L, n, L, malloc(sizeof(double) * ((size_t)L * n + 1)) };
    struct factors f = { { 0 }, { 0 }, NULL, NULL, NULL };
    double *work = malloc(sizeof *work * BLOCK * ((size_t)2 * n + L + 1));
    enum modal_status rc = MODAL_OK;

    s.coefficient = calloc((size_t)count * Y->n + 1, sizeof *s.coefficient);
    s.reference = calloc((size_t)count + 1, sizeof *s.reference);
    s.channel_residual = calloc((size_t)Y->n + 1, sizeof *s.channel_residual);
    if (basis.x == NULL || work == NULL || s.coefficient == NULL || s.reference == NULL || s.channel_residual == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "synthesis: no memory for %d poles in %d channels", count, Y->n);
        goto out;
    }
    synthesis_basis(lambda, count, tau, &basis, s.reference);
    rc = factorise(&basis, &f, &s, err);
    if (rc != MODAL_OK)
        goto out;
    for (int first = 0; first < Y->n; first += BLOCK)
        fit_block(lambda, tau, Y, first, Y->n - first < BLOCK ? Y->n - first : BLOCK, &f, work, fit, &s);
    s.residual = safe_norm(s.channel_residual, Y->n);
    *out = s;
    memset(&s, 0, sizeof s);
out:
    synthesis_done(&s);
    factors_done(&f);
    free(work);
    free(basis.x);
    return rc;
}
