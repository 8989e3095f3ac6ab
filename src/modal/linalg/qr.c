/* qr.c - Householder QR by dgeqrf and dorgqr: backward stable, no Gram matrix */
#include "modal/linalg/qr.h"
#include <lapacke.h>
#include <stdlib.h>

/* tau (n numbers, the caller frees) of the factored A, or NULL with ERR and *RC set. */
static double *factor(struct matrix *A, enum modal_status *rc, struct modal_error *err)
{
    double *tau;

    if (A->m < A->n) {
        *rc = modal_fail(err, MODAL_BAD_INPUT, "qr: %d x %d is wider than tall", A->m, A->n);
        return NULL;
    }
    tau = malloc(sizeof *tau * (A->n + 1));
    if (tau == NULL || (A->n > 0 && LAPACKE_dgeqrf(LAPACK_COL_MAJOR, A->m, A->n, A->x, A->ld, tau) != 0)) {
        *rc = modal_fail(err, MODAL_NO_MEMORY, "qr: no memory for %d x %d", A->m, A->n);
        free(tau);
        return NULL;
    }
    *rc = MODAL_OK;
    return tau;
}

static void copy_triangle(const struct matrix *A, struct matrix *R)
{
    for (int j = 0; j < A->n; j++)
        for (int i = 0; i < A->n; i++)
            R->x[i + (size_t)j * R->ld] = i <= j ? A->x[i + (size_t)j * A->ld] : 0;
}

enum modal_status qr_orthonormal(struct matrix *A, struct matrix *R, struct modal_error *err)
{
    enum modal_status rc;
    double *tau = factor(A, &rc, err);

    if (tau == NULL)
        return rc;
    if (R != NULL && R->x != NULL)
        copy_triangle(A, R);
    if (A->n > 0 && LAPACKE_dorgqr(LAPACK_COL_MAJOR, A->m, A->n, A->n, A->x, A->ld, tau) != 0)
        rc = modal_fail(err, MODAL_NO_MEMORY, "qr: no memory for Q, %d x %d", A->m, A->n);
    free(tau);
    return rc;
}

enum modal_status qr_triangle(struct matrix *A, struct matrix *R, struct modal_error *err)
{
    enum modal_status rc;
    double *tau = factor(A, &rc, err);

    if (tau != NULL)
        copy_triangle(A, R);
    free(tau);
    return rc;
}
