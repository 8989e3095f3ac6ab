/* polish.h - exponents of a fit at rounding, in extended precision */
#ifndef MODAL_POLISH_H
#define MODAL_POLISH_H
#include <complex.h>
#include "base/error.h"
#include "modal/identify/fit/refine.h"

/*
 * A fit of COUNT poles to DATA leaves nothing but rounding, and yet some of them are ill
 * determined: refined once more in long double.
 *
 *   lambda, std_re, std_im   replaced where that lowers the residual; poles at zero stay
 *
 * Nothing happens where long double is no longer than double, or the data are too many for it to be
 * cheap. Fails with MODAL_NO_MEMORY.
 */
enum modal_status polish_poles(const struct refine_data *data, double complex *lambda, int count,
                               double *std_re, double *std_im, struct modal_error *err);
#endif
