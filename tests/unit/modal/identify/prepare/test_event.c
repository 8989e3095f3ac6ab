/* Quiet, a half sine that strikes, the free response, noise: where each ends, and what is
 * identified of the part proposed. Motions are the convolution integral in closed form. */
#include "modal/identify/identify.h"
#include <stdlib.h>
#include "answer.h"
#include "check.h"
#include "signals.h"

enum { MODES_MOST = 6, CHANNELS_MOST = 5 };

struct strike {
    int samples, channels, modes;
    double begin, duration, noise;       /* in samples; beside a response of about 1 */
    double complex lambda[MODES_MOST];   /* a sample */
    double shape[MODES_MOST][CHANNELS_MOST];
};

/* The integral of sin(a s) exp(lambda (t - s)), s from 0 to t or the end of the half sine. */
static double complex response(double complex lambda, double duration, double t)
{
    double a = M_PI / duration, u = t < duration ? t : duration;
    double complex end = lambda * sin(a * u) + a * cos(a * u);

    end *= cexp(lambda * (t - u));
    return t <= 0 ? 0 : (a * cexp(lambda * t) - end) / (lambda * lambda + a * a);
}

/* Velocities: row after row. */
static double *strike_signals(const struct strike *s, struct random *rng)
{
    size_t S = (size_t)s->channels;
    double *y = calloc((size_t)s->samples * S, sizeof *y);

    for (int j = 0; j < s->modes; j++) {
        double most = cabs(response(s->lambda[j], s->duration, s->duration));
        for (int k = 0; k < s->samples; k++) {
            double x = cimag(s->lambda[j]
                             * response(s->lambda[j], s->duration, k - s->begin))
                       / most / cabs(s->lambda[j]);
            for (size_t c = 0; c < S; c++)
                y[(size_t)k * S + c] += x * s->shape[j][c];
        }
    }
    for (size_t i = 0; i < (size_t)s->samples * S; i++)
        y[i] += s->noise * random_normal(rng);
    return y;
}

static void strike_draw(struct strike *s, double noise_db, struct random *rng)
{
    *s = (struct strike) { .samples = 800 + (int)(4000 * random_uniform(rng)) };
    s->channels = 1 + (int)(CHANNELS_MOST * random_uniform(rng));
    s->modes = 1 + (int)(3 * random_uniform(rng));
    s->begin = s->samples * (0.03 + 0.4 * random_uniform(rng));
    s->duration = 2 + 10 * random_uniform(rng);
    s->noise = noise_db > 0 ? pow(10, -noise_db / 20) : 0;
    for (int j = 0; j < s->modes; j++) {
        double w = 2 * M_PI * (0.02 + 0.06 * (j + random_uniform(rng)));
        s->lambda[j] = CMPLX(-(2 + 10 * random_uniform(rng)) / s->samples, w);
        for (int c = 0; c < s->channels; c++)
            s->shape[j][c] = 0.5 + random_uniform(rng);
    }
}

/* Errors of 4 standard deviations have a chance of 1e-4 each. */
TEST(what_is_proposed_begins_after_the_strike_and_its_modes_are_the_true_ones)
{
    const double levels[] = { 0, 80, 60, 40, 30 };
    const int each = 12;

    for (int i = 0; i < (int)(sizeof levels / sizeof *levels) * each; i++) {
        struct random rng = { 9100 + (uint64_t)i };
        struct strike s;
        strike_draw(&s, levels[i / each], &rng);
        double *y = strike_signals(&s, &rng), end = s.begin + s.duration;
        struct identify_result r = identified(y, s.samples, s.channels, WINDOW_AUTO, 0);
        CHECK(r.proposed[0] >= end && r.proposed[0] < end + 0.1 * s.samples);
        CHECK(r.proposed[1] > end + 0.2 * s.samples && r.proposed[1] <= s.samples - 1);
        CHECK(r.used.window[0] == r.proposed[0] && r.used.window[1] == r.proposed[1]);
        CHECK(!told(&r) && r.mode_count == s.modes);
        for (int j = 0; j < s.modes; j++)
            CHECK(shows(&r, s.lambda[j], 4));
        identify_result_done(&r);
        free(y);
    }
}

/* Equal strikes, 3000 rows apart. */
TEST(of_two_strikes_what_follows_the_second_is_proposed)
{
    struct random rng = { 31 };
    struct strike s = { .samples = 8000, .channels = 1, .modes = 2, .begin = 400, .duration = 5,
                        .noise = 0.003, .lambda = { CMPLX(-1e-3, 0.3), CMPLX(-2e-3, 0.75) },
                        .shape = { { 1 }, { 0.6 } } };
    double *y = strike_signals(&s, &rng), *again;
    struct identify_result r;

    s.noise = 0, s.begin += 3000;
    again = strike_signals(&s, &rng);
    for (int k = 0; k < s.samples; k++)
        y[k] += again[k];
    r = identified(y, s.samples, 1, WINDOW_AUTO, 0);
    CHECK(r.proposed[0] >= 3405 && r.proposed[0] < 4200 && r.mode_count == 2);
    CHECK(shows(&r, s.lambda[0], 4) && shows(&r, s.lambda[1], 4));
    identify_result_done(&r);
    free(y), free(again);
}

TEST(a_window_that_was_not_asked_for_is_told_with_advice_and_not_used)
{
    check_slow();
    struct random rng = { 77 };
    struct strike s;

    strike_draw(&s, 50, &rng);
    double *y = strike_signals(&s, &rng);
    struct identify_result r = identified(y, s.samples, s.channels, 0, 0);
    CHECK(r.proposed[0] >= s.begin + s.duration && told(&r));
    CHECK(r.used.window[1] == 0 && r.samples == s.samples);
    identify_result_done(&r);
    free(y);
}

/* Its rows are looked at in means of many samples. */
TEST(a_very_long_record_is_cut_as_well)
{
    struct random rng = { 6 };
    struct strike s = { .samples = 150000, .channels = 1, .modes = 2, .begin = 40000, .duration = 9,
                        .noise = 0.01, .lambda = { CMPLX(-3e-5, 0.3), CMPLX(-5e-5, 0.7) },
                        .shape = { { 1 }, { 0.5 } } };
    double *y = strike_signals(&s, &rng);
    struct identify_result r = identified(y, s.samples, s.channels, WINDOW_AUTO, 0);

    CHECK(r.proposed[0] >= 40009 && r.proposed[0] < 45000 && r.mode_count == 2);
    CHECK(shows(&r, s.lambda[0], 4) && shows(&r, s.lambda[1], 4));
    identify_result_done(&r);
    free(y);
}

/* All of it would be searched for modes without end. Named, a window is what it says. */
TEST(of_a_very_long_record_that_begins_with_quiet_the_response_alone_is_identified)
{
    struct random rng = { 7 };
    struct strike s = { .samples = 60000, .channels = 2, .modes = 2, .begin = 20000, .duration = 9,
                        .noise = 0.01, .lambda = { CMPLX(-5e-5, 0.3), CMPLX(-9e-5, 0.7) },
                        .shape = { { 1, 0.3 }, { 0.5, 0.8 } } };
    double *y = strike_signals(&s, &rng);
    struct identify_result r = identified(y, s.samples, s.channels, 0, 0);

    CHECK(r.proposed[0] >= 20009 && r.proposed[0] < 22500 && told(&r) && r.mode_count == 2);
    CHECK(r.used.window[0] == r.proposed[0] && r.used.window[1] == r.proposed[1]);
    CHECK(shows(&r, s.lambda[0], 4) && shows(&r, s.lambda[1], 4));
    CHECK(r.verdict == VERDICT_STABLE);
    identify_result_done(&r);
    struct batch b = { .samples = (size_t)s.samples, .channels = 2, .signals = y, .dt = 1 };
    struct identify_options whole = { .window = { 0, s.samples } };
    CHECK(modal_identify(&b, &whole, &r, NULL) == MODAL_OK);
    CHECK(r.samples == s.samples && told(&r));
    identify_result_done(&r);
    free(y);
}

/* From where the amplitude is twice the noise to where it is a fifth of it. */
TEST(what_is_proposed_ends_where_white_noise_is_left)
{
    struct random rng = { 5 };
    struct strike s = { .samples = 6000, .channels = 2, .modes = 1, .begin = 400, .duration = 6,
                        .noise = 0.01, .lambda = { CMPLX(-1.0 / 200, 0.4) },
                        .shape = { { 1, 0.7 } } };
    double *y = strike_signals(&s, &rng), begin = s.begin;
    struct identify_result r = identified(y, s.samples, s.channels, WINDOW_AUTO, 0);

    CHECK(r.proposed[1] > begin + 200 * log(50) && r.proposed[1] < begin + 200 * log(500));
    CHECK(r.mode_count == 1 && shows(&r, s.lambda[0], 4));
    identify_result_done(&r);
    free(y);
}

/* Fast and slow modes, close pairs that beat, growth, an offset; no noise, and 10 to 80 dB. */
TEST(free_responses_keep_their_whole_record)
{
    int cut = 0;
    const int records = 200;

    for (int i = 0; i < records; i++) {
        struct random rng = { 4000 + (uint64_t)i };
        struct decay d = { .modes = 1 + i % 4, .channels = 1 + i % 3, .dt = 1 };
        d.samples = 100 + (int)(900 * random_uniform(&rng));
        for (int j = 0; j < d.modes; j++) {
            double decay = 30 * pow(random_uniform(&rng), 3) / d.samples;
            d.lambda[j] = CMPLX(-decay, 0.1 + 2.5 * random_uniform(&rng));
        }
        if (i % 5 == 0 && d.modes > 1)
            d.lambda[1] = d.lambda[0] + CMPLX(0, 8 * M_PI * random_uniform(&rng) / d.samples);
        if (i % 7 == 0)
            d.lambda[0] = CMPLX(6 * random_uniform(&rng) / d.samples, cimag(d.lambda[0]));
        if (i % 6 == 0)
            d.lambda[d.modes++] = 0;
        decay_amplitudes(&d, &rng);
        double *column = calloc((size_t)d.samples * 3, sizeof *column), *y;
        decay_signals(&d, column, (size_t)d.samples);
        if (i % 8 > 0)
            decay_noise(&d, column, (size_t)d.samples, 10 + 70 * random_uniform(&rng), &rng);
        y = calloc((size_t)d.samples * 3, sizeof *y);
        for (int k = 0; k < d.samples; k++)
            for (int c = 0; c < d.channels; c++)
                y[k * d.channels + c] = column[k + c * d.samples];
        struct identify_result r = identified(y, d.samples, d.channels, WINDOW_AUTO, 0);
        cut += r.proposed[1] != 0;
        CHECK(r.proposed[1] != 0 || (r.used.window[1] == 0 && r.samples == d.samples));
        identify_result_done(&r);
        free(column), free(y);
    }
    CHECK(cut <= records / 100);
}

/* A short record: of a strike that is no periodic system's a search for its modes takes long. */
TEST(of_a_periodic_system_nothing_is_proposed)
{
    struct random rng = { 12 };
    struct strike s;

    strike_draw(&s, 60, &rng);
    s.samples = (int)(0.15 * s.samples), s.begin *= 0.15, s.channels = s.modes = 1;
    s.lambda[0] = CMPLX(creal(s.lambda[0]) / 0.15, cimag(s.lambda[0]));
    double *y = strike_signals(&s, &rng);
    for (int period = 0; period <= 8; period += 8) {
        struct identify_result r = identified(y, s.samples, s.channels, WINDOW_AUTO, period);
        CHECK((r.proposed[0] == 0 && r.proposed[1] == 0) == (period > 0));
        CHECK((r.used.window[1] == 0) == (period > 0));
        identify_result_done(&r);
    }
    free(y);
}
