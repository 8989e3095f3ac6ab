/* sparse_cholesky.h - Cholesky factors of sparse symmetric positive matrices, for many right-hand
 * sides at once */
#ifndef MODAL_SPARSE_CHOLESKY_H
#define MODAL_SPARSE_CHOLESKY_H
#include <stdbool.h>

struct sparse_cholesky;

/*
 * Factors of the matrix of order N whose column j has VALUE[e] in row INDEX[e], START[j] <= e <
 * START[j + 1], ascending; the upper triangle is read, nothing is borrowed.  NULL where it is not
 * positive, or there is no memory.
 */
struct sparse_cholesky *sparse_cholesky_new(int n, const int *start, const int *index,
                                            const double *value);
void sparse_cholesky_free(struct sparse_cholesky *f);       /* NULL too */
/* X <- A^-1 X, COLUMNS of n entries each; false: no memory, and X is as it was. */
bool sparse_cholesky_solve(struct sparse_cholesky *f, double *X, int columns);
/* In the order of elimination, A = L L^T, row ORDER[i] of A is the i-th; F owns ORDER. */
const int *sparse_cholesky_order(const struct sparse_cholesky *f);
/*
 * X, in that order n rows of LD numbers, <- L^-1 X, or L^-T X where TRANSPOSED, of the first
 * COLUMNS, a multiple of LANES; false: no memory, and X is as it was.
 */
bool sparse_cholesky_half(struct sparse_cholesky *f, bool transposed, double *X, int columns,
                          int ld);
/* Operations of the factorization, and entries of the factor. */
double sparse_cholesky_flops(const struct sparse_cholesky *f);
double sparse_cholesky_fill(const struct sparse_cholesky *f);
#endif
