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
 * V has orthonormal columns, so that with v its last row
 *
 *     R^T R = V1^T V1 = I - v v^T,   Q^T V2 = R^{-T} V1^T V2                                    (5)
 *
 * cost two products of V with itself: V1^T V1 is summed, for V is orthonormal to its rounding
 * alone, and weak multipliers of exact data need that as well. That is made of a large V, for which
 * the QR takes copies and time. Where v has much of the norm of some column, as of a motion that
 * grows, (5) would lose digits, and the QR is made.
 *
 * Of few rows with many signals, as a record folded by its period has, the products of rows cost
 * less: with K = Y Y^T
 *
 *     (H^T H)[l, k] = sum_{i=0..m-1} K[l + i, k + i],                                (4)
 *
 * n x n whatever S is, whose eigenvectors are V, and whose eigenvalues s^2.
 *
 * Rounding in (1) is of the order DBL_EPSILON log2(N) |H|: singular values are right to that times
 * the largest, and a refinement on the signals themselves follows.
 *
 * [HS90] Hua and Sarkar, IEEE Trans. ASSP 38 (1990) 814-824.
 */
#include "modal/identify/linear/pencil.h"
#include "modal/linalg/eigen.h"
#include <stdbool.h>
#include <complex.h>
#include <cblas.h>
#include <fftw3.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    WANTED = 16,                   /* triplets where the options name no number */
    PRODUCTS_ROWS = 1024,          /* of K at most: 8 MB, beyond the caches */
    PRODUCTS_SHARE = 8,            /* rows over columns, at most, where products pay: a transform
                                    * costs some ten times its length */
    V_LARGE = 1 << 20,             /* entries of V from which on (5) is made: 8 MB, as above */
    WHOLE_SHARE = 4                /* of one in so many eigenvectors all are had for less */
};
static const double LAST_MOST = 0.5;    /* of a column's square in its last row: a bit is lost */
/* Of the edge: noise turns the vector of value s by edge / s, and what is left of an iteration by
 * residual / s; a tenth of that adds a hundredth to the square of the error. */
static const double WITHIN = 0.1;
static const double ROUNDING = 1e-14;   /* of the largest value: no residual need be smaller */
enum { STEPS_MOST = 4 };                /* steps a triplet: what has not converged by then lies
                                         * among others as strong, and either is as good */

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

static enum modal_status check_rows(const struct matrix *Y, int rows, struct modal_error *err)
{
    if (Y->m < 2 || Y->n < 1 || rows < 1 || rows >= Y->m)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rows",
                                "%d rows of %d samples; accepted: 1 to %d", rows, Y->m, Y->m - 1);
    return MODAL_OK;
}

enum modal_status hankel_operator_new(const struct matrix *Y, int rows,
                                      struct hankel_operator **out, struct linear_operator *op,
                                      struct modal_error *err)
{
    struct hankel_operator *h = NULL;
    size_t half;

    enum modal_status rc = check_rows(Y, rows, err);

    if (rc != MODAL_OK)
        return rc;
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

/* R and W of (3) from V^T (count x n), by the QR. */
static enum modal_status factor_by_qr(struct pencil *p, const struct matrix *VT,
                                      struct modal_error *err)
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

/* The same by (5). */
static enum modal_status factor(struct pencil *p, const struct matrix *VT, struct modal_error *err)
{
    int k = p->count, n = VT->n;
    const double *v = VT->x + (size_t)(n - 1) * (size_t)VT->ld;

    /* 1 - |v|^2 is the least eigenvalue of (5) */
    if ((double)n * k < V_LARGE || cblas_ddot(k, v, 1, v, 1) > LAST_MOST)
        return factor_by_qr(p, VT, err);
    cblas_dsyrk(CblasColMajor, CblasUpper, CblasNoTrans, k, n - 1, 1, VT->x, VT->ld, 0, p->R, k);
    if (LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'U', k, p->R, k) != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "pencil: vectors are not orthonormal");
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, k, k, n - 1, 1, VT->x, VT->ld,
                VT->x + VT->ld, VT->ld, 0, p->W, k);
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, k, k, 1, p->R, k,
                p->W, k);
    return MODAL_OK;
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

bool pencil_products_pay(int rows, int columns)
{
    return rows <= PRODUCTS_ROWS && rows <= PRODUCTS_SHARE * columns;
}

enum modal_status pencil_products(const struct matrix *Y, struct matrix *out,
                                  struct modal_error *err)
{
    size_t L = (size_t)Y->m;

    *out = (struct matrix) { Y->m, Y->m, Y->m, calloc(L * L + 1, sizeof *out->x) };
    if (out->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory for %d rows", Y->m);
    cblas_dsyrk(CblasColMajor, CblasLower, CblasNoTrans, Y->m, Y->n, 1, Y->x, Y->ld, 0, out->x,
                Y->m);
    return MODAL_OK;
}

/* (4), both triangles; its trace is the energy of H. */
static void sum_products(const struct matrix *K, int m, struct matrix *G)
{
    for (int d = 0; d < G->n; d++) {
        double sum = 0;
        for (int i = 0; i < m; i++)
            sum += K->x[i + d + (size_t)i * (size_t)K->ld];
        for (int l = 0; l + d < G->n; l++) {
            size_t out = (size_t)l, in = (size_t)(l + m);
            G->x[l + d + out * (size_t)G->ld] = G->x[out + (size_t)(l + d) * (size_t)G->ld] = sum;
            if (l + d + 1 < G->n)
                sum += K->x[in + (size_t)d + in * (size_t)K->ld]
                     - K->x[out + (size_t)d + out * (size_t)K->ld];
        }
    }
}

/* The leading WANTED eigenvectors of G, destroyed, and the roots of their values. */
static enum modal_status leading(struct matrix *G, int wanted, double *s, struct matrix *VT,
                                 struct lanczos_result *found, struct modal_error *err)
{
    struct linear_operator op = dense_operator(G);
    struct matrix none = { 0 };
    int n = G->n;
    double *all;
    enum modal_status rc;

    if (WHOLE_SHARE * wanted < n) {
        rc = lanczos_svd(&op, &(struct lanczos_options){ .wanted = wanted, .tolerance = HUGE_VAL },
                         s, &none, VT, found, err);
        for (int j = 0; j < found->count && rc == MODAL_OK; j++)
            s[j] = sqrt(s[j]);
        return rc;
    }
    all = calloc((size_t)n, sizeof *all);
    rc = all == NULL ? modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory for %d values", n)
                     : eigen_symmetric(G, all, err);
    for (int j = 0; j < wanted && rc == MODAL_OK; j++) {
        s[j] = sqrt(fmax(all[n - 1 - j], 0));
        for (int l = 0; l < n; l++)
            VT->x[j + (size_t)l * (size_t)VT->ld] = G->x[l + (size_t)(n - 1 - j) * (size_t)G->ld];
    }
    *found = (struct lanczos_result) { wanted, n, 0 };
    free(all);
    return rc;
}

/* The triplets by (4); *energy: that of H. */
static enum modal_status triplets_of_products(const struct matrix *K, int m, int wanted,
                                              struct pencil *p, struct matrix *VT,
                                              struct lanczos_result *found,
                                              struct modal_error *err)
{
    struct matrix G = { p->columns, p->columns, p->columns,
                        malloc(sizeof(double) * (size_t)p->columns * (size_t)p->columns) };
    enum modal_status rc;

    if (G.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory for %d columns", G.n);
    sum_products(K, m, &G);
    p->energy = 0;
    for (int l = 0; l < G.n; l++)
        p->energy += G.x[l + (size_t)l * (size_t)G.ld];
    rc = leading(&G, wanted, p->s, VT, found, err);
    free(G.x);
    return rc;
}

/* The edge of noise, of what the COUNT triplets of P leave of H. */
static double edge_of(const struct pencil *p, int count)
{
    double rest = p->energy;

    for (int i = 0; i < count; i++)
        rest -= p->s[i] * p->s[i];
    /* mean square of what the triplets leave of H */
    rest = fmax(rest, 0) / ((double)p->height * p->columns);
    /* pod.c's (1); a Hankel matrix of noise has dependent entries, and a margin for that */
    return PENCIL_EDGE * sqrt(rest) * (sqrt(p->height) + sqrt(p->columns));
}

int pencil_signals(const struct pencil *p)
{
    double edge = edge_of(p, p->count);
    int count = 0;

    while (count < p->count && p->s[count] > edge)
        count++;
    return count;
}

/* Have the leading SURE of COUNT triplets converged, as far as they are no noise? */
static bool converged(const struct pencil *p, const double *residuals, int count, int sure)
{
    double edge = edge_of(p, count), most;

    if (count < 1)
        return true;
    most = fmax(WITHIN * edge, ROUNDING * p->s[0]);
    for (int i = 0; i < sure && i < count && p->s[i] > edge; i++)
        if (residuals[i] > most)
            return false;
    return true;
}

/* RUN goes on until `sure` triplets have converged. */
static enum modal_status make_sure(struct lanczos **run, const struct linear_operator *op,
                                   struct lanczos_options *how, int sure, struct pencil *p,
                                   struct modal_error *err)
{
    struct matrix none = { 0 };
    struct lanczos_result found;
    enum modal_status rc = MODAL_OK;

    how->residuals = calloc((size_t)how->wanted, sizeof *how->residuals);
    if (how->residuals == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory for %d values", how->wanted);
    do {
        rc = lanczos_more(run, op, how, p->s, &none, &none, &found, err);
        if (rc != MODAL_OK || found.steps < how->least
            || converged(p, how->residuals, found.count, sure))
            break;
        how->least = found.steps + how->wanted / 8 + 4;
    } while (how->least <= STEPS_MOST * how->wanted);
    free(how->residuals), how->residuals = NULL;
    how->least = 0;
    return rc;
}

/* The same by (1). Any tolerance is met at once: strong triplets have converged by then, and noise
 * has none worth waiting for. */
static enum modal_status triplets_of_signals(const struct matrix *Y, int m, int wanted,
                                             const struct pencil_options *opt, struct pencil *p,
                                             struct matrix *VT, struct lanczos_result *found,
                                             struct modal_error *err)
{
    struct hankel_operator *h = NULL;
    struct lanczos *own = NULL, **run = opt != NULL && opt->run != NULL ? opt->run : &own;
    struct linear_operator op;
    struct matrix none = { 0 };
    struct lanczos_options how = { .wanted = wanted, .tolerance = HUGE_VAL };
    enum modal_status rc = hankel_operator_new(Y, m, &h, &op, err);

    p->energy = hankel_energy(Y, m, p->columns);
    if (rc == MODAL_OK && opt != NULL && opt->sure > 0)
        rc = make_sure(run, &op, &how, opt->sure, p, err);
    if (rc == MODAL_OK)
        rc = lanczos_more(run, &op, &how, p->s, &none, VT, found, err);
    lanczos_free(own);
    hankel_operator_done(h);
    return rc;
}

enum modal_status pencil_new(const struct matrix *Y, const struct pencil_options *opt,
                             struct pencil *out, struct modal_error *err)
{
    int rows = opt != NULL && opt->rows > 0 ? opt->rows : (Y->m + 2) / 3,
        wanted = opt != NULL && opt->wanted > 0 ? opt->wanted : WANTED, n = Y->m - rows + 1;
    const struct matrix *K = opt != NULL ? opt->products : NULL;
    struct pencil p = { .rows = rows, .columns = n, .height = Y->n * rows };
    struct matrix VT = { 0 };
    struct lanczos_result found;
    enum modal_status rc = check_rows(Y, rows, err);

    if (rc != MODAL_OK)
        return rc;
    wanted = wanted < p.height ? wanted : p.height;
    wanted = wanted < n - 1 ? wanted : n - 1;        /* (2) has a row less */
    wanted = wanted < 1 ? 1 : wanted;
    VT = matrix_new(wanted, n);
    p.s = calloc((size_t)wanted, sizeof *p.s);
    p.R = calloc((size_t)wanted * (size_t)wanted, sizeof *p.R),
    p.W = calloc((size_t)wanted * (size_t)wanted, sizeof *p.W);
    if (VT.x == NULL || p.s == NULL || p.R == NULL || p.W == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "pencil: no memory for %d triplets of %d x %d",
                        wanted, p.height, n);
        goto out;
    }
    rc = K != NULL ? triplets_of_products(K, rows, wanted, &p, &VT, &found, err)
                   : triplets_of_signals(Y, rows, wanted, opt, &p, &VT, &found, err);
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
