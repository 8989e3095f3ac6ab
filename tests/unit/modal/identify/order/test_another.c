/* One pole more than a fit has, against signals that have it or not. */
#include "modal/identify/order/another.h"
#include <stdlib.h>
#include "check.h"
#include "signals.h"

enum { L = 40, S = 60 };
static double y[L * S];

/* COUNT pairs in S columns, the last of them WEAK, in noise of variance 1. */
static struct matrix columns(const double complex *lambda, int count, double weak,
                             struct random *rng)
{
    for (int c = 0; c < S; c++) {
        double complex b[3];
        for (int j = 0; j < count; j++)
            b[j] = CMPLX(random_normal(rng), random_normal(rng)) * (j == count - 1 ? weak : 20);
        for (int l = 0; l < L; l++) {
            y[l + c * L] = random_normal(rng);
            for (int j = 0; j < count; j++)
                y[l + c * L] += creal(b[j] * cexp(lambda[j] * l));
        }
    }
    return (struct matrix) { L, S, L, y };
}

/* The fit of the first COUNT poles, and another. */
static void look(const struct matrix *Y, const double complex *lambda, int count,
                 struct refined *fit, struct another *a)
{
    struct refine_data data = { .Y = Y, .tau = 1, .phases = S };

    CHECK(refine_poles(&data, lambda, count, NULL, NULL, fit, NULL) == MODAL_OK);
    CHECK(another_pole(&data, fit, a, NULL) == MODAL_OK);
}

static const double complex lambda[] = { CMPLX(-0.02, 1.1), CMPLX(-0.05, 2.2),
                                         CMPLX(-0.2, 1.9) };

/* Of amplitudes of 1.5, decaying by e in five rows, chi-squared is about 60 x 2 x 1.5^2 x 1.25 =
 * 340 beside the 122 of noise: a hundredth of the places would do. */
TEST(a_pole_that_is_left_out_is_found_and_no_chance)
{
    struct random rng = { 5 };
    struct matrix Y = columns(lambda, 3, 1.5, &rng);
    struct refined fit;
    struct another a;

    look(&Y, lambda, 2, &fit, &a);
    CHECK(a.chance < 1e-6);
    CHECK(a.fit.poles == 3);
    CHECK(cabs(a.fit.lambda[2] - lambda[2]) < 5 * hypot(a.fit.std_re[2], a.fit.std_im[2]));
    refined_done(&fit), refined_done(&a.fit);
}

/* The chance is at least uniform: of 40 records with nothing left 0.05 is met by two in the mean,
 * by seven and more once in 300 sets (Poisson). */
TEST(where_nothing_is_left_the_best_pole_is_what_noise_gives)
{
    int doubted = 0;

    for (int run = 0; run < 40; run++) {
        struct random rng = { 100 + (uint64_t)run };
        struct matrix Y = columns(lambda, 2, 20, &rng);
        struct refined fit;
        struct another a;
        look(&Y, lambda, 2, &fit, &a);
        doubted += a.chance < 0.05;
        refined_done(&fit), refined_done(&a.fit);
    }
    CHECK(doubted <= 6);
}

TEST(a_look_that_fails_is_not_taken_for_one_that_finds_nothing)
{
    struct random rng = { 6 };
    struct matrix Y = columns(lambda, 2, 20, &rng);
    struct refine_data other = { .Y = &Y, .tau = 1, .phases = S - 1 };
    struct refined fit;
    struct another a;

    look(&Y, lambda, 2, &fit, &a);
    refined_done(&a.fit);
    CHECK(another_pole(&other, &fit, &a, NULL) == MODAL_BAD_INPUT);
    CHECK(a.fit.poles == 0 && a.chance == 1);
    refined_done(&fit);
}

enum { LONG = 300, FEW = 4 };
static double slow[LONG * FEW];

/* COUNT pairs LAMBDA of size 1 and random shapes in FEW signals, in noise of 0.1. */
static struct matrix slow_signals(const double complex *exponents, int count, struct random *rng)
{
    for (int c = 0; c < FEW; c++) {
        double complex b[3];
        for (int j = 0; j < count; j++)
            b[j] = CMPLX(random_normal(rng), random_normal(rng));
        for (int l = 0; l < LONG; l++) {
            slow[l + c * LONG] = 0.1 * random_normal(rng);
            for (int j = 0; j < count; j++)
                slow[l + c * LONG] += creal(b[j] * cexp(exponents[j] * l));
        }
    }
    return (struct matrix) { LONG, FEW, LONG, slow };
}

/* How many of 100 records grow in the fit of two pairs from START by its errors; of how many of
 * these it may be that none does. */
static int count_growing(const double complex *exponents, int count, const double complex *start,
                         int *may_decay)
{
    int grow = 0;

    *may_decay = 0;
    for (int run = 0; run < 100; run++) {
        struct random rng = { 900 + (uint64_t)run };
        struct matrix Y = slow_signals(exponents, count, &rng);
        struct refine_data data = { .Y = &Y, .tau = 1 };
        struct refined fit;
        CHECK(refine_poles(&data, start, 2, NULL, NULL, &fit, NULL) == MODAL_OK);
        for (int j = 0, seen = 0; j < 2 && refined_converged(&fit) && seen == 0; j++) {
            bool decays;
            if (!(creal(fit.lambda[j]) > 3 * fit.std_re[j]))
                continue;
            CHECK(another_decays(&data, &fit, j, &decays, NULL) == MODAL_OK);
            grow++, seen++, *may_decay += decays;
        }
        refined_done(&fit);
    }
    return grow;
}

/* Turns in the record, and e-foldings. */
static double complex slow_one(double turns, double rise)
{
    return CMPLX(rise / LONG, 2 * M_PI * turns / LONG);
}

TEST(what_three_slow_modes_without_growth_let_two_poles_draw_is_not_growth)
{
    double complex truth[] = { slow_one(3, -0.01), slow_one(3.15, -0.01), slow_one(3.4, -0.02) },
                   start[] = { truth[0], truth[2] };
    int may, grow = count_growing(truth, 3, start, &may);

    CHECK(grow >= 10);
    CHECK(may >= grow - 1);
}

TEST(of_two_slow_modes_that_which_grows_by_e_squared_has_to_whatever_is_beside_it)
{
    double complex truth[] = { slow_one(3, 2), slow_one(3.6, -0.3) };
    int may, grow = count_growing(truth, 2, truth, &may);

    CHECK(grow >= 95);
    CHECK(may <= 5);
}

TEST(of_a_mode_without_a_neighbour_within_a_beat_no_other_is_asked)
{
    double complex truth[] = { slow_one(3, 0.5), slow_one(4.5, -0.3) };
    int may, grow = count_growing(truth, 2, truth, &may);

    CHECK(grow >= 95);
    CHECK(may == 0);
}
