/* least_squares.h - min |A x - b| with columns scaled, by SVD */
#ifndef MODAL_LEAST_SQUARES_H
#define MODAL_LEAST_SQUARES_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * The least-squares solution of least norm (in scaled unknowns) for every column of B.
 *
 *   A  m x n, destroyed; its columns are divided by their norms first
 *   B  max(m, n) rows of storage, m used: on success the first n rows are the solutions, destroyed
 *      otherwise
 *
 * Singular values of the scaled A below max(m, n) DBL_EPSILON times the largest count as 0.  A zero
 * column gets the unknown 0.  Fails with MODAL_BAD_INPUT, MODAL_NO_MEMORY,
 * MODAL_NO_CONVERGENCE.
 */
enum modal_status least_squares_solve(struct matrix *A, struct matrix *B,
                                      struct modal_error *err);
#endif
