/* sparse.h - a sparse matrix by compressed rows: built from triplets, multiplied, spread to dense
 *
 * What a scene's matrices are made of; factors of one are sparse_lu.h's.
 */
#ifndef MODAL_SPARSE_H
#define MODAL_SPARSE_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* Row i holds entries start[i] .. start[i+1]-1: column index[e], value[e], columns ascending, none
 * twice.  Zeros: a matrix that is absent, which sparse_done takes too. */
struct sparse {
    int m, n;        /* rows, columns */
    int *start;      /* m + 1; start[m] entries in all */
    int *index;
    double *value;
};

/* VALUE at row i, column j, counted from 0. */
struct triplet { int i, j; double value; };

/*
 * The m x n matrix of COUNT entries (0 .. m-1, 0 .. n-1; any order; COUNT may be 0).  Entries of
 * one place are added in the order given, so that the sum is the same on every machine; sums that
 * are exactly 0 are dropped.  *out is the caller's, to sparse_done.  Fails with MODAL_NO_MEMORY,
 * and leaves *out as it was.
 */
enum modal_status sparse_from_triplets(int m, int n, const struct triplet *entries, int count,
                                       struct sparse *out, struct modal_error *err);
/* Its arrays are freed; *A becomes zeros. */
void sparse_done(struct sparse *a);

/* y += alpha A x: x has n numbers, y m. */
void sparse_multiply_add(const struct sparse *a, double alpha, const double *x, double *y);
/* OUT += alpha A, m x n. */
void sparse_add_to_dense(const struct sparse *a, double alpha, struct matrix *out);
/* 1 into PLACE at the row and the column of every entry. */
void sparse_mark(const struct sparse *a, int *place);
/* Whether each entry differs from the one across the diagonal by no more than the part TOLERANCE of
 * itself. */
bool sparse_symmetric(const struct sparse *a, double tolerance);
#endif
