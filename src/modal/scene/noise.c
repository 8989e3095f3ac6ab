/*
 * noise.c - see noise.h
 *
 * Values v_i at i h, of densities V(f) at 0 < f < 1 / (2 h), joined by straight lines have there
 *
 *     G(f) = V(f) sinc(f h)^4,   sinc x = sin(pi x) / (pi x),                   (1)
 *
 * and beyond it images that fall with f^-4.  So V = G / sinc^4 is drawn, line by line of a period
 * T = n h, n at least twice the values asked for, so that what is given does not repeat:
 *
 *     v_i = sum_{0 < j < n/2} a_j cos(2 pi i j / n) + b_j sin(2 pi i j / n),    (2)
 *
 * a_j and b_j normal, each of variance V(j / T) / T.
 */
#include "modal/scene/noise.h"
#include <complex.h>
#include <fftw3.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* In (0, 1]: 53 bits of a counter, mixed as in splitmix64: the same on every machine. */
static double uniform(uint64_t *counter)
{
    uint64_t x = *counter += 0x9e3779b97f4a7c15u;

    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
    x = (x ^ x >> 27) * 0x94d049bb133111ebu;
    return (double)((x ^ x >> 31) >> 11) / 9007199254740992.0 + 1 / 9007199254740992.0;
}

/* (a - i b) / 2 of (2), a and b of variance 1, by Box and Muller. */
static double complex line(uint64_t *counter)
{
    double radius = sqrt(-2 * log(uniform(counter))), angle = 2 * M_PI * uniform(counter);

    return CMPLX(radius * cos(angle) / 2, -radius * sin(angle) / 2);
}

/* V of (1) */
static double density(const struct noise *n, double f)
{
    double x = M_PI * f * n->step, sinc = sin(x) / x, r = f / n->corner;

    return n->psd / (sinc * sinc * sinc * sinc) / (1 + r * r);
}

enum modal_status noise_draw(const struct noise *n, int count, double *values,
                             struct modal_error *err)
{
    int size = 2;
    uint64_t counter = (uint64_t)n->seed << 32;        /* streams of seeds lie apart */
    double *x;
    fftw_complex *X;
    fftw_plan plan = NULL;

    while (size < 2 * count)
        size *= 2;
    x = fftw_alloc_real((size_t)size);
    X = fftw_alloc_complex((size_t)size / 2 + 1);
    if (x != NULL && X != NULL)
        plan = fftw_plan_dft_c2r_1d(size, X, x, FFTW_ESTIMATE);
    for (int j = 0; plan != NULL && j <= size / 2; j++) {
        double f = j / (size * n->step);

        X[j] = j == 0 || 2 * j == size ? 0
                                       : sqrt(density(n, f) / (size * n->step)) * line(&counter);
    }
    if (plan != NULL)
        fftw_execute(plan);                            /* (2) */
    for (int i = 0; plan != NULL && i < count; i++)
        values[i] = x[i];
    bool failed = plan == NULL;
    if (plan != NULL)
        fftw_destroy_plan(plan);
    fftw_free(x);
    fftw_free(X);
    return failed ? modal_fail(err, MODAL_NO_MEMORY, "noise: no memory for %d values", count)
                  : MODAL_OK;
}
