/* Bodies that nothing but what slips holds: where their means are told. */
#include "check.h"
#include <complex.h>
#include "modal/steady/condense.h"
#include "modal/steady/solve.h"
#include "modal/steady/unheld.h"
#include "scene_text.h"

#define FREE "{'structure':{'type':'matrices','M':[[1]],'C':[[0.1]],'K':[[0]]},'omega':1," \
    "'effects':[{'type':'friction','dof':'x1','stiffness':1,'limit':0.3}"
#define LOAD "],'excitation':[{'dof':'x1','k':1,'cos':1}]}"
#define STOP ",{'type':'gap','dof':'x1','stiffness':1000,'clearance':-5}"

/* POINT of the session *S of TEXT, its N dofs begun at MEAN. */
static struct steady *from_mean(const char *text, int n, double mean, struct program **p,
                                struct steady_point *point)
{
    struct steady_options opt = { .harmonics = 15 };
    double complex X[32] = { 0 };
    const struct steady_start start = { n, 1, X };
    struct steady *s;

    for (int i = 0; i < n; i++)
        X[2 * i] = mean;
    *p = program_text(text);
    CHECK(steady_new(*p, &opt, &s, NULL) == MODAL_OK);
    CHECK(steady_solve(s, (*p)->omega, &start, point, NULL) == MODAL_OK && point->converged);
    return s;
}

TEST(a_mean_that_nothing_holds_is_told_where_the_body_began_wherever_newtons_method_left_it)
{
    static const double means[] = { 0, 1000, -3e4 };
    double complex first = 0;

    for (int r = 0; r < 3; r++) {
        struct steady_point point;
        struct program *p;
        struct steady *s = from_mean(FREE LOAD, 1, means[r], &p, &point);

        CHECK(point.open);
        CHECK_NEAR(creal(point.X[0]), 0, 1e-12);
        if (r == 0)
            first = point.X[1];
        CHECK_NEAR(cabs(point.X[1] - first), 0, 1e-9);
        steady_point_done(&point);
        steady_free(s);
        program_free(p);
    }
}

/* Twelve alike under like loads move as one of them, and so many take sparse factors. */
TEST(the_mean_of_many_masses_is_told_where_they_began)
{
    char text[8192];
    int at = snprintf(text, sizeof text, "{'structure':{'type':'chain','masses':[1");
    struct steady_point point, one;
    struct program *p, *p1;
    struct steady *s, *s1 = from_mean(FREE LOAD, 1, 0, &p1, &one);

    for (int i = 1; i < 12; i++)
        at += snprintf(text + at, sizeof text - (size_t)at, ",1");
    at += snprintf(text + at, sizeof text - (size_t)at, "],'springs':[0");
    for (int i = 1; i < 12; i++)
        at += snprintf(text + at, sizeof text - (size_t)at, ",20");
    at += snprintf(text + at, sizeof text - (size_t)at, ",0]},'omega':1,'effects':[");
    for (int i = 1; i <= 12; i++)
        at += snprintf(text + at, sizeof text - (size_t)at,
                       "%s{'type':'damper','dof':'x%d','coefficient':0.1},"
                       "{'type':'friction','dof':'x%d','stiffness':1,'limit':0.3}",
                       i > 1 ? "," : "", i, i);
    at += snprintf(text + at, sizeof text - (size_t)at, "],'excitation':[");
    for (int i = 1; i <= 12; i++)
        at += snprintf(text + at, sizeof text - (size_t)at, "%s{'dof':'x%d','k':1,'cos':1}",
                       i > 1 ? "," : "", i);
    snprintf(text + at, sizeof text - (size_t)at, "]}");
    s = from_mean(text, 12, 500, &p, &point);
    CHECK(point.open);
    for (int i = 0; i < 12; i++) {
        CHECK_NEAR(creal(point.X[16 * i]), 0, 1e-9);
        CHECK_NEAR(cabs(point.X[16 * i + 1] - one.X[1]), 0, 1e-9);
    }
    steady_point_done(&one);
    steady_point_done(&point);
    steady_free(s1);
    steady_free(s);
    program_free(p1);
    program_free(p);
}

/* It swings by 1.06 about its mean: the stop at -5 keeps that below -6. */
TEST(a_stop_between_a_free_body_and_where_it_began_keeps_it_beyond_by_a_swing_or_two)
{
    struct steady_point point;
    struct program *p;
    struct steady *s = from_mean(FREE STOP LOAD, 1, -1e4, &p, &point);

    CHECK(point.open && point.residual < 1e-11);
    CHECK(creal(point.X[0]) < -6 && creal(point.X[0]) > -8.5);
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}

/* Far off a stop's rounding is all that Newton's method has; near 0 the motion is found anew, and
 * its errors with it. */
TEST(a_motion_that_lost_its_digits_far_off_has_them_back_and_its_errors)
{
    struct steady_point point;
    struct program *p;
    struct steady *s = from_mean(FREE LOAD, 1, 1e9, &p, &point);

    CHECK(point.open && point.residual < 1e-13);
    CHECK(point.error > 0 && point.error < 1e-2);
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}
