/* Tests as well: rebuild.c */
/* test_wild.c - spikes and dropouts stand out of what poles leave, noise does not */
#include "check.h"
#include "signals.h"
#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include "modal/identify/prepare/wild.h"

enum { ROWS = 1500, WIDTH = 2 };
static const double NOISE = 0.01;

struct case_of { struct matrix Y; double *clean; double complex lambda[2]; };

/* Two modes in two channels, noise of 0.01. */
static struct case_of make(uint64_t seed)
{
    struct random r = { seed };
    struct decay d = { .modes = 2, .channels = WIDTH, .samples = ROWS, .dt = 1 };
    struct case_of k = { { ROWS, WIDTH, ROWS, malloc(sizeof(double) * ROWS * WIDTH) },
                         malloc(sizeof(double) * ROWS * WIDTH), { 0 } };

    d.lambda[0] = decay_pole(0.031, 0.008), d.lambda[1] = decay_pole(0.083, 0.004);
    decay_amplitudes(&d, &r);
    decay_signals(&d, k.clean, ROWS);
    for (int i = 0; i < ROWS * WIDTH; i++)
        k.Y.x[i] = k.clean[i] + NOISE * random_normal(&r);
    for (int j = 0; j < 2; j++)
        k.lambda[j] = d.lambda[j];
    return k;
}

static int taken(struct case_of *k, struct wild *w)
{
    struct modal_error err;

    CHECK(wild_take(&(struct rebuild_model) { k->lambda, 2, 1, 1 }, &k->Y, w, &err) == MODAL_OK);
    return w->count;
}

static void done(struct case_of *k, struct wild *w)
{
    wild_done(w);
    free(k->Y.x), free(k->clean);
}

/* One of ten thousand records loses a sample: 400 lose none but once in 25. */
TEST(noise_has_no_wild_samples)
{
    int lost = 0;

    for (uint64_t seed = 1; seed <= 400; seed++) {
        struct case_of k = make(seed);
        struct wild w = { 0 };
        lost += taken(&k, &w) > 0;
        done(&k, &w);
    }
    CHECK(lost == 0);
}

/* 3000 numbers: 3000 erfc(t / sqrt 2) = 1e-4 at t = 5.56 (scipy.special.erfcinv); the median of 65
 * rows about it is 10 % off. */
TEST(a_sample_stands_out_from_five_and_a_half_of_the_noise_on)
{
    for (uint64_t seed = 1; seed <= 20; seed++)
        for (int side = 0; side < 2; side++) {
            struct case_of k = make(seed);
            struct wild w = { 0 };
            int at = 700 + (int)seed, row = at % ROWS;
            k.Y.x[at] = k.clean[at] + (side ? -8 : 5) * NOISE;
            CHECK(taken(&k, &w) == side);
            CHECK(side == 0 || (w.at[0].row == row && w.at[0].channel == 0));
            done(&k, &w);
        }
}

TEST(spikes_of_any_size_are_taken_out_and_rebuilt_to_the_noise)
{
    for (double size = 10; size < 1e12; size *= 100) {
        struct case_of k = make(5);
        struct wild w = { 0 };
        double *before = malloc(sizeof(double) * ROWS * WIDTH);
        for (int i = 0; i < 20; i++)
            k.Y.x[40 + 139 * i] += (i % 3 ? size : -size) * NOISE;
        memcpy(before, k.Y.x, sizeof(double) * ROWS * WIDTH);
        CHECK(taken(&k, &w) == 20);
        /* 4 unknowns a channel, of some 300 rows: a fit's errors are a ninth of the noise */
        for (int i = 0; i < 20; i++)
            CHECK_NEAR(k.Y.x[40 + 139 * i], k.clean[40 + 139 * i], 0.5 * NOISE);
        wild_put_back(&k.Y, &w);
        CHECK(memcmp(before, k.Y.x, sizeof(double) * ROWS * WIDTH) == 0 && w.count == 0);
        free(before);
        done(&k, &w);
    }
}

TEST(a_dropout_is_taken_out_whole_where_it_crosses_the_motion)
{
    struct case_of k = make(9);
    struct wild w = { 0 };

    for (int l = 200; l < 212; l++)
        k.Y.x[l] = 0;
    CHECK(taken(&k, &w) >= 10 && w.count <= 12);
    for (int i = 1; i < w.count; i++)
        CHECK(w.at[i].row == w.at[i - 1].row + 1 && w.at[i].channel == 0);
    done(&k, &w);
}

TEST(more_than_a_few_are_not_taken_out_nor_what_begins_the_record)
{
    struct case_of k = make(3);
    struct wild w = { 0 };

    for (int l = 100; l < ROWS; l += 9)
        k.Y.x[l] += NOISE * 1000, k.Y.x[l + ROWS] -= NOISE * 1000;
    CHECK(taken(&k, &w) == 0);
    done(&k, &w);
    k = make(3);
    k.Y.x[0] += 1000 * NOISE, k.Y.x[ROWS - 1] += 1000 * NOISE;
    CHECK(taken(&k, &w) == 0);
    done(&k, &w);
}

/* Poles know the motion of a period of five samples by an amplitude at each, of which one channel's
 * noise has one size. */
TEST(spikes_stand_out_of_what_the_multipliers_of_periods_leave)
{
    enum { SHIFT = 5 };

    for (uint64_t seed = 1; seed <= 20; seed++) {
        struct case_of k = make(seed);
        struct rebuild_model poles = { k.lambda, 2, SHIFT, SHIFT };
        struct modal_error err;
        struct wild w = { 0 };
        for (int i = 0; i < ROWS * WIDTH; i++)
            k.Y.x[i] += k.clean[i] * 0.5 * cos(2 * M_PI * (i % ROWS) / SHIFT);
        for (int i = 0; i < 10; i++)
            k.Y.x[100 + 137 * i] += (i % 2 ? 1 : -1) * (1 + i);
        CHECK(wild_take(&poles, &k.Y, &w, &err) == MODAL_OK);
        CHECK(w.count == 10);
        for (int i = 0; i < w.count; i++)
            CHECK(w.at[i].channel == 0 && (w.at[i].row - 100) % 137 == 0);
        done(&k, &w);
    }
}
