/* The identification of a moving window against the batch's on the same samples, and the triangles
 * it rests on against closed forms. */
/* Tests as well: moving_blocks.c moving_columns.c moving_fit.c moving_judge.c moving_report.c
 * window_qr.c */
#include "modal/identify/live/moving.h"
#include <float.h>
#include "check.h"
#include "modal/linalg/window_qr.h"
#include "signals.h"

/* ---- window_qr ---- */

static double noise_at(uint64_t i, int c)
{
    struct random r = { i * 64 + (uint64_t)c };

    return random_normal(&r);
}

/* 10^6 rows through a window of 1,000, six columns of sizes 1 to 1e-10 with a common part: with Y
 * the window's rows in the end and R the factor, Y R^{-1} has orthonormal columns to what one QR of
 * a window's 21 joins leaves.  Gram matrices compared after division by the columns' norms. */
TEST(a_million_rows_leave_the_triangle_of_the_window_as_orthogonal_as_one_factorisation)
{
    enum { N = 6, BLOCK = 50, BLOCKS = 20, ROWS = 1000000 };
    double *y = malloc(sizeof *y * BLOCK * N), R[N * N], worst = 0;
    struct window_qr *q;

    CHECK(window_qr_new(N, &q, NULL) == MODAL_OK);
    for (int b = 0; b < ROWS / BLOCK; b++) {
        struct matrix rows = { BLOCK, N, BLOCK, y };
        for (int l = 0; l < BLOCK; l++)
            for (int c = 0; c < N; c++)
                y[l + c * BLOCK] = pow(10, -2 * c) *
                                   (noise_at((uint64_t)b * BLOCK + (uint64_t)l, c) +
                                    noise_at((uint64_t)b * BLOCK + (uint64_t)l, 40));
        CHECK(window_qr_push(q, &rows, NULL) == MODAL_OK);
        if (b >= BLOCKS)
            CHECK(window_qr_pop(q, NULL) == MODAL_OK);
    }
    CHECK(window_qr_factor(q, NULL, R, NULL) == MODAL_OK);
    for (int i = 0; i < N; i++)
        for (int j = 0; j <= i; j++) {
            long double gram = 0, ours = 0, a = 0, b = 0;
            for (uint64_t l = ROWS - BLOCK * BLOCKS; l < ROWS; l++) {
                long double x = (long double)(pow(10, -2 * i) * (noise_at(l, i) + noise_at(l, 40))),
                            z = (long double)(pow(10, -2 * j) * (noise_at(l, j) + noise_at(l, 40)));
                gram += x * z, a += x * x, b += z * z;
            }
            for (int k = 0; k <= j; k++)
                ours += (long double)R[k + i * N] * (long double)R[k + j * N];
            worst = fmax(worst, (double)(fabsl(gram - ours) / sqrtl(a * b)));
        }
    CHECK_NEAR(worst, 0, 22 * N * DBL_EPSILON);
    window_qr_free(q);
    free(y);
}

TEST(an_empty_queue_has_a_zero_triangle_and_no_columns_are_bad_input)
{
    struct window_qr *q = NULL;
    double R[4] = { 1, 1, 1, 1 };

    CHECK(window_qr_new(0, &q, NULL) == MODAL_BAD_INPUT && q == NULL);
    CHECK(window_qr_new(2, &q, NULL) == MODAL_OK);
    CHECK(window_qr_pop(q, NULL) == MODAL_OK);
    CHECK(window_qr_factor(q, NULL, R, NULL) == MODAL_OK);
    CHECK(R[0] == 0 && R[1] == 0 && R[2] == 0 && R[3] == 0);
    window_qr_free(q);
}

/* ---- moving against batch ---- */

/* A long record, row-major. */
static double *record(const struct decay *d, double snr_db, uint64_t seed)
{
    size_t N = (size_t)d->samples, S = (size_t)d->channels;
    double *y = malloc(sizeof *y * N * S), *x = malloc(sizeof *x * N * S);
    struct random r = { seed };

    decay_signals(d, y, N);
    if (snr_db > 0)
        decay_noise(d, y, N, snr_db, &r);
    for (size_t k = 0; k < N; k++)
        for (size_t c = 0; c < S; c++)
            x[k * S + c] = y[k + c * N];
    free(y);
    return x;
}

static struct decay three(int samples, int channels, uint64_t seed)
{
    struct decay d = { .modes = 3,
                       .channels = channels,
                       .samples = samples,
                       .dt = 0.05,
                       .lambda = { decay_pole(1.0, 2e-4), decay_pole(2.3, 1e-4),
                                   decay_pole(4.1, 1e-4) } };
    struct random r = { seed };

    decay_amplitudes(&d, &r);
    return d;
}

struct tally { int windows, updates, offsets; double worst; };

/* The largest relative difference of two answers, in frequency, damping (over itself, or ten of its
 * standard errors where it is less), amplitude, and standard errors, which are held to a tenth of
 * that; 1 where modes or verdict differ.  ROUNDING is what the batch's own arithmetic leaves of an
 * exponent, over its modulus. */
static double apart(const struct identify_result *a, const struct identify_result *b,
                    double rounding)
{
    double worst = 0;

    if (a->mode_count != b->mode_count || a->verdict != b->verdict ||
        (a->offset != NULL) != (b->offset != NULL) || a->hankel_rank != b->hankel_rank)
        return 1;
    for (int i = 0; i < a->mode_count; i++)
        if (a->modes[i].growth != b->modes[i].growth)
            return 1;
    for (int i = 0; i < a->mode_count; i++) {
        const struct identify_mode *p = &a->modes[i], *q = &b->modes[i];
        double size = cabs(q->exponent);
        worst =
            fmax(worst, fmax(fabs(creal(p->exponent) - creal(q->exponent)) - rounding * size, 0) /
                            hypot(creal(q->exponent), 10 * q->std_re));
        worst =
            fmax(worst, fmax(fabs(cimag(p->exponent) - cimag(q->exponent)) - rounding * size, 0) /
                            cimag(q->exponent));
        worst = fmax(worst, fabs(p->amplitude - q->amplitude) / q->amplitude);
        if (rounding == 0)
            worst = fmax(worst, 0.1 * fmax(fabs(p->std_re - q->std_re) / q->std_re,
                                           fabs(p->std_im - q->std_im) / q->std_im));
    }
    for (int c = 0; rounding == 0 && c < a->channel_count; c++)
        worst = fmax(worst, fabs(a->rms_error[c] - b->rms_error[c]) / b->rms_error[c]);
    for (int c = 0; a->offset != NULL && c < a->channel_count; c++)
        worst =
            fmax(worst, fabs(a->offset[c] - b->offset[c]) / hypot(b->offset[c], b->rms_error[c]));
    return worst;
}

/* Every so many windows are held against a batch of them, or NONE is. */
enum { NONE = 1 << 30 };
static struct tally compare(const double *x, int samples, struct moving_options opt, int chunk,
                            int every, double rounding)
{
    struct tally t = { 0 };
    struct moving *m;

    CHECK(moving_new(&opt, &m, NULL) == MODAL_OK);
    for (int at = 0; at < samples; ) {
        int n = samples - at < chunk ? samples - at : chunk;
        struct batch b = { .channels = (size_t)opt.channels,
                           .samples = (size_t)opt.window,
                           .dt = opt.dt,
                           .period = opt.period };
        struct identify_result ours, batch;
        struct moving_cost cost;

        CHECK(moving_push(m, x + (size_t)at * (size_t)opt.channels, (size_t)n, NULL) == MODAL_OK);
        at += n;
        if (at < opt.window)
            continue;
        CHECK(moving_identify(m, &ours, &cost, NULL) == MODAL_OK);
        t.windows++, t.updates += cost.updated, t.offsets += ours.offset != NULL;
        CHECK(cost.updated == (cost.why == NULL) && cost.updates == (uint64_t)t.updates &&
              cost.batches == (uint64_t)(t.windows - t.updates));
        if (t.windows % every == 0) {
            b.signals = x + (size_t)(at - opt.window) * (size_t)opt.channels;
            CHECK(modal_identify(&b, &opt.identify, &batch, NULL) == MODAL_OK);
            t.worst = fmax(t.worst, apart(&ours, &batch, rounding));
            identify_result_done(&batch);
        }
        identify_result_done(&ours);
    }
    moving_free(m);
    return t;
}

/* Both settle within 1e-10 standard errors of one minimum, or a step of 1e-10 before it; the goal
 * is 1e-9.  Clean records end at rounding: 1e-13 of an exponent's modulus each (test_refine.c).
 * Hops that divide the window, and not; few channels, and proper orthogonal signals of many.  False
 * alarms cost windows found from nothing: 1 in 10 at most. */
TEST(every_window_has_the_modes_that_a_batch_of_it_has)
{
    static const struct { int channels, samples, window, hop; double snr;
    } cases[] = {
        { 3, 3000, 1200, 100, 40 },  { 3, 3000, 600, 50, 20 },   { 1, 2400, 600, 60, 40 },
        { 3, 2400, 600, 100, 0 },    { 8, 2400, 1000, 100, 60 }, { 16, 2000, 800, 100, 30 },
        { 64, 1600, 1000, 200, 40 }, { 2, 2400, 1000, 37, 30 },  { 3, 1600, 1000, 1000, 30 },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct decay d = three(cases[i].samples, cases[i].channels, 5 + i);
        double *x = record(&d, cases[i].snr, 9 + i);
        struct moving_options opt = {
            .channels = d.channels, .window = cases[i].window, .hop = cases[i].hop, .dt = d.dt
        };
        struct tally t = compare(x, d.samples, opt, cases[i].hop, 1, cases[i].snr > 0 ? 0 : 2e-13);
        CHECK_NEAR(t.worst, 0, 1e-9);
        CHECK(t.windows ==
                  1 + (cases[i].samples - cases[i].window + cases[i].hop - 1) / cases[i].hop ||
              cases[i].window % cases[i].hop != 0);
        CHECK(10 * (t.windows - t.updates - 1) <= t.windows);
        free(x);
    }
}

/* A periodic system, 20 samples a period: each mode is its exponential times 1 + cos / 3, with a
 * phase of its own in each channel; the first BEGINS at that sample. */
static double *periodic(int samples, int channels, int begins, uint64_t seed)
{
    static const double hz[] = { 0.35, 1.15, 2.05 };
    double *x = calloc((size_t)(samples * channels), sizeof *x);
    struct random r = { seed };

    for (int c = 0; c < channels; c++)
        for (int j = 0; j < 3; j++) {
            double complex lambda = decay_pole(hz[j], 1e-4);
            double a = 0.4 + 0.6 * random_uniform(&r), phase = 6.283 * random_uniform(&r);
            for (int k = j == 0 ? begins : 0; k < samples; k++) {
                double t = 0.05 * k;
                x[k * channels + c] += a * exp(creal(lambda) * t) * cos(cimag(lambda) * t + phase)
                                     * (1 + cos(2 * M_PI * t + phase) / 3);
            }
        }
    for (int i = 0; i < samples * channels; i++)
        x[i] += 0.007 * random_normal(&r);      /* 40 dB */
    return x;
}

/* An exponent is told but for a multiple of i 2 pi: within five standard errors of its own. */
static bool shows(const struct identify_result *r, double hz)
{
    double complex lambda = decay_pole(hz, 1e-4);

    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        double turns = cimag(m->exponent - lambda) / (2 * M_PI), back = cimag(m->exponent + lambda)
                                                                      / (2 * M_PI);
        double off = 2 * M_PI * fmin(fabs(turns - nearbyint(turns)), fabs(back - nearbyint(back)));
        if (off < 5 * m->std_im && fabs(creal(m->exponent - lambda)) < 5 * m->std_re)
            return true;
    }
    return false;
}

TEST(windows_of_a_periodic_system_are_updated_to_what_a_batch_of_them_says)
{
    static const struct { int channels, window;
    } cases[] = { { 1, 1200 }, { 3, 2400 }, { 8, 600 } };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int samples = cases[i].window + 1200;
        double *x = periodic(samples, cases[i].channels, 0, 61 + i);
        struct moving_options opt = { .channels = cases[i].channels, .window = cases[i].window,
                                      .hop = 100, .dt = 0.05, .period = 1 };
        struct tally t = compare(x, samples, opt, 100, 1, 0);
        CHECK_NEAR(t.worst, 0, 1e-9);
        CHECK(t.windows == 13 && t.updates == 12);
        free(x);
    }
}

/* The windows that it fills in part are left out: the next one begins at two poles of three. */
TEST(a_mode_of_a_periodic_system_that_begins_between_two_windows_is_found)
{
    enum { BEGINS = 800, WINDOW = 600, SAMPLES = 2000 };
    double *x = periodic(SAMPLES, 3, BEGINS, 71);
    struct moving_options opt = { .channels = 3, .window = WINDOW, .dt = 0.05, .period = 1 };
    struct identify_result result;
    struct moving *m;

    CHECK(moving_new(&opt, &m, NULL) == MODAL_OK);
    for (int at = 0; at < SAMPLES; at += 100) {
        int before = at + 100 - WINDOW;
        CHECK(moving_push(m, x + at * 3, 100, NULL) == MODAL_OK);
        if (before < 0 || (before < BEGINS && at + 100 > BEGINS))
            continue;
        CHECK(moving_identify(m, &result, NULL, NULL) == MODAL_OK);
        CHECK(result.mode_count == (before < BEGINS ? 2 : 3));
        CHECK(shows(&result, 1.15) && shows(&result, 2.05));
        CHECK(before < BEGINS || shows(&result, 0.35));
        identify_result_done(&result);
    }
    moving_free(m);
    free(x);
}

/* Noise alone, then a mode; the windows that it fills in part are left out.  Each window of noise
 * was searched from nothing. */
TEST(windows_of_a_periodic_system_in_which_there_is_no_mode_are_updated_until_one_begins)
{
    enum { BEGINS = 1500, WINDOW = 600, SAMPLES = 2600, CHANNELS = 3 };
    double *x = malloc(sizeof *x * SAMPLES * CHANNELS);
    struct random r = { 72 };
    double complex lambda = decay_pole(0.35, 1e-4);
    struct moving_options opt = { .channels = CHANNELS, .window = WINDOW, .dt = 0.05, .period = 1 };
    struct identify_result result;
    struct moving_cost cost;
    struct moving *m;

    for (int i = 0; i < SAMPLES * CHANNELS; i++) {
        double t = 0.05 * (i / CHANNELS - BEGINS);
        x[i] = 0.02 * random_normal(&r)
             + (t < 0 ? 0 : exp(creal(lambda) * t) * cos(cimag(lambda) * t + i % CHANNELS)
                                * (1 + cos(2 * M_PI * t) / 3));
    }
    CHECK(moving_new(&opt, &m, NULL) == MODAL_OK);
    for (int at = 0; at < SAMPLES; at += 100) {
        int before = at + 100 - WINDOW;
        CHECK(moving_push(m, x + at * CHANNELS, 100, NULL) == MODAL_OK);
        if (before < 0 || (before < BEGINS && at + 100 > BEGINS))
            continue;
        CHECK(moving_identify(m, &result, &cost, NULL) == MODAL_OK);
        CHECK(cost.updated || before == 0 || before > BEGINS);
        CHECK(result.mode_count == (before < BEGINS ? 0 : 1));
        CHECK(before < BEGINS || shows(&result, 0.35));
        identify_result_done(&result);
    }
    moving_free(m);
    free(x);
}

/* Windows of 600 samples, 300 left out between one and the next. */
TEST(a_window_behind_a_gap_is_updated_from_the_poles_before_it_and_is_what_a_batch_says)
{
    struct decay d = three(6000, 3, 21);
    double *x = record(&d, 40, 22);
    struct moving_options opt = { .channels = 3, .window = 600, .hop = 900, .dt = d.dt };
    struct moving *m;
    int updates = 0;

    CHECK(moving_new(&opt, &m, NULL) == MODAL_OK);
    for (int at = 0; at + 600 <= d.samples; at += 900) {
        struct batch b = { .channels = 3, .samples = 600, .dt = d.dt, .signals = x + at * 3 };
        struct identify_result ours, batch;
        struct moving_cost cost;
        moving_clear(m);
        CHECK(moving_push(m, b.signals, 600, NULL) == MODAL_OK);
        CHECK(moving_identify(m, &ours, &cost, NULL) == MODAL_OK);
        CHECK(modal_identify(&b, &opt.identify, &batch, NULL) == MODAL_OK);
        CHECK_NEAR(apart(&ours, &batch, 0), 0, 1e-9);
        updates += cost.updated;
        identify_result_done(&ours);
        identify_result_done(&batch);
    }
    CHECK(updates == 6);
    moving_free(m);
    free(x);
}

/* Channels whose noise differs are weighed, and identified twice, by a batch. */
TEST(channels_of_different_noise_are_weighed_as_a_batch_weighs_them)
{
    static const uint64_t seeds[][2] = { { 6, 7 }, { 3, 4 } };

    for (size_t i = 0; i < sizeof seeds / sizeof *seeds; i++) {
        struct decay d = three(1600, 12, seeds[i][0]);
        struct random r = { seeds[i][1] };
        double *x = record(&d, 50, 5);
        struct moving_options opt = { .channels = 12, .window = 800, .hop = 100, .dt = d.dt };
        struct tally t;

        for (int k = 0; k < d.samples; k++)
            for (int c = 0; c < 4; c++)
                x[k * 12 + c] += 0.05 * (c + 1) * random_normal(&r);
        t = compare(x, d.samples, opt, 100, 1, 0);
        CHECK_NEAR(t.worst, 0, 1e-9);
        CHECK(t.updates >= 7);
        free(x);
    }
}

/* A fourth mode begins at sample 1,500 of 3,600: every window agrees with its batch, the change is
 * told by a window found from nothing, and once the fourth mode fills the window updates go on with
 * four. */
TEST(a_mode_that_begins_in_mid_record_is_found_when_a_batch_finds_it)
{
    check_slow();
    struct decay d = three(3600, 3, 11);
    double *x = record(&d, 40, 12), w = 2 * M_PI * 3.1;
    struct moving_options opt = { .channels = 3, .window = 600, .hop = 100, .dt = d.dt };
    struct tally before, all, after;

    for (int k = 1500; k < d.samples; k++)
        for (int c = 0; c < 3; c++)
            x[k * 3 + c] += 0.3 * (c + 1) * exp(-1e-3 * (k - 1500) * d.dt) *
                            cos(w * d.dt * (k - 1500) + c);
    before = compare(x, 1500, opt, 100, NONE, 0);
    all = compare(x, d.samples, opt, 100, 1, 0);
    after = compare(x + 2100 * 3, d.samples - 2100, opt, 100, NONE, 0);
    CHECK_NEAR(all.worst, 0, 1e-9);
    CHECK(before.updates == before.windows - 1);
    CHECK(all.windows - all.updates >= 2 && all.updates >= before.updates);
    CHECK(after.updates == after.windows - 1);
    free(x);
}

/* 10^6 samples, 2,000 updates, none from nothing but the first: what a batch finds in every
 * hundredth window is still what the update finds. */
TEST(a_million_samples_later_an_update_is_still_the_batch)
{
    check_slow();
    struct decay d = { .modes = 2,
                       .channels = 2,
                       .samples = 1000000,
                       .dt = 0.05,
                       .lambda = { decay_pole(1.0, -1e-8), decay_pole(2.3, -1e-8) } };
    struct random r = { 21 };
    double *x;
    struct moving_options opt = { .channels = 2, .window = 1000, .hop = 500, .dt = 0.05 };
    struct tally t;

    decay_amplitudes(&d, &r);
    x = record(&d, 40, 22);
    t = compare(x, d.samples, opt, 500, 100, 0);
    CHECK(t.windows == 1999 && t.updates >= 1950);
    CHECK_NEAR(t.worst, 0, 1e-9);
    free(x);
}

/* One evaluation of refine.c on the window is L (2q + S)^2 multiplications, and a batch takes some
 * tens of them. */
TEST(an_update_costs_less_than_two_evaluations_on_the_window)
{
    struct decay d = three(2400, 3, 31);
    double *x = record(&d, 40, 32);
    struct moving_options opt = { .channels = 3, .window = 1200, .hop = 100, .dt = d.dt };
    struct identify_result result;
    struct moving_cost cost;
    struct moving *m;

    CHECK(moving_new(&opt, &m, NULL) == MODAL_OK);
    CHECK(moving_push(m, x, 1200, NULL) == MODAL_OK);
    CHECK(moving_identify(m, &result, &cost, NULL) == MODAL_OK && !cost.updated &&
          strcmp(cost.why, "first") == 0);
    identify_result_done(&result);
    for (int k = 1200; k < 2400; k += 100) {
        CHECK(moving_push(m, x + k * 3, 100, NULL) == MODAL_OK);
        CHECK(moving_identify(m, &result, &cost, NULL) == MODAL_OK && cost.updated);
        CHECK(cost.work > 0 && cost.work < 2 * 1200 * pow(2 * 6 + 3, 2));
        identify_result_done(&result);
    }
    moving_free(m);
    free(x);
}

TEST(a_window_that_is_not_full_and_one_too_short_are_bad_input_and_options_beyond_an_update_say_so)
{
    struct decay d = three(300, 3, 41);
    double *x = record(&d, 40, 42);
    struct moving_options opt = { .channels = 3, .window = 200, .dt = d.dt },
                          bad = { .channels = 0, .window = 200 },
                          shorter = { .channels = 1, .window = 7 };
    struct identify_result result;
    struct moving_cost cost;
    struct moving *m = NULL;

    CHECK(moving_new(&bad, &m, NULL) == MODAL_BAD_INPUT &&
          moving_new(&shorter, &m, NULL) == MODAL_BAD_INPUT && m == NULL);
    opt.identify.detrend = DETREND_MEAN;
    CHECK(moving_new(&opt, &m, NULL) == MODAL_OK);
    CHECK(moving_push(m, x, 199, NULL) == MODAL_OK && moving_samples(m) == 199);
    CHECK(moving_identify(m, &result, NULL, NULL) == MODAL_BAD_INPUT);
    CHECK(moving_push(m, x + 199 * 3, 101, NULL) == MODAL_OK && moving_samples(m) == 200);
    CHECK(moving_identify(m, &result, &cost, NULL) == MODAL_OK && !cost.updated &&
          strcmp(cost.why, "options") == 0);
    identify_result_done(&result);
    moving_clear(m);
    CHECK(moving_samples(m) == 0 && moving_identify(m, &result, NULL, NULL) == MODAL_BAD_INPUT);
    moving_free(m);
    free(x);
}

/* Samples of a phase that was rounded, w t + phase in double at times far from 0: what is left is a
 * few times the rounding of a window that begins at 0, and all of it lies beside the poles, but a
 * pole as two neighbours fits a million times worse than one. */
TEST(exact_records_late_in_a_stream_are_updated)
{
    enum { N = 1800 };

    for (int channels = 1; channels <= 3; channels++) {
        struct decay d = three(N, channels, 70 + (uint64_t)channels);
        double *x = calloc(N * 3, sizeof *x);
        struct moving_options opt = { .channels = channels, .window = 600, .hop = 100, .dt = d.dt };
        struct tally t;

        for (int k = 0; k < N; k++)
            for (int c = 0; c < channels; c++)
                for (int j = 0; j < d.modes; j++) {
                    double at = k * d.dt, phase = cimag(d.lambda[j]) * at + carg(d.B[j][c]);
                    x[k * channels + c] += cabs(d.B[j][c]) * exp(creal(d.lambda[j]) * at) *
                                           cos(phase);
                }
        t = compare(x, N, opt, 100, 1, 2e-13);
        CHECK_NEAR(t.worst, 0, 1e-9);
        CHECK(t.windows == 13 && t.updates >= 11);
        free(x);
    }
}

static void add_constant(double *x, int samples, int channels, double size, double slope)
{
    for (int k = 0; k < samples; k++)
        for (int c = 0; c < channels; c++)
            x[k * channels + c] += size * (1 + slope * c);
}

/* A constant under the vibration, a hundredth of it and a hundred times it.  Proper orthogonal
 * modes of many channels found twice may differ in sign, and a fit's amplitudes are of the first:
 * the residual must be too, or it is not white. */
TEST(a_window_with_an_offset_is_updated_and_its_offset_is_the_batchs)
{
    check_slow();
    static const struct { int channels, window; double size, slope;
    } cases[] = {
        { 1, 800, 3.7, 0.1 },  { 3, 800, 0.02, 0.1 }, { 3, 800, 170, 0.1 },
        { 16, 800, 3.7, 0.1 }, { 64, 2000, 3.7, 0 },  { 64, 2000, 3.7, 0.1 },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int hop = cases[i].window / 8;
        struct decay d = three(cases[i].window + 12 * hop, cases[i].channels, 51 + i);
        double *x = record(&d, 40, 52 + i);
        struct moving_options opt = {
            .channels = d.channels, .window = cases[i].window, .hop = hop, .dt = d.dt
        };
        struct tally t;

        add_constant(x, d.samples, d.channels, cases[i].size, cases[i].slope);
        t = compare(x, d.samples, opt, hop, 1, 0);
        CHECK_NEAR(t.worst, 0, 1e-9);
        CHECK(t.windows == 13 && t.updates >= 10 && t.offsets == 13);
        free(x);
    }
}

/* A level that drifts away with a time constant of ten windows: whatever a batch calls it, offset,
 * mode or both, the update's answer is the same. */
TEST(a_drifting_level_is_what_a_batch_says_it_is)
{
    struct decay d = three(2400, 2, 61);
    double *x = record(&d, 40, 62);
    struct moving_options opt = { .channels = 2, .window = 600, .hop = 100, .dt = d.dt };
    struct tally t;

    for (int k = 0; k < d.samples; k++)
        for (int c = 0; c < 2; c++)
            x[k * 2 + c] += 3.7 * exp(-fmax(k - 1200, 0) / 6000.0);
    t = compare(x, d.samples, opt, 100, 1, 0);
    CHECK_NEAR(t.worst, 0, 1e-9);
    CHECK(t.offsets >= 7 && t.offsets < t.windows);
    free(x);
}

/* Constants in noise, 200 short windows: the rule that a constant may rather be a decay is where
 * the two could differ. */
TEST(an_offset_in_noise_is_judged_as_a_batch_judges_it)
{
    int windows = 0, updates = 0;
    double worst = 0;

    for (uint64_t seed = 0; seed < 40; seed++) {
        struct decay d = { .modes = 1,
                           .channels = 1,
                           .samples = 400,
                           .dt = 0.05,
                           .lambda = { decay_pole(1.0, 2e-3) } };
        struct random r = { 100 + seed };
        struct moving_options opt = { .channels = 1, .window = 200, .hop = 50, .dt = 0.05 };
        struct tally t;
        double *x;
        decay_amplitudes(&d, &r);
        x = record(&d, 15, 200 + seed);
        add_constant(x, d.samples, 1, 0.3, 0);
        t = compare(x, d.samples, opt, 50, 1, 0);
        windows += t.windows, updates += t.updates, worst = fmax(worst, t.worst);
        free(x);
    }
    CHECK_NEAR(worst, 0, 1e-9);
    CHECK(windows == 200 && updates >= 120);
}

/* Silence and then noise is not white in time: a batch keeps all proper orthogonal signals while it
 * lasts, and so must an update that has so far kept two. */
TEST(a_channel_that_is_silent_and_then_starts_is_reduced_as_a_batch_reduces_it)
{
    enum { S = 20, N = 1240, START = 1000 };
    struct decay d = { .modes = 2,
                       .channels = S,
                       .samples = N,
                       .dt = 0.05,
                       .lambda = { decay_pole(1.0, 2e-4), decay_pole(2.3, 1e-4) } };
    struct random r = { 81 };
    struct moving_options opt = { .channels = S, .window = 800, .hop = 40, .dt = d.dt };
    struct tally t;
    double *x;

    decay_amplitudes(&d, &r);
    x = record(&d, 10, 82);
    for (int k = 0; k < START; k++)
        x[k * S + S - 1] = 0;
    t = compare(x, N, opt, 40, 1, 0);
    CHECK_NEAR(t.worst, 0, 1e-9);
    CHECK(t.windows == 12 && t.updates >= 3);
    free(x);
}

/* A pole that turns half a time in the window: its error is that of its scatter over other orders,
 * which only a batch tries. */
TEST(what_turns_less_than_once_in_the_window_has_the_error_bars_of_a_batch)
{
    struct decay d = { .modes = 2,
                       .channels = 3,
                       .samples = 1000,
                       .dt = 0.05,
                       .lambda = { decay_pole(0.5 / 30, 2e-2), decay_pole(2.3, 1e-4) } };
    struct random r = { 91 };
    struct moving_options opt = { .channels = 3, .window = 600, .hop = 100, .dt = d.dt };
    struct tally t;
    double *x;

    decay_amplitudes(&d, &r);
    x = record(&d, 10, 92);
    t = compare(x, d.samples, opt, 100, 1, 0);
    CHECK_NEAR(t.worst, 0, 1e-9);
    CHECK(t.windows == 5);
    free(x);
}

/* One pole that fades into noise: a batch ends with no modes, or none that it trusts, and no update
 * goes on with one. */
TEST(a_last_mode_that_fades_is_given_up_when_a_batch_gives_it_up)
{
    struct decay d = {
        .modes = 1, .channels = 2, .samples = 3000, .dt = 0.05, .lambda = { decay_pole(1.0, 1e-2) }
    };
    struct random r = { 95 };
    struct moving_options opt = { .channels = 2, .window = 300, .hop = 50, .dt = d.dt };
    struct tally t;
    double *x;

    decay_amplitudes(&d, &r);
    x = record(&d, 0, 0);
    for (int i = 0; i < 2 * d.samples; i++)
        x[i] += 0.02 * random_normal(&r);
    t = compare(x, d.samples, opt, 50, 1, 0);
    CHECK_NEAR(t.worst, 0, 1e-9);
    CHECK(t.windows == 55 && t.updates >= 1);
    free(x);
}

/* A NaN is refused with a batch's words while the window has it, few channels or many, and updates
 * begin again behind it. */
TEST(a_nan_is_refused_as_a_batch_refuses_it_and_what_follows_is_updated)
{
    for (int S = 3; S <= 18; S += 15) {
        struct decay d = three(2000, S, 99);
        struct moving_options opt = { .channels = S, .window = 500, .hop = 100, .dt = d.dt };
        double *x = record(&d, 40, 98);
        struct moving *m;
        int refused = 0, updated = 0;

        x[1034 * S] = NAN;
        CHECK(moving_new(&opt, &m, NULL) == MODAL_OK);
        for (int at = 0; at < d.samples; at += 100) {
            struct batch b = { .channels = (size_t)S,
                               .samples = 500,
                               .dt = d.dt,
                               .signals = x + (size_t)(at - 400) * (size_t)S };
            struct identify_result ours, batch;
            struct modal_error e = { 0 }, f = { 0 };
            struct moving_cost cost;
            CHECK(moving_push(m, x + (size_t)at * (size_t)S, 100, NULL) == MODAL_OK);
            if (at < 400)
                continue;
            if (moving_identify(m, &ours, &cost, &e) == MODAL_OK) {
                updated += at > 1500 && cost.updated;
            } else {
                refused++;
                CHECK(modal_identify(&b, &opt.identify, &batch, &f) == MODAL_BAD_INPUT &&
                      strcmp(e.message, f.message) == 0);
            }
            identify_result_done(&ours);
        }
        CHECK(refused == 5 && updated >= 3);
        moving_free(m);
        free(x);
    }
}

/* Three to five modes that all grow by 0.15 per s, in windows of 6 s, and nothing else: what fits
 * to rounding is no motion set off anew, however many modes it takes. */
TEST(exact_growth_of_many_modes_is_unstable_in_every_window)
{
    enum { L = 240, HOP = 60, WINDOWS = 9 };

    for (int modes = 3; modes <= 5; modes++) {
        struct decay d = { .modes = modes, .channels = 2, .samples = L + (WINDOWS - 1) * HOP,
                           .dt = 6.0 / L };
        struct moving_options opt = { .channels = 2, .window = L, .hop = HOP, .dt = d.dt };
        struct random r = { 7 };
        struct moving *m;
        double *x;

        for (int j = 0; j < modes; j++)
            d.lambda[j] = CMPLX(0.15, 2 * M_PI * (1 + 0.61 * j));
        decay_amplitudes(&d, &r);
        x = record(&d, 0, 0);
        CHECK(moving_new(&opt, &m, NULL) == MODAL_OK);
        for (int i = 0; i < WINDOWS; i++) {
            struct identify_result found;
            int from = i == 0 ? 0 : L + (i - 1) * HOP, count = i == 0 ? L : HOP;

            CHECK(moving_push(m, x + 2 * (size_t)from, (size_t)count, NULL) == MODAL_OK);
            CHECK(moving_identify(m, &found, NULL, NULL) == MODAL_OK);
            CHECK(found.verdict == VERDICT_UNSTABLE);
            identify_result_done(&found);
        }
        moving_free(m);
        free(x);
    }
}

/* Three modes within a beat over the window, none of which grows, in noise of a tenth: two draw
 * them, and now and then one of these grows beyond its errors. */
TEST(growth_that_a_crowd_may_draw_is_what_a_batch_says_of_it_in_every_window)
{
    enum { L = 300, HOP = 15, N = 450, S = 4 };
    static const double turns[] = { 3, 3.15, 3.4 };
    struct moving_options opt = { .channels = S, .window = L, .hop = HOP, .dt = 1 };
    int updates = 0;

    for (uint64_t seed = 911; seed <= 913; seed += 2) {
        struct random r = { seed };
        double *x = calloc((size_t)N * S, sizeof *x);

        for (int c = 0; c < S; c++)
            for (int j = 0; j < 3; j++) {
                double complex b = CMPLX(random_normal(&r), random_normal(&r)),
                               lambda = CMPLX(-0.01, 2 * M_PI * turns[j]) / L;
                for (int k = 0; k < N; k++)
                    x[k * S + c] += creal(b * cexp(lambda * k));
            }
        for (int i = 0; i < N * S; i++)
            x[i] += 0.1 * random_normal(&r);
        struct tally t = compare(x, N, opt, HOP, 1, 0);
        CHECK_NEAR(t.worst, 0, 1e-7);
        updates += t.updates;
        free(x);
    }
    CHECK(updates > 0);
}
