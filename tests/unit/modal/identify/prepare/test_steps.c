/* test_steps.c - a channel's mean that jumps is told, and nothing else is taken for it */
#include "check.h"
#include "signals.h"
#include <complex.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/prepare/steps.h"

enum { ROWS = 1500, WIDTH = 2, ALL = ROWS * WIDTH };
static const double NOISE = 0.01;
static double y[ALL];
static double complex lambda[2];

/* Two modes in two channels, some noise. */
static void make(uint64_t seed, double noise)
{
    struct random r = { seed };
    struct decay d = { .modes = 2, .channels = WIDTH, .samples = ROWS, .dt = 1 };

    d.lambda[0] = decay_pole(0.031, 0.008), d.lambda[1] = decay_pole(0.083, 0.004);
    decay_amplitudes(&d, &r);
    decay_signals(&d, y, ROWS);
    for (int i = 0; i < ALL; i++)
        y[i] += noise * random_normal(&r);
    lambda[0] = d.lambda[0], lambda[1] = d.lambda[1];
}

static struct steps spikes;             /* of the last look */

static struct steps found(void)
{
    struct matrix Y = { ROWS, WIDTH, ROWS, y };
    struct modal_error err;
    struct steps s;

    steps_done(&spikes);
    CHECK(steps_find(&Y, &s, &spikes, &err) == MODAL_OK);
    return s;
}

static void check_none(void)
{
    struct steps s = found();

    CHECK(s.count == 0);
    steps_done(&s);
}

static void check_neither(void)
{
    check_none();
    CHECK(spikes.count == 0);
}

static void jump(int channel, int row, double size)
{
    for (int l = row; l < ROWS; l++)
        y[l + channel * ROWS] += size;
}

/* Thirty modes leave a recurrence of order 64 little but noise that it filtered itself: sums of
 * that are no white noise's. */
TEST(as_many_modes_as_a_recurrence_tells_have_neither_steps_nor_spikes)
{
    enum { LONG = 8000, MODES = 30 };
    /* the first three had */
    static const uint64_t seeds[] = { 66, 127, 296, 1, 2 };
    double *x = calloc(LONG, sizeof *x);

    for (size_t i = 0; i < sizeof seeds / sizeof *seeds; i++) {
        struct random r = { seeds[i] };
        struct matrix Y = { LONG, 1, LONG, x };
        struct modal_error err;
        struct steps s;
        double hz = 0;

        for (int l = 0; l < LONG; l++)
            x[l] = 0.005 * random_normal(&r);
        for (int j = 0; j < MODES; j++) {
            /* distances of 0.3 of their mean and more */
            hz += (0.3 - 0.7 * log(1 - random_uniform(&r))) / (2.6 * MODES);
            double complex pole = decay_pole(hz, 1e-4 + 9e-4 * random_uniform(&r));
            double complex a = random_normal(&r) + I * random_normal(&r);
            for (int l = 0; l < LONG; l++)
                x[l] += creal(a * cexp(pole * l));
        }
        CHECK(steps_find(&Y, &s, &spikes, &err) == MODAL_OK && s.count + spikes.count == 0);
        steps_done(&s);
    }
    free(x);
}

/* One of ten thousand records has a step: 400 have none but once in 25. */
TEST(noise_has_neither_steps_nor_spikes)
{
    for (uint64_t seed = 1; seed <= 400; seed++) {
        make(seed, NOISE);
        check_neither();
    }
}

TEST(growth_an_offset_slow_decays_and_grids_are_neither_steps_nor_spikes)
{
    for (uint64_t seed = 1; seed <= 240; seed++) {
        struct random r = { seed + 1000 };
        double rate = exp(random_normal(&r) * 2) / ROWS, size = exp(random_normal(&r) * 2);
        make(seed, seed % 2 ? NOISE : 0);
        for (int i = 0; i < ALL; i++) {
            double slow = exp(-rate * (i % ROWS)) * size, grid = ldexp(1, -(int)(seed % 12));
            y[i] = seed % 4 == 0 ? y[i] + slow : seed % 4 == 1 ? y[i] + size
                 : seed % 4 == 2 ? y[i] / slow : nearbyint((y[i] + slow) / grid) * grid;
        }
        check_neither();
    }
}

TEST(spikes_quiet_before_an_onset_and_a_motion_struck_anew_are_no_steps)
{
    for (uint64_t seed = 1; seed <= 120; seed++) {
        int at = 200 + 7 * (int)seed;
        make(seed, NOISE);
        if (seed % 3 == 0)
            y[at] += 100 * NOISE;
        for (int l = 0; l < ROWS && seed % 3 == 1; l++)
            y[l] *= l >= at;
        for (int l = ROWS - 1; l >= at && seed % 3 == 2; l--)
            y[l] += 3 * y[l - at];
        check_none();
    }
}

/* Of 3000 differences one of t = 5.56 is told; a recurrence of order 32 of the differences of white
 * noise, a_j = 1 - j / 33 or less, has sum_j a_j^2 of at most 11: from 1.7 of the noise on. */
TEST(a_step_of_five_times_the_noise_or_more_is_found_where_it_is)
{
    for (double size = 5; size < 1e6; size *= 3)
        for (int side = -1; side < 2; side += 2) {
            make((uint64_t)size, NOISE);
            jump(1, 700, side * size * NOISE);
            struct steps s = found();
            CHECK(s.count == 1 && s.at[0].channel == 1);
            CHECK(s.count == 0 || abs(s.at[0].row - 700) < 2);
            CHECK(s.count == 0 || fabs(s.at[0].size - side * size * NOISE) < 6 * NOISE);
            steps_done(&s);
        }
}

/* Interpolated by 128 rows about it a sample is known to little more than its own noise: told from
 * 5.7 of that on (of 6000 looks); with few rows before or after, from that of a recurrence one way,
 * whose e is some times the noise. */
TEST(a_lone_spike_is_found_at_its_row_and_as_high_as_it_is)
{
    static const int rows[] = { 2, 3, 7, 31, 63, 64, 65, 127, 128, 700, 1370, 1440, 1490, 1495 };

    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        for (double size = 30; size < 1e6; size *= 10) {
            make(i + 1, NOISE);
            y[rows[i] + ROWS] -= size * NOISE;
            struct steps s = found();
            CHECK(s.count == 0 && spikes.count == 1);
            CHECK(spikes.count == 0 || (spikes.at[0].row == rows[i] && spikes.at[0].channel == 1));
            CHECK(spikes.count == 0 || fabs(spikes.at[0].size + size * NOISE) < 12 * NOISE);
            steps_done(&s);
        }
}

TEST(spikes_of_both_channels_are_found_beside_a_step)
{
    make(5, NOISE);
    y[11] += 0.9, y[750] -= 70, y[412 + ROWS] += 1.4;
    jump(0, 1100, 0.8);
    struct steps s = found();
    CHECK(s.count == 1 && s.at[0].channel == 0 && abs(s.at[0].row - 1100) < 2);
    CHECK(spikes.count == 3 && spikes.at[2].channel == 1 && spikes.at[2].row == 412);
    steps_done(&s);
}

TEST(steps_of_both_channels_are_found_and_taken_out)
{
    static double before[ALL];
    struct matrix Y = { ROWS, WIDTH, ROWS, y };
    make(3, NOISE);
    memcpy(before, y, sizeof y);
    jump(0, 400, 1.7), jump(0, 900, -0.6), jump(1, 900, 0.9);
    struct steps s = found();
    CHECK(s.count == 3);
    steps_take(&s, 1, &Y);
    for (int i = 0; i < ALL; i++)
        CHECK_NEAR(y[i], before[i], 6 * NOISE);
    steps_done(&s);
}

/* Without a step's column the bound of a slow decay is its own; with it, (4) by its definition:
 * numbers of numpy for 64 rows are not needed, as a step at row 1 of a channel is its offset. */
TEST(rows_sizes_and_errors_of_a_fitted_step_are_those_of_least_squares)
{
    struct modal_error err;
    struct matrix Y = { ROWS, WIDTH, ROWS, y };
    double off = 0, all = 0;
    for (uint64_t seed = 1; seed <= 100; seed++) {
        struct step at = { 703, 0, 0.2, 0 };
        struct steps s = { &at, 1 };
        double moved, left;
        make(seed, NOISE);
        jump(0, 700, 0.21);
        steps_take(&s, 1, &Y);
        CHECK(steps_fit(&(struct rebuild_model) { lambda, 2, 1, 1 }, &Y, &s, &moved, &left, &err)
              == MODAL_OK);
        CHECK(moved > 1 && at.row == 700);
        /* 700 rows before and 800 after: 1/700 + 1/800 where nothing else is fitted but an offset
         * that is none: 1/800 */
        CHECK_NEAR(at.std, NOISE / sqrt(800), 0.1 * NOISE / sqrt(800));
        off += pow((at.size - 0.21) / at.std, 2), all++;
    }
    CHECK_NEAR(off / all, 1, 5 * sqrt(2 / all));
}
