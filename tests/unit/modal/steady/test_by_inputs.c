/* Derivatives solved on what laws read, beside their blocks factored whole. */
#include "check.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/program.h"
#include "modal/steady/aft.h"
#include "modal/steady/balance.h"
#include "modal/steady/by_inputs.h"
#include "modal/steady/condense.h"
#include "modal/steady/pattern.h"
#include "scene_text.h"

enum { DOFS = 200, SLIDERS = 24, H = 5, ORDER = DOFS * (2 * H + 1) };

/* A chain of DOFS masses with sliders at the first SLIDERS, every dof kept. */
static struct program *chain_of_sliders(int sliders)
{
    char *text = calloc(1, 64 * DOFS + 256 * SLIDERS), *at = text;
    struct program *p;

    at += sprintf(at, "{'structure':{'type':'chain','masses':[");
    for (int i = 0; i < DOFS; i++)
        at += sprintf(at, "%s1", i > 0 ? "," : "");
    at += sprintf(at, "],'springs':[");
    for (int i = 0; i <= DOFS; i++)
        at += sprintf(at, "%s1", i > 0 ? "," : "");
    at += sprintf(at, "],'dampers':[");
    for (int i = 0; i <= DOFS; i++)
        at += sprintf(at, "%s0.03", i > 0 ? "," : "");
    at += sprintf(at, "]},'omega':0.02,'excitation':[{'dof':'x1','k':1,'cos':0.5}],'effects':[");
    for (int i = 0; i < sliders; i++)
        at += sprintf(at, "%s{'type':'friction','dof':'x%d','stiffness':0.3,'limit':0.05}",
                      i > 0 ? "," : "", i + 1);
    sprintf(at, "]}");
    p = program_text(text);
    free(text);
    return p;
}

/* A motion of SIZE, of which some sliders slip and some stick. */
static void move(double size, double complex *X)
{
    for (int i = 0; i < DOFS; i++)
        for (int k = 1; k <= H; k++)
            X[i * (H + 1) + k] = CMPLX(cos(i + k), sin(2 * i - k)) * exp(-0.1 * i) * size / (k * k);
}

TEST(what_is_solved_on_the_laws_inputs_is_what_the_whole_blocks_give)
{
    struct program *p = chain_of_sliders(SLIDERS);
    struct condense *c = NULL;
    struct balance *b = NULL;
    struct joint *joint = NULL;
    struct by_inputs *s = NULL;
    double complex *X = calloc(DOFS * (H + 1), sizeof *X);
    double *y = calloc(ORDER, sizeof *y), *z = calloc(ORDER, sizeof *z);

    CHECK(condense_new(p, CONDENSE_SPARSE, &c, NULL) == MODAL_OK);
    CHECK(balance_new(p, c, H, 256, true, &b, NULL) == MODAL_OK);
    CHECK(balance_set(b, 0.02, 1, NULL) == MODAL_OK);
    CHECK(joint_new(p, condense_place(c), condense_pattern(c), &joint, NULL) == MODAL_OK);
    CHECK(joint_serves(joint));
    CHECK(by_inputs_new(joint, H, true, &s, NULL) == MODAL_OK && by_inputs_harmonics(s) == H);
    b->forcing = 1e-13;
    for (int round = 0; round < 2; round++) {           /* nothing is left of the first's slopes */
        move(round == 0 ? 1 : 0.3, X);
        CHECK(balance_residual(b, X, true, NULL) == MODAL_OK);
        CHECK(by_inputs_set(s, b->aft, NULL) == MODAL_OK);
        for (int i = 0; i < ORDER; i++)
            y[i] = z[i] = cos(0.7 * i);
        CHECK(balance_factor(b, NULL));
        balance_solve(b, z);
        CHECK(by_inputs_solve(s, b->S, 0.02, 1e-13, y) && by_inputs_work(s) > 0);
        for (int i = 0; i < ORDER; i++)
            CHECK_NEAR(y[i], z[i], 1e-8);
    }
    /* the same through a balance that keeps its derivative so */
    b->joint = joint;
    CHECK(balance_on_inputs(b) && balance_residual(b, X, true, NULL) == MODAL_OK && b->on_inputs);
    CHECK(balance_factor(b, NULL) && !balance_open(b));
    by_inputs_free(s);
    balance_free(b);
    joint_free(joint);
    condense_free(c);
    program_free(p);
    free(X);
    free(y);
    free(z);
}

/* As the sums of finite elements leave it: 1e-18 where its mirror image cancels to 0. */
TEST(a_stiffness_that_is_symmetric_but_for_rounding_has_a_symmetric_pattern)
{
    struct program *p = program_text(
        "{'structure':{'type':'matrices','M':[[1,0,0],[0,1,0],[0,0,1]],"
        "'K':[[2,-1,1e-18],[-1,2,-1],[0,-1,2]]},'omega':1,'effects':[]}");
    int place[3] = { 0, 1, 2 };
    struct pattern *pattern = NULL;

    CHECK(pattern_new(p, place, 3, false, &pattern, NULL) == MODAL_OK);
    CHECK(pattern_entries(pattern) == 9);
    CHECK(pattern->index[pattern_find(pattern, 0, 2)] == 0);
    CHECK(pattern->index[pattern_find(pattern, 2, 0)] == 2);
    pattern_free(pattern);
    program_free(p);
}

TEST(few_inputs_are_left_to_factors)
{
    struct program *p = chain_of_sliders(3);
    struct condense *c = NULL;
    struct joint *joint = NULL;

    CHECK(condense_new(p, CONDENSE_SPARSE, &c, NULL) == MODAL_OK);
    CHECK(joint_new(p, condense_place(c), condense_pattern(c), &joint, NULL) == MODAL_OK);
    CHECK(joint == NULL && !joint_serves(joint));
    joint_free(joint);
    condense_free(c);
    program_free(p);
}
