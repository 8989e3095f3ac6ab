/* influence.h - how exponents move between two programs of the same dofs: exactly, and to first
 * order
 *
 * The first-order estimate is from the left and right eigenvectors of the first: with A the state
 * matrix of the one, A' that of the other in the same coordinates, and dX = A' - A (constant) or
 * the derivative of the monodromy matrix towards A' (periodic),
 *
 *     d_i = l_i dX r_i,   l_i r_i = 1,                                                          (1)
 *
 * for lambda_i where both are constant; d rho_i where either is periodic, d lambda_i = d rho_i /
 * (rho_i T) then.  What it leaves out is of second order in A' - A: an effect of half the size has
 * a quarter of it.
 */
#ifndef MODAL_INFLUENCE_H
#define MODAL_INFLUENCE_H
#include <complex.h>
#include <stdbool.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

struct influence {
    int count;                       /* exponents of FROM */
    bool periodic;  /* either of the two is */
    double period;  /* s; 0: both are constant */
    /* exponents, matched by their eigenvectors; NAN where `to` has none or it is below rounding */
    double complex *from, *to;
    /* (1): of to - from; NAN where the numbers of linear states differ */
    double complex *first_order;
    struct workspace space;          /* of the arrays */
    double margin_from, margin_to;   /* -max Re exponent */
};

/*
 * Fails with MODAL_BAD_INPUT (laws; other dofs), MODAL_TOO_LARGE, MODAL_OVERFLOW,
 * MODAL_NO_CONVERGENCE, MODAL_NO_MEMORY. influence_done frees.
 */
enum modal_status influence(const struct program *from, const struct program *to,
                            struct influence *out, struct modal_error *err);
/* F's arrays; F itself is the caller's and becomes zeros. */
void influence_done(struct influence *f);

#endif
