/*
 * block_lanczos.c - see block_lanczos.h
 *
 * Blocks lie row by row, so that products with sparse factors read a row of all vectors at one
 * place (sparse_cholesky_half).  To BLAS, which counts in columns, they are transposed.
 *
 * Q_j+1 B_j+1 is by Cholesky's factors of the Gram matrix, twice where it is ill-conditioned, or,
 * where it is singular nearly, column by column.
 */
#include "modal/linalg/block_lanczos.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/lanes.h"

enum { PRODUCTS = 8 };          /* n x wide x wide in a step: (1), and Q's factors */
/* What a column of (1) has beside the others, over |N|, below which it is their rounding. */
static const double DEPENDENT = 1e-13;
/* Cholesky's pivots over the largest size of a column: above REGULAR columns are orthonormal to a
 * thousand roundings, above TWICE a second factorization makes them so. */
static const double REGULAR = 0.03;
static const double TWICE = 1e-5;

bool block_lanczos_init(struct block_lanczos *l, int n, int sides)
{
    size_t s = (size_t)sides;

    *l = (struct block_lanczos) {
        .n = n, .sides = sides,
        .ld = (sides + LANES - 1) / LANES * LANES
    };
    for (int i = 0; i < 4; i++)
        l->Q[i] = workspace_zeros(&l->space, (size_t)n * (size_t)l->ld, sizeof *l->Q[i]);
    l->R = workspace_zeros(&l->space, s * s, sizeof *l->R);
    l->small = workspace_zeros(&l->space, 2 * s * s, sizeof *l->small);
    return !l->space.failed;
}

void block_lanczos_done(struct block_lanczos *l)
{
    workspace_free(&l->space);
    workspace_free(&l->blocks);
    free(l->step);
}

/* Room for one step more; it has WIDE columns. */
static bool add_step(struct block_lanczos *l, int wide)
{
    size_t w = (size_t)wide;
    struct block_step *s;

    if (l->steps == l->places) {
        int more = 2 * l->places + 16;

        s = realloc(l->step, (size_t)more * sizeof *s);
        if (s == NULL)
            return false;
        l->step = s;
        l->places = more;
    }
    s = &l->step[l->steps];
    *s = (struct block_step) { wide, 0, workspace_zeros(&l->blocks, w * w, sizeof *s->A),
                               workspace_zeros(&l->blocks, w * w, sizeof *s->B) };
    return !l->blocks.failed;
}

/* The WIDE columns of Z to Q R, those that have more than LEAST (of their own size where RELATIVE)
 * beside the ones before: how many.  R in columns of LD. */
static int part(struct block_lanczos *l, double *Z, int wide, double least, bool relative,
                double *R, int ld)
{
    int kept = 0;

    for (int j = 0; j < wide; j++) {
        double *z = Z + kept, *h = R + (size_t)j * (size_t)ld, size;
        double bound = least * (relative ? cblas_dnrm2(l->n, Z + j, l->ld) : 1);

        memset(h, 0, (size_t)wide * sizeof *h);
        if (j > kept)
            cblas_dcopy(l->n, Z + j, l->ld, z, l->ld);
        for (int pass = 0; pass < 2 && kept > 0; pass++) {
            cblas_dgemv(CblasColMajor, CblasNoTrans, kept, l->n, 1, Z, l->ld, z, l->ld, 0,
                        l->small, 1);
            cblas_dgemv(CblasColMajor, CblasTrans, kept, l->n, -1, Z, l->ld, l->small, 1, 1, z,
                        l->ld);
            cblas_daxpy(kept, 1, l->small, 1, h, 1);
        }
        size = cblas_dnrm2(l->n, z, l->ld);
        if (size > bound && isfinite(size)) {
            cblas_dscal(l->n, 1 / size, z, l->ld);
            h[kept++] = size;
        }
    }
    return kept;
}

/* The same by Cholesky's factors of Z^T Z, once more where these are not REGULAR; false: a column
 * has no more than BOUND beside the others, or they are singular, nearly, and Z is as it was. */
static bool part_at_once(struct block_lanczos *l, double *Z, int wide, double bound, double *R,
                         int ld)
{
    size_t w = (size_t)wide;
    double *G = l->small, *second = l->small + (size_t)l->sides * (size_t)l->sides, most = 0,
           least = 0;

    for (int pass = 0; pass < 2 && !(least > REGULAR * most); pass++) {
        double *to = pass == 0 ? G : second;

        cblas_dsyrk(CblasColMajor, CblasUpper, CblasNoTrans, wide, l->n, 1, Z, l->ld, 0, to, wide);
        if (LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'U', wide, to, wide) != 0)
            return false;                               /* never at the second pass */
        for (size_t i = 0; pass == 0 && i < w; i++) {
            most = fmax(most, cblas_dnrm2((int)i + 1, G + i * w, 1));   /* a column's size */
            least = i == 0 ? G[0] : fmin(least, G[i * (w + 1)]);
        }
        if (!(least > fmax(TWICE * most, bound)))
            return false;
        cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, wide, l->n, 1,
                    to, wide, Z, l->ld);
    }
    if (!(least > REGULAR * most))
        cblas_dtrmm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, wide, wide,
                    1, second, wide, G, wide);
    for (size_t j = 0; j < w; j++)
        for (size_t i = 0; i < w; i++)
            R[j * (size_t)ld + i] = i <= j ? G[j * w + i] : 0;
    return true;
}

bool block_lanczos_begin(struct block_lanczos *l)
{
    int wide = part(l, l->Q[1], l->sides, DEPENDENT, true, l->R, l->sides);

    l->ended = wide == 0 || !add_step(l, wide);
    return !l->ended;
}

/* A_j of Q, and W less its part of Q. */
static void take_diagonal(struct block_lanczos *l, const double *Q, int wide, double *W, double *A)
{
    size_t w = (size_t)wide;

    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, wide, wide, l->n, 1, Q, l->ld, W, l->ld,
                0, A, wide);
    for (size_t j = 0; j < w; j++)
        for (size_t i = 0; i <= j; i++) {
            A[i * w + j] = A[j * w + i] = (A[i * w + j] + A[j * w + i]) / 2;
            l->scale = fmax(l->scale, fabs(A[i * w + j]));
        }
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, wide, l->n, wide, -1, A, wide, Q, l->ld,
                1, W, l->ld);
}

/* The WIDE columns of FROM to X, and 0 in what fills its rows. */
static void copy_rows(const struct block_lanczos *l, const double *from, int wide, double *X)
{
    size_t ld = (size_t)l->ld, w = (size_t)wide;

    for (size_t i = 0; i < (size_t)l->n; i++, from += ld, X += ld) {
        memcpy(X, from, w * sizeof *X);
        memset(X + w, 0, (ld - w) * sizeof *X);
    }
}

bool block_lanczos_step(struct block_lanczos *l, block_product *product, void *context)
{
    struct block_step *s = &l->step[l->steps];
    double *before = l->Q[0], *now = l->Q[1], *next = l->Q[2], *scratch = l->Q[3];
    int wide = s->wide,
        columns = (wide + LANES - 1) / LANES * LANES;

    if (l->ended)
        return false;
    copy_rows(l, now, wide, scratch);
    l->ended = !product(context, columns, l->ld, scratch, next);
    if (l->ended)
        return false;
    if (l->steps > 0)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, wide, l->n, s[-1].wide, -1, s[-1].B,
                    s[-1].wide, before, l->ld, 1, next, l->ld);
    take_diagonal(l, now, wide, next, s->A);
    s->next = part_at_once(l, next, wide, DEPENDENT * l->scale, s->B, wide)
                  ? wide
                  : part(l, next, wide, DEPENDENT * l->scale, false, s->B, wide);
    l->Q[0] = now;
    l->Q[1] = next;
    l->Q[2] = before;
    wide = s->next;
    l->steps++;
    l->ended = wide == 0 || !add_step(l, wide);
    return true;
}

double block_lanczos_work(const struct block_lanczos *l)
{
    double wide = l->step[l->steps].wide;

    return PRODUCTS * l->n * wide * wide;
}
