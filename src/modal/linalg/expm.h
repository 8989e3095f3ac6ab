/* expm.h - the exponential of a small or middling dense matrix */
#ifndef MODAL_EXPM_H
#define MODAL_EXPM_H
#include "base/error.h"

struct expm;      /* workspace for one size: made once, used for every step */

/* For matrices of order N; the caller frees *out with expm_free.  Fails with MODAL_NO_MEMORY. */
enum modal_status expm_new(int n, struct expm **out, struct modal_error *err);
void expm_free(struct expm *w);

/*
 * E = exp(A), n x n by columns, leading dimension n; A is kept, E may not be A.  The error is that
 * of a relative perturbation of A by DBL_EPSILON (backward stable: see expm.c).  Fails with
 * MODAL_OVERFLOW where A is not finite or exp(A) is not, and leaves E undefined then.
 */
enum modal_status expm(struct expm *w, const double *A, double *E, struct modal_error *err);

/*
 * The same for A = [A_11 B; 0 S], A_11 of order STATES: a motion and what drives it.  exp(A) is
 * linear in the columns of B, so they are brought to 1 at most by a power of 2 first: forces in any
 * unit leave the error to A_11 and S.
 */
enum modal_status expm_driven(struct expm *w, int states, const double *A, double *E,
                              struct modal_error *err);

/* C = alpha A B + beta C, all n x n by columns, C apart from A and B: small sizes inline, others by
 * BLAS. */
void square_multiply(int n, double alpha, const double *A, const double *B, double beta, double *C);

#endif
