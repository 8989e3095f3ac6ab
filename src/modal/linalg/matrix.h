/* matrix.h - a dense matrix as LAPACK sees it */
#ifndef MODAL_MATRIX_H
#define MODAL_MATRIX_H
#include <stdlib.h>
#include <string.h>

/* m rows, n columns, leading dimension ld >= max(m, 1): entry (i, j) is x[i + j*ld]. */
struct matrix {
    int m, n, ld;
    double *x;
};

/* M x N numbers of any content; x is the caller's to free, NULL: no memory. */
static inline struct matrix matrix_new(int m, int n)
{
    size_t count = (size_t)m * (size_t)n;

    return (struct matrix) { m, n, m > 0 ? m : 1, malloc(sizeof(double) * (count + 1)) };
}

/* The M x N numbers of leading dimension FROM_LD at FROM, to TO. */
static inline void matrix_copy(int m, int n, const double *from, int from_ld, double *to, int to_ld)
{
    for (int j = 0; j < n; j++)
        memcpy(to + (size_t)j * (size_t)to_ld, from + (size_t)j * (size_t)from_ld,
               sizeof *to * (size_t)m);
}
#endif
