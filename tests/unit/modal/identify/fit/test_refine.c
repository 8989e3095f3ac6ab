/* Variable projection against closed forms, and against the Cramer-Rao bound computed apart
 * (signals.h). */
/* Tests as well: refine_covariance.c refine_evaluate.c refine_search.c */
#include "modal/identify/fit/refine.h"
#include <float.h>
#include "check.h"
#include "modal/identify/fit/compressed.h"
#include "signals.h"

static double y[64 * 4096];

static struct matrix signals_of(const struct decay *d)
{
    decay_signals(d, y, (size_t)d->samples);
    return (struct matrix) { d->samples, d->channels, d->samples, y };
}

static struct decay three(int samples, uint64_t seed)
{
    struct decay d = { .modes = 3,
                       .channels = 3,
                       .samples = samples,
                       .dt = 0.05,
                       .lambda = { decay_pole(1.0, 0.01), decay_pole(2.3, 0.005),
                                   decay_pole(4.1, 0.02) } };
    struct random r = { seed };

    decay_amplitudes(&d, &r);
    return d;
}

/* The record holds L theta = 1200 * 1.3 rad of the fastest mode: exponents to DBL_EPSILON times
 * that, relative to 1/record. */
TEST(clean_signals_give_back_their_exponents_to_rounding_from_a_start_a_thousandth_off)
{
    struct decay d = three(1200, 1);
    struct matrix Y = signals_of(&d);
    struct refine_data data = { &Y, d.dt, 0, 0, NULL, false, 0, NULL, 0, 0 };
    double complex start[3];
    struct refined r;

    for (int j = 0; j < 3; j++)
        start[j] = d.lambda[j] * CMPLX(1.001, 0.0007);
    CHECK(refine_poles(&data, start, 3, NULL, NULL, &r, NULL) == MODAL_OK);
    CHECK(refined_converged(&r));
    for (int j = 0; j < 3; j++)
        CHECK_NEAR(cabs(r.lambda[j] - d.lambda[j]), 0, 1e-13 * cabs(d.lambda[j]));
    CHECK(r.residual < 1e-11);
    refined_done(&r);
}

/* Three lines of one multiplier, lambda, lambda + i omega and the conjugate of lambda - i omega,
 * have two unknowns, and apart as they are what each tells of them adds up: 1/std^2 is the sum of
 * the bounds' for each line on its own.  They cross by e^{-14} at most. */
TEST(lines_of_one_multiplier_have_one_exponent_and_the_errors_of_all_of_them)
{
    const double omega = 7.3;
    struct decay d = three(1200, 6);
    struct random rng = { 7 };
    struct matrix Y;
    struct refine_data data = { &Y, d.dt, 0, 0, NULL, false, 0, NULL, 0, .omega = omega };
    double complex head = CMPLX(-0.031, 2.17), off = CMPLX(1e-3, -2e-3), start[3];
    double sd, re[3], im[3], sum_re = 0, sum_im = 0;
    struct refined r;

    for (int k = 0; k < 3; k++) {
        d.lambda[k] = CMPLX(creal(head), fabs(cimag(head) + (k < 2 ? k : -1) * omega));
        start[k] = CMPLX(creal(head + off), fabs(cimag(head + off) + (k < 2 ? k : -1) * omega));
    }
    Y = signals_of(&d);
    sd = decay_noise(&d, y, 1200, 40, &rng);
    decay_bound(&d, sd, re, im);
    CHECK(refine_poles(&data, start, 3, NULL, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.end == REFINE_CONVERGED);
    CHECK(r.parameters == 2 && r.order == 6);
    for (int k = 0; k < 3; k++) {
        sum_re += 1 / (re[k] * re[k]), sum_im += 1 / (im[k] * im[k]);
        CHECK_NEAR(creal(r.lambda[k]), creal(r.lambda[0]), 1e-15);
        CHECK_NEAR(r.std_re[k], r.std_re[0], 1e-12 * r.std_re[0]);
    }
    CHECK_NEAR(cimag(r.lambda[1]) - cimag(r.lambda[0]), omega, 1e-12);
    CHECK_NEAR(cimag(r.lambda[2]) + cimag(r.lambda[0]), omega, 1e-12);
    CHECK_NEAR(r.std_re[0] * sqrt(sum_re), 1, 0.08);
    CHECK_NEAR(r.std_im[0] * sqrt(sum_im), 1, 0.08);
    CHECK(fabs(creal(r.lambda[0] - head)) < 5 / sqrt(sum_re));
    CHECK(fabs(cimag(r.lambda[0] - head)) < 5 / sqrt(sum_im));
    refined_done(&r);
}

enum { HEADS = 4, LINES = 9, FAMILY_ROWS = 2000 };
static const double FAMILY_OMEGA = 7.3, FAMILY_STEP = 0.05;

/* LINES of each of HEADS, k omega from it. */
static void family_lines(const double complex *head, double complex *lambda)
{
    for (int i = 0; i < HEADS * LINES; i++) {
        double complex h = head[i / LINES];
        lambda[i] = CMPLX(creal(h), fabs(cimag(h) + (i % LINES - LINES / 2) * FAMILY_OMEGA));
    }
}

/* Of 36 lines of four multipliers, two half a beat apart, whose lines' derivatives each depend on
 * others' columns: the fit takes sums, a tenth of the work of rows, L columns^2 an evaluation. */
TEST(many_lines_of_few_multipliers_are_fitted_without_a_row_for_each_column)
{
    const double complex head[HEADS] = { CMPLX(-0.011, 0.9), CMPLX(-0.031, 2.17),
                                         CMPLX(-0.023, 2.2), CMPLX(-0.05, 3.3) };
    double complex lambda[HEADS * LINES], start[HEADS * LINES], off[HEADS];
    struct matrix Y = { FAMILY_ROWS, 2, FAMILY_ROWS, y };
    struct refine_data data = { .Y = &Y, .tau = FAMILY_STEP, .omega = FAMILY_OMEGA };
    struct random rng = { 11 };
    double rows = FAMILY_ROWS * (4.0 * HEADS * LINES + 2) * (4.0 * HEADS * LINES + 2);
    struct refined r;

    for (int h = 0; h < HEADS; h++)
        off[h] = head[h] + CMPLX(1e-3, h % 2 ? -2e-3 : 2e-3);
    family_lines(head, lambda), family_lines(off, start);
    for (int k = 0; k < 2 * FAMILY_ROWS; k++)
        y[k] = 1e-3 * random_normal(&rng);
    for (int i = 0; i < 2 * HEADS * LINES; i++) {
        double complex B = CMPLX(random_normal(&rng), random_normal(&rng));
        for (int k = 0; k < FAMILY_ROWS; k++)
            y[k + i % 2 * FAMILY_ROWS] += creal(B * cexp(lambda[i / 2] * (k * FAMILY_STEP)));
    }
    CHECK(refine_poles(&data, start, HEADS * LINES, NULL, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.end == REFINE_CONVERGED && r.parameters == 2 * HEADS);
    CHECK(r.work < rows / 10 * r.evaluations);
    for (int i = 0; i < HEADS * LINES; i++) {
        CHECK(fabs(creal(r.lambda[i] - lambda[i])) < 5 * r.std_re[i]);
        CHECK(fabs(cimag(r.lambda[i] - lambda[i])) < 5 * r.std_im[i]);
    }
    refined_done(&r);
}

/* A record (A + B t) e^{mt} and more, of two exponents m +- d, looks the same with -d, and so has
 * no slope in d where d is small: begun at small d of other directions, the search comes to the
 * true pair all the same. */
TEST(two_exponents_that_begin_nearly_equal_come_apart_in_whatever_direction_is_right)
{
    for (int turn = 0; turn < 8; turn++) {
        struct decay d = three(1200, 21 + (uint64_t)turn);
        struct random rng = { 31 + (uint64_t)turn };
        double complex apart = 0.11 * cexp(0.3 * turn * I), m = d.lambda[0], start[3];
        double re[3], im[3], sd;
        struct refined r;

        d.lambda[0] = m + apart, d.lambda[1] = m - apart;
        for (int c = 0; c < 3; c++)
            d.B[1][c] = -d.B[0][c];
        struct matrix Y = signals_of(&d);
        struct refine_data data = { &Y, d.dt, 0, 0, NULL, false, 0, NULL, 0, 0 };
        sd = decay_noise(&d, y, 1200, 60, &rng);
        decay_bound(&d, sd, re, im);
        start[0] = m + 0.01 * I * apart, start[1] = m - 0.01 * I * apart, start[2] = d.lambda[2];
        CHECK(refine_poles(&data, start, 3, NULL, NULL, &r, NULL) == MODAL_OK);
        CHECK(r.end == REFINE_CONVERGED && r.iterations < 40);
        for (int j = 0; j < 2; j++) {
            int k = cabs(r.lambda[0] - d.lambda[j]) > cabs(r.lambda[1] - d.lambda[j]);
            CHECK(fabs(creal(r.lambda[k] - d.lambda[j])) < 5 * re[j]);
            CHECK(fabs(cimag(r.lambda[k] - d.lambda[j])) < 5 * im[j]);
        }
        refined_done(&r);
    }
}

/* White noise: standard errors are the bound at the true noise level up to its estimate's scatter,
 * 1/sqrt(2 * 3580) = 1.2 %; 5 of it. */
TEST(standard_errors_are_the_cramer_rao_bound)
{
    struct decay d = three(1200, 2);
    struct random rng = { 3 };
    struct matrix Y = signals_of(&d);
    double sd = decay_noise(&d, y, 1200, 40, &rng), re[3], im[3];
    struct refine_data data = { &Y, d.dt, 0, 0, NULL, false, 0, NULL, 0, 0 };
    struct refined r;

    decay_bound(&d, sd, re, im);
    CHECK(refine_poles(&data, d.lambda, 3, NULL, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.end == REFINE_CONVERGED);
    for (int j = 0; j < 3; j++) {
        CHECK_NEAR(r.std_re[j] / re[j], 1, 0.06);
        CHECK_NEAR(r.std_im[j] / im[j], 1, 0.06);
        CHECK(fabs(creal(r.lambda[j] - d.lambda[j])) < 5 * re[j] &&
              fabs(cimag(r.lambda[j] - d.lambda[j])) < 5 * im[j]);
    }
    for (int c = 0; c < 3; c++)
        CHECK_NEAR(r.noise[c] / sd, 1, 0.12);
    refined_done(&r);
}

/* A third channel with a hundred times the noise must not spoil the other two: the error stays
 * below the two-channel bound's 5 sigma. */
TEST(a_noisy_channel_weighs_less)
{
    struct decay d = three(800, 4), two = d;
    struct random rng = { 5 };
    struct matrix Y = signals_of(&d);
    struct refine_data data = { &Y, d.dt, 0, 0, NULL, false, 0, NULL, 0, 0 };
    double re[3], im[3];
    struct refined r;

    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 800; k++)
            y[k + 800 * c] += (c == 2 ? 1e-1 : 1e-3) * random_normal(&rng);
    two.channels = 2;
    decay_bound(&two, 1e-3, re, im);
    CHECK(refine_poles(&data, d.lambda, 3, NULL, NULL, &r, NULL) == MODAL_OK);
    for (int j = 0; j < 3; j++) {
        CHECK(fabs(creal(r.lambda[j] - d.lambda[j])) < 5 * re[j]);
        CHECK_NEAR(r.std_re[j] / re[j], 1, 0.1);
    }
    CHECK_NEAR(r.noise[2] / r.noise[0], 100, 10);
    refined_done(&r);
}

TEST(growing_decaying_and_alternating_real_poles_are_refined_too)
{
    enum { L = 60 };
    struct matrix Y = { L, 1, L, y };
    struct refine_data data = { &Y, 1, 0, 0, NULL, false, 0, NULL, 0, 0 };
    double complex truth[3] = { 0.15, CMPLX(-0.05, M_PI), CMPLX(-0.1, 1.1) }, start[3];
    struct refined r;

    for (int l = 0; l < L; l++)
        y[l] = 0.7 * exp(0.15 * l) + 2e3 * (l % 2 ? -1 : 1) * exp(-0.05 * l) +
               900 * exp(-0.1 * l) * cos(1.1 * l + 0.3);
    start[0] = 0.1502, start[1] = CMPLX(-0.0503, M_PI), start[2] = CMPLX(-0.103, 1.104);
    CHECK(refine_poles(&data, start, 3, NULL, NULL, &r, NULL) == MODAL_OK);
    CHECK(refined_converged(&r) && r.order == 4 && r.parameters == 4);
    for (int j = 0; j < 3; j++)
        CHECK_NEAR(cabs(r.lambda[j] - truth[j]), 0, 1e-12);
    CHECK(cimag(r.lambda[0]) == 0 && cimag(r.lambda[1]) == M_PI);
    refined_done(&r);
}

TEST(growth_over_six_hundred_e_foldings_does_not_overflow)
{
    enum { L = 200 };
    struct matrix Y = { L, 1, L, y };
    struct refine_data data = { &Y, 1, 0, 0, NULL, false, 0, NULL, 0, 0 };
    double complex start[1] = { 3.001 };
    struct refined r;

    for (int l = 0; l < L; l++)
        y[l] = exp(3.0 * (l - (L - 1)));
    CHECK(refine_poles(&data, start, 1, NULL, NULL, &r, NULL) == MODAL_OK);
    CHECK(refined_converged(&r));
    CHECK_NEAR(creal(r.lambda[0]), 3, 1e-13);
    refined_done(&r);
}

TEST(a_fixed_pole_stays_and_costs_no_parameter)
{
    struct decay d = three(400, 6);
    struct matrix Y = signals_of(&d);
    struct refine_data data = { &Y, d.dt, 0, 0, NULL, false, 0, NULL, 0, 0 };
    double complex start[4] = { 0, d.lambda[0] * 1.0005, d.lambda[1] * 1.0003, d.lambda[2] };
    bool fixed[4] = { true };
    struct refined r;

    for (int i = 0; i < 1200; i++)
        y[i] += 2.385;
    CHECK(refine_poles(&data, start, 4, fixed, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.parameters == 6 && r.order == 7 && r.lambda[0] == 0 && r.first[0] == -1 &&
          r.std_re[0] == 0);
    CHECK_NEAR(cabs(r.lambda[1] - d.lambda[0]), 0, 1e-12 * cabs(d.lambda[0]));
    refined_done(&r);
}

/* Period of 8 samples: rho = 0.9 e^{+-1.1 i}; the 8 phases are 8 columns with one noise level. */
TEST(phases_of_a_periodic_signal_share_one_multiplier_and_one_noise_level)
{
    enum { L = 30, P = 8 };
    struct random rng = { 7 };
    struct matrix Y = { L, P, L, y };
    struct refine_data data = { &Y, 1, P, 0, NULL, false, 0, NULL, 0, 0 };
    double complex rho = 0.9 * cexp(1.1 * I), start[1] = { clog(rho) * 1.01 };
    struct refined r;

    for (int k = 0; k < P; k++)
        for (int l = 0; l < L; l++)
            y[l + k * L] = creal((1 + 0.3 * k) * cexp(0.4 * k * I) * cpow(rho, l)) +
                           1e-3 * random_normal(&rng);
    CHECK(refine_poles(&data, start, 1, NULL, NULL, &r, NULL) == MODAL_OK);
    CHECK(refined_converged(&r) && r.groups == 1);
    CHECK(fabs(creal(r.lambda[0] - clog(rho))) < 5 * r.std_re[0] && r.std_re[0] < 1e-3);
    CHECK_NEAR(r.noise[0], 1e-3, 2.5e-4);   /* 222 degrees of freedom: 5 / sqrt(2 * 222) = 24 % */
    refined_done(&r);
}

/* Thirty times the same columns: 30 times the information at the same noise. Sixteen join the QR,
 * of 480 the derivatives are turned to as many columns as there are rows of Q.  The noise is told
 * by a hundredth less, and so is its share in the information, which is a thousandth. */
TEST(columns_that_repeat_leave_the_exponents_and_divide_their_errors)
{
    enum { ROWS = 40, COLUMNS = 16, TIMES = 30, ALL = COLUMNS * TIMES, UNKNOWNS = 6 };
    const double complex lambda[] = { CMPLX(-0.02, 0.7), CMPLX(-0.05, 1.9), CMPLX(-0.01, 2.6) };
    struct random rng = { 41 };
    struct matrix Y = { ROWS, ALL, ROWS, y }, one = { ROWS, COLUMNS, ROWS, y };
    struct refine_data all = { .Y = &Y, .tau = 1, .phases = ALL },
                       few = { .Y = &one, .tau = 1, .phases = COLUMNS };
    struct refine_options settle = { .settle = true };
    double complex start[3];
    struct refined r, as;
    double expected;

    for (int i = 0; i < ROWS * COLUMNS; i++)
        y[i] = 0.1 * random_normal(&rng);
    for (int j = 0; j < 3; j++) {
        for (int c = 0; c < COLUMNS; c++) {
            double complex B = CMPLX(random_normal(&rng), random_normal(&rng));
            for (int l = 0; l < ROWS; l++)
                y[l + c * ROWS] += creal(B * cexp(lambda[j] * l));
        }
        start[j] = lambda[j] * CMPLX(1.001, 0.0007);
    }
    for (int i = ROWS * COLUMNS; i < ROWS * ALL; i++)
        y[i] = y[i - ROWS * COLUMNS];
    CHECK(refine_poles(&all, start, 3, NULL, &settle, &r, NULL) == MODAL_OK);
    CHECK(refine_poles(&few, start, 3, NULL, &settle, &as, NULL) == MODAL_OK);
    /* degrees of freedom: each column less its amplitudes, all less the exponents */
    expected = sqrt((COLUMNS * (ROWS - UNKNOWNS) - UNKNOWNS)
                    / (double)(ALL * (ROWS - UNKNOWNS) - UNKNOWNS));
    for (int j = 0; j < 3; j++) {
        CHECK_NEAR(cabs(r.lambda[j] - as.lambda[j]), 0, 1e-6 * as.std_im[j]);
        CHECK_NEAR(r.std_re[j] / as.std_re[j], expected, 2e-5);
        CHECK_NEAR(r.std_im[j] / as.std_im[j], expected, 2e-5);
    }
    CHECK_NEAR(r.residual / as.residual, sqrt(TIMES), 1e-9);
    refined_done(&r), refined_done(&as);
}

/* Known nowhere at first, then where the search went; a ten-thousandth of a standard error is what
 * both are settled to. Multiplications are counted: all rows are read a few times, not with each
 * step. */
TEST(a_fit_by_blocks_of_rows_is_that_to_all_of_them_for_less)
{
    struct decay d = { .modes = 3, .channels = 3, .samples = 64 * 1024, .dt = 0.05,
                       .lambda = { decay_pole(1.0, 1e-4), decay_pole(2.3, 5e-5),
                                   decay_pole(4.1, 2e-5) } };
    struct random rng = { 9 };
    const struct refine_options settle = { .settle = true };
    double complex start[3];
    struct refined r[2];

    decay_amplitudes(&d, &rng);
    struct matrix Y = signals_of(&d);
    decay_noise(&d, y, (size_t)d.samples, 40, &rng);
    struct refine_data data = { .Y = &Y, .tau = d.dt };
    for (int j = 0; j < 3; j++)
        start[j] = d.lambda[j] + CMPLX(-1e-5, 2e-5);
    CHECK(refine_poles(&data, start, 3, NULL, &settle, &r[0], NULL) == MODAL_OK);
    data.blocks = compressed_new(&Y);
    CHECK(data.blocks != NULL);
    CHECK(refine_poles(&data, start, 3, NULL, &settle, &r[1], NULL) == MODAL_OK);
    for (int j = 0; j < 3; j++)
        CHECK_NEAR(cabs(r[1].lambda[j] - r[0].lambda[j]), 0, 1e-4 * r[0].std_re[j]);
    CHECK_NEAR(r[1].bic, r[0].bic, 1e-6);
    CHECK_NEAR(r[1].residual / r[0].residual, 1, 1e-12);
    CHECK(refined_converged(&r[1]) && r[1].work < 0.5 * r[0].work);
    compressed_free(data.blocks);
    refined_done(&r[0]), refined_done(&r[1]);
}

TEST(two_equal_poles_are_degenerate_and_nothing_is_not_a_number_in_the_poles)
{
    struct decay d = three(100, 8);
    struct matrix Y = signals_of(&d);
    struct refine_data data = { &Y, d.dt, 0, 0, NULL, false, 0, NULL, 0, 0 };
    double complex start[2] = { d.lambda[0], d.lambda[0] };
    struct refined r;

    CHECK(refine_poles(&data, start, 2, NULL, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.end == REFINE_DEGENERATE && !refined_converged(&r));
    CHECK(r.lambda[0] == start[0] && isnan(r.std_re[0]));
    refined_done(&r);
}

TEST(zero_signals_do_not_divide_by_zero)
{
    struct matrix Y = { 50, 2, 50, y };
    struct refine_data data = { &Y, 0.1, 0, 0, NULL, false, 0, NULL, 0, 0 };
    double complex start[1] = { CMPLX(-0.1, 3) };
    struct refined r;

    memset(y, 0, sizeof y);
    CHECK(refine_poles(&data, start, 1, NULL, NULL, &r, NULL) == MODAL_OK);
    CHECK(isfinite(creal(r.lambda[0])) && r.residual == 0);
    refined_done(&r);
}

TEST(more_unknowns_than_rows_or_a_pole_that_is_not_finite_is_bad_input)
{
    struct matrix Y = { 4, 1, 4, y };
    struct refine_data data = { &Y, 1, 0, 0, NULL, false, 0, NULL, 0, 0 };
    double complex two[2] = { CMPLX(-0.1, 1), CMPLX(-0.1, 2) }, nan_pole[1] = { NAN };
    struct refined r = { .poles = 77 };

    CHECK(refine_poles(&data, two, 2, NULL, NULL, &r, NULL) == MODAL_BAD_INPUT);
    CHECK(refine_poles(&data, nan_pole, 1, NULL, NULL, &r, NULL) == MODAL_BAD_INPUT);
    CHECK(refine_poles(&data, two, 0, NULL, NULL, &r, NULL) == MODAL_BAD_INPUT);
    CHECK(r.poles == 77);
}

/* sd(|lambda|)/2pi and sd(zeta) from independent Re and Im errors s: for zeta << 1, s/2pi and
 * s/|lambda|. */
TEST(standard_deviations_of_frequency_and_damping_follow_from_the_exponents)
{
    double complex lambda[1] = { CMPLX(-0.02, 5) };
    double cov[4] = { 1e-6, 0, 0, 4e-6 }, re[1] = { 1e-3 }, im[1] = { 2e-3 }, f, z;
    int first[1] = { 0 }, turn[1] = { 1 };
    struct refined r = { .poles = 1,
                         .parameters = 2,
                         .lambda = lambda,
                         .covariance = cov,
                         .first = first,
                         .turn = turn,
                         .std_re = re,
                         .std_im = im };

    refined_std(&r, 0, &f, &z);
    CHECK_NEAR(f, 2e-3 / (2 * M_PI), 1e-7);
    CHECK_NEAR(z, 1e-3 / 5, 1e-8);
}

/* A settled answer lies within SETTLED = 1e-10 standard errors of the minimum; two of them within
 * twice that, rounding about 1e-13 beside it.  An answer that only converged may lie 1e-3 standard
 * errors off. */
TEST(a_settled_answer_does_not_tell_where_the_search_began)
{
    for (int snr = 10; snr <= 60; snr += 10) {
        struct decay d = three(400, 50 + snr);
        struct random rng = { 60 + snr };
        struct matrix Y = signals_of(&d);
        struct refine_data data = { &Y, d.dt, 0, 0, NULL, false, 0, NULL, 0, 0 };
        struct refine_options opt = { .settle = true };
        double complex start[3];
        struct refined a, b;

        decay_noise(&d, y, 400, snr, &rng);
        for (int j = 0; j < 3; j++)
            start[j] = d.lambda[j] * CMPLX(1.0007, -0.0011);
        CHECK(refine_poles(&data, d.lambda, 3, NULL, &opt, &a, NULL) == MODAL_OK);
        CHECK(refine_poles(&data, start, 3, NULL, &opt, &b, NULL) == MODAL_OK);
        for (int j = 0; j < 3; j++)
            CHECK_NEAR(cabs(a.lambda[j] - b.lambda[j]), 0,
                       4e-10 * hypot(a.std_re[j], a.std_im[j]) + 1e-13 * cabs(a.lambda[j]));
        refined_done(&a);
        refined_done(&b);
    }
}

/* One pair in 200 columns whose amplitudes are as small as what they are known to: half of what the
 * columns show of it is their own noise, and bars by that alone hold in 80 % of draws.  Of 100
 * draws with two components each 0.95 has a deviation of 0.015. */
TEST(bars_of_a_pole_that_many_columns_show_little_of_hold)
{
    enum { L = 40, S = 200, DRAWS = 100 };
    const double complex lambda = CMPLX(-0.05, 1.3);
    int inside = 0;

    for (int draw = 0; draw < DRAWS; draw++) {
        struct random rng = { 3000 + (uint64_t)draw };
        struct matrix Y = { L, S, L, y };
        struct refine_data data = { .Y = &Y, .tau = 1, .phases = S };
        struct refined r;
        for (int c = 0; c < S; c++) {
            double complex b = 0.45 * CMPLX(random_normal(&rng), random_normal(&rng));
            for (int l = 0; l < L; l++)
                y[l + c * L] = creal(b * cexp(lambda * l)) + random_normal(&rng);
        }
        CHECK(refine_poles(&data, &lambda, 1, NULL, NULL, &r, NULL) == MODAL_OK);
        inside += fabs(creal(r.lambda[0] - lambda)) <= 1.96 * r.std_re[0];
        inside += fabs(cimag(r.lambda[0] - lambda)) <= 1.96 * r.std_im[0];
        refined_done(&r);
    }
    CHECK(inside >= 2 * DRAWS * (0.95 - 3 * 0.0154));
}

/* Poles that keep their values have no covariance; BLAS refuses a matrix of none. */
TEST(poles_that_are_all_fixed_are_known)
{
    struct decay d = three(300, 9);
    struct matrix Y = signals_of(&d);
    struct refine_data data = { .Y = &Y, .tau = d.dt };
    const bool fixed[] = { true, true, true };
    struct refined r;

    CHECK(refine_poles(&data, d.lambda, 3, fixed, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.parameters == 0 && r.std_re[0] == 0 && r.std_im[2] == 0);
    refined_done(&r);
}
