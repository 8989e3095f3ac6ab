/* Tests as well: torus_laws.c torus_set.c torus_tone.c torus_newton.c torus_begin.c torus_error.c
 * torus_march.c torus_stand.c torus_pieces.c torus_from.c torus_stability.c torus_solve.c
 * torus_slopes.c torus_taylor.c torus_fold.c
 *
 * Motions of several tones. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/json.h"
#include "modal/scene/program.h"
#include "modal/scene/scene.h"
#include "modal/steady/budget.h"
#include "modal/steady/torus_fold.h"
#include "modal/steady/torus_laws.h"
#include "modal/steady/torus_lines.h"
#include "modal/steady/torus_pieces.h"
#include "modal/steady/torus_solve.h"
#include "modal/steady/torus_taylor.h"

static const double W[3] = { 0.7, 1.1326237921249264, 0.43 };   /* the golden ratio, and one more */

static struct program *lower(const char *text)
{
    cJSON *scene = cJSON_Parse(text);
    struct program *p = NULL;
    struct modal_error err = { 0 };

    assert_non_null(scene);
    if (scene_lower(scene, NULL, &p, &err) != MODAL_OK)
        fail_msg("%s", err.message);
    cJSON_Delete(scene);
    return p;
}

/* A line's samples are the motion itself, in time. */
static void test_samples_along_a_line_are_the_motion_in_time(void **state)
{
    struct torus_tones t = torus_tones_of(W, 3);
    const struct torus_index k[] = {
        { { 0 } }, { { 1, 0, 0 } }, { { -1, 2, 0 } }, { { 2, -1, 1 } }
    };
    const double complex X[] = { 0.3, 1 - 2 * I, 0.5 + 0.1 * I, -0.7 * I };
    const int lines[] = { 8, 8, 8 };
    struct torus_grid *g;
    double *x, *v;

    (void)state;
    assert_int_equal(torus_grid_new(&t, 16, lines, &g, NULL), MODAL_OK);
    x = malloc((size_t)torus_grid_lines(g) * 16 * sizeof *x);
    v = malloc((size_t)torus_grid_lines(g) * 16 * sizeof *v);
    for (int turn = -3; turn <= 1; turn++) {
        torus_synthesize_both(g, 4, k, X, turn, x, v);
        for (int line = 0; line < torus_grid_lines(g); line += 7)
            for (int n = 0; n < 16; n++) {
                double time = 2 * M_PI * (turn + n / 16.0) / W[t.lead], sum = 0;

                for (int i = 0; i < 4; i++) {
                    double Omega = torus_frequency(&t, k[i]), phase = Omega * time;

                    for (int j = 0; j < 3; j++)
                        phase += k[i].k[j] * torus_grid_phase(g, line, j);
                    sum += creal(I * Omega * X[i] * cexp(I * phase));
                }
                assert_float_equal(v[line * 16 + n], sum, 1e-12);
            }
    }
    torus_synthesize(g, 4, k, X, x);
    torus_analyze(g, x);
    for (int i = 0; i < 4; i++)
        assert_float_equal(cabs((i > 0 ? 2 : 1) * torus_coefficient(g, k[i]) - X[i]), 0, 1e-13);
    torus_grid_free(g);
    free(x), free(v);
}

static void test_a_combination_is_told_with_its_positive_frequency(void **state)
{
    struct torus_tones t = torus_tones_of(W, 2);
    bool flipped;
    struct torus_index k = torus_signed(&t, (struct torus_index) { { 1, -1, 0 } }, &flipped);

    (void)state;
    assert_true(flipped);
    assert_int_equal(k.k[0], -1);
    assert_int_equal(k.k[1], 1);
    assert_true(torus_frequency(&t, k) > 0);
}

/* Clipped at its top, the mean of max(0, cos theta_1 - 0.3): an integral known in closed form. */
static void test_a_kink_between_samples_costs_no_second_order(void **state)
{
    struct program *p = lower(
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"K\":[[1]],\"dofs\":[\"x\"]},"
        "\"effects\":[{\"type\":\"gap\",\"dof\":\"x\",\"stiffness\":1,\"clearance\":0.3}]}");
    struct torus_tones t = torus_tones_of(W, 2);
    const struct torus_index at[] = { { { 0 } }, { { 0, 1, 0 } } };
    const double complex X = 1;
    const int lines[] = { 4, 1 }, place[] = { 0 };
    double a = acos(0.3), exact[2] = { (sin(a) - 0.3 * a) / M_PI,
                                       (a + sin(a) * cos(a) - 2 * 0.3 * sin(a)) / M_PI };
    double error[2];
    struct budget work = { 0 };
    struct torus_laws *w;

    (void)state;
    assert_int_equal(torus_laws_new(p, &t, place, 1, &work, &w, NULL), MODAL_OK);
    for (int i = 0; i < 2; i++) {             /* the second tone leads, and is the one that moves */
        struct torus_grid *g;
        double complex F[2];

        assert_int_equal(torus_grid_new(&t, i == 0 ? 64 : 128, lines, &g, NULL), MODAL_OK);
        assert_int_equal(torus_forces(w, g, 1, &at[1], &X, 2, at, F, NULL), MODAL_OK);
        error[i] = fmax(cabs(F[0] - exact[0]), cabs(F[1] - exact[1]));
        torus_grid_free(g);
    }
    assert_true(error[0] < 1e-6);                  /* sampled: 1e-3 */
    assert_true(error[1] < error[0] / 6);
    torus_laws_free(w);
    program_free(p);
}

static void solve(struct program *p, const double *omega, int count, double target,
                  struct torus_point *out)
{
    const int all[] = { 0, 1, 2, 3 };
    struct torus_options opt = { .target_error = target, .dofs = all, .dofs_count = p->n };
    struct modal_error err = { 0 };

    if (torus_solve(p, omega, count, &opt, out, &err) != MODAL_OK)
        fail_msg("%s", err.message);
}

static double complex find(const struct torus_point *point, int dof, int k1, int k2)
{
    for (int m = 0; m < point->count; m++)
        if (point->index[m].k[0] == k1 && point->index[m].k[1] == k2)
            return point->X[dof * point->count + m];
    return 0;
}

static void test_a_linear_structure_answers_each_tone_by_its_receptance(void **state)
{
    struct program *p = lower(
        "{\"structure\":{\"type\":\"chain\",\"masses\":[1,2],\"springs\":[1,1,0],"
        "\"dampers\":[0.1,0,0.2]},"
        "\"excitation\":[{\"dof\":\"x1\",\"k\":[1,0],\"cos\":1},"
        "{\"dof\":\"x2\",\"k\":[1,-1],\"sin\":2}]}");
    struct torus_point point;
    double w = W[0], s = W[1] - W[0];
    double complex d = (2 - w * w + 0.1 * I * w) * (1 - 2 * w * w + 0.2 * I * w) - 1;
    double complex e = (2 - s * s + 0.1 * I * s) * (1 - 2 * s * s + 0.2 * I * s) - 1;

    (void)state;
    solve(p, W, 2, 1e-6, &point);
    assert_true(point.converged);
    assert_float_equal(cabs(find(&point, 0, 1, 0) - (1 - 2 * w * w + 0.2 * I * w) / d), 0, 1e-12);
    /* 2 sin(-(s t)) = Re 2 i e^{i s t} */
    assert_float_equal(cabs(find(&point, 0, -1, 1) - 2 * I / e), 0, 1e-12);
    torus_point_done(&point);
    program_free(p);
}

/* The cubic's balance, evaluated by a plain sum over combinations, k = k1 + k2 + k3. */
static double complex cube_at(const struct torus_point *point, int k1, int k2)
{
    double complex sum = 0;
    int n = point->count;

    for (int a = 0; a < 8 * n * n * n; a++) {
        int m[3] = { a / 8 % n, a / 8 / n % n, a / 8 / n / n }, at[2] = { 0, 0 };
        double complex product = 1;
        bool once = true;

        for (int j = 0; j < 3; j++) {
            bool other = a >> j & 1, mean = torus_order(point->index[m[j]]) == 0;
            double complex X = point->X[m[j]] * (mean ? 1 : 0.5);

            once = once && !(mean && other);
            product *= other ? conj(X) : X;
            for (int i = 0; i < 2; i++)
                at[i] += (other ? -1 : 1) * point->index[m[j]].k[i];
        }
        if (once && at[0] == k1 && at[1] == k2)
            sum += product;
    }
    return 2 * sum;
}

static void test_a_cubic_spring_is_balanced_combination_by_combination(void **state)
{
    struct program *p =
        lower("{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.1]],\"K\":[[1]],"
              "\"dofs\":[\"x\"]},"
              "\"effects\":[{\"type\":\"cubic_spring\",\"dof\":\"x\",\"coefficient\":0.5}],"
              "\"excitation\":[{\"dof\":\"x\",\"k\":[1,0],\"cos\":0.1},{\"dof\":\"x\",\"k\":[0,1],"
              "\"cos\":0.1}]}");
    struct torus_point point;
    static const int look[][2] = { { 1, 0 }, { 0, 1 }, { 2, -1 }, { 3, 0 } };

    (void)state;
    solve(p, W, 2, 1e-4, &point);
    assert_true(point.converged && point.count < 40);
    assert_true(point.error <= 1e-4 * point.amplitude);
    for (int i = 0; i < 4; i++) {
        double s = look[i][0] * W[0] + look[i][1] * W[1];
        double complex R = (1 - s * s + 0.1 * I * s) * find(&point, 0, look[i][0], look[i][1])
            + 0.5 * cube_at(&point, look[i][0], look[i][1]) - (i < 2 ? 0.1 : 0);

        assert_float_equal(cabs(R), 0, 1e-10);
    }
    torus_point_done(&point);
    program_free(p);
}

static void test_a_slider_that_never_slips_is_a_spring_of_undetermined_place(void **state)
{
    struct program *p =
        lower("{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.1]],\"K\":[[1]],"
              "\"dofs\":[\"x\"]},"
              "\"effects\":[{\"type\":\"friction\",\"dof\":\"x\",\"stiffness\":3,\"limit\":9}],"
              "\"excitation\":[{\"dof\":\"x\",\"k\":[1,0],\"cos\":0.1},{\"dof\":\"x\",\"k\":[0,1],"
              "\"cos\":0.1}]}");
    struct torus_point point;

    (void)state;
    solve(p, W, 2, 1e-6, &point);
    assert_true(point.converged && point.undetermined[0] && !point.acts[0]);
    assert_float_equal(cabs(find(&point, 0, 1, 0)
                            - 0.1 / (4 - W[0] * W[0] + 0.1 * I * W[0])), 0, 1e-10);
    torus_point_done(&point);
    program_free(p);
}

/* x'' + 0.1 x' + x + f = 0.2 (cos w1 t + cos w2 t), f a spring of 0.5 behind a slider of 0.2, which
 * is at *Z. */
static double accelerate(const double *w, double t, double x, double v, double *z, bool slides)
{
    double stretch = fmin(fmax(x - *z, -0.4), 0.4);

    *z = slides ? x - stretch : *z;
    return 0.2 * (cos(w[0] * t) + cos(w[1] * t)) - 0.1 * v - x - 0.5 * stretch;
}

/* By classical Runge-Kutta steps of H, from rest to step FIRST and on to LAST: the most that POINT
 * is off. */
static double march(const double *w, const struct torus_point *point, double h, long first,
                    long last)
{
    double x = 0, v = 0, z = 0, worst = 0;

    for (long step = 0; step <= last; step++) {
        double t = step * h, a[4], sum = 0;

        for (int m = 0; step >= first && step % 500 == 0 && m < point->count; m++)
            sum += creal(point->X[m] * cexp(I * torus_frequency(&point->tones, point->index[m])
                                            * t));
        worst = step >= first && step % 500 == 0 ? fmax(worst, fabs(x - sum)) : worst;
        a[0] = accelerate(w, t, x, v, &z, true);
        a[1] = accelerate(w, t + h / 2, x + h / 2 * v, v + h / 2 * a[0], &z, false);
        a[2] = accelerate(w, t + h / 2, x + h / 2 * (v + h / 2 * a[0]), v + h / 2 * a[1], &z,
                          false);
        a[3] = accelerate(w, t + h, x + h * (v + h / 2 * a[1]), v + h * a[2], &z, false);
        x += h * v + h * h / 6 * (a[0] + a[1] + a[2]);
        v += h / 6 * (a[0] + 2 * a[1] + 2 * a[2] + a[3]);
    }
    return worst;
}

static void test_tones_are_one_where_small_whole_numbers_have_them_to_rounding(void **state)
{
    const double fifths[] = { 0.8, 0.8 * 5 / 3 }, even[] = { 1.4, 0.7, 2.1 },
                 hundredths[] = { 0.8, 0.8 * 1.01 }, off[] = { 0.7, 1.4 * (1 + 1e-14) },
                 pair[] = { 0.8, 0.8 * 1.7320508, 1.2 };
    struct torus_fold f;

    (void)state;
    assert_true(torus_fold_finds(fifths, 2, &f));
    assert_int_equal(f.number[0], 3);
    assert_int_equal(f.number[1], 5);
    assert_float_equal(f.omega[0], 0.8 / 3, 1e-15);
    assert_true(torus_fold_finds(even, 3, &f));
    assert_int_equal(f.number[0], 2);
    assert_int_equal(f.number[1], 1);
    assert_int_equal(f.number[2], 3);
    assert_int_equal(f.tones, 1);
    assert_true(torus_fold_finds(pair, 3, &f));
    assert_int_equal(f.tones, 2);
    assert_int_equal(f.number[0], 2);
    assert_int_equal(f.number[1], 1);
    assert_int_equal(f.number[2], 3);
    assert_int_equal(f.into[1], 1);
    assert_float_equal(f.omega[0], 0.4, 1e-15);
    assert_float_equal(f.omega[1], pair[1], 0);
    assert_false(torus_fold_finds(W, 2, &f));
    assert_false(torus_fold_finds(hundredths, 2, &f));
    assert_false(torus_fold_finds(off, 2, &f));
    assert_false(torus_fold_finds(W, 1, &f));
}

/* At the phases that these tones have the slider holds, a spring; at others it would slip. */
static void test_a_slider_that_holds_at_its_tones_own_phases_is_a_spring_to_the_error_asked_for(
    void **state)
{
    struct program *p =
        lower("{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.1]],\"K\":[[1]],"
              "\"dofs\":[\"x\"]},"
              "\"effects\":[{\"type\":\"friction\",\"dof\":\"x\",\"stiffness\":0.5,"
              "\"limit\":0.2}],"
              "\"excitation\":[{\"dof\":\"x\",\"k\":[1,0],\"cos\":0.2},"
              "{\"dof\":\"x\",\"k\":[0,1],\"cos\":0.2}]}");
    const double w[] = { 0.8, 1.6 };
    struct torus_point point;

    (void)state;
    solve(p, w, 2, 1e-6, &point);
    assert_true(point.converged && point.undetermined[0] && point.tones.count == 2);
    assert_true(point.error < 1e-6);               /* of all phases: 6.6e-3 */
    assert_float_equal(point.tones.omega[1], 1.6, 0);
    for (int j = 0; j < 2; j++) {
        double complex X = find(&point, 0, 1 - j, j), exact = 1.5 - w[j] * w[j] + 0.1 * I * w[j];

        assert_float_equal(cabs(X - 0.2 / exact), 0, 1e-6);
    }
    torus_point_done(&point);
    program_free(p);
}

/* x'' + 0.1 x' + x + 0.5 x^3 of loads 3 and 2 of 0.35 rad/s: each harmonic is told once, at the
 * combination of the lowest order that has it, and one begun at the motion is there. */
static void test_a_motion_of_a_common_period_is_told_at_lowest_combinations_and_begun_at(
    void **state)
{
    struct program *p =
        lower("{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.1]],\"K\":[[1]],"
              "\"dofs\":[\"x\"]},"
              "\"effects\":[{\"type\":\"cubic_spring\",\"dof\":\"x\",\"coefficient\":0.5}],"
              "\"excitation\":[{\"dof\":\"x\",\"k\":[1,0],\"cos\":0.2},"
              "{\"dof\":\"x\",\"k\":[0,1],\"cos\":0.2}]}");
    const double w[] = { 1.05, 0.7 };
    const int dofs[] = { 0 };
    struct torus_point point, again;
    struct torus_options opt = { .target_error = 1e-9, .dofs = dofs, .dofs_count = 1,
                                 .near = true, .start = &point };

    (void)state;
    solve(p, w, 2, 1e-9, &point);
    assert_true(point.converged && point.error < 1e-8);
    for (int m = 1; m < point.count; m++) {
        const int *k = point.index[m].k;

        assert_true(torus_order(point.index[m]) >= torus_order(point.index[m - 1]));
        assert_true(3 * k[0] + 2 * k[1] > 0);
        for (int a = -30; a <= 30; a++)                /* (-2, 3) has frequency 0 */
            assert_true(torus_order(point.index[m]) <= abs(k[0] - 2 * a) + abs(k[1] + 3 * a));
    }
    assert_int_equal(torus_solve(p, w, 2, &opt, &again, NULL), MODAL_OK);
    assert_true(again.converged && again.iterations <= 3);
    assert_float_equal(cabs(find(&again, 0, 1, -1) - find(&point, 0, 1, -1)), 0, 1e-8);
    assert_true(cabs(find(&point, 0, 1, -1)) > 1e-3);
    torus_point_done(&point);
    torus_point_done(&again);
    program_free(p);
}

static void test_a_slider_under_tones_one_per_cent_apart_moves_as_marching_says(void **state)
{
    const double w[2] = { 0.8, 0.808 };
    struct program *p =
        lower("{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.1]],\"K\":[[1]],"
              "\"dofs\":[\"x\"]},"
              "\"effects\":[{\"type\":\"friction\",\"dof\":\"x\",\"stiffness\":0.5,"
              "\"limit\":0.2}],"
              "\"excitation\":[{\"dof\":\"x\",\"k\":[1,0],\"cos\":0.2},{\"dof\":\"x\","
              "\"k\":[0,1],\"cos\":0.2}]}");
    struct torus_point point;

    (void)state;
    solve(p, w, 2, 1e-5, &point);
    assert_true(point.converged && point.marched && !point.wanting);
    /* two beats of a hundred turns, after one; the steps' own error is 2e-8 */
    assert_true(march(w, &point, 0.004, 250000, 700000) <= 3 * point.error + 1e-7);
    assert_true(point.line <= 1e-5 * point.amplitude);
    torus_point_done(&point);
    program_free(p);
}

static void test_lines_that_leave_much_stand_only_where_all_disturbances_decay(void **state)
{
    struct torus_solver s = { .followed = { .verdict = 1 } };
    struct torus_lines lines = { .count = 1, .error = 0.1, .amplitude = 1 };

    (void)state;
    assert_true(torus_lines_stand(&s, &lines, NULL));
    s.followed.verdict = 0;
    assert_false(torus_lines_stand(&s, &lines, NULL));
    s.followed.verdict = -1;
    assert_false(torus_lines_stand(&s, &lines, NULL));
    lines.error = 1e-3;
    assert_true(torus_lines_stand(&s, &lines, NULL));
}

/* Ten times the one tone is nine times the other: a record tells that as (0, 9), of lower order. */
static void test_a_load_that_a_record_tells_as_another_combination_moves_what_no_law_is_at(
    void **state)
{
    struct program *p = lower(
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1,0],[0,1]],\"C\":[[0.2,0],[0,0.2]],"
        "\"K\":[[1,0],[0,60]],\"dofs\":[\"x\",\"y\"]},"
        "\"effects\":[{\"type\":\"gap\",\"dof\":\"x\",\"stiffness\":1,\"clearance\":0.1}],"
        "\"excitation\":[{\"dof\":\"x\",\"k\":[1,0],\"cos\":0.2},"
        "{\"dof\":\"x\",\"k\":[0,1],\"cos\":0.1},{\"dof\":\"y\",\"k\":[10,0],\"cos\":3}]}");
    const double w[2] = { 0.9, 1 };
    double complex y = 0;
    struct torus_point point;

    (void)state;
    solve(p, w, 2, 1e-3, &point);
    assert_true(point.converged && point.marched);
    for (int m = 0; m < point.count; m++)
        if (fabs(torus_frequency(&point.tones, point.index[m]) - 9) < 1e-9)
            y += point.X[point.count + m];
    assert_float_equal(cabs(y - 3 / (60 - 81 + 0.2 * I * 9)), 0, 1e-10);
    torus_point_done(&point);
    program_free(p);
}

/* Two masses, the first at a stop, the second without a law; at each its own load. */
static const char BY_A_STOP[] =
    "{\"structure\":{\"type\":\"matrices\",\"M\":[[1,0],[0,1]],\"C\":[[0.2,0],[0,0.2]],"
    "\"K\":[[2,-1],[-1,2]],\"dofs\":[\"x\",\"y\"]},"
    "\"effects\":[{\"type\":\"gap\",\"dof\":\"x\",\"stiffness\":1,\"clearance\":0.1}],"
    "\"excitation\":[{\"dof\":\"x\",\"k\":%s,\"cos\":0.2},"
    "{\"dof\":\"y\",\"k\":%s,\"cos\":%.17g,\"sin\":%.17g}]}";

static struct program *lower_by_a_stop(const char *first, const char *second, double phase)
{
    char text[600];

    snprintf(text, sizeof text, BY_A_STOP, first, second, 0.15 * cos(phase), 0.15 * sin(phase));
    return lower(text);
}

/* x of dof at phases PHASE of the tones. */
static double at_phases(const struct torus_point *point, int dof, const double *phase)
{
    double sum = 0;

    for (int m = 0; m < point->count; m++) {
        const int *k = point->index[m].k;

        sum += creal(point->X[dof * point->count + m]
                     * cexp(I * (k[0] * phase[0] + k[1] * phase[1])));
    }
    return sum;
}

/* Tones 2e-9 apart are one tone at each phase of their beat, which takes 5e8 turns: a record sees
 * one of them. */
static void test_twin_tones_at_a_stop_move_as_one_tone_does_at_each_phase_of_their_beat(
    void **state)
{
    const double w[2] = { 0.9, 0.9 * (1 + 2e-9) }, once[2] = { 0.9, 1.8 };
    struct program *p = lower_by_a_stop("[1,0]", "[0,1]", 0);
    struct torus_point twins;
    double least = HUGE_VAL, most = 0;

    (void)state;
    solve(p, w, 2, 1e-3, &twins);
    assert_true(twins.converged && twins.error < 0.02 * twins.amplitude);
    for (int b = 0; b < 4; b++) {
        double beat = b * M_PI / 2, largest = 0;
        struct program *q = lower_by_a_stop("[1,0]", "[1,0]", -beat);   /* cos(w t + beat) */
        struct torus_point one;

        solve(q, once, 2, 1e-6, &one);
        assert_true(one.converged && one.error < 1e-4 * one.amplitude);
        for (int i = 0; i < 2 * 50; i++) {
            double theta = 2 * M_PI * (i / 2) / 50;
            double x = at_phases(&one, i % 2, (double[]) { theta, 2 * theta });
            double twin = at_phases(&twins, i % 2, (double[]) { theta, theta + beat });

            assert_true(fabs(x - twin) <= twins.error + one.error);
            largest = fmax(largest, fabs(x));
        }
        least = fmin(least, largest), most = fmax(most, largest);
        torus_point_done(&one);
        program_free(q);
    }
    assert_true(most > 1.5 * least);                       /* a beat there is */
    torus_point_done(&twins);
    program_free(p);
}

/* A chain of N masses of 1, stiffness 1 between them and 0.4 to the ground, damped, a slider at
 * each under unequal loads of both tones. */
static struct program *chain_of_sliders(int n)
{
    struct program *p;
    char *text = malloc(1000 + 400 * (size_t)n);
    char *at = text;

    at += sprintf(at, "{\"structure\":{\"type\":\"chain\",\"masses\":[1");
    for (int i = 1; i < n; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],\"springs\":[0.4");
    for (int i = 0; i < n; i++)
        at += sprintf(at, ",%d", i < n - 1);
    at += sprintf(at, "],\"dampers\":[0.3");
    for (int i = 0; i < n; i++)
        at += sprintf(at, ",%g", i < n - 1 ? 0.05 : 0.2);
    at += sprintf(at, "]},\"effects\":[");
    for (int i = 0; i < n; i++)
        at += sprintf(at, "%s{\"type\":\"friction\",\"dof\":\"x%d\",\"stiffness\":0.5,"
                      "\"limit\":%g}", i > 0 ? "," : "", i + 1, 0.1 + 0.01 * (i % 7));
    at += sprintf(at, "],\"excitation\":[");
    for (int i = 0; i < n; i++)
        at += sprintf(at, "%s{\"dof\":\"x%d\",\"k\":[1,0],\"cos\":%g},{\"dof\":\"x%d\","
                      "\"k\":[0,1],\"sin\":0.3}", i > 0 ? "," : "", i + 1,
                      0.2 + 0.05 * (i % 3), i + 1);
    sprintf(at, "]}");
    p = lower(text);
    free(text);
    return p;
}

/* A solver of P, its loads read: what a march asks of one. */
static void two_loads(struct torus_solver *s, const struct program *p, struct torus_options *opt)
{
    *s = (struct torus_solver) { .view = *p, .p = p, .opt = opt, .tones = torus_tones_of(W, 2),
                                 .tone = { .index = -1 }, .level = 1 };
    assert_int_equal(torus_read_loads(s, NULL), MODAL_OK);
}

/* The motion is analytic until the law changes and from there on: two shorter steps, one to each
 * side, know of no change within a step.  AGAIN: after one of nothing, that moves none. */
static void moves_as_two_steps(int n, int law, bool again)
{
    enum { MOST = 40, WIDE = 2 * MOST * TORUS_WIDE };
    const double tau = 0.37, h = 0.15;
    struct program *p = chain_of_sliders(n);
    struct torus_options opt = { .target_error = 1e-10 };
    struct torus_solver s;
    struct torus_taylor t;
    double u[WIDE], once[WIDE], part[WIDE], twice[WIDE], wave[4] = { 0.6, 0.8, -0.28, 0.96 };
    double steepest[MOST], level[TORUS_WIDE], rest[TORUS_WIDE] = { 0.1 }, most = 0;
    bool serves;

    for (int l = 0; l < n; l++)
        steepest[l] = 0.5;
    two_loads(&s, p, &opt);
    assert_int_equal(torus_taylor_init(&t, &s, TORUS_WIDE, steepest, &serves, NULL), MODAL_OK);
    assert_true(serves && torus_taylor_set_step(&t, h) && !torus_taylor_set_step(&t, 10 * h));
    for (int e = 0; e < 2 * n * TORUS_WIDE; e++)
        u[e] = cos(1 + 0.7 * e) / (1 + e % 5);
    for (int l = 0; l < n; l++)
        t.gain[l] = 0.5 * (l % 2);
    for (int e = 0; e < n * TORUS_WIDE; e++)
        t.level[e] = 0.1 * sin(e);
    memcpy(level, t.level + law * TORUS_WIDE, sizeof level);
    torus_taylor_make(&t, u, wave, once);
    if (again)
        torus_taylor_change(&t, law, 0.5 * tau, t.gain[law], level);
    torus_taylor_end(&t, t.reach[law].dof,
                     t.reach[law].dofs[torus_taylor_change(&t, law, tau, 0, rest)], once);
    assert_true(torus_taylor_set_step(&t, tau * h));
    t.gain[law] = 0.5;
    memcpy(t.level + law * TORUS_WIDE, level, sizeof level);
    torus_taylor_make(&t, u, wave, part);
    for (int w = 0; w < 2; w++) {
        double complex q = CMPLX(wave[2 * w], wave[2 * w + 1]) * cexp(I * t.omega[w] * tau * h);

        wave[2 * w] = creal(q), wave[2 * w + 1] = cimag(q);
    }
    assert_true(torus_taylor_set_step(&t, (1 - tau) * h));
    t.gain[law] = 0;
    memcpy(t.level + law * TORUS_WIDE, rest, sizeof rest);
    torus_taylor_make(&t, part, wave, twice);
    for (int e = 0; e < 2 * n * TORUS_WIDE; e++)
        most = fmax(most, fabs(once[e] - twice[e]));
    assert_true(most < 1e-14);
    torus_taylor_done(&t);
    program_free(p);
}

static void test_a_law_that_changes_within_a_step_moves_all_as_two_shorter_steps_do(void **state)
{
    (void)state;
    moves_as_two_steps(40, 17, false);
}

static void test_a_change_that_moves_nothing_ends_none_of_the_next_one_s_reach(void **state)
{
    (void)state;
    for (int n = 4; n <= 40; n += 2)
        moves_as_two_steps(n, 1, true);
}

/* Four times the dofs and laws have four times the entries and the events: 16 would be where each
 * event moves all of them, or a step is a full matrix. */
static void test_a_turn_of_a_chain_of_sliders_costs_as_its_length(void **state)
{
    double work[2];

    (void)state;
    for (int i = 0; i < 2; i++) {
        struct program *p = chain_of_sliders(32 << (2 * i));
        struct torus_options opt = { .dofs_count = 0 };
        struct torus_solver s;
        struct torus_pieces *m;
        bool followed = true;

        two_loads(&s, p, &opt);
        assert_int_equal(torus_pieces_new(&s, 32, 0, &m, NULL), MODAL_OK);
        assert_non_null(m);
        for (int a = 0; a < 2; a++)               /* from rest, then on its way */
            assert_int_equal(torus_pieces_go(m, 32, 0, NULL, NULL, NULL, &followed, NULL),
                             MODAL_OK);
        assert_true(followed && torus_pieces_acted(m, p->laws - 1));
        work[i] = torus_pieces_work(m);
        torus_pieces_free(m);
        program_free(p);
    }
    assert_true(work[1] < 5 * work[0]);
}

/* Three masses, tones 1.5e-7 apart and a spring that holds twice as much as the structure: the
 * motion beats through some 600 combinations, each of weight for the others. */
static void test_twin_tones_of_a_strong_spring_are_balanced_whole(void **state)
{
    const double w[2] = { 123.920744, 123.920762 };
    struct program *p =
        lower("{\"structure\":{\"type\":\"matrices\","
              "\"M\":[[2.27e-3,0,0],[0,3.4e-3,0],[0,0,1.374e-3]],"
              "\"C\":[[0.0838,-0.0401,0],[-0.0401,0.164,-0.0812],[0,-0.0812,0.0985]],"
              "\"K\":[[1206,-875,0],[-875,2646,-1772],[0,-1772,1772]],"
              "\"dofs\":[\"x\",\"y\",\"z\"]},"
              "\"effects\":[{\"type\":\"cubic_spring\",\"dof\":\"x\",\"coefficient\":16.44}],"
              "\"excitation\":[{\"dof\":\"y\",\"k\":[1,0],\"cos\":3518,\"sin\":1710},"
              "{\"dof\":\"x\",\"k\":[0,1],\"cos\":4259}]}");
    struct torus_point point;

    (void)state;
    solve(p, w, 2, 1e-6, &point);
    assert_true(point.converged && point.count > 500);
    assert_true(point.error < 3e-4 * point.amplitude);      /* 1.7e-3 where 700 numbers were solved
                                                             * for and the rest followed them */
    torus_point_done(&point);
    program_free(p);
}

/* Two tones that beat, and a third that hardly moves anything: lines go on along the beat to orders
 * past ten.  They are right where the equation of motion holds at any instant.  Of more than was
 * asked for what no grid serves is left out anyway, and as little of the rest is no use. */
static void test_three_tones_are_balanced_to_the_orders_that_a_beat_of_two_has(void **state)
{
    const double w[3] = { 0.83, 0.8, 0.53 };
    struct program *p =
        lower("{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.2]],\"K\":[[1]],"
              "\"dofs\":[\"x\"]},"
              "\"effects\":[{\"type\":\"cubic_spring\",\"dof\":\"x\",\"coefficient\":1}],"
              "\"excitation\":[{\"dof\":\"x\",\"k\":[1,0,0],\"cos\":0.2},{\"dof\":\"x\","
              "\"k\":[0,1,0],\"cos\":0.2},{\"dof\":\"x\",\"k\":[0,0,1],\"cos\":1e-6}]}");
    struct torus_point point;

    (void)state;
    solve(p, w, 3, 1e-8, &point);
    assert_true(point.converged && point.error < 1e-4 * point.amplitude);
    assert_true(point.count < 150);       /* 183 change the error by a thirtieth of it */
    for (double t = 0; t < 2000; t += 7.3) {
        double x = 0, v = 0, a = 0;

        for (int m = 0; m < point.count; m++) {
            double s = torus_frequency(&point.tones, point.index[m]);
            double complex X = point.X[m] * cexp(I * s * t);

            x += creal(X), v -= s * cimag(X), a -= s * s * creal(X);
        }
        assert_float_equal(a + 0.2 * v + x + x * x * x,
                           0.2 * (cos(w[0] * t) + cos(w[1] * t)) + 1e-6 * cos(w[2] * t), 3e-4);
    }
    torus_point_done(&point);
    program_free(p);
}

/* Work of the stability of P's motion of all combinations of at most ORDER; *COUNT: how many. */
static double work_to_follow(const struct program *p, int order, int *count)
{
    const int dofs[] = { 0 };
    double spent[2];

    for (int i = 0; i < 2; i++) {
        struct torus_options opt = { .order = order, .dofs = dofs, .dofs_count = 1,
                                     .stability = i > 0 };
        struct torus_point point;

        assert_int_equal(torus_solve(p, W, 2, &opt, &point, NULL), MODAL_OK);
        assert_true(point.converged);
        assert_true(!opt.stability || point.stability.verdict == 1);
        *count = point.count;
        spent[i] = point.work.spent;
        torus_point_done(&point);
    }
    return spent[1] - spent[0];
}

/* What sums went through is in that work as they counted it, step by step, not as it was foreseen.
 * Order 16 has 3.7 times as many combinations as 8, of 1.9 times as many k of the slower tone.  An
 * unstable motion of tones 1 to 1.01 has some hundreds, and asks for 512 turns to be told. */
static void test_disturbances_cost_as_the_orders_of_the_slow_tone_not_as_the_combinations(
    void **state)
{
    struct program *p = lower(
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.3]],\"K\":[[1]],"
        "\"dofs\":[\"x\"]},\"effects\":[{\"type\":\"gap\",\"dof\":\"x\",\"to\":\"ground\","
        "\"stiffness\":1,\"clearance\":0.1}],"
        "\"excitation\":[{\"dof\":\"x\",\"k\":[1,0],\"cos\":0.2},"
        "{\"dof\":\"x\",\"k\":[0,1],\"cos\":0.2}]}");
    int few, many;
    double once = work_to_follow(p, 8, &few), twice = work_to_follow(p, 16, &many);

    (void)state;
    assert_true(many > 3.5 * few);
    assert_true(twice < 2 * once);
    program_free(p);
}

/* Nine times as stiff on one side, at 2 and 3 times what is about its 1.5: lines as Runge and Kutta
 * have them.  Of the last thousands of the tones' own lines explain all but a fortieth. */
static void test_a_motion_that_repeats_after_turns_of_a_tone_is_told_at_that_part(void **state)
{
    static const struct { int of; double first, second, damper, load[2], size[4]; } m[] = {
        { 2, 3, 4.8541019662496845, 0.1, { 1, 0.2 }, { 1.575116, 0.260838, 0.062591, 0.010192 } },
        { 2, 3, 1.8541019662496845, 0.1, { 1, 0.2 }, { 1.568993, 0.259033, 0.061492, 0.148872 } },
        { 3, 4.5, 1.8541, 0.03, { 1.5, 0.05 }, { 3.585040, 0.467385, 0.167006, 0.038023 } },
        { 3, 4.4, 1.8541, 0.03, { 1.5, 0.05 }, { 0.607589, 0.066493, 0.067832, 0.049834 } },
    };
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct torus_point point;
        struct program *p;
        char text[400];
        snprintf(text, sizeof text, "{\"structure\":{\"type\":\"chain\",\"masses\":[1],"
                 "\"springs\":[1,0],\"dampers\":[%g,0]},\"effects\":[{\"type\":\"gap\","
                 "\"dof\":\"x1\",\"stiffness\":8,\"clearance\":0}],\"excitation\":[{\"k\":[1,0],"
                 "\"dof\":\"x1\",\"cos\":%g},{\"dof\":\"x1\",\"k\":[0,1],\"cos\":%g}]}",
                 m[i].damper, m[i].load[0], m[i].load[1]);
        solve(p = lower(text), (double[]){ m[i].first, m[i].second }, 2, 1e-3, &point);
        assert_true(point.part.of == m[i].of
                    && point.tones.omega[0] == m[i].first / m[i].of);
        for (int k = 0; k < 4; k++)
            assert_float_equal(cabs(find(&point, 0, k < 3 ? k + 1 : 0, k == 3)), m[i].size[k],
                               3 * point.line + 1e-4);
        torus_point_done(&point);
        program_free(p);
    }
}

/* The last of those above beside a tone of three times the first, which moves next to nothing: a
 * third of both is one of the first, for of the other it would be a ninth. */
static void test_a_part_of_tones_of_a_common_period_is_told_as_one_of_a_tone(void **state)
{
    static const double size[] = { 0.607589, 0.066493, 0.067832 };
    struct program *p = lower(
        "{\"structure\":{\"type\":\"chain\",\"masses\":[1],\"springs\":[1,0],"
        "\"dampers\":[0.03,0]},\"effects\":[{\"type\":\"gap\",\"dof\":\"x1\","
        "\"stiffness\":8,\"clearance\":0}],\"excitation\":["
        "{\"dof\":\"x1\",\"k\":[0,1,0],\"cos\":1.5},{\"dof\":\"x1\",\"k\":[1,0,0],\"cos\":1e-7},"
        "{\"dof\":\"x1\",\"k\":[0,0,1],\"cos\":0.05}]}");
    const double tones[] = { 3 * 4.4, 4.4, 1.8541 };
    struct torus_point point;

    (void)state;
    solve(p, tones, 3, 1e-3, &point);
    assert_true(point.converged && point.part.tone == 1 && point.part.of == 3);
    assert_true(point.tones.omega[0] == tones[0] && point.tones.omega[1] == tones[1] / 3);
    for (int m = 0; m < point.count; m++)
        if (point.index[m].k[0] == 0 && point.index[m].k[2] == 0 && point.index[m].k[1] > 0
            && point.index[m].k[1] <= 3)
            assert_float_equal(cabs(point.X[m]), size[point.index[m].k[1] - 1],
                               3 * point.line + 1e-4);
    assert_int_equal(torus_order(point.index[1]), 1);
    torus_point_done(&point);
    program_free(p);
}

static void test_laws_that_are_no_function_of_a_path_are_refused(void **state)
{
    struct program *p = lower(
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"K\":[[1]],\"dofs\":[\"x\"]},"
        "\"effects\":[{\"type\":\"coulomb\",\"dof\":\"x\",\"limit\":1}],"
        "\"excitation\":[{\"dof\":\"x\",\"k\":[1,0],\"cos\":0.1}]}");
    struct torus_options opt = { .dofs_count = 0 };
    struct torus_point point;
    struct modal_error err = { 0 };

    (void)state;
    assert_int_equal(torus_solve(p, W, 2, &opt, &point, &err), MODAL_BAD_INPUT);
    assert_string_equal(err.field, "tones");
    program_free(p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_samples_along_a_line_are_the_motion_in_time),
        cmocka_unit_test(test_a_combination_is_told_with_its_positive_frequency),
        cmocka_unit_test(test_a_kink_between_samples_costs_no_second_order),
        cmocka_unit_test(test_a_linear_structure_answers_each_tone_by_its_receptance),
        cmocka_unit_test(test_a_cubic_spring_is_balanced_combination_by_combination),
        cmocka_unit_test(test_a_slider_that_never_slips_is_a_spring_of_undetermined_place),
        cmocka_unit_test(test_tones_are_one_where_small_whole_numbers_have_them_to_rounding),
        cmocka_unit_test(
            test_a_slider_that_holds_at_its_tones_own_phases_is_a_spring_to_the_error_asked_for),
        cmocka_unit_test(
            test_a_motion_of_a_common_period_is_told_at_lowest_combinations_and_begun_at),
        cmocka_unit_test(test_a_slider_under_tones_one_per_cent_apart_moves_as_marching_says),
        cmocka_unit_test(test_lines_that_leave_much_stand_only_where_all_disturbances_decay),
        cmocka_unit_test(
            test_a_law_that_changes_within_a_step_moves_all_as_two_shorter_steps_do),
        cmocka_unit_test(test_a_change_that_moves_nothing_ends_none_of_the_next_one_s_reach),
        cmocka_unit_test(test_a_turn_of_a_chain_of_sliders_costs_as_its_length),
        cmocka_unit_test(test_twin_tones_of_a_strong_spring_are_balanced_whole),
        cmocka_unit_test(
            test_a_load_that_a_record_tells_as_another_combination_moves_what_no_law_is_at),
        cmocka_unit_test(
            test_twin_tones_at_a_stop_move_as_one_tone_does_at_each_phase_of_their_beat),
        cmocka_unit_test(
            test_three_tones_are_balanced_to_the_orders_that_a_beat_of_two_has),
        cmocka_unit_test(
            test_disturbances_cost_as_the_orders_of_the_slow_tone_not_as_the_combinations),
        cmocka_unit_test(test_a_motion_that_repeats_after_turns_of_a_tone_is_told_at_that_part),
        cmocka_unit_test(test_a_part_of_tones_of_a_common_period_is_told_as_one_of_a_tone),
        cmocka_unit_test(test_laws_that_are_no_function_of_a_path_are_refused),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
