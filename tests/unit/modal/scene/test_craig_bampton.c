/* Reductions: frequencies by their closed form, exact with all modes, and errors told as made. */
/* Tests as well: symmetric_modes.c reduction.c */
#include "check.h"
#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include "modal/scene/craig_bampton.h"
#include "modal/steady/reduction.h"
#include "modal/steady/solve.h"
#include "modal/steady/stability.h"
#include "scene_text.h"

enum { CHAIN_ROOM = 16384, MIDDLE = 20, MASSES = 2 * MIDDLE + 1, LOADED = 7 };

/* Masses of 1 between springs of 1, EFFECTS on the middle one, x21, a load on the eighth. */
static struct program *chain(const char *effects)
{
    char text[CHAIN_ROOM], *at = text;
    struct program *p;

    at += sprintf(at, "{'omega':0.11,'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < MASSES; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'springs':[1");
    for (int i = 0; i < MASSES; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'dampers':[0.03");
    for (int i = 0; i < MASSES; i++)
        at += sprintf(at, ",0.03");
    sprintf(at, "]},'effects':[%s],'excitation':[{'dof':'x8','k':1,'cos':0.1}]}", effects);
    p = program_text(text);
    return p;
}

#define CUBIC_TEXT "{'type':'cubic_spring','dof':'x21','coefficient':0.05}"
static const char CUBIC[] = CUBIC_TEXT;

/* Between fixed ends and a middle held fast M masses have omega_j = 2 sin(j pi / (2 (M + 1))), and
 * both halves the same: every frequency is there twice. */
TEST(frequencies_of_two_like_halves_are_there_twice)
{
    struct modal_error err = { 0 };
    struct program *p = chain(CUBIC);
    struct craig_bampton *a;

    p->loads = 0;                                       /* only the middle is kept */
    for (int modes = 1; modes < 2 * MIDDLE; modes++) {
        if (craig_bampton_new(p, NULL, 0, modes, &a, &err) != MODAL_OK)
            fail_msg("%s", err.message);
        CHECK(a->kept == 1 && a->modes == modes && craig_bampton_find(a, MIDDLE) == 0);
        CHECK(craig_bampton_find(a, LOADED) == -1);
        CHECK_NEAR(a->highest, 2 * sin((modes + 1) / 2 * M_PI / (2 * (MIDDLE + 1))), 1e-10);
        CHECK_NEAR(a->next, 2 * sin((modes + 2) / 2 * M_PI / (2 * (MIDDLE + 1))), 1e-10);
        craig_bampton_free(a);
    }
    p->loads = 1;
    program_free(p);
}

/* Numbers of damping that modes of Q share, of which B dofs were kept. */
static int shared_damping(const struct program *q, int b, int modes)
{
    const struct sparse *C = &q->constant[PROGRAM_C];
    int shared = 0;

    for (int i = b; i < b + modes; i++)
        for (int e = C->start[i]; e < C->start[i + 1]; e++)
            shared += C->index[e] >= b && C->index[e] < b + modes && C->index[e] != i;
    return shared;
}

/* The dampers are 0.03 of the springs: modes share none of them, and what rounding leaves would
 * make a dense matrix of it, dear in every step of the stability.  One to the ground they share. */
TEST(modes_share_no_damping_but_what_is_not_as_the_springs)
{
    static const char *const effects[] = { CUBIC_TEXT,
        CUBIC_TEXT ",{'type':'damper','dof':'x21','to':'x5','coefficient':0.1}" };
    enum { MODES = 12 };

    for (int i = 0; i < 2; i++) {
        struct modal_error err = { 0 };
        struct program *p = chain(effects[i]);
        struct craig_bampton *a;

        if (craig_bampton_new(p, NULL, 0, MODES, &a, &err) != MODAL_OK)
            fail_msg("%s", err.message);
        CHECK((shared_damping(&a->reduced, a->kept, MODES) == 0) == (i == 0));
        CHECK((shared_damping(&a->finer, a->kept, 2 * MODES) == 0) == (i == 0));
        craig_bampton_free(a);
        program_free(p);
    }
}

static struct steady_options options(int reduce)
{
    static const int dofs[] = { LOADED, MIDDLE };

    return (struct steady_options){ .harmonics = 9, .reduce = reduce, .dofs = dofs,
                                    .dofs_count = 2, .keep = dofs, .keep_count = 2 };
}

/* max over time and both dofs of what REDUCE modes answer off WHOLE; what is told into *TOLD. */
static double off(const struct program *p, int reduce, const struct steady_point *whole,
                  struct steady *of_whole, double *told, struct stability *st)
{
    struct steady_options opt = options(reduce);
    struct modal_error err = { 0 };
    struct steady *s = NULL;
    struct steady_point point;
    double complex x[10], y[10];
    double most = 0;

    if (steady_new(p, &opt, &s, &err) != MODAL_OK
        || steady_solve(s, p->omega, NULL, &point, &err) != MODAL_OK
        || reduction_error(s, &point, &err) != MODAL_OK
        || stability_of(s, &point, st, &err) != MODAL_OK)
        fail_msg("%s: %s", err.field, err.message);
    CHECK(point.converged && point.error >= point.reduction);
    for (int i = 0; i < opt.dofs_count; i++) {
        CHECK(steady_recover(of_whole, whole, opt.dofs[i], x, &err) == MODAL_OK);
        CHECK(steady_recover(s, &point, opt.dofs[i], y, &err) == MODAL_OK);
        for (int j = 0; j < 64; j++) {
            double complex sum = 0;

            for (int k = 0; k <= point.H; k++)
                sum += (x[k] - y[k]) * cexp(2 * M_PI * I * j * k / 64);
            most = fmax(most, fabs(creal(sum)));
        }
    }
    *told = point.reduction;
    steady_point_done(&point);
    steady_free(s);
    return most;
}

static void errors_of_reductions_are_told_as_they_are(const char *effects)
{
    struct program *p = chain(effects);
    struct steady_options opt = options(0);
    struct modal_error err = { 0 };
    struct steady *s = NULL;
    struct steady_point whole;
    struct stability exact;

    CHECK(steady_new(p, &opt, &s, &err) == MODAL_OK);
    CHECK(steady_solve(s, p->omega, NULL, &whole, &err) == MODAL_OK && whole.converged);
    CHECK(stability_of(s, &whole, &exact, &err) == MODAL_OK && exact.verdict == STABILITY_STABLE);
    for (int modes = 4; modes <= 64; modes *= 2) {
        double told, made;
        struct stability st;

        made = off(p, modes, &whole, s, &told, &st);
        CHECK(made <= 3 * told + 1e-11 && told <= 30 * made + 1e-11);
        CHECK(modes > 4 || told > 1e-7);                /* it leaves something out */
        CHECK(fabs(st.largest - exact.largest) <= 3 * st.error + 1e-9);
        CHECK(modes < MASSES || (told < 1e-11 && fabs(st.largest - exact.largest) < 1e-9));
        stability_done(&st);
    }
    stability_done(&exact);
    steady_point_done(&whole);
    steady_free(s);
    program_free(p);
}

TEST(a_linear_reduction_tells_its_error)
{
    errors_of_reductions_are_told_as_they_are("");
}

TEST(a_reduction_with_a_cubic_spring_tells_its_error)
{
    errors_of_reductions_are_told_as_they_are(CUBIC);
}

TEST(a_reduction_with_a_slider_tells_its_error)
{
    errors_of_reductions_are_told_as_they_are("{'type':'friction','dof':'x21','stiffness':0.5,"
                                              "'limit':0.02}");
}

/* Springs from x1 to x2 and from x3 to x4: with x1 held fast the second pair is loose. */
TEST(loose_dofs_are_refused)
{
    struct modal_error err = { 0 };
    struct craig_bampton *a;
    struct program *p = program_text(
        "{'omega':1,'structure':{'type':'chain','masses':[1,1,1,1],'springs':[0,1,0,1,0]},"
        "'effects':[{'type':'cubic_spring','dof':'x1','coefficient':1}],'excitation':[]}");

    CHECK(craig_bampton_new(p, NULL, 0, 2, &a, &err) == MODAL_BAD_INPUT);
    assert_string_equal(err.field, "reduce");
    assert_non_null(strstr(err.message, "loose"));
    program_free(p);
}
