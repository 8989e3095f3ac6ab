/* test_ambient_lift.c - the samples of a period side by side, and where a mode of them moves */
#include "check.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/identify/ambient/ambient_lift.h"

enum { PHASES = 5, PERIODS = 40, CHANNELS = 2, SAMPLES = PHASES * PERIODS + 3 };

/* Channel 0: what repeats; channel 1: that and a ramp from period to period. */
static void fill(double y[CHANNELS * SAMPLES])
{
    for (int k = 0; k < SAMPLES; k++) {
        y[k] = sin(2 * M_PI * (k % PHASES) / PHASES) + 0.3;
        y[SAMPLES + k] = y[k] + 0.01 * (k / PHASES);
    }
}

TEST(what_repeats_goes_and_what_does_not_stays)
{
    double y[CHANNELS * SAMPLES];
    struct matrix Y = { SAMPLES, CHANNELS, SAMPLES, y };

    fill(y);
    ambient_lift_settle(&Y, PHASES);
    CHECK(Y.m == PHASES * PERIODS);
    for (int k = 0; k < Y.m; k++) {
        CHECK(y[k] == 0);
        CHECK_NEAR(y[SAMPLES + k], 0.01 * (k / PHASES - (PERIODS - 1) / 2.), 1e-13);
    }
}

TEST(a_row_holds_one_period_and_a_column_one_phase_of_one_channel)
{
    double y[CHANNELS * SAMPLES];
    struct matrix Y = { SAMPLES, CHANNELS, SAMPLES, y }, lifted;
    struct modal_error err;

    for (int k = 0; k < CHANNELS * SAMPLES; k++)
        y[k] = k;
    CHECK(ambient_lift(&Y, SAMPLES, PHASES, &lifted, &err) == MODAL_OK);
    CHECK(lifted.m == PERIODS && lifted.n == PHASES * CHANNELS);
    for (int m = 0; m < PERIODS; m++)
        for (int c = 0; c < CHANNELS; c++)
            for (int k = 0; k < PHASES; k++)
                CHECK(lifted.x[m + lifted.ld * (size_t)(k + PHASES * c)]
                      == c * SAMPLES + m * PHASES + k);
    free(lifted.x);
    CHECK(ambient_lift(&Y, SAMPLES, 1, &lifted, &err) == MODAL_OK);
    CHECK(lifted.m == SAMPLES && lifted.n == CHANNELS && lifted.x[SAMPLES + 1] == y[SAMPLES + 1]);
    free(lifted.x);
}

/* A motion (1 + 0.4 exp(-i Omega t)) exp((lambda + 2 i Omega) t) of one channel, and 0.7i of it in
 * the other: harmonics 2 and 1, of sizes 1 to 0.4. */
TEST(a_mode_moves_at_its_strongest_harmonic)
{
    const double period = 0.7, Omega = 2 * M_PI / period;
    struct identify_mode m = { .exponent = CMPLX(-0.31, 1.2) };
    double complex b[PHASES * CHANNELS];
    struct modal_error err;

    for (int k = 0; k < PHASES; k++) {
        double t = period * k / PHASES;
        b[k] = (1 + 0.4 * cexp(CMPLX(0, -Omega * t)))
               * cexp((m.exponent + CMPLX(0, 2 * Omega)) * t);
        b[PHASES + k] = CMPLX(0, 0.7) * b[k];
    }
    CHECK(ambient_lift_resolve(b, PHASES, CHANNELS, period, &m, &err) == MODAL_OK);
    CHECK(m.resolved_k == 2 && m.harmonic_count == PHASES && m.harmonics[1].k == 1);
    CHECK_NEAR(m.runner_up, 0.4, 1e-12);
    CHECK_NEAR(cimag(m.resolved), 1.2 + 2 * Omega, 1e-12);
    for (int c = 0; c < CHANNELS; c++)
        CHECK_NEAR(cabs(ambient_lift_component(b + c * PHASES, PHASES, m.resolved * period)
                        - (c == 0 ? 1 : CMPLX(0, 0.7))), 0, 1e-12);
    free(m.harmonics);
}
