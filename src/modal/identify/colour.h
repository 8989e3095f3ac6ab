/* colour.h - is the residual white, and what its colour does to the error bars */
#ifndef MODAL_COLOUR_H
#define MODAL_COLOUR_H
#include "modal/error.h"
#include "modal/linalg/matrix.h"

/*
 * The standard errors of a fit suppose white noise.  For each of COUNT frequencies theta (radians a row, 0..pi) the factor by which that
 * at theta must be multiplied: sqrt(S(theta) / mean S), S the residual's power spectrum smoothed over neighbouring bins and averaged over columns; 1 where the ratio is
 * below 2 (which white noise does not reach) or the residual has fewer than 64 rows.
 *
 *   E   L x S residuals, kept; zero columns are left out
 *
 * Fails with MODAL_NO_MEMORY.
 */
enum modal_status colour_factors(const struct matrix *E, const double *theta, int count, double *factor, struct modal_error *err);
#endif
