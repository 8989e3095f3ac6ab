/* Tests as well: torus_reach.c
 *
 * Strides of a march that takes many steps at once. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>
#include "base/json.h"
#include "modal/scene/program.h"
#include "modal/scene/scene.h"
#include "modal/steady/torus_maps.h"
#include "modal/steady/torus_pieces.h"

enum { N = 32, TURNS = 24 };
static const double W[2] = { 0.7, 1.1326237921249264 };

/* A mass of 1 on a slider under two tones, and the same in two parts, joined by a spring that holds
 * their relative motion below 1e-7. */
static const char *const ONE =
    "{\"structure\":{\"type\":\"chain\",\"masses\":[1],\"springs\":[1,0],\"dampers\":[0.1,0]},"
    "\"effects\":[{\"type\":\"friction\",\"dof\":\"x1\",\"stiffness\":0.5,\"limit\":0.3}],"
    "\"excitation\":[{\"dof\":\"x1\",\"k\":[1,0],\"cos\":0.45},"
    "{\"dof\":\"x1\",\"k\":[0,1],\"sin\":0.45}]}";
static const char *const JOINED =
    "{\"structure\":{\"type\":\"chain\",\"masses\":[0.7,0.3],\"springs\":[1,1e7,0],"
    "\"dampers\":[0.1,300,0]},"
    "\"effects\":[{\"type\":\"friction\",\"dof\":\"x1\",\"stiffness\":0.5,\"limit\":0.3}],"
    "\"excitation\":[{\"dof\":\"x1\",\"k\":[1,0],\"cos\":0.45},"
    "{\"dof\":\"x1\",\"k\":[0,1],\"sin\":0.45}]}";

static struct program *set_up(const char *text, const struct torus_options *opt,
                              struct torus_solver *s)
{
    cJSON *scene = cJSON_Parse(text);
    struct program *p = NULL;

    assert_int_equal(scene_lower(scene, NULL, &p, NULL), MODAL_OK);
    cJSON_Delete(scene);
    *s = (struct torus_solver) { .view = *p, .p = p, .opt = opt, .tones = torus_tones_of(W, 2),
                                 .tone = { .index = -1 }, .level = 1 };
    assert_int_equal(torus_read_loads(s, NULL), MODAL_OK);
    return p;
}

static void test_a_stride_of_32_steps_ends_where_32_steps_do(void **state)
{
    enum { LONGEST = 5 };
    const double steepest[] = { 0.5 };
    const struct torus_options opt = { .target_error = 1e-9 };
    struct torus_solver s;
    struct program *p = set_up(JOINED, &opt, &s);
    struct torus_taylor t;
    struct torus_maps a;
    double u[8] = { 0.3, 0.2999, -0.7, -0.71, 1, 0.2, 0, 0.4 }, to[8], once[8];
    double wave[4] = { 0.6, 0.8, -0.28, 0.96 }, most = 0;
    int key[] = { 0 };
    bool serves;

    (void)state;
    assert_int_equal(torus_taylor_init(&t, &s, TORUS_PAIR, steepest, &serves, NULL), MODAL_OK);
    assert_true(serves && torus_taylor_set_step(&t, 2e-5));
    assert_int_equal(torus_maps_init(&a, &t, 0, LONGEST, NULL), MODAL_OK);
    t.gain[0] = 0.5, t.level[0] = 0.07, t.level[1] = -0.2;
    torus_maps_find(&a, key);
    while (!torus_maps_has(&a, true))
        ;
    torus_maps_stride(&a, LONGEST, u, wave, once);
    /* d'' of the first mass: its forces over 0.7 */
    assert_float_equal(torus_maps_bend(&a, 0, u, wave) / (2e-5 * 2e-5),
                       (-u[0] - 0.1 * u[4] - 0.5 * u[0] - 0.07 - 1e7 * (u[0] - u[2])
                        - 300 * (u[4] - u[6]) + 0.45 * (wave[0] + wave[3])) / 0.7, 1e-2);
    for (int k = 0; k < 1 << LONGEST; k++) {
        torus_taylor_make(&t, u, wave, to);
        torus_maps_turn(&a, 0, wave);
        memcpy(u, to, sizeof u);
    }
    for (int e = 0; e < 8; e++)
        most = fmax(most, fabs(once[e] - u[e]) / (1 + fabs(u[e])));
    assert_true(most < 1e-11);
    torus_maps_done(&a);
    torus_taylor_done(&t);
    program_free(p);
}

/* Of the motion and of a disturbance beside it, from the step's begin and anew from within it. */
static void test_terms_by_a_product_are_those_of_the_recurrence(void **state)
{
    const double steepest[] = { 0.5 }, level[TORUS_PAIR] = { -0.11, 0.3 };
    const struct torus_options opt = { .target_error = 1e-9 };
    const double wave[4] = { 0.6, 0.8, -0.28, 0.96 };
    struct torus_solver s;
    struct program *p = set_up(ONE, &opt, &s);
    struct torus_taylor t;
    struct torus_maps a;
    double u[4] = { 0.3, 0.2, -0.7, 0.4 }, x[2][TORUS_PAIR], then[4], to[4];
    int key[] = { 0 };
    bool serves;

    (void)state;
    assert_int_equal(torus_taylor_init(&t, &s, TORUS_PAIR, steepest, &serves, NULL), MODAL_OK);
    assert_true(serves && torus_taylor_set_step(&t, 0.2));
    assert_int_equal(torus_maps_init(&a, &t, 0, 0, NULL), MODAL_OK);
    t.gain[0] = 0.5;
    torus_maps_find(&a, key);
    while (!torus_maps_has(&a, true))
        ;
    assert_true(torus_maps_tells(&a));
    for (int way = 0; way < 2; way++) {
        torus_taylor_set_line(&t, 0, 0.5, (double[]) { 0.07, -0.2 });
        if (way == 0)
            torus_taylor_make(&t, u, wave, to);
        else {
            torus_taylor_begin(&t, wave);
            torus_maps_tell(&a, u, wave);
        }
        /* 0.3 of the step on the law's level is another */
        torus_taylor_stop(&t, 0.3, then);
        torus_taylor_set_line(&t, 0, 0.5, level);
        if (way == 0) {
            memcpy(u, t.u, sizeof u);
            torus_taylor_make(&t, u, then, to);
            t.base = 0.3;
        } else
            torus_maps_tell(&a, t.u, then);
        for (int c = 0; c < TORUS_PAIR; c++) {
            double q[TORUS_TERMS_MOST + 1], rate;

            torus_taylor_sees(&t, 0, c, q);
            x[way][c] = torus_taylor_at(&t, q, 0.9, &rate);
        }
        memcpy(u, (double[]) { 0.3, 0.2, -0.7, 0.4 }, sizeof u);
    }
    for (int c = 0; c < TORUS_PAIR; c++) {
        assert_true(fabs(x[0][c]) > 0.1);
        assert_float_equal(x[1][c], x[0][c], 1e-14);
    }
    torus_maps_done(&a);
    torus_taylor_done(&t);
    program_free(p);
}

/* X of TURNS turns of TEXT's first dof, and what the last cost. */
static double follow(const char *text, double *x)
{
    const struct torus_options opt = { .target_error = 1e-9 };
    const int dof = 0;
    struct torus_solver s;
    struct program *p = set_up(text, &opt, &s);
    struct torus_pieces *m;
    bool followed = true;
    double work;

    assert_int_equal(torus_pieces_new(&s, N, 1, &m, NULL), MODAL_OK);
    assert_non_null(m);
    for (int t = 0; t < TURNS; t++)
        assert_int_equal(torus_pieces_go(m, 1, 1, &dof, x + t * N, NULL, &followed, NULL),
                         MODAL_OK);
    assert_true(followed && torus_pieces_acted(m, 0));
    work = torus_pieces_work(m);
    torus_pieces_free(m);
    program_free(p);
    return work;
}

/* Their relative motion is at most what 0.3 of the mass needs of a spring of 1e7; a turn has 1e5
 * steps of the joint's own vibration, and of a motion without it as few strides as of one mass. */
static void test_two_masses_that_a_stiff_spring_joins_move_as_one_and_cost_as_one(void **state)
{
    double one[N * TURNS], joined[N * TURNS], most = 0, largest = 0;
    double work = follow(ONE, one);

    (void)state;
    assert_true(follow(JOINED, joined) < 12 * work);
    for (int n = 0; n < N * TURNS; n++) {
        most = fmax(most, fabs(joined[n] - one[n]));
        largest = fmax(largest, fabs(one[n]));
    }
    assert_true(largest > 0.5);
    assert_true(most < 1e-6);
}

/* Without a record strides are longer than samples: both ways pass the same places. */
static void test_a_march_without_a_record_comes_to_the_same_place(void **state)
{
    const struct torus_options opt = { .target_error = 1e-9 };
    const int dof = 0;
    double x[2][N];

    (void)state;
    for (int way = 0; way < 2; way++) {
        struct torus_solver s;
        struct program *p = set_up(JOINED, &opt, &s);
        struct torus_pieces *m;
        bool followed = true;
        double room[N * TURNS];

        assert_int_equal(torus_pieces_new(&s, N, 1, &m, NULL), MODAL_OK);
        assert_non_null(m);
        assert_int_equal(torus_pieces_go(m, TURNS, way, &dof, room, NULL, &followed, NULL),
                         MODAL_OK);
        assert_int_equal(torus_pieces_go(m, 1, 1, &dof, x[way], NULL, &followed, NULL), MODAL_OK);
        assert_true(followed);
        torus_pieces_free(m);
        program_free(p);
    }
    for (int n = 0; n < N; n++)
        assert_float_equal(x[0][n], x[1][n], 1e-11);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_stride_of_32_steps_ends_where_32_steps_do),
        cmocka_unit_test(test_terms_by_a_product_are_those_of_the_recurrence),
        cmocka_unit_test(test_two_masses_that_a_stiff_spring_joins_move_as_one_and_cost_as_one),
        cmocka_unit_test(test_a_march_without_a_record_comes_to_the_same_place),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
