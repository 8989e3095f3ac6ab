/* test_condense_basis.c - a basis that harmonics and frequencies share answers as factors do, to
 * the error that it states, and seldom asks for any */
/* Tests as well: condense.c */
#include "check.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/scene/program.h"
#include "modal/steady/condense.h"
#include "modal/steady/pattern.h"
#include "scene_text.h"

enum { MASSES = 2101, H = 3, POINTS = 16, ROOM = 64 * MASSES, SEEN = 300 };

/* A chain with a cubic spring on its middle mass and a load on another. */
static struct program *chain(void)
{
    char *text = malloc(ROOM), *at = text;
    struct program *p;

    assert_non_null(text);
    at += sprintf(at, "{'omega':0.002,'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < MASSES; i++)
        at += sprintf(at, ",%g", 1 + 0.2 * (i % 7));
    at += sprintf(at, "],'springs':[1");
    for (int i = 0; i < MASSES; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'dampers':[0");
    for (int i = 0; i < MASSES; i++)
        at += sprintf(at, ",2");
    at += sprintf(at, "]},'effects':[{'type':'cubic_spring','dof':'x1000','coefficient':1},"
                  "{'type':'rayleigh_damping','alpha':1e-4,'beta':0}],"
                  "'excitation':[{'dof':'x700','k':1,'cos':1},{'dof':'x700','k':3,'sin':0.2}]}");
    p = program_text(text);
    free(text);
    return p;
}

struct answer { double complex S[H + 1], p[H + 1], x[H + 1]; };

static struct answer ask(struct condense *c, double omega)
{
    static const double complex kept[H + 1] = { 0.1, 1, 0.2 - 0.1 * I, 0.05 * I };
    struct modal_error err = { 0 };
    struct answer a;

    CHECK(condense_at(c, omega, 1, H, a.S, a.p, &err) == MODAL_OK);
    CHECK(condense_recover(c, SEEN, H, kept, H, a.x, &err) == MODAL_OK);
    return a;
}

/* A frequency of a curve that passes several resonances of the chain. */
static double omega_at(int i) { return 0.002 + 0.0001 * i; }

/* How far the answers with a basis of TOLERANCE are from those of factors, relative, at most; the
 * same over what the basis says of itself; and how many harmonics were factored. */
static void compare(double tolerance, double *far, double *over, int *factored)
{
    static const int seen = SEEN;
    struct program *p = chain();
    struct condense *alone, *shared;
    struct modal_error err = { 0 };

    CHECK(condense_new(p, CONDENSE_LINEAR, &alone, &err) == MODAL_OK);
    CHECK(condense_new(p, CONDENSE_LINEAR, &shared, &err) == MODAL_OK);
    condense_want(alone, &seen, 1);
    condense_want(shared, &seen, 1);
    CHECK(condense_share(shared, tolerance, &err) == MODAL_OK);
    *far = *over = *factored = 0;
    for (int i = 0; i < POINTS; i++) {
        struct answer a = ask(alone, omega_at(i)), b = ask(shared, omega_at(i));

        for (int k = 0; k <= H; k++) {
            double off = fmax(cabs(a.S[k] - b.S[k]) / cabs(a.S[k]),
                              cabs(a.x[k] - b.x[k]) / (1 + cabs(a.x[k])));

            CHECK(condense_doubt(shared, k) <= tolerance);
            *factored += condense_doubt(shared, k) == 0;
            off = fmax(off, cabs(a.p[k] - b.p[k]));
            *far = fmax(*far, off);
            *over = fmax(*over, off / (condense_doubt(shared, k) + 1e-9));
        }
    }
    condense_free(alone);
    condense_free(shared);
    program_free(p);
}

TEST(a_curve_by_a_basis_is_that_of_factors_and_factors_a_third_of_its_harmonics_at_most)
{
    double far, over;
    int factored;

    compare(1e-10, &far, &over, &factored);
    CHECK(far <= 1e-9);
    CHECK(factored <= POINTS + POINTS * H / 3);        /* statics have no frequency, and no doubt */
}

TEST(what_a_coarse_basis_leaves_is_within_three_times_what_it_says)
{
    double far, over;
    int factored;

    compare(1e-2, &far, &over, &factored);
    CHECK(far > 1e-9);
    CHECK(over <= 3);
}
