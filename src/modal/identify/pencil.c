/*
 * pencil.c - the matrix pencil on FFT Hankel products
 *
 * Block s of H is H_s[i, l] = y_s[i + l], i = 0..m-1, l = 0..n-1, n = L - m + 1.  Its products are
 * correlations,
 *
 *     (H_s x)[i] = sum_l y_s[i + l] x[l],       (H_s^T u)[l] = sum_i y_s[i + l] u[i],           (1)
 *
 * and, since i + l <= L - 1, circular ones of any length N >= L: by FFT in O(S N log N) instead of
 * O(S m n).  The leading triplets come from Lanczos on (1).  The row space of H is that of the
 * powers z_j^l, so that with V its basis
 *
 *     V2 = V1 Z,   V1 = V without the last row, V2 without the first,                           (2)
 *
 * has the multipliers as eigenvalues of Z = V1^+ V2 [HS90].  One QR V1 = Q R serves all orders:
 * leading r columns give
 *
 *     Z_r = R_r^{-1} (Q^T V2)_r.                                                                (3)
 *
 * Rounding in (1) is of the order DBL_EPSILON log2(N) |H|: singular values are right to that times
 * the largest, and a refinement on the signals themselves follows.
 *
 * [HS90] Hua and Sarkar, IEEE Trans. ASSP 38 (1990) 814-824.
 */
#include "modal/identify/pencil.h"
#include "modal/linalg/eigen.h"
#include <stdbool.h>
#include <complex.h>
#include <cblas.h>
#include <fftw3.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WANTED = 16 };              /* triplets where the options name no number */

struct hankel_operator {
    int L, S, m, n, N;
    double *x;                      /* N: a signal in time */
    fftw_complex *X, *sum, *Y;      /* N/2 + 1 each; Y: S of them, conjugated later */
    fftw_plan forward, backward;    /* x -> X, sum -> x */
};

int transform_length(int n)
{
    for (n = (n + 1) / 2 + ((n + 1) / 2 + 1) % 2;; n += 2) {
        int k = n;
        while (k % 3 == 0) k /= 3;
        while (k % 5 == 0) k /= 5;
        while (k % 7 == 0) k /= 7;
        if (k == 1)
            return 2 * n;
    }
}

void hankel_operator_done(struct hankel_operator *h)
{
    if (h == NULL)
        return;
    if (h->forward != NULL) fftw_destroy_plan(h->forward);
    if (h->backward != NULL) fftw_destroy_plan(h->backward);
    fftw_free(h->x), fftw_free(h->X), fftw_free(h->sum), fftw_free(h->Y);
    free(h);
}

/* X = FFT of COUNT numbers padded with zeros. */
static void transform(struct hankel_operator *h, const double *x, int count)
{
    memcpy(h->x, x, (size_t)count * sizeof *x);
    memset(h->x + count, 0, (size_t)(h->N - count) * sizeof *x);
    fftw_execute(h->forward);
}

/* A complex number, for the loop below: gcc does not see it in pairs of doubles. */
typedef double complex_pair __attribute__((vector_size(16), aligned(8), may_alias));

/* sum (+)= Y_s conj(X) */
static void correlate(struct hankel_operator *h, int s, bool add)
{
    const complex_pair *y = (const complex_pair *)(h->Y + (size_t)s * (size_t)(h->N / 2 + 1));
    const double *x = (const double *)h->X;
    complex_pair *sum = (complex_pair *)h->sum;

    for (int k = 0; k <= h->N / 2; k++) {
        complex_pair swapped = { y[k][1], y[k][0] }, re = { x[2 * k], x[2 * k] },
                     im = { x[2 * k + 1], -x[2 * k + 1] }, z = y[k] * re + swapped * im;
        if (add)
            z += sum[k];
        sum[k] = z;
    }
}

static enum modal_status apply(void *context, const double *x, double *y, struct modal_error *err)
{
    struct hankel_operator *h = context;

    (void)err;
    transform(h, x, h->n);
    for (int s = 0; s < h->S; s++) {
        correlate(h, s, false);
        fftw_execute(h->backward);
        memcpy(y + (size_t)s * (size_t)h->m, h->x, (size_t)h->m * sizeof *y);
    }
    return MODAL_OK;
}

static enum modal_status apply_transpose(void *context, const double *y, double *x,
                                         struct modal_error *err)
{
    struct hankel_operator *h = context;

    (void)err;
    for (int s = 0; s < h->S; s++) {
        transform(h, y + (size_t)s * (size_t)h->m, h->m);
        /* H^T y is a sum over signals, added as spectra: one transform back */
        correlate(h, s, s > 0);
    }
    fftw_execute(h->backward);
    memcpy(x, h->x, (size_t)h->n * sizeof *x);
    return MODAL_OK;
}

enum modal_status hankel_operator_new(const struct matrix *Y, int rows,
                                      struct hankel_operator **out, struct linear_operator *op,
                                      struct modal_error *err)
{
    struct hankel_operator *h = NULL;
    size_t half;

    if (Y->m < 2 || Y->n < 1 || rows < 1 || rows >= Y->m)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rows",
                                "%d rows of %d samples; accepted: 1 to %d", rows, Y->m, Y->m - 1);
    h = calloc(1, sizeof *h);
    if (h == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory");
    h->L = Y->m, h->S = Y->n, h->m = rows, h->n = Y->m - rows + 1, h->N = transform_length(Y->m);
    half = (size_t)h->N / 2 + 1;
    h->x = fftw_alloc_real((size_t)h->N), h->X = fftw_alloc_complex(half),
    h->sum = fftw_alloc_complex(half);
    h->Y = fftw_alloc_complex(half * (size_t)h->S);
    if (h->x != NULL && h->X != NULL && h->sum != NULL) {
        h->forward = fftw_plan_dft_r2c_1d(h->N, h->x, h->X, FFTW_ESTIMATE);
        h->backward = fftw_plan_dft_c2r_1d(h->N, h->sum, h->x, FFTW_ESTIMATE);
    }
    if (h->Y == NULL || h->forward == NULL || h->backward == NULL) {
        hankel_operator_done(h);
        return modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory for %d transforms of %d", Y->n,
                          Y->m);
    }
    for (int s = 0; s < h->S; s++) {
        /* N >= L: H's sums are correlations that do not wrap */
        transform(h, Y->x + (size_t)s * (size_t)Y->ld, h->L);
        for (size_t k = 0; k < half; k++)         /* 1/N of the transforms to come */
            h->Y[(size_t)s * half + k] = h->X[k] / h->N;
    }
    *op = (struct linear_operator) { h->S * h->m, h->n, h, apply, apply_transpose };
    *out = h;
    return MODAL_OK;
}

/* (2), (3): R and W from V^T (count x n). */
static enum modal_status factor(struct pencil *p, const struct matrix *VT, struct modal_error *err)
{
    int k = p->count, n = VT->n;
    size_t entries = (size_t)(n - 1) * (size_t)k;
    double *V1 = malloc(2 * entries * sizeof *V1 + (size_t)k * sizeof *V1), *V2 = V1 + entries,
           *tau = V2 + entries;
    enum modal_status rc = MODAL_OK;

    if (V1 == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory for %d vectors of %d", k, n);
    for (int j = 0; j < k; j++)
        for (int l = 0; l < n - 1; l++) {
            V1[l + (size_t)j * (size_t)(n - 1)] = VT->x[j + (size_t)l * (size_t)VT->ld];
            V2[l + (size_t)j * (size_t)(n - 1)] = VT->x[j + (size_t)(l + 1) * (size_t)VT->ld];
        }
    if (LAPACKE_dgeqrf(LAPACK_COL_MAJOR, n - 1, k, V1, n - 1, tau) != 0
        || LAPACKE_dormqr(LAPACK_COL_MAJOR, 'L', 'T', n - 1, k, k, V1, n - 1, tau, V2, n - 1) != 0)
        rc = modal_fail(err, MODAL_NO_MEMORY, "pencil: QR of %d x %d", n - 1, k);
    for (int j = 0; j < k && rc == MODAL_OK; j++)
        for (int i = 0; i < k; i++) {
            p->R[i + j * k] = i <= j ? V1[i + (size_t)j * (size_t)(n - 1)] : 0;
            p->W[i + j * k] = V2[i + (size_t)j * (size_t)(n - 1)];
        }
    free(V1);
    return rc;
}

/* Sum of squares of H: sample l lies on min(l + 1, m, n, L - l) of its entries. */
static double hankel_energy(const struct matrix *Y, int m, int n)
{
    double sum = 0;
    int less = m < n ? m : n;

    for (int c = 0; c < Y->n; c++)
        for (int l = 0; l < Y->m; l++) {
            double y = Y->x[l + (size_t)c * (size_t)Y->ld];
            int times = l + 1 < Y->m - l ? l + 1 : Y->m - l;  /* the length of antidiagonal l */
            sum += y * y * (times < less ? times : less);
        }
    return sum;
}

int pencil_signals(const struct pencil *p)
{
    double rest = p->energy, edge;
    int count = 0;

    for (int i = 0; i < p->count; i++)
        rest -= p->s[i] * p->s[i];
    /* mean square of what the triplets leave of H */
    rest = fmax(rest, 0) / ((double)p->height * p->columns);
    /* pod.c's (1); a Hankel matrix of noise has dependent entries, and a margin for that */
    edge = PENCIL_EDGE * sqrt(rest) * (sqrt(p->height) + sqrt(p->columns));
    while (count < p->count && p->s[count] > edge)
        count++;
    return count;
}

enum modal_status pencil_new(const struct matrix *Y, const struct pencil_options *opt,
                             struct pencil *out, struct modal_error *err)
{
    int rows = opt != NULL && opt->rows > 0 ? opt->rows : (Y->m + 2) / 3,
        wanted = opt != NULL && opt->wanted > 0 ? opt->wanted : WANTED;
    struct pencil p = { .rows = rows };
    struct hankel_operator *h = NULL;
    struct linear_operator op;
    struct matrix VT = { 0 }, none = { 0 };
    struct lanczos_result found;
    enum modal_status rc = hankel_operator_new(Y, rows, &h, &op, err);

    if (rc != MODAL_OK)
        return rc;
    p.columns = op.n, p.height = op.m;
    p.energy = hankel_energy(Y, rows, op.n);
    wanted = wanted < op.m ? wanted : op.m;
    wanted = wanted < op.n - 1 ? wanted : op.n - 1;  /* (2) has a row less */
    wanted = wanted < 1 ? 1 : wanted;
    VT = matrix_new(wanted, op.n);
    p.s = calloc((size_t)wanted, sizeof *p.s);
    p.R = calloc((size_t)wanted * (size_t)wanted, sizeof *p.R),
    p.W = calloc((size_t)wanted * (size_t)wanted, sizeof *p.W);
    if (VT.x == NULL || p.s == NULL || p.R == NULL || p.W == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory for %d triplets of %d x %d",
                        wanted, op.m, op.n);
        goto out;
    }
    /* Any tolerance is met at once: strong triplets have converged by then, and noise has none
     * worth waiting for. */
    rc = lanczos_svd(&op, &(struct lanczos_options){ .wanted = wanted, .tolerance = HUGE_VAL }, p.s,
                     &none, &VT, &found, err);
    if (rc != MODAL_OK)
        goto out;
    p.count = found.count, p.steps = found.steps;
    if (p.count > 0)
        rc = factor(&p, &VT, err);
    if (rc != MODAL_OK)
        goto out;
    p.VT = VT;
    p.VT.m = p.count;
    VT.x = NULL;
    *out = p;
    p = (struct pencil) { 0 };
out:
    pencil_done(&p);
    free(VT.x);
    hankel_operator_done(h);
    return rc;
}

void pencil_done(struct pencil *p)
{
    free(p->s), free(p->R), free(p->W), free(p->VT.x);
    *p = (struct pencil) { 0 };
}

enum modal_status pencil_multipliers(const struct pencil *p, int r, double complex *rho,
                                     struct modal_error *err)
{
    struct matrix Z = { r, r, r, NULL };
    enum modal_status rc;

    if (r < 1 || r > p->count)
        return modal_fail(err, MODAL_BAD_INPUT, "pencil: order %d; accepted: 1 to %d", r, p->count);
    Z.x = malloc(sizeof *Z.x * (size_t)r * (size_t)r);
    if (Z.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory for order %d", r);
    matrix_copy(r, r, p->W, p->count, Z.x, r);
    /* (3) */
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, r, r, 1, p->R,
                p->count, Z.x, r);
    rc = eigen_general(&Z, rho, NULL, NULL, err);
    free(Z.x);
    return rc;
}
