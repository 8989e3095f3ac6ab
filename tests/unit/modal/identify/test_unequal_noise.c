/* test_unequal_noise.c - channels exact to the last bit beside channels of noise: the exact ones
 * decide, and the answer says how well */
#include "check.h"
#include "modal/identify/identify.h"
#include "signals.h"

enum { SAMPLES = 600, CHANNELS = 20 };
static double column[SAMPLES * CHANNELS], samples[SAMPLES * CHANNELS];

static bool has(const struct identify_result *r, const char *code)
{
    for (int i = 0; i < r->diagnostic_count; i++)
        if (strcmp(r->diagnostics[i].code, code) == 0)
            return true;
    return false;
}

/* `modes` modes in all channels; noise of so much of their rms in the last `noisy`, which alone
 * hear the last mode if `own`. */
static void make(struct decay *d, int channels, int noisy, double noise, bool own, uint64_t seed)
{
    static const double hertz[] = { 1.03, 2.31, 4.17 }, zeta[] = { 0.01, 0.005, 0.02 };
    struct random rng = { seed };

    *d = (struct decay) { .modes = 3, .channels = channels, .samples = SAMPLES, .dt = 0.05 };
    for (int j = 0; j < 3; j++)
        d->lambda[j] = decay_pole(hertz[j], zeta[j]);
    decay_amplitudes(d, &rng);
    for (int c = 0; c < channels - noisy && own; c++)
        d->B[2][c] = 0;
    decay_signals(d, column, SAMPLES);
    for (int c = 0; c < channels; c++) {
        double sum = 0, sd;
        for (int k = 0; k < SAMPLES; k++)
            sum += column[k + c * SAMPLES] * column[k + c * SAMPLES];
        sd = c < channels - noisy ? 0 : noise * sqrt(sum / SAMPLES);
        for (int k = 0; k < SAMPLES; k++)
            samples[c + k * channels] = column[k + c * SAMPLES] + sd * random_normal(&rng);
    }
}

static struct identify_result identified(const struct decay *d)
{
    struct batch b = {
        .samples = SAMPLES, .channels = (size_t)d->channels, .signals = samples, .dt = d->dt
    };
    struct identify_options opt = { 0 };
    struct identify_result r;

    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    return r;
}

/* Mode j within `relative` of the truth and within 5 of its own standard errors. */
static void check_mode(const struct identify_result *r, double complex lambda, double relative)
{
    int at = 0;

    for (int i = 1; i < r->mode_count; i++)
        if (cabs(r->modes[i].exponent - lambda) < cabs(r->modes[at].exponent - lambda))
            at = i;
    CHECK(cabs(r->modes[at].exponent - lambda) <= relative * cabs(lambda));
    CHECK(fabs(creal(r->modes[at].exponent - lambda)) <= 5 * r->modes[at].std_re);
    CHECK(fabs(cimag(r->modes[at].exponent - lambda)) <= 5 * r->modes[at].std_im);
}

/* Without noise the reference files are met to 1e-12; a noise of any size in other channels may
 * take a digit, for it is weighed down by no more than 1e6 where channels are reduced. */
TEST(exact_channels_beside_noisy_ones_give_exact_poles_with_bars_that_hold)
{
    static const int channels[] = { 2, 3, 6, 8, 12, 20 };
    static const double noise[] = { 1e-5, 1e-3, 0.03, 1 };

    for (int i = 0; i < 6; i++)
        for (int n = 0; n < 4; n++) {
            struct decay d;
            struct identify_result r;
            make(&d, channels[i], 1 + (i + n) % (channels[i] / 2), noise[n], false,
                 (uint64_t)(10 * i + n));
            r = identified(&d);
            CHECK(r.mode_count == 3);
            for (int j = 0; j < 3; j++)
                check_mode(&r, d.lambda[j], 1e-11);
            CHECK(!has(&r, "not_converged") && !has(&r, "coloured_residual") &&
                  !has(&r, "parts_disagree") && !has(&r, "changes_in_record"));
            CHECK(r.verdict == VERDICT_STABLE);
            identify_result_done(&r);
        }
}

/* Its error is that of the noise where it is heard: at 3 % of the rms, 600 samples, about 1e-4 of
 * the exponent. */
TEST(a_mode_that_only_the_noisy_channels_hear_is_found_with_their_error)
{
    static const int channels[] = { 2, 4, 8, 12, 20 };

    for (int i = 0; i < 5; i++) {
        struct decay d;
        struct identify_result r;
        make(&d, channels[i], 1 + channels[i] / 4, 0.03, true, (uint64_t)(70 + i));
        r = identified(&d);
        CHECK(r.mode_count == 3 && !has(&r, "not_converged"));
        check_mode(&r, d.lambda[0], 1e-11);
        check_mode(&r, d.lambda[1], 1e-11);
        check_mode(&r, d.lambda[2], 2e-3);
        identify_result_done(&r);
    }
}

/* The bound of the noisy channels alone, whose number does not matter to it: s^2 of exact signals
 * must not dilute theirs. */
TEST(the_bar_of_a_mode_in_noise_is_its_bound_whatever_is_exact_beside_it)
{
    struct decay d;
    struct identify_result r;
    double re[DECAY_MODES], im[DECAY_MODES], sum = 0;
    int at = 0;

    make(&d, 8, 1, 0.03, true, 99);
    r = identified(&d);
    for (int k = 0; k < SAMPLES; k++)
        sum += column[k + 7 * SAMPLES] * column[k + 7 * SAMPLES];
    for (int j = 0; j < 3; j++)
        d.B[j][0] = d.B[j][7];
    d.channels = 1;
    /* the other two are known exactly */
    d.lambda[0] = d.lambda[2], d.B[0][0] = d.B[2][0], d.modes = 1;
    decay_bound(&d, 0.03 * sqrt(sum / SAMPLES), re, im);
    for (int i = 1; i < r.mode_count; i++)
        if (cabs(r.modes[i].exponent - d.lambda[0]) < cabs(r.modes[at].exponent - d.lambda[0]))
            at = i;
    /* variance from 600 numbers: 3 %; amplitudes of the other two: 1 % */
    CHECK_NEAR(r.modes[at].std_re, re[0], 0.15 * re[0]);
    CHECK_NEAR(r.modes[at].std_im, im[0], 0.15 * im[0]);
    identify_result_done(&r);
}

/* One channel of three hears five times as much noise as motion: the other two, at 1e-3 of it, tell
 * all three modes, and that they decay freely. */
TEST(a_channel_of_mostly_noise_does_not_hide_what_the_others_hear)
{
    for (uint64_t seed = 0; seed < (uint64_t)check_draws(6, 16); seed++) {
        struct random rng = { 900 + seed };
        struct decay d;
        struct identify_result r;
        make(&d, 3, 1, 5, false, 200 + seed);
        for (int i = 0; i < SAMPLES; i++)
            for (int c = 0; c < 2; c++)
                samples[3 * i + c] += 1e-3 * random_normal(&rng);
        r = identified(&d);
        CHECK(r.mode_count == 3 && r.verdict == VERDICT_STABLE);
        for (int j = 0; j < 3; j++)
            check_mode(&r, d.lambda[j], 1e-3);
        CHECK(!has(&r, "not_free_decay") && !has(&r, "order_work_limit") &&
              !has(&r, "not_converged"));
        identify_result_done(&r);
    }
}
