/* harmonics.h - the periodic coefficient of a mode as a Fourier series, and the integer k that its
 * signals support */
#ifndef MODAL_HARMONICS_H
#define MODAL_HARMONICS_H
#include <complex.h>
#include "base/error.h"
#include "modal/identify/result.h"

/* The strongest of each mode. */
enum { HARMONICS_REPORTED = 12 };

/*
 * A mode of a periodic system contributes Re sum_l b[k] rho^l at phase k, so a(k dt) = b[k]
 * exp(-lambda k dt) is periodic and
 *
 *   a(t) = sum_k g_k exp(i k Omega t),  k = -p/2 .. p/2,
 *
 * its component at the signed frequency Im lambda + k Omega.
 *
 *   b        p phases of `signals` signals: phase k of signal s at b[(k + p s) * stride], signals
 *            scaled alike
 *   out      the HARMONICS_REPORTED strongest by descending sum_s |g_k|^2 (square root taken), at
 *            most p; the caller's array
 *
 * *resolved is the strongest k, *runner_up the ratio of the second to it; of a tie (within 1e-6)
 * the one of least |Im lambda + k Omega|, then the larger k. For the real kinds the two of a tied
 * pair are one frequency, so runner_up is that of the next different one.
 */
enum modal_status harmonics_of(const double complex *b, size_t stride, int p, int signals,
                               double complex lambda, double period, struct identify_harmonic *out,
                               int *count, int *resolved, double *runner_up,
                               struct modal_error *err);

/* The choice alone, from harmonics in any order, which it sorts. */
void harmonics_choose(struct identify_harmonic *list, int count, double complex lambda,
                      double period, int *resolved, double *runner_up);
#endif
