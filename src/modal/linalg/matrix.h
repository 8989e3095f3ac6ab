/* matrix.h - a dense matrix as LAPACK sees it */
#ifndef MODAL_MATRIX_H
#define MODAL_MATRIX_H

/* m rows, n columns, leading dimension ld >= max(m, 1): entry (i, j) is x[i + j*ld]. */
struct matrix {
    int m, n, ld;
    double *x;
};
#endif
