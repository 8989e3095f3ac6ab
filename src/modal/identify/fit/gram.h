/* gram.h - one evaluation of a fit of many poles, by sums in closed form instead of a QR */
#ifndef MODAL_GRAM_H
#define MODAL_GRAM_H
#include <stdbool.h>
#include "modal/identify/fit/doubling.h"
#include "modal/linalg/matrix.h"

struct gram;

/* Is it cheaper than refine's QR, for S columns of data? */
bool gram_pays(int L, int order, int S);
/* Multiplications of one evaluation, about. */
double gram_work(int L, int order, int S);

/* For COUNT poles of ORDER columns over L rows; TOGETHER: some share their parameters. NULL: no
 * memory. */
struct gram *gram_new(int L, int count, int order, bool together);
void gram_free(struct gram *g);

/*
 * R of Phi (look) or of [Phi D], as doubling_factor has them, K x K for its K columns; of poles
 * together the columns of R22 are in an order of its own, for the functions below. False where
 * a column, of poles together one of Phi, is so near to those before it that sums of squares do not
 * tell them apart.
 */
bool gram_factor(struct gram *g, const struct doubling_poles *poles, bool look, double *R);

/*
 * Of the columns of Y, by the last factors: C, order x S, the amplitudes; Z = Q^T Y, K x S; rest2,
 * the sum of squares of what Y - Phi C leaves. False where that is near rounding, or no memory.
 */
bool gram_project(struct gram *g, const struct matrix *Y, const double *R, double *C, double *Z,
                  double *rest2);

/* What moves the poles: of each its first parameter, or -1; and what its Im moves by with the next
 * (refine.h, turn), 0: it stays.  Poles that move together have the same. */
struct gram_parameters { int count; const int *first, *turn; };

/*
 * The triangle [R_J, g] of (4) of refine.c, parameters and one more columns, of what the last
 * projection gave, column c with weight[c].  False where the normal equations are not positive
 * definite.
 */
bool gram_triangle(struct gram *g, const double *R, const double *C, const double *Z, int S,
                   const double *weight, const struct gram_parameters *p, double *T);
#endif
