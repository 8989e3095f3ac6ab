/* Forced responses of systems that are known, simulated here mode by mode: x' = rho x + b u. */
/* Tests as well: clipping.c forced_order.c hits.c lines.c screen.c transfer.c transfer_gain.c
 * transfer_model.c transfer_sums.c */
#include "modal/identify/identify.h"
#include <complex.h>
#include <stdlib.h>
#include "check.h"
#include "modal/identify/ask/screen.h"
#include "modal/identify/forced/forced_order.h"
#include "modal/linalg/matrix.h"
#include "signals.h"

enum { SAMPLES = 2000, INPUTS = 2, RESPONSES = 3, CHANNELS = INPUTS + RESPONSES, MODES = 3 };

static const double dt = 0.01, hertz[MODES] = { 7.0, 7.2, 21.0 },
                    zeta[MODES] = { 0.01, 0.02, 0.005 };
static const int inputs[INPUTS] = { 0, 1 }, responses[RESPONSES] = { 2, 3, 4 };
static double x[SAMPLES * CHANNELS];

static double complex exponent(int p)
{
    return decay_pole(hertz[p], zeta[p]);
}

/* Two inputs that are white, the first HITS where they are some, direct terms, a state from before;
 * noise of rms NOISE on responses. */
static struct batch simulated_by(const double *hits, uint64_t seed, double noise)
{
    struct random r = { seed };
    double complex shape[RESPONSES][MODES], part[INPUTS][MODES], state[MODES];
    double direct[RESPONSES][INPUTS];

    for (int p = 0; p < MODES; p++) {
        for (int i = 0; i < RESPONSES; i++)
            shape[i][p] = CMPLX(random_normal(&r), random_normal(&r));
        for (int j = 0; j < INPUTS; j++)
            part[j][p] = CMPLX(random_normal(&r), random_normal(&r)) / 10;
        state[p] = CMPLX(random_normal(&r), random_normal(&r));
    }
    for (int i = 0; i < RESPONSES; i++)
        for (int j = 0; j < INPUTS; j++)
            direct[i][j] = random_normal(&r);
    for (int k = 0; k < SAMPLES; k++) {
        double *row = x + CHANNELS * k;
        for (int j = 0; j < INPUTS; j++)
            row[j] = hits != NULL && j == 0 ? hits[k] : 3 + random_normal(&r);
        for (int i = 0; i < RESPONSES; i++) {
            row[INPUTS + i] = noise * random_normal(&r) - 5;
            for (int p = 0; p < MODES; p++)
                row[INPUTS + i] += creal(shape[i][p] * state[p]);
            for (int j = 0; j < INPUTS; j++)
                row[INPUTS + i] += direct[i][j] * row[j];
        }
        for (int p = 0; p < MODES; p++) {
            state[p] *= cexp(exponent(p) * dt);
            for (int j = 0; j < INPUTS; j++)
                state[p] += part[j][p] * row[j];
        }
    }
    return (struct batch) { .samples = SAMPLES, .channels = CHANNELS, .signals = x, .dt = dt };
}

static struct batch simulated(uint64_t seed, double noise)
{
    return simulated_by(NULL, seed, noise);
}

static struct identify_options forced(void)
{
    return (struct identify_options) { .response = RESPONSE_FORCED, .inputs = inputs,
                                       .input_count = INPUTS };
}

static const struct identify_mode *mode_of(const struct identify_result *r, int p)
{
    const struct identify_mode *best = &r->modes[0];

    for (int i = 1; i < r->mode_count; i++)
        if (cabs(r->modes[i].exponent - exponent(p)) < cabs(best->exponent - exponent(p)))
            best = &r->modes[i];
    return best;
}

static bool has(const struct identify_result *r, const char *code)
{
    for (int i = 0; i < r->diagnostic_count; i++)
        if (strcmp(r->diagnostics[i].code, code) == 0)
            return true;
    return false;
}

TEST(without_noise_exponents_are_exact_whatever_the_initial_state_and_the_mean)
{
    struct batch b = simulated(1, 0);
    struct identify_options opt = forced();
    struct identify_result r;

    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == MODES && r.verdict == VERDICT_STABLE && r.total_relative_error < 1e-10);
    for (int p = 0; p < MODES; p++)
        CHECK(cabs(mode_of(&r, p)->exponent - exponent(p)) < 1e-9 * cabs(exponent(p)));
    identify_result_done(&r);
}

/* 40 records of 3 modes: the mean of 240 squares of unit variance has a standard deviation of
 * 0.09, and the share within 1.96 of 0.014. */
TEST(errors_over_their_standard_deviations_are_of_unit_size)
{
    double sum = 0;
    int within = 0, all = 0;

    for (uint64_t seed = 100; seed < 140; seed++) {
        struct batch b = simulated(seed, 0.5);
        struct identify_options opt = forced();
        struct identify_result r;
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == MODES);
        for (int p = 0; p < MODES; p++) {
            const struct identify_mode *m = mode_of(&r, p);
            double complex e = m->exponent - exponent(p);
            double re = creal(e) / m->std_re, im = cimag(e) / m->std_im;
            sum += re * re + im * im;
            within += (fabs(re) < 1.96) + (fabs(im) < 1.96), all += 2;
        }
        identify_result_done(&r);
    }
    CHECK_NEAR(sum / all, 1, 0.3);
    CHECK_NEAR((double)within / all, 0.95, 0.045);
}

/* White noise is the worst that can be taken for modes: in 100 records none. */
TEST(responses_that_no_input_moves_have_no_mode_and_no_verdict)
{
    for (uint64_t seed = 0; seed < 100; seed++) {
        struct random random = { 1000 + seed };
        struct identify_options opt = forced();
        struct identify_result r;
        struct batch b = { .samples = 400, .channels = CHANNELS, .signals = x, .dt = dt };
        for (int k = 0; k < 400 * CHANNELS; k++)
            x[k] = random_normal(&random);
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == 0 && r.verdict == VERDICT_UNDECIDED && has(&r, "no_modes"));
        identify_result_done(&r);
    }
}

TEST(a_line_that_no_input_moves_is_told_and_takes_no_verdict_by_storm)
{
    struct batch b = simulated(3, 0.1);
    struct identify_options opt = forced();
    struct identify_result r;

    for (int k = 0; k < SAMPLES; k++)
        for (int i = INPUTS; i < CHANNELS; i++)
            x[CHANNELS * k + i] += sin(2 * M_PI * 50.0 / 3 * k * dt + i);
    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    CHECK(has(&r, "narrow_line") && r.verdict != VERDICT_UNSTABLE);
    for (int p = 0; p < MODES; p++)
        CHECK(cabs(mode_of(&r, p)->exponent - exponent(p)) < 0.01 * cabs(exponent(p)));
    identify_result_done(&r);
}

/* The noise of responses is that of a filter, strongest where the modes are: errors grow with it,
 * and so must what is said of them. */
TEST(noise_that_is_stronger_about_a_mode_widens_its_errors)
{
    double complex state[RESPONSES] = { 0 };
    struct random random = { 77 };
    struct batch b = simulated(4, 0.1);
    struct identify_options opt = forced();
    struct identify_result r;

    for (int k = 0; k < SAMPLES; k++)
        for (int i = 0; i < RESPONSES; i++) {
            state[i] = state[i] * cexp(decay_pole(21, 0.3) * dt) + random_normal(&random);
            x[CHANNELS * k + INPUTS + i] += creal(state[i]);
        }
    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    CHECK(has(&r, "coloured_residual"));
    for (int p = 0; p < MODES; p++) {
        const struct identify_mode *m = mode_of(&r, p);
        double complex e = m->exponent - exponent(p);
        CHECK(fabs(creal(e)) < 4 * m->std_re && fabs(cimag(e)) < 4 * m->std_im);
    }
    identify_result_done(&r);
}

/* Correlated by 0.9^j over j samples: 19 times its mean at the lowest lines, a twentieth at the
 * highest, and nothing that any input moves. */
TEST(noise_of_a_spectrum_that_falls_is_not_taken_for_modes)
{
    for (uint64_t seed = 200; seed < 206; seed++) {
        double state[RESPONSES] = { 0 };
        struct random random = { seed };
        struct batch b = simulated(seed, 0);
        struct identify_options opt = forced();
        struct identify_result r;
        for (int k = 0; k < SAMPLES; k++)
            for (int i = 0; i < RESPONSES; i++) {
                state[i] = 0.9 * state[i] + 0.2 * random_normal(&random);
                x[CHANNELS * k + INPUTS + i] += state[i];
            }
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.mode_count == MODES && r.verdict == VERDICT_STABLE);
        for (int p = 0; p < MODES; p++) {
            const struct identify_mode *m = mode_of(&r, p);
            double complex e = m->exponent - exponent(p);
            CHECK(fabs(creal(e)) < 4 * m->std_re && fabs(cimag(e)) < 4 * m->std_im);
        }
        identify_result_done(&r);
    }
}

/* 1e7 multiplications are two poles', 1e9 more than are needed. */
TEST(a_search_whose_work_is_spent_has_the_best_so_far_and_says_so)
{
    struct matrix u = matrix_new(SAMPLES, INPUTS), y = matrix_new(SAMPLES, RESPONSES);
    struct lines l;

    simulated(5, 0.5);
    for (int k = 0; k < SAMPLES; k++) {
        for (int j = 0; j < INPUTS; j++)
            u.x[k + SAMPLES * j] = x[CHANNELS * k + j];
        for (int i = 0; i < RESPONSES; i++)
            y.x[k + SAMPLES * i] = x[CHANNELS * k + INPUTS + i];
    }
    CHECK(lines_make(&y, &u, &(struct lines_records) { (const int[]) { 0 }, 1 },
                     (const double[2]) { 0, 0 }, &l, NULL) == MODAL_OK);
    for (double work = 1e7; work <= 1e9; work *= 100) {
        struct forced_limits limits = { .most = TRANSFER_POLES_MOST, .work = work };
        struct forced_search found = { 0 };
        CHECK(forced_search(&l, &limits, &found, NULL) == MODAL_OK);
        CHECK(found.limit == (work < 1e9));
        CHECK(work < 1e9 ? found.model.poles < MODES : found.model.poles == MODES);
        CHECK(found.model.poles > 0 && isfinite(found.model.likelihood));
        forced_search_done(&found);
    }
    lines_done(&l);
    free(u.x), free(y.x);
}

static void shape(const void *of, int column, int first, int rows, double complex *U)
{
    const struct lines *l = of;

    memcpy(U, l->W + first + (size_t)column * l->count, sizeof *U * (size_t)rows);
}

/* From one in five samples of the first input 0.1 was left out, from others nothing: of the account
 * without it, what it would take off, and by how much.  Against a fit with it. */
TEST(what_an_input_lacks_is_foretold_by_the_account_without_it)
{
    const double lacks = 0.1;
    struct matrix u = matrix_new(SAMPLES, INPUTS), y = matrix_new(SAMPLES, RESPONSES),
                  s = matrix_new(SAMPLES, 2);
    struct lines l, whole, shapes;
    struct forced_limits limits = { .most = MODES };
    struct forced_search without = { 0 }, with = { 0 };
    struct random r = { 11 };
    double M[9], own[4], det, gain;

    simulated(5, 0.5);
    for (int k = 0; k < SAMPLES; k++) {
        for (int i = 0; i < RESPONSES; i++)
            y.x[k + SAMPLES * i] = x[CHANNELS * k + INPUTS + i];
        for (int j = 0; j < INPUTS; j++)
            u.x[k + SAMPLES * j] = x[CHANNELS * k + j];
        int fifth = (int)(5 * random_uniform(&r));
        s.x[k] = fifth == 0, s.x[k + SAMPLES] = fifth == 2;
    }
    const struct lines_records records = { (const int[]) { 0 }, 1 };
    const double band[2] = { 0, 0 };
    CHECK(lines_make(&y, &u, &records, band, &whole, NULL) == MODAL_OK);
    for (int k = 0; k < SAMPLES; k++)
        u.x[k] -= lacks * s.x[k];
    CHECK(lines_make(&y, &u, &records, band, &l, NULL) == MODAL_OK);
    CHECK(lines_make(&y, &s, &records, band, &shapes, NULL) == MODAL_OK);
    for (int k = 0; k < 2 * shapes.count; k++)
        shapes.W[k] *= shapes.size[k / shapes.count];
    CHECK(forced_search(&l, &limits, &without, NULL) == MODAL_OK);
    CHECK(forced_search(&whole, &limits, &with, NULL) == MODAL_OK);
    CHECK(without.model.poles == MODES && with.model.poles == MODES);
    CHECK(transfer_gain(&l, &without.model, &(struct transfer_more) { 2, (const int[]) { 0, 0 },
                                                                      shape, &shapes }, M, own,
                        NULL) == MODAL_OK);
    /* each column's share of the products over lines is charged, of each response */
    CHECK(transfer_gain_work(&l, MODES, 64) - transfer_gain_work(&l, MODES, 0)
          > 64. * RESPONSES * l.count * 2 * (64 + 2 * MODES));
    /* row 0 is the score, the rest the information */
    det = M[4] * M[8] - M[5] * M[7];
    CHECK(fabs((M[3] * M[8] - M[6] * M[5]) / det - lacks) < 4 * sqrt(M[8] / det));
    CHECK(fabs((M[6] * M[4] - M[3] * M[7]) / det) < 4 * sqrt(M[4] / det));
    /* noise is white, and some thirty lines at the modes are nearly all: three deviations */
    CHECK_NEAR(own[0] / M[4], 1, 0.55);
    CHECK_NEAR(own[3] / M[8], 1, 0.55);
    CHECK_NEAR((own[1] - M[5]) / sqrt(M[4] * M[8]), 0, 0.55);
    gain = with.model.likelihood - without.model.likelihood;
    CHECK_NEAR(lacks * M[3] - lacks * lacks * M[4] / 2, gain, 0.05 * gain);
    forced_search_done(&without), forced_search_done(&with);
    lines_done(&l), lines_done(&whole), lines_done(&shapes);
    free(u.x), free(y.x), free(s.x);
}

/* 16 records of 64 samples, each a decay from a state of its own: 36 unknowns, to which noise gives
 * chi-squared of more than 100 in one of 1e7 looks, and the mode here 36 + 182 +- 28.  Were each
 * state told by all 1022 numbers, the price would be 263, by ln of them for each part of it. */
TEST(a_state_that_one_record_tells_is_not_priced_as_if_all_records_told_it)
{
    enum { RECORDS = 16, EACH = 64 };
    const int input = 0;
    double starts[RECORDS - 1], clean[RECORDS * EACH], size = 0;
    struct random r = { 3 };
    struct batch b = { .samples = RECORDS * EACH, .channels = 2, .signals = x, .dt = dt };
    struct identify_options opt = { .response = RESPONSE_FORCED, .inputs = &input, .input_count = 1,
                                    .starts = starts, .start_count = RECORDS - 1 };
    struct identify_result result;

    for (int e = 0; e < RECORDS; e++) {
        double complex state = CMPLX(random_normal(&r), random_normal(&r));
        if (e > 0)
            starts[e - 1] = e * EACH * dt;
        for (int k = 0; k < EACH; k++, state *= cexp(exponent(2) * dt)) {
            clean[k + EACH * e] = creal(state);
            /* the first two samples are any by the ends' columns of lines.h */
            size += k > 1 ? creal(state) * creal(state) : 0;
        }
    }
    for (int k = 0; k < RECORDS * EACH; k++) {
        x[2 * k] = random_normal(&r);
        x[2 * k + 1] = clean[k] * sqrt(182 / size) + random_normal(&r);
    }
    CHECK(modal_identify(&b, &opt, &result, NULL) == MODAL_OK);
    CHECK(result.mode_count == 1);
    CHECK(result.mode_count == 0 || cabs(result.modes[0].exponent - exponent(2)) < 4);
    identify_result_done(&result);
}

/* Of three modes two: what the third leaves bends them by more than any noise. */
TEST(modes_that_others_were_left_out_beside_have_no_errors_and_no_verdict)
{
    struct batch b = simulated(5, 0.5);
    struct identify_options opt = forced();
    struct identify_result r;

    opt.rank.most = 4;
    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    CHECK(has(&r, "order_work_limit") && has(&r, "coloured_residual"));
    CHECK(r.mode_count == 2 && r.verdict == VERDICT_UNDECIDED);
    for (int p = 0; p < r.mode_count; p++)
        CHECK(isnan(r.modes[p].std_re) && isnan(r.modes[p].std_im));
    identify_result_done(&r);
}

/* One sample each; at the second turn every other one was 2 % harder than it says, as a force is
 * whose peak lies between samples. */
TEST(hits_that_samples_do_not_tell_take_errors_and_verdict_and_those_that_they_tell_do_not)
{
    static double hits[SAMPLES];
    struct identify_options opt = forced();

    for (int i = 0; i < 6; i++)
        hits[100 + 300 * i] = 40 + 10 * i;
    for (int harder = 0; harder < 2; harder++) {
        struct batch b = simulated_by(hits, 9, 0.05);
        struct identify_result r;
        bool told = false;
        for (int i = 0; i < 6; i += 2)
            x[CHANNELS * (100 + 300 * i)] /= 1 + 0.02 * harder;
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK && r.mode_count >= MODES);
        for (int i = 0; i < r.diagnostic_count; i++)
            told |= strcmp(r.diagnostics[i].code, "coloured_residual") == 0
                && r.diagnostics[i].channel == 0;
        CHECK(told == harder && (r.verdict == VERDICT_UNDECIDED) == harder);
        for (int p = 0; p < r.mode_count; p++)
            CHECK(isnan(r.modes[p].std_re) == harder);
        identify_result_done(&r);
    }
}

/* Longer than what of a free response is cut to what follows its strike, here the last of four. */
TEST(a_long_record_of_hits_or_under_noise_is_taken_whole)
{
    enum { LONG = 40000 };
    double *signals = calloc(2 * LONG, sizeof *signals);
    struct batch b = { .samples = LONG, .channels = 2, .signals = signals, .dt = dt };
    struct identify_options hit = { .response = RESPONSE_FORCED, .inputs = inputs,
                                    .input_count = 1, .rank.most = 2 };
    struct identify_options noise = { .response = RESPONSE_AMBIENT, .channels = &(int) { 1 },
                                      .channel_count = 1, .rank.most = 2 };
    struct identify_result r;
    struct random random = { 12 };
    double complex state = 0;

    for (int k = 0; k < LONG; k++) {
        double u = k % 9000 == 500 && k < 30000 ? 10 + 1e-4 * k : 0;
        signals[2 * k] = u;
        signals[2 * k + 1] = creal(state) + 0.01 * random_normal(&random);
        state = state * cexp(exponent(1) * dt) + u;
    }
    CHECK(modal_identify(&b, &hit, &r, NULL) == MODAL_OK && r.samples == LONG);
    CHECK(r.mode_count == 1 && cabs(r.modes[0].exponent - exponent(1)) < 5 * r.modes[0].std_im);
    identify_result_done(&r);
    CHECK(modal_identify(&b, &noise, &r, NULL) == MODAL_OK && r.samples == LONG);
    identify_result_done(&r);
    free(signals);
}

/* The second input, which is white, unmeasured: it moves the modes that the hits do. */
TEST(hits_beside_an_excitation_that_was_not_measured_are_not_blamed)
{
    static double hits[SAMPLES];

    for (int i = 0; i < 6; i++)
        hits[100 + 300 * i] = 1000 + 200 * i;
    for (uint64_t seed = 20; seed < 23; seed++) {
        struct batch b = simulated_by(hits, seed, 0.05);
        struct identify_options opt = forced();
        struct identify_result r;
        opt.input_count = 1;
        opt.channels = responses, opt.channel_count = RESPONSES;
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK && r.mode_count >= MODES);
        CHECK(has(&r, "coloured_residual"));
        for (int i = 0; i < r.diagnostic_count; i++)
            CHECK(strcmp(r.diagnostics[i].code, "coloured_residual") != 0
                  || r.diagnostics[i].channel != 0);
        identify_result_done(&r);
    }
}

/* The first of two inputs, which are white of variance 1 about 3, at two standard deviations. */
TEST(the_input_that_was_cut_off_is_named_and_takes_errors_and_verdict)
{
    struct batch b = simulated(6, 0.5);
    struct identify_options opt = forced();
    struct identify_result r;
    int told = 0;

    for (int k = 0; k < SAMPLES; k++)
        x[CHANNELS * k] = fmin(fmax(x[CHANNELS * k], 1), 5);
    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    for (int i = 0; i < r.diagnostic_count; i++)
        if (strcmp(r.diagnostics[i].code, "clipped") == 0) {
            told++;
            CHECK(r.diagnostics[i].channel == 0);
        }
    CHECK(told == 1 && r.verdict == VERDICT_UNDECIDED);
    for (int p = 0; p < r.mode_count; p++)
        CHECK(isnan(r.modes[p].std_re) && isnan(r.modes[p].std_im));
    identify_result_done(&r);
}

/* Cut off at 0.8 standard deviations from its mean by a converter of steps of 0.001, or of none;
 * whole on the same grid. */
TEST(the_response_that_was_cut_off_is_named_and_a_whole_one_on_a_grid_is_not)
{
    const double steps[] = { 0.001, 0 };

    for (int cut = 0; cut < 2; cut++)
        for (int i = 0; i < 2; i++) {
            struct batch b = simulated(6, 0.5);
            struct identify_options opt = forced();
            struct identify_result r;
            double mean = 0, square = 0;
            for (int k = 0; k < SAMPLES; k++)
                mean += x[CHANNELS * k + 3] / SAMPLES;
            for (int k = 0; k < SAMPLES; k++)
                square += pow(x[CHANNELS * k + 3] - mean, 2) / SAMPLES;
            for (int k = 0; k < SAMPLES; k++) {
                double *y = x + CHANNELS * k + 3, most = cut ? 0.8 * sqrt(square) : HUGE_VAL;
                *y = fmin(fmax(*y, mean - most), mean + most);
                *y = steps[i] > 0 ? nearbyint(*y / steps[i]) * steps[i] : *y;
            }
            CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
            CHECK(has(&r, "clipped") == (cut == 1));
            for (int d = 0; d < r.diagnostic_count && cut == 1; d++)
                CHECK(strcmp(r.diagnostics[d].code, "clipped") != 0
                      || r.diagnostics[d].channel == 3);
            CHECK((r.verdict == VERDICT_UNDECIDED) == (cut == 1));
            CHECK(r.mode_count > 0 && isnan(r.modes[0].std_re) == (cut == 1));
            identify_result_done(&r);
        }
}

static bool is_cut_off(double *y, int samples)
{
    struct batch b = { .samples = (size_t)samples, .channels = 1, .signals = y, .dt = dt };
    struct identify_result r = { .channel = calloc(1, sizeof *r.channel), .channel_count = 1 };
    bool cut = screen_rails(&b, 0, b.samples, &r);

    CHECK(cut == has(&r, "clipped"));
    identify_result_done(&r);
    return cut;
}

/* Where periods repeat, noise of less than a step gives a peak the same value nearly each time. */
TEST(sines_of_whole_samples_a_turn_are_whole_on_any_grid_and_one_cut_off_at_0_8_is_told)
{
    struct random r = { 8 };

    for (int turn = 20; turn <= 200; turn += 36)
        for (double steps = 3; steps < 5000; steps *= 4)
            for (double noise = 0; noise < 1; noise = 2 * noise + 0.05) {
                for (int k = 0; k < SAMPLES; k++)
                    x[k] = nearbyint(steps * sin(2 * M_PI * k / turn) + noise * random_normal(&r));
                CHECK(!is_cut_off(x, SAMPLES));
            }
    for (int k = 0; k < SAMPLES; k++)
        x[k] = nearbyint(1000 * fmin(fmax(sin(0.2 * k), -0.8), 0.8));
    CHECK(is_cut_off(x, SAMPLES));
}

/* A contact force, one about its mean, two levels, three, a sensor slower than its converter, and a
 * hit that dies away. */
TEST(what_truly_holds_an_extreme_is_not_cut_off)
{
    for (int kind = 0; kind < 6; kind++) {
        for (int k = 0; k < SAMPLES; k++) {
            double y = sin(0.1 * k) + 0.3 * sin(0.237 * k);
            x[k] = kind == 0 ? fmax(0, y)
                 : kind == 1 ? fmax(0, y) - 0.37
                 : kind == 2 ? (y > 0) - (y < 0)
                 : kind == 3 ? nearbyint(1.2 * y)
                 : kind == 4 ? nearbyint(50 * sin(0.1 * (k / 4 * 4)))
                             : nearbyint(1000 * exp(-0.01 * k) * sin(0.3 * k));
        }
        CHECK(!is_cut_off(x, SAMPLES));
    }
}

static void refused(const struct batch *b, struct identify_options opt, const char *field,
                    const char *words)
{
    struct identify_result r;
    struct modal_error err;

    CHECK(modal_identify(b, &opt, &r, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, field);
    CHECK(strstr(err.message, words) != NULL);
}

TEST(inputs_that_tell_nothing_are_refused_by_name)
{
    struct batch b = simulated(5, 0.1);
    struct identify_options opt = forced(), none = opt, ruled = opt, periodic = opt;

    for (int k = 0; k < SAMPLES; k++)
        x[CHANNELS * k + 1] = 2 * x[CHANNELS * k] - 7;
    refused(&b, opt, "inputs", "channel 1 is a sum of the inputs");
    for (int k = 0; k < SAMPLES; k++)
        x[CHANNELS * k + 1] = 0.1;
    refused(&b, opt, "inputs", "channel 1 is constant");
    none.inputs = NULL, none.input_count = 0;
    refused(&b, none, "inputs", "needs the channels");
    ruled.method = IDENTIFY_AUTOREGRESSIVE;
    refused(&b, ruled, "method", "says nothing of response=forced");
    periodic.period = 0.5;
    refused(&b, periodic, "period", "constant systems only");
}
