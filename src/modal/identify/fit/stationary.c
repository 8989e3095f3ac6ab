/*
 * stationary.c - Burg's recursion [Bur75]
 *
 * The forward and the backward error of order n - 1 at sample t, f and b, become
 *
 *     f' = f[t] - k b[t-1],  b' = b[t-1] - k f[t],
 *     k = 2 sum f[t] b[t-1] / sum (f[t]^2 + b[t-1]^2),
 *
 * the variance of the innovations v (1 - k^2).  |k| <= 1: the filter is stable whatever the signal
 * does, and as both directions of time are asked alike, a decay, which is no growth, pays for it.
 * By the formula of Kolmogorov v is exp of the mean logarithm of the spectrum, so that Whittle's
 * likelihood of the model is -N/2 (ln v + 1) but for a constant.
 *
 * [Bur75] Burg, Maximum Entropy Spectral Analysis, thesis, Stanford (1975).
 */
#include "modal/identify/fit/stationary.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    ORDER_MOST = 256,            /* coefficients: a shorter filter than the best is less likely */
    SAMPLES_EACH = 4             /* to a coefficient at least: each costs ln(N)/2 */
};

enum modal_status stationary_likelihood(const double *x, int N, double *likelihood,
                                        struct modal_error *err)
{
    int most = N / SAMPLES_EACH < ORDER_MOST ? N / SAMPLES_EACH : ORDER_MOST;
    double v = 0, best, *f = malloc(2 * sizeof *f * ((size_t)N + 1)), *b = f + N + 1;

    if (f == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples", N);
    for (int t = 0; t < N; t++) {
        f[t] = b[t] = x[t];
        v += x[t] * x[t] / N;
    }
    best = -0.5 * N * log(v);
    for (int n = 1; n <= most && v > 0; n++) {
        double fb = 0, both = 0, k;
        for (int t = n; t < N; t++) {
            fb += f[t] * b[t - 1];
            both += f[t] * f[t] + b[t - 1] * b[t - 1];
        }
        k = both > 0 ? 2 * fb / both : 0;
        for (int t = N - 1; t >= n; t--) {
            double forward = f[t];
            f[t] -= k * b[t - 1];
            b[t] = b[t - 1] - k * forward;
        }
        v *= 1 - k * k;
        best = fmax(best, -0.5 * N * log(v) - 0.5 * n * log(N));
    }
    free(f);
    *likelihood = v > 0 ? best : HUGE_VAL;
    return MODAL_OK;
}
