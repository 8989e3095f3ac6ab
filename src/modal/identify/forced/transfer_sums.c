/*
 * transfer_sums.c - see transfer_sums.h
 *
 * Columns.  A pair's part is real-linear in the real and imaginary part of phi q, with the columns
 * f + g and i (f - g) of f = W/(z - r), g = W/(z - conj r), r = e^s; moving s moves f by
 * r W/(z - r)^2 ds.  These four for each pole and drive and the direct columns are C; all that a
 * step needs are its products G = C^T C and B = C^T Y (real parts), taken block by block.
 *
 * Elimination.  For given s and q a response is linear in its phi and D, whose columns V are sums
 * of those of C, the same for all responses: x = (V^T V)^-1 V^T Y.  With P the projection off V and
 * T_i the directions in C that s and q move response i in, the step solves
 *
 *     S d = sum_i w_i T_i^T C^T (Y_i - V x_i),    S = sum_i w_i T_i^T C^T P C T_i,      (1)
 *
 * w_i = 1/v_i, and S^-1 is the covariance of s and q: the bound's, shapes and direct terms unknown.
 * A number that is linear in x_i by the row v, and moves by the row c of C as s and q move, has the
 * variance
 *
 *     v_i |v|^2_(V^T V)^-1 + |T_i^T (c - C^T V (V^T V)^-1 v)|^2_S^-1.                  (2)
 */
#include "modal/identify/forced/transfer_sums.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/eigen.h"

enum {
    EIGEN = 16                   /* n^3 of these: what eigenvalues and vectors of n take */
};
static const double
    DEPENDENT = 1e-11;           /* of the largest eigenvalue: directions of V that are others */

/* ---- columns ---- */

void sums_put(double *column, int rows, int n, double complex value)
{
    column[n] = creal(value);
    column[n + rows] = cimag(value);
}

void sums_columns(const struct lines *l, const struct transfer *t, int first, int rows, double *C)
{
    size_t ld = 2 * (size_t)rows;

    for (int p = 0; p < t->poles; p++) {
        double complex r = cexp(t->s[p]), u = conj(r);
        for (int n = 0; n < rows; n++) {
            double complex z = l->z[first + n], a = 1 / (z - r), b = 1 / (z - u);
            double complex da = r * a * a, db = u * b * b;  /* d/ds of 1 / (z - e^s) */
            for (int j = 0; j < l->drives; j++) {
                double complex w = l->W[first + n + (size_t)j * l->count];
                double *c = C + ld * SUMS_PARTS * ((size_t)p * l->drives + j);
                /* f + g of the text, by the real part of phi q, and by the imaginary one */
                sums_put(c, rows, n, w * (a + b));
                sums_put(c + ld, rows, n, I * w * (a - b));
                sums_put(c + 2 * ld, rows, n, w * (da + db));
                sums_put(c + 3 * ld, rows, n, I * w * (da - db));
            }
        }
    }
    for (int k = 0; k < l->direct; k++)
        for (int n = 0; n < rows; n++)
            sums_put(C + ld * (SUMS_PARTS * (size_t)t->poles * l->drives + k), rows, n,
                     l->X[first + n + (size_t)k * l->count]);
}

void sums_responses(const struct lines *l, int first, int rows, double *Y)
{
    for (int i = 0; i < l->responses; i++)
        for (int n = 0; n < rows; n++)
            sums_put(Y + 2 * (size_t)rows * i, rows, n, l->Y[first + n + (size_t)i * l->count]);
}

void sums_rows(const struct lines *l, const struct transfer *t, double complex z, int j,
               double complex *v, double complex *c)
{
    int V = 2 * t->poles, K = SUMS_PARTS * t->poles * l->drives;

    memset(c, 0, sizeof *c * (size_t)K);
    for (int p = 0; p < t->poles; p++) {
        double complex r = cexp(t->s[p]), u = conj(r), a = 1 / (z - r), b = 1 / (z - u);
        double complex q = t->q[j + (size_t)p * l->drives], w = 1 / l->size[j];
        double complex *own = c + SUMS_PARTS * ((size_t)p * l->drives + j);
        own[0] = w * (a + b), own[1] = I * w * (a - b);
        own[2] = w * (r * a * a + u * b * b), own[3] = I * w * (r * a * a - u * b * b);
        v[2 * p] = w * (q * a + conj(q) * b), v[2 * p + 1] = I * w * (q * a - conj(q) * b);
    }
    lines_direct(l, z, j, v + V);
    memcpy(c + K, v + V, sizeof *c * (size_t)l->direct);
}

void sums_mix(const struct lines *l, const struct transfer *t, struct sums *s)
{
    memset(s->Q, 0, sizeof *s->Q * (size_t)s->K * s->V);
    for (int p = 0; p < t->poles; p++)
        for (int j = 0; j < l->drives; j++) {
            double complex q = t->q[j + (size_t)p * l->drives];
            double *re = s->Q + SUMS_PARTS * ((size_t)p * l->drives + j) + (size_t)s->K * 2 * p;
            double *im = re + s->K;
            re[0] = creal(q), re[1] = cimag(q);
            im[0] = -cimag(q), im[1] = creal(q);
        }
    for (int k = 0; k < l->direct; k++)
        s->Q[SUMS_PARTS * t->poles * l->drives + k + (size_t)s->K * (2 * t->poles + k)] = 1;
}

/* ---- sums ---- */

enum modal_status sums_new(const struct lines *l, int poles, struct sums *s,
                           struct modal_error *err)
{
    size_t K = (size_t)(SUMS_PARTS * poles * l->drives + l->direct);
    size_t V = (size_t)(2 * poles + l->direct);
    size_t g = (size_t)(2 * poles * l->drives), R = (size_t)l->responses;

    *s = (struct sums) { .K = (int)K, .V = (int)V, .g = (int)g };
    s->G = workspace_zeros(&s->held, K * K, sizeof(double));
    s->B = workspace_zeros(&s->held, K * R, sizeof(double));
    s->GV = workspace_zeros(&s->held, K * V, sizeof(double));
    s->A = workspace_zeros(&s->held, V * V, sizeof(double));
    s->Q = workspace_zeros(&s->held, K * V, sizeof(double));
    s->S = workspace_zeros(&s->held, g * g, sizeof(double));
    s->d = workspace_zeros(&s->held, g, sizeof(double));
    s->block = workspace_zeros(&s->held, 2 * SUMS_BLOCK * (K + V + 2 * R), sizeof(double));
    return workspace_check(&s->held, "transfer: no memory for the sums over lines", err);
}

/* G and B. */
static void take_sums(const struct lines *l, const struct transfer *t, struct sums *s)
{
    int K = s->K;

    for (int first = 0; first < l->count; first += SUMS_BLOCK) {
        int rows = l->count - first < SUMS_BLOCK ? l->count - first : SUMS_BLOCK, two = 2 * rows;
        double *C = s->block, *Y = C + (size_t)two * K;
        sums_columns(l, t, first, rows, C);
        sums_responses(l, first, rows, Y);
        cblas_dsyrk(CblasColMajor, CblasUpper, CblasTrans, K, two, 1, C, two, first > 0, s->G, K);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, K, l->responses, two, 1, C, two, Y,
                    two, first > 0, s->B, K);
    }
    for (int c = 0; c < K; c++)
        for (int r = 0; r < c; r++)
            s->G[c + (size_t)r * K] = s->G[r + (size_t)c * K];
}

/* A := A^-1 on the directions that are there, columns over their norms. */
static enum modal_status invert(double *A, int n, struct modal_error *err)
{
    double *size = calloc((size_t)n + 1, sizeof *size), *w = calloc((size_t)n + 1, sizeof *w);
    double *V = calloc((size_t)n * n + 1, sizeof *V);
    enum modal_status rc = size != NULL && w != NULL && V != NULL
        ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "transfer: no memory for %d unknowns", n);

    for (int i = 0; i < n && rc == MODAL_OK; i++)
        /* units of columns are no condition */
        size[i] = A[i + (size_t)n * i] > 0 ? 1 / sqrt(A[i + (size_t)n * i]) : 0;
    for (int i = 0; i < n * n && rc == MODAL_OK; i++)
        V[i] = A[i] * size[i % n] * size[i / n];
    if (rc == MODAL_OK)
        rc = eigen_symmetric(&(struct matrix) { n, n, n, V }, w, err);
    if (rc == MODAL_OK) {
        memset(A, 0, sizeof *A * (size_t)n * n);
        for (int k = 0; k < n; k++)
            /* a pseudoinverse: columns that others make get no amplitude of their own */
            if (w[k] > DEPENDENT * w[n - 1])
                cblas_dger(CblasColMajor, n, n, 1 / w[k], V + (size_t)n * k, 1, V + (size_t)n * k,
                           1, A, n);
        for (int i = 0; i < n * n; i++)
            A[i] *= size[i % n] * size[i / n];
    }
    free(size), free(w), free(V);
    return rc;
}

/* ---- what they cost: multiplications of their products ---- */

static double work_of_measure(const struct lines *l, int poles)
{
    double K = SUMS_PARTS * poles * l->drives + l->direct, V = 2 * poles + l->direct;

    /* G of one triangle, B, the rest by V; then G Q and an eigenproblem of V */
    return 2.0 * l->count * (K * K / 2 + K * l->responses + K * V + V * l->responses)
         + K * K * V + EIGEN * V * V * V;
}

static double work_of_step(const struct lines *l, int poles)
{
    double K = SUMS_PARTS * poles * l->drives + l->direct, V = 2 * poles + l->direct;
    double g = 2 * poles * l->drives;

    return K * V * (K + V) + l->responses * K * g * (K + g) + g * g * g;
}

double transfer_work(const struct lines *l, int poles)
{
    return work_of_measure(l, poles) + work_of_step(l, poles);
}

enum modal_status sums_take(const struct lines *l, const struct transfer *t, struct sums *s,
                            struct modal_error *err)
{
    int K = s->K, V = s->V;

    s->spent += work_of_measure(l, t->poles);
    sums_mix(l, t, s);
    take_sums(l, t, s);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, V, K, 1, s->G, K, s->Q, K, 0, s->GV,
                K);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, V, V, K, 1, s->Q, K, s->GV, K, 0, s->A, V);
    return invert(s->A, V, err);
}

/* ---- steps ---- */

void sums_directions(const struct lines *l, const struct transfer *t, int i, int K, double *T)
{
    int V = 2 * t->poles + l->direct;

    memset(T, 0, sizeof *T * (size_t)K * (size_t)(2 * t->poles * l->drives));
    for (int p = 0; p < t->poles; p++) {
        const double *x = t->x + 2 * p + (size_t)V * i;
        double complex phi = CMPLX(x[0], x[1]);
        double *at = T + (size_t)K * 2 * l->drives * p, *free_q = at + 2 * (size_t)K;
        for (int j = 0; j < l->drives; j++) {
            int c = SUMS_PARTS * (p * l->drives + j);
            double complex k = phi * t->q[j + (size_t)p * l->drives];
            /* moving s moves columns 2 and 3, its derivatives */
            at[c + 2] = creal(k), at[c + 3] = cimag(k);
            at[c + 2 + K] = -cimag(k), at[c + 3 + K] = creal(k);
            if (j == t->held[p])
                continue;
            /* moving q moves the columns themselves */
            free_q[c] = creal(phi), free_q[c + 1] = cimag(phi);
            free_q[c + K] = -cimag(phi), free_q[c + 1 + K] = creal(phi);
            free_q += 2 * (size_t)K;
        }
    }
}

enum modal_status sums_step(const struct lines *l, const struct transfer *t, struct sums *s,
                            struct modal_error *err)
{
    int K = s->K, V = s->V, g = s->g;
    double *P = malloc(sizeof *P * ((size_t)K * K + (size_t)K * V + 2 * (size_t)K * g + K));
    double *AV = P + (size_t)K * K, *T = AV + (size_t)K * V, *PT = T + (size_t)K * g;
    double *rest = PT + (size_t)K * g;

    if (P == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "transfer: no memory for %d unknowns", g);
    s->spent += work_of_step(l, t->poles);
    memcpy(P, s->G, sizeof *P * (size_t)K * K);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, V, V, 1, s->GV, K, s->A, V, 0, AV, K);
    /* C^T P C of (1) */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, K, K, V, -1, AV, K, s->GV, K, 1, P, K);
    memset(s->S, 0, sizeof *s->S * (size_t)g * g);
    memset(s->d, 0, sizeof *s->d * (size_t)g);
    for (int i = 0; i < l->responses; i++) {
        sums_directions(l, t, i, K, T);
        memcpy(rest, s->B + (size_t)K * i, sizeof *rest * K);
        cblas_dgemv(CblasColMajor, CblasNoTrans, K, V, -1, s->GV, K, t->x + (size_t)V * i, 1, 1,
                    rest, 1);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, g, K, 1, P, K, T, K, 0, PT, K);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, g, g, K, 1 / t->variance[i], T, K, PT,
                    K, 1, s->S, g);
        cblas_dgemv(CblasColMajor, CblasTrans, K, g, 1 / t->variance[i], T, K, rest, 1, 1, s->d, 1);
    }
    free(P);
    return MODAL_OK;
}

bool sums_covariance(double *S, int g)
{
    double *size = malloc(sizeof *size * ((size_t)g + 1));
    bool good = size != NULL;

    for (int i = 0; i < g && good; i++)
        size[i] = S[i + (size_t)g * i] > 0 ? 1 / sqrt(S[i + (size_t)g * i]) : 1;
    for (int i = 0; i < g * g && good; i++)
        S[i] *= size[i % g] * size[i / g];
    for (int i = 0; i < g && good; i++)
        S[i + (size_t)g * i] = 1 + SUMS_RIDGE;
    good = good && LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'U', g, S, g) == 0
        && LAPACKE_dpotri(LAPACK_COL_MAJOR, 'U', g, S, g) == 0;
    for (int j = 0; j < g && good; j++)
        for (int i = 0; i <= j; i++)
            S[j + (size_t)g * i] = S[i + (size_t)g * j] *= size[i] * size[j];
    free(size);
    return good;
}
