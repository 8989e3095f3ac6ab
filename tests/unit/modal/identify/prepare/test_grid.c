/* Recordings of few digits: the grid that a converter rounds to is found, and what the rounding
 * leaves is not taken for modes. */
/* Tests as well: digits.c */
#include "check.h"
#include "modal/identify/identify.h"
#include "modal/identify/prepare/grid.h"
#include "signals.h"

enum { SAMPLES = 5000, CHANNELS = 1, DRAWS = 5 };
static double x[SAMPLES * CHANNELS];
static const int bits[] = { 8, 12, 16, 24 };

static double uniform(struct random *rng, double low, double high)
{
    return low + (high - low) * random_uniform(rng);
}

/* ---- the step ---- */

static void fill(struct random *rng, int n, double step, double offset)
{
    for (int k = 0; k < n; k++)
        x[k] = nearbyint(random_normal(rng) * exp(-3.0 * k / n) / step) * step + offset;
}

TEST(the_step_of_a_grid_is_found_whatever_its_size_and_offset)
{
    const double steps[] = { 0x1p-23, 0x1p-15, 1.0 / 32767, 1e-5, 0.01, 0.3 };

    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 2; j++) {
            struct random rng = { 10 + (uint64_t)i };
            fill(&rng, SAMPLES, steps[i], j * 0.7);
            CHECK_NEAR(grid_step(x, 1, SAMPLES) / steps[i], 1, 1e-6);
        }
}

/* A player that stores k / 32767 in single precision. */
TEST(single_precision_lies_on_the_grid_that_it_was_made_from)
{
    struct random rng = { 5 };

    for (int k = 0; k < SAMPLES; k++)
        x[k] = (float)(nearbyint(fmin(1, fmax(-1, random_normal(&rng) / 3)) * 32767) / 32767);
    CHECK_NEAR(grid_step(x, 1, SAMPLES) * 32767, 1, 1e-6);
}

TEST(numbers_of_the_continuum_lie_on_no_grid)
{
    const int counts[] = { 8, 12, 50, SAMPLES };

    for (int i = 0; i < 200; i++) {
        struct random rng = { 1000 + (uint64_t)i };
        int n = counts[i % 4];
        for (int k = 0; k < n; k++)
            x[k] = i % 2 ? random_normal(&rng) : exp(-0.01 * k) * cos(0.3 * k + i);
        CHECK(grid_step(x, 1, n) == 0);
        for (int k = 0; k < n; k++)
            x[k] = (float)x[k];
        CHECK(grid_step(x, 1, n) == 0);
    }
    for (int k = 0; k < 100; k++)
        x[k] = 3;
    CHECK(grid_step(x, 1, 100) == 0);
}

/* ---- significant digits ---- */

enum { SINGLE_PRECISION = 0 };

/* What a table of so many digits says, or single precision. */
static double rounded(double value, int digits)
{
    char text[64];

    if (digits == SINGLE_PRECISION)
        return (float)value;
    snprintf(text, sizeof text, "%.*e", digits - 1, value);
    return strtod(text, NULL);
}

TEST(the_steps_of_few_digits_are_those_that_made_the_rounding_errors)
{
    const int digits[] = { 3, 4, 5, 6, 8, 11, 13, SINGLE_PRECISION };

    for (int i = 0; i < 8; i++) {
        struct random rng = { 70 + (uint64_t)i };
        double errors = 0;
        struct grid grid;
        for (int k = 0; k < SAMPLES; k++) {
            double value = random_normal(&rng) * exp(-2.0 * k / SAMPLES);
            x[k] = rounded(value, digits[i]);
            errors += (x[k] - value) * (x[k] - value) / SAMPLES;
        }
        grid = grid_of(x, 1, SAMPLES);
        CHECK(grid.floating);
        CHECK_NEAR(grid.step / sqrt(12 * errors), 1, 0.05);
    }
}

TEST(numbers_of_the_continuum_and_of_a_grid_are_of_no_few_digits)
{
    for (int i = 0; i < 200; i++) {
        struct random rng = { 80 + (uint64_t)i };
        for (int k = 0; k < 50; k++)
            x[k] = random_normal(&rng);
        CHECK(grid_of(x, 1, 50).step == 0);
        fill(&rng, 50, i % 2 ? 0.01 : 0x1p-11, 0);
        CHECK(grid_of(x, 1, 50).step > 0 && !grid_of(x, 1, 50).floating);
    }
}

/* ---- identification ---- */

/* One to three modes at least three beats of the record apart, decaying by e^-3 to e^-25 over it:
 * most fall below a step before its end. */
static void draw(struct random *rng, struct decay *d)
{
    double record = SAMPLES * 0.01, f = uniform(rng, 1.5, 5);

    *d = (struct decay) { .modes = 1 + (int)(3 * random_uniform(rng)),
                         .channels = CHANNELS,
                         .samples = SAMPLES,
                         .dt = 0.01 };
    for (int j = 0; j < d->modes; j++) {
        d->lambda[j] = CMPLX(-uniform(rng, 3, 25) / record, 2 * M_PI * f);
        f += uniform(rng, 3 / record, 12);
    }
    decay_amplitudes(d, rng);
}

/* Full scale is four. */
static double sample(const struct decay *d, int b, double noise, struct random *rng)
{
    static double y[SAMPLES * CHANNELS];
    double q = 8 / ldexp(1, b);

    decay_signals(d, y, SAMPLES);
    for (int k = 0; k < SAMPLES; k++)
        for (int c = 0; c < CHANNELS; c++)
            x[k * CHANNELS + c] =
                nearbyint((y[k + c * SAMPLES] + noise * q * random_normal(rng)) / q) * q;
    return q;
}

/* How many standard errors, by the bound of white noise SD and by the answer, the modes are off;
 * false where their number is wrong. */
static bool compare(const struct decay *d, double sd, const struct identify_result *r,
                    double *by_bound, double *by_std)
{
    double std_re[DECAY_MODES], std_im[DECAY_MODES];

    *by_bound = *by_std = 0;
    decay_bound(d, sd, std_re, std_im);
    for (int j = 0; j < d->modes && r->mode_count == d->modes; j++) {
        int best = 0;
        for (int i = 0; i < r->mode_count; i++)
            if (cabs(r->modes[i].exponent - d->lambda[j]) <
                cabs(r->modes[best].exponent - d->lambda[j]))
                best = i;
        double off = fabs(cimag(r->modes[best].exponent - d->lambda[j]));
        *by_bound = fmax(*by_bound, off / std_im[j]);
        *by_std = fmax(*by_std, off / r->modes[best].std_im);
    }
    return r->mode_count == d->modes;
}

/* The bound is of white noise of variance q^2/12 and the noise; five of it, for rounding is not
 * quite white.  Its own errors: at most five too. */
static void check_depths(double noise)
{
    for (int i = 0; i < 4 * DRAWS; i++) {
        struct random rng = { 60 + (uint64_t)i };
        struct batch b = { .samples = SAMPLES, .channels = CHANNELS, .signals = x, .dt = 0.01 };
        struct identify_options opt = { 0 };
        struct identify_result r;
        struct decay d;
        double by_bound, by_std, q;
        draw(&rng, &d);
        q = sample(&d, bits[i % 4], noise, &rng);
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        bool right = compare(&d, q * sqrt(noise * noise + 1.0 / 12), &r, &by_bound, &by_std);
        if (!right || by_bound >= 5 || by_std >= 5)
            printf("draw %d: %d bits, noise %g steps: %d modes of %d, off by %g bounds, %g "
                   "standard errors\n",
                   i, bits[i % 4], noise, r.mode_count, d.modes, by_bound, by_std);
        CHECK(right && by_bound < 5 && by_std < 5);
        CHECK(r.verdict == VERDICT_STABLE);
        identify_result_done(&r);
    }
}

/* Through a filter the grid's noise is as much less as any white noise's: no modes beside the
 * three, each within five standard errors. */
TEST(a_band_of_a_record_of_few_digits_has_its_own_modes_and_no_more)
{
    static const int depths[] = { 8, 10, 12, 16 };
    enum { LONG = 4000 };
    double *column = malloc(sizeof *column * 3 * LONG),
           *rounded = malloc(sizeof *rounded * 3 * LONG);

    CHECK(column != NULL && rounded != NULL);
    for (int i = 0; i < 8; i++) {
        struct random rng = { 300 + (uint64_t)i };
        struct decay d = { .modes = 3,
                           .channels = 3,
                           .samples = LONG,
                           .dt = 0.02,
                           .lambda = { decay_pole(1, 0.01), decay_pole(2.3, 0.005),
                                       decay_pole(4.1, 0.02) } };
        struct batch b = { .samples = LONG, .channels = 3, .signals = rounded, .dt = d.dt };
        struct identify_options opt = { .band = { 0.5, 6 } };
        struct identify_result r;
        double q = 3 * exp2(1 - depths[i % 4]);         /* amplitudes: at most 1 a mode */
        decay_amplitudes(&d, &rng);
        decay_signals(&d, column, LONG);
        for (int k = 0; k < 3 * LONG; k++)
            rounded[k] = nearbyint(column[k / 3 + k % 3 * LONG] / q) * q;
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == 3);
        for (int j = 0; j < 3; j++) {
            int at = 0;
            for (int m = 1; m < r.mode_count; m++)
                if (cabs(r.modes[m].exponent - d.lambda[j]) <
                    cabs(r.modes[at].exponent - d.lambda[j]))
                    at = m;
            CHECK(fabs(creal(r.modes[at].exponent - d.lambda[j])) < 5 * r.modes[at].std_re);
            CHECK(fabs(cimag(r.modes[at].exponent - d.lambda[j])) < 5 * r.modes[at].std_im);
        }
        identify_result_done(&r);
    }
    free(column), free(rounded);
}

TEST(clean_decays_of_few_digits_have_their_own_modes_and_no_more)
{
    check_depths(0);
}

TEST(noise_about_the_step_and_above_changes_nothing_of_that)
{
    check_depths(0.3);
    check_depths(3);
}

/* One to three modes in three channels, rounded to so many digits: loud rounding where the response
 * is.  Adds the errors over their standard errors that are below 1.96, and all. */
static void check_digits(uint64_t seed, int digits, int *within, int *all)
{
    enum { L = 1000, S = 3 };
    static double y[L * S], z[L * S];
    struct random rng = { seed };
    struct decay d = { .modes = 1 + (int)(seed % 3), .channels = S, .samples = L, .dt = 0.01 };
    struct batch b = { .samples = L, .channels = S, .signals = z, .dt = d.dt };
    struct identify_options opt = { 0 };
    struct identify_result r;
    double f = uniform(&rng, 0.5, 5);

    for (int j = 0; j < d.modes; j++, f += uniform(&rng, 0.5, 12))
        d.lambda[j] = decay_pole(f, exp(uniform(&rng, log(0.001), log(0.04))));
    decay_amplitudes(&d, &rng);
    decay_signals(&d, y, L);
    for (int k = 0; k < L * S; k++)
        z[k] = rounded(y[k / S + k % S * L], digits);
    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    if (r.mode_count != d.modes)
        printf("seed %d: %d digits, %d modes of %d\n", (int)seed, digits, r.mode_count, d.modes);
    CHECK(r.mode_count == d.modes && r.verdict == VERDICT_STABLE);
    for (int j = 0; j < d.modes && r.mode_count > 0; j++) {
        int at = 0;
        for (int m = 1; m < r.mode_count; m++)
            if (cabs(r.modes[m].exponent - d.lambda[j]) < cabs(r.modes[at].exponent - d.lambda[j]))
                at = m;
        *within += fabs(creal(r.modes[at].exponent - d.lambda[j])) < 1.96 * r.modes[at].std_re;
        *within += fabs(cimag(r.modes[at].exponent - d.lambda[j])) < 1.96 * r.modes[at].std_im;
        *all += 2;
    }
    identify_result_done(&r);
}

/* Of 240 numbers 95 % give or take 3.5 standard deviations of that count, 1.4 %. */
TEST(decays_of_few_significant_digits_have_their_own_modes_and_errors)
{
    check_slow();
    const int digits[] = { 3, 5, 6, 9, SINGLE_PRECISION };
    int within = 0, all = 0;

    for (int i = 0; i < 60; i++)
        check_digits(400 + (uint64_t)i, digits[i % 5], &within, &all);
    CHECK(all == 240);
    CHECK(within > 0.90 * all && within < all);
}

/* Fibonacci's numbers lie on the grid 1, and are exact: the second mode falls below a step at once,
 * and is there. */
TEST(whole_numbers_that_are_exact_keep_what_is_smaller_than_one)
{
    struct batch b = { .samples = 24, .channels = 1, .signals = x, .dt = 1 };
    struct identify_options opt = { 0 };
    struct identify_result r;

    x[0] = x[1] = 1;
    for (int k = 2; k < 24; k++)
        x[k] = x[k - 1] + x[k - 2];
    CHECK(grid_step(x, 1, 24) == 1);
    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == 2);
    for (int i = 0; i < r.mode_count; i++) {
        double rho = creal(r.modes[i].multiplier), golden = (1 + sqrt(5)) / 2;
        CHECK_NEAR(rho, rho > 0 ? golden : -1 / golden, 1e-8);
    }
    identify_result_done(&r);
}

TEST(few_samples_say_that_the_continuum_has_no_grid_and_miss_none_that_is_there)
{
    const double steps[] = { 0x1p-23, 1.0 / 32767, 0.01, 1 };
    struct random rng = { 67 };

    for (int i = 0; i < DRAWS; i++) {
        for (int k = 0; k < GRID_FIRST; k++)
            x[k] = random_normal(&rng);
        CHECK(!grid_may_be(x, GRID_FIRST) && grid_may_be(x, GRID_FIRST - 1));
        for (int k = 0; k < GRID_FIRST; k++)
            x[k] = (float)x[k];
        CHECK(grid_may_be(x, GRID_FIRST));
        for (int j = 0; j < 4; j++) {
            fill(&rng, GRID_FIRST, steps[j], 0);
            CHECK(grid_may_be(x, GRID_FIRST));
        }
    }
}
