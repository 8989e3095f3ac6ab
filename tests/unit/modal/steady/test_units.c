/* A scene in other units is the same scene; where rigid friction holds for good its slider is at
 * zero. */
/* Tests as well: coulomb.c orbit.c */
#include "check.h"
#include <complex.h>
#include "modal/scene/simulate.h"
#include "modal/steady/solve.h"
#include "scene_text.h"

static void solve(const char *text, int H, struct program **p, struct steady **s,
                  struct steady_point *point)
{
    struct steady_options opt = { .harmonics = H };
    struct modal_error err = { 0 };

    *p = program_text(text);
    if (steady_new(*p, &opt, s, &err) != MODAL_OK ||
        steady_solve(*s, (*p)->omega, NULL, point, &err) != MODAL_OK)
        fail_msg("%s: %s: %s", text, err.field, err.message);
}

static void release(struct program *p, struct steady *s, struct steady_point *point)
{
    steady_point_done(point);
    steady_free(s);
    program_free(p);
}

/* Lengths in units of L, times of T, masses of M: every number divided by its own. */
struct units { double L, T, M; };
static const struct units systems[] = { { 1, 1, 1 },           { 1e-6, 1e6, 1e-6 },
                                        { 1e6, 1e-6, 1e6 },    { 1e-6, 1e-6, 1e6 },
                                        { 1e-9, 1e-9, 1e-24 }, { 1, 1e6, 1 },
                                        { 1e10, 1, 1 } };
enum { SYSTEMS = sizeof systems / sizeof *systems };

static void write_chain(const struct units *u, const char *more, char *text, size_t size)
{
    double m = u->M, c = u->M / u->T, k = c / u->T, f = k * u->L;

    snprintf(text, size,
             "{'structure':{'type':'chain','masses':[%.17g,%.17g,%.17g],'springs':"
             "[%.17g,%.17g,%.17g,0],'dampers':[%.17g,%.17g,0,%.17g]},'omega':%.17g,'effects':"
             "[{'type':'coulomb','dof':'x2','limit':%.17g},{'type':'coulomb','dof':'x3','to':'x1',"
             "'limit':%.17g}],'excitation':[{'dof':'x1','k':1,'cos':%.17g},{'dof':'x3','k':3,"
             "'sin':%.17g}]%s}",
             1.2 / m, 0.7 / m, 1.9 / m, 210 / k, 130 / k, 95 / k, 1.1 / c, 0.8 / c, 1.4 / c,
             8.3 * u->T, 2.2 / f, 1.7 / f, 13.0 / f, 4.1 / f, more);
}

/* Both sliders slip and stick within the period; rounding of the numbers written moves the answer
 * by a few units in the last place, times the condition of the cycle. */
TEST(rigid_friction_on_several_dofs_gives_the_same_motion_in_any_units)
{
    double complex first[3 * 33];
    double multiplier = 0;

    for (int i = 0; i < SYSTEMS; i++) {
        struct program *p;
        struct steady *s;
        struct steady_point point;
        char text[2048];

        write_chain(&systems[i], "", text, sizeof text);
        solve(text, 32, &p, &s, &point);
        CHECK(point.converged);
        CHECK_STRING(point.method, "events");
        for (int j = 0; j < 3 * 33; j++) {
            if (i == 0)
                first[j] = point.X[j];
            CHECK_NEAR(cabs(point.X[j] * systems[i].L - first[j]), 0,
                       1e-12 * cabs(point.X[1]) * systems[i].L);
        }
        multiplier = i == 0 ? cabs(point.multiplier[0]) : multiplier;
        CHECK_NEAR(cabs(point.multiplier[0]), multiplier, 1e-10);
        release(p, s, &point);
    }
}

/* N numbers X but LAST, 0 in the middle where two chains meet. */
static char *write_numbers(char *at, const char *name, int n, double x, int middle)
{
    at += sprintf(at, "'%s':[", name);
    for (int i = 0; i < n; i++)
        at += sprintf(at, "%s%.17g", i > 0 ? "," : "", i == middle ? 0 : x);
    return at + sprintf(at, "],");
}

/* N contacts with friction between the dofs of two chains, one along the normals, which a load
 * presses, and one along the other way: springs K, contacts of KC, dampers of DAMPING times the
 * springs, in units U. */
static char *write_joint(int n, const struct units *u, double k, double kc, double damping)
{
    double m = 1 / u->M, t = 1 / u->T, s = k * m / (t * t), f = s / u->L;
    char *text = malloc((size_t)n * 512 + 1024), *at = text;

    at += sprintf(at, "{'structure':{'type':'chain',");
    at = write_numbers(at, "masses", 2 * n, m, -1);
    at = write_numbers(at, "springs", 2 * n + 1, s, n);
    at = write_numbers(at, "dampers", 2 * n + 1, damping * s * t, n);
    at += sprintf(at - 1, "},'omega':%.17g,'effects':[", 0.3 * sqrt(k) / t) - 1;
    for (int i = 1; i <= n; i++)
        at += sprintf(at,
                      "%s{'type':'contact_friction','normal':'x%d','tangential':'x%d','preload':"
                      "%.17g,'mu':0.3,'normal_stiffness':%.17g,'tangential_stiffness':%.17g}",
                      i > 1 ? "," : "", i, n + i, f, kc / k * s, kc / k * s);
    at += sprintf(at, "],'excitation':[");
    for (int i = 1; i <= n; i++)
        at += sprintf(at, "{'dof':'x%d','k':0,'cos':%.17g},", i, f);
    sprintf(at, "{'dof':'x%d','k':1,'cos':%.17g},{'dof':'x1','k':1,'cos':%.17g}]}", n + 1, 0.5 * f,
            0.2 * f);
    return text;
}

/* Rounding of the numbers written, times the condition of the balance. */
TEST(contacts_of_a_joint_move_alike_in_units_from_1e8_down_to_1e_minus_8)
{
    static const struct units scaled[] = { { 1, 1, 1 },      { 1e-8, 1, 1 },      { 1e8, 1, 1 },
                                           { 1, 1e-8, 1 },   { 1, 1e8, 1 },       { 1, 1, 1e-8 },
                                           { 1, 1, 1e8 },    { 1e8, 1e-8, 1e8 } };
    enum { N = 12, H = 5, NUMBERS = 2 * N * (H + 1) };
    double complex first[NUMBERS];

    for (size_t i = 0; i < sizeof scaled / sizeof *scaled; i++) {
        char *text = write_joint(N, &scaled[i], 1, 10, 0.03);
        struct program *p;
        struct steady *s;
        struct steady_point point;

        solve(text, H, &p, &s, &point);
        CHECK(point.converged);
        for (int j = 0; j < NUMBERS; j++) {
            if (i == 0)
                first[j] = point.X[j];
            CHECK_NEAR(cabs(point.X[j] * scaled[i].L - first[j]), 0, 1e-11);
        }
        release(p, s, &point);
        free(text);
    }
}

/* 1e8 N/m on springs of 1e7, dampers of a millionth of them; the residual is as small as 2 H + 1
 * roundings of a motion of 1e-7 m make the forces. */
TEST(four_hundred_stiff_contacts_that_hardly_anything_damps_are_in_balance)
{
    const struct units si = { 1, 1, 1 };
    char *text = write_joint(400, &si, 1e7, 1e8, 1e-6);
    struct program *p;
    struct steady *s;
    struct steady_point point;

    solve(text, 3, &p, &s, &point);
    CHECK(point.converged);
    CHECK(point.residual < 1e-12);
    release(p, s, &point);
    free(text);
}

TEST(what_is_simulated_is_the_same_in_any_units)
{
    enum { samples = 200, dofs = 3 };
    static double first[samples * dofs], signals[samples * dofs];

    for (int i = 0; i < SYSTEMS; i++) {
        char text[2048];
        struct scene_time time = { .dt = 0.02 / systems[i].T, .samples = samples };
        struct simulate_options opt = { 0 };
        struct simulate_result result;
        struct program *p;
        struct modal_error err = { 0 };

        write_chain(&systems[i], "", text, sizeof text);
        p = program_text(text);
        if (simulate(p, &time, &opt, i == 0 ? first : signals, &result, &err) != MODAL_OK)
            fail_msg("%s", err.message);
        for (int j = 0; i > 0 && j < samples * dofs; j++)
            CHECK_NEAR(signals[j] * systems[i].L, first[j], 1e-13);   /* displacements of 0.1 m */
        program_free(p);
    }
}

/* A mass on K = 2.3 under 5 + 0.7 cos: slipping from rest it would stop wherever its history says.
 * Held by 3.1 at most it may lie anywhere in |5 + 0.7 cos - 2.3 d| <= 3.1; nearest to zero is d =
 * (5.7 - 3.1) / 2.3. */
TEST(a_body_that_friction_cannot_hold_at_zero_lies_as_near_as_it_can)
{
    struct program *p;
    struct steady *s;
    struct steady_point point;

    solve("{'structure':{'type':'matrices','M':[[1.4]],'C':[[0.3]],'K':[[2.3]]},'omega':2.1,"
          "'effects':[{'type':'coulomb','dof':'x1','limit':3.1}],'excitation':[{'dof':'x1','k':0,"
          "'cos':5},{'dof':'x1','k':1,'cos':0.7}]}",
          8, &p, &s, &point);
    CHECK(point.converged && point.undetermined[0] && !point.acts[0]);
    CHECK_NEAR(creal(point.X[0]), (5.7 - 3.1) / 2.3, 1e-12);
    for (int k = 1; k <= 8; k++)
        CHECK_NEAR(cabs(point.X[k]), 0, 1e-12);
    release(p, s, &point);
}

/* Two masses locked together: they move as one of the sum, without mean, wherever the start has
 * left them. */
TEST(two_bodies_that_friction_locks_swing_about_no_offset)
{
    const double m = 0.6 + 1.58, k = 150.6 + 52.3, c = 1.06 + 2.93, w = 24.8, a = 6.73;
    const double complex X = a / (k - m * w * w + I * w * c);
    struct program *p;
    struct steady *s;
    struct steady_point point;

    solve("{'structure':{'type':'chain','masses':[0.6,1.58],'springs':[150.6,61.5,52.3],'dampers':"
          "[1.06,0.58,2.93]},'omega':24.8,'effects':[{'type':'coulomb','dof':'x1','to':'x2',"
          "'limit':3.9}],'excitation':[{'dof':'x2','k':1,'cos':6.73}]}",
          4, &p, &s, &point);
    CHECK(point.converged && point.undetermined[0]);
    for (int i = 0; i < 2; i++) {
        CHECK_NEAR(cabs(point.X[5 * i]), 0, 1e-12 * cabs(X));
        CHECK_NEAR(cabs(point.X[5 * i + 1] - X), 0, 1e-10 * cabs(X));
    }
    release(p, s, &point);
}

/* A stop that is never reached changes nothing, but the disturbances are then differences of the
 * period map, not products of its exponentials and jumps. */
TEST(multipliers_of_rigid_friction_by_differences_are_those_of_its_phases)
{
    static const char *const beside[2] = {
        "", ",{'type':'gap','dof':'x1','stiffness':40,'clearance':90}"
    };
    double complex multiplier[2][4];
    double error = 0;

    for (int i = 0; i < 2; i++) {
        struct program *p;
        struct steady *s;
        struct steady_point point;
        char text[1024];

        snprintf(text, sizeof text,
                 "{'structure':{'type':'chain','masses':[1.2,0.7],'springs':[210,130,95],"
                 "'dampers':[1.1,0.8,1.4]},'omega':8.3,'effects':[{'type':'coulomb','dof':'x2',"
                 "'limit':2.2}%s],'excitation':[{'dof':'x1','k':1,'cos':13},{'dof':'x2','k':3,"
                 "'sin':4.1}]}",
                 beside[i]);
        solve(text, 16, &p, &s, &point);
        CHECK(point.converged && point.states == 4);
        memcpy(multiplier[i], point.multiplier, sizeof multiplier[i]);
        CHECK(i == 1 || point.multiplier_error == 0);
        error = point.multiplier_error;
        release(p, s, &point);
    }
    CHECK(error > 0 && error < 1e-6);
    for (int i = 0; i < 4; i++) {
        double nearest = HUGE_VAL;

        for (int k = 0; k < 4; k++)
            nearest = fmin(nearest, cabs(multiplier[1][i] - multiplier[0][k]));
        CHECK_NEAR(nearest, 0, 10 * error);
    }
}

/* Rigid friction of 1.5 and of 0.7 between the same two bodies is friction of 2.2, whichever way
 * round each is written. */
TEST(two_rigid_sliders_at_one_place_are_one_of_both_strengths)
{
    static const char *const effects[2] = { "{'type':'coulomb','dof':'x1','to':'x2','limit':2.2}",
                                            "{'type':'coulomb','dof':'x1','to':'x2','limit':1.5},"
                                            "{'type':'coulomb','dof':'x2','to':'x1','limit':0.7}" };
    double complex first[2 * 13];

    for (int i = 0; i < 2; i++) {
        struct program *p;
        struct steady *s;
        struct steady_point point;
        char text[1024];

        snprintf(text, sizeof text,
                 "{'structure':{'type':'chain','masses':[1.2,0.7],'springs':[210,130,95],"
                 "'dampers':[1.1,0.8,1.4]},'omega':8.3,'effects':[%s],'excitation':[{'dof':'x1',"
                 "'k':1,'cos':13},{'dof':'x2','k':3,'sin':4.1}]}",
                 effects[i]);
        solve(text, 12, &p, &s, &point);
        CHECK(point.converged);
        CHECK(p->laws == 1 && p->effects == 1 + i && p->effect[i].carrier == i);
        for (int j = 0; j < 2 * 13; j++) {
            first[j] = i == 0 ? point.X[j] : first[j];
            CHECK_NEAR(cabs(point.X[j] - first[j]), 0, 1e-12);
        }
        release(p, s, &point);
    }
}
