/* arnoldi.h - eigenvalues of largest modulus of an operator known by its products */
#ifndef MODAL_ARNOLDI_H
#define MODAL_ARNOLDI_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/lanczos.h"

struct arnoldi {
    int count;                   /* as many as were wanted, or one more: no pair is parted */
    int products;                /* with A */
    int vectors;                 /* of the subspace in the end */
    bool settled;                /* each residual met the tolerance */
    double worst;                /* residual, over the largest modulus */
    double complex *w;           /* count, descending in modulus, pairs together */
    double *residual;            /* of each |A v - w v|, v of unit norm */
    double *condition;           /* of each >= 1, as seen from the subspace: see eigen.h */
    double complex *V;           /* n x count: v by columns */
};

enum { ARNOLDI_MOST = 3000 };    /* chosen: the small problem takes a minute by then */

/*
 * WANTED (at least 1, at most n) eigenvalues of the square real A, each to a residual of at most
 * TOLERANCE times the largest modulus.  The subspace grows until that is so, all of it orthonormal
 * to rounding, and in the end it is all of A.  EVEN: beside so many vectors one more costs another
 * product; where a third of them foretell no end, the start is carried by twice as many products at
 * most and the subspace begun anew, once (0: never).  The start vector is fixed, so the answer is
 * the same every time.  MOST (at least WANTED; 0: ARNOLDI_MOST) products end it: what is given then
 * is the best so far by its residuals, and has not settled.
 *
 * Fails with what the operator fails with, MODAL_NO_CONVERGENCE (of the small eigenvalue problem),
 * MODAL_NO_MEMORY.  arnoldi_done frees what *OUT has.
 */
enum modal_status arnoldi(const struct linear_operator *A, int wanted, double tolerance, int most,
                          int even, struct arnoldi *out, struct modal_error *err);
/* *A becomes zeros. */
void arnoldi_done(struct arnoldi *a);
#endif
