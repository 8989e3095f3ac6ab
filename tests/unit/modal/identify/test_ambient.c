/* test_ambient.c - spectra of known systems: what a record's ends and bins make of them, and the
 * modes found in records */
#include "check.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/identify/ambient_order.h"

enum { N = 96, CHANNELS = 2 };

/* Two pairs seen by two channels, one of them as narrow as a line of the record. */
static struct whittle two_pairs(void)
{
    struct whittle m = { .channels = CHANNELS, .count = 2, .root = { 1.3, 0.4, 0, 0.7 } };

    m.mode[0].lambda = CMPLX(-0.031, 0.73), m.mode[1].lambda = CMPLX(-0.17, 1.9);
    for (int i = 0; i < CHANNELS; i++) {
        m.mode[0].phi[i] = CMPLX(1 - 0.6 * i, 0.2 * i), m.mode[1].phi[i] = CMPLX(0.4 + i, -0.3);
        m.mode[0].kappa[i] = CMPLX(0.07, 0.05 * i), m.mode[1].kappa[i] = CMPLX(-0.1 * i, 0.21);
    }
    return m;
}

static double complex H_of(const struct whittle *m, double complex z, int r, int c)
{
    double complex h = r == c;

    for (int k = 0; k < m->count; k++) {
        double complex mu = cexp(m->mode[k].lambda), p = m->mode[k].phi[r] * m->mode[k].kappa[c];
        h += p / (z - mu) + conj(p) / (z - conj(mu));
    }
    return h;
}

/* H R H^H at w, from its definition. */
static double complex S_of(const struct whittle *m, double w, int r, int c)
{
    double complex z = cexp(CMPLX(0, w)), sum = 0;

    for (int i = 0; i < CHANNELS; i++)
        for (int j = 0; j < CHANNELS; j++) {
            double R = 0;
            for (int k = 0; k < CHANNELS; k++)
                R += m->root[i + CHANNELS * k] * m->root[j + CHANNELS * k];
            sum += H_of(m, z, r, i) * R * conj(H_of(m, z, c, j));
        }
    return sum;
}

/* What a line j of a record of N samples shows in the mean: covariances, which are the Fourier
 * coefficients of S (their aliases decay by exp(-0.031 FINE)), under the triangle 1 - |k|/N. */
static double complex line_of(const struct whittle *m, int j, int r, int c)
{
    enum { FINE = 4096 };
    double complex sum = 0;

    for (int k = 1 - N; k < N; k++) {
        double complex covariance = 0;
        for (int f = 0; f < FINE; f++)
            covariance += S_of(m, 2 * M_PI * f / FINE, r, c)
                          * cexp(CMPLX(0, 2 * M_PI * ((double)f * k / FINE))) / FINE;
        sum += (1 - abs(k) / (double)N) * covariance * cexp(CMPLX(0, -2 * M_PI * j * k / N));
    }
    return sum;
}

static struct bins one_bin(int first, int lines, double *from, double *to, int *counts)
{
    counts[0] = 0, counts[1] = lines;
    *from = 2 * M_PI * (first - 0.5) / N, *to = *from + 2 * M_PI * lines / N;
    return (struct bins) { .count = 1, .channels = CHANNELS, .samples = N, .first = counts,
                           .lines = counts + 1, .from = from, .to = to };
}

/* The triangle is exact; sums of 4096 terms of a size up to 100 are off by some 1e-12 of that. */
TEST(a_line_shows_the_covariances_under_a_triangle)
{
    struct whittle m = two_pairs();
    struct whittle_covariances v;
    double from, to;
    int counts[2];
    double complex S[CHANNELS * CHANNELS];

    whittle_covariances(&m, &v);
    for (int j = 10; j < 13; j++) {
        struct bins b = one_bin(j, 1, &from, &to, counts);
        whittle_spectrum(&m, &v, &b, 0, S);
        for (int c = 0; c < CHANNELS; c++)
            for (int r = 0; r < CHANNELS; r++)
                CHECK_NEAR(cabs(S[r + CHANNELS * c] - line_of(&m, j, r, c)), 0,
                           1e-9 * cabs(S[0]));
    }
}

/* R_0 is the mean of S over all frequencies. */
TEST(the_covariance_at_no_lag_is_the_mean_of_the_spectrum)
{
    enum { FINE = 4096 };
    struct whittle m = two_pairs();
    struct whittle_covariances v;

    whittle_covariances(&m, &v);
    for (int c = 0; c < CHANNELS; c++)
        for (int r = 0; r < CHANNELS; r++) {
            double mean = 0;
            for (int f = 0; f < FINE; f++)
                mean += creal(S_of(&m, 2 * M_PI * f / FINE, r, c)) / FINE;
            CHECK_NEAR((v.zero[r + CHANNELS * c] + v.zero[c + CHANNELS * r]) / 2, mean,
                       1e-10 * fabs(v.zero[0]));
        }
}

/* The integral of (2) over a bin against 400 of its points by the midpoint rule, whose error is
 * (h / 400)^2 / 24 times a second derivative of 2 / 0.031^3. */
TEST(a_bin_shows_the_mean_of_what_lies_in_it)
{
    enum { POINTS = 400, LINES = 4 };
    struct whittle m = two_pairs();
    struct whittle_covariances v;
    double from, to, f, t;
    int counts[2], one[2];
    double complex S[CHANNELS * CHANNELS], point[CHANNELS * CHANNELS], mean = 0;
    struct bins wide = one_bin(9, LINES, &from, &to, counts);

    m.mode[0].lambda = CMPLX(-0.31, 0.73);               /* exp(-0.31 N) is 1e-13: z^N drops out */
    m.mode[1].lambda = CMPLX(-0.37, 1.9);
    whittle_covariances(&m, &v);
    whittle_spectrum(&m, &v, &wide, 0, S);
    for (int i = 0; i < POINTS; i++) {
        struct bins b = one_bin(9, 1, &f, &t, one);
        f = t = from + (i + 0.5) * (to - from) / POINTS;
        whittle_spectrum(&m, &v, &b, 0, point);
        mean += point[1] / POINTS;
    }
    CHECK_NEAR(cabs(S[1] - mean), 0, 1e-5 * cabs(mean));
}

/* Of a chi-squared variable the bound holds for every degree of freedom; of 2, where the tail is
 * exp(-t / 2), in closed form. */
TEST(the_price_is_above_what_chance_brings)
{
    const double alarm = 0.01;

    for (int lines = 100; lines <= 1000000; lines *= 10) {
        double twice = 2 * ambient_price(1, lines);
        /* four degrees of freedom: P = exp(-t/2) (1 + t/2) */
        CHECK(exp(-twice / 2) * (1 + twice / 2) * lines <= alarm);
        CHECK(exp(-twice / 2) * (1 + twice / 2) * lines > alarm * 1e-4);
    }
}
