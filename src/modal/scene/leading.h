/* leading.h - the multipliers of largest modulus of a large periodic program, by its period map
 *
 * No matrix of states by states is made: the map is a vector carried over a period by leaps
 * (leap.h), and its eigenvalues come by arnoldi.h.
 */
#ifndef MODAL_LEADING_H
#define MODAL_LEADING_H
#include "modal/linalg/arnoldi.h"
#include "modal/scene/program.h"

struct leading {
    struct arnoldi found;        /* residuals are those of a map by twice as many leaps */
    int leaps;                   /* of a period */
};

enum { LEADING_HALVINGS = 6 };   /* order 8: by 2^48, which is past all digits */

/*
 * WANTED multipliers over PERIOD of P, which has no laws and serves dofwise.h, each to a residual
 * of at most TOLERANCE times the largest modulus: steps are halved until that is so.
 *
 * Fails as arnoldi, or with MODAL_OVERFLOW where a vector leaves the range of doubles,
 * MODAL_NO_CONVERGENCE where steps halved LEADING_HALVINGS times still miss TOLERANCE.
 * arnoldi_done(&out->found) frees.
 */
enum modal_status leading_multipliers(const struct program *p, double period, int wanted,
                                      double tolerance, struct leading *out,
                                      struct modal_error *err);
#endif
