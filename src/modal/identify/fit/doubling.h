/* doubling.h - the QR of a long basis of powers and of its derivatives, and projections on it, by
 * doubling */
#ifndef MODAL_DOUBLING_H
#define MODAL_DOUBLING_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/fit/compressed.h"
#include "modal/identify/linear/powers.h"

struct doubling;

/* Is it cheaper than the QR of all rows at once, for S columns of data? */
bool doubling_pays(int L, int columns, int S);

/* For L rows of a basis of `columns` columns and up to `most` columns of data at a time, which come
 * from BLOCKS, borrowed, and tell of poles that it holds; NULL: as they are.  NULL: no memory. */
struct doubling *doubling_new(int L, int columns, int most, const struct compressed *blocks);
void doubling_free(struct doubling *d);

/* Multiplications of one factorisation and the projection of S columns, about. */
double doubling_cost(const struct doubling *d, int S);

/*
 * Factor Phi (columns = order) or [Phi D] (columns = 2 order) of synthesis.h and refine.c, each
 * column of Phi at most 1 and D centred on its weight: the triangle R, columns x columns, zeros
 * below.  Fails with MODAL_NO_CONVERGENCE (LAPACK).
 */
enum modal_status doubling_factor(struct doubling *d, const struct doubling_poles *poles, double *R,
                                  struct modal_error *err);

/*
 * Of columns FIRST, .. of Y, S of them, by the last factors: Z = Q^T Y, columns x S, and rest2,
 * per column the square of what Y - Q Z leaves, summed without cancellation.
 */
enum modal_status doubling_project(struct doubling *d, const struct matrix *Y, int first, int S,
                                   double *Z, double *rest2, struct modal_error *err);
#endif
