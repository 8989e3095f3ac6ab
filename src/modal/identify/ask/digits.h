/* digits.h - standard errors where the noise is rounding to significant digits */
#ifndef MODAL_DIGITS_H
#define MODAL_DIGITS_H
#include <complex.h>
#include <stddef.h>
#include "base/error.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/prepare/grid.h"

/* The samples as they were sent: channel[c] of `rows` rows, `stride` apart; all borrowed. */
struct digits_record {
    const double *x;
    size_t stride;
    int rows, channels;
    double dt;                     /* s */
    const int *channel;
    const double *scale;           /* per channel: the unit of the fit's coefficients; 0: none */
    const struct grid *grid;       /* per channel */
};

/*
 * For each of the fit's poles LAMBDA (exponents, 1/s): the factor by which its standard error in
 * white noise of the same mean square must be multiplied, see digits.c; 1 where no channel is
 * floating.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status digits_factors(const struct digits_record *r, const double complex *lambda,
                                 const struct synthesis *fit, double *factor,
                                 struct modal_error *err);
#endif
