/* stiffness.h - the dynamic stiffnesses S_k of the dofs that iterate, factored when asked for */
#ifndef MODAL_STIFFNESS_H
#define MODAL_STIFFNESS_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct pattern;

struct stiffness;

/* For S as condense_at gives it: S[k entries + e] at entry e of PATTERN (borrowed), k = 0 .. H. */
enum modal_status stiffness_new(const struct pattern *pattern, int H, struct stiffness **out,
                                struct modal_error *err);
/* Frees S and its factors; NULL is none. */
void stiffness_free(struct stiffness *s);
/* S (borrowed until the next) is another: its factors are made anew. */
void stiffness_set(struct stiffness *s, const double complex *S);
/* S_k y = b, in place; false where S_k is singular to rounding, and then y is b. */
bool stiffness_solve(struct stiffness *s, int k, double complex *y);
/* y += S_k x, x[j stride]. */
void stiffness_multiply_add(const struct pattern *pattern, const double complex *S, int k,
                            const double complex *x, int stride, double complex *y);
/* A lower bound of 1 / |S_k^-1| in the norm of rows: the least by which a diagonal entry exceeds
 * the others of its row together; <= 0 where one does not. */
double stiffness_least(const struct pattern *pattern, const double complex *S, int k);
#endif
