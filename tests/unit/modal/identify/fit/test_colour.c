/* test_colour.c - error bars under noise that is not white */
#include "check.h"
#include <stdlib.h>
#include "modal/identify/fit/colour.h"
#include "modal/identify/fit/synthesis.h"
#include "signals.h"

enum { L = 2048 };

/* x[l] = a x[l-1] + white: its spectrum over its mean at angle theta is (1 - a^2) / |1 - a e^{-i
 * theta}|^2. */
static void autoregressive(double *x, double a)
{
    uint32_t z = 12345;

    for (int l = 0; l < L; l++) {
        z = 1664525u * z + 1013904223u;
        x[l] = (l > 0 ? a * x[l - 1] : 0) + z / 4294967296.0 - 0.5;
    }
}

TEST(white_noise_leaves_every_bar_as_it_is)
{
    double x[L], theta[9], factor[9];
    struct matrix E = { L, 1, L, x };

    autoregressive(x, 0);
    for (int j = 0; j < 9; j++)
        theta[j] = M_PI * j / 8;
    CHECK(colour_factors(&E, theta, 9, factor, NULL) == MODAL_OK);
    for (int j = 0; j < 9; j++)
        CHECK(factor[j] == 1);
}

TEST(coloured_noise_widens_by_the_root_of_its_spectrum)
{
    const double a = 0.9, theta[3] = { 0.15, 0.4, 2.5 };
    double x[L], factor[3];
    struct matrix E = { L, 1, L, x };

    autoregressive(x, a);
    CHECK(colour_factors(&E, theta, 3, factor, NULL) == MODAL_OK);
    for (int j = 0; j < 2; j++) {
        double ratio = (1 - a * a) / (1 - 2 * a * cos(theta[j]) + a * a);
        double expected = ratio > 2 ? sqrt(ratio) : 1;
        /* 65 bins: 12 % of the power, and its slope across them */
        CHECK_NEAR(factor[j], expected, 0.3 * expected);
    }
    CHECK(factor[2] == 1);   /* less noise than the mean is no reason to narrow a bar */
}

TEST(a_short_or_empty_residual_changes_nothing)
{
    double x[L] = { 0 }, theta = 0.3, factor = 7;
    struct matrix zero = { L, 1, L, x }, few = { 40, 1, 40, x };

    CHECK(colour_factors(&zero, &theta, 1, &factor, NULL) == MODAL_OK && factor == 1);
    factor = 7;
    CHECK(colour_factors(&few, &theta, 1, &factor, NULL) == MODAL_OK && factor == 1);
}

/* 2,000 records of each size.  Chi-square of 8 degrees exceeds 40 once in 320,000: two of 8,000
 * white records have a chance of 3e-4.  With 0.3 of the sample before in each, r_1 = 0.3 and the
 * statistic is at least 0.09 n = 184 with a deviation of 2 sqrt(184): 40 is five off. */
TEST(white_noise_is_white_at_any_seed_and_size_and_three_tenths_of_the_sample_before_is_not)
{
    static const struct {
        int rows, columns;
    } sizes[] = { { 2048, 1 }, { 300, 7 }, { 50, 64 }, { 1024, 3 } };
    static double x[4096];
    struct random r = { 5 };
    int alarms = 0, missed = 0;

    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (int seed = 0; seed < 2000; seed++) {
            struct matrix E = { sizes[i].rows, sizes[i].columns, sizes[i].rows, x };
            for (int k = 0; k < E.m * E.n; k++)
                x[k] = pow(10, k / E.m % 5) * random_normal(&r);
            alarms += !colour_white(&E);
            for (int k = 1; k < E.m * E.n; k++)
                x[k] += k % E.m > 0 ? 0.3 * x[k - 1] : 0;
            missed += colour_white(&E);
        }
    CHECK(alarms < 2);
    CHECK(missed == 0);
}

/* 24 lines over the lower half of the band take a tenth of the noise there away: 8,000 numbers show
 * that it is not white, and it is what white noise leaves. */
TEST(what_a_fit_of_many_poles_leaves_of_white_noise_is_told_from_colour)
{
    enum { ROWS = 200, COLUMNS = 40, POLES = 12, DRAWS = 100 };
    static double x[ROWS * COLUMNS], fitted[ROWS * COLUMNS];
    struct matrix Y = { ROWS, COLUMNS, ROWS, x }, F = { ROWS, COLUMNS, ROWS, fitted };
    double complex lambda[POLES];
    double mean[COLOUR_LAGS];
    struct random r = { 11 };
    int white = 0, about = 0;

    for (int j = 0; j < POLES; j++)
        lambda[j] = -0.002 + I * (0.1 + 0.12 * j);
    colour_left_by(lambda, POLES, 1, ROWS, mean);
    for (int draw = 0; draw < DRAWS; draw++) {
        struct synthesis fit = { 0 };
        for (int k = 0; k < ROWS * COLUMNS; k++)
            x[k] = random_normal(&r);
        CHECK(synthesis_fit(lambda, POLES, 1, &Y, &F, &fit, NULL) == MODAL_OK);
        synthesis_done(&fit);
        for (int k = 0; k < ROWS * COLUMNS; k++)
            x[k] -= fitted[k];
        white += colour_white(&Y), about += colour_white_about(&Y, mean, 0);
    }
    CHECK(white < DRAWS / 2);
    CHECK(about >= DRAWS - 1);
}

/* 40 is what the test stands in white noise. A motion of chi-squared 200 among 2,000 numbers turns
 * the autocorrelations by 0.1 cos: up to 8 x 20 more. Where it is known to be no larger it is let
 * pass; of three times that it is not. */
TEST(a_motion_that_may_be_hidden_is_no_colour_and_one_of_three_times_its_size_is)
{
    static double x[2000];
    struct matrix E = { 2000, 1, 2000, x };
    const double none[COLOUR_LAGS] = { 0 };
    struct random r = { 23 };

    for (int draw = 0; draw < 50; draw++) {
        double size = draw % 2 == 0 ? 200 : 600;
        for (int k = 0; k < 2000; k++)
            x[k] = random_normal(&r) + sqrt(size / 1000) * cos(0.02 * k);
        CHECK(!colour_white(&E));
        CHECK(colour_white_about(&E, none, 250) == (size == 200));
    }
}

TEST(columns_of_zeros_have_no_colour)
{
    double x[4 * L] = { 0 };
    struct matrix E = { L, 4, L, x };

    CHECK(colour_white(&E));
    autoregressive(x + 2 * L, 0);
    CHECK(colour_white(&E));
    autoregressive(x + 2 * L, 0.3);
    CHECK(!colour_white(&E));
}

/* Of K equal columns the correlations have one eigenvalue, K; of orthogonal ones K, all 1. */
TEST(columns_that_are_multiples_of_each_other_spread_as_one)
{
    double x[4 * L] = { 0 };
    struct matrix E = { L, 4, L, x };
    struct colour_spread s;

    for (int k = 0; k < L; k++)
        for (int c = 0; c < 3; c++)
            x[k + c * L] = (c + 1) * sin(0.7 * k) * (c == 1 ? -1e3 : 1);
    CHECK(colour_spread_of(&E, &s, NULL) == MODAL_OK);          /* the fourth is zero */
    CHECK_NEAR(s.square, 9, 1e-12);
    CHECK_NEAR(s.largest, 3, 1e-12);
    memset(x, 0, sizeof x);
    for (int c = 0; c < 4; c++)
        x[c + c * L] = c + 1;
    CHECK(colour_spread_of(&E, &s, NULL) == MODAL_OK);
    CHECK_NEAR(s.square, 4, 1e-12);
    CHECK_NEAR(s.largest, 1, 1e-12);
}
