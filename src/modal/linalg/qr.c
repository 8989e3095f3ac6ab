/* qr.c - Householder QR by dgeqrf and dorgqr: backward stable, no Gram matrix */
#include "modal/linalg/qr.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/svd.h"

/* rows of a panel: with its triangle above it, it fits the second cache for some 100 columns */
enum { PANEL_LEAST = 256 };
/* of a column's length: a QR's rounding, and its bound's modest factor */
static const double DEPENDENT = 32 * DBL_EPSILON;

bool qr_in_place(int m, int n, double *x, int ld, double *work)
{
    if (n == 0)
        return true;
    if ((m < n ? m : n) > QR_BLOCK)
        return LAPACKE_dgeqrt_work(LAPACK_COL_MAJOR, m, n, QR_BLOCK, x, ld, work, QR_BLOCK,
                                   work + (size_t)QR_BLOCK * n) == 0;
    return LAPACKE_dgeqrf_work(LAPACK_COL_MAJOR, m, n, x, ld, work, work + n,
                               (2 * QR_BLOCK - 1) * n) == 0;
}

/* tau (n numbers, the caller frees) of the factored A, or NULL with ERR and *RC set. */
static double *factor(struct matrix *A, enum modal_status *rc, struct modal_error *err)
{
    double *tau;

    if (A->m < A->n) {
        *rc = modal_fail(err, MODAL_BAD_INPUT, "qr: %d x %d is wider than tall", A->m, A->n);
        return NULL;
    }
    tau = malloc(sizeof *tau * (A->n + 1));
    if (tau == NULL ||
        (A->n > 0 && LAPACKE_dgeqrf(LAPACK_COL_MAJOR, A->m, A->n, A->x, A->ld, tau) != 0)) {
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
            /* below the diagonal LAPACK keeps the reflections */
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

/* The triangle of [R; rows first .. first + count - 1 of A] back into the top of STACK, ld n +
 * panel. */
static bool join_rows(const struct matrix *A, int first, int count, int above, double *stack,
                      int ld, double *work)
{
    int n = A->n, m = above + count;

    for (int j = 0; j < n; j++) {
        for (int i = j + 1; i < above; i++)     /* the reflections of the panel before */
            stack[i + (size_t)j * ld] = 0;
        memcpy(stack + above + (size_t)j * ld, A->x + first + (size_t)j * A->ld,
               sizeof(double) * (size_t)count);
    }
    return qr_in_place(m, n, stack, ld, work);
}

static enum modal_status triangle_by_panels(const struct matrix *A, int panel, struct matrix *R,
                                            struct modal_error *err)
{
    int n = A->n, ld = n + panel;
    double *stack = malloc(sizeof *stack * ((size_t)ld * n + QR_ROOM(n)));
    bool ok = stack != NULL;

    for (int first = 0, above = 0; ok && first < A->m; above = n) {
        int count = A->m - first < ld - above ? A->m - first : ld - above;
        ok = join_rows(A, first, count, above, stack, ld, stack + (size_t)ld * n);
        first += count;
    }
    if (ok)
        copy_triangle(&(struct matrix) { ld, n, ld, stack }, R);
    free(stack);
    return ok ? MODAL_OK
              : modal_fail(err, MODAL_NO_MEMORY, "qr: no memory for a panel of %d x %d", ld, n);
}

enum modal_status qr_triangle(struct matrix *A, struct matrix *R, struct modal_error *err)
{
    int panel = 3 * A->n > PANEL_LEAST ? 3 * A->n : PANEL_LEAST;
    double *work;
    bool ok;

    if (A->m < A->n)
        return modal_fail(err, MODAL_BAD_INPUT, "qr: %d x %d is wider than tall", A->m, A->n);
    /* panels read A once; they pay where there are several */
    if (A->n > 0 && A->m > 2 * (A->n + panel))
        return triangle_by_panels(A, panel, R, err);
    work = malloc(sizeof *work * (QR_ROOM(A->n) + 1));
    ok = work != NULL && qr_in_place(A->m, A->n, A->x, A->ld, work);
    free(work);
    if (!ok)
        return modal_fail(err, MODAL_NO_MEMORY, "qr: no memory for %d x %d", A->m, A->n);
    copy_triangle(A, R);
    return MODAL_OK;
}

/* x becomes v, v[0] = 1, with (1 - tau v v^T) x = (beta, 0 ..); tau. */
static double reflector(double *x, int count, double *beta)
{
    double norm = quick_norm(x, (size_t)count), alpha = x[0];

    *beta = alpha > 0 ? -norm : norm;       /* of the other sign: alpha - beta does not cancel */
    if (norm == 0)
        return 0;
    for (int i = 1; i < count; i++)
        x[i] /= alpha - *beta;
    x[0] = 1;
    return (*beta - alpha) / *beta;
}

void qr_reflect(struct matrix *A, int k, double *work)
{
    for (int i = 0; i < k; i++) {
        int rows = A->m - i, left = A->n - i - 1;
        double *v = A->x + i + (size_t)i * (size_t)A->ld, *rest = v + A->ld, beta,
               tau = reflector(v, rows, &beta);
        if (left > 0 && tau != 0) {
            cblas_dgemv(CblasColMajor, CblasTrans, rows, left, 1, rest, A->ld, v, 1, 0, work, 1);
            cblas_dger(CblasColMajor, rows, left, -tau, v, 1, work, 1, rest, A->ld);
        }
        memset(v, 0, sizeof *v * (size_t)rows);   /* v has done its work: the column is beta e_1 */
        v[0] = beta;
    }
}

bool qr_dependent(const double *column, int j)
{
    return !(fabs(column[j]) > DEPENDENT * cblas_dnrm2(j + 1, column, 1));
}
