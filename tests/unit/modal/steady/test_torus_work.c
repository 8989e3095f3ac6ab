/* What a balance of several tones may cost: Newton's steps of torus_newton.c leave the work that
 * torus_set.c says an estimate of torus_error.c takes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include "base/json.h"
#include "modal/scene/program.h"
#include "modal/scene/scene.h"
#include "modal/steady/condense.h"
#include "modal/steady/torus_laws.h"
#include "modal/steady/torus_state.h"

enum { ORDER = 3 };

static const double W[2] = { 0.7, 1.1326237921249264 };

/* A mass on a spring and a slider under two tones. */
static const char *const SLIDER =
    "{\"structure\":{\"type\":\"chain\",\"masses\":[1],\"springs\":[1,0],\"dampers\":[0.5,0]},"
    "\"effects\":[{\"type\":\"friction\",\"dof\":\"x1\",\"stiffness\":0.2,\"limit\":0.1}],"
    "\"excitation\":[{\"dof\":\"x1\",\"k\":[1,0],\"cos\":0.45},"
    "{\"dof\":\"x1\",\"k\":[0,1],\"sin\":0.45}]}";

static const int ALL[] = { 0 };
static const struct torus_options OPTIONS = { .dofs = ALL, .dofs_count = 1, .target_error = 1e-6 };

/* A solver of P at rest, its work WORK, an estimate to follow. */
static void set_up(struct torus_solver *s, const struct program *p, struct budget *work)
{
    *s = (struct torus_solver) { .view = *p, .p = p, .opt = &OPTIONS, .work = work, .level = 1,
                                 .tones = torus_tones_of(W, 2), .tone = { .index = -1 },
                                 .told = true };
    assert_int_equal(torus_read_loads(s, NULL), MODAL_OK);
    for (int g = 0; g <= s->groups; g++)
        assert_int_equal(torus_new_group(s, g, NULL), MODAL_OK);
    s->q = condense_kept(s->condense[0]);
    assert_int_equal(torus_laws_new(p, &s->tones, condense_place(s->condense[0]), s->q, work,
                                    &s->laws, NULL), MODAL_OK);
    assert_int_equal(torus_grow_to_order(s, ORDER, NULL), MODAL_OK);
    assert_int_equal(torus_grid_for(s, 0, 0, &s->grid, NULL), MODAL_OK);
}

static void clean_up(struct torus_solver *s)
{
    for (int g = 0; g <= s->groups; g++)
        condense_free(s->condense[g]);
    for (int m = 0; m < s->count; m++)
        torus_linear_done(&s->linear[m]);
    torus_laws_free(s->laws);
    torus_grid_free(s->grid);
    free(s->linear), free(s->index), free(s->X), free(s->F), free(s->R), free(s->J);
    free(s->pivot), free(s->outer), free(s->outer_pivot);
}

static struct program *lower(void)
{
    cJSON *scene = cJSON_Parse(SLIDER);
    struct program *p = NULL;

    assert_int_equal(scene_lower(scene, NULL, &p, NULL), MODAL_OK);
    cJSON_Delete(scene);
    return p;
}

/* What s->X of a balance takes to tell its error; no step of the estimate's own is left. */
static double estimate(struct torus_solver *s)
{
    struct torus_candidate *list = malloc(TORUS_CANDIDATES_MOST * sizeof *list);
    double complex *room = malloc(TORUS_CANDIDATES_MOST * sizeof *room);
    struct torus_errors e = { 0 };
    double amplitude, before = s->work->spent;
    int count = 0;

    s->work->most = before;
    assert_int_equal(torus_estimate(s, list, &count, room, &e, &amplitude, NULL), MODAL_OK);
    free(list), free(room);
    return s->work->spent - before;
}

static void test_newton_s_steps_leave_the_work_that_the_estimate_after_them_takes(void **state)
{
    struct program *p = lower();
    struct torus_solver s;
    struct budget work = { 0 };
    double priced, took, step, all;
    bool converged;

    (void)state;
    set_up(&s, p, &work);
    assert_int_equal(torus_solve_set(&s, &converged, NULL), MODAL_OK);
    assert_true(converged && s.step < 1e-8);
    all = work.spent, step = all / s.iterations;
    priced = torus_estimate_work(&s);
    took = estimate(&s);
    assert_true(took < 1.2 * priced && took > 0.5 * priced);
    clean_up(&s);

    work = (struct budget) { .most = priced + 0.7 * all };
    set_up(&s, p, &work);
    assert_int_equal(torus_solve_set(&s, &converged, NULL), MODAL_OK);
    assert_true(converged && s.step > 1e-8 && s.step < 1e-2);
    assert_true(work.spent + priced < work.most + step);
    clean_up(&s);

    work = (struct budget) { .most = 0.5 * priced };      /* at rest forces cost less: a step */
    set_up(&s, p, &work);
    assert_int_equal(torus_solve_set(&s, &converged, NULL), MODAL_OK);
    assert_true(!converged && s.iterations <= 1 && work.spent < work.most);
    clean_up(&s);
    program_free(p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_newton_s_steps_leave_the_work_that_the_estimate_after_them_takes),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
