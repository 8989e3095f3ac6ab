/* A band of a periodic system shows some of a mode's lines, at lambda + i k Omega; demodulation
 * moves them by a known frequency, and folding undoes it. */
#include "check.h"
#include "modal/identify/identify.h"
#include "signals.h"

enum { SAMPLES = 4000 };
static double x[2 * SAMPLES];
static const double dt = 0.01, period = 0.5;

/* Lines of lambda at k = -2 .. 2, amplitudes 1 / (1 + |k|), and a stronger mode of no interest at
 * low frequency. */
static void make(double complex lambda, double noise)
{
    struct random rng = { 41 };

    for (int i = 0; i < SAMPLES; i++) {
        double t = i * dt, Omega = 2 * M_PI / period, y[2] = { 0 };
        for (int k = -2; k <= 2; k++) {
            double complex z = cexp(CMPLX(creal(lambda), cimag(lambda) + k * Omega) * t) /
                               (1 + abs(k));
            y[0] += creal(z * CMPLX(1, 0.3 * k)), y[1] += creal(z * CMPLX(0.4, -1));
        }
        for (int c = 0; c < 2; c++)
            x[2 * i + c] = y[c] + 3 * exp(-0.05 * t) * cos(2 * M_PI * 0.9 * t + c) +
                           noise * random_normal(&rng);
    }
}

static struct identify_result identified(double low, double high)
{
    struct batch b = {
        .samples = SAMPLES, .channels = 2, .signals = x, .dt = dt, .period = period
    };
    struct identify_options opt = { .band = { low, high } };
    struct identify_result r;

    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    return r;
}

/* 0.35 Hz with Omega = 2 Hz: in 3 to 5 Hz lie 0.35 + 4 and, the conjugate's, 4 - 0.35. */
TEST(two_lines_in_a_band_are_one_mode_with_its_principal_exponent)
{
    const double complex lambda = CMPLX(-0.1, 2 * M_PI * 0.35);
    struct identify_result r;

    make(lambda, 0);
    r = identified(3, 5);
    CHECK(r.mode_count == 1);
    /* the stop band lets 90 dB less of the other mode through */
    CHECK_NEAR(creal(r.modes[0].exponent), creal(lambda), 1e-4);
    CHECK_NEAR(cimag(r.modes[0].exponent), cimag(lambda), 1e-4);
    CHECK(r.modes[0].harmonic_count == 2);
    CHECK(r.modes[0].harmonics[0].k == 2 || r.modes[0].harmonics[0].k == -2);
    CHECK(r.modes[0].harmonics[0].k == -r.modes[0].harmonics[1].k);
    CHECK_NEAR(cabs(r.modes[0].multiplier - cexp(lambda * period)), 0, 1e-4);
    identify_result_done(&r);
}

TEST(a_growing_mode_seen_by_one_line_of_a_band_is_unstable)
{
    struct identify_result r;

    make(CMPLX(0.05, 2 * M_PI * 0.35), 0.01);
    r = identified(4, 5);
    CHECK(r.mode_count == 1 && r.verdict == VERDICT_UNSTABLE);
    CHECK(fabs(creal(r.modes[0].exponent) - 0.05) < 5 * r.modes[0].std_re);
    CHECK(fabs(cimag(r.modes[0].exponent) - 2 * M_PI * 0.35) < 5 * r.modes[0].std_im);
    CHECK(r.modes[0].resolved_k == 2);
    identify_result_done(&r);
}
