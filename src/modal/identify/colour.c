/*
 * colour.c - the power spectrum of a residual
 *
 * An exponent at theta is estimated from the data's component there, within 1/L or the mode's own width: noise of power density S(theta) acts
 * on it as white noise of that density would, so the standard error scales with sqrt(S(theta) / S_white), S_white being the mean over all
 * frequencies, which is what the variance of the residual measures.
 *
 * S is the periodogram averaged over 2h+1 bins, h = max(8, L/64), and over the columns, each of unit power.  With c columns the relative fluctuation is
 * 1/sqrt((2h+1) c) <= 0.24, and a ratio of 2 four deviations off: below it nothing is changed, so white noise keeps its bars.
 */
#include "modal/identify/colour.h"
#include <fftw3.h>
#include <math.h>
#include <stdlib.h>
#include "modal/linalg/svd.h"

enum { ROWS_LEAST = 64, HALF_LEAST = 8 };
static const double RATIO_LEAST = 2;

/* Add the periodogram of one column of unit power to power[0 .. L/2]. */
static void add_periodogram(const double *e, int L, double *x, fftw_complex *X, fftw_plan plan, double *power)
{
    double norm = safe_norm(e, L);

    for (int l = 0; l < L && norm > 0; l++)
        x[l] = e[l] / norm;
    if (norm == 0)
        return;
    fftw_execute(plan);
    for (int k = 0; k <= L / 2; k++)
        power[k] += X[k][0] * X[k][0] + X[k][1] * X[k][1];
}

/* The mean over the bins within `half` of theta, over that of all. */
static double ratio_at(const double *power, int bins, double theta, int half)
{
    int at = (int)lround(theta / M_PI * (bins - 1)), count = 0;
    double near = 0, all = 0;

    for (int k = 0; k < bins; k++) {
        all += power[k] / bins;
        if (abs(k - at) <= half)
            near += power[k], count++;
    }
    return all > 0 ? near / count / all : 1;
}

enum modal_status colour_factors(const struct matrix *E, const double *theta, int count, double *factor, struct modal_error *err)
{
    int L = E->m, bins = L / 2 + 1, half = L / 64 > HALF_LEAST ? L / 64 : HALF_LEAST;
    double *x = NULL, *power = NULL;
    fftw_complex *X = NULL;
    fftw_plan plan = NULL;
    enum modal_status rc = MODAL_OK;

    for (int j = 0; j < count; j++)
        factor[j] = 1;
    if (L < ROWS_LEAST || count == 0)
        return MODAL_OK;
    x = fftw_alloc_real(L), X = fftw_alloc_complex(bins), power = calloc(bins, sizeof *power);
    if (x != NULL && X != NULL)
        plan = fftw_plan_dft_r2c_1d(L, x, X, FFTW_ESTIMATE);
    if (power == NULL || plan == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "colour: no memory for %d rows", L);
        goto out;
    }
    for (int c = 0; c < E->n; c++)
        add_periodogram(E->x + (size_t)c * E->ld, L, x, X, plan, power);
    for (int j = 0; j < count; j++) {
        double ratio = ratio_at(power, bins, theta[j], half);
        factor[j] = ratio > RATIO_LEAST ? sqrt(ratio) : 1;
    }
out:
    if (plan != NULL)
        fftw_destroy_plan(plan);
    fftw_free(x), fftw_free(X), free(power);
    return rc;
}
