/*
 * harmonics.c - g_jk by the discrete Fourier transform over the phases of one period
 *
 *     g_k = (1/p) sum_n b[n] exp(-lambda n dt) exp(-i 2 pi k n / p).                            (1)
 *
 * With p even, k = p/2 and -p/2 are one column of the samples; it is listed as -p/2 and p/2 is left
 * out.  exp(-lambda n dt) lies within the factor |rho|^{-1}: a mode that decays by 1e-300 within a
 * period is scaled by its largest value first.
 */
#include "modal/identify/answer/harmonics.h"
#include <fftw3.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/linear/exponents.h"
#include "modal/numbers.h"

static const double
    TIED = 1e-6,                    /* of a magnitude: partners' differ by the fit's rounding */
    TOP_MOST = 300;                 /* ln of a growth whose square, e^600, leaves 1e47 to it */

static int by_magnitude(const void *a, const void *b)
{
    const struct identify_harmonic *p = a, *q = b;

    if (p->magnitude != q->magnitude)
        return p->magnitude > q->magnitude ? -1 : 1;
    return (p->k > q->k) - (p->k < q->k);
}

static double signed_frequency(double complex lambda, double period, int k)
{
    return cimag(lambda) + 2 * M_PI / period * k;
}

/* One and the same frequency but for its sign: the tied partners of real multipliers. */
static bool same_frequency(double complex lambda, double period, int j, int k)
{
    double a = fabs(signed_frequency(lambda, period, j)),
           b = fabs(signed_frequency(lambda, period, k));

    /* of 1 / period: frequencies, to rounding and a few digits */
    return fabs(a - b) < REFINE_TIED * 2 * M_PI / period;
}

void harmonics_choose(struct identify_harmonic *list, int count, double complex lambda,
                      double period, int *resolved, double *runner_up)
{
    int best = 0;

    qsort(list, count, sizeof *list, by_magnitude);
    *resolved = 0, *runner_up = 0;
    for (int i = 1; i < count && list[i].magnitude >= (1 - TIED) * list[0].magnitude; i++) {
        double f = fabs(signed_frequency(lambda, period, list[i].k)),
               g = fabs(signed_frequency(lambda, period, list[best].k));
        bool same = same_frequency(lambda, period, list[i].k, list[best].k);
        /* of equal ones the lowest frequency; of one frequency's two signs the positive k */
        if ((same && list[i].k > list[best].k) || (!same && f < g))
            best = i;
    }
    if (count == 0)
        return;
    *resolved = list[best].k;
    for (int i = 0; i < count; i++)
        if (!same_frequency(lambda, period, list[i].k, *resolved)) {
            *runner_up = list[best].magnitude > 0 ? list[i].magnitude / list[best].magnitude : 0;
            break;
        }
}

/* (1) for one signal, its squares added to power[0..p-1]. */
static void add_power(const double complex *b, size_t stride, int p, double complex lambda,
                      double period, double complex *a, fftw_plan plan, double *power)
{
    /* (1) takes e^{-lambda t} out, which may overflow: its largest factor apart */
    double growth = -creal(lambda) * period / p, top = growth > 0 ? growth * (p - 1) : 0,
           turn = -cimag(lambda) * period / p;

    for (int n = 0; n < p; n++)
        a[n] = b[n * stride] * exp(growth * n - top) * CMPLX(cos(turn * n), sin(turn * n)) / p;
    fftw_execute(plan);
    top = top < TOP_MOST ? exp(top) : 1;
    for (int k = 0; k < p; k++)
        power[k] += numbers_square(a[k]) * top * top;
}

enum modal_status harmonics_of(const double complex *b, size_t stride, int p, int signals,
                               double complex lambda, double period, struct identify_harmonic *out,
                               int *count, int *resolved, double *runner_up,
                               struct modal_error *err)
{
    double complex *a = fftw_malloc(sizeof *a * p);
    double *power = calloc(p, sizeof *power);
    struct identify_harmonic *all = malloc(sizeof *all * p);
    fftw_plan plan = a != NULL
        ? fftw_plan_dft_1d(p, (fftw_complex *)a, (fftw_complex *)a, FFTW_FORWARD, FFTW_ESTIMATE)
        : NULL;
    enum modal_status rc = MODAL_OK;

    if (power == NULL || all == NULL || plan == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "harmonics: no memory for %d phases", p);
        goto out;
    }
    for (int s = 0; s < signals; s++)
        add_power(b + (size_t)s * p * stride, stride, p, lambda, period, a, plan, power);
    for (int k = 0; k < p; k++)
        /* bins past the middle are negative k */
        all[k] = (struct identify_harmonic) { 2 * k < p ? k : k - p, sqrt(power[k]) };
    harmonics_choose(all, p, lambda, period, resolved, runner_up);
    *count = p < HARMONICS_REPORTED ? p : HARMONICS_REPORTED;
    memcpy(out, all, sizeof *out * *count);
out:
    if (plan != NULL)
        fftw_destroy_plan(plan);
    fftw_free(a);
    free(power);
    free(all);
    return rc;
}
