/* Steady states: known motions, derivatives against differences, errors as estimated. */
/* Tests as well: aft.c aft_derivative.c aft_events.c balance.c blocks.c by_cycle.c condense.c
 * condense_modes.c contact_friction.c cycle.c dry_friction.c estimate.c friction.c iterate.c
 * linear_answer.c local_law.c march.c pattern.c pieces.c point.c regularised_coulomb.c slider.c
 * solve.c sparse_lu.c stiffness.c ways.c */
#include "check.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/scene/collocation.h"
#include "modal/scene/scene.h"
#include "modal/steady/balance.h"
#include "modal/steady/condense.h"
#include "modal/steady/cycle.h"
#include "modal/steady/iterate.h"
#include "modal/steady/session.h"
#include "modal/steady/solve.h"
#include "modal/steady/stability.h"

static struct program *lower(const char *text)
{
    struct modal_error err = { 0 };
    struct program *p = NULL;
    cJSON *scene = NULL;

    if (json_read(text, strlen(text), &scene, &err) != MODAL_OK ||
        scene_lower(scene, NULL, &p, &err) != MODAL_OK)
        fail_msg("%s: %s", err.field, err.message);
    cJSON_Delete(scene);
    return p;
}

static void solve(const struct program *p, const struct steady_options *opt, struct steady **s,
                  struct steady_point *point)
{
    struct modal_error err = { 0 };

    if (steady_new(p, opt, s, &err) != MODAL_OK ||
        steady_solve(*s, p->omega, NULL, point, &err) != MODAL_OK)
        fail_msg("%s: %s", err.field, err.message);
}

/* The sample problem of Cameron and Griffin (1989), (8). */
static const char *const friction_damper =
    "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.02]],\"K\":[[0.75]]},"
    "\"omega\":0.25,\"effects\":[{\"type\":\"friction\",\"dof\":\"x1\",\"stiffness\":0.25,"
    "\"limit\":0.25}],\"excitation\":[{\"dof\":\"x1\",\"k\":2,\"sin\":0.75},{\"dof\":\"x1\","
    "\"k\":3,\"sin\":0.5},{\"dof\":\"x1\",\"k\":4,\"sin\":0.375}]}";

/* Twice the two-sided coefficients of the event-exact reference (34 digits), X_0 .. X_6. */
static const double complex friction_exact[] = {
    0.041499106176073753022,
    2 * (0.040552896013259665892 + 0.030127090852996863751 * I),
    2 * (-0.028686839542598408468 - 0.65864493572785270346 * I),
    2 * (-0.3235735040449855171 - 0.89198369316520571738 * I),
    2 * (-0.44146451736077982575 + 0.85497276871755921745 * I),
    2 * (-0.016520196744539577337 - 0.016299827133257139888 * I),
    2 * (-0.0059682387401277418552 + 0.00072203930596272105058 * I)
};

/* Harmonics fall as k^-4, so that truncation at H leaves an error of order H^-4 in each: 1e-6 at H
 * = 64, 1e-9 at 256. */
TEST(friction_with_located_events_converges_with_the_truncation_alone)
{
    struct program *p = lower(friction_damper);
    static const struct { int H; double tolerance; } rows[] = { { 64, 2e-6 }, { 256, 4e-9 } };

    for (int r = 0; r < 2; r++) {
        struct steady_options opt = { .harmonics = rows[r].H };
        struct steady_point point;
        struct steady *s;

        solve(p, &opt, &s, &point);
        CHECK(point.converged);
        for (int k = 0; k <= 6; k++)
            CHECK_NEAR(cabs(point.X[k] - friction_exact[k]), 0, rows[r].tolerance);
        steady_point_done(&point);
        steady_free(s);
    }
    program_free(p);
}

/*
 * A round shaft without mass on pinned ends, a disk M at its middle, shaken in space along z by F
 * cos(w t): z = F cos(w t)/(48 EI/L^3
 * - w^2 M), y = 0.  Axes that turn at 2 w see (y, z) = z (sin 2wt, cos 2wt): half of it at w and at
 * 3 w each.
 */
TEST(a_load_fixed_in_space_is_seen_from_turning_axes)
{
    struct program *p = lower("{\"structure\":{\"type\":\"shaft\",\"length\":1.1,\"EI\":"
                              "[98.9,98.9],\"disk\":{\"mass\":5.3},\"speed\":14.6,"
                              "\"model\":\"massless\"},\"omega\":7.3,\"excitation\":"
                              "[{\"dof\":\"z1\",\"k\":1,\"cos\":2.7,\"frame\":\"fixed\"}],"
                              "\"effects\":[{\"type\":\"bearing\",\"at\":\"left\","
                              "\"transverse\":1e12},{\"type\":\"bearing\",\"at\":\"right\","
                              "\"transverse\":1e12}]}");
    double half = 2.7 / (48 * 98.9 / (1.1 * 1.1 * 1.1) - 7.3 * 7.3 * 5.3) / 2;
    struct steady_options opt = { .harmonics = 4 };
    struct steady_point point;
    struct steady *s;

    CHECK(strcmp(p->dofs[0], "y1") == 0 && strcmp(p->dofs[1], "z1") == 0);
    solve(p, &opt, &s, &point);
    for (int k = 0; k <= 4; k++) {   /* the supports' 1e12 N/m against the shaft's 4e3 */
        double complex y[5], z[5];

        CHECK(steady_recover(s, &point, 0, y, NULL) == MODAL_OK &&
              steady_recover(s, &point, 1, z, NULL) == MODAL_OK);
        CHECK_NEAR(cabs(y[k] - (k == 1 || k == 3 ? -I * half : 0)), 0, 1e-7 * half);
        CHECK_NEAR(cabs(z[k] - (k == 1 || k == 3 ? half : 0)), 0, 1e-7 * half);
    }
    steady_point_done(&point);
    steady_free(s);
    p->omega = 7;                                      /* 14.6 is no whole multiple of it */
    struct modal_error err;
    CHECK(steady_new(p, &opt, &s, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "excitation[0].frame");
    program_free(p);
}

/* (c - w^2) etc.: a linear oscillator's X = F / (k - w^2 m + i w c), one solve, nothing evaluated.
 */
TEST(a_linear_scene_is_its_closed_form_without_iterations)
{
    struct program *p = lower("{\"structure\":{\"type\":\"matrices\",\"M\":[[2.385]],\"C\":"
                              "[[0.31]],\"K\":[[7.7]]},\"omega\":1.37,\"excitation\":"
                              "[{\"dof\":\"x1\",\"k\":2,\"cos\":0.75,\"sin\":-1.9},"
                              "{\"dof\":\"x1\",\"k\":0,\"cos\":3.1}]}");
    double w = 2 * 1.37;
    double complex exact = (0.75 + 1.9 * I) / (7.7 - w * w * 2.385 + I * w * 0.31), X[3];
    struct steady_options opt = { 0 };
    struct steady_point point;
    struct steady *s;

    solve(p, &opt, &s, &point);
    CHECK(point.converged && point.iterations == 0 && point.ffts == 0);
    CHECK(steady_recover(s, &point, 0, X, NULL) == MODAL_OK);
    CHECK_NEAR(cabs(X[2] - exact), 0, 1e-14 * cabs(exact));
    CHECK_NEAR(creal(X[0]), 3.1 / 7.7, 1e-15);
    CHECK(X[1] == 0);
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}

static void residual_of_friction(const char *text, int H, double *rms, double *most)
{
    struct program *p = lower(text);
    struct steady_options opt = { .harmonics = H };
    struct steady_point point;
    struct steady *s;

    solve(p, &opt, &s, &point);
    CHECK(point.converged && point.followed);
    *rms = point.tail_rms;
    *most = point.tail_max;
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}

/* A body that never stops turns twice a period, half a period apart: its friction is a square wave,
 * what H of its harmonics lack has the mean square sum_{odd k > H} (4 F / pi k)^2 / 2, and is
 * nowhere more than the jump's half.  Instants on 8192 samples: 1e-3. */
TEST(rigid_friction_leaves_the_square_waves_tail_of_the_equation_of_motion)
{
    static const char *const text = "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":"
                                    "[[0.02]],\"K\":[[0.75]]},\"omega\":0.5,\"effects\":"
                                    "[{\"type\":\"coulomb\",\"dof\":\"x1\",\"limit\":0.35}],"
                                    "\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":0.9}]}";

    for (int H = 16; H <= 256; H *= 4) {
        double rms, most, squares = 0;

        for (int k = H + 1; k < 4000000; k += 2)
            squares += pow(4 * 0.35 / (M_PI * k), 2) / 2;
        residual_of_friction(text, H, &rms, &most);
        CHECK_NEAR(rms, sqrt(squares), 2e-3 * sqrt(squares));
        CHECK(most > 0.3 && most <= 0.35 * 1.001);
    }
}

/* Held fast, friction is the load itself, which one harmonic holds; with stops between two bodies
 * the rms falls as H^-1/2. */
TEST(rigid_friction_that_holds_balances_the_load)
{
    static const char *const held = "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":"
                                    "[[0.02]],\"K\":[[0.75]]},\"omega\":0.5,\"effects\":"
                                    "[{\"type\":\"coulomb\",\"dof\":\"x1\",\"limit\":0.35}],"
                                    "\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":0.3}]}";
    static const char *const stops =
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1,0],[0,1]],\"C\":[[0.1,0],[0,0.1]],\"K\":"
        "[[2,-1],[-1,2]]},\"omega\":0.3,\"effects\":[{\"type\":\"coulomb\",\"dof\":\"x1\","
        "\"to\":\"x2\",\"limit\":0.3}],\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":0.9}]}";
    double rms, most, finer;

    residual_of_friction(held, 8, &rms, &most);
    CHECK(rms < 1e-12 && most < 1e-12);
    residual_of_friction(stops, 64, &rms, &most);
    residual_of_friction(stops, 256, &finer, &most);
    CHECK(rms > 0 && most <= 2 * 0.3);
    CHECK_NEAR(finer / rms, 0.5, 0.1);
}

/* Dampers take no more power than loads give: rigid friction takes some, a gap none.  With 8
 * harmonics corrections for those left out run away here, to 1e44 m. */
TEST(a_motion_through_rigid_friction_takes_no_more_power_than_its_load_gives)
{
    static const double C[5][5] = { { 0.292, -0.237, 0, 0, 0 },
                                    { -0.237, 0.272, -0.0221, 0, 0 },
                                    { 0, -0.0221, 0.0498, -0.00747, 0 },
                                    { 0, 0, -0.00747, 0.315, -0.261 },
                                    { 0, 0, 0, -0.261, 0.308 } };
    struct program *p = lower(
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1.35,0,0,0,0],"
        "[0,0.454,0,0,0],[0,0,0.704,0,0],[0,0,0,1.64,0],[0,0,0,0,1.65]],\"C\":"
        "[[0.292,-0.237,0,0,0],[-0.237,0.272,-0.0221,0,0],[0,-0.0221,0.0498,-0.00747,0],"
        "[0,0,-0.00747,0.315,-0.261],[0,0,0,-0.261,0.308]],\"K\":[[177,-166,0,0,0],"
        "[-166,181,-15.5,0,0],[0,-15.5,20.7,-5.22,0],[0,0,-5.22,187,-182],[0,0,0,-182,182]]},"
        "\"effects\":[{\"type\":\"coulomb\",\"dof\":\"x5\",\"to\":\"x2\",\"limit\":0.192},"
        "{\"type\":\"gap\",\"dof\":\"x3\",\"stiffness\":352,\"clearance\":0.00137,"
        "\"both_sides\":false}],\"excitation\":[{\"dof\":\"x3\",\"k\":1,\"cos\":5}],"
        "\"omega\":0.817}");
    struct steady_options opt = { .harmonics = 8, .method = STEADY_NEWTON };
    struct steady_point point;
    struct modal_error err;
    struct steady *s;
    double complex X[5][9];
    double taken = 0, given;

    solve(p, &opt, &s, &point);
    CHECK(point.converged);
    for (int i = 0; i < 5; i++)
        CHECK(steady_recover(s, &point, i, X[i], &err) == MODAL_OK);
    for (int k = 1; k <= 8; k++)
        for (int i = 0; i < 5; i++)
            for (int j = 0; j < 5; j++)
                taken += pow(k * p->omega, 2) / 2 * C[i][j] * creal(conj(X[i][k]) * X[j][k]);
    given = 5 * creal(I * p->omega * X[2][1]) / 2;
    CHECK(taken > 0 && taken <= given);
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}

/* Corrections for the harmonics left out that come in slowly leave their last steps' worth to go.
 * The first harmonic is that of friction regularised at 1e-4 m/s, 256 harmonics, which is 1e-4 m
 * from where 1e-3 m/s has it: as far from rigid friction as a ninth of that. */
TEST(corrections_that_come_in_slowly_count_as_error)
{
    struct program *p = lower(
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[0.505,0],[0,0.337]],\"C\":"
        "[[0.291,-0.291],[-0.291,0.291]],\"K\":[[242,-242],[-242,242]]},"
        "\"effects\":[{\"type\":\"coulomb\",\"dof\":\"x1\",\"limit\":1.84},"
        "{\"type\":\"coulomb\",\"dof\":\"x2\",\"to\":\"x1\",\"limit\":0.355},"
        "{\"type\":\"gap\",\"dof\":\"x1\",\"stiffness\":193,\"clearance\":0.0154},"
        "{\"type\":\"cubic_spring\",\"dof\":\"x2\",\"coefficient\":242}],"
        "\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":5}],\"omega\":26.6}");
    struct steady_options opt = { .harmonics = 8, .method = STEADY_NEWTON };
    struct steady_point point;
    struct modal_error err;
    struct steady *s;
    double complex X[9];

    solve(p, &opt, &s, &point);
    CHECK(point.converged);
    CHECK(steady_recover(s, &point, 1, X, &err) == MODAL_OK);
    CHECK(cabs(X[1] - (-0.0096999 + 0.0022926 * I)) <= point.error + 1e-4 / 9);
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}

/*
 * What follows a motion through rigid friction is work as any other: each of CYCLE_SAMPLES instants
 * is reached by a step that asks the law at COLLOCATION_STAGES nodes once at least.  A body of 1e-8
 * kg that a slider of 1e30 N holds beside another law never repeats to rounding: half the work
 * allowed goes into following it, and the balance ends within the whole.
 */
TEST(steps_through_rigid_friction_count_as_work_and_end_with_it)
{
    static const char *const slips =
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.02]],\"K\":[[0.75]]},"
        "\"omega\":0.5,\"effects\":[{\"type\":\"coulomb\",\"dof\":\"x1\",\"limit\":0.35}],"
        "\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":0.9}]}";
    static const char *const never =
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1e-8,0],[0,1]],\"C\":[[1e-30,0],[0,0.1]],"
        "\"K\":[[7.7,-1],[-1,0.1]]},\"omega\":0.001,\"effects\":[{\"type\":\"friction\","
        "\"dof\":\"x1\",\"to\":\"x2\",\"stiffness\":10,\"limit\":7.7},{\"type\":\"coulomb\","
        "\"dof\":\"x1\",\"limit\":1e30},{\"type\":\"regularised_coulomb\",\"dof\":\"x1\","
        "\"limit\":3,\"velocity\":1}],\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":0.5},"
        "{\"dof\":\"x2\",\"k\":2,\"sin\":-1}]}";
    const char *const texts[] = { slips, never };

    for (int r = 0; r < 2; r++) {
        struct program *p = lower(texts[r]);
        struct steady_options opt = { .harmonics = 5 };
        struct steady_point point;
        struct steady *s;

        solve(p, &opt, &s, &point);
        CHECK(point.converged == (r == 0));
        CHECK(point.work.spent >= (double)CYCLE_SAMPLES * COLLOCATION_STAGES * BUDGET_SAMPLE);
        CHECK(r == 0 || point.work.spent >= point.work.most / 2);
        CHECK(point.work.spent <= 1.05 * point.work.most);
        steady_point_done(&point);
        steady_free(s);
        program_free(p);
    }
}

/*
 * The map of a verdict is work too: of a cubic spring at least 32 steps, three matrices each, the
 * law asked once in each.  A damper of 1e30 N s/m on 1e-30 kg takes a hundred squarings and more in
 * every one of the 16384 steps that it is given: the work allowed ends them.
 */
TEST(the_maps_of_a_verdict_count_as_work_and_end_with_it)
{
    static const char *const smooth =
        "{\"structure\":{\"type\":\"chain\",\"masses\":[1],\"springs\":[1,0],"
        "\"dampers\":[0.1,0]},\"omega\":0.7,\"effects\":[{\"type\":\"cubic_spring\","
        "\"dof\":\"x1\",\"coefficient\":0.3}],\"excitation\":[{\"dof\":\"x1\",\"k\":1,"
        "\"cos\":0.5}]}";
    static const char *const stiff =
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1e-30,0],[0,1]],\"C\":[[1e30,0],"
        "[0,0.1]],\"K\":[[0.001,-1],[-1,0]]},\"omega\":3,\"effects\":[{\"type\":"
        "\"contact_friction\",\"normal\":\"x1\",\"tangential\":\"x2\",\"normal_stiffness\":2,"
        "\"preload\":1e-30,\"tangential_stiffness\":1,\"mu\":0.3},{\"type\":\"cubic_spring\","
        "\"dof\":\"x2\",\"coefficient\":1e8}],\"excitation\":[{\"dof\":\"x1\",\"k\":1,"
        "\"cos\":1},{\"dof\":\"x2\",\"k\":2,\"sin\":0.001}]}";
    const char *const texts[] = { smooth, stiff };

    for (int r = 0; r < 2; r++) {
        struct program *p = lower(texts[r]);
        struct steady_options opt = { .harmonics = 5 };
        struct steady_point point;
        struct stability st;
        struct steady *s;

        solve(p, &opt, &s, &point);
        CHECK(point.converged && stability_of(s, &point, &st, NULL) == MODAL_OK);
        CHECK(st.work.spent >= 32 * 3 * BUDGET_SAMPLE && st.work.spent <= 1.05 * st.work.most);
        CHECK(r == 1 || st.verdict == STABILITY_STABLE);
        stability_done(&st);
        steady_point_done(&point);
        steady_free(s);
        program_free(p);
    }
}

static void drop_points(struct steady_point *points, int count, struct steady_point *known)
{
    for (int i = 0; i < count; i++)
        steady_point_done(&points[i]);
    free(points);
    steady_point_done(known);
}

static const char *const three_motions =
    "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.05]],\"K\":[[1]]},"
    "\"omega\":1.5,\"effects\":[{\"type\":\"cubic_spring\",\"dof\":\"x1\",\"coefficient\":1}],"
    "\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":0.3}]}";

/* A hardening spring past its resonance has three motions; work for none but the one known ends the
 * search for others. */
TEST(a_search_for_other_motions_that_its_work_ends_says_so)
{
    for (int r = 0; r < 2; r++) {
        struct program *p = lower(three_motions);
        struct steady_options opt = { .harmonics = 5 };
        struct steady_point known, *points;
        struct steady *s;
        int count = 0;

        solve(p, &opt, &s, &known);
        CHECK(known.converged);
        if (r == 1)
            s->budget.most = 2 * s->budget.spent;
        CHECK(steady_solve_all(s, p->omega, NULL, &known, &points, &count, NULL) == MODAL_OK);
        CHECK(points[0].unsought == (r == 1) && (r == 1 || count == 3));
        CHECK(steady_work(s)->spent > known.work.spent);         /* one budget goes on */
        drop_points(points, count, &known);
        steady_free(s);
        program_free(p);
    }
}

/* The same spring with 31 harmonics: what is left after nine tenths of the budget would not take a
 * search at 16 of them to its end, which the whole of it takes; at 8 it finds all three. */
TEST(a_search_takes_as_few_harmonics_as_what_is_left_of_the_work_asks_for)
{
    struct program *p = lower(three_motions);
    struct steady_options opt = { .harmonics = 31 };
    struct steady_point known, *points;
    struct steady *s;
    int count = 0;

    solve(p, &opt, &s, &known);
    CHECK(known.converged);
    s->budget.spent = 0.9 * s->budget.most;
    CHECK(steady_solve_all(s, p->omega, NULL, &known, &points, &count, NULL) == MODAL_OK);
    CHECK(!points[0].unsought && count == 3);
    drop_points(points, count, &known);
    steady_free(s);
    program_free(p);
}

/* Forty stops in a row: 240 starts of thirty steps each would cost billions of operations. */
TEST(a_search_beside_a_motion_that_was_cheap_is_as_cheap_as_one_of_few_dofs)
{
    enum { STOPS = 40 };
    char text[8192], *at = text;
    struct steady_options opt = { .harmonics = 5 };
    struct steady_point known, *points;
    struct program *p;
    struct steady *s;
    double before;
    int count = 0;

    at += sprintf(at, "{\"omega\":0.3,\"structure\":{\"type\":\"chain\",\"masses\":[1");
    for (int i = 1; i < STOPS; i++)
        at += sprintf(at, ",1");
    for (int d = 0; d < 2; d++) {
        at += sprintf(at, "],\"%s\":[1", d == 0 ? "springs" : "dampers");
        for (int i = 0; i < STOPS; i++)
            at += sprintf(at, d == 0 ? ",1" : ",0.1");
    }
    at += sprintf(at, "]},\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":0.5}],\"effects\":[");
    for (int i = 1; i <= STOPS; i++)
        at += sprintf(at, "%s{\"type\":\"gap\",\"dof\":\"x%d\",\"stiffness\":1,\"clearance\":0.3}",
                      i > 1 ? "," : "", i);
    sprintf(at, "]}");
    p = lower(text);
    solve(p, &opt, &s, &known);
    before = s->budget.spent;
    CHECK(known.converged && before < steady_least_work() / 4);
    CHECK(s->budget.most > 4 * steady_least_work());
    CHECK(steady_solve_all(s, p->omega, NULL, &known, &points, &count, NULL) == MODAL_OK);
    CHECK(points[0].unsought);
    /* a half, the step that it ends in, and errors of what is found */
    CHECK(steady_work(s)->spent - before < 0.75 * steady_least_work());
    drop_points(points, count, &known);
    steady_free(s);
    program_free(p);
}

/* What an answer has left after its verdict is for the search; verdicts that took as much as one
 * may are of what is left. */
TEST(a_verdict_leaves_an_answer_what_it_had_left_once)
{
    struct program *p = lower(friction_damper);
    struct steady_options opt = { .harmonics = 5 };
    struct steady_point point;
    struct steady *s;
    struct stability st;

    solve(p, &opt, &s, &point);
    for (int r = 0; r < 2; r++) {
        double left = s->budget.most - s->budget.spent, now;

        s->budget.apart = r == 1 ? s->budget.most : 0;
        CHECK(stability_of(s, &point, &st, NULL) == MODAL_OK);
        now = s->budget.most - s->budget.spent;
        CHECK(st.work.spent > 0 && st.verdict == STABILITY_STABLE);
        CHECK(r == 0 ? fabs(now - left) < 1 : now < left - st.work.spent + 1);
        stability_done(&st);
    }
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}

TEST(what_was_found_is_judged_though_all_is_spent_until_verdicts_took_as_much_as_one_may)
{
    struct program *p = lower(friction_damper);
    struct steady_options opt = { .harmonics = 5 };
    struct steady_point point;
    struct stability first, next;
    struct steady *s;

    solve(p, &opt, &s, &point);
    CHECK(stability_of(s, &point, &first, NULL) == MODAL_OK);
    s->budget.spent = s->budget.most;
    CHECK(stability_pays(steady_work(s), &first));
    CHECK(stability_of(s, &point, &next, NULL) == MODAL_OK && next.verdict == STABILITY_STABLE);
    s->budget.spent = s->budget.most;
    s->budget.apart = first.work.most;
    CHECK(!stability_pays(steady_work(s), &first));
    s->budget.spent = 0;                                /* nor is this beside the answer */
    CHECK(stability_pays(steady_work(s), &first));
    stability_done(&first);
    stability_done(&next);
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}

/* A motion at rest that is known is none of those of a balance, which is solved and searched at the
 * cost of both. */
TEST(a_search_beside_a_motion_at_rest_counts_its_own_first_answer)
{
    static const char *const text =
        "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.05]],\"K\":[[1]]},"
        "\"omega\":1.5,\"effects\":[{\"type\":\"gap\",\"dof\":\"x1\",\"stiffness\":1,"
        "\"clearance\":3}],\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":0.3}]}";
    struct program *p = lower(text);
    struct steady_options opt = { .harmonics = 5 };
    struct steady_point known, *points;
    struct steady *s;
    double all = 0, before = 0;
    int count;

    for (int r = 0; r < 2; r++) {
        solve(p, &opt, &s, &known);
        CHECK(known.converged);
        known.linear = s->c;                            /* as of many laws at rest */
        if (r == 1)
            before = s->budget.spent = 0.3 * s->budget.most;
        CHECK(steady_solve_all(s, p->omega, NULL, r == 1 ? &known : NULL, &points, &count, NULL)
              == MODAL_OK);
        if (r == 0)
            all = points[0].work.spent;
        CHECK(all > 0 && (r == 0 || fabs(steady_work(s)->spent - before - all) < 0.01 * all));
        drop_points(points, count, &known);
        steady_free(s);
    }
    program_free(p);
}

/* Masses that nothing holds rub on each other: where they are is of no law, by way of events and,
 * beside a stop between them, by balances of more and more harmonics alike. */
TEST(rigid_friction_within_a_free_body_leaves_its_mean_undetermined)
{
    static const char *const body =
        "{\"structure\":{\"type\":\"chain\",\"masses\":[1,1,1],\"springs\":[%s,1,1,0],"
        "\"dampers\":[0,0.02,0.02,0]},\"omega\":0.9,\"effects\":[{\"type\":\"coulomb\","
        "\"dof\":\"x1\",\"to\":\"x2\",\"limit\":0.02}%s],"
        "\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":1}]}";
    static const char *const stop =
        ",{\"type\":\"gap\",\"dof\":\"x1\",\"to\":\"x2\",\"stiffness\":2,\"clearance\":0.2}";

    for (int r = 0; r < 4; r++) {
        struct steady_options opt = { .harmonics = 9 };
        struct steady_point point;
        struct program *p;
        struct steady *s;
        char text[1024];

        snprintf(text, sizeof text, body, r < 2 ? "0" : "0.1", r % 2 == 0 ? "" : stop);
        p = lower(text);
        solve(p, &opt, &s, &point);
        CHECK(point.converged && point.open == (r < 2));
        CHECK(r % 2 == 0 ? strcmp(point.method, "events") == 0
                         : strcmp(point.method, "events") != 0);
        steady_point_done(&point);
        steady_free(s);
        program_free(p);
    }
}

/* Springs hold the masses, and so does rigid friction that never slips: where it sticks is of the
 * past, and told as its offset. */
TEST(rigid_friction_that_never_slips_leaves_no_mean_to_what_slips)
{
    struct program *p = lower(
        "{\"structure\":{\"type\":\"chain\",\"masses\":[1,1,1],\"springs\":[0.1,1,1,0],"
        "\"dampers\":[0,0.02,0.02,0]},\"omega\":0.9,\"effects\":[{\"type\":\"coulomb\","
        "\"dof\":\"x3\",\"limit\":50}],\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":1}]}");
    struct steady_options opt = { .harmonics = 9 };
    struct steady_point point;
    struct steady *s;

    solve(p, &opt, &s, &point);
    CHECK(point.converged && strcmp(point.method, "events") == 0);
    CHECK(point.undetermined[0] && !point.open);
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}

/* Two masses, K and C full; R_k = (K - k^2 w^2 M + i k w C) X_k - P_k multiplied out here from the
 * X reported. */
TEST(a_linear_scene_reports_the_residual_of_its_equation_of_motion)
{
    struct program *p =
        lower("{\"structure\":{\"type\":\"matrices\",\"M\":[[2,0.1],[0.1,3]],\"C\":[[0.3,-0.1],"
              "[-0.1,0.2]],\"K\":[[70000.3,-69999.1],[-69999.1,70001.7]]},\"omega\":0.7,"
              "\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":1.1},{\"dof\":\"x2\",\"k\":3,"
              "\"sin\":0.3},{\"dof\":\"x2\",\"k\":0,\"cos\":0.9}]}");
    const double M[] = { 2, 0.1, 0.1, 3 }, C[] = { 0.3, -0.1, -0.1, 0.2 },
                 K[] = { 70000.3, -69999.1, -69999.1, 70001.7 };
    const double complex P[4][2] = { { 0, 0.9 }, { 1.1, 0 }, { 0, 0 }, { 0, -0.3 * I } };
    double complex X[2][4];
    double most = 0, squares = 0, peak[2] = { 0 };
    struct steady_options opt = { 0 };
    struct steady_point point;
    struct steady *s;

    solve(p, &opt, &s, &point);
    CHECK(point.converged && point.H == 3 && point.ffts == 0);
    for (int i = 0; i < 2; i++)
        CHECK(steady_recover(s, &point, i, X[i], NULL) == MODAL_OK);
    for (int k = 0; k <= 3; k++)
        for (int i = 0; i < 2; i++) {
            double complex R = -P[k][i];

            for (int j = 0; j < 2; j++)
                R += (K[2 * i + j] - 0.49 * k * k * M[2 * i + j] + I * 0.7 * k * C[2 * i + j]) *
                     X[j][k];
            most = fmax(most, cabs(R));
            squares += pow(cabs(R), 2) / (k == 0 ? 1 : 2);
            peak[i] += cabs(R);
        }
    /* either sum of products of 7e4 and X rounds by a few epsilon of them */
    double rounding = 16 * 2.2e-16 * 7e4 * 4 * fmax(cabs(X[0][0]), cabs(X[0][1]));
    CHECK(most > 0 && point.residual > 0 && point.tail_rms > 0 && point.tail_max > 0);
    CHECK_NEAR(point.residual * 1.1, most, rounding);
    CHECK_NEAR(point.tail_rms, sqrt(squares), rounding);
    CHECK_NEAR(point.tail_max, fmax(peak[0], peak[1]), rounding);
    CHECK_NEAR(point.load_max, 1.2, 1e-15);
    steady_point_done(&point);

    /* against three times the load, twice the load is left */
    struct condense *c = steady_condense(s);
    struct condense_residual left;
    CHECK(steady_solve(s, 0.7, NULL, &point, NULL) == MODAL_OK);
    condense_set_level(c, 3);
    CHECK(condense_residual(c, point.X, &left, NULL) == MODAL_OK);
    CHECK_NEAR(left.relative, 2. / 3, 1e-9);
    CHECK_NEAR(left.rms, 2 * sqrt(0.81 + 1.21 / 2 + 0.09 / 2), 1e-9);
    CHECK_NEAR(left.most, 2.4, 1e-9);
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}

static uint64_t seed = 2385;
static double uniform(double a, double b)
{
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return a + (b - a) * (double)(seed >> 11) / 9007199254740992.0;
}

/* Every law's dF/dX against eighth-order central differences of F; h^8 and rounding balance near
 * 1e-9 of the slope. */
static double derivative_error(const char *effects, int H, int N, double amplitude)
{
    static const double weight[] = { 4.0 / 5, -1.0 / 5, 4.0 / 105, -1.0 / 280 };
    char text[1024];
    struct modal_error err = { 0 };
    struct condense *c;
    struct balance *b;
    struct program *p;
    double worst = 0, scale = 0, *column, *J;
    double complex *X;

    snprintf(text, sizeof text,
             "{\"structure\":{\"type\":\"matrices\",\"M\":[[1,0],[0,2]],\"C\":[[0.1,0],[0,0.1]],"
             "\"K\":[[1,-0.3],[-0.3,2]]},\"omega\":0.7,\"effects\":[%s],\"excitation\":"
             "[{\"dof\":\"x1\",\"k\":1,\"cos\":1}]}",
             effects);
    p = lower(text);
    if (condense_new(p, false, &c, &err) != MODAL_OK ||
        balance_new(p, c, H, N, true, &b, &err) != MODAL_OK ||
        balance_set(b, 0.7, 1, &err) != MODAL_OK)
        fail_msg("%s", err.message);
    X = calloc((size_t)b->q * ((size_t)H + 1), sizeof *X);
    column = calloc((size_t)b->order, sizeof *column);
    J = malloc((size_t)b->order * (size_t)b->order * sizeof *J);
    for (int i = 0; i < b->q; i++)
        for (int k = 0; k <= H; k++)
            X[i * (H + 1) + k] = amplitude * pow(k + 1, -2.5) *
                                 (uniform(-1, 1) + (k > 0 ? I * uniform(-1, 1) : 0));
    CHECK(balance_residual(b, X, true, &err) == MODAL_OK);
    memcpy(J, b->J, (size_t)b->order * (size_t)b->order * sizeof *J);
    for (int e = 0; e < b->order; e++) {
        int n = 2 * H + 1, i = e / n, r = e % n;
        double complex *x = &X[i * (H + 1) + (r + 1) / 2], kept = *x,
                       unit = r > 0 && r % 2 == 0 ? I : 1;
        double h = 1e-3 * amplitude / 16;

        memset(column, 0, (size_t)b->order * sizeof *column);
        for (int m = 1; m <= 4; m++)
            for (int sign = -1; sign <= 1; sign += 2) {
                *x = kept + sign * m * h * unit;
                CHECK(balance_residual(b, X, false, &err) == MODAL_OK);
                for (int o = 0; o < b->order; o++)
                    column[o] += sign * weight[m - 1] * b->R[o] / h;
            }
        *x = kept;
        for (int o = 0; o < b->order; o++) {
            worst = fmax(worst, fabs(column[o] - J[(size_t)e * (size_t)b->order + (size_t)o]));
            scale = fmax(scale, fabs(J[(size_t)e * (size_t)b->order + (size_t)o]));
        }
    }
    free(X);
    free(column);
    free(J);
    balance_free(b);
    condense_free(c);
    program_free(p);
    return worst / scale;
}

/* Smooth laws: 1e-8.  Piecewise ones are twice continuously differentiable in X but for the events'
 * square roots: the differences themselves are good to h^2 f''' / f', about 1e-6 here, where no
 * event appears within h. */
TEST(every_laws_derivative_agrees_with_differences)
{
    static const struct { const char *effect; int N; double tolerance;
    } rows[] = {
        { "{\"type\":\"cubic_spring\",\"dof\":\"x1\",\"to\":\"x2\",\"coefficient\":0.83}", 64,
          1e-8 },
        { "{\"type\":\"polynomial_spring\",\"dof\":\"x2\",\"coefficients\":[0.4,-0.2,0.1,0.7]}", 64,
          1e-8 },
        { "{\"type\":\"polynomial_damper\",\"dof\":\"x1\",\"coefficients\":[-0.5,0.1,0.5]}", 64,
          1e-8 },
        { "{\"type\":\"cubic_spring\",\"dof\":\"x1\",\"coefficient\":0.83}", 9, 1e-8 },
        { "{\"type\":\"regularised_coulomb\",\"dof\":\"x1\",\"limit\":0.3,\"velocity\":0.2}", 512,
          1e-7 },
        { "{\"type\":\"parametric_stiffness\",\"dof\":\"x1\",\"to\":\"x2\",\"stiffness\":0.4,"
          "\"k\":2,\"phase\":0.3}",
          64, 1e-8 },
        { "{\"type\":\"friction\",\"dof\":\"x1\",\"to\":\"x2\",\"stiffness\":0.9,\"limit\":0.35}",
          64, 1e-5 },
        { "{\"type\":\"iwan\",\"dof\":\"x1\",\"stiffnesses\":[0.9,0.5],\"limits\":[0.35,0.1]}", 64,
          1e-5 },
        { "{\"type\":\"gap\",\"dof\":\"x1\",\"stiffness\":3,\"clearance\":0.1}", 64, 1e-5 },
        { "{\"type\":\"gap\",\"dof\":\"x1\",\"to\":\"x2\",\"stiffness\":3,\"clearance\":0.2,"
          "\"both_sides\":true,\"dissipation\":0.4}",
          64, 1e-5 },
        { "{\"type\":\"gap\",\"dof\":\"x1\",\"stiffness\":3,\"clearance\":-0.4,\"dissipation\":2."
          "5}",
          64, 1e-5 },
        { "{\"type\":\"contact_friction\",\"normal\":\"x1\",\"tangential\":\"x2\","
          "\"normal_stiffness\":1.3,\"preload\":0.4,\"tangential_stiffness\":0.8,\"mu\":0.5}",
          128, 1e-5 },
        { "{\"type\":\"coulomb\",\"dof\":\"x1\",\"limit\":0.35}", 64, 1e-5 },
    };

    for (size_t r = 0; r < sizeof rows / sizeof *rows; r++)
        for (int round = 0; round < 3; round++) {
            double error = derivative_error(rows[r].effect, 4, rows[r].N, uniform(0.9, 1.6));

            if (!(error <= rows[r].tolerance))
                fail_msg("%s: derivative off by %g", rows[r].effect, error);
        }
}
