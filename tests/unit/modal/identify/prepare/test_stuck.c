/* test_stuck.c - samples that are equal as no motion's are, and only those, are mended */
#include "check.h"
#include "signals.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/prepare/stuck.h"

enum { ROWS = 1500, WIDTH = 2, ALL = ROWS * WIDTH };
static const double NOISE = 0.01;
static double clean[ALL], y[ALL];

/* Two modes in two channels, some noise, from row QUIET on; zeros before. */
static void make(uint64_t seed, double noise, int quiet)
{
    struct random r = { seed };
    struct decay d = { .modes = 2, .channels = WIDTH, .samples = ROWS, .dt = 1 };

    d.lambda[0] = decay_pole(0.031, 0.008), d.lambda[1] = decay_pole(0.083, 0.004);
    decay_amplitudes(&d, &r);
    decay_signals(&d, clean, ROWS);
    for (int i = 0; i < ALL; i++)
        y[i] = i % ROWS < quiet ? 0 : clean[i] + noise * random_normal(&r);
}

static int mended_of_period(int period, struct wild *out)
{
    struct matrix Y = { ROWS, WIDTH, ROWS, y };
    struct modal_error err;

    CHECK(stuck_mend(&Y, period, out, &err) == MODAL_OK);
    return out->count;
}

static int mended(struct wild *out)
{
    return mended_of_period(0, out);
}

/* Nothing is stuck, and y is as it was. */
static void check_whole(void)
{
    static double before[ALL];
    struct wild w;

    memcpy(before, y, sizeof y);
    CHECK(mended(&w) == 0 && memcmp(before, y, sizeof y) == 0);
    wild_done(&w);
}

TEST(records_of_noise_of_rounding_and_of_quiet_have_no_stuck_samples)
{
    for (uint64_t seed = 1; seed <= 50; seed++)
        for (int bits = 1; bits <= 14; bits++) {
            make(seed, seed % 2 ? NOISE : 0, seed % 3 ? 0 : 30 * (int)seed);
            for (int i = 0; i < ALL && bits < 14; i++)
                y[i] = nearbyint(ldexp(y[i], bits)) / ldexp(1, bits);
            check_whole();
        }
}

TEST(a_sine_that_meets_its_extreme_at_each_crest_is_not_cut)
{
    for (int each = 3; each <= 64; each++) {
        for (int i = 0; i < ALL; i++)
            y[i] = (float)cos(2 * M_PI * (i % ROWS) / each + M_PI / each);
        check_whole();
    }
}

/* A contact's force is zero where it is open, and 1 at a stop. */
TEST(what_a_periodic_motion_comes_to_in_its_last_period_is_neither_dropped_nor_cut)
{
    struct wild w;

    make(5, NOISE, 0);
    for (int i = 0; i < ALL; i++)
        y[i] = fmin(1, fmax(0, clean[i] + 2 * sin(2 * M_PI * (i % ROWS) / 50)));
    CHECK(mended_of_period(50, &w) == 0);
    wild_done(&w);
    memset(y + 700, 0, 20 * sizeof *y);
    for (int i = 0; i < ALL; i++)
        y[i] += i % ROWS < 700 || i % ROWS >= 720 || i >= ROWS ? 1e-3 * sin(i) : 0;
    CHECK(mended_of_period(50, &w) == 20);
    wild_done(&w);
}

/* What a fit of some ten numbers to hundreds leaves of white noise: less than the noise itself, and
 * a gap is predicted to some times that. */
TEST(dropped_and_held_samples_are_all_found_and_come_near_the_motion)
{
    for (uint64_t seed = 1; seed <= 20; seed++)
        for (int held = 0; held < 2; held++) {
            struct wild w;
            double sent = 0;
            make(seed, NOISE, 0);
            int from = 100 + 60 * (int)seed, count = 6 + (int)seed;
            for (int l = from; l < from + count; l++)
                y[l] = held ? y[from - 1] : sent;
            CHECK(mended(&w) == count + held);
            for (int i = 0; i < w.count; i++) {
                int l = from - held + i;
                CHECK(w.at[i].row == l && w.at[i].channel == 0);
                CHECK_NEAR(y[l], clean[l], 6 * NOISE);
            }
            wild_done(&w);
        }
}

TEST(what_was_sent_is_what_is_kept_over_what_is_in_its_place)
{
    static double before[ALL];
    struct wild w;

    make(4, NOISE, 0);
    for (int l = 300; l < 320; l++)
        y[l + ROWS] = 0;
    memcpy(before, y, sizeof y);
    CHECK(mended(&w) == 20);
    for (int i = 0; i < w.count; i++)
        y[w.at[i].row + ROWS * w.at[i].channel] += w.at[i].sent;
    for (int i = 0; i < ALL; i++)
        CHECK_NEAR(y[i], before[i], 1e-15);
    wild_done(&w);
}

TEST(peaks_that_are_cut_are_put_back_beyond_the_rail)
{
    for (double rail = 0.5; rail < 0.95; rail += 0.1) {
        struct wild w;
        double most = 0;
        int cut = 0;
        make(6, NOISE, 0);
        for (int l = 0; l < ROWS; l++)
            most = fmax(most, fabs(y[l]));
        for (int l = 0; l < ROWS; l++)
            cut += fabs(y[l]) > rail * most, y[l] = fmax(fmin(y[l], rail * most), -rail * most);
        CHECK(cut > 2 && mended(&w) == cut);
        for (int i = 0; i < w.count; i++) {
            CHECK(fabs(y[w.at[i].row]) > rail * most - 3 * NOISE);
            CHECK_NEAR(y[w.at[i].row], clean[w.at[i].row], 0.3 * most);
        }
        wild_done(&w);
    }
}

TEST(stuck_samples_of_a_rounded_channel_are_found_where_they_jump)
{
    struct wild w;

    make(8, NOISE, 50);
    for (int i = 0; i < ALL; i++)
        y[i] = nearbyint(ldexp(y[i], 9)) / 512;
    for (int l = 400; l < 425; l++)
        y[l] = 0;
    CHECK(mended(&w) == 25 && w.at[0].row == 400 && w.at[24].row == 424);
    wild_done(&w);
}

/* Its first crest is the longest: what begins a column counts where it is the extreme. */
TEST(a_record_that_begins_in_a_cut_crest_has_it_told)
{
    for (double rail = 0.5; rail < 0.95; rail += 0.1) {
        struct wild w;
        int cut = 0;
        make(7, 0, 0);
        for (int l = 0; l < ROWS; l++) {
            double x = exp(-0.003 * l) * cos(0.05 * l) + NOISE * clean[l + ROWS];
            y[l] = fmax(fmin(x, rail), -rail), cut += fabs(x) > rail;
        }
        CHECK(fabs(y[0]) == rail && cut > 5 && mended(&w) == cut && w.at[0].row == 0);
        wild_done(&w);
    }
}
