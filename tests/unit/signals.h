/* signals.h - free decays with known exponents, white noise, and their Cramer-Rao bound, for tests
 * and benchmarks
 *
 * Everything here is computed apart from the code under test: signals in extended precision, the
 * bound from the whole Fisher information matrix (exponents and amplitudes of every channel),
 * inverted in extended precision.
 */
#ifndef TESTS_SIGNALS_H
#define TESTS_SIGNALS_H
#include <complex.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

struct random { uint64_t state; };

/* splitmix64 (Steele, Lea, Flood 2014): uniform in (0, 1), then Box-Muller. */
static inline double random_uniform(struct random *r)
{
    uint64_t z = r->state += 0x9e3779b97f4a7c15u;

    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return ((double)((z ^ (z >> 31)) >> 11) + 0.5) / 9007199254740992.0;
}

static inline double random_normal(struct random *r)
{
    double u = random_uniform(r), v = random_uniform(r);

    return sqrt(-2 * log(u)) * cos(2 * M_PI * v);
}

enum { DECAY_MODES = 8, DECAY_CHANNELS = 64 };

struct decay {
    int modes, channels, samples;
    double dt;
    double complex lambda[DECAY_MODES];                     /* Im > 0: a pair; Im = 0: real */
    double complex B[DECAY_MODES][DECAY_CHANNELS];          /* y = sum_j Re(B_j e^{lambda_j t}) */
};

static inline double complex decay_pole(double f_hz, double zeta)
{
    double w = 2 * M_PI * f_hz;

    return CMPLX(-zeta * w, w * sqrt(1 - zeta * zeta));
}

/* Amplitudes 0.4 to 1, phases anywhere. */
static inline void decay_amplitudes(struct decay *d, struct random *r)
{
    for (int j = 0; j < d->modes; j++)
        for (int c = 0; c < d->channels; c++) {
            double a = 0.4 + 0.6 * random_uniform(r), phase = 2 * M_PI * random_uniform(r);
            d->B[j][c] = cimag(d->lambda[j]) != 0 ? a * cexp(I * phase) : a;
        }
}

/* Samples of channel c at y[k + c*ld]. */
static inline void decay_signals(const struct decay *d, double *y, size_t ld)
{
    memset(y, 0, sizeof *y * ld * (size_t)d->channels);
    for (int c = 0; c < d->channels; c++)
        for (int k = 0; k < d->samples; k++) {
            long double t = (long double)k * (long double)d->dt, sum = 0;
            for (int j = 0; j < d->modes; j++) {
                long double e = expl((long double)creal(d->lambda[j]) * t),
                            w = (long double)cimag(d->lambda[j]) * t;
                sum += e * ((long double)creal(d->B[j][c]) * cosl(w) -
                            (long double)cimag(d->B[j][c]) * sinl(w));
            }
            y[(size_t)k + (size_t)c * ld] = (double)sum;
        }
}

/* White noise of SNR_DB below the mean square of all samples; its standard deviation. */
static inline double decay_noise(const struct decay *d, double *y, size_t ld, double snr_db,
                                 struct random *r)
{
    double sum = 0, sd;

    for (int c = 0; c < d->channels; c++)
        for (int k = 0; k < d->samples; k++)
            sum += y[(size_t)k + (size_t)c * ld] * y[(size_t)k + (size_t)c * ld];
    sd = sqrt(sum / d->samples / d->channels * pow(10, -snr_db / 10));
    for (int c = 0; c < d->channels; c++)
        for (int k = 0; k < d->samples; k++)
            y[(size_t)k + (size_t)c * ld] += sd * random_normal(r);
    return sd;
}

/* Inverse of a symmetric positive matrix in place, scaled to unit diagonal first (Gauss-Jordan). */
static inline void information_invert(long double *F, int n)
{
    long double *s = malloc(sizeof *s * (size_t)n);

    for (int i = 0; i < n; i++)
        s[i] = 1 / sqrtl(F[i + i * n]);
    for (int i = 0; i < n * n; i++)
        F[i] *= s[i % n] * s[i / n];
    for (int p = 0; p < n; p++) {
        long double pivot = F[p + p * n];
        F[p + p * n] = 1;
        for (int j = 0; j < n; j++)
            F[p + j * n] /= pivot;
        for (int i = 0; i < n; i++) {
            if (i == p)
                continue;
            long double f = F[i + p * n];
            F[i + p * n] = 0;
            for (int j = 0; j < n; j++)
                F[i + j * n] -= f * F[p + j * n];
        }
    }
    for (int i = 0; i < n * n; i++)
        F[i] *= s[i % n] * s[i / n];
    free(s);
}

/* The bound for noise SD on every sample: standard deviations of Re and Im of each exponent (Im of
 * a real one: 0). */
static inline void decay_bound(const struct decay *d, double sd, double *std_re, double *std_im)
{
    int at[DECAY_MODES], amplitude[DECAY_MODES], n = 0, columns = 0;
    long double *F, *g;

    for (int j = 0; j < d->modes; j++) {
        at[j] = n, amplitude[j] = columns;
        n += cimag(d->lambda[j]) != 0 ? 2 : 1, columns += cimag(d->lambda[j]) != 0 ? 2 : 1;
    }
    int all = n + columns * d->channels;
    F = calloc((size_t)all * (size_t)all, sizeof *F), g = calloc((size_t)all, sizeof *g);
    for (int c = 0; c < d->channels; c++)
        for (int k = 0; k < d->samples; k++) {
            long double t = (long double)k * (long double)d->dt;
            memset(g, 0, sizeof *g * (size_t)all);
            for (int j = 0; j < d->modes; j++) {
                long double e = expl((long double)creal(d->lambda[j]) * t),
                            w = (long double)cimag(d->lambda[j]) * t;
                long double co = e * cosl(w), si = e * sinl(w), br = (long double)creal(d->B[j][c]),
                            bi = (long double)cimag(d->B[j][c]);
                int a = n + columns * c + amplitude[j];
                g[at[j]] = t * (br * co - bi * si), g[a] = co;
                if (cimag(d->lambda[j]) != 0)
                    g[at[j] + 1] = -t * (br * si + bi * co), g[a + 1] = -si;
            }
            for (int i = 0; i < all; i++)
                for (int j = 0; g[i] != 0 && j < all; j++)
                    F[i + j * all] += g[i] * g[j];
        }
    information_invert(F, all);
    for (int j = 0; j < d->modes; j++) {
        std_re[j] = sd * (double)sqrtl(F[at[j] + at[j] * all]);
        std_im[j] = cimag(d->lambda[j]) != 0 ? sd * (double)sqrtl(F[at[j] + 1 + (at[j] + 1) * all])
                                             : 0;
    }
    free(F), free(g);
}

/* The six cases of the efficiency tests: sep, close, closehi, each short (200) and long (1200
 * samples), 3 channels. */
static const struct decay_case {
    const char *name;
    int samples, modes;
    double f[3], zeta[3];
} decay_cases[6] = {
    { "sep_short", 200, 3, { 1.0, 2.3, 4.1 }, { 0.01, 0.005, 0.02 } },
    { "close_short", 200, 2, { 2.00, 2.02 }, { 0.001, 0.002 } },
    { "closehi_short", 200, 2, { 2.00, 2.02 }, { 0.01, 0.02 } },
    { "sep_long", 1200, 3, { 1.0, 2.3, 4.1 }, { 0.01, 0.005, 0.02 } },
    { "close_long", 1200, 2, { 2.00, 2.02 }, { 0.001, 0.002 } },
    { "closehi_long", 1200, 2, { 2.00, 2.02 }, { 0.01, 0.02 } },
};

static inline void decay_of_case(const struct decay_case *k, struct random *r, struct decay *d)
{
    d->modes = k->modes, d->channels = 3, d->samples = k->samples, d->dt = 0.05;
    for (int j = 0; j < k->modes; j++)
        d->lambda[j] = decay_pole(k->f[j], k->zeta[j]);
    decay_amplitudes(d, r);
}
#endif
