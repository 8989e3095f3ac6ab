/*
 * expm.c - see expm.h
 *
 * Scaling and squaring [H05]: exp(A) = r_m(A / 2^s)^(2^s), r_m the diagonal Pade approximant of
 * degree m, and (m, s) the cheapest with |A / 2^s|_1 <= theta_m, where the backward error is at
 * most the unit roundoff.  The trace is taken out first, A - (tr A / n) I, which lowers the norm of
 * damped systems.
 *
 * A 2 x 2 matrix has a closed form: with the half trace t, the traceless part B and d = -det B,
 *
 *     exp(A) = e^t (cosh sqrt(d) I + sinh sqrt(d) / sqrt(d) B),                           (1)
 *
 * cos and sin where d < 0, which keeps the determinant at e^(2t) to rounding however long the step.
 *
 * A block triangular matrix [A_11 B; 0 S] is similar to [A_11 2^-k B; 0 S], and so are their
 * exponentials: with |2^-k B| <= 1 neither the squarings nor the solve see how large B is.
 *
 * [H05] Higham, SIAM J. Matrix Anal. Appl. 26 (2005) 1179-1193, algorithm 2.3 and table 2.3.
 */
#include "modal/linalg/expm.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Up to here a product is some hundred multiplications, about what a call of BLAS spends before its
 * first. */
enum { INLINE_MOST = 8 };

/* sinh(r) / r = 1 + r^2 / 6 + r^4 / 120 ...: below it the third term is 1e-34 of the first. */
static const double SERIES_BELOW = 1e-8;

/* 38 squarings, each of which may double the relative error: 6e-5 at the worst; beyond, none is
 * stated. */
static const double NORM_MOST = 1e12;

struct expm {
    int n;
    double *B, *B2, *B4, *B6, *U, *V, *A; /* n x n each, in one piece; A: what expm_driven scales */
    int *pivot;
};

enum modal_status expm_new(int n, struct expm **out, struct modal_error *err)
{
    size_t size = (size_t)n * (size_t)n;
    struct expm *w = calloc(1, sizeof *w);

    if (w == NULL || (w->B = malloc(7 * size * sizeof *w->B + 1)) == NULL ||
        (w->pivot = malloc((size_t)n * sizeof *w->pivot + 1)) == NULL) {
        expm_free(w);
        return modal_fail(err, MODAL_NO_MEMORY, "expm: out of memory for %d x %d", n, n);
    }
    w->n = n;
    w->B2 = w->B + size;
    w->B4 = w->B2 + size;
    w->B6 = w->B4 + size;
    w->U = w->B6 + size;
    w->V = w->U + size;
    w->A = w->V + size;
    *out = w;
    return MODAL_OK;
}

void expm_free(struct expm *w)
{
    if (w == NULL)
        return;
    free(w->B);
    free(w->pivot);
    free(w);
}

static inline void small_multiply(int n, double alpha, const double *A, const double *B,
                                  double beta, double *C)
{
    for (int j = 0; j < n; j++) {
        double column[INLINE_MOST] = { 0 };     /* a compiler cannot tell that C is not A */
        for (int k = 0; k < n; k++)
            for (int i = 0; i < n; i++)
                column[i] += A[i + k * n] * B[k + j * n];
        for (int i = 0; i < n; i++)
            /* as BLAS has it: with beta 0 what C holds, a NaN too, is not read */
            C[i + j * n] = alpha * column[i] + (beta != 0 ? beta * C[i + j * n] : 0);
    }
}

void square_multiply(int n, double alpha, const double *A, const double *B, double beta, double *C)
{
    if (n > INLINE_MOST) {
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, n, n, alpha, A, n, B, n, beta, C,
                    n);
        return;
    }
    switch (n) {    /* as many as one or two oscillators have: a compiler that knows n unrolls */
    case 2: small_multiply(2, alpha, A, B, beta, C); break;
    case 4: small_multiply(4, alpha, A, B, beta, C); break;
    default: small_multiply(n, alpha, A, B, beta, C);
    }
}

/* (1) */
static void exponential_2(const double *A, double *E)
{
    double t = (A[0] + A[3]) / 2, a = (A[0] - A[3]) / 2, d = a * a + A[1] * A[2], r = sqrt(fabs(d));
    double c = d < 0 ? cos(r) : cosh(r),
           s = r < SERIES_BELOW ? 1 + d / 6 : (d < 0 ? sin(r) : sinh(r)) / r, e = exp(t);

    E[0] = e * (c + s * a);
    E[3] = e * (c - s * a);
    E[1] = e * s * A[1];
    E[2] = e * s * A[2];
}

/* The power of 2 that brings a block of ROWS x COLUMNS (leading dimension LD) to 1 at most. */
static int exponent_of(const double *X, int rows, int columns, size_t ld)
{
    double most = 0;

    for (int j = 0; j < columns; j++)
        for (int i = 0; i < rows; i++)
            most = fmax(most, fabs(X[(size_t)i + (size_t)j * ld]));
    return most > 1 && isfinite(most) ? ilogb(most) + 1 : 0;   /* what is small already stays */
}

static void scale_block(double *X, int rows, int columns, size_t ld, int k)
{
    for (int j = 0; k != 0 && j < columns; j++)         /* powers of 2: exact */
        for (int i = 0; i < rows; i++)
            X[(size_t)i + (size_t)j * ld] = ldexp(X[(size_t)i + (size_t)j * ld], k);
}

static double norm_1(int n, const double *A)
{
    double norm = 0;

    for (int j = 0; j < n; j++) {
        double sum = 0;
        for (int i = 0; i < n; i++)
            sum += fabs(A[i + (size_t)j * (size_t)n]);
        if (!(sum <= norm))
            norm = sum;                   /* a NaN stays */
    }
    return norm;
}

/* Coefficients of the Pade numerators and the bounds theta_m [H05, table 2.3]. */
static const struct { int m; double theta; double b[14]; } pade[] = {
    { 3, 1.495585217958292e-2, { 120, 60, 12, 1 } },
    { 5, 2.539398330063230e-1, { 30240, 15120, 3360, 420, 30, 1 } },
    { 7, 9.504178996162932e-1, { 17297280, 8648640, 1995840, 277200, 25200, 1512, 56, 1 } },
    { 9, 2.097847961257068e0, { 17643225600, 8821612800, 2075673600, 302702400, 30270240, 2162160,
                                110880, 3960, 90, 1 } },
    { 13, 5.371920351148152e0, { 64764752532480000, 32382376266240000, 7771770303897600,
                                 1187353796428800, 129060195264000, 10559470521600, 670442572800,
                                 33522128640, 1323241920, 40840800, 960960, 16380, 182, 1 } },
};

static void add_scaled(size_t size, double a, const double *X, double *Y)
{
    for (size_t i = 0; i < size; i++)
        Y[i] += a * X[i];
}

/* Y = c0 I + c2 B^2 + c4 B^4 + c6 B^6; a power whose factor is 0 may not have been made. */
static void even(const struct expm *w, double c0, double c2, double c4, double c6, double *Y)
{
    size_t size = (size_t)w->n * (size_t)w->n;

    for (size_t i = 0; i < size; i++)
        Y[i] = c2 * w->B2[i] + (c4 != 0 ? c4 * w->B4[i] : 0) + (c6 != 0 ? c6 * w->B6[i] : 0);
    for (int i = 0; i < w->n; i++)
        Y[(size_t)i * ((size_t)w->n + 1)] += c0;
}

/* p(B) = U + V of the numerator, U its odd powers and V its even ones: p(-B) = V - U is
 * the denominator, so one set of powers makes both.  E is scratch. */
static void numerator(struct expm *w, int row, double *E)
{
    const double *b = pade[row].b;
    int n = w->n, m = pade[row].m;
    size_t size = (size_t)n * (size_t)n;

    square_multiply(n, 1, w->B, w->B, 0, w->B2);
    if (b[5] != 0)
        square_multiply(n, 1, w->B2, w->B2, 0, w->B4);
    if (b[7] != 0)
        square_multiply(n, 1, w->B2, w->B4, 0, w->B6);
    even(w, b[1], b[3], b[5], b[7], E);      /* U / B; of low degrees the table ends in zeros */
    even(w, b[0], b[2], b[4], b[6], w->V);
    if (m == 9) {
        square_multiply(n, 1, w->B2, w->B6, 0, w->U);              /* B^8 */
        add_scaled(size, b[9], w->U, E);
        add_scaled(size, b[8], w->U, w->V);
    }
    if (m == 13) {      /* B^8 and above as B^6 times a second even part */
        double *inner = w->U;
        even(w, 0, b[9], b[11], b[13], inner);
        square_multiply(n, 1, w->B6, inner, 1, E);
        even(w, 0, b[8], b[10], b[12], inner);
        square_multiply(n, 1, w->B6, inner, 1, w->V);
    }
    square_multiply(n, 1, w->B, E, 0, w->U);
}

static enum modal_status exponential(struct expm *w, const double *A, double *E, double shift,
                                     double norm)
{
    enum { LAST = sizeof pade / sizeof *pade - 1 };
    int n = w->n, row = 0, squarings = 0;
    size_t size = (size_t)n * (size_t)n;
    double *result = E, *other = w->B;

    while (row < LAST && norm > pade[row].theta)   /* the cheapest degree that needs no squaring */
        row++;
    if (norm > pade[LAST].theta)
        squarings = (int)ceil(log2(norm / pade[LAST].theta));
    for (size_t i = 0; i < size; i++)
        w->B[i] = ldexp(A[i], -squarings);
    for (int i = 0; i < n; i++)
        w->B[(size_t)i * ((size_t)n + 1)] -= ldexp(shift, -squarings);   /* the trace, taken out */
    numerator(w, row, E);
    for (size_t i = 0; i < size; i++) {
        double u = w->U[i], v = w->V[i];
        E[i] = v + u;           /* p(B) */
        w->V[i] = v - u;        /* p(-B) */
    }
    if (LAPACKE_dgesv_work(LAPACK_COL_MAJOR, n, n, w->V, n, w->pivot, E, n) != 0)
        return MODAL_OVERFLOW;
    /* before squaring: exp(A - shift I) alone may overflow */
    double factor = exp(ldexp(shift, -squarings));
    for (size_t i = 0; i < size; i++)
        result[i] *= factor;
    for (int k = 0; k < squarings; k++) {
        square_multiply(n, 1, result, result, 0, other);
        double *swap = result;
        result = other;
        other = swap;
    }
    if (result != E)
        memcpy(E, result, size * sizeof *E);
    return MODAL_OK;
}

enum modal_status expm(struct expm *w, const double *A, double *E, struct modal_error *err)
{
    int n = w->n;
    double norm, shift = 0;
    enum modal_status rc = MODAL_OK;

    if (n == 0)
        return MODAL_OK;
    norm = norm_1(n, A);
    if (!(norm < NORM_MOST))        /* a NaN too */
        return modal_fail(err, MODAL_OVERFLOW, "expm: the matrix has norm %g; at most 1e12", norm);
    for (int i = 0; i < n; i++)
        shift += A[(size_t)i * ((size_t)n + 1)] / n;
    if (n == 1)
        E[0] = exp(A[0]);
    else if (n == 2)
        exponential_2(A, E);
    else
        rc = exponential(w, A, E, shift, norm + fabs(shift));   /* a bound of |A - shift I| */
    if (rc != MODAL_OK || !isfinite(norm_1(n, E)))
        return modal_fail(err, MODAL_OVERFLOW,
                          "expm: exp(A) leaves the range of doubles (norm of A %g)", norm);
    return MODAL_OK;
}

enum modal_status expm_driven(struct expm *w, int states, const double *A, double *E,
                              struct modal_error *err)
{
    size_t n = (size_t)w->n;
    int columns = w->n - states, k = exponent_of(A + (size_t)states * n, states, columns, n);
    enum modal_status rc;

    if (k == 0)
        return expm(w, A, E, err);
    memcpy(w->A, A, n * n * sizeof *A);
    scale_block(w->A + (size_t)states * n, states, columns, n, -k);
    rc = expm(w, w->A, E, err);
    if (rc == MODAL_OK)
        scale_block(E + (size_t)states * n, states, columns, n, k);
    return rc != MODAL_OK || isfinite(norm_1(w->n, E))
               ? rc
               : modal_fail(err, MODAL_OVERFLOW,
                            "expm: what drives the motion leaves the range of doubles");
}
