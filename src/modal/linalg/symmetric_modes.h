/* symmetric_modes.h - the modes of least |lambda| of K phi = lambda M phi, large and sparse */
#ifndef MODAL_SYMMETRIC_MODES_H
#define MODAL_SYMMETRIC_MODES_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/sparse.h"

struct sparse_lu;

struct symmetric_modes {
    int count;            /* as many as were wanted; fewer where M has no more */
    double *lambda;       /* count, |lambda| ascending */
    double *phi;          /* n x count, phi^T M phi = 1 */
};

/*
 * WANTED modes of K (regular) and M (of no negative form), both symmetric of order n; FACTORS are
 * K's.  The start is fixed, so the answer is the same every time.  Each is a mode to a residual of
 * 1e-9 in K^-1 M, relative to 1 / lambda; of 3 WANTED + 40 steps the best there is.  Fails with
 * MODAL_NO_CONVERGENCE (of the small eigenproblem), MODAL_NO_MEMORY.
 */
enum modal_status symmetric_modes(struct sparse_lu *factors, const struct sparse *M, int wanted,
                                  struct symmetric_modes *out, struct modal_error *err);
/* *A becomes zeros. */
void symmetric_modes_done(struct symmetric_modes *a);

/*
 * X less its parts along the COUNT columns of V (n x COUNT, V^T M V = 1), twice, and then of unit
 * M-norm, the norm it had into *NORM: what is left of less than LEAST of its size at first is
 * rounding, and X is not touched further: false.  SCRATCH: n + COUNT numbers.
 */
bool symmetric_modes_join(const struct sparse *M, const double *V, int count, double least,
                          double *x, double *along, double *norm, double *scratch);
#endif
