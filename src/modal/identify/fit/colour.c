/*
 * colour.c - the power spectrum of a residual
 *
 * An exponent at theta is estimated from the data's component there, within 1/L or the mode's own
 * width: noise of power density S(theta) acts on it as white noise of that density would, so the
 * standard error scales with sqrt(S(theta) / S_white), S_white being the mean over all frequencies,
 * which is what the variance of the residual measures.
 *
 * S is the periodogram, of the rows padded with zeros to a length N that is planned quickly
 * (pencil.h), averaged over 2h+1 bins, h = max(8, N/64), and over the columns, each of unit power.
 * With c columns the relative fluctuation is 1/sqrt((2h+1) c) <= 0.24, and a ratio of 2 four
 * deviations off: below it nothing is changed, so white noise keeps its bars.
 *
 * [BP70] Box and Pierce, J. Amer. Statist. Assoc. 65 (1970) 1509-1526.
 */
#include <fftw3.h>       /* before complex.h, which makes its numbers the compiler's */
#include "modal/identify/fit/colour.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/pencil.h"
#include "modal/linalg/svd.h"

enum {
    HALF_LEAST = 8,                 /* h of the text, */
    HALF_PART = 64                  /* and what part of N it is where that is more */
};
static const double RATIO_LEAST = 2;    /* four deviations off */

/* Add the periodogram of one column over its NORM, padded to N, to power[0 .. N/2]. */
static void add_periodogram(const double *e, int L, int N, double norm, double *x, fftw_complex *X,
                            fftw_plan plan, double *power)
{
    for (int l = 0; l < L && norm > 0; l++)
        x[l] = e[l] / norm;         /* every column counts alike: its variance is its own */
    memset(x + L, 0, sizeof *x * (size_t)(N - L));
    if (norm == 0)
        return;
    fftw_execute(plan);
    for (int k = 0; k <= N / 2; k++)
        power[k] += X[k][0] * X[k][0] + X[k][1] * X[k][1];
}

/* The mean over the bins within `half` of theta, over that of all. */
static double ratio_at(const double *power, int bins, double theta, int half)
{
    int at = (int)lround(theta / M_PI * (bins - 1)), count = 0;  /* the nearest bin, 0 to Nyquist */
    double near = 0, all = 0;

    for (int k = 0; k < bins; k++) {
        all += power[k] / bins;
        if (abs(k - at) <= half)
            near += power[k], count++;
    }
    return all > 0 ? near / count / all : 1;
}

void colour_factors_of(const double *power, int rows, const double *theta, int count,
                       double *factor)
{
    int half = rows / HALF_PART > HALF_LEAST ? rows / HALF_PART : HALF_LEAST;

    for (int j = 0; j < count; j++) {
        double ratio = rows < REFINE_ROWS_LEAST ? 1 : ratio_at(power, rows / 2 + 1, theta[j], half);
        /* variance by the spectrum at its line over white noise's */
        factor[j] = ratio > RATIO_LEAST ? sqrt(ratio) : 1;
    }
}

enum modal_status colour_factors(const struct matrix *E, const double *theta, int count,
                                 double *factor, struct modal_error *err)
{
    int L = E->m, N = transform_length(L), bins = N / 2 + 1;
    double *x = NULL, *power = NULL;
    fftw_complex *X = NULL;
    fftw_plan plan = NULL;
    enum modal_status rc = MODAL_OK;

    for (int j = 0; j < count; j++)
        factor[j] = 1;
    /* of fewer the 17 bins that are averaged are half of all */
    if (L < REFINE_ROWS_LEAST || count == 0)
        return MODAL_OK;
    x = fftw_alloc_real(N), X = fftw_alloc_complex(bins), power = calloc(bins, sizeof *power);
    if (x != NULL && X != NULL)
        plan = fftw_plan_dft_r2c_1d(N, x, X, FFTW_ESTIMATE);
    if (power == NULL || plan == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "colour: no memory for %d rows", L);
        goto out;
    }
    for (int c = 0; c < E->n; c++)
        add_periodogram(E->x + (size_t)c * E->ld, L, N, safe_norm(E->x + (size_t)c * E->ld, L), x,
                        X, plan, power);
    colour_factors_of(power, N, theta, count, factor);
out:
    if (plan != NULL)
        fftw_destroy_plan(plan);
    fftw_free(x), fftw_free(X), free(power);
    return rc;
}

bool colour_white(const struct matrix *E)
{
    static const double none[COLOUR_LAGS] = { 0 };

    return colour_white_about(E, none, 0);
}

/* Autocorrelations of a column, over its square, times its rows, to r; chunk by chunk, so that a
 * chunk is read from memory once. */
static void add_lags(const double *e, int L, double norm, double *r)
{
    enum { CHUNK = 4096 };          /* rows: 32 kB, a first cache */
    double unit = 1 / norm;

    for (int at = 0; at < L; at += CHUNK)
        for (int l = 1; l <= COLOUR_LAGS && at + l < L; l++) {
            int n = L - l - at < CHUNK ? L - l - at : CHUNK;
            /* weighed by rows: divided by all of them at the end */
            r[l - 1] += L * (cblas_ddot(n, e + at, 1, e + at + l, 1) * unit * unit);
        }
}

/* Box and Pierce's test of R, sums over NUMBERS of which MEAN was to be expected, with HIDDEN
 * beside the noise. */
static bool lags_white(const double *r, double numbers, const double *mean, double hidden)
{
    double sum = 0;

    for (int l = 0; l < COLOUR_LAGS && numbers > 0; l++)
        sum += (r[l] / numbers - mean[l]) * (r[l] / numbers - mean[l]);
    /* chi-squared of COLOUR_LAGS for white noise */
    return numbers * numbers * sum <= numbers * COLOUR_LIMIT + COLOUR_LAGS * hidden * hidden;
}

bool colour_white_about(const struct matrix *E, const double *mean, double hidden)
{
    double n = 0, r[COLOUR_LAGS] = { 0 };

    for (int c = 0; c < E->n; c++) {
        const double *e = E->x + (size_t)c * (size_t)E->ld;
        double norm = safe_norm(e, E->m);
        n += norm > 0 ? E->m : 0;
        if (norm > 0)
            add_lags(e, E->m, norm, r);
    }
    return lags_white(r, n, mean, hidden);
}

bool colour_sum_white(const struct colour_sum *sum, const double *mean, double hidden)
{
    return lags_white(sum->r, sum->numbers, mean, hidden);
}

enum modal_status colour_add(const double *e, int rows, struct colour_sum *sum,
                             struct modal_error *err)
{
    enum { N = COLOUR_ROWS, BINS = N / 2 + 1 };
    double norm = quick_norm(e, (size_t)rows), *x = fftw_alloc_real(N);
    fftw_complex *X = fftw_alloc_complex(BINS);
    fftw_plan plan = x != NULL && X != NULL ? fftw_plan_dft_r2c_1d(N, x, X, FFTW_ESTIMATE) : NULL;

    if (sum->power == NULL)
        sum->power = calloc(BINS, sizeof *sum->power);
    if (plan != NULL && sum->power != NULL && norm > 0) {
        for (int l = 0; l + N <= rows; l += N)
            add_periodogram(e + l, N, N, norm, x, X, plan, sum->power);
        add_lags(e, rows, norm, sum->r);
        sum->numbers += rows;
    }
    if (plan != NULL)
        fftw_destroy_plan(plan);
    fftw_free(x), fftw_free(X);
    return plan != NULL && sum->power != NULL
               ? MODAL_OK
               : modal_fail(err, MODAL_NO_MEMORY, "colour: no memory for %d rows", N);
}

void colour_left_by(const double complex *lambda, int count, double tau, int rows, double *mean)
{
    double left = fmax(rows - poles_order(lambda, count, tau), 1);

    for (int l = 1; l <= COLOUR_LAGS; l++) {
        mean[l - 1] = 0;
        for (int j = 0; j < count; j++)
            /* a fit takes the part in its columns out: I - Q Q^T has these lags */
            mean[l - 1] -= pole_order(lambda[j], tau) * exp(-fabs(creal(lambda[j])) * tau * l)
                         * cos(cimag(lambda[j]) * tau * l) / left;
    }
}

void colour_leave_out(struct matrix *E, const struct matrix *Y, double ratio)
{
    for (int c = 0; c < E->n; c++) {
        double *e = E->x + (size_t)c * (size_t)E->ld;
        /* rounding is not white, and no noise either */
        if (safe_norm(e, E->m) <= ratio * safe_norm(Y->x + (size_t)c * (size_t)Y->ld, Y->m))
            memset(e, 0, sizeof *e * (size_t)E->m);
    }
}

enum modal_status colour_spread_of(const struct matrix *E, struct colour_spread *out,
                                   struct modal_error *err)
{
    int S = E->n;
    struct matrix G = matrix_new(S, S);
    double *unit = calloc((size_t)S + 1, sizeof *unit);
    enum modal_status rc = G.x == NULL || unit == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "colour: no memory for %d columns", S) : MODAL_OK;

    *out = (struct colour_spread) { 0, 1 };
    if (rc == MODAL_OK)
        cblas_dsyrk(CblasColMajor, CblasLower, CblasTrans, S, E->m, 1, E->x, E->ld, 0, G.x, S);
    for (int i = 0; i < S && rc == MODAL_OK; i++)
        unit[i] = G.x[i + i * S] > 0 ? 1 / sqrt(G.x[i + i * S]) : 0;
    for (int j = 0; j < S && rc == MODAL_OK; j++) {
        double row = 0;
        for (int i = 0; i < S; i++) {
            double r = (i > j ? G.x[i + j * S] : G.x[j + i * S]) * unit[i] * unit[j];
            out->square += r * r, row += fabs(r);
        }
        out->largest = fmax(out->largest, row);     /* Gershgorin's bound */
    }
    free(G.x), free(unit);
    return rc;
}
