/* eigen.c - eigenvalues by dgeevx (balanced, with condition numbers) and dsyevd (symmetric) */
#include "modal/linalg/eigen.h"
#include <lapacke.h>
#include <lapacke_utils.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

/* In place of LAPACKE's, which writes to stdout where it has no memory: its status says so too. */
void LAPACKE_xerbla(const char *name, lapack_int info)
{
    (void)name, (void)info;
}

static bool finite_square(const struct matrix *A)
{
    for (int j = 0; j < A->n; j++)
        for (int i = 0; i < A->m; i++)
            if (!isfinite(A->x[i + (size_t)j * A->ld]))
                return false;
    return A->m == A->n;
}

/* LAPACK's real storage of complex vectors: a pair's real part in column j, its imaginary part in
 * j+1. */
static void unpack_vectors(int n, const double *wi, const double *vr, double complex *V)
{
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++) {
            const double *at = vr + i + (size_t)j * n;
            if (wi[j] == 0)               /* real: one column */
                V[i + (size_t)j * n] = at[0];
            else if (wi[j] > 0)           /* the first of a pair: columns j and j + 1 */
                V[i + (size_t)j * n] = CMPLX(at[0], at[n]);
            else
                V[i + (size_t)j * n] = CMPLX(at[-n], -at[0]);
        }
}

enum modal_status eigen_general(struct matrix *A, double complex *w, double *condition,
                                double complex *V, struct modal_error *err)
{
    int n = A->n, ilo, ihi, info;
    size_t nn = (size_t)n * n;
    double *work, *wr, *wi, *scale, *rconde, *rcondv, *vl, *vr, abnrm;
    bool vectors = V != NULL || condition != NULL;     /* dgeevx needs both sides for conditions */

    if (!finite_square(A))
        return modal_fail(err, MODAL_NO_CONVERGENCE,
                          "eigen: a %d x %d matrix that is not square or not finite", A->m, A->n);
    if (n == 0)
        return MODAL_OK;
    work = calloc(5 * (size_t)n + (vectors ? 2 * nn : 2), sizeof *work);
    if (work == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "eigen: no memory for %d x %d", n, n);
    wr = work, wi = wr + n, scale = wi + n, rconde = scale + n, rcondv = rconde + n,
    vl = rcondv + n;
    vr = vectors ? vl + nn : vl + 1;
    info = LAPACKE_dgeevx(LAPACK_COL_MAJOR, 'B', vectors ? 'V' : 'N', vectors ? 'V' : 'N',
                          vectors ? 'E' : 'N', n, A->x, A->ld, wr, wi, vl, n, vr, n, &ilo, &ihi,
                          scale, &abnrm, rconde, rcondv);
    if (info == 0) {
        for (int j = 0; j < n; j++) {
            w[j] = CMPLX(wr[j], wi[j]);
            if (condition != NULL)
                /* LAPACK's is |y^H x|: 0 of a defective eigenvalue */
                condition[j] = rconde[j] > 0 ? 1 / rconde[j] : HUGE_VAL;
        }
        if (V != NULL)
            unpack_vectors(n, wi, vr, V);
    }
    free(work);
    if (info == LAPACK_WORK_MEMORY_ERROR)
        return modal_fail(err, MODAL_NO_MEMORY, "eigen: no memory for the workspace of %d x %d", n,
                          n);
    if (info != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "eigen: dgeevx failed on %d x %d (info %d)", n,
                          n, info);
    return MODAL_OK;
}

/* qsort: |.| descending. */
static int by_size(const void *a, const void *b)
{
    double x = cabs(*(const double complex *)a), y = cabs(*(const double complex *)b);

    return (x < y) - (x > y);
}

enum modal_status eigen_by_size(struct matrix *A, double complex *w, struct modal_error *err)
{
    enum modal_status rc = eigen_general(A, w, NULL, NULL, err);

    if (rc == MODAL_OK)
        qsort(w, (size_t)A->n, sizeof *w, by_size);
    return rc;
}

enum modal_status eigen_symmetric(struct matrix *A, double *w, struct modal_error *err)
{
    int info;

    if (!finite_square(A))
        return modal_fail(err, MODAL_BAD_INPUT,
                          "eigen: a %d x %d matrix that is not square or not finite", A->m, A->n);
    if (A->n == 0)
        return MODAL_OK;
    info = LAPACKE_dsyevd(LAPACK_COL_MAJOR, 'V', 'L', A->n, A->x, A->ld, w);
    if (info == LAPACK_WORK_MEMORY_ERROR)
        return modal_fail(err, MODAL_NO_MEMORY, "eigen: no memory for the workspace of %d x %d",
                          A->n, A->n);
    if (info != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "eigen: dsyevd failed on %d x %d (info %d)",
                          A->n, A->n, info);
    return MODAL_OK;
}
