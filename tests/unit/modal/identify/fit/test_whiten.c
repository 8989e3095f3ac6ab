/* Noise correlated within a period, against the inverse of its covariance's root. */
#include "modal/identify/fit/whiten.h"
#include <math.h>
#include <stdbool.h>
#include "check.h"
#include "signals.h"

enum { L = 400, PHASES = 24, SIGNALS = 2, S = PHASES * SIGNALS };
static double y[L * S], e[L * S];

/* Rows of noise that is told by AR(1) of A in the first signal and is white in the second; a sample
 * of it begins each row as if there had been others before. */
static void noise(double a, uint64_t seed)
{
    struct random r = { seed };

    for (int l = 0; l < L; l++)
        for (int c = 0; c < S; c++) {
            bool white = c >= PHASES, first = c % PHASES == 0;
            double u = random_normal(&r), before = first ? 0 : e[l + (c - 1) * L];
            e[l + c * L] = white ? u : first ? u / sqrt(1 - a * a) : a * before + u;
        }
    memcpy(y, e, sizeof y);
}

/* An AR(1) coefficient is known to 1 / sqrt(L PHASES) = 0.01 of its deviations. */
TEST(correlated_noise_is_left_white_and_of_one_variance_at_every_sample_of_a_period)
{
    const double a = 0.9;
    struct matrix Y = { L, S, L, y }, E = { L, S, L, e };
    double told;

    noise(a, 1);
    CHECK(whiten_rows(&E, PHASES, 0, 100, &Y, &told, NULL) == MODAL_OK);
    CHECK_NEAR(told, 0.5 * a * a, 0.02);            /* of two signals one */
    for (int c = 0; c < S; c++)
        for (int k = 0; k <= c; k++) {
            double sum = 0;
            for (int l = 0; l < L; l++)
                sum += y[l + c * L] * y[l + k * L] / L;
            CHECK_NEAR(sum, c == k, 5 * sqrt((c == k ? 2.0 : 1.0) / L));
        }
}

/* What is made of a row without noise is what (2) takes out of it, at the noise's own deviation. */
TEST(of_a_row_is_left_what_the_sample_before_does_not_tell_whatever_it_holds)
{
    const double a = 0.9;
    struct matrix Y = { L, S, L, y }, E = { L, S, L, e };
    double told;

    noise(a, 2);
    for (int c = 0; c < S; c++)
        for (int l = 0; l < L; l++)
            y[l + c * L] = l == 0 ? c + 1 : 0;
    CHECK(whiten_rows(&E, PHASES, 0, 100, &Y, &told, NULL) == MODAL_OK);
    CHECK_NEAR(y[0], sqrt(1 - a * a), 0.03);
    for (int c = 1; c < PHASES; c++)
        CHECK_NEAR(y[c * L], c + 1 - a * c, 0.02 * PHASES);
    for (int c = 0; c < S; c++)
        CHECK(y[1 + c * L] == 0);
}

TEST(white_noise_stays_as_it_is)
{
    for (uint64_t seed = 10; seed < 30; seed++) {
        struct matrix Y = { L, S, L, y }, E = { L, S, L, e };
        double told;

        noise(0, seed);
        CHECK(whiten_rows(&E, PHASES, 0, 100, &Y, &told, NULL) == MODAL_OK && told == 0);
        CHECK(memcmp(y, e, sizeof y) == 0);
    }
}
