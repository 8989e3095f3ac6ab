/* Proper orthogonal modes of data read in panels, against the dense SVD; the step over all
 * channels, against a full refinement. */
/* Tests as well: merge.c parts.c polish.c refine_wide.c screen.c widen.c */
#include "modal/identify/fit/refine.h"
#include "modal/identify/identify.h"
#include "modal/identify/prepare/record.h"
#include "modal/identify/prepare/wide.h"
#include <float.h>
#include "modal/linalg/svd.h"
#include "check.h"
#include "signals.h"

enum { MOST = 400 * 700 };
static double x[MOST], copy[MOST], column[MOST];

/* Samples by channels as in a batch: `modes` decaying exponentials of graded strength `grade`^i and
 * white noise. */
static void make(int L, int S, int modes, double grade, double noise, uint64_t seed)
{
    struct random r = { seed };

    memset(x, 0, sizeof x);
    for (int j = 0; j < modes; j++) {
        double complex lambda = CMPLX(-0.002 * (j + 1), 0.1 + 0.37 * j);
        for (int c = 0; c < S; c++) {
            double complex b = pow(grade, j) * cexp(2 * M_PI * I * random_uniform(&r));
            for (int k = 0; k < L; k++)
                x[k * S + c] += creal(b * cexp(lambda * k));
        }
    }
    for (int i = 0; i < L * S; i++)
        x[i] += noise * random_normal(&r);
}

/* The dense SVD of the scaled data: s and the left vectors (L). */
static void dense(int L, int S, const double *scale, double *s, double *V)
{
    int k = L < S ? L : S;
    struct matrix A = { L, S, L, copy }, U = { L, k, L, V }, VT = { k, S, k, column };

    for (int c = 0; c < S; c++)
        for (int l = 0; l < L; l++)
            copy[l + c * L] = scale[c] > 0 ? x[l * S + c] / scale[c] : 0;
    CHECK(svd_thin(&A, s, &U, &VT, NULL) == MODAL_OK);
}

static double orthonormality(const struct matrix *Q)
{
    double worst = 0;

    for (int i = 0; i < Q->n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = -(i == j);
            for (int k = 0; k < Q->m; k++)
                sum += Q->x[k + i * Q->ld] * Q->x[k + j * Q->ld];
            worst = fmax(worst, fabs(sum));
        }
    return worst;
}

static void compare(int L, int S, bool by_rows, int expected, double tolerance)
{
    double scale[700], s[400], *V = malloc(sizeof *V * 400 * 400);
    struct wide w = { x, (size_t)S, L, S, scale, by_rows, NULL, NULL };
    bool varies;
    struct pod p;

    CHECK(wide_scales(&w, scale, &varies, NULL) == MODAL_OK && varies);
    dense(L, S, scale, s, V);
    CHECK(wide_pod(&w, NULL, &p, NULL) == MODAL_OK);
    CHECK(p.count == expected);
    for (int i = 0; i < p.count; i++) {
        double sum = 0;
        for (int k = 0; k < L; k++)
            sum += p.signals.x[k + i * L] * V[k + i * L];
        CHECK_NEAR(p.s[i] / s[i], 1, tolerance);
        CHECK_NEAR(fabs(sum) / s[i], 1, tolerance);
    }
    CHECK(orthonormality(&p.modes) < 1e-12);
    pod_done(&p);
    free(V);
}

/* Residuals below 1e-8 s^2 and gaps of order s^2 make vectors right to about 1e-8. */
TEST(noisy_data_give_the_modes_of_the_dense_svd_and_no_noise)
{
    make(200, 600, 3, 0.7, 0.02, 1);
    compare(200, 600, false, 6, 1e-8);
    compare(200, 600, true, 6, 1e-8);
    make(400, 120, 4, 0.7, 0.02, 2);
    compare(400, 120, false, 8, 1e-8);
}

/* Grades down to 1e-9 of the first: the Gram matrix loses what is below 1e-8; Lanczos on the data
 * keeps it, to 1e-9 relative. */
TEST(graded_clean_data_are_found_down_to_rounding)
{
    struct wide w = { x, 500, 150, 500, NULL, false, NULL, NULL };
    double scale[500], s[150], *V = malloc(sizeof *V * 150 * 150);
    struct pod p;

    make(150, 500, 4, 1e-3, 0, 3);
    for (int c = 0; c < 500; c++)
        scale[c] = 1;
    dense(150, 500, scale, s, V);
    CHECK(wide_pod(&w, NULL, &p, NULL) == MODAL_OK);
    CHECK(p.count >= 8);
    for (int i = 0; i < 8; i++)
        CHECK_NEAR(p.s[i] / s[i], 1, 1e-6);
    CHECK(s[7] < 1e-8 * s[0] && s[7] > 1e-11 * s[0]);
    pod_done(&p);
    free(V);
}

TEST(scales_are_root_mean_squares_at_any_magnitude)
{
    const double factors[3] = { 1, 1e-200, 1e200 };

    for (int f = 0; f < 3; f++) {
        double scale[40];
        struct wide w = { x, 40, 90, 40, NULL, false, NULL, NULL };
        bool varies;
        make(90, 40, 2, 0.5, 0.1, 4);
        for (int k = 0; k < 90; k++)
            x[k * 40 + 7] = 0;
        for (int i = 0; i < 90 * 40; i++)
            x[i] *= factors[f];
        CHECK(wide_scales(&w, scale, &varies, NULL) == MODAL_OK && varies);
        CHECK(scale[7] == 0);
        double sum = 0;
        for (int k = 0; k < 90; k++)
            sum += (x[k * 40 + 3] / factors[f]) * (x[k * 40 + 3] / factors[f]);
        CHECK_NEAR(scale[3] / factors[f], sqrt(sum / 90), 1e-13);
    }
}

TEST(a_sample_that_is_not_finite_is_named_and_constants_do_not_vary)
{
    struct wide w = { x, 5, 30, 5, NULL, false, NULL, NULL };
    struct modal_error err;
    double scale[5];
    bool varies = true;

    for (int i = 0; i < 150; i++)
        x[i] = 3.25;
    CHECK(wide_scales(&w, scale, &varies, &err) == MODAL_OK && !varies);
    x[12 * 5 + 2] = NAN;
    CHECK(wide_scales(&w, scale, &varies, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "signals");
    CHECK(strstr(err.message, "sample 12 of channel 2") != NULL);
    x[12 * 5 + 2] = -INFINITY;
    CHECK(wide_scales(&w, scale, &varies, &err) == MODAL_BAD_INPUT &&
          strstr(err.message, "infinity") != NULL);
}

/* 300 channels, the noise of each its own: one step from a start two standard errors off lands
 * where the whole refinement does, to the second order in the step, a few hundredths of a standard
 * error; the standard errors agree, and so do amplitudes with the truth. */
TEST(one_step_over_all_channels_is_the_refinement_of_all_channels)
{
    enum { L = 400, S = 300 };
    double complex truth[2] = { CMPLX(-0.05, 2.1), CMPLX(-0.02, 5.3) }, start[2], lambda[2],
                   *B = malloc(sizeof *B * 2 * S);
    double dt = 0.05, scale[S], rest[S], std_re[2], std_im[2];
    struct wide w = { x, S, L, S, scale, false, NULL, NULL };
    struct matrix Y = { L, S, L, copy };
    struct refine_data data = { .Y = &Y, .tau = dt };
    struct wide_step step = { lambda, std_re, std_im, B, rest, 0, false };
    struct random r = { 6 };
    struct refined full;
    bool varies;

    for (int c = 0; c < S; c++) {
        double noise = 0.01 * (1 + c % 7);
        for (int k = 0; k < L; k++)
            x[k * S + c] = creal(CMPLX(1, 0.01 * c) * cexp(truth[0] * k * dt) +
                                 0.5 * cexp(truth[1] * k * dt)) +
                           noise * random_normal(&r);
    }
    for (int c = 0; c < S; c++)
        for (int k = 0; k < L; k++)
            copy[k + c * L] = x[k * S + c];
    CHECK(refine_poles(&data, truth, 2, NULL, NULL, &full, NULL) == MODAL_OK &&
          full.end == REFINE_CONVERGED);
    for (int j = 0; j < 2; j++)
        start[j] = full.lambda[j] + CMPLX(2 * full.std_re[j], -2 * full.std_im[j]);
    CHECK(wide_scales(&w, scale, &varies, NULL) == MODAL_OK);
    CHECK(wide_refine(&w, dt, start, 2, NULL, 20, &step, NULL) == MODAL_OK);
    CHECK(step.taken && step.length > 2 && step.length < 8);
    for (int j = 0; j < 2; j++) {
        CHECK_NEAR(creal(lambda[j] - full.lambda[j]) / full.std_re[j], 0, 0.05);
        CHECK_NEAR(cimag(lambda[j] - full.lambda[j]) / full.std_im[j], 0, 0.05);
        CHECK_NEAR(std_re[j] / full.std_re[j], 1, 0.02);
    }
    CHECK_NEAR(cimag(B[2 * 123]), 1.23, 0.1);
    CHECK_NEAR(rest[5] / 0.06, 1, 0.2);
    CHECK(wide_refine(&w, dt, start, 2, NULL, 1e-3, &step, NULL) == MODAL_OK);
    CHECK(!step.taken && lambda[0] == start[0]);
    refined_done(&full);
    free(B);
}

/* No pole pays for itself in white noise; there is an answer all the same, and it is that nothing
 * was explained. */
TEST(a_wide_batch_of_nothing_but_noise_has_no_modes_and_is_left_unexplained)
{
    enum { L = 900, S = RECORD_WIDE_ENTRIES / L + 1 };
    double *noise = malloc(sizeof *noise * L * S);
    struct batch b = { .samples = L, .channels = S, .signals = noise, .dt = 0.02 };
    struct identify_options opt = { .shapes = true };
    struct identify_result r;
    struct random rng = { 17 };

    CHECK(noise != NULL);
    for (int i = 0; i < L * S; i++)
        noise[i] = random_normal(&rng);
    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == 0 && r.verdict == VERDICT_UNDECIDED);
    for (int c = 0; c < S; c++)
        CHECK_NEAR(r.relative_error[c], 1, 1e-12);
    identify_result_done(&r);
    free(noise);
}

/* Rounded to 8 bits of its full scale, and gone below half a step after a fifth of the record:
 * rounding is no white noise then, but the response itself.  No other mode, and errors within five
 * of the stated ones, which are those of noise of a step / sqrt(12) to a small factor. */
TEST(a_wide_batch_on_a_converters_grid_has_its_modes_and_no_others)
{
    enum { L = 16400, S = 260 };
    static const double complex truth[3] = { CMPLX(-0.163, 8.17), CMPLX(-0.182, 18.22),
                                             CMPLX(-0.443, 29.53) };
    const double dt = 0.01;
    double *y = malloc(sizeof *y * L * S);
    double complex B[3];
    struct batch b = { .samples = L, .channels = S, .signals = y, .dt = dt };
    struct identify_result r;
    struct random rng = { 31 };

    CHECK(y != NULL && L * S >= RECORD_WIDE_ENTRIES);
    for (int c = 0; c < S; c++) {
        double full = 0, q;
        for (int j = 0; j < 3; j++) {
            B[j] = CMPLX(random_normal(&rng), random_normal(&rng));
            full += cabs(B[j]);
        }
        q = full / 128;
        for (int k = 0; k < L; k++) {
            double sum = 0;
            for (int j = 0; j < 3; j++)
                sum += creal(B[j] * cexp(truth[j] * (k * dt)));
            y[(size_t)k * S + (size_t)c] = q * nearbyint(sum / q);
        }
    }
    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == 3 && r.at_grid);
    for (int i = 0; i < r.mode_count; i++) {
        const struct identify_mode *m = &r.modes[i];
        double complex off = HUGE_VAL;
        for (int j = 0; j < 3; j++)
            if (cabs(m->exponent - truth[j]) < cabs(off))
                off = m->exponent - truth[j];
        CHECK(fabs(creal(off)) < 5 * m->std_re && fabs(cimag(off)) < 5 * m->std_im);
        CHECK(m->std_re < 1e-4);
    }
    identify_result_done(&r);
    free(y);
}

/* Each channel hears three motions and a white noise of 1e-4, at sizes over three decades.  The
 * amplitude of a motion is the rms of its part over all channels, in units of the loudest's rms. */
TEST(a_common_scale_keeps_the_proportions_of_a_wide_batch)
{
    enum { L = 16400, S = 260, MODES = 3 };
    static const double complex truth[MODES] = {
        CMPLX(-0.2, 8.17), CMPLX(-0.182, 18.2), CMPLX(-0.4, 29.5),
    };
    const double dt = 0.01;
    double *y = malloc(sizeof *y * L * S), energy[MODES] = { 0 }, most = 0;
    struct batch b = { .samples = L, .channels = S, .signals = y, .dt = dt };
    struct identify_options options = { .scale = SCALE_COMMON };
    struct identify_result r;
    struct random rng = { 37 };

    CHECK(y != NULL && L * S >= RECORD_WIDE_ENTRIES);
    for (int c = 0; c < S; c++) {
        double size = pow(10, -3.0 * c / S), sum2 = 0;
        double complex B[MODES];
        for (int j = 0; j < MODES; j++)
            B[j] = size * CMPLX(random_normal(&rng), random_normal(&rng)) *
                   (c % MODES == j ? 3 : 0.3);
        for (int k = 0; k < L; k++) {
            double sum = 1e-4 * random_normal(&rng);
            for (int j = 0; j < MODES; j++) {
                double part = creal(B[j] * cexp(truth[j] * (k * dt)));
                energy[j] += part * part / ((double)L * S);
                sum += part;
            }
            y[(size_t)k * S + (size_t)c] = sum;
            sum2 += sum * sum;
        }
        most = fmax(most, sqrt(sum2 / L));
    }
    CHECK(modal_identify(&b, &options, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == MODES);
    for (int i = 0; i < MODES; i++) {
        const struct identify_mode *m = &r.modes[i];
        int j = 0;
        while (j + 1 < MODES && cabs(m->exponent - truth[j]) > 1e-2)
            j++;
        CHECK(fabs(creal(m->exponent - truth[j])) < 5 * m->std_re);
        CHECK(fabs(cimag(m->exponent - truth[j])) < 5 * m->std_im);
        CHECK_NEAR(m->amplitude * most / sqrt(energy[j]), 1, 1e-3);
    }
    identify_result_done(&r);
    free(y);
}

/* A grid that few rows and channels show, and where the last of it is left. */
TEST(grids_are_those_of_each_channel_and_end_where_the_response_does)
{
    enum { L = 500, S = 40 };
    static double y[L * S];
    struct grid grid[S];
    struct wide w = { y, S, L, S, NULL, false, NULL, NULL };
    bool any;

    for (int k = 0; k < L; k++)
        for (int c = 0; c < S; c++)
            y[k * S + c] = (0.25 + 0.03125 * c) * nearbyint(40 * exp(-0.02 * k) * cos(1.7 * k + c));
    CHECK(wide_grids(&w, grid, &any, NULL) == MODAL_OK && any);
    for (int c = 0; c < S; c++)
        CHECK_NEAR(grid[c].step, 0.25 + 0.03125 * c, 1e-12);
    int rows = wide_rows_above(&w, grid, 1.9);        /* 40 e^{-0.02 k} = 1.5 at k = 164 */
    CHECK(rows > 150 && rows < 166);
    grid[7].step = 0;
    CHECK(wide_rows_above(&w, grid, 1.9) == L);
    for (int i = 0; i < L * S; i++)
        y[i] += 1e-3 * sin(1.0 * i * i);
    CHECK(wide_grids(&w, grid, &any, NULL) == MODAL_OK && !any);
}

static size_t released;
static const void *up_to;

/* Row after row, none twice in a pass. */
static void count_released(const void *from, size_t bytes)
{
    CHECK(from == up_to || from == (const void *)x);
    up_to = (const char *)from + bytes;
    released += bytes;
}

/* The same sums in another order: what is left of a channel agrees to rounding of its energy, and
 * where energies cancel (noise of 1e-6, an energy of 1e-12) to the rounding of the samples over the
 * noise, 1e-9; the step is as good as its weights. */
TEST(what_is_read_in_order_and_given_back_gives_the_same_step)
{
    enum { L = 400, S = 700 };
    const double noises[] = { 0.05, 1e-6 };
    double complex truth[2] = { CMPLX(-0.05, 2.1), CMPLX(-0.02, 5.3) }, lambda[2][2];
    double dt = 0.05, scale[S], rest[2][S], std_re[2][2], std_im[2][2];

    for (int i = 0; i < 2; i++) {
        struct random r = { 8 };
        for (int c = 0; c < S; c++)
            for (int k = 0; k < L; k++)
                x[k * S + c] = creal(CMPLX(1, 0.01 * c) * cexp(truth[0] * k * dt) +
                                     0.5 * cexp(truth[1] * k * dt)) +
                               noises[i] * random_normal(&r);
        for (int in_order = 0; in_order < 2; in_order++) {
            struct wide w = { x, S, L, S, scale, in_order, in_order ? count_released : NULL, NULL };
            struct wide_step step = {
                lambda[in_order], std_re[in_order], std_im[in_order], NULL, rest[in_order], 0, false
            };
            bool varies;
            CHECK(wide_scales(&w, scale, &varies, NULL) == MODAL_OK);
            released = 0;
            CHECK(wide_refine(&w, dt, truth, 2, NULL, 20, &step, NULL) == MODAL_OK && step.taken);
        }
        /* one pass; another where energies cancel */
        CHECK(released == (i + 1) * sizeof *x * L * S);
        for (int c = 0; c < S; c++)
            CHECK_NEAR(rest[1][c] / rest[0][c], 1, i == 0 ? 1e-10 : 1e-8);
        for (int j = 0; j < 2; j++) {
            CHECK_NEAR(cabs(lambda[1][j] - lambda[0][j]) / std_re[0][j], 0, 1e-6);
            CHECK_NEAR(std_im[1][j] / std_im[0][j], 1, 1e-8);
        }
    }
}
