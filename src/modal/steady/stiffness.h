/* stiffness.h - the dynamic stiffnesses S_k of the dofs that iterate, factored when asked for
 *
 * S_k is K - (k Omega)^2 M + i k Omega C condensed to those dofs, (2) of condense.h.  Direct
 * iteration solves with every one, Newton's method with those past its own harmonics.
 */
#ifndef MODAL_STIFFNESS_H
#define MODAL_STIFFNESS_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct pattern;

struct stiffness;

/* Room for k = 0 .. H on PATTERN (borrowed); no S is known yet.  *out is the caller's, to
 * stiffness_free.  Fails with MODAL_NO_MEMORY. */
enum modal_status stiffness_new(const struct pattern *pattern, int H, struct stiffness **out,
                                struct modal_error *err);
/* Frees S and its factors; NULL is none. */
void stiffness_free(struct stiffness *s);
/* S as condense_at gives it, S[k entries + e] at entry e of the pattern; borrowed until the next.
 * Factors of the one before are forgotten. */
void stiffness_set(struct stiffness *s, const double complex *S);
/* S_k y = b, in place, y the dofs that iterate; false where S_k is singular to rounding or has no
 * factors for want of memory, and then y is b. */
bool stiffness_solve(struct stiffness *s, int k, double complex *y);
/* y += S_k x, entry j of x at x[j stride]; nothing is factored. */
void stiffness_multiply_add(const struct pattern *pattern, const double complex *S, int k,
                            const double complex *x, int stride, double complex *y);
/* A lower bound of 1 / |S_k^-1| in the norm of rows: the least by which a diagonal entry exceeds
 * the others of its row together; <= 0 where one does not. */
double stiffness_least(const struct pattern *pattern, const double complex *S, int k);
#endif
