/*
 * sparse_cholesky.c - CHOLMOD [CDHR08] behind one face
 *
 * The order of elimination is that of approximate minimum degree alone, the same on every machine.
 *
 * [CDHR08] Chen, Davis, Hager and Rajamanickam, Algorithm 887: CHOLMOD, ACM Trans. Math. Softw. 35
 * (2008) 22.
 */
#include "modal/linalg/sparse_cholesky.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <suitesparse/cholmod.h>

struct sparse_cholesky {
    int n;
    cholmod_common common;
    cholmod_factor *factor;
    cholmod_dense *room[2];       /* of solutions, CHOLMOD's own */
};

enum modal_status sparse_cholesky_new(int n, const int *start, const int *index,
                                      const double *value, struct sparse_cholesky **out,
                                      struct modal_error *err)
{
    struct sparse_cholesky *f = calloc(1, sizeof *f);
    cholmod_sparse A = { .nrow = (size_t)n, .ncol = (size_t)n, .nzmax = (size_t)start[n],
                         .p = (void *)start, .i = (void *)index, .x = (void *)value, .stype = 1,
                         .itype = CHOLMOD_INT, .xtype = CHOLMOD_REAL, .dtype = CHOLMOD_DOUBLE,
                         .sorted = 1, .packed = 1 };
    int status;

    *out = NULL;
    if (f == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "cholesky: no memory");
    f->n = n;
    cholmod_start(&f->common);
    f->common.print = 0;
    f->common.quick_return_if_not_posdef = 1;
    f->common.final_ll = 1;                             /* L D L^T would take negative pivots */
    f->common.nmethods = 1;
    f->common.method[0].ordering = CHOLMOD_AMD;
    f->factor = cholmod_analyze(&A, &f->common);
    if (f->factor != NULL)
        cholmod_factorize(&A, f->factor, &f->common);
    status = f->common.status;
    if (status == CHOLMOD_OK && f->factor->minor == f->factor->n) {
        *out = f;
        return MODAL_OK;
    }
    sparse_cholesky_free(f);
    return status == CHOLMOD_OUT_OF_MEMORY || status == CHOLMOD_TOO_LARGE
               ? modal_fail(err, MODAL_NO_MEMORY, "cholesky: no memory for the factor")
               : MODAL_OK;
}

void sparse_cholesky_free(struct sparse_cholesky *f)
{
    if (f == NULL)
        return;
    for (int i = 0; i < 2; i++)
        cholmod_free_dense(&f->room[i], &f->common);
    cholmod_free_factor(&f->factor, &f->common);
    cholmod_finish(&f->common);
    free(f);
}

/* X <- the solution of SYSTEM, one of CHOLMOD's. */
static bool solve(struct sparse_cholesky *f, int system, double *X, int columns)
{
    size_t n = (size_t)f->n, size = n * (size_t)columns;
    cholmod_dense B = { .nrow = n, .ncol = (size_t)columns, .nzmax = size, .d = n, .x = X,
                        .xtype = CHOLMOD_REAL, .dtype = CHOLMOD_DOUBLE },
                  *solution = NULL;
    bool ok = columns == 0
              || cholmod_solve2(system, f->factor, &B, NULL, &solution, NULL, &f->room[0],
                                &f->room[1], &f->common) != 0;

    if (ok && columns > 0)
        memcpy(X, solution->x, size * sizeof *X);
    cholmod_free_dense(&solution, &f->common);
    return ok;
}

bool sparse_cholesky_solve(struct sparse_cholesky *f, double *X, int columns)
{
    return solve(f, CHOLMOD_A, X, columns);
}

const int *sparse_cholesky_order(const struct sparse_cholesky *f) { return f->factor->Perm; }

bool sparse_cholesky_half(struct sparse_cholesky *f, bool transposed, double *X, int columns)
{
    return solve(f, transposed ? CHOLMOD_Lt : CHOLMOD_L, X, columns);
}

double sparse_cholesky_flops(const struct sparse_cholesky *f) { return f->common.fl; }
double sparse_cholesky_fill(const struct sparse_cholesky *f) { return f->common.lnz; }
