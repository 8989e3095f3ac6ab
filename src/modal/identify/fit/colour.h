/* colour.h - is the residual white, and what its colour does to the error bars */
#ifndef MODAL_COLOUR_H
#define MODAL_COLOUR_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * The standard errors of a fit suppose white noise.  For each of COUNT frequencies theta (radians a
 * row, 0..pi) the factor by which that at theta must be multiplied: sqrt(S(theta) / mean S), S the
 * residual's power spectrum smoothed over neighbouring bins and averaged over columns; 1 where the
 * ratio is below 2 (which white noise does not reach) or the residual has fewer than 64 rows.
 *
 *   E   L x S residuals, kept; zero columns are left out
 *
 * Fails with MODAL_NO_MEMORY.
 */
enum modal_status colour_factors(const struct matrix *E, const double *theta, int count,
                                 double *factor, struct modal_error *err);

/* The same where the power spectrum is known: POWER, rows/2 + 1 numbers, the squared magnitudes of
 * the discrete Fourier transforms of E's columns of unit norm, added. */
void colour_factors_of(const double *power, int rows, const double *theta, int count,
                       double *factor);

/*
 * Box and Pierce's test [BP70]: with r_l the autocorrelation at lag l, its mean over the columns,
 * each of unit power, and n numbers in all,
 *
 *     n sum_{l=1..COLOUR_LAGS} r_l^2
 *
 * is chi-square with COLOUR_LAGS degrees of freedom if E is white.  True up to eight deviations
 * above the mean, which no ordinary number of white records exceeds.  Zero columns are left out;
 * none at all are white.
 */
enum { COLOUR_LAGS = 8 };
#define COLOUR_LIMIT (COLOUR_LAGS + 8 * sqrt(2.0 * COLOUR_LAGS))     /* of that sum */
bool colour_white(const struct matrix *E);

/*
 * The same where E is what a fit of q columns leaves of L rows, which takes as much from white
 * noise near its poles: the unit autocorrelation at lag l is then MEAN[l - 1] = -sum rho^l / (L -
 * q) over the q multipliers, COLOUR_LAGS of them. A motion that nothing could tell from noise, of
 * at most chi-squared HIDDEN, turns r_l by HIDDEN / n at most, and may.
 */
bool colour_white_about(const struct matrix *E, const double *mean, double hidden);

/*
 * The same sums of a very long record, column by column: autocorrelations, each column of unit
 * power, and the power spectrum of parts of COLOUR_ROWS rows.
 */
enum { COLOUR_ROWS = 8192 };
struct colour_sum {
    double numbers, r[COLOUR_LAGS];
    double *power;               /* COLOUR_ROWS / 2 + 1, owned */
};

/* ROWS of a column more; fails with MODAL_NO_MEMORY. A zero column is left out. */
enum modal_status colour_add(const double *e, int rows, struct colour_sum *sum,
                             struct modal_error *err);
/* As colour_white_about. */
bool colour_sum_white(const struct colour_sum *sum, const double *mean, double hidden);

/* That mean, of COUNT exponents' fit to ROWS rows, TAU apart (exponents.h); a multiplier that grows
 * is seen from its end. */
void colour_left_by(const double complex *lambda, int count, double tau, int rows, double *mean);

/* Of the eigenvalues of the columns' correlations, the sum of squares and a bound on the largest, 1
 * or more: columns that hear the same noise say together less than as many that do not. */
struct colour_spread { double square, largest; };
/* That of E, L x S, zero columns being no others'. Fails with MODAL_NO_MEMORY. */
enum modal_status colour_spread_of(const struct matrix *E, struct colour_spread *out,
                                   struct modal_error *err);

/* Make zero the columns of E that are no larger than `ratio` of Y's: what is rounding is no noise,
 * and has any colour. */
void colour_leave_out(struct matrix *E, const struct matrix *Y, double ratio);
#endif
