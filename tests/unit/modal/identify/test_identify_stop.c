/* A response that stops where its modes would last, and such as do not stop. Motions are sums of
 * modes in closed form, with nothing after the row that they stop at. */
#include "modal/identify/identify.h"
#include <stdlib.h>
#include <string.h>
#include "answer.h"
#include "check.h"
#include "signals.h"

enum { MODES_MOST = 6 };

enum { STOPS = 6 };

/* Modes that last to e^-1 to e^-3 of their beginning at row *STOP, where they stop; or, DIES, that
 * die away: the slowest pair of two or more beats. 20 to 60 dB; each channel has its own noise. */
static double *stopped_signals(struct decay *d, int *stop, bool dies, struct random *rng)
{
    d->modes = 1 + (int)(MODES_MOST * random_uniform(rng)), d->dt = 1;
    d->channels = 1 + (int)(4 * random_uniform(rng));
    d->samples = 500 + (int)(700 * random_uniform(rng));
    *stop = (int)(d->samples * (0.2 + 0.6 * random_uniform(rng)));
    for (int j = 0; j < d->modes; j++) {
        double depth = 1 + 2 * random_uniform(rng);
        if (dies)
            depth = 6 * pow(8, random_uniform(rng));
        d->lambda[j] = CMPLX(-depth / *stop, 0.1 + 0.4 * (j + random_uniform(rng)));
    }
    if (dies && d->modes > 1)
        d->lambda[1] = d->lambda[0] + CMPLX(0, -2 * creal(d->lambda[0]));
    decay_amplitudes(d, rng);
    size_t L = (size_t)d->samples, S = (size_t)d->channels;
    double *column = calloc(L * S, sizeof *column), *y = calloc(L * S, sizeof *y);
    decay_signals(d, column, L);
    for (size_t c = 0; c < S; c++) {
        double *x = column + c * L, power = 0, db = 20 + 40 * random_uniform(rng);
        for (size_t k = 0; k < L; k++) {
            x[k] = !dies && k >= (size_t)*stop ? 0 : x[k];
            power += k < (size_t)*stop ? x[k] * x[k] / *stop : 0;
        }
        for (size_t k = 0; k < L; k++)
            y[k * S + c] = x[k] + sqrt(power) * pow(10, -db / 20) * random_normal(rng);
    }
    free(column);
    return y;
}

/* Errors of 4 standard deviations have a chance of 1e-4 each; the row is told within a few. */
TEST(a_response_that_stops_is_told_without_a_verdict_and_what_comes_before_has_the_true_modes)
{
    for (int i = 0; i < check_draws(3, STOPS); i++) {
        struct random rng = { 7000 + (uint64_t)i };
        struct decay d = { 0 };
        int stop;
        double *y = stopped_signals(&d, &stop, false, &rng);
        struct identify_result r = identified(y, d.samples, d.channels, 0, 0);
        CHECK(told(&r) && r.verdict == VERDICT_UNDECIDED && r.proposed[0] == 0);
        CHECK(r.proposed[1] > stop - 20 && r.proposed[1] < stop + 20);
        CHECK(r.used.window[1] == 0 && r.samples == d.samples);
        for (int j = 0; j < r.mode_count; j++)
            CHECK(isnan(r.modes[j].std_re));
        identify_result_done(&r);
        r = identified(y, d.samples, d.channels, WINDOW_AUTO, 0);
        CHECK(!told(&r) && r.verdict == VERDICT_STABLE && r.mode_count == d.modes);
        CHECK(r.proposed[1] > stop - 20 && r.proposed[1] < stop + 20);
        CHECK(r.used.window[1] == r.proposed[1]);
        for (int j = 0; j < d.modes; j++)
            CHECK(shows(&r, d.lambda[j], 4));
        identify_result_done(&r);
        free(y);
    }
}

TEST(a_response_that_dies_away_by_its_modes_does_not_stop)
{
    for (int i = 0; i < 4 * STOPS; i++) {
        struct random rng = { 8000 + (uint64_t)i };
        struct decay d = { 0 };
        int stop;
        double *y = stopped_signals(&d, &stop, true, &rng);
        struct identify_result r = identified(y, d.samples, d.channels, 0, 0);
        CHECK(!told(&r) && r.proposed[1] == 0 && r.verdict == VERDICT_STABLE);
        identify_result_done(&r);
        free(y);
    }
}

/* An offset of 2 to 2e8 times the motion, exact or in noise of a thousandth: beside squares of the
 * offset, those of the noise are mostly rounding. */
TEST(a_response_that_dies_away_by_its_modes_does_not_stop_far_from_zero)
{
    enum { L = 1500 };
    static double y[L];

    for (int i = 0; i < 2 * STOPS; i++) {
        struct random rng = { 9000 + (uint64_t)i };
        const double offset = 1.7 * pow(100, i / 2 % 5), noise = i % 2 * 1e-3;
        for (int k = 0; k < L; k++)
            y[k] = offset + exp(-0.03 * k) * cos(0.5 * k + i) + noise * random_normal(&rng);
        struct identify_result r = identified(y, L, 1, 0, 0);
        CHECK(!told(&r) && r.proposed[1] == 0 && r.verdict == VERDICT_STABLE);
        identify_result_done(&r);
    }
}

/* A simulation that ends leaves zeros, and no noise before. */
TEST(a_response_that_zeros_follow_stops_where_they_begin)
{
    struct decay d = { .modes = 2, .channels = 1, .dt = 1, .samples = 3000,
                       .lambda = { CMPLX(-2e-3, 0.3), CMPLX(-1e-3, 0.8) } };
    struct random rng = { 11 };
    double *y = calloc((size_t)d.samples, sizeof *y);

    decay_amplitudes(&d, &rng);
    decay_signals(&d, y, (size_t)d.samples);
    memset(y + 1300, 0, sizeof *y * 1700);
    struct identify_result r = identified(y, d.samples, 1, WINDOW_AUTO, 0);
    CHECK(r.proposed[1] == 1299 && r.mode_count == 2 && r.verdict == VERDICT_STABLE);
    CHECK(cabs(r.modes[0].exponent - d.lambda[0]) < 1e-9
          || cabs(r.modes[1].exponent - d.lambda[0]) < 1e-9);
    identify_result_done(&r);
    free(y);
}

/* 400 of 1200 samples of a response. */
static void stop_early(double *y)
{
    struct random rng = { 12 };

    for (int k = 0; k < 1200; k++)
        y[k] = (k < 400) * exp(-4e-3 * k) * cos(0.7 * k) + 1e-3 * random_normal(&rng);
}

/* 900 rows of 1200 samples are as asked, of the 400 before the stop they would be refused. */
TEST(rows_and_columns_that_do_not_fit_before_a_stop_are_no_refusal)
{
    enum { L = 1200, STOP = 400 };
    static double y[L];

    stop_early(y);
    for (int columns = 0; columns <= 290; columns += 290) {
        struct batch b = { .samples = L, .channels = 1, .signals = y, .dt = 1 };
        struct identify_options opt = { .rows = 900, .columns = columns };
        struct identify_result r = { 0 };
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(told(&r) && r.proposed[1] == STOP - 1 && r.verdict == VERDICT_UNDECIDED);
        identify_result_done(&r);
    }
}

TEST(window_auto_has_the_rows_that_were_asked_before_a_stop_or_refuses_them_by_name)
{
    enum { L = 1200, STOP = 400 };
    static double y[L];
    struct batch b = { .samples = L, .channels = 1, .signals = y, .dt = 1 };
    struct identify_options opt = { .rows = 123, .window = { WINDOW_AUTO } };
    struct identify_result r = { 0 };
    struct modal_error err = { 0 };

    stop_early(y);
    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    CHECK(r.rows == 123 && r.samples == STOP && r.proposed[1] == STOP - 1);
    identify_result_done(&r);
    opt.rows = STOP;
    CHECK(modal_identify(&b, &opt, &r, &err) == MODAL_BAD_INPUT);
    CHECK(strcmp(err.field, "rows") == 0 && r.modes == NULL);
}

/* Dry friction takes as much of the amplitude each period until nothing moves: modes of the part
 * before it that cancel at its end are none of the system's. */
TEST(a_response_that_friction_ends_is_not_taken_for_modes_that_stop)
{
    for (int i = 0; i < STOPS; i++) {
        struct random rng = { 600 + (uint64_t)i };
        int L = 600 + 100 * i, stop = (int)(L * (0.2 + 0.5 * random_uniform(&rng)));
        double *y = calloc((size_t)L, sizeof *y), w = 0.05 + 2 * random_uniform(&rng);
        for (int k = 0; k < L; k++)
            y[k] = (k < stop ? (1 - (double)k / stop) * cos(w * k) : 0)
                 + pow(10, -1 - 0.15 * i) * random_normal(&rng);
        struct identify_result r = identified(y, L, 1, WINDOW_AUTO, 0);
        CHECK(r.proposed[1] == 0);
        identify_result_done(&r);
        free(y);
    }
}
