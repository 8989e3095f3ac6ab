/* test_scoring.c - steps to the summit of a likelihood of spectra, and the errors there */
/* Tests as well: reach.c whittle_fit.c */
#include "check.h"
#include <complex.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ambient/reach.h"
#include "modal/identify/ambient/scoring.h"
#include "modal/identify/ambient/whittle_fit.h"

enum { SAMPLES = 4000, LINES = SAMPLES / 2 - 1, CHANNELS = 3, MODES = 5 };

/* Modes 0.31 of a radian apart, of which neighbours' peaks overlap. */
static struct whittle some_modes(void)
{
    struct whittle m = { .channels = CHANNELS, .count = MODES,
                         .root = { 1.1, 0.3, -0.2, 0, 0.8, 0.1, 0, 0, 0.9 } };

    for (int k = 0; k < MODES; k++) {
        m.mode[k].lambda = CMPLX(-0.013 - 0.009 * k, 0.4 + 0.31 * k + 0.02 * k * k);
        for (int i = 0; i < CHANNELS; i++) {
            m.mode[k].phi[i] = CMPLX(cos(1.3 * k + 2.1 * i), 0.3 * sin(k - i));
            m.mode[k].kappa[i] = CMPLX(0.05 * cos(k + 1.7 * i), -0.06 * sin(2.3 * k + i));
        }
    }
    return m;
}

/* Every line a bin of its own; what is seen is what M says. */
static struct bins exact(const struct whittle *m)
{
    size_t n = LINES, l2 = CHANNELS * CHANNELS;
    struct bins b = { LINES, CHANNELS, SAMPLES, calloc(n, sizeof(int)), calloc(n, sizeof(int)),
                      calloc(n, sizeof(double)), calloc(n, sizeof(double)),
                      calloc(n * l2, sizeof(double complex)), calloc(n, sizeof(double)),
                      calloc(n * l2, sizeof(double complex)) };
    struct whittle_covariances v;

    whittle_covariances(m, &v);
    for (int j = 0; j < LINES; j++) {
        b.first[j] = j, b.lines[j] = 1;
        b.from[j] = 2 * M_PI * (j + 0.5) / SAMPLES, b.to[j] = 2 * M_PI * (j + 1.5) / SAMPLES;
        whittle_spectrum(m, &v, &b, j, b.mean + (size_t)j * l2);
    }
    memcpy(b.seen, b.mean, sizeof *b.seen * n * l2);
    return b;
}

/* M, all of it a little beside itself. */
static struct whittle beside(const struct whittle *m, double much)
{
    struct whittle near = *m;

    for (int k = 0; k < MODES; k++) {
        near.mode[k].lambda *= 1 + much * CMPLX(0, 0.01 * (k - 2));
        for (int i = 0; i < CHANNELS; i++) {
            near.mode[k].phi[i] += much * CMPLX(0.2 * (i - k), 0.1 * i);
            near.mode[k].kappa[i] += much * 0.01 * CMPLX(k - 2 * i, 1);
        }
    }
    near.root[1] += much;
    near.likelihood = -HUGE_VAL;
    return near;
}

/* x widths away the square of f is 1 / (1 + x^2); what is told of an exponent lies between that,
 * over a peak that is all of S, and its square, in noise: a share 2 / (pi x) at most of it is
 * further away, a tenth at 6.4; bins are as many on both sides. */
TEST(a_mode_is_told_by_bins_about_its_turn_all_of_them_where_nothing_may_be_lost)
{
    struct whittle m = some_modes(), swapped = m;
    struct bins b = exact(&m);
    bool *tells = calloc((size_t)LINES * MODES, sizeof *tells);

    swapped.mode[0] = m.mode[3], swapped.mode[3] = m.mode[0];
    CHECK(tells != NULL && reach_find(&swapped, &b, 0.1, tells, NULL) == MODAL_OK);
    for (int k = 0; k < MODES; k++) {
        double turn = cimag(m.mode[k].lambda), width = -creal(m.mode[k].lambda);
        CHECK(swapped.mode[k].lambda == m.mode[k].lambda);
        for (int j = 0; j < LINES; j++) {
            double away = fabs((b.from[j] + b.to[j]) / 2 - turn);
            CHECK(away > width / 4 || tells[k + MODES * j]);
            CHECK(away < 8 * width || !tells[k + MODES * j]);
        }
    }
    CHECK(reach_find(&m, &b, 0, tells, NULL) == MODAL_OK);
    for (int j = 0; j < LINES * MODES; j++)
        CHECK(tells[j]);
    free(tells);
    bins_done(&b);
}

/* A step so damped that the likelihood is a plane along it: of twice what is promised, the share of
 * its curvature, 1 / damping, is missed. */
TEST(a_short_step_gains_what_the_gradient_promises)
{
    struct whittle truth = some_modes(), m = beside(&truth, 0.05), moved;
    struct bins b = exact(&truth);
    struct scoring *w;
    struct scoring_step step;
    double before = whittle_likelihood(&m, &b), damping = 1e6;

    CHECK(scoring_new(&m, &b, SCORING_STEPS, &w, NULL) == MODAL_OK);
    scoring_gradient(w, &m, &b);
    scoring_inform(w, &m, &b);
    CHECK(scoring_step(w, &m, &b, damping, &step) && step.settled);
    moved = m;
    scoring_move(w, &b, &moved);
    CHECK_NEAR(whittle_likelihood(&moved, &b) - before, 2 * step.promised,
               100 / damping * step.promised + 1e-9 * fabs(before));
    scoring_free(w);
    bins_done(&b);
}

/* Where spectra are the model's own, a step of Gauss and Newton leaves the square of what was
 * missing, of the likelihood its fourth power: a tenth of the way is a hundredth of what is left at
 * most, but for what conjugate gradients leave of a step, a tenth. */
TEST(a_step_near_the_summit_leaves_little_more_than_its_solution_does)
{
    struct whittle truth = some_modes(), m = beside(&truth, 0.003);
    struct bins b = exact(&truth);
    struct scoring *w;
    struct scoring_step step;
    double most = whittle_likelihood(&truth, &b), before = most - whittle_likelihood(&m, &b);

    CHECK(before > 0);
    CHECK(scoring_new(&m, &b, SCORING_STEPS, &w, NULL) == MODAL_OK);
    scoring_gradient(w, &m, &b);
    scoring_inform(w, &m, &b);
    CHECK(scoring_step(w, &m, &b, 1e-9, &step) && step.settled);
    scoring_move(w, &b, &m);
    CHECK(most - whittle_likelihood(&m, &b) < 0.2 * before);
    scoring_free(w);
    bins_done(&b);
}

/* One of them: the likelihood where it begins and where the step ends, and all that is scored. */
TEST(a_step_is_charged_for_its_gradient_and_its_likelihoods)
{
    struct whittle truth = some_modes(), m = beside(&truth, 0.003);
    struct bins b = exact(&truth);
    double left = 1e12, spent, product = 16;     /* as the work of matrices is counted */
    struct whittle_limits limits = { 0, -HUGE_VAL, 1, 0, false, &left, NULL, NULL };
    struct scoring *w;
    struct scoring_step step;

    CHECK(scoring_new(&m, &b, SCORING_STEPS, &w, NULL) == MODAL_OK);
    scoring_gradient(w, &m, &b);
    CHECK(scoring_work(w) * product > 8. * LINES * MODES * CHANNELS * CHANNELS);
    scoring_inform(w, &m, &b);
    CHECK(scoring_step(w, &m, &b, WHITTLE_DAMPING_FIRST, &step));
    spent = scoring_work(w) + 2 * whittle_work(&m, &b);
    CHECK(whittle_fit(&m, &b, &limits, NULL) == MODAL_OK && m.steps == 1);
    CHECK_NEAR(1e12 - left, spent, 1e-6 * spent);
    scoring_free(w);
    bins_done(&b);
}

/* From the exact spectra the climb's end is what made them, and its errors are those of [Au14],
 * sqrt(decay / samples), of a mode alone in no noise; noise and neighbours add to them. */
TEST(a_fit_of_exact_spectra_ends_where_they_came_from)
{
    struct whittle truth = some_modes(), m = beside(&truth, 0.02);
    struct bins b = exact(&truth);
    double work = HUGE_VAL;
    struct whittle_limits limits = { 1e-8, -HUGE_VAL, 60, 0, true, &work, NULL, NULL };

    CHECK(whittle_fit(&m, &b, &limits, NULL) == MODAL_OK && m.converged);
    for (int k = 0; k < MODES; k++) {
        double least = sqrt(-creal(truth.mode[k].lambda) / SAMPLES);
        CHECK(m.mode[k].std_decay > 0.9 * least && m.mode[k].std_decay < 3 * least);
        CHECK(m.mode[k].std_turn > 0.9 * least && m.mode[k].std_turn < 3 * least);
        CHECK_NEAR(cabs(m.mode[k].lambda - truth.mode[k].lambda), 0, 1e-2 * least);
    }
    bins_done(&b);
}
