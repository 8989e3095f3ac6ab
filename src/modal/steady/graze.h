/* graze.h - a balance whose mean is held by nothing but what it meets by a hair */
#ifndef MODAL_GRAZE_H
#define MODAL_GRAZE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct balance;
struct iterate_options;

/*
 * X of B, converged, moved off what it only grazes, in place: along each mean that S_0 does not
 * hold and the derivative does, by as much as X moves itself, to a side where Newton's method, by
 * OPT, leaves the motion as it is and nothing holds it.  R is of X before and after; the derivative
 * is to be made anew.  Patterns that are not full are left as they are.  Fails with MODAL_NO_MEMORY
 * or as iterate_newton does.
 */
enum modal_status graze_leave(struct balance *b, const struct iterate_options *opt,
                              double complex *X, struct modal_error *err);
/* Newton's method on X of B, full, from where it is, its mean along V (b->q of them) held there by
 * a spring as stiff as B's stiffest, which pulls at nothing where it ends. */
enum modal_status graze_newton_held(struct balance *b, const struct iterate_options *opt,
                                    const double *v, double complex *X, bool *converged,
                                    struct modal_error *err);
#endif
