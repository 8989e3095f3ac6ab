/* test_hard_at_size.c - hard cases among many modes: hardly any damping, pairs that nearly
 * coalesce, channels in units far apart, growth among decays, modes that are over before the record
 * is
 *
 * Truth is what makes the record; a mode is right within five of its own standard errors, and
 * those of another unit against what is told in one unit. */
/* Tests as well: identify_growth.c parts.c rounding.c */
#include "check.h"
#include "modal/identify/identify.h"
#include "signals.h"

enum { MOST_MODES = 100, MOST_CHANNELS = 12, MOST_ROWS = 4000 };
static double y[MOST_ROWS * MOST_CHANNELS];
static double complex lambda[MOST_MODES], B[MOST_CHANNELS][MOST_MODES];

static void shapes(struct random *rng, int modes, int channels)
{
    for (int c = 0; c < channels; c++)
        for (int j = 0; j < modes; j++)
            B[c][j] = CMPLX(random_normal(rng), random_normal(rng));
}

/* Samples of what is above, and white noise of deviation SD. */
static void samples(struct random *rng, int modes, int channels, int rows, double dt, double sd)
{
    for (int i = 0; i < rows * channels; i++)
        y[i] = sd * random_normal(rng);
    for (int k = 0; k < rows; k++)
        for (int j = 0; j < modes; j++) {
            double complex z = cexp(lambda[j] * (k * dt));
            for (int c = 0; c < channels; c++)
                y[k * channels + c] += creal(B[c][j] * z);
        }
}

static struct identify_result identified(int channels, int rows, double dt)
{
    struct batch b = { .samples = (size_t)rows, .channels = (size_t)channels, .signals = y,
                       .dt = dt };
    struct identify_result r;

    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    return r;
}

static const struct identify_mode *nearest(const struct identify_result *r, double complex z)
{
    int at = 0;

    for (int m = 1; m < r->mode_count; m++)
        if (cabs(r->modes[m].exponent - z) < cabs(r->modes[at].exponent - z))
            at = m;
    return &r->modes[at];
}

/* Modes within five of their own standard errors. */
static int right(const struct identify_result *r, int modes)
{
    int count = 0;

    for (int j = 0; j < modes && r->mode_count > 0; j++) {
        const struct identify_mode *m = nearest(r, lambda[j]);
        count += fabs(creal(m->exponent - lambda[j])) < 5 * m->std_re
              && fabs(cimag(m->exponent - lambda[j])) < 5 * m->std_im;
    }
    return count;
}

static bool says(const struct identify_result *r, const char *code)
{
    for (int i = 0; i < r->diagnostic_count; i++)
        if (strcmp(r->diagnostics[i].code, code) == 0)
            return true;
    return false;
}

/* Two of a hundred. */
TEST(damping_of_1e_minus_6_among_a_hundred_modes_is_found_and_stable)
{
    enum { ROWS = 4000, WIDTH = 8, MODES = 100 };
    struct random rng = { 1001 };
    struct identify_result r;

    for (int j = 0; j < MODES; j++)
        lambda[j] = decay_pole(1.2 + 0.45 * j + 0.2 * random_uniform(&rng),
                               j % 50 == 30 ? 1e-6 : 1e-4 + 9e-4 * random_uniform(&rng));
    shapes(&rng, MODES, WIDTH);
    samples(&rng, MODES, WIDTH, ROWS, 0.01, 1e-5);
    r = identified(WIDTH, ROWS, 0.01);
    CHECK(r.mode_count == MODES && right(&r, MODES) == MODES && r.verdict == VERDICT_STABLE);
    for (int j = 30; j < MODES; j += 50)
        CHECK(nearest(&r, lambda[j])->std_re < 0.1 * fabs(creal(lambda[j])));
    identify_result_done(&r);
}

/* Four pairs of 0.1 of a line of the record between their halves, of opposite shapes, so that each
 * looks like (a + b t) e^{lambda t}, among sixteen modes; noise of 1e-6.  Their means are as well
 * known as a mode is. */
TEST(pairs_that_nearly_coalesce_among_many_modes_have_errors_that_hold_and_sharp_means)
{
    enum { ROWS = 2000, WIDTH = 6, MODES = 16, PAIRS = 4 };
    struct random rng = { 1002 };
    struct identify_result r;

    for (int j = 0; j < MODES; j++)
        lambda[j] = decay_pole(2 + 2.8 * j + random_uniform(&rng),
                               1e-3 + 1e-3 * random_uniform(&rng));
    shapes(&rng, MODES + PAIRS, WIDTH);
    for (int j = 0; j < PAIRS; j++) {
        lambda[MODES + j] = lambda[4 * j] + CMPLX(-0.01, 0.03);
        for (int c = 0; c < WIDTH; c++)
            B[c][MODES + j] = -B[c][4 * j] * (1 + 0.1 * random_normal(&rng));
    }
    samples(&rng, MODES + PAIRS, WIDTH, ROWS, 0.01, 1e-6);
    r = identified(WIDTH, ROWS, 0.01);
    CHECK(r.mode_count == MODES + PAIRS && right(&r, MODES + PAIRS) == MODES + PAIRS);
    CHECK(r.verdict == VERDICT_STABLE && says(&r, "unresolved_pair"));
    for (int j = 0; j < PAIRS; j++) {
        const struct identify_mode *a = nearest(&r, lambda[4 * j]),
                                   *b = nearest(&r, lambda[MODES + j]);
        double complex mean = (lambda[4 * j] + lambda[MODES + j]) / 2;
        CHECK(a != b);
        CHECK(cabs((a->exponent + b->exponent) / 2 - mean) < 0.2 * (a->std_re + a->std_im) + 1e-6);
    }
    identify_result_done(&r);
}

/* More modes than a small channel shows in few triplets: its unit alone makes it small, and what is
 * told of all is what is told of them in one unit. */
TEST(channels_in_units_1e_minus_8_to_1e8_tell_as_much_as_in_one_unit)
{
    enum { ROWS = 1500, WIDTH = 10, MODES = 24 };
    struct random rng = { 1003 };
    struct identify_result one, many;

    for (int j = 0; j < MODES; j++)
        lambda[j] = decay_pole(1.5 + 1.8 * j + random_uniform(&rng),
                               1e-3 + 2e-3 * random_uniform(&rng));
    shapes(&rng, MODES, WIDTH);
    samples(&rng, MODES, WIDTH, ROWS, 0.01, 0.03);
    one = identified(WIDTH, ROWS, 0.01);
    for (int i = 0; i < ROWS * WIDTH; i++)
        y[i] *= i % WIDTH < 4 ? 1e-8 : i % WIDTH < 7 ? 1e8 : pow(10, i % WIDTH - 8);
    many = identified(WIDTH, ROWS, 0.01);
    CHECK(one.mode_count == MODES && many.mode_count == MODES && right(&many, MODES) == MODES);
    CHECK(many.verdict == VERDICT_STABLE && !says(&many, "below_rounding"));
    for (int j = 0; j < MODES; j++)
        CHECK_NEAR(nearest(&many, lambda[j])->std_re / nearest(&one, lambda[j])->std_re, 1, 1e-3);
    identify_result_done(&one), identify_result_done(&many);
}

/* Growth to 1e8 beside decays of 1 in noise of 1e-3: all are there.  To 1e290: what it hides is
 * said. */
TEST(growth_among_many_decays_is_unstable_and_hides_none_before_rounding_does)
{
    enum { ROWS = 2000, WIDTH = 6, MODES = 20 };
    for (int huge = 0; huge < 2; huge++) {
        struct random rng = { 1004 };
        struct identify_result r;
        double top = huge ? 290 : 8;
        for (int j = 0; j < MODES; j++)
            lambda[j] = decay_pole(1.5 + 2.2 * j + random_uniform(&rng),
                                   1e-3 + 4e-3 * random_uniform(&rng));
        lambda[7] = CMPLX(top * log(10) / (ROWS * 0.01), cimag(lambda[7]));
        shapes(&rng, MODES, WIDTH);
        samples(&rng, MODES, WIDTH, ROWS, 0.01, 1e-3);
        r = identified(WIDTH, ROWS, 0.01);
        CHECK(r.verdict == VERDICT_UNSTABLE && r.mode_count == (huge ? 1 : MODES));
        CHECK(huge ? says(&r, "growth_hides") : right(&r, MODES) == MODES);
        CHECK_NEAR(creal(nearest(&r, lambda[7])->exponent) / creal(lambda[7]), 1, 1e-9);
        identify_result_done(&r);
    }
}

/* Growth to 1e12 is rounded to more than the noise of 1e-3 where it ends: the record before that
 * shows all there is, few modes or many, and rounding is taken for none. */
TEST(growth_that_is_rounded_to_more_than_the_noise_leaves_every_mode_in_the_record_before)
{
    enum { ROWS = 2000, MODES = 20 };
    static const uint64_t seeds[] = { 0, 3, 1, 4, 2, 5 };

    for (int draw = 0; draw < check_draws(2, 6); draw++) {
        uint64_t seed = seeds[draw];
        int modes = seed < 3 ? MODES : 3, width = seed < 3 ? 6 : 4;
        struct random rng = { 1200 + seed };
        struct identify_result r;
        for (int j = 0; j < modes; j++)
            lambda[j] = decay_pole(1.5 + 44.0 / modes * j + random_uniform(&rng),
                                   1e-3 + 4e-3 * random_uniform(&rng));
        lambda[1] = CMPLX(12 * log(10) / (ROWS * 0.01), cimag(lambda[1]));
        shapes(&rng, modes, width);
        samples(&rng, modes, width, ROWS, 0.01, 1e-3);
        r = identified(width, ROWS, 0.01);
        CHECK(r.verdict == VERDICT_UNSTABLE && says(&r, "growth_hides"));
        CHECK(r.mode_count == modes && right(&r, modes) == modes);
        identify_result_done(&r);
    }
}

/* Most of forty have sunk in the noise when the later half begins: free to follow any of it there,
 * they win more than chi-square says, which contradicts nothing. */
TEST(modes_that_are_over_before_the_later_half_leave_the_verdict_alone)
{
    enum { ROWS = 1500, WIDTH = 12, MODES = 40 };

    for (uint64_t seed = 0; seed < 4; seed++) {
        struct random rng = { 1100 + seed };
        struct identify_result r;
        for (int j = 0; j < MODES; j++)
            lambda[j] = decay_pole(1.5 + 1.1 * j + 0.7 * random_uniform(&rng),
                                   5e-3 + 5e-3 * random_uniform(&rng));
        shapes(&rng, MODES, WIDTH);
        samples(&rng, MODES, WIDTH, ROWS, 0.01, 2e-3);
        r = identified(WIDTH, ROWS, 0.01);
        CHECK(r.mode_count == MODES && right(&r, MODES) == MODES);
        CHECK(r.verdict == VERDICT_STABLE && !says(&r, "parts_disagree"));
        identify_result_done(&r);
    }
}
