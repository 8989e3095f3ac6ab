/* transition.h - the multipliers of Q, Qhat, B, Bhat from the small projection */
#ifndef MODAL_TRANSITION_H
#define MODAL_TRANSITION_H
#include <complex.h>
#include "base/error.h"
#include "modal/identify/result.h"
#include "modal/linalg/matrix.h"

/*
 * Leading triplets of H0 = U S V^T and the projection G = U^T H1 V (k x k).  For any r <= k, with
 * S_r, G_r the leading parts,
 *
 *   Qhat = G_r S_r^{-1} (17),   Bhat = S_r^{-1} G_r (21),
 *
 * and Q, B have the same non-zero eigenvalues: nonzero eig(XY) = eig(YX).
 */
struct transition {
    int count;            /* k */
    const double *s;      /* k */
    const double *G;      /* k x k, column-major, ld k */
};

/* The r eigenvalues. */
enum modal_status transition_multipliers(const struct transition *t, enum identify_method method,
                                         int r, double complex *rho, struct modal_error *err);
#endif
