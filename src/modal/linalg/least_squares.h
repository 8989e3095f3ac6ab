/* least_squares.h - min |A x - b| with columns scaled, by SVD */
#ifndef MODAL_LEAST_SQUARES_H
#define MODAL_LEAST_SQUARES_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

struct least_squares {
    int rank;           /* singular values of the scaled A above rcond * the largest */
    /* largest over smallest singular value of the scaled A; HUGE_VAL where that is 0 */
    double condition;
};

/*
 * The least-squares solution of least norm (in scaled unknowns) for every column of B.
 *
 *   A      m x n, destroyed; its columns are divided by their norms first
 *   B      max(m, n) rows of storage, m used: on success the first n rows are the solutions,
 *          destroyed otherwise
 *   rcond  singular values of the scaled A below rcond times the largest count as 0; 0: max(m,n)
 *          DBL_EPSILON
 *   out    NULL, or what the solution rests on
 *
 * A zero column gets the unknown 0.  Fails with MODAL_BAD_INPUT, MODAL_NO_MEMORY,
 * MODAL_NO_CONVERGENCE.
 */
enum modal_status least_squares_solve(struct matrix *A, struct matrix *B, double rcond,
                                      struct least_squares *out, struct modal_error *err);
#endif
