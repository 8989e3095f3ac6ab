/* eigen.h - eigenvalues of dense matrices: general and symmetric */
#ifndef MODAL_EIGEN_H
#define MODAL_EIGEN_H
#include <complex.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * All n eigenvalues of a general A (n x n, destroyed), balanced first (dgeevx).  Those of a
 * conjugate pair are adjacent, the one with positive imaginary part first.
 *
 *   w          n eigenvalues
 *   condition  n numbers >= 1, or NULL: 1/|y^H x|, the factor from a perturbation of A to the
 *              eigenvalue's
 *   V          n x n right eigenvectors of unit norm, column j for w[j], or NULL
 *
 * Fails with MODAL_NO_CONVERGENCE (also where A is not square or holds what is not finite),
 * MODAL_NO_MEMORY.
 */
enum modal_status eigen_general(struct matrix *A, double complex *w, double *condition,
                                double complex *V, struct modal_error *err);

/* The eigenvalues alone, the largest first. */
enum modal_status eigen_by_size(struct matrix *A, double complex *w, struct modal_error *err);

/* Eigenvalues of a symmetric A (lower triangle read), ascending; A becomes the orthonormal
 * eigenvectors. */
enum modal_status eigen_symmetric(struct matrix *A, double *w, struct modal_error *err);
#endif
