/* Blocks of harmonics solved harmonic by harmonic beside their own factors. */
#include "check.h"
#include <math.h>
#include <stdlib.h>
#include "modal/scene/program.h"
#include "modal/steady/blocks.h"
#include "modal/steady/by_harmonic.h"
#include "modal/steady/pattern.h"
#include "scene_text.h"

enum { DOFS = 6, HJ = 3, ROWS = 2 * HJ + 1, ORDER = DOFS * ROWS };

/* In [-1, 1], the same on every machine. */
static double next(unsigned *state)
{
    *state = *state * 1103515245u + 12345u;
    return (double)(*state >> 8 & 0xffff) / 32768 - 1;
}

/* Blocks of P: numbers without pattern of size COUPLED, each unknown's own 4. */
static struct blocks *filled(const struct pattern *p, double coupled)
{
    struct blocks *b = NULL;
    unsigned state = 7;

    CHECK(blocks_new(p, HJ, false, &b, NULL) == MODAL_OK);
    blocks_clear(b);
    for (int j = 0; j < DOFS; j++)
        for (int e = p->start[j]; e < p->start[j + 1]; e++)
            for (int c = 0; c < ROWS; c++) {
                int k = (c + 1) / 2, i = p->index[e];
                double *column = blocks_column(b, i, j, c);

                for (int r = p->mixes[e] ? 0 : k > 0 ? 2 * k - 1 : 0;
                     r <= (p->mixes[e] ? ROWS - 1 : 2 * k); r++)
                    column[r] = coupled * next(&state) + (i == j && r == c ? 4 : 0);
            }
    return b;
}

/* By LU factors of all, backward stable; what GMRES leaves is asked for. */
TEST(what_harmonics_solve_apart_is_what_the_whole_blocks_give)
{
    struct program *p = program_text(
        "{'structure':{'type':'chain','masses':[1,1,1,1,1,1],'springs':[1,1,1,1,1,1,0]},'omega':1,"
        "'effects':[{'type':'cubic_spring','dof':'x2','to':'x5','coefficient':1},"
        "{'type':'gap','dof':'x3','stiffness':1,'clearance':0}]}");
    int place[DOFS] = { 0, 1, 2, 3, 4, 5 };
    struct pattern *pattern = NULL;
    struct by_harmonic *s = NULL;
    struct blocks *b;
    double y[ORDER], z[ORDER];
    unsigned state = 3;

    CHECK(pattern_new(p, place, DOFS, false, &pattern, NULL) == MODAL_OK);
    CHECK((s = by_harmonic_new(pattern, HJ)) != NULL);
    for (int round = 0; round < 2; round++) {           /* weakly coupled, and not */
        b = filled(pattern, round == 0 ? 0.05 : 1);
        for (int i = 0; i < ORDER; i++)
            y[i] = z[i] = next(&state);
        CHECK(by_harmonic_factor(s, b) && blocks_factor(b, NULL));
        CHECK(by_harmonic_solve(s, b, 1e-12, y));
        blocks_solve(b, z);
        for (int i = 0; i < ORDER; i++)
            CHECK_NEAR(y[i], z[i], 1e-10);
        CHECK(by_harmonic_rcond(s) > 0 && by_harmonic_work(s) > 0);
        blocks_free(b);
    }
    by_harmonic_free(s);
    pattern_free(pattern);
    program_free(p);
}

TEST(a_product_with_blocks_undoes_their_solution_with_a_border_or_without)
{
    struct program *p = program_text(
        "{'structure':{'type':'chain','masses':[1,1,1,1,1,1],'springs':[1,1,1,1,1,1,0]},'omega':1,"
        "'effects':[{'type':'cubic_spring','dof':'x2','to':'x5','coefficient':1}]}");
    int place[DOFS] = { 0, 1, 2, 3, 4, 5 };
    struct pattern *pattern = NULL;
    struct blocks *b[2] = { NULL };
    double side[2][ORDER], y[ORDER + 1], z[ORDER + 1], again[ORDER + 1];
    unsigned state = 3;

    CHECK(pattern_new(p, place, DOFS, false, &pattern, NULL) == MODAL_OK);
    CHECK(blocks_new(pattern, HJ, true, &b[1], NULL) == MODAL_OK);
    b[0] = filled(pattern, 0.5);
    for (int i = 0; i < 2 * ORDER; i++)
        side[i / ORDER][i % ORDER] = next(&state);
    blocks_set_border(b[1], b[0], 2, side[0], side[1], 3);
    for (int bordered = 0; bordered < 2; bordered++) {
        for (int i = 0; i < ORDER + bordered; i++)
            y[i] = z[i] = next(&state);
        CHECK(blocks_factor(b[bordered], NULL));
        blocks_solve(b[bordered], z);
        blocks_multiply(b[bordered], z, again);
        for (int i = 0; i < ORDER + bordered; i++)
            CHECK_NEAR(again[i], y[i], 1e-12);
        blocks_free(b[bordered]);
    }
    pattern_free(pattern);
    program_free(p);
}

/* What the first found of the blocks is there for the second, as long as they are the same. */
TEST(a_second_right_hand_side_of_the_same_blocks_costs_less_than_the_first)
{
    struct program *p = program_text(
        "{'structure':{'type':'chain','masses':[1,1,1,1,1,1],'springs':[1,1,1,1,1,1,0]},'omega':1,"
        "'effects':[{'type':'cubic_spring','dof':'x2','to':'x5','coefficient':1},"
        "{'type':'gap','dof':'x3','stiffness':1,'clearance':0}]}");
    int place[DOFS] = { 0, 1, 2, 3, 4, 5 };
    struct pattern *pattern = NULL;
    struct by_harmonic *s = NULL;
    struct blocks *b;
    double y[2][ORDER], z[ORDER], work[3];
    unsigned state = 3;

    CHECK(pattern_new(p, place, DOFS, false, &pattern, NULL) == MODAL_OK);
    CHECK((s = by_harmonic_new(pattern, HJ)) != NULL);
    b = filled(pattern, 0.5);
    CHECK(by_harmonic_factor(s, b) && blocks_factor(b, NULL));
    work[0] = by_harmonic_work(s);
    for (int j = 0; j < 2; j++) {
        for (int i = 0; i < ORDER; i++)                 /* the second: the first, and a little */
            y[j][i] = z[i] = j == 0 ? next(&state) : z[i] + 0.01 * next(&state);
        CHECK(by_harmonic_solve(s, b, 1e-3, y[j]));
        work[j + 1] = by_harmonic_work(s);
    }
    CHECK(work[2] - work[1] < 0.7 * (work[1] - work[0]));
    blocks_solve(b, z);
    for (int i = 0; i < ORDER; i++)
        CHECK_NEAR(y[1][i], z[i], 1e-2);
    blocks_free(b);
    by_harmonic_free(s);
    pattern_free(pattern);
    program_free(p);
}

TEST(a_harmonic_that_is_singular_is_told)
{
    struct program *p = program_text(
        "{'structure':{'type':'chain','masses':[1,1,1,1,1,1],'springs':[1,1,1,1,1,1,0]},"
        "'omega':1,'effects':[]}");
    int place[DOFS] = { 0, 1, 2, 3, 4, 5 };
    struct pattern *pattern = NULL;
    struct by_harmonic *s = NULL;
    struct blocks *b = NULL;

    CHECK(pattern_new(p, place, DOFS, false, &pattern, NULL) == MODAL_OK);
    CHECK((s = by_harmonic_new(pattern, HJ)) != NULL);
    CHECK(blocks_new(pattern, HJ, false, &b, NULL) == MODAL_OK);
    blocks_clear(b);
    CHECK(!by_harmonic_factor(s, b));
    blocks_free(b);
    by_harmonic_free(s);
    pattern_free(pattern);
    program_free(p);
}
