/* A body that nothing holds, and a stop that it meets by a hair. */
#include "check.h"
#include <complex.h>
#include <math.h>
#include "modal/steady/condense.h"
#include "modal/steady/graze.h"
#include "modal/steady/solve.h"
#include "modal/steady/stability.h"
#include "scene_text.h"

#define OMEGA 1.3
#define CLEARANCE 0.2
#define LOAD "'excitation':[{'dof':'x1','k':1,'cos':1}"
#define STOP "'omega':1.3,'effects':[{'type':'gap','dof':'x1','stiffness':1000,'clearance':0.2}"
#define ONE "{'structure':{'type':'matrices','M':[[1]],'C':[[0.1]],'K':[[0]]}," STOP "]," LOAD
/* the second stop is far off */
#define TWO \
    "{'structure':{'type':'matrices','M':[[1,0],[0,2]],'C':[[0.16,-0.06],[-0.06,0.26]]," \
    "'K':[[3,-3],[-3,3]]}," STOP ",{'type':'gap','dof':'x2','stiffness':10,'clearance':50}]," LOAD
/* two that no law acts on: 0.9911 - 0.45 - 0.5411 is 1.1e-16 in doubles */
#define THREE \
    "{'structure':{'type':'matrices','M':[[1,0,0],[0,2,0],[0,0,1.5]]," \
    "'C':[[0.19,-0.06,-0.03],[-0.06,0.06,0],[-0.03,0,0.03]]," \
    "'K':[[0.9911,-0.45,-0.5411],[-0.45,0.45,0],[-0.5411,0,0.5411]]}," STOP "]," LOAD
/* from rest, one that goes where nothing is near; and one of three stops, where S_0 takes a mean of
 * all to rounding without an entry of it that is */
static const char *const from_rest[] = {
    "{'structure':{'type':'chain','masses':[1.8689,0.7507],'springs':[0,0.6741,0],"
    "'dampers':[0.0135,0.0257,0]},'omega':0.9656,'effects':[{'type':'gap','dof':'x2',"
    "'stiffness':14.388,'clearance':0.125}],'excitation':[{'dof':'x2','k':1,'cos':1.759}]}",
    "{'structure':{'type':'chain','masses':[0.7486,1.2736,1.3742,0.627,0.6607],"
    "'springs':[0,0.3177,0.51,0.3592,0.7554,0],"
    "'dampers':[0.0941,0.01917,0.0158,0.02811,0.01421,0]},'omega':1.4412,'effects':["
    "{'type':'gap','dof':'x4','stiffness':3.365,'clearance':0.227},"
    "{'type':'gap','dof':'x2','stiffness':1.354,'clearance':0.567},"
    "{'type':'gap','dof':'x1','stiffness':151.101,'clearance':0.28}],"
    "'excitation':[{'dof':'x4','k':1,'cos':1.032}]}"
};

/* The first harmonics without a stop, multiplied out: (K - w^2 M + i w C) X = (1, 0, 0). */
static void without_stop(int n, double complex *X)
{
    double w = OMEGA;
    double complex a, d, b, det;

    if (n == 1) {
        X[0] = 1 / (-w * w + I * w * 0.1);
        return;
    }
    if (n == 3) {
        a = 0.45 + I * w * 0.06;
        b = 0.5411 + I * w * 0.03;
        d = a - 2 * w * w;
        det = b - 1.5 * w * w;
        X[0] = 1 / (a + b - w * w + I * w * 0.1 - a * a / d - b * b / det);
        X[1] = a / d * X[0];
        X[2] = b / det * X[0];
        return;
    }
    a = 3 - w * w + I * w * 0.16;
    d = 3 - 2 * w * w + I * w * 0.26;
    b = -3 - I * w * 0.06;
    det = a * d - b * b;
    X[0] = d / det;
    X[1] = -b / det;
}

/* The scene TEXT of n masses from the motion without its stop, which that is met by DEPTH in. */
static struct steady *from_depth(const char *text, int n, double depth, struct program **p,
                                 struct steady_point *point)
{
    enum { H = 15 };
    double complex X1[3], X[2 * (H + 1)] = { 0 };
    struct steady_options opt = { .harmonics = H };
    struct steady_start start;
    struct steady *s;

    *p = program_text(text);
    CHECK(steady_new(*p, &opt, &s, NULL) == MODAL_OK);
    without_stop(n, X1);
    start = (struct steady_start){ condense_kept(steady_condense(s)), H, X };
    for (int i = 0; i < start.q; i++) {
        X[i * (H + 1)] = CLEARANCE + depth - cabs(X1[0]);
        X[i * (H + 1) + 1] = X1[i];
    }
    CHECK(steady_solve(s, OMEGA, &start, point, NULL) == MODAL_OK && point->converged);
    return s;
}

TEST(a_free_body_that_newtons_method_leaves_at_a_stop_by_a_hair_has_a_free_mean)
{
    static const double depths[] = { 1e-4, 1e-6, 1e-8 };

    static const char *const whole[] = { ONE "]}", TWO "]}", THREE "]}" };

    for (int r = 0; r < 9; r++) {
        int n = 1 + r % 3;
        double complex X1[3], found[3][16];
        struct program *p;
        struct steady_point point;
        struct stability st;
        struct steady *s = from_depth(whole[n - 1], n, depths[r / 3], &p, &point);

        without_stop(n, X1);
        CHECK(point.open && point.error < 4e-9 && point.residual < 1e-13);
        for (int i = 0; i < n; i++) {
            CHECK(steady_recover(s, &point, i, found[i], NULL) == MODAL_OK);
            CHECK(cabs(found[i][1] - X1[i]) < 1e-12);
        }
        /* a whole swing off the stop, and all of one body */
        CHECK(creal(found[0][0]) < CLEARANCE - 1.9 * cabs(X1[0]));
        for (int i = 1; i < n; i++)
            CHECK(cabs(found[i][0] - found[0][0]) < 1e-9);
        CHECK(stability_of(s, &point, &st, NULL) == MODAL_OK);
        CHECK(st.verdict == STABILITY_UNDECIDED && fabs(st.largest - 1) < 1e-8);
        stability_done(&st);
        steady_point_done(&point);
        steady_free(s);
        program_free(p);
    }
}

TEST(a_body_that_a_load_presses_on_its_stop_stays_there)
{
    for (int n = 1; n <= 2; n++) {
        struct program *p;
        struct steady_point point;
        struct steady *s = from_depth(n == 1 ? ONE ",{'dof':'x1','k':0,'cos':1e-6}]}"
                                             : TWO ",{'dof':'x1','k':0,'cos':1e-6}]}",
                                      n, 1e-4, &p, &point);
        double complex found[16];
        double far = -HUGE_VAL;

        CHECK(!point.open && steady_recover(s, &point, 0, found, NULL) == MODAL_OK);
        for (int j = 0; j < 4096; j++) {
            double x = 0;

            for (int k = 0; k < 16; k++)
                x += creal(found[k] * cexp(I * k * j * (2 * M_PI / 4096)));
            far = fmax(far, x);
        }
        CHECK(far > CLEARANCE && far < CLEARANCE + 1e-4);
        steady_point_done(&point);
        steady_free(s);
        program_free(p);
    }
}

/* So that errors are held against what moves, wherever the body is. */
TEST(the_amplitude_of_a_motion_with_a_free_mean_is_about_it)
{
    for (int n = 1; n <= 2; n++) {
        double complex X1[2];
        struct program *p;
        struct steady_point point;
        struct steady *s = from_depth(n == 1 ? ONE "]}" : TWO "]}", n, -1e3, &p, &point);

        without_stop(n, X1);
        CHECK(point.open);
        CHECK_NEAR(point.amplitude, fmax(cabs(X1[0]), n == 2 ? cabs(X1[1]) : 0),
                   1e-3 * point.amplitude);
        steady_point_done(&point);
        steady_free(s);
        program_free(p);
    }
}

TEST(a_free_body_from_rest_beside_its_stops_has_a_free_mean)
{
    for (int r = 0; r < 2; r++) {
        struct program *p = program_text(from_rest[r]);
        struct steady_options opt = { .harmonics = 0 };
        struct steady_point point;
        struct steady *s;

        CHECK(steady_new(p, &opt, &s, NULL) == MODAL_OK);
        CHECK(steady_solve(s, p->omega, NULL, &point, NULL) == MODAL_OK && point.converged);
        CHECK(point.open);
        steady_point_done(&point);
        steady_free(s);
        program_free(p);
    }
}
