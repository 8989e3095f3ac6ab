/* test_condense_basis.c - a basis that harmonics and frequencies share answers as factors do, to
 * the error that it states, and seldom asks for any */
/* Tests as well: condense.c condense_known.c condense_lanczos.c condense_modes.c */
#include "check.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/scene/program.h"
#include "modal/steady/condense_state.h"
#include "modal/steady/pattern.h"
#include "scene_text.h"

enum { MASSES = 2101, H = 3, POINTS = 16, ROOM = 64 * MASSES, SEEN = 300 };

enum damping { UNEVEN, PROPORTIONAL, NONE };

/* A chain with a cubic spring on its middle mass and a load on another; its dampers are in
 * proportion to its springs, UNEVEN: but the first, to the ground. */
static struct program *chain(enum damping damping)
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
    at += sprintf(at, "],'dampers':[%d", damping == PROPORTIONAL ? 2 : 0);
    for (int i = 0; i < MASSES; i++)
        at += sprintf(at, damping == NONE ? ",0" : ",2");
    at += sprintf(at, "]},'effects':[{'type':'cubic_spring','dof':'x1000','coefficient':1},"
                  "{'type':'rayleigh_damping','alpha':%g,'beta':0}],"
                  "'excitation':[{'dof':'x700','k':1,'cos':1},{'dof':'x700','k':3,'sin':0.2}]}",
                  damping == NONE ? 0 : 1e-4);
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

/* How far the answers with a basis of TOLERANCE, told that TOLD points follow, are from those of
 * factors, relative, at most; the same over what the basis says of itself; and how many harmonics
 * were factored. */
static void compare(enum damping damping, double tolerance, int told, double *far, double *over,
                    int *factored)
{
    static const int seen = SEEN;
    struct program *p = chain(damping);
    struct condense *alone, *shared;
    struct modal_error err = { 0 };

    CHECK(condense_new(p, CONDENSE_LINEAR, &alone, &err) == MODAL_OK);
    CHECK(condense_new(p, CONDENSE_LINEAR, &shared, &err) == MODAL_OK);
    condense_want(alone, &seen, 1);
    condense_want(shared, &seen, 1);
    CHECK(condense_share(shared, tolerance, told, &err) == MODAL_OK);
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

    compare(UNEVEN, 1e-10, 1, &far, &over, &factored);
    CHECK(far <= 1e-9);
    CHECK(factored <= POINTS + POINTS * H / 3);        /* statics have no frequency, and no doubt */
}

TEST(what_a_coarse_basis_leaves_is_within_three_times_what_it_says)
{
    double far, over;
    int factored;

    compare(UNEVEN, 1e-2, 1, &far, &over, &factored);
    CHECK(far > 1e-9);
    CHECK(over <= 3);
}

TEST(of_a_curve_with_proportional_damping_nothing_is_factored)
{
    double far, over;
    int factored;

    compare(PROPORTIONAL, 1e-10, POINTS, &far, &over, &factored);
    CHECK(far <= 1e-9);
    CHECK(factored == 0);
    compare(PROPORTIONAL, 1e-2, POINTS, &far, &over, &factored);
    CHECK(over <= 3);
    CHECK(factored == 0);
}

/* The harmonics of the first point are known before it, and of four they are sixteen. */
TEST(of_a_curve_of_four_points_nothing_is_factored_either)
{
    double far, over;
    int factored;

    compare(PROPORTIONAL, 1e-10, 4, &far, &over, &factored);
    CHECK(far <= 1e-9);
    CHECK(factored == 0);
}

/* Springs over the distances of squared frequencies: rounding of factors is a million times as
 * much, and a harmonic or two at a resonance is left to them. */
TEST(a_curve_without_damping_is_that_of_factors_and_factors_next_to_nothing)
{
    double far, over;
    int factored;

    compare(NONE, 1e-8, POINTS, &far, &over, &factored);
    CHECK(far <= 1e-7);
    CHECK(factored <= POINTS / 4);
}

TEST(a_curve_whose_damping_is_not_proportional_is_that_of_factors)
{
    double far, over;
    int factored;

    compare(UNEVEN, 1e-10, POINTS, &far, &over, &factored);
    CHECK(far <= 1e-9);
    CHECK(factored <= POINTS + POINTS * H / 3);
}

TEST(harmonics_that_an_estimate_does_not_need_are_left_and_made_when_they_are_asked_for)
{
    static const double complex force[H + 1] = { [3] = 1 };
    struct program *p = chain(UNEVEN);
    struct condense *whole, *some;
    struct modal_error err = { 0 };
    struct answer a, b;

    CHECK(condense_new(p, CONDENSE_LINEAR, &whole, &err) == MODAL_OK);
    CHECK(condense_new(p, CONDENSE_LINEAR, &some, &err) == MODAL_OK);
    a = ask(whole, omega_at(3));
    condense_rough(some, 1, force, H);
    b = ask(some, omega_at(3));
    CHECK(b.S[1] == a.S[1] && b.S[2] == 0 && b.S[3] == a.S[3]);
    condense_rough(some, 0, NULL, 0);
    b = ask(some, omega_at(3));
    CHECK(b.S[1] == a.S[1] && b.S[2] == a.S[2] && b.x[2] == a.x[2] && b.S[3] == a.S[3]);
    condense_free(whole);
    condense_free(some);
    program_free(p);
}

TEST(what_an_estimate_asks_for_takes_no_factors_holds_to_its_digits_and_is_made_anew_for_a_solution)
{
    static const double complex force[H + 1] = { [3] = 1 };
    static const int seen = SEEN;
    struct program *p = chain(PROPORTIONAL);
    struct condense *alone, *shared;
    struct modal_error err = { 0 };
    int rough = 0;

    CHECK(condense_new(p, CONDENSE_LINEAR, &alone, &err) == MODAL_OK);
    CHECK(condense_new(p, CONDENSE_LINEAR, &shared, &err) == MODAL_OK);
    condense_want(alone, &seen, 1);
    condense_want(shared, &seen, 1);
    CHECK(condense_share(shared, 1e-10, POINTS, &err) == MODAL_OK);
    for (int i = 0; i < POINTS; i++) {
        struct answer a = ask(alone, 10 * omega_at(i)), b;

        CHECK(condense_at(shared, 10 * omega_at(i), 1, 1, b.S, b.p, &err) == MODAL_OK);
        condense_rough(shared, 1, force, H);
        b = ask(shared, 10 * omega_at(i));
        CHECK(cabs(a.S[1] - b.S[1]) <= 1e-9 * cabs(a.S[1]));
        CHECK(condense_doubt(shared, H) > 0);                           /* by the basis */
        CHECK(cabs(a.S[H] - b.S[H]) <= 0.03 * cabs(a.S[H]));
        rough += condense_doubt(shared, H) > 1e-10;
        condense_rough(shared, 0, NULL, 0);
        if (i < POINTS - 1)
            continue;
        b = ask(shared, 10 * omega_at(i));
        CHECK(condense_doubt(shared, H) <= 1e-10);
        CHECK(cabs(a.S[H] - b.S[H]) <= 1e-9 * cabs(a.S[H]));
    }
    CHECK(rough > 0);
    condense_free(alone);
    condense_free(shared);
    program_free(p);
}

/* A membrane of SIDE x HEIGHT masses with a cubic spring on one, a load on another and BETA K. */
static struct program *membrane(int side, int height, double beta)
{
    int n = side * height, entries = 0;
    char *text = malloc(200 * (size_t)n), *at = text, *starts = malloc(8 * (size_t)n + 8),
         *columns = malloc(40 * (size_t)n), *values = malloc(20 * (size_t)n), *s = starts,
         *c = columns, *v = values;
    struct program *p;

    assert_true(text != NULL && starts != NULL && columns != NULL && values != NULL);
    at += sprintf(at, "{'omega':1,'structure':{'type':'matrices','M':{'shape':[%d,%d],"
                  "'row_pointers':[0", n, n);
    for (int i = 0; i < n; i++) {
        int to[] = { i - side, i % side > 0 ? i - 1 : -1, i, i % side < side - 1 ? i + 1 : -1,
                     i + side };

        at += sprintf(at, ",%d", i + 1);
        for (int e = 0; e < 5; e++)
            if (to[e] >= 0 && to[e] < n) {
                c += sprintf(c, "%s%d", entries > 0 ? "," : "", to[e]);
                v += sprintf(v, "%s%d", entries++ > 0 ? "," : "", e == 2 ? 4 : -1);
            }
        s += sprintf(s, ",%d", entries);
    }
    at += sprintf(at, "],'columns':[0");
    for (int i = 1; i < n; i++)
        at += sprintf(at, ",%d", i);
    at += sprintf(at, "],'values':[1");
    for (int i = 1; i < n; i++)
        at += sprintf(at, ",%g", 1 + 0.2 * (i % 7) + 0.01 * (i % 11));
    sprintf(at, "]},'K':{'shape':[%d,%d],'row_pointers':[0%s],'columns':[%s],'values':[%s]}},"
            "'effects':[{'type':'cubic_spring','dof':'x1107','coefficient':1},"
            "{'type':'rayleigh_damping','alpha':0,'beta':%g}],"
            "'excitation':[{'dof':'x440','k':1,'cos':1}]}", n, n, starts, columns, values, beta);
    p = program_text(text);
    free(text);
    free(starts);
    free(columns);
    free(values);
    return p;
}

enum { TOP = 7 };

/* S of membrane P at 0.11 rad/s by factors. */
static void ask_factors(const struct program *p, double complex *S)
{
    struct condense *alone;
    double complex load[TOP + 1];
    struct modal_error err = { 0 };

    CHECK(condense_new(p, CONDENSE_LINEAR, &alone, &err) == MODAL_OK);
    condense_want(alone, NULL, 0);
    CHECK(condense_at(alone, 0.11, 1, TOP, S, load, &err) == MODAL_OK);
    condense_free(alone);
}

/* The same by what is shared where an estimate asks what FORCE, of harmonics 2 .. TOP, moves; what
 * it left out. */
static double ask_roughly(const struct program *p, const double complex *force, double complex *S)
{
    static const int seen = SEEN;
    struct condense *shared;
    double complex load[TOP + 1];
    double left;
    struct modal_error err = { 0 };

    CHECK(condense_new(p, CONDENSE_LINEAR, &shared, &err) == MODAL_OK);
    condense_want(shared, &seen, 1);
    CHECK(condense_share(shared, 1e-8, 40, &err) == MODAL_OK);
    CHECK(condense_at(shared, 0.11, 1, 1, S, load, &err) == MODAL_OK);
    condense_rough(shared, 1, force, TOP);
    CHECK(condense_at(shared, 0.11, 1, TOP, S, load, &err) == MODAL_OK);
    left = condense_left(shared);
    condense_free(shared);
    return left;
}

/* Between sharp resonances S seems to settle before they are apart: it was off by 57 % here. */
TEST(an_estimate_holds_to_its_digits_among_sharp_resonances)
{
    check_slow();
    struct program *p = membrane(50, 44, 1e-6);
    double complex S[TOP + 1], other[TOP + 1];

    ask_factors(p, S);
    for (int k = 3; k <= TOP; k += 2) {
        double complex force[TOP + 1] = { 0 };

        force[k] = 1;
        ask_roughly(p, force, other);
        CHECK(cabs(other[k] - S[k]) <= 0.03 * cabs(S[k]));
    }
    program_free(p);
}

/* Forces as a cubic spring's fall: 0.03 of the largest motion is asked of each, and the last is
 * known to be less than 0.25 of it. */
TEST(an_estimate_is_within_its_digits_of_the_largest_motion_and_what_it_leaves_out_moves_no_more)
{
    static const double complex force[TOP + 1] = { [3] = 1, [5] = 1e-2 * I, [7] = 1e-4 };
    struct program *p = membrane(50, 44, 2e-2);
    double complex S[TOP + 1], other[TOP + 1];
    double left = ask_roughly(p, force, other), most = 0;

    ask_factors(p, S);
    for (int k = 3; k <= TOP; k += 2)
        most = fmax(most, cabs(force[k] / S[k]));
    CHECK(cabs(force[3] / other[3] - force[3] / S[3]) <= 0.03 * most);
    CHECK(cabs(force[5] / other[5] - force[5] / S[5]) <= 0.03 * most);
    CHECK(other[7] == 0);
    CHECK(cabs(force[7] / S[7]) <= left && left <= 0.25 * 1.03 * most);
    program_free(p);
}

/* Without damping a motion has no bound. */
TEST(an_estimate_leaves_nothing_out_where_nothing_damps)
{
    check_slow();
    static const double complex force[TOP + 1] = { [3] = 1, [7] = 1e-4 };
    struct program *p = membrane(50, 44, 0);
    double complex S[TOP + 1], other[TOP + 1];

    ask_factors(p, S);
    CHECK(ask_roughly(p, force, other) == 0);
    CHECK(cabs(other[7] - S[7]) <= 0.03 * cabs(S[7]));
    program_free(p);
}

/* 240,000 entries: what sums of them are rounded by is more than entries may be off. */
TEST(damping_of_a_large_structure_in_proportion_to_its_matrices_is_known_as_that)
{
    check_slow();
    enum { LARGE = 80000 };
    char *text = malloc(12 * LARGE), *at = text;
    struct condense *c;
    struct program *p;
    struct modal_error err = { 0 };
    double alpha, beta;

    assert_non_null(text);
    at += sprintf(at, "{'omega':1,'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < LARGE; i++)
        at += sprintf(at, ",%g", 1 + 0.2 * (i % 7));
    at += sprintf(at, "],'springs':[1");
    for (int i = 0; i < LARGE; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "]},'effects':[{'type':'cubic_spring','dof':'x10','coefficient':1},"
                  "{'type':'rayleigh_damping','alpha':0.01,'beta':0.02}]}");
    p = program_text(text);
    free(text);
    CHECK(condense_new(p, CONDENSE_LINEAR, &c, &err) == MODAL_OK);
    CHECK(condense_proportional(c, &alpha, &beta));
    CHECK_NEAR(alpha, 0.01, 1e-13);
    CHECK_NEAR(beta, 0.02, 1e-13);
    condense_free(c);
    program_free(p);
}
