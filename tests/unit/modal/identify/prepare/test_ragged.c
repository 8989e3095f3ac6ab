/* test_ragged.c - spectra of responses that noise drives, and of free ones of any kind */
#include "check.h"
#include "signals.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/identify/identify.h"
#include "modal/identify/prepare/ragged.h"

enum { ROWS_MOST = 20000, WIDTH = 3 };

static double *room(void)
{
    return calloc((size_t)ROWS_MOST * WIDTH, sizeof(double));
}

/* Modes that noise drives, at rest before the record; each of unit size about. */
static void drive(struct random *r, int rows, int modes, const double *turns, double zeta,
                  double noise, double *y)
{
    memset(y, 0, sizeof *y * (size_t)rows * WIDTH);
    for (int j = 0; j < modes; j++) {
        double w = 2 * M_PI * turns[j], shape[WIDTH];
        double complex z = 0, turn = cexp(w * (-zeta + I * sqrt(1 - zeta * zeta)));
        for (int c = 0; c < WIDTH; c++)
            shape[c] = random_normal(r);
        for (int k = -1000; k < rows; k++) {
            z = turn * z + sqrt(2 * zeta * w) * random_normal(r);
            for (int c = 0; c < WIDTH && k >= 0; c++)
                y[k + (size_t)c * rows] += shape[c] * creal(z);
        }
    }
    for (int k = 0; k < rows * WIDTH; k++)
        y[k] += noise * random_normal(r);
}

/* Driven, or of poles without end. */
static bool ragged(double *y, int rows, int signals, bool driven)
{
    struct matrix Y = { .x = y, .m = rows, .n = signals, .ld = rows };
    struct modal_error err;
    struct ragged is;

    CHECK(ragged_spectrum(&Y, &is, &err) == MODAL_OK);
    CHECK(is.endless || !is.driven);
    return driven ? is.driven : is.endless;
}

TEST(a_response_that_noise_drives_is_told_by_its_spectrum)
{
    const double turns[] = { 0.024, 0.05, 0.074 }, zetas[] = { 0.003, 0.01, 0.05 };
    const int rows[] = { 8000, 15013, ROWS_MOST };
    struct random r = { 71 };
    double *y = room();

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int signals = 1; signals <= WIDTH; signals += 2) {
                drive(&r, rows[i], 3, turns, zetas[j], 0.05, y);
                CHECK(ragged(y, rows[i], signals, true));
            }
    free(y);
}

enum kind { DECAYS, UNDAMPED, GROWS, PERIODIC, OVERLAPPING, CROWD, KINDS };

/* Exponent J of MODES in ROWS; turns are of a sample. */
static double complex exponent(struct random *r, enum kind kind, int rows, int j, int modes)
{
    double turn = 0.01 + 0.48 * random_uniform(r), zeta = pow(10, -6 + 3 * random_uniform(r));

    switch (kind) {
    case UNDAMPED: zeta = 0; break;
    case GROWS: zeta *= -1e-2; break;
    case PERIODIC: turn = 0.45 * (j + 1) / modes, zeta = 0; break;
    case OVERLAPPING: zeta = 0.002 + 0.018 * random_uniform(r); break;
    case CROWD: turn = 0.05 + 8 * (j + random_uniform(r)) / rows; break;
    default: break;
    }
    return 2 * M_PI * turn * CMPLX(-zeta, sqrt(1 - zeta * zeta));
}

static void release(struct random *r, enum kind kind, int rows, int modes, double db, double *y)
{
    double all = 0, sd;

    memset(y, 0, sizeof *y * (size_t)rows * WIDTH);
    for (int j = 0; j < modes; j++) {
        double complex lambda = exponent(r, kind, rows, j, modes), turn = cexp(lambda);
        double size = pow(10, -2 * random_uniform(r)) * fmin(1, exp(-creal(lambda) * rows));
        for (int c = 0; c < WIDTH; c++) {
            double complex z = size * CMPLX(random_normal(r), random_normal(r));
            for (int k = 0; k < rows; k++, z *= turn)
                y[k + (size_t)c * rows] += creal(z);
        }
    }
    for (int k = 0; k < rows * WIDTH; k++)
        all += y[k] * y[k];
    sd = sqrt(all / (rows * WIDTH)) * pow(10, -db / 20);
    for (int k = 0; k < rows * WIDTH; k++)
        y[k] += sd * random_normal(r);
}

/* One mode is no wider than two lines. */
TEST(a_short_response_of_narrow_and_broad_modes_that_noise_drives_is_told)
{
    const double turns[] = { 0.024, 0.15, 0.33 };
    double *y = room();
    int told = 0;

    for (int i = 0; i < 12; i++) {
        struct random r = { 90 + (uint64_t)i };
        drive(&r, 4000, 3, turns, 0.01, 0.05, y);
        told += ragged(y, 4000, WIDTH, true);
    }
    CHECK(told >= 10);
    free(y);
}

/* Of few places each needs more poles than of many. */
TEST(of_1500_rows_that_noise_drives_most_are_told)
{
    const double turns[] = { 0.015, 0.035, 0.1 };
    double *y = room();
    int told = 0;

    for (int i = 0; i < 12; i++) {
        struct random r = { 110 + (uint64_t)i };
        drive(&r, 1500, 3, turns, 0.01, 0.05, y);
        told += ragged(y, 1500, WIDTH, true);
    }
    CHECK(told >= 8);
    free(y);
}

/* A decay, and beside it a weak one that noise drives: not driven, but nothing to draw by poles. */
TEST(a_decay_beside_a_weak_motion_that_noise_drives_is_free_and_has_poles_without_end)
{
    const double turns[] = { 0.1, 0.2, 0.3 };
    double *y = room();

    for (int i = 0; i < 4; i++) {
        struct random r = { 130 + (uint64_t)i };
        drive(&r, 8000, 3, turns, 0.01, 0.02, y);
        for (int c = 0; c < WIDTH; c++)
            for (int k = 0; k < 8000; k++)
                y[k + c * 8000] += 10 * (c + 1) * exp(-k / 2000.0) * cos(0.3 * k + c);
        CHECK(ragged(y, 8000, WIDTH, false));
        CHECK(!ragged(y, 8000, WIDTH, true));
    }
    free(y);
}

/* 1 to 200 modes, 10 dB to none. */
TEST(no_free_response_is_taken_for_one_that_noise_drives)
{
    const int rows[] = { 1500, 4000, 7993 }, modes[] = { 1, 3, 12, 40, 100, 200 };
    const double db[] = { 10, 40, 80, 320 };
    struct random r = { 72 };
    double *y = room();

    for (int kind = 0; kind < KINDS; kind++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 6 && 7 * modes[j] < rows[i]; j++) {
                release(&r, kind, rows[i], modes[j], db[(kind + i + j) % 4], y);
                CHECK(!ragged(y, rows[i], 1, false) && !ragged(y, rows[i], WIDTH, false));
            }
    free(y);
}

TEST(white_noise_silence_and_few_samples_are_no_driven_response)
{
    struct random r = { 73 };
    double *y = room();

    CHECK(!ragged(y, 4000, WIDTH, false) && !ragged(y, 1, 1, false));
    CHECK(!ragged(y, 100, WIDTH, false));
    for (int k = 0; k < ROWS_MOST * WIDTH; k++)
        y[k] = random_normal(&r);
    CHECK(!ragged(y, ROWS_MOST, WIDTH, false) && !ragged(y, 100, WIDTH, false));
    CHECK(!ragged(y, 2, 1, false));
    free(y);
}

/* A channel that is dead, or hears nothing but noise, changes nothing. */
TEST(a_dead_channel_does_not_hide_a_driven_response)
{
    const double turns[] = { 0.024, 0.05, 0.074 };
    struct random r = { 74 };
    double *y = room();

    drive(&r, 12000, 3, turns, 0.01, 0.05, y);
    memset(y, 0, 12000 * sizeof *y);
    CHECK(ragged(y, 12000, WIDTH, true));
    for (int k = 0; k < 12000; k++)
        y[k] = random_normal(&r);
    CHECK(ragged(y, 12000, WIDTH, true));
    free(y);
}

/* So long that no pole pays for itself: it is said what it is all the same. */
TEST(a_long_record_that_noise_drives_is_no_free_decay)
{
    const double turns[] = { 0.0038, 0.0099, 0.0655 };
    enum { ROWS = 150000 };
    struct random r = { 75 };
    double *y = calloc((size_t)ROWS * WIDTH, sizeof *y), *x = calloc((size_t)ROWS * WIDTH, 8);
    struct batch b = { .samples = ROWS, .channels = WIDTH, .signals = x, .dt = 1 };
    struct identify_result result;
    bool said = false;

    drive(&r, ROWS, 3, turns, 0.01, 0.05, y);
    for (int k = 0; k < ROWS * WIDTH; k++)
        x[k] = y[k / WIDTH + (size_t)(k % WIDTH) * ROWS];
    CHECK(modal_identify(&b, NULL, &result, NULL) == MODAL_OK);
    for (int i = 0; i < result.diagnostic_count; i++)
        said |= strcmp(result.diagnostics[i].code, "not_free_decay") == 0;
    CHECK(said && result.driven && result.verdict == VERDICT_UNDECIDED);
    CHECK(strstr(result.diagnostics[0].message, "windows") != NULL);
    identify_result_done(&result);
    free(x), free(y);
}
