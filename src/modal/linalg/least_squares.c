/*
 * least_squares.c - column-scaled least squares
 *
 * With D = diag(1/|a_j|), min |A D z - b| is solved by SVD (dgelsd) and x = D z.  Unit columns are
 * within sqrt(n) of the best column scaling for the condition number [vdS69]; normal equations,
 * which square it, are never formed.
 *
 * [vdS69] van der Sluis, Numer. Math. 14 (1969) 14-23.
 */
#include "modal/linalg/least_squares.h"
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include "modal/linalg/svd.h"

/* Columns to unit norm; norm[j] = 0 for a zero column, HUGE_VAL or NaN where an entry is not
 * finite. */
static void scale_columns(struct matrix *A, double *norm)
{
    for (int j = 0; j < A->n; j++) {
        double *a = A->x + (size_t)j * A->ld;
        norm[j] = safe_norm(a, A->m);
        for (int i = 0; i < A->m && norm[j] > 0; i++)
            a[i] /= norm[j];                        /* A D, D = diag(1/|a_j|) */
    }
}

static bool all_finite(const struct matrix *B, int rows)
{
    for (int j = 0; j < B->n; j++)
        if (!isfinite(largest_magnitude(B->x + (size_t)j * B->ld, rows)))
            return false;
    return true;
}

static void unscale(struct matrix *B, int n, const double *norm)
{
    for (int j = 0; j < B->n; j++)
        for (int i = 0; i < n; i++) {
            double *x = B->x + i + (size_t)j * B->ld;
            *x = norm[i] > 0 ? *x / norm[i] : 0;   /* x = D z; a zero column's unknown is free: 0 */
        }
}

enum modal_status least_squares_solve(struct matrix *A, struct matrix *B, struct modal_error *err)
{
    int m = A->m, n = A->n, k = m < n ? m : n, rank, info = 0;
    double *norm;

    if (B->ld < m || B->ld < n || B->n < 0)
        return modal_fail(err, MODAL_BAD_INPUT,
                          "least squares: B has room for %d rows, %d x %d needs %d", B->ld, m, n,
                          m > n ? m : n);
    if (!all_finite(A, m) || !all_finite(B, m))
        return modal_fail(err, MODAL_BAD_INPUT,
                          "least squares: an entry of the %d x %d problem is not finite", m, n);
    norm = calloc((size_t)n + k + 1, sizeof *norm);
    if (norm == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "least squares: no memory for %d x %d", m, n);
    scale_columns(A, norm);
    if (k > 0 && B->n > 0)     /* the last but one: what rounding makes of an exact 0 */
        info = LAPACKE_dgelsd(LAPACK_COL_MAJOR, m, n, B->n, A->x, A->ld, B->x, B->ld, norm + n,
                              (m > n ? m : n) * DBL_EPSILON, &rank);
    if (info == 0)
        unscale(B, n, norm);
    free(norm);
    if (info == LAPACK_WORK_MEMORY_ERROR)
        return modal_fail(err, MODAL_NO_MEMORY,
                          "least squares: no memory for the workspace of %d x %d", m, n);
    if (info != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE,
                          "least squares: dgelsd failed on %d x %d (info %d)", m, n, info);
    return MODAL_OK;
}
