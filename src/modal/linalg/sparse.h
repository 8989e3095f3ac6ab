/* sparse.h - a sparse matrix by compressed rows: built from triplets, multiplied, spread to dense
 */
#ifndef MODAL_SPARSE_H
#define MODAL_SPARSE_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* Row i holds entries start[i] .. start[i+1]-1: column index[j], value[j], columns ascending, none
 * twice. */
struct sparse {
    int m, n;
    int *start;      /* m + 1 */
    int *index;
    double *value;
};

struct triplet { int i, j; double value; };

/* Entries of one place are added in the order given; the sums that are exactly 0 are dropped. COUNT
 * may be 0. */
enum modal_status sparse_from_triplets(int m, int n, const struct triplet *entries, int count,
                                       struct sparse *out, struct modal_error *err);
void sparse_done(struct sparse *a);

/* y += alpha * A x */
void sparse_multiply_add(const struct sparse *a, double alpha, const double *x, double *y);
/* The entries added, times alpha, into a dense m x n matrix. */
void sparse_add_to_dense(const struct sparse *a, double alpha, struct matrix *out);
/* Whether A = A^T entry by entry, to the part TOLERANCE of each. */
bool sparse_symmetric(const struct sparse *a, double tolerance);
#endif
