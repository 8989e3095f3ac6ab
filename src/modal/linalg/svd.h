/* svd.h - thin singular value decompositions of dense matrices, and the norms that scale them */
#ifndef MODAL_SVD_H
#define MODAL_SVD_H
#include <stdbool.h>
#include <stddef.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * A = U diag(s) V^T, k = min(m, n) singular values, descending, in the units of A.
 *
 *   A    m x n, its contents destroyed
 *   s    k values
 *   U    m x k, or x NULL: not wanted
 *   VT   k x n (V transposed), or x NULL: not wanted; both or neither
 *
 * A is divided by its largest magnitude first, so any finite scale is accepted; divide and conquer
 * (dgesdd), and the QR iteration (dgesvd) should that fail.  Each s[i] is off by at most p(m,n)
 * DBL_EPSILON s[0].  m or n = 0 does nothing.  Fails with MODAL_BAD_INPUT (an entry that is not
 * finite), MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status svd_thin(struct matrix *A, double *s, struct matrix *U, struct matrix *VT,
                           struct modal_error *err);

/* The largest magnitude of COUNT numbers, 0 for none; a NaN among them gives NaN. */
double largest_magnitude(const double *x, size_t count);

/* The Euclidean norm without overflow or harmful underflow. */
double safe_norm(const double *x, size_t count);
/* the same by one dot product, where squares neither overflow nor vanish */
double quick_norm(const double *x, size_t count);
double safe_matrix_norm(const struct matrix *a);      /* Frobenius, column by column */
#endif
