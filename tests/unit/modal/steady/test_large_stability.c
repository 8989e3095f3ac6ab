/* Stability of motions of many states: against the whole monodromy matrix, and values of others. */
/* Tests as well: disturbance.c leading.c monodromy.c period_map.c stability.c */
#include "check.h"
#include <complex.h>
#include "modal/scene/leading.h"
#include "modal/scene/period_map.h"
#include "modal/steady/disturbance.h"
#include "modal/steady/large_stability.h"
#include "modal/steady/session.h"
#include "modal/steady/solve.h"
#include "modal/steady/stability.h"
#include "scene_text.h"

/* Springs between masses of 1 in a row, each with EFFECTS of its own, where %d is its number; MORE
 * effects. */
static struct program *chain(int n, const char *spring, double omega, const char *effects,
                             const char *more, const char *load)
{
    static char text[200000];
    size_t at = 0, room = sizeof text;

    at += (size_t)snprintf(text + at, room - at, "{'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < n; i++)
        at += (size_t)snprintf(text + at, room - at, ",1");
    at += (size_t)snprintf(text + at, room - at, "],'springs':[%s", spring);
    for (int i = 0; i < n; i++)
        at += (size_t)snprintf(text + at, room - at, ",%s", spring);
    at += (size_t)snprintf(text + at, room - at, "]},'omega':%.17g,'effects':[%s", omega, more);
    for (int i = 1; i <= n; i++)
        at += (size_t)snprintf(text + at, room - at, effects, i);
    snprintf(text + at, room - at, "],'excitation':[%s]}", load);
    return program_text(text);
}

struct verdict {
    struct program *p;
    struct steady *s;
    struct steady_point point;
    struct stability whole, large;
    const char *reason;
};

/* The verdict of a motion of 5 harmonics both ways, the whole one where it has few states. */
static struct verdict verdict_of(struct program *p)
{
    struct verdict v = { .p = p };
    struct steady_options opt = { .harmonics = 5, .estimate_later = true };
    struct disturbance u;

    CHECK(steady_new(p, &opt, &v.s, NULL) == MODAL_OK);
    CHECK(steady_solve(v.s, p->omega, NULL, &v.point, NULL) == MODAL_OK && v.point.converged);
    if (2 * p->n <= STABILITY_STATES_MOST)
        CHECK(stability_of(v.s, &v.point, &v.whole, NULL) == MODAL_OK);
    steady_allow_work(v.s);
    u = (struct disturbance){ .s = v.s, .p = p, .point = &v.point, .budget = &v.s->budget };
    CHECK(disturbance_begin(&u, NULL) == MODAL_OK && disturbance_follow(&u, NULL) == MODAL_OK);
    CHECK(u.reason == NULL && large_stability(&u, &v.large, NULL) == MODAL_OK);
    v.reason = u.reason;
    disturbance_done(&u);
    return v;
}

static void verdict_done(struct verdict *v)
{
    stability_done(&v->whole);
    stability_done(&v->large);
    steady_point_done(&v->point);
    steady_free(v->s);
    program_free(v->p);
}

#define DAMPED "{'type':'rayleigh_damping','alpha':0.05,'beta':0.03}"
#define PUSHED "{'dof':'x1','k':1,'cos':0.5},{'dof':'x7','k':2,'sin':0.3}"

/* Laws that are sampled, of pieces, with sliders, and with slopes that vary within a piece; their
 * multipliers by the monodromy matrix are of another way to carry disturbances. */
TEST(leading_multipliers_are_those_of_the_whole_monodromy_matrix)
{
    static const struct { int n; const char *law; } cases[] = {
        { 50, ",{'type':'cubic_spring','dof':'x%d','coefficient':0.1}" },
        { 100, ",{'type':'gap','dof':'x%d','stiffness':1,'clearance':0.05}" },
        { 30, ",{'type':'gap','dof':'x%d','stiffness':1,'clearance':0.02,'dissipation':0.3}" },
        { 30, ",{'type':'friction','dof':'x%d','stiffness':0.3,'limit':0.01}" },
        { 20, ",{'type':'regularised_coulomb','dof':'x%d','limit':0.03,'velocity':0.05}" },
    };

    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct verdict v = verdict_of(chain(cases[c].n, "1", 0.3, cases[c].law, DAMPED, PUSHED));

        CHECK(v.reason == NULL && v.large.count >= 10);
        CHECK(v.whole.count >= 2 * cases[c].n && v.whole.error < 1e-9);
        CHECK(v.large.verdict == v.whole.verdict);
        for (int i = 0; i < v.large.count; i++) {
            double least = HUGE_VAL;
            for (int k = 0; k < v.whole.count; k++)
                least = fmin(least, cabs(v.large.multiplier[i] - v.whole.multiplier[k]));
            CHECK_NEAR(least, 0, 1e-8);
                        CHECK_NEAR(cabs(v.large.multiplier[i]), cabs(v.whole.multiplier[i]), 1e-8);
        }
        verdict_done(&v);
    }
}

/* Of 200 states one map is within the work allowed, but not a second that would tell its error. */
TEST(a_motion_whose_whole_matrix_costs_too_much_has_its_leading_multipliers)
{
    struct verdict v = verdict_of(chain(
        100, "1", 0.3, ",{'type':'cubic_spring','dof':'x%d','coefficient':0.1}", DAMPED, PUSHED));

    CHECK(v.whole.verdict == STABILITY_STABLE && v.whole.count == v.large.count);
    CHECK(v.whole.error < 1e-9 && v.whole.largest == v.large.largest);
    verdict_done(&v);
}

/* q'' + (1 - 0.3 cos 2t) q = 0 among undamped others: |rho| = 1.264911399 over its period pi, of an
 * order-8 Runge-Kutta code of others (10 digits printed). */
TEST(one_growing_disturbance_among_hundreds_makes_a_motion_unstable)
{
    struct verdict v = verdict_of(chain(
        210, "0", 2, ",{'type':'spring','dof':'x%d','stiffness':1}",
        "{'type':'parametric_stiffness','dof':'x1','stiffness':-0.3},"
        "{'type':'cubic_spring','dof':'x1','coefficient':0.1}", ""));
    struct stability st;

    CHECK(v.large.verdict == STABILITY_UNSTABLE);
    CHECK_NEAR(v.large.largest, 1.264911399, 5e-10);
    CHECK(stability_of(v.s, &v.point, &st, NULL) == MODAL_OK);   /* above the limit: the same */
    CHECK(st.verdict == STABILITY_UNSTABLE && st.largest == v.large.largest);
    stability_done(&st);
    verdict_done(&v);
}

/* Undamped but for a damper of -0.1, and a slider that never slips, a spring of 0.5: multipliers of
 * 1 and just outside it crowd, which takes more than the first periods to tell apart.  |rho| =
 * exp(2 pi / 3 Re lambda), of the eigenvalues of these 402 states by another code. */
TEST(a_growing_disturbance_beside_a_slider_that_never_slips_makes_a_motion_unstable)
{
    struct verdict v = verdict_of(chain(
        201, "1", 3, "", "{'type':'friction','dof':'x30','to':'x31','stiffness':0.5,'limit':10},"
        "{'type':'damper','dof':'x100','coefficient':-0.1}", "{'dof':'x1','k':1,'cos':0.1}"));

    CHECK(v.point.undetermined[0] && v.reason == NULL);
    CHECK(v.large.verdict == STABILITY_UNSTABLE);
    CHECK_NEAR(v.large.largest, 1.0015522820, 2e-10);
    verdict_done(&v);
}

/* Damping 0.1 by mass of 420 states: all but a few multipliers of modulus exp(-0.05 T), none told
 * from its neighbours. */
TEST(multipliers_too_many_of_one_modulus_are_bounded_and_the_motion_is_stable)
{
    struct verdict v = verdict_of(chain(
        210, "1", 0.9, ",{'type':'spring','dof':'x%d','stiffness':1}",
        "{'type':'rayleigh_damping','alpha':0.1,'beta':0},"
        "{'type':'cubic_spring','dof':'x1','coefficient':0.1}", "{'dof':'x1','k':1,'cos':0.1}"));
    double modulus = exp(-0.05 * 2 * M_PI / 0.9);

    CHECK(v.large.verdict == STABILITY_STABLE);
    CHECK(v.large.largest + v.large.error >= modulus * (1 - 1e-6));
    CHECK(v.large.largest + v.large.error < 1);
    verdict_done(&v);
}

/* One mass: multipliers exp(lambda T), lambda = -0.15 +- i sqrt(25 - 0.0225). */
TEST(the_bound_holds_and_a_vector_comes_back_turned_and_shrunk)
{
    struct program *p = program_text("{'structure':{'type':'chain','masses':[2],'springs':[50,0],"
                                     "'dampers':[0.6,0]}}");
    struct period_map *m = NULL;
    double T = 1.7, radius = exp(-0.15 * T), angle = sqrt(25 - 0.0225) * T, x[2] = { 1, 0 }, y[2],
           z[2], bound;
    int periods;

    CHECK(period_map_new(p, NULL, T, 1e6, &m, NULL) == MODAL_OK && period_map_states(m) == 2);
    CHECK(period_map_carry(m, x, y, NULL) == MODAL_OK);
    CHECK(period_map_carry(m, y, z, NULL) == MODAL_OK);
    for (int i = 0; i < 2; i++)                  /* Cayley and Hamilton */
        CHECK_NEAR(z[i], 2 * radius * cos(angle) * y[i] - radius * radius * x[i], 1e-14);
    CHECK(leading_bound(m, 0.9, 1000, &bound, &periods, NULL) == MODAL_OK);
    CHECK(bound >= radius && bound <= 0.9 && periods % LEADING_PROBES == 0);
    period_map_free(m);
    program_free(p);
}

/* period_parts.taylor: g = 0.1 all along; how often it was asked into *CONTEXT. */
static int asked_tenth(void *context, int function, double t, double h, int most, double *out)
{
    (void)function, (void)t, (void)h;
    ++*(int *)context;
    for (int m = 0; m < most; m++)
        out[m] = m == 0 ? 0.1 : 0;
    return 1;
}

/* Two steps at least, of 1e6 operations each where 1e6 are allowed. */
TEST(slopes_whose_coefficients_cost_more_than_is_allowed_are_refused_before_one_is_asked_for)
{
    struct program *p =
        program_text("{'structure':{'type':'chain','masses':[2],'springs':[50,0]}}");
    struct law_end end = { 0, 1 };
    struct period_channel channel = { &end, &end, 1, 1, false, 0 };
    int asked = 0;
    struct period_parts parts = { .functions = 1, .channels = 1, .channel = &channel,
                                  .taylor = asked_tenth, .context = &asked, .step_work = 1e6 };
    struct period_map *m = NULL;

    CHECK(period_map_new(p, &parts, 1.7, 1e6, &m, NULL) == MODAL_TOO_LARGE && asked == 0);
    parts.step_work = 100;
    CHECK(period_map_new(p, &parts, 1.7, 1e6, &m, NULL) == MODAL_OK);
    CHECK(asked == period_map_steps(m) && asked > 1);
    period_map_free(m);
    program_free(p);
}

/* 60 undamped masses, all multipliers of modulus 1: 20 vectors do not tell ten of them apart. */
TEST(multipliers_not_told_apart_by_the_work_given_are_the_best_so_far_and_not_settled)
{
    struct program *p = chain(60, "1", 2, ",{'type':'spring','dof':'x%d','stiffness':1}",
                              "{'type':'parametric_stiffness','dof':'x1','stiffness':0.2}", "");
    struct period_map *m = NULL;
    struct leading few, enough;

    CHECK(period_map_new(p, NULL, M_PI, 1e9, &m, NULL) == MODAL_OK);
    CHECK(leading_multipliers(m, 10, 1e-9, 20, &few, NULL) == MODAL_OK);
    CHECK(!few.found.settled && few.found.count >= 10 && few.found.worst > 1e-9);
    CHECK(leading_multipliers(m, 10, 1e-9, 0, &enough, NULL) == MODAL_OK);
    CHECK(enough.found.settled && enough.periods > few.periods);
    leading_done(&few);
    leading_done(&enough);
    period_map_free(m);
    program_free(p);
}

/* A stiff beam of 20 elements with a cubic spring, too dear for maps by steps. */
TEST(points_that_had_no_verdict_for_all_their_work_leave_later_ones_of_the_session_unasked)
{
    struct program *p = program_text(
        "{'structure':{'type':'beam','length':2,'elements':20,'supports':['clamped','free'],"
        "'EI':100,'mass_per_length':1.5},'omega':20,'effects':[{'type':'rayleigh_damping',"
        "'alpha':0.5,'beta':1e-6},{'type':'cubic_spring','dof':'w20','coefficient':1e5}],"
        "'excitation':[{'type':'harmonic','dof':'w20','cos':1,'k':1}]}");
    struct steady_options opt = { .harmonics = 5 };
    struct steady *s = NULL;
    struct steady_point point = { 0 };
    struct stability asked, unasked;

    CHECK(steady_new(p, &opt, &s, NULL) == MODAL_OK);
    CHECK(steady_solve(s, p->omega, NULL, &point, NULL) == MODAL_OK && point.converged);
    CHECK(stability_of(s, &point, &asked, NULL) == MODAL_OK);
    CHECK(asked.verdict == STABILITY_STABLE && s->in_vain == 0 && asked.work.spent > 0);
    s->in_vain = 10 * asked.work.most;
    CHECK(stability_of(s, &point, &unasked, NULL) == MODAL_OK);
    CHECK(unasked.verdict == STABILITY_UNKNOWN && unasked.reason != NULL);
    CHECK(unasked.work.spent < asked.work.spent / 10);
    stability_done(&asked);
    stability_done(&unasked);
    steady_point_done(&point);
    steady_free(s);
    program_free(p);
}
