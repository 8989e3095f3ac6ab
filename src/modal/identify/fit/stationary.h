/* stationary.h - how likely a signal is as noise that passed a filter and goes on for ever */
#ifndef MODAL_STATIONARY_H
#define MODAL_STATIONARY_H
#include "base/error.h"

/*
 * *likelihood: the logarithm of the likelihood of X, N samples, as a stationary autoregression, at
 * the order that is best by BIC, less that order's price ln(N)/2 a coefficient; less, too, what
 * every Gaussian likelihood of N samples has, -N/2 (ln(2 pi) + 1).  White noise of variance v is
 * -N/2 ln v; HUGE_VAL where the signal is zero.  A sum of exponentials that decay or grow is not
 * stationary, however well each sample follows from those before.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status stationary_likelihood(const double *x, int N, double *likelihood,
                                        struct modal_error *err);
#endif
