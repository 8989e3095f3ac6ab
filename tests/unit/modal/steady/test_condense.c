/* test_condense.c - what a session knows of many linear dofs serves the next one exactly, and only
 * where it is the same */
/* Tests as well: condense_known.c condense_residual.c */
#include "check.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/scene/program.h"
#include "modal/steady/condense.h"
#include "modal/steady/condense_state.h"
#include "modal/steady/pattern.h"
#include "modal/steady/solve.h"
#include "scene_text.h"

enum { MASSES = 2101, HARMONICS = 3, ROOM = 64 * MASSES };
static const double OMEGA = 0.3;

/* A chain with a cubic spring on its first mass, loads on the first and the third, and a second
 * harmonic; SPRING is its last. */
static struct program *chain(double cubic, double spring, const double load[3])
{
    char *text = malloc(ROOM), *at = text;
    struct program *p;

    assert_non_null(text);
    at += sprintf(at, "{'omega':0.3,'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < MASSES; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'springs':[1");
    for (int i = 1; i < MASSES; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, ",%g],'dampers':[0", spring);
    for (int i = 1; i < MASSES; i++)
        at += sprintf(at, ",0.03");
    at += sprintf(at, ",0]},'effects':[{'type':'cubic_spring','dof':'x1','coefficient':%g}],"
                  "'excitation':[{'dof':'x3','k':1,'cos':%g},{'dof':'x5','k':1,'sin':%g},"
                  "{'dof':'x3','k':2,'cos':%g}]}", cubic, load[0], load[1], load[2]);
    p = program_text(text);
    free(text);
    return p;
}

/* What is asked of the linear part: S and p of all harmonics, and the motion of x9. */
struct answer {
    double complex S[HARMONICS + 1], p[HARMONICS + 1], x9[HARMONICS + 1];
    double work;
};

static struct answer ask(struct condense *c)
{
    static const double complex kept[HARMONICS + 1] = { 0.1, 1, 0.2 - 0.1 * I, 0.05 * I };
    struct modal_error err = { 0 };
    struct answer a;

    CHECK(condense_kept(c) == 1 && pattern_entries(condense_pattern(c)) == 1);
    CHECK(condense_at(c, OMEGA, 1, HARMONICS, a.S, a.p, &err) == MODAL_OK);
    CHECK(condense_recover(c, 8, HARMONICS, kept, HARMONICS, a.x9, &err) == MODAL_OK);
    a.work = condense_work(c);
    return a;
}

/* The answer of P after one of BEFORE (NULL: alone). */
static struct answer answer_of(const struct program *p, const struct program *before)
{
    struct modal_error err = { 0 };
    struct condense *c = NULL, *from = NULL;
    struct answer a;

    CHECK(condense_new(p, CONDENSE_LINEAR, &c, &err) == MODAL_OK);
    if (before != NULL) {
        CHECK(condense_new(before, CONDENSE_LINEAR, &from, &err) == MODAL_OK);
        ask(from);
        condense_inherit(c, from);
        condense_free(from);
    }
    a = ask(c);
    condense_free(c);
    return a;
}

/* P after one of BEFORE answers as alone, by the work of COUNT of its harmonics: a factorization
 * each, and a solution or two. */
static void check_work(struct program *p, struct program *before, int count)
{
    struct answer alone = answer_of(p, NULL), after = answer_of(p, before);

    CHECK(alone.work > 0);
    CHECK_NEAR(after.work / alone.work * (HARMONICS + 1), count, 0.4 * (count % (HARMONICS + 1)));
    for (int k = 0; k <= HARMONICS; k++) {
        CHECK(after.S[k] == alone.S[k]);
        CHECK_NEAR(cabs(after.p[k] - alone.p[k]), 0, 1e-15 * cabs(alone.p[k]));
        CHECK_NEAR(cabs(after.x9[k] - alone.x9[k]), 0, 1e-14 * cabs(alone.x9[k]));
    }
    program_free(p);
    program_free(before);
}

TEST(another_law_on_the_same_structure_and_loads_factors_nothing)
{
    check_work(chain(2, 1, (double[]) { 1, 2, 3 }), chain(1, 1, (double[]) { 1, 2, 3 }), 0);
}

TEST(a_harmonic_whose_only_load_is_another_is_scaled_and_factors_nothing)
{
    check_work(chain(1, 1, (double[]) { 1, 2, 5 }), chain(1, 1, (double[]) { 1, 2, 3 }), 0);
}

TEST(a_harmonic_of_several_loads_one_of_which_changed_is_factored_alone)
{
    check_work(chain(1, 1, (double[]) { 1, 4, 3 }), chain(1, 1, (double[]) { 1, 2, 3 }), 1);
}

TEST(a_harmonic_that_had_no_load_is_factored_alone)
{
    check_work(chain(1, 1, (double[]) { 1, 2, 3 }), chain(1, 1, (double[]) { 1, 2, 0 }), 1);
    check_work(chain(1, 1, (double[]) { 1, 2, 0 }), chain(1, 1, (double[]) { 1, 2, 3 }), 1);
}

TEST(another_structure_is_factored_anew)
{
    check_work(chain(1, 2, (double[]) { 1, 2, 3 }), chain(1, 1, (double[]) { 1, 2, 3 }),
               HARMONICS + 1);
}

/* The work of a session of P at so few harmonics that the estimate looks at many more, after
 * BEFORE's (NULL: alone), which is then freed. */
static double work_of_point(const struct program *p, struct steady *before, struct steady **out)
{
    static const int seen = 0;
    const struct steady_options opt = { .harmonics = 3, .dofs = &seen, .dofs_count = 1 };
    struct modal_error err = { 0 };
    struct steady_point point;

    CHECK(steady_new(p, &opt, out, &err) == MODAL_OK);
    if (before != NULL)
        steady_inherit(*out, before);
    steady_free(before);
    CHECK(steady_solve(*out, OMEGA, NULL, &point, &err) == MODAL_OK && point.converged);
    CHECK(point.error > 0);
    steady_point_done(&point);
    return condense_work(steady_condense(*out));
}

TEST(a_point_with_its_error_factors_nothing_after_one_on_the_same_structure)
{
    struct program *p = chain(1, 1, (double[]) { 1, 2, 3 }),
                   *next = chain(2, 1, (double[]) { 1, 2, 3 });
    struct steady *first, *second;

    CHECK(work_of_point(p, NULL, &first) > 0);
    CHECK(work_of_point(next, first, &second) == 0);
    steady_free(second);
    program_free(p);
    program_free(next);
}

/* 60 masses in a row that nothing holds, one of them kept: what moves all of them alike meets no
 * force at rest.  Modes alone left a stiffness of some 1e-15 there, which held the mean. */
TEST(modes_of_a_body_that_nothing_holds_leave_nothing_at_rest)
{
    enum { FREE = 60 };
    char text[4096], *at = text;
    double complex S[HARMONICS + 1], p[HARMONICS + 1], by_factors[HARMONICS + 1],
        load[HARMONICS + 1];
    struct modal_error err = { 0 };
    struct program *of;
    struct condense *c;
    bool done = false;

    at += sprintf(at, "{'omega':0.3,'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < FREE; i++)
        at += sprintf(at, ",1");
    for (int d = 0; d < 2; d++) {
        at += sprintf(at, "],'%s':[0", d == 0 ? "springs" : "dampers");
        for (int i = 1; i < FREE; i++)
            at += sprintf(at, d == 0 ? ",1.7" : ",0.051");
        at += sprintf(at, ",0");
    }
    sprintf(at, "]},'effects':[{'type':'gap','dof':'x7','stiffness':5,'clearance':0.3}],"
                "'excitation':[{'dof':'x20','k':1,'cos':1},{'dof':'x50','k':0,'cos':0.3}]}");
    of = program_text(text);
    CHECK(condense_new(of, CONDENSE_LINEAR, &c, &err) == MODAL_OK && condense_kept(c) == 1);
    CHECK(condense_at(c, OMEGA, 2, HARMONICS, by_factors, load, &err) == MODAL_OK);
    CHECK(condense_reduce(c, &done, &err) == MODAL_OK && done);
    CHECK(condense_at(c, OMEGA, 2, HARMONICS, S, p, &err) == MODAL_OK);
    CHECK(S[0] == 0);
    CHECK_NEAR(cabs(p[0] - 0.6), 0, 1e-12);       /* all of the load, at level 2 */
    for (int k = 0; k <= HARMONICS; k++) {
        CHECK_NEAR(cabs(S[k] - by_factors[k]), 0, 1e-11 * cabs(by_factors[1]));
        CHECK_NEAR(cabs(p[k] - load[k]), 0, 1e-11 * cabs(load[1]));
    }
    condense_free(c);
    program_free(of);
}

/* x3 and x4 are tied to nothing, and a static load is on x4: no rest.  A curve asks at each of its
 * points. */
TEST(a_rest_that_cannot_be_made_takes_no_more_memory_each_time_it_is_asked_for)
{
    double complex S[HARMONICS + 1], p[HARMONICS + 1];
    struct modal_error err = { 0 };
    struct condense *c;
    size_t blocks = 0;
    bool done = false;
    struct program *of = program_text(
        "{'structure':{'type':'chain','masses':[1,1,1,1],'springs':[1,1,0,1,0]},'omega':0.3,"
        "'effects':[{'type':'gap','dof':'x1','stiffness':5,'clearance':0.3}],"
        "'excitation':[{'dof':'x4','k':0,'cos':0.3},{'dof':'x1','k':1,'cos':1}]}");

    CHECK(condense_new(of, CONDENSE_LINEAR, &c, &err) == MODAL_OK && condense_kept(c) == 1);
    CHECK(condense_reduce(c, &done, &err) == MODAL_OK && done);
    for (int i = 0; i < 3; i++) {
        CHECK(condense_at(c, OMEGA + 0.01 * i, 1, HARMONICS, S, p, &err) == MODAL_NO_CONVERGENCE);
        CHECK(i == 0 || c->space.count == blocks);
        blocks = c->space.count;
    }
    condense_free(c);
    program_free(of);
}
