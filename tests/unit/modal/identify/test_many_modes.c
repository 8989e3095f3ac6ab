/* test_many_modes.c - many modes in few channels: no order below theirs explains much, and the
 * ladder must not end before */
/* Tests as well: drift.c */
#include "check.h"
#include "modal/identify/identify.h"
#include "signals.h"

enum { SAMPLES = 192, CHANNELS = 2 };

/* Eight modes of like strength and two channels, 60 dB: order 4 is a least of BIC, 16 the least.
 * Five of the bound. */
TEST(eight_modes_in_two_channels_are_all_found)
{
    static double column[SAMPLES * CHANNELS], samples[SAMPLES * CHANNELS];

    for (int i = 0; i < 6; i++) {
        struct random rng = { 400 + (uint64_t)i };
        struct decay d = { .modes = 8, .channels = CHANNELS, .samples = SAMPLES, .dt = 1 };
        struct batch b = {
            .samples = SAMPLES, .channels = CHANNELS, .signals = samples, .dt = d.dt
        };
        struct identify_options opt = { 0 };
        struct identify_result r;
        double re[DECAY_MODES], im[DECAY_MODES], sd;
        for (int j = 0; j < 8; j++)
            d.lambda[j] = decay_pole(0.04 + 0.05 * j + 0.015 * random_uniform(&rng),
                                     0.002 + 0.01 * random_uniform(&rng));
        decay_amplitudes(&d, &rng);
        decay_signals(&d, column, SAMPLES);
        sd = decay_noise(&d, column, SAMPLES, 60, &rng);
        decay_bound(&d, sd, re, im);
        for (int k = 0; k < SAMPLES * CHANNELS; k++)
            samples[k] = column[k / CHANNELS + k % CHANNELS * SAMPLES];
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == 8 && r.verdict == VERDICT_STABLE);
        for (int j = 0; j < 8; j++) {
            int at = 0;
            for (int m = 1; m < r.mode_count; m++)
                if (cabs(r.modes[m].exponent - d.lambda[j]) <
                    cabs(r.modes[at].exponent - d.lambda[j]))
                    at = m;
            CHECK(fabs(creal(r.modes[at].exponent - d.lambda[j])) < 5 * re[j]);
            CHECK(fabs(cimag(r.modes[at].exponent - d.lambda[j])) < 5 * im[j]);
        }
        identify_result_done(&r);
    }
}

/* Twelve modes in 54 channels at 1e-7: the ladder climbs to order 24 with as many signals, and ends
 * within its work. */
TEST(twelve_modes_in_many_channels_are_all_found)
{
    enum { ROWS = 1200, MANY = 54, MODES = 12 };
    static double y[ROWS * MANY];

    for (uint64_t seed = 0; seed < 2; seed++) {
        struct random rng = { 60 + seed };
        struct batch b = { .samples = ROWS, .channels = MANY, .signals = y, .dt = 0.02 };
        double complex lambda[MODES], B[MODES];
        struct identify_result r;
        for (int j = 0; j < MODES; j++)
            lambda[j] = decay_pole(0.7 + 1.6 * j + 0.9 * random_uniform(&rng),
                                   0.002 + 0.02 * random_uniform(&rng));
        for (int c = 0; c < MANY; c++) {
            for (int j = 0; j < MODES; j++)
                B[j] = CMPLX(random_normal(&rng), random_normal(&rng));
            for (int k = 0; k < ROWS; k++) {
                double sum = 0;
                for (int j = 0; j < MODES; j++)
                    sum += creal(B[j] * cexp(lambda[j] * (k * b.dt)));
                y[k * MANY + c] = sum + 1e-7 * random_normal(&rng);
            }
        }
        CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == MODES);
        for (int j = 0; j < MODES; j++) {
            int at = 0;
            for (int m = 1; m < r.mode_count; m++)
                if (cabs(r.modes[m].exponent - lambda[j]) < cabs(r.modes[at].exponent - lambda[j]))
                    at = m;
            CHECK(fabs(creal(r.modes[at].exponent - lambda[j])) < 5 * r.modes[at].std_re &&
                  r.modes[at].std_re < 1e-6);
            CHECK(fabs(cimag(r.modes[at].exponent - lambda[j])) < 5 * r.modes[at].std_im &&
                  r.modes[at].std_im < 1e-6);
        }
        for (int i = 0; i < r.diagnostic_count; i++)
            CHECK(strcmp(r.diagnostics[i].code, "order_work_limit") != 0);
        identify_result_done(&r);
    }
}

/* A record of MODES random modes, y row by row; noise at SNR dB of all of it. */
static void random_record(struct random *rng, int modes, int channels, int rows, double dt,
                          double snr, const double complex *lambda, double *y)
{
    double complex B[64];
    double sum = 0, sd;

    memset(y, 0, sizeof *y * (size_t)rows * (size_t)channels);
    for (int c = 0; c < channels; c++)
        for (int j = 0; j < modes; j++) {
            B[j] = CMPLX(random_normal(rng), random_normal(rng));
            for (int k = 0; k < rows; k++)
                y[k * channels + c] += creal(B[j] * cexp(lambda[j] * (k * dt)));
        }
    for (int i = 0; i < rows * channels; i++)
        sum += y[i] * y[i];
    sd = sqrt(sum / (rows * channels)) * pow(10, -snr / 20);
    for (int i = 0; i < rows * channels; i++)
        y[i] += sd * random_normal(rng);
}

/* The mode nearest to z, within 5 of its own standard errors. */
static bool has(const struct identify_result *r, double complex z)
{
    int at = 0;

    for (int m = 1; m < r->mode_count; m++)
        if (cabs(r->modes[m].exponent - z) < cabs(r->modes[at].exponent - z))
            at = m;
    return r->mode_count > 0 && fabs(creal(r->modes[at].exponent - z)) < 5 * r->modes[at].std_re
        && fabs(cimag(r->modes[at].exponent - z)) < 5 * r->modes[at].std_im;
}

/* Some thirty lines of a periodogram apart: each is found, where a few explain next to nothing. */
TEST(forty_modes_at_40_dB_are_all_found_and_no_other)
{
    enum { ROWS = 3000, MANY = 10, MODES = 40 };
    static double y[ROWS * MANY];

    for (uint64_t seed = 0; seed < 2; seed++) {
        struct random rng = { 800 + seed };
        struct batch b = { .samples = ROWS, .channels = MANY, .signals = y, .dt = 0.01 };
        double complex lambda[MODES];
        struct identify_result r;
        for (int j = 0; j < MODES; j++)
            lambda[j] = decay_pole(1.2 + 0.95 * j + 0.6 * random_uniform(&rng),
                                   0.0005 + 0.004 * random_uniform(&rng));
        random_record(&rng, MODES, MANY, ROWS, b.dt, 40, lambda, y);
        CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == MODES && r.verdict == VERDICT_STABLE);
        for (int j = 0; j < MODES; j++)
            CHECK(has(&r, lambda[j]));
        identify_result_done(&r);
    }
}

/* One channel, eleven modes, 50 dB: a ladder from below ends at a few of them now and then. */
TEST(eleven_modes_in_one_channel_are_all_found)
{
    enum { ROWS = 1200, MODES = 11 };
    static double y[ROWS];

    for (uint64_t seed = 0; seed < 12; seed++) {
        struct random rng = { 900 + seed };
        struct batch b = { .samples = ROWS, .channels = 1, .signals = y, .dt = 0.01 };
        double complex lambda[MODES];
        struct identify_result r;
        for (int j = 0; j < MODES; j++)
            lambda[j] = decay_pole(1.5 + 3.5 * j + 2 * random_uniform(&rng),
                                   0.0005 + 0.004 * random_uniform(&rng));
        random_record(&rng, MODES, 1, ROWS, b.dt, 50, lambda, y);
        CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == MODES);
        for (int j = 0; j < MODES; j++)
            CHECK(has(&r, lambda[j]));
        identify_result_done(&r);
    }
}

/* So many alike that a few triplets of Lanczos, half of them not converged, look like a few modes
 * in noise: 64 are asked for, 47 stand above what they leave. */
TEST(sixty_modes_of_irregular_spacing_at_50_dB_are_all_found_and_no_other)
{
    enum { ROWS = 1500, MANY = 8, MODES = 60 };
    static double y[ROWS * MANY];

    for (uint64_t seed = 0; seed < 3; seed++) {
        struct random rng = { 500 + seed };
        struct batch b = { .samples = ROWS, .channels = MANY, .signals = y, .dt = 0.01 };
        double complex lambda[MODES];
        struct identify_result r;
        double f = 1;
        for (int j = 0; j < MODES; j++) {
            f += 0.2 - 0.5 * log(random_uniform(&rng) + 1e-3);
            lambda[j] = decay_pole(f, 1e-4 + 9e-4 * random_uniform(&rng));
        }
        random_record(&rng, MODES, MANY, ROWS, b.dt, 50, lambda, y);
        CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
        CHECK(f < 50 && r.mode_count == MODES && r.verdict == VERDICT_STABLE);
        for (int j = 0; j < MODES; j++)
            CHECK(has(&r, lambda[j]));
        identify_result_done(&r);
    }
}

/* A hundred lightly damped modes, 50 dB: every one within five of its own standard errors. */
TEST(a_hundred_modes_are_all_found)
{
    enum { ROWS = 4000, WIDTH = 8, MODES = 100 };
    static double y[ROWS * WIDTH];
    static double complex lambda[MODES], B[MODES];
    struct random rng = { 81 };
    struct batch b = { .samples = ROWS, .channels = WIDTH, .signals = y, .dt = 0.01 };
    struct identify_result r;

    for (int j = 0; j < MODES; j++)
        lambda[j] = decay_pole(1.2 + 0.45 * j + 0.2 * random_uniform(&rng),
                               1e-4 + 9e-4 * random_uniform(&rng));
    for (int c = 0; c < WIDTH; c++) {
        for (int k = 0; k < ROWS; k++)
            y[k * WIDTH + c] = 0.03 * random_normal(&rng);
        for (int j = 0; j < MODES; j++)
            B[j] = CMPLX(random_normal(&rng), random_normal(&rng));
        for (int j = 0; j < MODES; j++) {
            double complex z = 1, step = cexp(lambda[j] * b.dt);
            for (int k = 0; k < ROWS; k++, z *= step)
                y[k * WIDTH + c] += creal(B[j] * z);
        }
    }
    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == MODES && r.verdict == VERDICT_STABLE);
    for (int j = 0; j < MODES; j++) {
        int at = 0;
        for (int m = 1; m < r.mode_count; m++)
            if (cabs(r.modes[m].exponent - lambda[j]) < cabs(r.modes[at].exponent - lambda[j]))
                at = m;
        CHECK(fabs(creal(r.modes[at].exponent - lambda[j])) < 5 * r.modes[at].std_re);
        CHECK(fabs(cimag(r.modes[at].exponent - lambda[j])) < 5 * r.modes[at].std_im);
    }
    identify_result_done(&r);
}

/* How many of the record's modes are near one that is found where the order is TOLD; *hits: within
 * five of its own standard errors. */
static int modes_told(int told, const double complex *lambda, int modes, const struct batch *b,
                      int *hits)
{
    struct identify_options opt = { .rank = { .rule = RANK_FIXED, .fixed = told } };
    struct identify_result r;
    int near = 0;

    *hits = 0;
    CHECK(modal_identify(b, &opt, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count <= told);
    for (int j = 0; j < modes; j++) {
        bool is = false;
        /* a fifth of the least distance of two modes */
        for (int m = 0; m < r.mode_count; m++)
            is |= fabs(cimag(r.modes[m].exponent - lambda[j])) < 0.2 * 2 * M_PI * 0.35
                && creal(r.modes[m].exponent) < 0;
        near += is, *hits += has(&r, lambda[j]);
    }
    identify_result_done(&r);
    return near;
}

TEST(orders_that_are_told_give_all_modes_or_as_many_of_them_as_fit_or_all_and_some_of_noise)
{
    enum { ROWS = 2000, MANY = 4, MODES = 40 };
    static double y[ROWS * MANY];
    struct batch b = { .samples = ROWS, .channels = MANY, .signals = y, .dt = 0.01 };
    struct random rng = { 820 };
    double complex lambda[MODES];
    int hits;

    for (int j = 0; j < MODES; j++)
        lambda[j] = decay_pole(1.2 + 0.95 * j + 0.6 * random_uniform(&rng),
                               0.0005 + 0.001 * random_uniform(&rng));
    random_record(&rng, MODES, MANY, ROWS, b.dt, 50, lambda, y);
    CHECK(modes_told(2 * MODES, lambda, MODES, &b, &hits) == MODES && hits == MODES);
    CHECK(modes_told(2 * MODES - 20, lambda, MODES, &b, &hits) == MODES - 10);
    CHECK(modes_told(2 * MODES + 10, lambda, MODES, &b, &hits) == MODES);
}

/* Is mode J further from any other than their two half lines reach? */
static bool alone(const double complex *lambda, int modes, int j)
{
    bool is = true;

    for (int k = 0; k < modes; k++)
        is &= k == j || fabs(cimag(lambda[j] - lambda[k])) > -creal(lambda[j] + lambda[k]);
    return is;
}

/* Thirty modes, many within a line of the next, the weakest of which no singular value shows: noise
 * refined in their place ends nowhere, and none of it is beside the modes that are found. */
TEST(an_order_that_is_told_is_reached_though_overlapping_modes_hide_among_noise)
{
    enum { ROWS = 1200, MANY = 8, MODES = 30 };
    static double y[ROWS * MANY];
    struct batch b = { .samples = ROWS, .channels = MANY, .signals = y, .dt = 0.01 };
    struct identify_options opt = { .rank = { .rule = RANK_FIXED, .fixed = 2 * MODES } };

    for (uint64_t seed = 0; seed < 2; seed++) {
        struct random rng = { 910 + seed };
        double complex lambda[MODES];
        struct identify_result r;
        for (int j = 0; j < MODES; j++)
            lambda[j] = decay_pole(1 + 39 * random_uniform(&rng),
                                   0.002 + 0.018 * random_uniform(&rng));
        random_record(&rng, MODES, MANY, ROWS, b.dt, 30, lambda, y);
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == MODES);
        for (int i = 0; i < r.diagnostic_count; i++)
            CHECK(strcmp(r.diagnostics[i].code, "not_converged") != 0);
        for (int j = 0; j < MODES; j++)
            CHECK(!alone(lambda, MODES, j) || has(&r, lambda[j]));
        identify_result_done(&r);
    }
}

/* Two modes driven by noise, of which as many directions stand out of that of the channels as are
 * looked at: poles that do not pay for themselves among so many numbers are no poles of noise, and
 * what is looked for beyond the order is driven as well (orders up to 12 were fitted, and cut off
 * again). */
TEST(an_order_that_is_told_where_all_directions_stand_out_of_noise_is_not_searched_beyond)
{
    enum { ROWS = 800, MANY = 16 };
    static double y[ROWS * MANY];
    struct batch b = { .samples = ROWS, .channels = MANY, .signals = y, .dt = 0.01 };
    struct identify_options opt = { .rank = { .rule = RANK_FIXED, .fixed = 4 } };

    for (uint64_t seed = 0; seed < 8; seed++) {
        struct random rng = { 930 + seed };
        double x[2][2] = { { 0 } };
        struct identify_result r;
        for (int k = 0; k < ROWS; k++) {
            for (int m = 0; m < 2; m++) {
                double w = 0.628 * (m + 1), radius = exp(-0.01 * w),
                       next = 2 * radius * cos(w) * x[m][0] - radius * radius * x[m][1]
                            + random_normal(&rng);
                x[m][1] = x[m][0], x[m][0] = next;
            }
            for (int c = 0; c < MANY; c++)
                y[k * MANY + c] = x[0][0] * cos(c) + x[1][0] * sin(1 + c)
                                + 0.01 * random_normal(&rng);
        }
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.candidate_count > 0);
        for (int i = 0; i < r.candidate_count; i++)
            CHECK(r.candidates[i].order <= 4);
        identify_result_done(&r);
    }
}

/* Three pairs, the weakest hardly decays, and a constant of 0.6 of its power: each of the two
 * directions that the pair has is less than the constant's, so that the six first of seven cut the
 * pair; the constant costs less of what is left out. */
TEST(an_order_that_is_told_of_pairs_gives_all_of_them_though_a_constant_stands_out_as_well)
{
    enum { ROWS = 300, MANY = 8, MODES = 3 };
    static double y[ROWS * MANY];
    static const double strength[] = { 1, 1, 0.1 };
    struct batch b = { .samples = ROWS, .channels = MANY, .signals = y, .dt = 0.01 };
    struct identify_options opt = { .rank = { .rule = RANK_FIXED, .fixed = 2 * MODES } };
    const double complex lambda[] = { decay_pole(4, 0.015), decay_pole(14, 0.001),
                                      decay_pole(31, 0.0003) };

    for (uint64_t seed = 0; seed < 8; seed++) {
        struct random rng = { 940 + seed };
        struct identify_result r;
        bool low = false;
        for (int k = 0; k < ROWS; k++)
            for (int c = 0; c < MANY; c++) {
                /* of a shape whose parts of all channels have the power of one */
                double *at = &y[k * MANY + c];
                *at = 0.055 * M_SQRT2 * cos(1 + 2 * M_PI * 3 * c / MANY) / sqrt(MANY)
                    + 3e-5 * random_normal(&rng);
                for (int j = 0; j < MODES; j++)
                    *at += strength[j] / sqrt(MANY)
                         * creal(cexp(lambda[j] * (k * b.dt) + CMPLX(0, (1 + j) * c + (int)seed)));
            }
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == MODES);
        for (int i = 0; i < r.diagnostic_count; i++)
            low |= strcmp(r.diagnostics[i].code, "rank_too_low") == 0;
        CHECK(low);
        for (int j = 0; j < MODES; j++) {
            bool is = false;
            for (int m = 0; m < r.mode_count; m++)
                is |= cabs(r.modes[m].exponent - lambda[j]) < 0.01 * cabs(lambda[j]);
            CHECK(is);
        }
        identify_result_done(&r);
    }
}

/* Seventy modes whose strengths fall by two thirds of a decade, in a record of which 256 triplets
 * of a matrix as high as few modes have it cost too much: the first 64 leave little, and more are
 * looked for. */
TEST(seventy_modes_are_found_though_the_strongest_leave_little)
{
    enum { ROWS = 16000, MANY = 10, MODES = 70 };
    double *y = calloc((size_t)ROWS * MANY, sizeof *y);
    struct random rng = { 77 };
    struct batch b = { .samples = ROWS, .channels = MANY, .signals = y, .dt = 1 };
    double complex lambda[MODES];
    struct identify_result r;

    for (int j = 0; j < MODES; j++) {
        double complex z = 1, turn, B[MANY];
        lambda[j] = decay_pole(0.01 + 0.0065 * (j + 0.5 * random_uniform(&rng)), 0.0005);
        turn = cexp(lambda[j]);
        for (int c = 0; c < MANY; c++)
            B[c] = pow(10, -1.5 * j / MODES) * CMPLX(random_normal(&rng), random_normal(&rng));
        for (int k = 0; k < ROWS; k++, z *= turn)
            for (int c = 0; c < MANY; c++)
                y[k * MANY + c] += creal(B[c] * z);
    }
    for (int k = 0; k < ROWS * MANY; k++)
        y[k] += 1e-4 * random_normal(&rng);
    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == MODES && r.verdict == VERDICT_STABLE);
    for (int j = 0; j < MODES; j++)
        CHECK(has(&r, lambda[j]));
    identify_result_done(&r);
    free(y);
}

/* Twelve modes in five channels, 60 dB; over the record all frequencies rise by RISE. */
static void drifting_record(struct random *rng, int rows, double rise, double *y)
{
    enum { MODES = 12, MANY = 5 };
    double sum = 0, sd;

    memset(y, 0, sizeof *y * (size_t)rows * MANY);
    for (int j = 0; j < MODES; j++) {
        double complex z = decay_pole(0.02 + 0.035 * j + 0.01 * random_uniform(rng),
                                      0.002 + 0.008 * random_uniform(rng));
        for (int c = 0; c < MANY; c++) {
            double complex B = CMPLX(random_normal(rng), random_normal(rng));
            for (int k = 0; k < rows; k++)
                y[k * MANY + c] += creal(B * cexp(z * (k + 0.5 * rise * k * k / rows)));
        }
    }
    for (int i = 0; i < rows * MANY; i++)
        sum += y[i] * y[i];
    sd = sqrt(sum / (rows * MANY)) * 1e-3;
    for (int i = 0; i < rows * MANY; i++)
        y[i] += sd * random_normal(rng);
}

/* Of more modes than windows tell one by one: two poles for each leave nothing but noise. */
TEST(many_modes_that_drift_are_no_modes_and_those_that_do_not_are)
{
    enum { ROWS = 800, MANY = 5 };
    static double y[ROWS * MANY];
    struct batch b = { .samples = ROWS, .channels = MANY, .signals = y, .dt = 1 };

    for (int i = 0; i < 2; i++) {
        struct random rng = { 52 };
        struct identify_result r;
        bool drifts = i == 0, told = false;
        drifting_record(&rng, ROWS, drifts ? 2e-3 : 0, y);
        CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
        for (int k = 0; k < r.diagnostic_count; k++)
            told |= strcmp(r.diagnostics[k].code, "changes_in_record") == 0;
        CHECK(told == drifts && (drifts || r.mode_count == 12));
        identify_result_done(&r);
    }
}

