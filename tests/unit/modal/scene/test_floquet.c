/* Tests as well: hill.c hill_found.c hill_growth.c hill_leading.c hill_sums.c hill_window.c
 * leading.c magnus.c parametric_stiffness.c statespace.c */
#include "check.h"
#include <float.h>
#include "modal/scene/floquet.h"
#include "modal/scene/hill.h"
#include "modal/scene/hill_growth.h"
#include "modal/scene/hill_leading.h"
#include "modal/scene/magnus.h"
#include "scene_text.h"

static struct floquet floquet_text(const char *text)
{
    struct modal_error err;
    struct program *p = program_text(text);
    struct floquet f;

    if (floquet(p, NULL, &f, &err) != MODAL_OK)
        fail_msg("%s: %s: %s", text, err.field, err.message);
    program_free(p);
    return f;
}

TEST(one_damped_mass_has_its_closed_form)
{
    struct floquet f = floquet_text(
        "{'structure':{'type':'chain','masses':[2],'springs':[50,0],'dampers':[0.6,0]}}");

    CHECK(f.count == 2 && !f.periodic);
    CHECK_NEAR(creal(f.exponent[0]), -0.15, 1e-16);
    CHECK_NEAR(cimag(f.exponent[0]), sqrt(25 - 0.0225), 1e-15);
    CHECK(f.stable == FLOQUET_STABLE);
    CHECK_NEAR(f.margin, 0.15, 1e-16);
    floquet_done(&f);
}

/* Damping of 1e-6 of critical beside a mode 1e4 times stiffer: its relative error stays that of
 * doubles. */
TEST(tiny_damping_beside_a_stiff_mode_keeps_its_digits)
{
    struct floquet f =
        floquet_text("{'structure':{'type':'chain','masses':[1,1],'springs':[1,0,1e8]},'effects':"
                     "[{'type':'modal_damping','ratios':[1e-6,0.01]}]}");

    CHECK_NEAR(creal(f.exponent[0]) / -1e-6, 1, 1e-12);
    CHECK(f.stable == FLOQUET_STABLE);
    floquet_done(&f);
}

TEST(an_undamped_and_a_free_structure_are_undecided_and_a_divergent_one_is_not)
{
    struct floquet a =
        floquet_text("{'structure':{'type':'chain','masses':[1,2],'springs':[3,4,5]}}");
    struct floquet b =
        floquet_text("{'structure':{'type':'chain','masses':[1,2],'springs':[0,4,0]}}");
    struct floquet c =
        floquet_text("{'structure':{'type':'chain','masses':[1,2],'springs':[-3,4,0]}}");

    CHECK(a.stable == FLOQUET_UNDECIDED && a.margin == 0);
    CHECK(b.stable == FLOQUET_UNDECIDED);
    CHECK(c.stable == FLOQUET_UNSTABLE);
    floquet_done(&a);
    floquet_done(&b);
    floquet_done(&c);
}

/* Two ratios for six modes: the other four are undamped, whatever rounding the products with Phi
 * leave in C. */
TEST(modes_left_without_damping_are_undecided_beside_damped_ones)
{
    struct floquet f = floquet_text("{'structure':{'type':'chain','masses':"
                                    "[0.13,1.9,5.1,1.5,0.33,4.8],'springs':"
                                    "[34,2.8,112,3.8,3.7,0,384]},'effects':"
                                    "[{'type':'modal_damping','ratios':[0.02,0.06]}]}");

    CHECK(f.stable == FLOQUET_UNDECIDED);
    CHECK_NEAR(f.margin, 0, 1e-15);
    floquet_done(&f);
}

/* A free beam drifts: its rigid motions have 0 four times, not the root of the rounding beside a
 * mode of 1e5 rad/s; then come its undamped modes by frequency, the first (4.7300407 / l)^2 sqrt(EI
 * / m) to the elements' h^4. */
TEST(a_free_beam_is_undecided_and_its_modes_come_by_frequency)
{
    struct floquet f = floquet_text("{'structure':{'type':'beam','length':1,'elements':8,'EI':6570,"
                                    "'mass_per_length':3.24,'supports':['free','free']}}");

    CHECK(f.count == 36 && f.stable == FLOQUET_UNDECIDED);
    CHECK_NEAR(cimag(f.exponent[4]) / (4.7300407 * 4.7300407 * sqrt(6570 / 3.24)), 1, 1e-4);
    for (int i = 0; i < 4; i++)
        CHECK_NEAR(cabs(f.exponent[i]), 0, f.bar[i]);
    for (int i = 6; i < f.count; i += 2)
        CHECK(cimag(f.exponent[i]) > cimag(f.exponent[i - 2]));
    floquet_done(&f);
}

/* Gyroscopic: M = I, K = k I, speed G = [0 2w; -2w 0]: whirl at sqrt(w^2 + k) +- w. */
TEST(gyroscopic_whirl_splits_as_the_closed_form)
{
    struct floquet f = floquet_text("{'structure':{'type':'matrices','M':[[1,0],[0,1]],'K':[[7,0],"
                                    "[0,7]],'G':[[0,2],[-2,0]],'speed':1.3}}");
    double high = sqrt(1.3 * 1.3 + 7) + 1.3, low = sqrt(1.3 * 1.3 + 7) - 1.3;
    int found = 0;

    for (int i = 0; i < 4; i++)
        found += fabs(fabs(cimag(f.exponent[i])) - high) < 1e-14 * 20 ||
                 fabs(fabs(cimag(f.exponent[i])) - low) < 1e-14 * 20;
    CHECK(found == 4 && f.stable == FLOQUET_UNDECIDED);
    floquet_done(&f);
}

#define STRUTT(omega, mu, c) \
    "{'structure':{'type':'matrices','M':[[1]],'K':[[1]],'C':[[" c "]]},'omega':" omega \
    ",'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':-" mu "}]}"

/* q'' + (1 - 0.3 cos 2t) q = 0: |rho| = 1.264911399 by an order-8 Runge-Kutta code of others (10
 * digits printed); the determinant of an undamped monodromy matrix is 1. */
TEST(the_principal_tongue_grows_as_tabulated)
{
    struct floquet f = floquet_text(STRUTT("2", "0.3", "0"));

    CHECK(f.periodic && f.count == 2 && f.stable == FLOQUET_UNSTABLE);
    CHECK_NEAR(f.max_multiplier, 1.264911399, 5e-10);
    CHECK_NEAR(creal(f.multiplier[0] * f.multiplier[1]), 1, 1e-13);
    CHECK_NEAR(cimag(f.exponent[0]), 1, 1e-14);               /* negative real: Im = pi / T = 1 */
    floquet_done(&f);
}

/* delta = 0.028282992: |rho| = 1.209966412; det = e^(-delta T). */
TEST(damping_shrinks_the_growth_and_the_determinant)
{
    struct floquet f = floquet_text(STRUTT("2", "0.3", "0.02828299212628083"));

    CHECK_NEAR(f.max_multiplier, 1.209966412, 5e-10);
    CHECK_NEAR(creal(f.multiplier[0] * f.multiplier[1]), exp(-0.02828299212628083 * M_PI), 1e-13);
    floquet_done(&f);
}

/* Edges of the undamped principal tongue at mu = 0.15, from Hill's determinant of others:
 * 0.923779552, 1.073499453. */
TEST(the_verdict_changes_at_the_tongue_s_edges)
{
    static const struct { const char *text; enum floquet_verdict expected;
    } cases[] = { { STRUTT("1.84755910", "0.3", "0"), FLOQUET_UNDECIDED },
                  { STRUTT("1.84755912", "0.3", "0"), FLOQUET_UNSTABLE },
                  { STRUTT("2.14699889", "0.3", "0"), FLOQUET_UNSTABLE },
                  { STRUTT("2.14699892", "0.3", "0"), FLOQUET_UNDECIDED },
                  { STRUTT("1.8475", "0.3", "0.001"), FLOQUET_STABLE } };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct floquet f = floquet_text(cases[i].text);
        if (f.stable != cases[i].expected)
            fail_msg("%s: |rho| %.17g, bar %g", cases[i].text, f.max_multiplier, f.bar[0]);
        floquet_done(&f);
    }
}

/* The period may hold two cycles: multipliers square, exponents stay modulo i 2 pi / T. */
TEST(twice_the_period_squares_the_multipliers)
{
    struct floquet one = floquet_text(STRUTT("1.7", "0.3", "0.01"));
    struct floquet two =
        floquet_text("{'structure':{'type':'matrices','M':[[1]],'K':[[1]],'C':[[0.01]]},"
                     "'omega':1.7,'period':7.3919827143282197,"
                     /* 4 pi / 1.7 */
                     "'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':-0.3}]}");

    CHECK_NEAR(two.max_multiplier, one.max_multiplier * one.max_multiplier, 1e-12);
    CHECK_NEAR(creal(two.exponent[0]), creal(one.exponent[0]), 1e-12);
    floquet_done(&one);
    floquet_done(&two);
}

TEST(hill_s_determinant_agrees_with_the_monodromy_matrix)
{
    struct program *p = program_text(
        "{'structure':{'type':'beam','length':1,'elements':3,'EI':6570,'mass_per_length':3.24},"
        "'omega':888,'effects':[{'type':'axial_load','mean':2000,'amplitude':19000},"
        "{'type':'strain_rate_damping','mu':1e-5},{'type':'parametric_stiffness','dof':'w1',"
        "'stiffness':3e4,'k':2,'phase':0.7}]}");
    struct floquet f;
    struct hill h;

    CHECK(floquet(p, NULL, &f, NULL) == MODAL_OK);
    CHECK(hill(p, 0, &h, NULL) == MODAL_OK);
    CHECK(h.count == f.count && h.truncation < 1e-6);
    for (int i = 0; i < f.count; i++) {
        double least = HUGE_VAL;
        for (int j = 0; j < h.count; j++)
            least = fmin(least, hypot(creal(f.exponent[i]) - creal(h.exponent[j]),
                                      remainder(cimag(f.exponent[i]) - cimag(h.exponent[j]), 888)));
        if (f.resolved[i] && cabs(f.multiplier[i]) > 1e-3)
            CHECK_NEAR(least, 0, 10 * h.truncation + 1e-7);
    }
    hill_done(&h);
    floquet_done(&f);
    program_free(p);
}

/* Halving the step of a sixth-order method divides its error by 64. */
TEST(magnus_steps_are_of_order_six)
{
    struct program *p = program_text(STRUTT("2", "0.6", "0.1"));
    struct statespace *ss = NULL;
    struct magnus *m = NULL;
    double reference[4], coarse[4], fine[4], error;
    int substeps = 64;

    CHECK(statespace_new(p, &ss, NULL) == MODAL_OK);
    CHECK(magnus_new(ss, NULL, &m, NULL) == MODAL_OK);
    CHECK(magnus_converge(m, 0.3, M_PI, 1e-14, &substeps, reference, &error, NULL) == MODAL_OK);
    CHECK(magnus_map(m, 0.3, M_PI, 8, coarse, NULL) == MODAL_OK);
    CHECK(magnus_map(m, 0.3, M_PI, 16, fine, NULL) == MODAL_OK);
    double a = 0, b = 0;
    for (int i = 0; i < 4; i++) {
        a = fmax(a, fabs(coarse[i] - reference[i]));
        b = fmax(b, fabs(fine[i] - reference[i]));
    }
    CHECK(b > 1e-12 && log2(a / b) > 5.8 && log2(a / b) < 6.4);
    magnus_free(m);
    statespace_free(ss);
    program_free(p);
}

TEST(a_multiplier_below_rounding_has_no_exponent)
{
    struct floquet f =
        floquet_text("{'structure':{'type':'chain','masses':[1,1],'springs':[1,0,1],'dampers':"
                     "[0.01,0,40]},'omega':0.5,'effects':[{'type':'parametric_stiffness',"
                     "'dof':'x1','stiffness':0.1}]}");
    /* the second mass has exponents -0.025 and -39.97: e^(-39.97 * 12.6) = 1e-218 */
    int unknown = 0;

    for (int i = 0; i < f.count; i++)
        unknown += !f.resolved[i];
    CHECK(unknown == 1 && !f.resolved[3] && isfinite(f.margin));
    floquet_done(&f);
}

TEST(what_is_not_linear_is_refused_and_growth_past_doubles_is_said)
{
    struct program *p =
        program_text("{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'effects':"
                     "[{'type':'cubic_spring','dof':'x1','coefficient':1}]}");
    struct program *q =
        program_text("{'structure':{'type':'chain','masses':[1],'springs':[-4e6,0]},'omega':1,"
                     "'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':1}]}");
    struct modal_error err;
    struct floquet f = { .count = -7 };

    CHECK(floquet(p, NULL, &f, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "effects[0]");
    CHECK(floquet(q, NULL, &f, &err) == MODAL_OVERFLOW);
    CHECK(f.count == -7);
    program_free(p);
    program_free(q);
}

/* Pulsating at 3 Omega deep enough that twelve harmonics (four of its own) leave 1e-3: more are
 * taken, until the two ways agree. */
TEST(exponents_past_the_range_of_doubles_are_refused_as_that)
{
    struct modal_error err = { 0 };
    struct floquet f;
    struct program *p = program_text("{'structure':{'type':'matrices','M':[[1,0],[0,3.5e-310]],"
                                     "'K':[[-1.2e-278,1.8e159],[4e-312,0]]},'omega':2}");

    CHECK(floquet(p, NULL, &f, &err) == MODAL_OVERFLOW);
    CHECK(strstr(err.message, "an exponent leaves the range of doubles") != NULL);
    program_free(p);
}

TEST(hill_takes_harmonics_until_its_truncation_is_small)
{
    struct program *p = program_text(
        "{'structure':{'type':'chain','masses':[0.137],'springs':[0,53.6]},'omega':3.03,'effects':"
        "[{'type':'parametric_stiffness','dof':'x1','stiffness':24.6,'k':3}]}");
    struct floquet f;
    struct hill twelve, h;

    CHECK(floquet(p, NULL, &f, NULL) == MODAL_OK);
    CHECK(hill(p, 12, &twelve, NULL) == MODAL_OK && twelve.truncation > 1e-5);
    CHECK(hill(p, 0, &h, NULL) == MODAL_OK && h.harmonics > 12 && h.truncation < 1e-9);
    for (int i = 0; i < 2; i++) {
        double least = HUGE_VAL;
        for (int j = 0; j < 2; j++)
            least =
                fmin(least, hypot(creal(f.exponent[i]) - creal(h.exponent[j]),
                                  remainder(cimag(f.exponent[i]) - cimag(h.exponent[j]), 3.03)));
        CHECK_NEAR(least, 0, 1e-10);
    }
    hill_done(&twelve);
    hill_done(&h);
    floquet_done(&f);
    program_free(p);
}

/* COUNT unit masses and springs with dampers 0.01, a spring in three pulsating; loads, which a map
 * must not see. */
static char *pulsating_chain(int count)
{
    char *text = malloc(40 * (size_t)count + 600), *at = text;
    static const char *const values[] = { ",'masses':[1", "],'springs':[1,1",
                                          "],'dampers':[0.01,0.01" };

    at += sprintf(at, "{'structure':{'type':'chain'");
    for (int list = 0; list < 3; list++) {
        at += sprintf(at, "%s", values[list]);
        for (int i = 1; i < count; i++)
            at += sprintf(at, list == 2 ? ",0.01" : ",1");
    }
    sprintf(at, "]},'omega':1.3,'excitation':[{'dof':'x2','k':1,'cos':3}],'effects':["
                "{'type':'parametric_stiffness','dof':'x1','stiffness':0.2,'k':1},"
                "{'type':'parametric_stiffness','dof':'x9','stiffness':0.3,'k':2,'phase':0.4}]}");
    return text;
}

/* Both ways know Phi to 1e-9 at least; multipliers of modulus near 1 are some 0.1 apart. */
TEST(the_leading_multipliers_are_those_of_the_whole_spectrum)
{
    char *text = pulsating_chain(40);
    struct program *p = program_text(text);
    struct floquet all, few;

    CHECK(floquet(p, NULL, &all, NULL) == MODAL_OK && !all.leading && all.count == 80);
    CHECK(floquet(p, &(struct floquet_options){ .multipliers = 9 }, &few, NULL) == MODAL_OK);
    CHECK(few.leading && few.count == 10 && few.stable == FLOQUET_STABLE);
    for (int i = 0; i < few.count; i++) {
        double nearest = HUGE_VAL;
        for (int j = 0; j < few.count; j++)
            nearest = fmin(nearest, cabs(few.multiplier[i] - all.multiplier[j]));
        CHECK_NEAR(nearest, 0, 1e-9);
        CHECK(few.bar[i] < 1e-7 && nearest <= few.bar[i] + all.bar[i]);
    }
    CHECK_NEAR(few.margin, all.margin, 1e-9);
    floquet_done(&all);
    floquet_done(&few);
    program_free(p);
    free(text);
}

/* x1 alone pulsates at twice its frequency: Mathieu's tongue, beside 260 masses that are damped. */
TEST(an_unstable_multiplier_of_many_states_is_found)
{
    enum { N = 260 };
    char *text = malloc(30 * N + 800), *at = text;
    struct floquet small = floquet_text(
        "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'omega':2,'effects':["
        "{'type':'parametric_stiffness','dof':'x1','stiffness':0.3,'k':1}]}");

    at += sprintf(at, "{'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < N; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'springs':[1,0");
    for (int i = 1; i < N; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'dampers':[0,0");
    for (int i = 1; i < N; i++)
        at += sprintf(at, ",0.5");
    sprintf(at, "]},'omega':2,'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':0.3,"
                "'k':1}]}");
    struct floquet f = floquet_text(text);

    CHECK(f.leading && f.count >= FLOQUET_LEADING && f.stable == FLOQUET_UNSTABLE);
    CHECK(small.stable == FLOQUET_UNSTABLE);
    CHECK_NEAR(f.max_multiplier, small.max_multiplier, 1e-8);
    floquet_done(&f);
    floquet_done(&small);
    free(text);
}

/* COUNT unit masses and springs with dampers 0.01, those of AT on springs that pulsate with
 * cos(K OMEGA t + PHASE); PERIOD 0: OMEGA's.  Nothing links mass CUT with the next. */
static struct program *pumped_chain(int count, int cut, const int *at, int pumps, double omega,
                                    int k, double phase, double period)
{
    static const char *const names[] = { "'masses':[1", "],'springs':[1,1",
                                         "],'dampers':[0.01,0.01" };
    char *text = malloc(20 * (size_t)count + 100 * (size_t)pumps + 300), *end = text;
    struct program *p;

    end += sprintf(end, "{'structure':{'type':'chain',");
    for (int list = 0; list < 3; list++) {
        end += sprintf(end, "%s", names[list]);
        for (int i = 1; i < count; i++)
            end += sprintf(end, list > 0 && i + 1 == cut ? ",0" : list == 2 ? ",0.01" : ",1");
    }
    end += sprintf(end, "]},'omega':%.17g,", omega);
    end += period > 0 ? sprintf(end, "'period':%.17g,", period) : 0;
    end += sprintf(end, "'effects':[");
    for (int i = 0; i < pumps; i++)
        end += sprintf(end, "%s{'type':'parametric_stiffness','dof':'x%d','stiffness':0.2,'k':%d,"
                       "'phase':%.17g}", i > 0 ? "," : "", at[i], k, phase);
    sprintf(end, "]}");
    p = program_text(text);
    free(text);
    return p;
}

/* The first WANTED multipliers of P over PERIOD, by windows alone, are the powers of CYCLES of ALL,
 * which LAPACK has of the whole map of one cycle; the largest modulus. */
static double windows_alone(const struct program *p, double period, int wanted,
                            const struct floquet *all, int cycles)
{
    struct modal_error err = { 0 };
    struct hill_leading h;
    double largest;

    CHECK(all->count == 2 * p->n);
    CHECK(hill_leading(p, period, &(struct hill_ask){ .wanted = wanted }, &h, &err) == MODAL_OK);
    CHECK(h.settled && h.sums_to == 0 && h.count >= wanted);
    for (int i = 0; i < h.count; i++) {
        double complex want = cpow(all->multiplier[i], cycles);
        double nearest = HUGE_VAL, own = HUGE_VAL;
        for (int j = 0; j < h.count; j++)
            nearest = fmin(nearest, cabs(h.multiplier[j] - want));
        for (int j = 0; j < all->count; j++)
            own = fmin(own, cabs(cpow(all->multiplier[j], cycles) - h.multiplier[i]));
        CHECK_NEAR(i < wanted ? nearest : 0, 0, 1e-9);
        CHECK_NEAR(i < wanted ? cabs(h.multiplier[i]) : 0, i < wanted ? cabs(want) : 0, 1e-9);
        CHECK_NEAR(own, 0, 1e-9);
    }
    largest = cabs(h.multiplier[0]);
    hill_leading_done(&h);
    return largest;
}

static double windows_and_map(const struct program *p, double period, int wanted)
{
    struct floquet all;
    double largest;

    CHECK(floquet(p, NULL, &all, NULL) == MODAL_OK);
    largest = windows_alone(p, period, wanted, &all, 1);
    floquet_done(&all);
    return largest;
}

/* 120 masses, 20 of them pumped: two pairs of multipliers that leave the circle do so far above
 * the slow motions where windows begin. */
TEST(windows_alone_find_what_leaves_the_circle_by_a_sum_of_two_frequencies)
{
    check_night();
    static const int at[] = { 4, 7, 9, 13, 17, 26, 35, 38, 52, 54,
                              64, 65, 73, 84, 90, 93, 97, 102, 113, 117 };
    struct program *p = pumped_chain(120, 0, at, sizeof at / sizeof *at, 1.3, 1, 0, 0);

    CHECK(windows_and_map(p, 2 * M_PI / 1.3, 10) > 1);
    program_free(p);
}

/* One pump of 1.3 rad/s as harmonic k of 1.3 / k, over whole cycles of it: wherever a cycle begins,
 * its map has the same multipliers.  The largest modulus over one is that of numpy's eigenvalues of
 * the map by scipy's DOP853 to 3e-13. */
TEST(windows_know_a_period_of_several_cycles_of_what_pulsates_and_a_harmonic_that_is_not_the_first)
{
    check_slow();
    static const int at[] = { 4, 7, 9, 13, 17, 26, 35, 38, 52, 54 };
    static const struct { int k, cycles; double phase; } cases[] = {
        { 3, 1, 0.4 }, { 2, 2, 1.1 }, { 1, 2, 0 }, { 1, 3, 0.4 }, { 2, 1, 0 }, { 3, 6, -0.7 },
    };
    struct program *one = pumped_chain(60, 0, at, sizeof at / sizeof *at, 1.3, 1, 0, 0);
    struct floquet all;

    CHECK(floquet(one, NULL, &all, NULL) == MODAL_OK);
    for (int i = 0; i < check_draws(2, sizeof cases / sizeof *cases); i++) {
        double period = cases[i].cycles * 2 * M_PI / 1.3;
        struct program *p = pumped_chain(60, 0, at, sizeof at / sizeof *at,
                                         1.3 / cases[i].k, cases[i].k, cases[i].phase, period);
        double largest = windows_alone(p, period, 10, &all, cases[i].cycles);
        CHECK_NEAR(pow(largest, 1.0 / cases[i].cycles), 1.044918874781, 1e-10);
        program_free(p);
    }
    floquet_done(&all);
    program_free(one);
}

/* A real exponent far right of all that windows along the axis see.  By numpy. */
TEST(windows_alone_find_a_divergence_far_right_of_the_axis)
{
    enum { N = 60 };
    char *text = malloc(30 * N + 400), *end = text;
    struct modal_error err = { 0 };
    struct hill_leading h;
    struct program *p;

    end += sprintf(end, "{'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < N; i++)
        end += sprintf(end, ",1");
    end += sprintf(end, "],'springs':[1e4");
    for (int i = 0; i < N; i++)
        end += sprintf(end, ",1e4");
    end += sprintf(end, "],'dampers':[0.5");
    for (int i = 0; i < N; i++)
        end += sprintf(end, ",0.5");
    sprintf(end, "]},'omega':3,'effects':[{'type':'parametric_stiffness','dof':'x5','stiffness':"
            "1000,'k':1},{'type':'spring','dof':'x30','stiffness':-1.5e4}]}");
    p = program_text(text);
    CHECK(hill_leading(p, 2 * M_PI / 3, &(struct hill_ask){ .wanted = 4 }, &h, &err) == MODAL_OK);
    CHECK(h.settled && h.growing == 1 && cimag(h.multiplier[0]) == 0);
    CHECK_NEAR(log(cabs(h.multiplier[0])) * 3 / (2 * M_PI) / 70.611002097414, 1, 1e-11);
    CHECK(cabs(h.multiplier[1]) < 1);
    hill_leading_done(&h);
    program_free(p);
    free(text);
}

/* Forty unit masses on springs of 1 with dampers of 0.01, as matrices. */
struct grown {
    const char *pumps;
    bool free, pushed, turns, circulates;  /* no ends; -1.6 on x20; gyroscopic; unsymmetric */
    int count[3];                          /* beyond 0.02, 0.05 and 0.125 of omega */
};

static struct program *grown_program(const struct grown *c)
{
    enum { N = 40 };
    char *text = malloc(3 * 12 * N * N + 600), *end = text;
    struct program *p;

    end += sprintf(end, "{'structure':{'type':'matrices'");
    for (int part = 0; part < 3; part++) {
        end += sprintf(end, ",'%c':[", "MCK"[part]);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) {
                bool rim = c->free && (i == 0 || i == N - 1);
                double v = i == j ? (rim ? 1 : 2) : abs(i - j) == 1 ? -1 : 0;
                v = part == 0 ? i == j : part == 1 ? v * 0.01 : v;
                v -= part == 2 && c->pushed && i == 19 && j == 19 ? 1.6 : 0;
                v += part == 1 && c->turns && i / 2 == j / 2 ? (j - i) * 0.4 : 0;
                v += part == 2 && c->circulates && i == 14 && j == 17 ? 0.5 : 0;
                v -= part == 2 && c->circulates && i == 17 && j == 14 ? 0.5 : 0;
                end += sprintf(end, "%s%.3g", j > 0 ? "," : i > 0 ? "],[" : "[", v);
            }
        end += sprintf(end, "]]");
    }
    sprintf(end, "},'omega':1.3,'effects':[%s]}", c->pumps);
    p = program_text(text);
    free(text);
    return p;
}

#define PUMP(dof, stiffness) "{'type':'parametric_stiffness','dof':'" dof "','stiffness':" \
    stiffness ",'k':1}"

/* Of numpy's eigenvalues of the map by scipy's DOP853; none is nearer to a line than 4e-5 omega. */
TEST(what_grows_faster_than_a_rate_is_counted_wherever_it_is)
{
    static const struct grown cases[] = {
        { PUMP("x5", "0.8"), false, true, false, false, { 1, 1, 1 } },
        { PUMP("x10", "3") "," PUMP("x25", "2.5"), false, false, false, false, { 5, 3, 1 } },
        { PUMP("x10", "1.5"), true, false, false, false, { 4, 0, 0 } },
        { PUMP("x10", "3"), false, true, true, false, { 2, 2, 2 } },
        { PUMP("x10", "2"), false, false, false, true, { 0, 0, 0 } },
    };
    static const double rate[] = { 0.02, 0.05, 0.125 };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct program *p = grown_program(&cases[i]);
        for (size_t k = 0; k < sizeof rate / sizeof *rate; k++) {
            struct modal_error err = { 0 };
            double work = 0;
            int count = -1;
            CHECK(hill_growth(p, 2 * M_PI / 1.3, rate[k] * 1.3, HUGE_VAL, &count, &work, &err)
                  == MODAL_OK);
            CHECK(count == cases[i].count[k] && work > 0);
        }
        program_free(p);
    }
}

/* Windows alone.  By numpy's eigenvalues of the map by Magnus's fourth order in 0.12 radians of the
 * fastest.  The third pulsates by more than what holds its dof, and what grows by 0.109 omega lies
 * far from all of the constant part. */
TEST(windows_alone_settle_free_and_turning_chains_and_what_pulsates_by_more_than_what_holds)
{
    static const struct { struct grown of; double omega, largest; } cases[] = {
        { { PUMP("x10", "0.8"), true, false, false, false, { 0 } }, 1.3, 1.098823 },
        { { PUMP("x10", "0.8"), true, false, true, false, { 0 } }, 1.3, 1.114208 },
        { { PUMP("x10", "9"), false, false, false, false, { 0 } }, 5, 1.985370 },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct program *p = grown_program(&cases[i].of);
        struct modal_error err = { 0 };
        struct hill_leading h;

        p->omega = cases[i].omega;
        CHECK(hill_leading(p, 2 * M_PI / p->omega, &(struct hill_ask){ .wanted = 10 }, &h, &err)
              == MODAL_OK);
        CHECK(h.settled);
        CHECK_NEAR(cabs(h.multiplier[0]), cases[i].largest, 1e-6);
        hill_leading_done(&h);
        program_free(p);
    }
}

/* A hundred unit masses on springs of 1e4 without ends, and one spring that pulsates: far above
 * omega there is much that turns between two samples of the line. Numpy's eigenvalues of the map
 * by Magnus's fourth order have the exponents 1.228, 0.884 and 0.443; the line is at 0.375. */
TEST(the_count_follows_what_turns_fast_along_its_line)
{
    enum { N = 100 };
    char *text = malloc(20 * N + 300), *at = text;

    at += sprintf(at, "{'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < N; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'springs':[0");
    for (int i = 1; i < N; i++)
        at += sprintf(at, ",1e4");
    sprintf(at, ",0]},'omega':3,'effects':[%s]}", PUMP("x5", "1000"));
    struct program *p = program_text(text);
    struct modal_error err = { 0 };
    double work = 0;
    int count = -1;
    CHECK(hill_growth(p, 2 * M_PI / 3, 0.125 * 3, HUGE_VAL, &count, &work, &err) == MODAL_OK);
    CHECK(count == 3);
    program_free(p);
    free(text);
}

/* A chain of unit springs that ends in two masses with a spring of STIFF between; two motions grow
 * beyond the line at 0.13.  The work of counting them.  By numpy's eigenvalues of the map by
 * scipy's DOP853, with one mass of 2 for those two: 0.248, 0.158 and 0.091. */
static double work_of_counting(double stiff)
{
    enum { N = 20 };
    char text[1000], *at = text;
    double work = 0;
    int count = -1;

    at += sprintf(at, "{'structure':{'type':'chain','masses':[1");
    for (int i = 1; i <= N; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'springs':[1");
    for (int i = 1; i < N; i++)
        at += sprintf(at, ",1");
    sprintf(at, ",%g,0]},'omega':1.3,'effects':[%s]}", stiff,
            PUMP("x10", "3") "," PUMP("x15", "2.5"));
    struct program *p = program_text(text);
    CHECK(hill_growth(p, 2 * M_PI / 1.3, 0.1 * 1.3, HUGE_VAL, &count, &work, NULL) == MODAL_OK);
    CHECK(count == 2);
    program_free(p);
    return work;
}

TEST(counting_what_grows_takes_no_more_however_stiff_a_spring_is)
{
    CHECK(work_of_counting(1e9) < 2 * work_of_counting(1e6));
}

/* Two chains, one the other's mirror image. */
TEST(windows_list_a_double_multiplier_twice_and_not_more)
{
    static const int at[] = { 4, 9, 52, 57 };

    for (int k = 1; k <= 2; k++) {
        struct program *p = pumped_chain(60, 30, at, sizeof at / sizeof *at, 1.3, k, 0, 0);
        CHECK(windows_and_map(p, 2 * M_PI / 1.3, 10) > 0.9);
        program_free(p);
    }
}

/* The five pairs of largest modulus of 1000 unit masses and springs with dampers 0.01, each 111th
 * mass on a spring that pulsates: LAPACK's of numpy's whole map, a Taylor series of 46 terms in
 * each of three steps.  The third pair is a combination resonance far above the others. */
TEST(a_combination_resonance_apart_from_the_slow_motions_is_among_the_leading)
{
    enum { N = 1000, PAIRS = 5, APART = 111 };
    static const double complex want[PAIRS] = {
        0.9931236995 + 0.1209581260 * I, 0.9947014194 + 0.1060861472 * I,
        0.9710126349 + 0.2402567084 * I, 0.9973872928 + 0.0758941175 * I,
        0.9961190960 + 0.0909770584 * I };
    static const char *const names[] = { "'masses':[1", "],'springs':[1,1",
                                         "],'dampers':[0.01,0.01" };
    char *text = malloc(20 * N + 2000), *at = text;

    at += sprintf(at, "{'structure':{'type':'chain',");
    for (int list = 0; list < 3; list++) {
        at += sprintf(at, "%s", names[list]);
        for (int i = 1; i < N; i++)
            at += sprintf(at, list == 2 ? ",0.01" : ",1");
    }
    at += sprintf(at, "]},'omega':1.3,'effects':[");
    for (int i = 0; i < N; i += APART)
        at += sprintf(at, "%s{'type':'parametric_stiffness','dof':'x%d','stiffness':0.2,'k':1}",
                      i > 0 ? "," : "", i + 1);
    sprintf(at, "]}");
    struct floquet f = floquet_text(text);

    CHECK(f.leading && !f.unsettled && f.count == 2 * PAIRS && f.stable == FLOQUET_UNSTABLE);
    for (int i = 0; i < f.count; i++) {
        CHECK_NEAR(creal(f.multiplier[i]), creal(want[i / 2]), 1e-9);
        CHECK_NEAR(fabs(cimag(f.multiplier[i])), cimag(want[i / 2]), 1e-9);
    }
    floquet_done(&f);
    free(text);
}

/* COUNT masses between walls, springs of STIFFNESS with dampers BETA as much, all of which pulsate
 * by SHARE. */
static char *breathing_chain(int count, double stiffness, double share, double beta, double omega)
{
    char *text = malloc(250 * (size_t)count + 600), *at = text;
    static const char *const names[] = { "'masses'", "'springs'", "'dampers'" };
    double value[] = { 1, stiffness, beta * stiffness };

    at += sprintf(at, "{'structure':{'type':'chain'");
    for (int list = 0; list < 3; list++) {
        at += sprintf(at, ",%s:[%.17g", names[list], value[list]);
        for (int i = 1; i < count + (list > 0); i++)
            at += sprintf(at, ",%.17g", value[list]);
        at += sprintf(at, "]");
    }
    at += sprintf(at, "},'omega':%.17g,'effects':[", omega);
    for (int i = 0; i <= count; i++) {
        at += sprintf(at, "%s{'type':'parametric_stiffness','stiffness':%.17g,'k':1,'dof':'x%d'",
                      i > 0 ? "," : "", share * stiffness, i < count ? i + 1 : count);
        at += i > 0 && i < count ? sprintf(at, ",'to':'x%d'}", i) : sprintf(at, "}");
    }
    sprintf(at, "]}");
    return text;
}

/* Of mode k alone, Mathieu's equation: the multiplier in the upper half plane, or the larger. */
static double complex of_mode(double squared, double share, double beta, double omega)
{
    char text[400];
    double complex w;

    snprintf(text, sizeof text, "{'structure':{'type':'chain','masses':[1],'springs':[%.17g,0],"
             "'dampers':[%.17g,0]},'omega':%.17g,'effects':[{'type':'parametric_stiffness','dof':"
             "'x1','stiffness':%.17g,'k':1}]}", squared, beta * squared, omega, share * squared);
    struct floquet f = floquet_text(text);
    w = cimag(f.multiplier[0]) < 0 ? conj(f.multiplier[0]) : f.multiplier[0];
    floquet_done(&f);
    return w;
}

/* Each mode of such a chain is Mathieu's equation; 300 of them crowd on the circle, and W is twice
 * the frequency of the sixth, which grows. */
TEST(multipliers_that_crowd_on_the_circle_are_those_of_mathieus_equation)
{
    check_slow();
    enum { N = 300, LOOKED = 12 };
    double omega = 4 * sin(6 * M_PI / (2 * (N + 1))), beta = 0.01;
    char *text = breathing_chain(N, 1, 0.1, beta, omega);
    struct floquet f = floquet_text(text);
    bool grows = false;

    CHECK(f.leading && !f.unsettled && f.stable == FLOQUET_UNSTABLE && f.count >= 10);
    for (int i = 0; i < f.count; i++) {
        double nearest = HUGE_VAL;
        for (int k = 1; k <= LOOKED; k++) {
            double w = 2 * sin(k * M_PI / (2 * (N + 1)));
            double complex m = of_mode(w * w, 0.1, beta, omega);
            nearest = fmin(nearest, fmin(cabs(m - f.multiplier[i]),
                                         cabs(conj(m) - f.multiplier[i])));
            grows = grows || cabs(m) > 1;
        }
        CHECK_NEAR(nearest, 0, 1e-9);
    }
    CHECK(grows);
    floquet_done(&f);
    free(text);
}

/* 1311 rad/s over a period of 2 pi s: a map of 40 states takes thousands of steps. */
TEST(all_multipliers_of_a_stiff_chain_are_those_of_mathieus_equation_without_a_map)
{
    enum { N = 20 };
    double stiffness = 4.3e5, beta = 2e-7, share = 1e-3;
    char *text = breathing_chain(N, stiffness, share, beta, 1);
    struct floquet f = floquet_text(text);

    CHECK(f.count == 2 * N && f.windows > 0 && !f.leading && !f.unsettled && !f.alike);
    CHECK(f.stable == FLOQUET_STABLE);
    for (int k = 1; k <= N; k++) {
        double w = 2 * sqrt(stiffness) * sin(k * M_PI / (2 * (N + 1)));
        double complex m = of_mode(w * w, share, beta, 1);
        double nearest[2] = { HUGE_VAL, HUGE_VAL };

        for (int i = 0; i < f.count; i++) {
            nearest[0] = fmin(nearest[0], cabs(m - f.multiplier[i]));
            nearest[1] = fmin(nearest[1], cabs(conj(m) - f.multiplier[i]));
        }
        CHECK_NEAR(nearest[0], 0, 1e-9);
        CHECK_NEAR(nearest[1], 0, 1e-9);
    }
    floquet_done(&f);
    free(text);
}

/* A beam about a pin turns freely: 1 is a multiplier, whatever pulsates between its sections.  Its
 * stiffness is 1e8 times that of its lowest motion: what rounding leaves of it is no damping. */
TEST(a_beam_that_turns_about_a_pin_is_undecided_and_one_that_is_clamped_is_stable)
{
    static const struct { const char *held; double alpha; enum floquet_verdict stable; } cases[] = {
        { "pinned", 1, FLOQUET_UNDECIDED }, { "clamped", 0.01, FLOQUET_STABLE },
    };

    for (int i = 0; i < 2; i++) {
        char text[700];
        double nearest = HUGE_VAL, bar = 0;
        struct program *p;
        struct floquet f;

        snprintf(text, sizeof text, "{'structure':{'type':'beam','length':1,'elements':10,'EI':6570"
                 ",'mass_per_length':3.24,'supports':['%s','free']},'omega':30,'effects':[{'type':"
                 "'rayleigh_damping','alpha':%g,'beta':1e-6},{'type':'parametric_stiffness',"
                 "'stiffness':6570,'dof':'th1','to':'th2'}]}", cases[i].held, cases[i].alpha);
        p = program_text(text);
        CHECK(floquet(p, &(struct floquet_options){ .multipliers = 2 }, &f, NULL) == MODAL_OK);
        CHECK(f.windows > 0 && f.stable == cases[i].stable);
        for (int k = 0; k < f.count; k++)
            if (cabs(f.multiplier[k] - 1) < nearest) {
                nearest = cabs(f.multiplier[k] - 1);
                bar = f.bar[k];
            }
        CHECK((nearest <= bar) == (i == 0) && bar < 1e-4);
        floquet_done(&f);
        program_free(p);
    }
}

/* Springs of 1e16 N/m on 1 kg: 2e8 radians a period, which no sum of a minute steps through.
 * Nothing damps: all moduli are 1. */
TEST(a_period_of_more_steps_than_are_paid_for_is_answered_and_what_is_alike_is_said)
{
    enum { N = 260 };
    char *text = malloc(30 * N + 800), *at = text;
    struct floquet f;

    at += sprintf(at, "{'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < N; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'springs':[1e16");
    for (int i = 0; i < N; i++)
        at += sprintf(at, ",1e16");
    sprintf(at, "]},'omega':6,'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':0.3,"
                "'k':1}]}");
    f = floquet_text(text);
    CHECK(f.leading && f.alike && f.count >= 10 && f.stable == FLOQUET_UNDECIDED);
    for (int i = 0; i < f.count; i++)
        CHECK(fabs(cabs(f.multiplier[i]) - 1) <= f.bar[i] && f.bar[i] < 1e-7);
    floquet_done(&f);
    free(text);
}

/* Multipliers by DOP853 of scipy at 1e-13: what holds the chain pulsates about nothing. */
TEST(a_pulsating_spring_alone_holds_a_chain_and_its_period_is_mapped)
{
    const double complex w[] = { -59.0904664826, 0.6142201909136 + 0.1484851752534 * I,
                                 -0.1332869061359 + 0.4236530352663 * I,
                                 -0.0571162112723 + 0.1307114920460 * I, -0.0136828197478 };
    struct floquet f = floquet_text(
        "{'structure':{'type':'chain','masses':[0.12,0.17,0.155,0.14],'springs':[0,1730,5520,5680,"
        "0],'dampers':[0.5,0.4,1.2,1.3,0]},'omega':40,'effects':[{'type':'parametric_stiffness',"
        "'dof':'x1','stiffness':1558,'k':1}]}");
    const int place[] = { 0, 1, 3, 5, 7 };

    CHECK(f.count == 8 && f.stable == FLOQUET_UNSTABLE);
    for (int i = 0; i < 5; i++)
        CHECK_NEAR(cabs(f.multiplier[place[i]] - w[i]), 0, 1e-9);
    floquet_done(&f);
}

/* 1 is a double multiplier with one vector: rounding e parts it by sqrt(e), and its bars say so. */
TEST(rigid_motion_of_a_small_chain_is_a_double_multiplier_of_one_within_its_bars)
{
    struct floquet f = floquet_text(
        "{'structure':{'type':'chain','masses':[0.7,1.3,0.9,2.1],'springs':[0,1.1,3.7,0.6,0],"
        "'dampers':[0,0.02,0.05,0.01,0]},'omega':1.3,'effects':[{'type':'parametric_stiffness',"
        "'dof':'x2','to':'x3','stiffness':0.2,'k':1}]}");
    int near = 0;

    for (int i = 0; i < f.count; i++)
        if (cabs(f.multiplier[i] - 1) < 1e-5) {
            CHECK(cabs(f.multiplier[i] - 1) <= f.bar[i] && f.bar[i] < 1e-5);
            near++;
        } else
            CHECK(f.bar[i] < 1e-10);
    CHECK(near == 2 && f.stable == FLOQUET_UNDECIDED);
    floquet_done(&f);
}

/* A chain that nothing holds keeps its place and its speed: 1 is a double multiplier with one
 * vector, which rounding parts. In other units of mass it is rounded otherwise: searches end a
 * value sooner or later, and nothing that is told may follow from that. */
TEST(rigid_motion_of_a_large_chain_is_a_double_multiplier_of_one_in_all_units)
{
    static const double units[] = { 1, 3, 5 };
    char *text = malloc(40 * 300 + 800);

    assert_non_null(text);
    for (int u = 0; u < check_draws(2, 3); u++) {
        char *at = text;
        struct floquet f;

        at += sprintf(at, "{'structure':{'type':'chain','masses':[%g", units[u]);
        for (int i = 1; i < 300; i++)
            at += sprintf(at, ",%g", units[u]);
        at += sprintf(at, "],'springs':[0");
        for (int i = 1; i < 300; i++)
            at += sprintf(at, ",%g", units[u]);
        at += sprintf(at, ",0],'dampers':[0");
        for (int i = 1; i < 300; i++)
            at += sprintf(at, ",%.17g", 0.02 * units[u]);
        sprintf(at, ",0]},'omega':1.3,'effects':[{'type':'parametric_stiffness','dof':'x100','to':"
                    "'x101','stiffness':%.17g,'k':1}]}", 0.2 * units[u]);
        f = floquet_text(text);
        CHECK(f.leading && !f.unsettled && f.stable == FLOQUET_UNDECIDED);
        for (int i = 0; i < 2; i++)
            CHECK(cabs(f.multiplier[i] - 1) <= f.bar[i] && f.bar[i] < 1e-4);
        CHECK(cabs(f.multiplier[2]) < 1 - 1e-7 && f.bar[2] < 1e-9);
        floquet_done(&f);
    }
    free(text);
}
