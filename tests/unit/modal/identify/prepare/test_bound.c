/* test_bound.c - the information of the samples that are there, against closed forms */
#include "check.h"
#include "signals.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/identify/prepare/bound.h"

enum { ROWS = 4000 };
static double y[ROWS];

/* One pole's motion of amplitude 1, in noise that no bound's ratio depends on. */
static void make(double complex lambda)
{
    struct random r = { 5 };

    for (int l = 0; l < ROWS; l++)
        y[l] = creal(cexp(lambda * l)) + 0.01 * random_normal(&r);
}

static void factors(double complex lambda, struct wild wild, struct steps steps, double factor[2])
{
    struct matrix Y = { ROWS, 1, ROWS, y };
    struct modal_error err;

    make(lambda);
    CHECK(bound_factors(&(struct rebuild_model) { &lambda, 1, 1, 1 }, &Y, &wild, &steps,
                        factor, &err) == MODAL_OK);
}

/* The variance of an undamped sine's frequency, and of its damping, goes as L^-3 (to 1 / turns). */
TEST(half_of_a_sine_s_samples_at_an_end_are_worth_seven_eighths_of_its_information)
{
    struct wild_sample at[ROWS / 2];
    double factor[2];

    for (int i = 0; i < ROWS / 2; i++)
        at[i] = (struct wild_sample) { ROWS / 2 + i, 0, 0 };
    factors(CMPLX(0, 0.3137), (struct wild) { .at = at, .count = ROWS / 2 },
            (struct steps) { 0 }, factor);
    CHECK_NEAR(factor[0], sqrt(8), 0.02);
    CHECK_NEAR(factor[1], sqrt(8), 0.02);
}

/* Every second sample: half of the information wherever it lies. */
TEST(every_second_sample_missing_costs_a_factor_of_root_two)
{
    struct wild_sample at[ROWS / 2];
    double factor[2];

    for (int i = 0; i < ROWS / 2; i++)
        at[i] = (struct wild_sample) { 2 * i, 0, 0 };
    factors(CMPLX(-1e-3, 0.3137), (struct wild) { .at = at, .count = ROWS / 2 },
            (struct steps) { 0 }, factor);
    CHECK_NEAR(factor[0], sqrt(2), 0.02);
    CHECK_NEAR(factor[1], sqrt(2), 0.02);
}

/* What is nearly constant has the derivative t, of which the mean leaves L^3 / 12, and a mean on
 * either side of a step in the middle 2 (L/2)^3 / 12. */
TEST(a_step_in_the_middle_doubles_the_error_of_a_slow_decay_and_leaves_a_sine_s)
{
    struct step at = { ROWS / 2, 0, 1, 0 };
    struct steps steps = { &at, 1 };
    double factor[2];

    factors(-1e-9, (struct wild) { 0 }, steps, factor);
    CHECK_NEAR(factor[0], 2, 0.01);
    CHECK_NEAR(factor[1], 1, 1e-12);
    factors(CMPLX(0, 0.3137), (struct wild) { 0 }, steps, factor);
    CHECK_NEAR(factor[0], 1, 0.01);
    CHECK_NEAR(factor[1], 1, 0.01);
}

TEST(what_lacks_nothing_costs_nothing)
{
    double factor[2];

    factors(CMPLX(-1e-3, 0.3137), (struct wild) { 0 }, (struct steps) { 0 }, factor);
    CHECK(factor[0] == 1 && factor[1] == 1);
}

/* At four phases of a period a sine is one of four times the frequency: what is known of it goes as
 * before with the periods that are there, and so does a step's price. */
TEST(periods_that_lack_samples_cost_what_rows_do)
{
    enum { SHIFT = 4 };
    static struct wild_sample at[ROWS / 2];
    struct step jump = { ROWS / 2, 0, 1, 0 };
    struct wild none = { 0 }, half = { .at = at, .count = ROWS / 2 };
    struct steps still = { 0 }, step = { &jump, 1 };
    double complex lambda = CMPLX(-1e-9, 0.3137);
    struct matrix Y = { ROWS, 1, ROWS, y };
    struct rebuild_model poles = { &lambda, 1, SHIFT, SHIFT };
    struct modal_error err;
    double factor[2];

    make(lambda);
    for (int i = 0; i < ROWS / 2; i++)
        at[i] = (struct wild_sample) { ROWS / 2 + i, 0, 0 };
    CHECK(bound_factors(&poles, &Y, &half, &still, factor, &err) == MODAL_OK);
    CHECK_NEAR(factor[0], sqrt(8), 0.03);
    CHECK_NEAR(factor[1], sqrt(8), 0.03);
    for (int i = 0; i < ROWS / 2; i++)
        at[i].row = 2 * i;
    CHECK(bound_factors(&poles, &Y, &half, &still, factor, &err) == MODAL_OK);
    CHECK_NEAR(factor[0], sqrt(2), 0.03);
    CHECK(bound_factors(&poles, &Y, &none, &still, factor, &err) == MODAL_OK);
    CHECK(factor[0] == 1 && factor[1] == 1);
    lambda = -1e-9;
    make(lambda);
    CHECK(bound_factors(&poles, &Y, &none, &step, factor, &err) == MODAL_OK);
    CHECK_NEAR(factor[0], 2, 0.02);
}
