/*
 * sparse_cholesky.c - CHOLMOD [CDHR08] behind one face
 *
 * The order of elimination is that of approximate minimum degree alone, the same on every machine.
 *
 * Half a solution is our own: the factor is read panel by panel, columns of one pattern in the rows
 * below, and each of its entries multiplies a row of all right-hand sides, which lies in one place.
 * CHOLMOD's, column by column of them, gathers each of these rows from as many places.
 *
 * [CDHR08] Chen, Davis, Hager and Rajamanickam, Algorithm 887: CHOLMOD, ACM Trans. Math. Softw. 35
 * (2008) 22.
 */
#include "modal/linalg/sparse_cholesky.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <suitesparse/cholmod.h>
#include "modal/linalg/lanes.h"

enum {
    PRODUCT_LEAST = 8,          /* columns of a panel from which products of BLAS are faster, */
    TRIANGLE_LEAST = 32,        /* and from which its triangles are: both seen */
    FOUR = 4                    /* sums at once */
};

struct sparse_cholesky {
    int n;
    double *below;                /* rows below a panel; of `below_room` numbers */
    size_t below_room;
    cholmod_common common;
    cholmod_factor *factor;
    cholmod_dense *room[2];       /* of solutions, CHOLMOD's own */
};

struct sparse_cholesky *sparse_cholesky_new(int n, const int *start, const int *index,
                                            const double *value)
{
    struct sparse_cholesky *f = calloc(1, sizeof *f);
    cholmod_sparse A = { .nrow = (size_t)n, .ncol = (size_t)n, .nzmax = (size_t)start[n],
                         .p = (void *)start, .i = (void *)index, .x = (void *)value, .stype = 1,
                         .itype = CHOLMOD_INT, .xtype = CHOLMOD_REAL, .dtype = CHOLMOD_DOUBLE,
                         .sorted = 1, .packed = 1 };

    if (f == NULL)
        return NULL;
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
    if (f->common.status == CHOLMOD_OK && f->factor->minor == f->factor->n)
        return f;
    sparse_cholesky_free(f);
    return NULL;
}

void sparse_cholesky_free(struct sparse_cholesky *f)
{
    if (f == NULL)
        return;
    for (int i = 0; i < 2; i++)
        cholmod_free_dense(&f->room[i], &f->common);
    cholmod_free_factor(&f->factor, &f->common);
    cholmod_finish(&f->common);
    free(f->below);
    free(f);
}

bool sparse_cholesky_solve(struct sparse_cholesky *f, double *X, int columns)
{
    size_t n = (size_t)f->n, size = n * (size_t)columns;
    cholmod_dense B = { .nrow = n, .ncol = (size_t)columns, .nzmax = size, .d = n, .x = X,
                        .xtype = CHOLMOD_REAL, .dtype = CHOLMOD_DOUBLE },
                  *solution = NULL;
    bool ok = columns == 0
              || cholmod_solve2(CHOLMOD_A, f->factor, &B, NULL, &solution, NULL, &f->room[0],
                                &f->room[1], &f->common) != 0;

    if (ok && columns > 0)
        memcpy(X, solution->x, size * sizeof *X);
    cholmod_free_dense(&solution, &f->common);
    return ok;
}

/* Columns `first` .. first + columns - 1 of L: entry (row[i], first + j) is x[j rows + i], the
 * first rows those of the diagonal. */
struct panel { int first, columns, rows; const int *row; const double *x; };

static int panels(const struct sparse_cholesky *f)
{
    return f->factor->is_super ? (int)f->factor->nsuper : f->n;
}

static struct panel panel_at(const struct sparse_cholesky *f, int i)
{
    const cholmod_factor *L = f->factor;
    const int *super = L->super, *pi = L->pi, *px = L->px, *s = L->s, *p = L->p, *nz = L->nz,
              *row = L->i;
    const double *x = L->x;

    return L->is_super
               ? (struct panel) { super[i], super[i + 1] - super[i], pi[i + 1] - pi[i], s + pi[i],
                                  x + px[i] }
               : (struct panel) { i, 1, nz[i], row + p[i], x + p[i] };
}

/* Y -= A X, rows of COLUMNS. */
LANES_BODY void subtract(double a, const double *X, int columns, double *Y)
{
    for (int v = 0; v < columns; v += LANES)
        *(lanes *)(Y + v) -= a * *(const lanes *)(X + v);
}

/* X <- X - the COUNT rows of Y, rows of LD, times A in steps of STRIDE: FOUR times LANES at once,
 * as each sum waits for its own. */
LANES_BODY void subtract_rows(int count, const double *a, size_t stride, const double *Y, size_t ld,
                              int columns, double *X)
{
    int v = 0;

    for (; v + FOUR * LANES <= columns; v += FOUR * LANES) {
        lanes *x = (lanes *)(X + v), sum[FOUR] = { x[0], x[1], x[2], x[3] };

        for (int j = 0; j < count; j++) {
            const lanes *y = (const lanes *)(Y + (size_t)j * ld + v);
            double by = a[(size_t)j * stride];

            for (int i = 0; i < FOUR; i++)
                sum[i] -= by * y[i];
        }
        for (int i = 0; i < FOUR; i++)
            x[i] = sum[i];
    }
    for (; v < columns; v += LANES) {
        lanes sum = *(const lanes *)(X + v);

        for (int j = 0; j < count; j++)
            sum -= a[(size_t)j * stride] * *(const lanes *)(Y + (size_t)j * ld + v);
        *(lanes *)(X + v) = sum;
    }
}

LANES_BODY void divide(double a, int columns, double *X)
{
    for (int v = 0; v < columns; v += LANES)
        *(lanes *)(X + v) /= a;
}

/* A panel's own rows of the solution. */
LANES_BODY void diagonal_forward(const struct panel *p, double *own, int columns, size_t ld)
{
    size_t rows = (size_t)p->rows;

    if (p->columns >= TRIANGLE_LEAST) {
        cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasTrans, CblasNonUnit, columns,
                    p->columns, 1, p->x, p->rows, own, (int)ld);
        return;
    }
    for (int j = 0; j < p->columns; j++) {
        subtract_rows(j, p->x + j, rows, own, ld, columns, own + (size_t)j * ld);
        divide(p->x[(size_t)j * rows + (size_t)j], columns, own + (size_t)j * ld);
    }
}

/* The same of L^T. */
LANES_BODY void diagonal_backward(const struct panel *p, double *own, int columns, size_t ld)
{
    if (p->columns >= TRIANGLE_LEAST) {
        cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasNoTrans, CblasNonUnit, columns,
                    p->columns, 1, p->x, p->rows, own, (int)ld);
        return;
    }
    for (int j = p->columns - 1; j >= 0; j--) {
        const double *below = p->x + (size_t)j * (size_t)p->rows + (size_t)j + 1;

        subtract_rows(p->columns - 1 - j, below, 1, own + (size_t)(j + 1) * ld, ld, columns,
                      own + (size_t)j * ld);
        divide(below[-1], columns, own + (size_t)j * ld);
    }
}

/* A panel's rows, and what those below it take from them. */
LANES_BODY void forward(const struct panel *p, double *X, int columns, size_t ld, double *below)
{
    int c = p->columns, m = p->rows - c;
    size_t rows = (size_t)p->rows;
    double *own = X + (size_t)p->first * ld;

    diagonal_forward(p, own, columns, ld);
    if (c >= PRODUCT_LEAST && m > 0)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, columns, m, c, 1, own, (int)ld,
                    p->x + c, p->rows, 0, below, columns);
    for (int i = 0; i < m; i++) {
        double *to = X + (size_t)p->row[c + i] * ld;

        if (c >= PRODUCT_LEAST)
            subtract(1, below + (size_t)i * (size_t)columns, columns, to);
        else
            subtract_rows(c, p->x + c + i, rows, own, ld, columns, to);
    }
}

/* The same of L^T: a panel's take from them. */
LANES_BODY void backward(const struct panel *p, double *X, int columns, size_t ld, double *below)
{
    int c = p->columns, m = p->rows - c;
    size_t rows = (size_t)p->rows;
    double *own = X + (size_t)p->first * ld;

    for (int i = 0; i < m; i++) {
        const double *from = X + (size_t)p->row[c + i] * ld;

        if (c >= PRODUCT_LEAST)
            memcpy(below + (size_t)i * (size_t)columns, from, (size_t)columns * sizeof *below);
        for (int j = 0; c < PRODUCT_LEAST && j < c; j++)
            subtract(p->x[(size_t)j * rows + (size_t)(c + i)], from, columns,
                     own + (size_t)j * ld);
    }
    if (c >= PRODUCT_LEAST && m > 0)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, columns, c, m, -1, below, columns,
                    p->x + c, p->rows, 1, own, (int)ld);
    diagonal_backward(p, own, columns, ld);
}

/* Half a solution, panel by panel. */
LANES_BODY void half(struct sparse_cholesky *f, bool transposed, double *X, int columns, size_t ld)
{
    int count = panels(f);

    for (int i = 0; i < count; i++) {
        struct panel p = panel_at(f, transposed ? count - 1 - i : i);

        if (transposed)
            backward(&p, X, columns, ld, f->below);
        else
            forward(&p, X, columns, ld, f->below);
    }
}

LANES_NARROW void half_narrow(struct sparse_cholesky *f, bool transposed, double *X, int columns,
                              size_t ld)
{
    half(f, transposed, X, columns, ld);
}

LANES_WIDE void half_wide(struct sparse_cholesky *f, bool transposed, double *X, int columns,
                          size_t ld)
{
    half(f, transposed, X, columns, ld);
}

bool sparse_cholesky_half(struct sparse_cholesky *f, bool transposed, double *X, int columns,
                          int ld)
{
    size_t room = f->factor->is_super ? f->factor->maxesize * (size_t)columns : 0;

    if (room > f->below_room) {
        double *more = realloc(f->below, room * sizeof *more);

        if (more == NULL)
            return false;
        f->below = more;
        f->below_room = room;
    }
    (lanes_wide() ? half_wide : half_narrow)(f, transposed, X, columns, (size_t)ld);
    return true;
}

const int *sparse_cholesky_order(const struct sparse_cholesky *f) { return f->factor->Perm; }

double sparse_cholesky_flops(const struct sparse_cholesky *f) { return f->common.fl; }
double sparse_cholesky_fill(const struct sparse_cholesky *f) { return f->common.lnz; }
