/*
 * projection.c - one decomposition of H0 serves every rank, and the error bars
 *
 * With U^T H0 = S V^T and W = U^T H1 (k x n) the multipliers of rank r are the eigenvalues of
 *
 *     Qhat = W_r (S_r V_r^T)^+ = W_r V_r S_r^{-1},                                              (1)
 *
 * least squares over the n columns.  Leaving columns out gives the jackknife; exchanging the two
 * factors,
 *
 *     X (W_r) = S_r V_r^T,   multipliers 1/eig(X),                                              (2)
 *
 * time reversed.  Noise in the right factor biases (1) towards more damping and (2) towards less,
 * so the two bracket the truth; method.md found the larger difference to be of the size of the
 * error in every case tried.
 *
 * W needs one product: column l of H1 is column l+1 of H0, so U^T h1_l = (S V^T)_{l+1}, and only
 * the last column is new.
 */
#include "modal/identify/linear/projection.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/pencil.h"
#include "modal/identify/linear/transition.h"
#include "modal/linalg/eigen.h"
#include "modal/linalg/lanczos.h"
#include "modal/linalg/least_squares.h"
#include "modal/linalg/svd.h"

enum {
    DENSE_SIDE = 128,               /* up to it all triplets are made, without iteration */
    ANGLES = 16                     /* poles at a time: one read of the vectors serves them all */
};

void projection_done(struct projection *p)
{
    free(p->s);
    free(p->VT.x);
    free(p->W.x);
    free(p->G.x);
    memset(p, 0, sizeof *p);
}

static enum modal_status operator_apply(void *context, const double *x, double *y,
                                        struct modal_error *err)
{
    (void)err;
    hankel_apply(context, x, y);
    return MODAL_OK;
}

static enum modal_status operator_apply_transpose(void *context, const double *y, double *x,
                                                  struct modal_error *err)
{
    (void)err;
    hankel_apply_transpose(context, y, x);
    return MODAL_OK;
}

static enum modal_status decompose_dense(const struct hankel *h, struct projection *p,
                                         struct matrix *U, struct modal_error *err)
{
    struct matrix A = matrix_new(p->m, p->n);
    enum modal_status rc;

    if (A.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY,
                          "projection: no memory for a Hankel matrix of %d x %d", p->m, p->n);
    hankel_form(h, &A);
    rc = svd_thin(&A, p->s, U, &p->VT, err);
    p->count = p->VT.m;
    free(A.x);
    return rc;
}

/* Columns one sample apart are correlations, done by FFT; further apart there are few of them, and
 * direct sums serve. */
static enum modal_status decompose_leading(const struct hankel *h, struct projection *p,
                                           struct matrix *U, struct modal_error *err)
{
    struct matrix Y = { h->rows + h->columns - 1, h->Y->n, h->Y->ld, h->Y->x + h->start };
    struct linear_operator A = { p->m, p->n, (void *)h, operator_apply, operator_apply_transpose };
    struct lanczos_options opt = { .wanted = U->n };
    struct lanczos_result result;
    struct hankel_operator *fast = NULL;
    enum modal_status rc =
        h->shift == 1 ? hankel_operator_new(&Y, h->rows, &fast, &A, err) : MODAL_OK;

    if (rc == MODAL_OK)
        rc = lanczos_svd(&A, &opt, p->s, U, &p->VT, &result, err);
    p->count = rc == MODAL_OK ? result.count : 0;
    hankel_operator_done(fast);
    return rc;
}

/* W and G from the triplets. */
static enum modal_status project(const struct hankel *h, const struct matrix *U,
                                 struct projection *p, struct modal_error *err)
{
    int k = p->count, n = p->n;
    double *last = malloc(sizeof *last * (p->m + 1));

    p->W = matrix_new(k, n);
    p->G = matrix_new(k, k);
    if (last == NULL || p->W.x == NULL || p->G.x == NULL) {
        free(last);
        return modal_fail(err, MODAL_NO_MEMORY, "projection: no memory for rank %d", k);
    }
    for (int l = 0; l + 1 < n; l++)
        for (int i = 0; i < k; i++)
            /* U^T H1 without its product: column l of H1 is column l + 1 of H0 */
            p->W.x[i + (size_t)l * k] = p->s[i] * p->VT.x[i + (size_t)(l + 1) * p->VT.ld];
    matrix_copy(h->rows, h->Y->n, h->Y->x + h->start + (size_t)n * h->shift, h->Y->ld, last,
                h->rows);
    if (k > 0) {
        /* but for H1's last column, which H0 has not */
        cblas_dgemv(CblasColMajor, CblasTrans, p->m, k, 1, U->x, U->ld, last, 1, 0,
                    p->W.x + (size_t)(n - 1) * k, 1);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, k, k, n, 1, p->W.x, k, p->VT.x,
                    p->VT.ld, 0, p->G.x, k);
    }
    free(last);
    return MODAL_OK;
}

enum modal_status projection_make(const struct hankel *h, int wanted, struct projection *out,
                                  struct modal_error *err)
{
    int m = h->rows * h->Y->n, n = h->columns, side = m < n ? m : n,
        room = side <= DENSE_SIDE || wanted > side ? side : wanted;
    struct projection p = { .m = m, .n = n };
    struct matrix U = matrix_new(m, room);
    enum modal_status rc = MODAL_OK;

    p.s = calloc((size_t)room + 1, sizeof *p.s);
    p.VT = matrix_new(room, n);
    if (U.x == NULL || p.s == NULL || p.VT.x == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "projection: no memory for %d triplets of %d x %d",
                        room, m, n);
    if (rc == MODAL_OK)
        rc = side <= DENSE_SIDE ? decompose_dense(h, &p, &U, err)
                                : decompose_leading(h, &p, &U, err);
    if (rc == MODAL_OK)
        rc = project(h, &U, &p, err);
    free(U.x);
    if (rc != MODAL_OK)
        projection_done(&p);
    else
        *out = p;
    return rc;
}

enum modal_status projection_poles(const struct projection *p, enum identify_method method, int r,
                                   double tau, double complex *lambda, int *count, int *dropped,
                                   struct modal_error *err)
{
    struct transition t = { p->count, p->s, p->G.x };
    double complex *rho = malloc(sizeof *rho * (r + 1));
    enum modal_status rc;

    if (rho == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "projection: no memory for rank %d", r);
    rc = transition_multipliers(&t, method, r, rho, err);
    if (rc == MODAL_OK)
        /* |rho| below eps^2 decays past rounding within a step */
        *count = poles_of_multipliers(rho, r, tau, DBL_EPSILON * DBL_EPSILON, lambda, dropped);
    free(rho);
    return rc;
}

static bool all_finite(const double *x, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!isfinite(x[i]))
            return false;
    return true;
}

/* Eigenvalues of X with X R = L in least squares over columns [first, last): X^T = (R^T)^+ L^T.  R
 * = left, right factors r x n. Where what is left of R has lost its rank X is not finite: then
 * every rho is infinite. */
static enum modal_status solve_pair(const struct matrix *right, const struct matrix *left, int r,
                                    int first, int last, double complex *rho,
                                    struct modal_error *err)
{
    int n = last - first, room = n > r ? n : r;
    double *block = malloc(sizeof *block * ((size_t)n * r + (size_t)room * r + (size_t)r * r));
    struct matrix A = { n, r, n, block }, B = { n, r, room, block + (size_t)n * r },
                  X = { r, r, r, B.x + (size_t)room * r };
    enum modal_status rc;

    if (block == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "projection: no memory for %d columns of rank %d",
                          n, r);
    for (int i = 0; i < r; i++)
        for (int l = 0; l < n; l++) {
            A.x[l + (size_t)i * n] = right->x[i + (size_t)(first + l) * right->ld];
            B.x[l + (size_t)i * room] = left->x[i + (size_t)(first + l) * left->ld];
        }
    rc = least_squares_solve(&A, &B, err);
    for (int i = 0; i < r && rc == MODAL_OK; i++)
        for (int j = 0; j < r; j++)
            X.x[i + (size_t)j * r] = B.x[j + (size_t)i * room];
    if (rc == MODAL_OK && all_finite(X.x, (size_t)r * r))
        rc = eigen_general(&X, rho, NULL, NULL, err);
    else
        for (int i = 0; i < r; i++)
            rho[i] = CMPLX(HUGE_VAL, 0);
    free(block);
    return rc;
}

static void widen(const double complex *rho, int r, bool inverse, const double complex *lambda,
                  int count, double tau, double *bar)
{
    for (int j = 0; j < count; j++) {
        double complex at = multiplier_of(lambda[j], tau);
        double nearest = HUGE_VAL;
        for (int i = 0; i < r; i++) {
            if (!isfinite(creal(rho[i])) || (inverse && rho[i] == 0))
                continue;      /* no multiplier there: what has none near it is known to no digit */
            /* spectra are compared as sets: no order survives another least squares */
            nearest = fmin(nearest, cabs((inverse ? 1 / rho[i] : rho[i]) - at));
        }
        if (nearest > bar[j])       /* the worst of all three */
            bar[j] = nearest;
    }
}

enum modal_status projection_bars(const struct projection *p, int r, int left_out, double tau,
                                  const double complex *lambda, int count, double *bar,
                                  struct modal_error *err)
{
    struct matrix SV = matrix_new(p->count, p->n);
    double complex *rho = malloc(sizeof *rho * (r + 1));
    enum modal_status rc = MODAL_OK;

    if (SV.x == NULL || rho == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "projection: no memory for rank %d", r);
    for (int l = 0; l < p->n && rc == MODAL_OK; l++)
        for (int i = 0; i < p->count; i++)
            SV.x[i + (size_t)l * SV.ld] = p->s[i] * p->VT.x[i + (size_t)l * p->VT.ld];
    for (int j = 0; j < count; j++)
        bar[j] = p->n - left_out >= r ? 0 : NAN;
    if (p->n - left_out < r)
        goto out;                            /* nothing can be left out: the bars stay unknown */
    if (rc == MODAL_OK) {
        /* without the first columns, and below without the last: what moves with them is not
         * known */
        rc = solve_pair(&SV, &p->W, r, left_out, p->n, rho, err);
        if (rc == MODAL_OK)
            widen(rho, r, false, lambda, count, tau, bar);
        if (rc == MODAL_OK)
            rc = solve_pair(&SV, &p->W, r, 0, p->n - left_out, rho, err);
        if (rc == MODAL_OK)
            widen(rho, r, false, lambda, count, tau, bar);
    }
    if (rc == MODAL_OK)
        /* the pair the other way round: eigenvalues 1 / rho, other errors from the same noise */
        rc = solve_pair(&p->W, &SV, r, 0, p->n, rho, err);
    if (rc == MODAL_OK)
        widen(rho, r, true, lambda, count, tau, bar);
out:
    free(rho);
    free(SV.x);
    return rc;
}

/* The same of no more than ANGLES poles: real parts in even columns of Z, imaginary ones in odd. */
static void angles_of(const struct matrix *VT, int r, const double complex *lambda, int count,
                      double tau, double *Z, double *C, double *angle)
{
    int n = VT->n;

    for (int j = 0; j < count; j++) {
        double a = creal(lambda[j]) * tau, b = cimag(lambda[j]) * tau,
               top = a > 0 ? a * (n - 1) : 0, *z = Z + 2 * (size_t)j * (size_t)n;
        for (int l = 0; l < n; l++) {
            double e = exp(a * l - top);
            z[l] = e * cos(b * l), z[n + l] = e * sin(b * l);
        }
        angle[j] = cblas_ddot(2 * n, z, 1, z, 1);
    }
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, r, 2 * count, n, 1, VT->x, VT->ld, Z, n,
                0, C, r);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, 2 * count, r, -1, VT->x, VT->ld, C, r,
                1, Z, n);
    for (int j = 0; j < count; j++) {
        const double *z = Z + 2 * (size_t)j * (size_t)n;
        angle[j] = angle[j] > 0 ? sqrt(cblas_ddot(2 * n, z, 1, z, 1) / angle[j]) : NAN;
    }
}

void projection_angles(const struct matrix *VT, int r, const double complex *lambda, int count,
                       double tau, double *angle)
{
    size_t columns = 2 * (size_t)(count < ANGLES ? count : ANGLES), n = (size_t)VT->n;
    double *Z = malloc(sizeof *Z * (columns * (n + (size_t)r) + 1));

    for (int j = 0; j < count; j += ANGLES) {
        int some = count - j < ANGLES ? count - j : ANGLES;
        if (Z != NULL)
            angles_of(VT, r, lambda + j, some, tau, Z, Z + columns * n, angle + j);
        for (int i = j; i < j + some && Z == NULL; i++)
            angle[i] = NAN;
    }
    free(Z);
}
