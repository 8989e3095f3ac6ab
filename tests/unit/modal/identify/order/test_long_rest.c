/* One reading of what a fit leaves of a very long record, against readings of it one by one. */
#include "modal/identify/order/long_rest.h"
#include <stdlib.h>
#include "check.h"
#include "modal/identify/fit/compressed.h"
#include "modal/identify/order/remainder.h"
#include "signals.h"

/* Smooth, so that no transform is padded; two pairs are fitted of the four there are: one is weak,
 * one stands beside the first. */
enum { L = 1 << 17, S = 3 };

struct scene { struct decay d; struct matrix Y; struct refined fit; };

static struct scene scene_of(double noise_db)
{
    struct scene s = { .d = { .modes = 4, .channels = S, .samples = L, .dt = 0.05,
                              .lambda = { decay_pole(1.0, 1e-4), decay_pole(4.1, 2e-5),
                                          decay_pole(2.3, 5e-5), 0 } } };
    struct random rng = { 5 };
    double complex start[2];

    s.d.lambda[3] = s.d.lambda[0] + CMPLX(0, 1.0 / (L * s.d.dt));
    decay_amplitudes(&s.d, &rng);
    for (int c = 0; c < S; c++)
        s.d.B[2][c] *= 0.01, s.d.B[3][c] *= 0.03;
    s.Y = (struct matrix) { L, S, L, malloc(sizeof(double) * L * S) };
    decay_signals(&s.d, s.Y.x, L);
    decay_noise(&s.d, s.Y.x, L, noise_db, &rng);
    start[0] = s.d.lambda[0], start[1] = s.d.lambda[1];
    struct refine_data data = { .Y = &s.Y, .tau = s.d.dt };
    CHECK(refine_poles(&data, start, 2, NULL, NULL, &s.fit, NULL) == MODAL_OK);
    return s;
}

static void scene_done(struct scene *s)
{
    refined_done(&s->fit);
    free(s->Y.x);
}

/* Half way between two bins, and without a filter for its decay, a mode shows 0.4 of itself. */
TEST(one_reading_says_of_a_remainder_what_many_say)
{
    struct scene s = scene_of(40);
    struct refine_data data = { .Y = &s.Y, .tau = s.d.dt, .blocks = compressed_new(&s.Y) };
    struct long_rest rest;
    struct matrix E = { 0 };
    double chi2, mean[COLOUR_LAGS] = { 0 };
    double complex peak;

    CHECK(long_rest_look(&data, &s.fit, L, &rest, NULL) == MODAL_OK && rest.known);
    CHECK(remainder_of(&data, &s.fit, &E, NULL) == MODAL_OK);
    CHECK(remainder_peak(&E, s.d.dt, &peak, &chi2, NULL) == MODAL_OK);
    CHECK(rest.chi2 > 100 && rest.chi2 <= chi2 * (1 + 1e-9) && rest.chi2 > 0.3 * chi2);
    for (int j = 0; j < 2; j++) {
        CHECK(remainder_split(&E, s.d.dt, s.fit.lambda[j], false, &chi2, NULL) == MODAL_OK);
        CHECK_NEAR(rest.beside[j] / chi2, 1, 1e-6);
    }
    CHECK(rest.beside[0] > 100 && rest.beside[1] < 30);
    CHECK(!colour_sum_white(&rest.colour, mean, 0) && !colour_white_about(&E, mean, 0));
    compressed_free(data.blocks);
    long_rest_done(&rest);
    free(E.x);
    scene_done(&s);
}

/* What was not fitted: the weak pair, and one beside a pair that was. */
TEST(poles_that_a_remainder_shows_are_those_that_were_not_fitted)
{
    struct scene s = scene_of(40);
    struct refine_data data = { .Y = &s.Y, .tau = s.d.dt, .blocks = compressed_new(&s.Y) };
    struct long_rest rest;
    double complex found[8];
    double record = L * s.d.dt, least = HUGE_VAL;
    int count;

    CHECK(long_rest_look(&data, &s.fit, L, &rest, NULL) == MODAL_OK && rest.known);
    CHECK(rest.rows == L && long_rest_poles(&data, &s.fit, &rest, 8, found, &count, NULL)
          == MODAL_OK);
    for (int k = 0; k < count; k++)
        for (int j = 2; j < 4; j++)
            least = fmin(least, cabs(found[k] - s.d.lambda[j]) * record);
    CHECK(count >= 1 && count <= 8 && least < 0.5);    /* radians over the record */
    CHECK(fabs(rest.angle / s.d.dt - cimag(s.d.lambda[2])) * record < M_PI
          || fabs(rest.angle / s.d.dt - cimag(s.d.lambda[3])) * record < M_PI);
    compressed_free(data.blocks);
    long_rest_done(&rest);
    scene_done(&s);
}

/* Of a decay e^{-a l} n rows show (1 - e^{-a n})^2 / (a n), here 0.05 in all of them and 0.41 in a
 * sixteenth; where so many were searched before they are not looked at again. */
TEST(shorter_parts_are_looked_at_down_to_those_that_were)
{
    struct scene s = scene_of(40);
    struct refine_data data = { .Y = &s.Y, .tau = s.d.dt };
    struct refined fit;
    struct long_rest few, all;

    CHECK(refine_poles(&data, s.d.lambda, 4, NULL, NULL, &fit, NULL) == MODAL_OK);
    for (int c = 0; c < S; c++)
        for (int l = 0; l < L; l++)
            s.Y.x[l + (size_t)c * L] += 0.01 * exp(-20.0 * l / L) * cos(1.7 * l);
    data.blocks = compressed_new(&s.Y);
    CHECK(long_rest_look(&data, &fit, L, &few, NULL) == MODAL_OK);
    CHECK(long_rest_look(&data, &fit, L / 64, &all, NULL) == MODAL_OK);
    CHECK(few.chi2 > 50 && all.chi2 > 4 * few.chi2);
    compressed_free(data.blocks);
    long_rest_done(&few), long_rest_done(&all);
    refined_done(&fit);
    scene_done(&s);
}

/* Exact to rounding: nothing is left that could be a line, or have a colour. */
TEST(of_exact_signals_nothing_is_left)
{
    struct scene s = scene_of(400);
    struct refine_data data = { .Y = &s.Y, .tau = s.d.dt, .blocks = compressed_new(&s.Y) };
    struct refined fit;
    struct long_rest rest;
    double factor, theta = 1, mean[COLOUR_LAGS] = { 0 };

    CHECK(refine_poles(&data, s.d.lambda, 4, NULL, NULL, &fit, NULL) == MODAL_OK);
    CHECK(long_rest_look(&data, &fit, L, &rest, NULL) == MODAL_OK && rest.known);
    CHECK(rest.chi2 == 0 && colour_sum_white(&rest.colour, mean, 0));
    colour_factors_of(rest.colour.power, COLOUR_ROWS, &theta, 1, &factor);
    CHECK(factor == 1);
    compressed_free(data.blocks);
    long_rest_done(&rest);
    refined_done(&fit);
    scene_done(&s);
}
