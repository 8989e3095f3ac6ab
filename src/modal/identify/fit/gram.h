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

/* For COUNT poles of ORDER columns over L rows. NULL: no memory. */
struct gram *gram_new(int L, int count, int order);
void gram_free(struct gram *g);

/*
 * R of Phi (look) or of [Phi D], as doubling_factor has them, K x K for its K columns. False where
 * a column is so near to those before it that sums of squares do not tell them apart.
 */
bool gram_factor(struct gram *g, const struct doubling_poles *poles, bool look, double *R);

/*
 * Of the columns of Y, by the last factors: C, order x S, the amplitudes; Z = Q^T Y, K x S; rest2,
 * the sum of squares of what Y - Phi C leaves. False where that is near rounding, or no memory.
 */
bool gram_project(struct gram *g, const struct matrix *Y, const double *R, double *C, double *Z,
                  double *rest2);

/*
 * The triangle [R_J, g] of (4) of refine.c, PARAMETERS + 1 columns, of what the last projection
 * gave, column c with weight[c]; FIRST: each pole's first parameter, or -1. False where the
 * normal equations are not positive definite.
 */
bool gram_triangle(struct gram *g, const double *R, const double *C, const double *Z, int S,
                   const double *weight, const int *first, int parameters, double *T);
#endif
