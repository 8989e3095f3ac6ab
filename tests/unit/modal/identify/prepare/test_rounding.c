/* A channel of rounding errors beside real ones is left out; one that is small by its unit is not.
 */
#include "check.h"
#include "modal/identify/identify.h"
#include "signals.h"

enum { SAMPLES = 600 };
static const double dt = 0.02;
static double x[3 * SAMPLES];

static double wave(int k)
{
    return exp(-0.2 * k * dt) * cos(7 * k * dt) + 0.4 * exp(-0.3 * k * dt) * cos(19 * k * dt + 1);
}

static bool has(const struct identify_result *r, const char *code)
{
    for (int i = 0; i < r->diagnostic_count; i++)
        if (strcmp(r->diagnostics[i].code, code) == 0)
            return true;
    return false;
}

static struct identify_result identified(void)
{
    struct batch b = { .samples = SAMPLES, .channels = 3, .signals = x, .dt = dt };
    struct identify_options opt = { 0 };
    struct identify_result r;

    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    return r;
}

/* (y + 1 - 1) - y is the rounding of y at 1. */
TEST(a_channel_of_the_last_bits_of_another_spoils_nothing)
{
    struct identify_result r;

    for (int k = 0; k < SAMPLES; k++) {
        volatile double y = wave(k), shifted = y + 1;
        x[3 * k] = y, x[3 * k + 1] = 0.3 * y + exp(-0.2 * k * dt) * sin(7 * k * dt),
              x[3 * k + 2] = 0.01 * ((shifted - 1) - y);
    }
    r = identified();
    CHECK(r.mode_count == 2 && has(&r, "below_rounding"));
    CHECK_NEAR(creal(r.modes[0].exponent), -0.2, 1e-12);
    CHECK_NEAR(cimag(r.modes[0].exponent), 7, 1e-12);
    CHECK_NEAR(creal(r.modes[1].exponent), -0.3, 1e-12);
    CHECK_NEAR(cimag(r.modes[1].exponent), 19, 1e-12);
    CHECK(r.relative_error[0] < 1e-12 && isnan(r.relative_error[2]));
    identify_result_done(&r);
}

TEST(a_channel_in_a_unit_1e18_times_larger_is_kept_with_its_own_mode)
{
    struct identify_result r;
    bool found = false;

    for (int k = 0; k < SAMPLES; k++)
        x[3 * k] = wave(k), x[3 * k + 1] = -0.7 * wave(k),
              x[3 * k + 2] = 1e-18 * (wave(k) + 0.5 * exp(-0.1 * k * dt) * cos(31 * k * dt));
    r = identified();
    for (int i = 0; i < r.mode_count; i++)
        found |= cabs(r.modes[i].exponent - CMPLX(-0.1, 31)) < 1e-10;
    CHECK(r.mode_count == 3 && found && !has(&r, "below_rounding"));
    CHECK(r.relative_error[2] < 1e-10);
    identify_result_done(&r);
}

/* Noise alone in all channels, however small, is its own largest. */
TEST(small_noise_alone_is_not_left_out)
{
    struct random rng = { 77 };
    struct identify_result r;

    for (int k = 0; k < 3 * SAMPLES; k++)
        x[k] = 1e-17 * random_normal(&rng);
    r = identified();
    CHECK(!has(&r, "below_rounding"));
    identify_result_done(&r);
}
