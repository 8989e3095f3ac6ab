/*
 * svd.c - thin singular value decompositions
 *
 * LAPACK's drivers scale by norm only where it nears overflow, and our callers square what they
 * get; so A is divided here by the power of two at or below its largest magnitude, which is exact,
 * and the values are multiplied back.  dgesdd can fail to converge on rare matrices where dgesvd
 * succeeds [LUG, xGESDD]; A is kept for that second attempt.
 *
 * [LUG] LAPACK Users' Guide, 3rd ed., 1999.
 */
#include "modal/linalg/svd.h"
#include <cblas.h>
#include <lapacke.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Between these magnitudes squares, and sums of 1e100 of them, stay within the doubles (1e-308 to
 * 1e308), and what underflows is below DBL_EPSILON of the largest square. */
static const double PLAIN_LEAST = 1e-100;
static const double PLAIN_MOST = 1e100;      /* see PLAIN_LEAST */

double largest_magnitude(const double *x, size_t count)
{
    double most = 0;

    for (size_t i = 0; i < count; i++) {
        double a = fabs(x[i]);
        if (a <= most)
            continue;
        if (isnan(a))
            return a;
        most = a;
    }
    return most;
}

/* Four sums, which a processor adds side by side. */
static double sum_of_squares(const double *x, size_t count)
{
    double part[4] = { 0 };
    size_t i = 0;

    for (; i + 4 <= count; i += 4)
        for (int k = 0; k < 4; k++)
            part[k] += x[i + k] * x[i + k];
    for (; i < count; i++)
        part[0] += x[i] * x[i];
    return (part[0] + part[1]) + (part[2] + part[3]);
}

double safe_norm(const double *x, size_t count)
{
    double sum = sum_of_squares(x, count), most;

    /* squares neither overflowed nor, where they vanished, matter */
    if (sum > PLAIN_LEAST * PLAIN_LEAST && sum < PLAIN_MOST * PLAIN_MOST)
        return sqrt(sum);
    most = largest_magnitude(x, count), sum = 0;
    if (most == 0 || !isfinite(most))
        return most;
    for (size_t i = 0; i < count; i++) {
        double a = x[i] / most;
        sum += a * a;
    }
    return most * sqrt(sum);
}

double quick_norm(const double *x, size_t count)
{
    double square = count <= INT_MAX ? cblas_ddot((int)count, x, 1, x, 1) : 0;

    return square > PLAIN_LEAST * PLAIN_LEAST && square < PLAIN_MOST * PLAIN_MOST ? sqrt(square)
                                                                      : safe_norm(x, count);
}

double safe_matrix_norm(const struct matrix *a)
{
    double norm = 0;

    for (int c = 0; c < a->n; c++)
        norm = hypot(norm, safe_norm(a->x + (size_t)c * (size_t)a->ld, a->m));
    return norm;
}

static double largest_of(const struct matrix *A)
{
    double most = 0;

    for (int j = 0; j < A->n; j++) {
        double a = largest_magnitude(A->x + (size_t)j * A->ld, A->m);
        if (isnan(a))
            return a;
        if (a > most)
            most = a;
    }
    return most;
}

/* Times 2^exponent, in two steps where that is no double by itself. */
static void scale_by(struct matrix *A, int exponent)
{
    double first = ldexp(1, exponent / 2), second = ldexp(1, exponent - exponent / 2);

    for (int j = 0; j < A->n; j++)
        for (int i = 0; i < A->m; i++)
            A->x[i + (size_t)j * A->ld] = A->x[i + (size_t)j * A->ld] * first * second;
}

/* One of the two drivers; the copy, where given, is A as it was. */
static int decompose(const struct matrix *A, double *s, struct matrix *U, struct matrix *VT,
                     double *copy)
{
    int k = A->m < A->n ? A->m : A->n;
    double *superb, none = 0;
    int info;
    char job = U != NULL ? 'S' : 'N';
    double *u = U != NULL ? U->x : &none, *vt = U != NULL ? VT->x : &none;
    int ldu = U != NULL ? U->ld : 1, ldvt = U != NULL ? VT->ld : 1;

    info = LAPACKE_dgesdd(LAPACK_COL_MAJOR, job, A->m, A->n, A->x, A->ld, s, u, ldu, vt, ldvt);
    if (info <= 0)
        return info;
    superb = malloc(sizeof *superb * k);
    if (superb == NULL)
        return LAPACK_WORK_MEMORY_ERROR;
    info = LAPACKE_dgesvd(LAPACK_COL_MAJOR, job, job, A->m, A->n, copy, A->m, s, u, ldu, vt, ldvt,
                          superb);
    free(superb);
    return info;
}

enum modal_status svd_thin(struct matrix *A, double *s, struct matrix *U, struct matrix *VT,
                           struct modal_error *err)
{
    int k = A->m < A->n ? A->m : A->n, exponent = 0, info;
    double most = largest_of(A), *copy;
    bool vectors = U != NULL && U->x != NULL;

    if (k == 0)
        return MODAL_OK;
    if (!isfinite(most))
        return modal_fail(err, MODAL_BAD_INPUT,
                          "svd: the %d x %d matrix has an entry that is not finite", A->m, A->n);
    if (most > 0) {
        frexp(most, &exponent);         /* most = f 2^exponent, f in [1/2, 1) */
        scale_by(A, -exponent);
    }
    copy = malloc(sizeof *copy * A->m * A->n);
    if (copy == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "svd: no memory for %d x %d", A->m, A->n);
    matrix_copy(A->m, A->n, A->x, A->ld, copy, A->m);
    info = decompose(A, s, vectors ? U : NULL, vectors ? VT : NULL, copy);
    free(copy);
    if (info == LAPACK_WORK_MEMORY_ERROR || info == LAPACK_TRANSPOSE_MEMORY_ERROR)
        return modal_fail(err, MODAL_NO_MEMORY, "svd: no memory for the workspace of %d x %d", A->m,
                          A->n);
    if (info != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE,
                          "svd: dgesdd and dgesvd failed on %d x %d (info %d)", A->m, A->n, info);
    for (int i = 0; i < k; i++)
        s[i] = ldexp(s[i], exponent);   /* singular values scale with A, its vectors not at all */
    return MODAL_OK;
}
