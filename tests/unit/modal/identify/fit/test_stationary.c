/* test_stationary.c - likelihoods of noise through a known filter, and of decays */
#include "check.h"
#include "modal/identify/fit/stationary.h"
#include "signals.h"

enum { N = 4000 };

/* Two poles of magnitude 0.99: x[t] = a x[t-1] - 0.9801 x[t-2] + unit white noise, settled. */
static void resonance(double *x, struct random *r)
{
    double one = 0, two = 0, a = 2 * 0.99 * cos(0.7);

    for (int t = -2000; t < N; t++) {
        double next = a * one - 0.9801 * two + random_normal(r);
        two = one, one = next;
        if (t >= 0)
            x[t] = next;
    }
}

TEST(noise_through_two_poles_is_as_likely_as_its_innovations_less_two_prices)
{
    struct random r = { 3 };
    double x[N], mean = 0;

    for (int i = 0; i < 10; i++) {
        double likelihood;
        resonance(x, &r);
        CHECK(stationary_likelihood(x, N, &likelihood, NULL) == MODAL_OK);
        mean += likelihood / 10;
    }
    /* innovations of unit variance: -N/2 ln 1, with a deviation of sqrt(N/2) a record, and half of
     * chi-squared of two more for what is fitted */
    CHECK_NEAR(mean, 1 - log(N), 3 * sqrt(N / 2 / 10.0));
}

TEST(white_noise_is_as_likely_as_its_variance_says)
{
    struct random r = { 4 };
    double x[N], v = 0, likelihood;

    for (int t = 0; t < N; t++)
        v += pow(x[t] = 3 * random_normal(&r), 2) / N;
    CHECK(stationary_likelihood(x, N, &likelihood, NULL) == MODAL_OK);
    CHECK_NEAR(likelihood, -0.5 * N * log(v), 2);
}

TEST(a_decay_in_white_noise_is_less_likely_than_one_vibration_beside_that_noise)
{
    for (int i = 0; i < 12; i++) {
        struct random r = { (uint64_t)i + 1 };
        double x[N], likelihood, lives = 2 + i, noise = pow(10, -1 - i % 4);
        for (int t = 0; t < N; t++)
            x[t] = exp(-lives * t / N) * cos(0.7 * t) + noise * random_normal(&r);
        CHECK(stationary_likelihood(x, N, &likelihood, NULL) == MODAL_OK);
        CHECK(likelihood < -N * log(noise) - 2 * log(N) - 100);
    }
}

TEST(nothing_at_all_is_certain)
{
    double x[8] = { 0 }, likelihood;

    CHECK(stationary_likelihood(x, 8, &likelihood, NULL) == MODAL_OK && likelihood == HUGE_VAL);
}
