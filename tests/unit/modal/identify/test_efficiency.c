/* The default identification is statistically efficient: a reduced run of
 * tests/bench/bench_efficiency.c, order unknown, defaults only.
 *
 * DRAWS draws of each of six cases at 40 and 20 dB.  Over the n parameters of a case the sum of
 * squared errors over their bounds is chi-square of mean n and deviation sqrt(2 n); the goal of 1.2
 * is missed by a true efficiency of 1 only beyond (0.2 n) / sqrt(2 n) deviations, and three more
 * are allowed here.  The share inside 95 % bars has deviation sqrt(0.05 * 0.95 / n); three are
 * allowed beyond 93 to 97 %.
 */
#include "modal/identify/identify.h"
#include <stdlib.h>
#include "check.h"
#include "efficiency.h"

enum { DRAWS = 25 };
static double samples[3 * 1200];

/* 2 of 25 wrong would be 92 %; at a true share of 98 % three or more wrong have a chance of 1.4 %,
 * with these fixed draws there is none. */
TEST(errors_follow_the_bound_the_order_is_right_and_bars_cover)
{
    const double levels[2] = { 40, 20 };

    for (int k = 0; k < 6; k++)
        for (int q = 0; q < 2; q++) {
            struct efficiency s = { 0 };
            for (int i = 0; i < DRAWS; i++)
                CHECK(efficiency_draw(
                    &decay_cases[k], levels[q],
                    77 + 1009 * (uint64_t)i + 100003 * (uint64_t)q + 1000003 * (uint64_t)k, &s));
            CHECK(s.right >= DRAWS - 2);
            CHECK(s.squares / s.parameters <= 1.2 + 3 * sqrt(2 / s.parameters));
            CHECK(s.inside / s.parameters >= 0.93 - 3 * sqrt(0.05 * 0.95 / s.parameters));
        }
}

/* Amplitudes and phases anywhere: 40 draws of a periodic system's signal, h[k + l p] = Re sum b[k]
 * rho^l, at 40 dB.  The multiplier's error over its stated standard deviation has mean square 1
 * (each of Re and Im): chi-square of 80, deviation 0.16; four of them. */
TEST(multipliers_of_periodic_systems_carry_their_standard_deviation)
{
    enum { P = 12, L = 30, RUNS = 40 };
    double sum = 0, n = 0;

    for (int run = 0; run < RUNS; run++) {
        struct random rng = { 900 + (uint64_t)run };
        double complex rho = (0.93 + 0.05 * random_uniform(&rng)) *
                             cexp((0.4 + 2.2 * random_uniform(&rng)) * I),
                       lambda = clog(rho);
        struct identify_options opt = { 0 };
        struct identify_result r;
        for (int k = 0; k < P; k++) {
            double complex b = (1 + 0.4 * cos(2 * M_PI * k / P + 1)) * cexp(lambda * k / P);
            for (int l = 0; l < L; l++)
                samples[l * P + k] = creal(b * cpow(rho, l)) + 5e-3 * random_normal(&rng);
        }
        struct batch b = {
            .samples = L * P, .channels = 1, .signals = samples, .dt = 1.0 / P, .period = 1
        };
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == 1);
        double complex e = r.modes[0].exponent - CMPLX(creal(lambda), fabs(cimag(lambda)));
        sum += pow(creal(e) / r.modes[0].std_re, 2) + pow(cimag(e) / r.modes[0].std_im, 2), n += 2;
        CHECK(cabs(r.modes[0].multiplier - cexp(r.modes[0].exponent)) < 1e-12);
        CHECK(fabs(r.modes[0].std_multiplier /
                       (hypot(r.modes[0].std_re, r.modes[0].std_im) * cabs(r.modes[0].multiplier)) -
                   1) < 1e-9);
        identify_result_done(&r);
    }
    CHECK(fabs(sum / n - 1) < 4 * sqrt(2 / n));
}
