/* Noise of which the samples before tell, against its own innovations. */
#include "modal/identify/order/whiten.h"
#include <math.h>
#include <stdbool.h>
#include "check.h"
#include "signals.h"

enum { L = 400, PHASES = 24, SIGNALS = 2, S = PHASES * SIGNALS };
static double y[L * S], e[L * S];

/* Noise that is told by AR(1) of A in the first signal, from the end of a period into the next, and
 * white in the second. */
static void noise(double a, uint64_t seed)
{
    struct random r = { seed };
    double before = random_normal(&r) / sqrt(1 - a * a);

    for (int l = 0; l < L; l++)
        for (int c = 0; c < S; c++) {
            double u = random_normal(&r);
            e[l + c * L] = c < PHASES ? before = a * before + u : u;
        }
    memcpy(y, e, sizeof y);
}

/* An AR(1) coefficient is known to 1 / sqrt(L PHASES) = 0.01 of its deviations. */
TEST(correlated_noise_is_left_white_within_a_period_and_from_one_to_the_next)
{
    const double a = 0.9;
    struct matrix Y = { L, S, L, y }, E = { L, S, L, e };
    struct periods all = { &Y, PHASES, L * PHASES };
    double told;

    noise(a, 1);
    CHECK(whiten_periods(&all, &E, 0, 100, &told, NULL) == MODAL_OK);
    CHECK_NEAR(told, 0.5 * a * a, 0.02);            /* of two signals one */
    CHECK(Y.m == L - 1);
    for (int later = 0; later < 2; later++)
        for (int c = 0; c < S; c++)
            for (int k = 0; k < S; k++) {
                double sum = 0;
                for (int l = later; l < Y.m; l++)
                    sum += y[l + c * L] * y[l - later + k * L] / L;
                bool same = c == k && later == 0;
                CHECK_NEAR(sum, same, 5 * sqrt((same ? 2.0 : 1.0) / L));
            }
}

/* Of each sample of a period a multiplier makes the next period's, and so it does of what is
 * left. */
TEST(what_multiplies_from_period_to_period_does_so_whitened_from_the_first_on)
{
    struct matrix Y = { L, S, L, y }, E = { L, S, L, e };
    struct periods all = { &Y, PHASES, L * PHASES };
    double told;

    noise(0.9, 2);
    for (int c = 0; c < S; c++)
        for (int l = 0; l < L; l++)
            y[l + c * L] = pow(0.8, l) * (1 + c % 5);
    CHECK(whiten_periods(&all, &E, 0, 100, &told, NULL) == MODAL_OK && told > 0);
    CHECK(Y.m == L - 1);
    for (int c = 0; c < S; c++) {
        CHECK(fabs(y[c * L]) > 0.01);
        for (int l = 1; l < 30; l++)
            CHECK_NEAR(y[l + c * L], pow(0.8, l) * y[c * L], 1e-14);
    }
}

/* All of the first period but one sample is kept, and the last period is gone. */
TEST(what_is_left_begins_a_sample_after_the_first_for_each_that_predicts)
{
    struct matrix Y = { L, S, L, y }, E = { L, S, L, e };
    struct periods all = { &Y, PHASES, L * PHASES };
    double told;

    noise(0.9, 3);
    memset(y, 0, sizeof y);
    y[1 * L] = 1;                                   /* sample 1 of period 0, first signal */
    y[(PHASES + 1) * L] = 1;                        /* and second */
    CHECK(whiten_periods(&all, &E, 0, 100, &told, NULL) == MODAL_OK);
    CHECK_NEAR(y[0], 1, 0);
    CHECK_NEAR(y[1 * L], -0.9, 0.02);
    CHECK_NEAR(y[PHASES * L], 1, 0);
    CHECK(all.samples == L * PHASES - 1);
}

/* A motion that a fit lacks is told by neighbours as noise is, but it is two directions of all and
 * stays two (unless it is a few tones within a period, which (2) can take whole). */
static void missing(double amplitude, double bend)
{
    struct matrix Y = { L, S, L, y }, E = { L, S, L, e };
    struct periods all = { &Y, PHASES, L * PHASES };
    double told;

    noise(0, 4);
    for (int c = 0; c < S; c++)
        for (int l = 0; l < L; l++)
            e[l + c * L] += amplitude * pow(0.99, l)
                            * sin(0.2 * (c % PHASES) + bend * pow(c % PHASES, 2) + 1.3 * l);
    memcpy(y, e, sizeof y);
    CHECK(whiten_periods(&all, &E, 0, 100, &told, NULL) == MODAL_OK && told == 0);
    CHECK(memcmp(y, e, sizeof y) == 0 && Y.m == L);
}

/* A tone (no bend) is what samples before tell best. */
TEST(a_multiplier_that_is_missing_from_the_fit_is_not_told_away)
{
    for (double amplitude = 2; amplitude < 1e5; amplitude *= 3) {
        missing(amplitude, 0);
        missing(amplitude, 0.01);
        missing(amplitude, 0.05);
    }
}

/* sum w^2 / S of columns with variance 1 is the mean of each column's squared correlations. */
TEST(spread_is_one_of_white_noise_and_one_over_the_free_share_of_coloured)
{
    struct matrix E = { L, PHASES, L, e };
    double spread, sum = 0, a = 0.6;

    noise(0, 5);
    CHECK(noise_spread(&E, L, &spread, NULL) == MODAL_OK);
    CHECK_NEAR(spread, 1, NOISE_CHANCE / L);
    noise(a, 6);
    CHECK(noise_spread(&E, L, &spread, NULL) == MODAL_OK);
    for (int j = 0; j < PHASES; j++)
        for (int k = 0; k < PHASES; k++)
            sum += pow(a, 2 * abs(j - k)) / PHASES;
    CHECK_NEAR(spread, sum, 5 * NOISE_CHANCE / L * sum);
    E.m = 1, E.ld = L;
    CHECK(noise_spread(&E, 1, &spread, NULL) == MODAL_OK && isinf(spread));
}

TEST(white_noise_stays_as_it_is)
{
    for (uint64_t seed = 10; seed < 30; seed++) {
        struct matrix Y = { L, S, L, y }, E = { L, S, L, e };
        struct periods all = { &Y, PHASES, L * PHASES };
        double told;

        noise(0, seed);
        CHECK(whiten_periods(&all, &E, 0, 100, &told, NULL) == MODAL_OK && told == 0);
        CHECK(memcmp(y, e, sizeof y) == 0 && Y.m == L);
    }
}

/* Periods of two signals, 240 samples each: noise of variance 1 that is correlated by a^j over j
 * samples, and two multipliers with all harmonics' worth of a period's shape at 100 times that. */
enum { FEW = 40, LONG = 240, WIDE = 2 * LONG };

static void few_periods(double a, uint64_t seed)
{
    struct random r = { seed };

    for (int g = 0; g < 2; g++) {
        double before = random_normal(&r);
        for (int l = 0; l < FEW; l++)
            for (int k = 0; k < LONG; k++) {
                double phase = 6.283185307179586 * k / LONG;
                before = a * before + sqrt(1 - a * a) * random_normal(&r);
                y[l + (g * LONG + k) * FEW] = before + 100 * pow(0.95, l) * cos(phase + g)
                                              + 100 * pow(-0.9, l) * sin(2 * phase + g);
            }
    }
}

TEST(noise_beside_strong_multipliers_is_made_white_before_they_are_known)
{
    const double a[] = { 0.9, 0.97, -0.8 };

    for (int i = 0; i < 3; i++) {
        struct matrix Y = { FEW, WIDE, FEW, y };
        struct periods all = { &Y, LONG, FEW * LONG };
        double told;
        few_periods(a[i], 40 + (uint64_t)i);
        CHECK(whiten_first(&all, NULL, 100, &told, NULL) == MODAL_OK);
        /* a third of the distance to the next power of a half; directions draw some of it */
        CHECK_NEAR(sqrt(told), fabs(a[i]), 0.02);
        CHECK(Y.m == FEW - 1);
    }
}

TEST(white_noise_beside_strong_multipliers_stays_as_it_is)
{
    for (uint64_t seed = 50; seed < 70; seed++) {
        struct matrix Y = { FEW, WIDE, FEW, y };
        struct periods all = { &Y, LONG, FEW * LONG };
        double told;
        few_periods(0, seed);
        memcpy(e, y, sizeof y);
        CHECK(whiten_first(&all, NULL, 100, &told, NULL) == MODAL_OK && told == 0);
        CHECK(memcmp(y, e, sizeof y) == 0 && Y.m == FEW);
    }
}

/* Of few columns beside periods, weak multipliers in white noise look as noise that is correlated:
 * each takes up all that (3) can tell of it. */
TEST(many_weak_multipliers_in_white_noise_of_few_columns_are_not_told_away)
{
    enum { SHORT = 24, COLUMNS = 2 * SHORT, WEAK = 16 };

    for (uint64_t seed = 70; seed < 90; seed++) {
        struct matrix Y = { FEW, COLUMNS, FEW, y };
        struct periods all = { &Y, SHORT, FEW * SHORT };
        struct random r = { seed };
        double told;
        for (int i = 0; i < FEW * COLUMNS; i++)
            y[i] = random_normal(&r);
        for (int g = 0; g < WEAK; g++) {
            double amplitude = 1 + 2 * random_uniform(&r);
            double turn = 6.283185307179586 * random_uniform(&r);
            for (int c = 0; c < COLUMNS; c++) {
                double shape = amplitude * cos(6.283185307179586 * (g / 2) * (c % SHORT) / SHORT
                                               + turn + c / SHORT);
                for (int l = 0; l < FEW; l++)
                    y[l + c * FEW] += shape * pow(0.97, l) * cos(turn * l);
            }
        }
        memcpy(e, y, sizeof y);
        CHECK(whiten_first(&all, NULL, 100, &told, NULL) == MODAL_OK && told == 0);
        CHECK(memcmp(y, e, sizeof y) == 0 && Y.m == FEW);
    }
}
