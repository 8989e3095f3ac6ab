/* Tests as well: dofwise.c leap.c leap_events.c leap_record.c sparse_motion_cost.c */
#include "check.h"
#include <float.h>
#include "modal/scene/dofwise.h"
#include "modal/scene/leap_events.h"
#include "modal/scene/simulate.h"
#include "modal/scene/sparse_motion.h"
#include "scene_text.h"

struct outcome {                 /* of one simulation */
    struct program *p;
    struct scene_time t;
    struct simulate_result s;
    double *x;
};

typedef enum modal_status way(struct program *, const struct scene_time *,
                              const struct simulate_options *, double *, struct simulate_result *,
                              struct modal_error *);

/* TEXT simulated by WAY to TOLERANCE (0: its own). */
static struct outcome run(const char *text, way *by, double tolerance)
{
    struct outcome o = { .p = program_text(text) };
    cJSON *scene = scene_text(text);
    struct modal_error err;
    struct simulate_options opt = { .tolerance = tolerance };

    if (scene_time(scene, o.p, &o.t, &err) != MODAL_OK)
        fail_msg("%s", err.message);
    o.x = malloc((size_t)o.t.samples * (size_t)o.p->outputs * sizeof *o.x);
    if (by(o.p, &o.t, &opt, o.x, &o.s, &err) != MODAL_OK)
        fail_msg("%s", err.message);
    cJSON_Delete(scene);
    return o;
}

static void done(struct outcome *o)
{
    program_free(o->p);
    free(o->x);
}

/* The largest difference, over the largest value of B. */
static double apart(const struct outcome *a, const struct outcome *b)
{
    double worst = 0, most = 0;

    CHECK(a->t.samples == b->t.samples && a->p->outputs == b->p->outputs);
    for (long k = 0; k < a->t.samples * a->p->outputs; k++) {
        worst = fmax(worst, fabs(a->x[k] - b->x[k]));
        most = fmax(most, fabs(b->x[k]));
    }
    return worst / most;
}

/* A chain of N unit masses and springs, EACH (%d: the dof) at every dof, then REST. */
static char *chain(int n, const char *each, const char *rest)
{
    size_t room = 64 * (size_t)n + strlen(rest) + 400 + (strlen(each) + 16) * (size_t)n;
    char *text = malloc(room), *at = text;

    at += sprintf(at, "{'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < n; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'springs':[1");
    for (int i = 0; i < n; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'dampers':[0.03");
    for (int i = 0; i < n; i++)
        at += sprintf(at, ",0.03");
    at += sprintf(at, "]},'effects':[");
    for (int i = 0; i < n && each[0] != '\0'; i++) {
        at += sprintf(at, "%s", i > 0 ? "," : "");
        at += sprintf(at, each, i + 1);
    }
    sprintf(at, "],%s}", rest);
    return text;
}

/* w = 2 sin(k pi / (2 n + 2)) is mode k's frequency; damping 0.03 K, decay 0.015 w^2. */
TEST(two_thousand_dofs_without_laws_are_the_closed_form_in_place_rate_and_acceleration)
{
    enum { N = 2000, K = 900 };
    double w = 2 * sin(K * M_PI / (2 * N + 2)), decay = 0.015 * w * w,
           wd = sqrt(w * w - decay * decay);
    char *rest = malloc(60 * N + 400), *at = rest;

    at += sprintf(at,
                  "'time':{'dt':0.37,'duration':18.5,'start':1.11},'sensors':[{'dof':'x77'},"
                  "{'dof':'x77','derivative':1},{'dof':'x77','derivative':2}],'initial':{'x':{");
    for (int i = 1; i <= N; i++)
        at += sprintf(at, "%s'x%d':%.17g", i > 1 ? "," : "", i, sin(M_PI * K * i / (N + 1)));
    sprintf(at, "}}");
    char *text = chain(N, "", rest);
    struct outcome o = run(text, simulate, 0);
    double shape = sin(M_PI * K * 77 / (N + 1));

    CHECK_STRING(o.s.integrator, "dormand-prince-8");
    for (long k = 0; k < o.t.samples; k++) {
        double t = 1.11 + 0.37 * (double)k, e = shape * exp(-decay * t),
               q = e * (cos(wd * t) + decay / wd * sin(wd * t)), v = -e * w * w / wd * sin(wd * t);
        CHECK_NEAR(o.x[3 * k], q, 1e-8);
        CHECK_NEAR(o.x[3 * k + 1], v, 1e-8);
        CHECK_NEAR(o.x[3 * k + 2], -w * w * q - 2 * decay * v, 4e-8);
    }
    done(&o);
    free(text);
    free(rest);
}

/* To the last bit: which of both is asked is a matter of cost. */
TEST(a_force_that_is_asked_for_alone_is_that_with_slopes)
{
    struct program *p = program_text(
        "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'effects':["
        "{'type':'cubic_spring','dof':'x1','coefficient':0.7},"
        "{'type':'polynomial_spring','dof':'x1','coefficients':[0.3,-2,0,1.1]},"
        "{'type':'polynomial_damper','dof':'x1','coefficients':[-0.1,0.2,0.3]},"
        "{'type':'regularised_coulomb','dof':'x1','limit':0.4,'velocity':0.05}]}");
    double d = -1.3, v = 0.9;

    CHECK(p->laws == 4);
    for (int k = 0; k < 40; k++, d += 0.07, v -= 0.043)
        for (int l = 0; l < p->laws; l++) {
            struct law_force out = { .memory = NULL };
            struct law_point at = { .d = &d, .v = &v };

            CHECK(p->law[l].kind->force(&p->law[l], &at, &out, NULL) == MODAL_OK);
            CHECK(p->law[l].kind->alone(&p->law[l], d, v) == out.f[0]);
        }
    program_free(p);
}

/* Two ways that share no step: 1e-10 of each, some hundred of them. */
TEST(laws_of_every_kind_move_as_by_exponential_collocation)
{
    static const char text[] =
        "{'structure':{'type':'chain','masses':[1,2,0.7,1,1.3,1],'springs':[1,2,1,0.5,1,1,0],"
        "'dampers':[0.03,0.02,0.03,0.01,0.03,0.03,0]},'effects':["
        "{'type':'friction','dof':'x1','stiffness':0.6,'limit':0.05},"
        "{'type':'gap','dof':'x3','to':'x2','stiffness':3,'clearance':0.02,'dissipation':0.4},"
        "{'type':'gap','dof':'x6','stiffness':2,'clearance':0.1,'both_sides':true},"
        "{'type':'iwan','dof':'x4','stiffnesses':[0.2,0.3],'limits':[0.02,0.05]},"
        "{'type':'contact_friction','normal':'x5','tangential':'x6','normal_stiffness':2,"
        "'preload':0.1,'tangential_stiffness':1,'mu':0.4},"
        "{'type':'cubic_spring','dof':'x2','to':'x5','coefficient':0.4},"
        "{'type':'parametric_stiffness','dof':'x4','stiffness':0.2,'k':2}],'omega':0.7,"
        "'excitation':[{'dof':'x1','k':1,'cos':0.5},{'dof':'x4','k':0,'cos':0.05},"
        "{'dof':'x6','type':'impulse','amplitude':0.3,'start':4.2},"
        "{'dof':'x3','type':'half_sine','amplitude':0.4,'duration':1.3,'start':2.05}],"
        "'time':{'dt':0.1,'duration':40},'sensors':[{'dof':'x1'},{'dof':'x3'},{'dof':'x4'},"
        "{'dof':'x6','derivative':1},{'dof':'x3','derivative':2}]}";
    struct outcome a = run(text, sparse_motion, 0), b = run(text, simulate, 1e-12);

    CHECK_STRING(b.s.integrator, "exponential-collocation");
    CHECK_NEAR(apart(&a, &b), 0, 1e-7);
    for (int e = 0; e < a.p->effects; e++)
        CHECK(a.p->effect[e].active && (e == 6 || a.p->effect[e].evaluations > 0));
    done(&a);
    done(&b);
}

TEST(a_mass_matrix_that_is_not_diagonal_moves_as_by_exponential_collocation)
{
    static const char text[] =
        "{'structure':{'type':'matrices','M':[[2,0.5,0],[0.5,2,0.4],[0,0.4,1]],"
        "'K':[[3,-1,0],[-1,2,-1],[0,-1,1.5]],'C':[[0.1,0,0],[0,0.1,0],[0,0,0.1]]},'effects':["
        "{'type':'gap','dof':'x1','stiffness':3,'clearance':0.1},"
        "{'type':'friction','dof':'x3','stiffness':1,'limit':0.06}],'omega':0.9,"
        "'excitation':[{'dof':'x2','k':1,'cos':0.3},"
        "{'dof':'x1','type':'impulse','amplitude':0.3,'start':3}],"
        "'time':{'dt':0.2,'duration':60},'sensors':[{'dof':'x1'},{'dof':'x3','derivative':2}]}";
    struct outcome a = run(text, sparse_motion, 0), b = run(text, simulate, 1e-12);

    CHECK_NEAR(apart(&a, &b), 0, 1e-7);
    done(&a);
    done(&b);
}

/* One stop and a damper of its own among masses that move as waves do: full maps would be made at
 * each touch.  The motion is that of maps, which a tolerance asks for. */
TEST(few_laws_of_a_chain_whose_modes_do_not_decouple_cost_no_full_maps)
{
    static const char effects[] = "{'type':'damper','dof':'x7','coefficient':0.5},"
                                  "{'type':'gap','dof':'x3','stiffness':0.5,'clearance':0.1}";
    char *plain = chain(60, "", "'omega':0.3,'excitation':[{'dof':'x1','k':1,'cos':0.5}],"
                                "'time':{'dt':0.1,'duration':40},"
                                "'sensors':[{'dof':'x1'},{'dof':'x9'}]"),
         *at = strstr(plain, "'effects':["), *text = malloc(strlen(plain) + sizeof effects);

    at += strlen("'effects':[");
    sprintf(text, "%.*s%s%s", (int)(at - plain), plain, effects, at);
    struct outcome a = run(text, simulate, 0), b = run(text, simulate, 1e-12);

    CHECK_STRING(a.s.integrator, "dormand-prince-8");
    CHECK_STRING(b.s.integrator, "exponential-collocation");
    CHECK_NEAR(apart(&a, &b), 0, 1e-9);
    done(&a);
    done(&b);
    free(plain);
    free(text);
}

/* Friction at every dof of one chain, near the load the same as of a longer one: what is far does
 * not matter to these samples, nor to the number of steps. */
static void far_dofs_cost_no_steps(const char *each)
{
    static const char rest[] = "'omega':0.3,'excitation':[{'dof':'x1','k':1,'cos':0.5}],"
                               "'time':{'dt':0.1,'duration':60},'sensors':[{'dof':'x1'},"
                               "{'dof':'x4'}]";
    char *small = chain(120, each, rest), *large = chain(480, each, rest);
    struct outcome a = run(small, simulate, 0), b = run(large, simulate, 0),
                   c = run(small, simulate, 1e-12);

    CHECK_STRING(a.s.integrator, "dormand-prince-8");
    CHECK_NEAR(apart(&a, &b), 0, 1e-7);
    CHECK_NEAR(apart(&a, &c), 0, 1e-7);
    CHECK(b.s.steps < 2 * a.s.steps && b.p->effect[2].evaluations < 2 * a.p->effect[2].evaluations);
    /* far from the load it is asked in leaps of the whole alone */
    CHECK(b.p->effect[400].evaluations < b.p->effect[2].evaluations);
    done(&a);
    done(&b);
    done(&c);
    free(small);
    free(large);
}

TEST(sliders_far_from_the_motion_cost_no_steps)
{
    far_dofs_cost_no_steps("{'type':'friction','dof':'x%d','stiffness':0.3,'limit':0.05}");
}

/* Twenty sliders: steps of the whole, cut where any of them turns, are given up for leaps with
 * parts.  Who names a tolerance has those steps. */
TEST(twenty_laws_that_turn_often_move_by_leaps_as_they_do_by_steps_of_the_whole)
{
    char *text = chain(20, "{'type':'friction','dof':'x%d','stiffness':1,'limit':0.1}",
                       "'excitation':[{'dof':'x20','k':1,'cos':1}],'omega':1,"
                       "'time':{'dt':0.05,'duration':60}");
    struct outcome leaps = run(text, simulate, 0), steps = run(text, simulate, 1e-11);

    CHECK_STRING(leaps.s.integrator, "dormand-prince-8");
    CHECK(strcmp(leaps.s.integrator, steps.s.integrator) != 0);
    CHECK(apart(&leaps, &steps) < 1e-8);
    done(&leaps);
    done(&steps);
    free(text);
}

/* Evaluations of a law, on the average, of a chain of N with EACH at every dof and a load of its
 * own at each. */
static double asked_a_law(int n, const char *each)
{
    size_t room = 80 * (size_t)n + 200;
    char *rest = malloc(room), *at = rest, *text;
    struct outcome o;
    double sum = 0;

    at += sprintf(at, "'omega':0.3,'time':{'dt':0.1,'duration':4},'sensors':[{'dof':'x1'}],"
                      "'excitation':[");
    for (int i = 0; i < n; i++)
        at += sprintf(at, "%s{'dof':'x%d','k':1,'cos':%.6f,'sin':%.6f}", i > 0 ? "," : "", i + 1,
                      0.5 * cos(i), 0.5 * sin(1.7 * i));
    sprintf(at, "]");
    text = chain(n, each, rest);
    o = run(text, simulate, 0);
    CHECK_STRING(o.s.integrator, "dormand-prince-8");
    for (int l = 0; l < o.p->laws; l++)
        sum += (double)o.p->effect[o.p->law[l].effect].evaluations / n;
    done(&o);
    free(text);
    free(rest);
    return sum;
}

/* Each moves as its own load and its neighbours make it: four times as many are four times the
 * work, whose events are as dense along the chain.  Leaps are shorter, by the fewest of them. */
TEST(sliders_that_all_turn_at_times_of_their_own_cost_what_each_does)
{
    static const char each[] = "{'type':'friction','dof':'x%d','stiffness':0.3,'limit':0.05}";

    CHECK(asked_a_law(400, each) < 2 * asked_a_law(100, each));
}

TEST(rigid_sliders_that_all_stick_and_slip_at_times_of_their_own_cost_what_each_does)
{
    static const char each[] = "{'type':'coulomb','dof':'x%d','limit':0.05}";

    CHECK(asked_a_law(400, each) < 2 * asked_a_law(100, each));
}

/* x'' + x = -c sign(x'): half turns about +-c, each 2 c shorter than the last, until one ends
 * within c: from 1 by 0.15 at 0.7, 0.4 and 0.1, and there it stays. */
TEST(a_mass_on_dry_ground_stops_after_as_many_half_turns_as_the_closed_form_has)
{
    struct outcome o = run("{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'effects':["
                           "{'type':'coulomb','dof':'x1','limit':0.15}],'initial':{'x':{'x1':1}},"
                           "'time':{'dt':0.05,'duration':20},'sensors':[{'dof':'x1'},"
                           "{'dof':'x1','derivative':2}]}", sparse_motion, 1e-12);

    CHECK_STRING(o.s.integrator, "dormand-prince-8");
    for (long k = 0; k < o.t.samples; k++) {
        double t = 0.05 * (double)k;
        int half = (int)(t / M_PI);
        double side = half % 2 == 0 ? 1 : -1, size = 1 - 0.15 * (2 * half + 1);
        bool rests = half > 2;
        CHECK_NEAR(o.x[2 * k], rests ? -0.1 : side * 0.15 + size * cos(t), 1e-9);
        CHECK_NEAR(o.x[2 * k + 1], rests ? 0 : -size * cos(t), 1e-9);
    }
    done(&o);
}

/* A chain of six dofs, sliders and cubic springs at each, beside two dofs at rest whose masses are
 * COUPLED by so much. */
static void sliding_chain(double coupled, char *at)
{
    enum { N = 6, ALL = N + 2 };

    at += sprintf(at, "{'structure':{'type':'matrices','M':[");
    for (int i = 0; i < ALL * ALL; i++)
        at += sprintf(at, "%s%g%s", i % ALL == 0 ? "[" : ",",
                      i % ALL == i / ALL ? 1 : i % ALL < N || i / ALL < N ? 0 : coupled,
                      i % ALL < ALL - 1 ? "" : i / ALL < ALL - 1 ? "]," : "]]");
    for (int part = 0; part < 2; part++) {
        at += sprintf(at, ",'%s':[", part == 0 ? "K" : "C");
        for (int i = 0; i < ALL * ALL; i++)
            at += sprintf(at, "%s%g%s", i % ALL == 0 ? "[" : ",",
                          (part == 0 ? 1 : 0.03) * (i % ALL == i / ALL ? 2
                                                    : abs(i % ALL - i / ALL) == 1
                                                          && i % ALL < N && i / ALL < N ? -1 : 0),
                          i % ALL < ALL - 1 ? "" : i / ALL < ALL - 1 ? "]," : "]]");
    }
    at += sprintf(at, "},'effects':[");
    for (int i = 1; i <= N; i++)
        at += sprintf(at, "%s{'type':'coulomb','dof':'x%d','limit':0.03},{'type':'cubic_spring',"
                          "'dof':'x%d','coefficient':0.2}", i > 1 ? "," : "", i, i);
    sprintf(at, "],'excitation':[{'dof':'x6','k':1,'cos':0.4},{'dof':'x5','type':'step',"
                "'start':7.3,'amplitude':0.2},{'dof':'x2','type':'impulse','start':3.11,"
                "'amplitude':0.5}],"
                "'omega':0.9,'initial':{'v':{'x3':0.2}},'time':{'dt':0.1,'duration':40}}");
}

/* Steps of the whole, which share nothing with leaps, where masses are coupled. */
TEST(rigid_sliders_move_by_leaps_as_they_do_by_steps_of_the_whole)
{
    char text[4000];
    struct outcome leaps, steps;

    sliding_chain(0, text);
    leaps = run(text, sparse_motion, 1e-12);
    sliding_chain(0.3, text);
    steps = run(text, simulate, 1e-12);
    CHECK_STRING(leaps.s.integrator, "dormand-prince-8");
    CHECK_STRING(steps.s.integrator, "exponential-collocation");
    CHECK(apart(&leaps, &steps) < 1e-8);
    done(&leaps);
    done(&steps);
}

/* Two loads that beat pull by more than is held for some tenths of a second half a minute on: until
 * then nothing that moves says how long a leap may be. */
TEST(a_slider_that_rests_and_slips_for_a_moment_is_not_leapt_over)
{
    char text[500];

    for (int i = 0; i < 20; i++) {
        snprintf(text, sizeof text, "{'structure':{'type':'chain','masses':[1],'springs':[1,1],"
                 "'dampers':[0.03,0.03]},'effects':[{'type':'coulomb','dof':'x1','limit':%.3f}],"
                 "'excitation':[{'dof':'x1','k':10,'cos':0.15},{'dof':'x1','k':11,'cos':-0.15}],"
                 "'omega':%.2f,'time':{'duration':60,'dt':0.1}}", 0.28 + 0.001 * i,
                 0.1 + 0.005 * i);
        struct outcome leaps = run(text, sparse_motion, 0), steps = run(text, simulate, 0);
        CHECK_STRING(leaps.s.integrator, "dormand-prince-8");
        CHECK_STRING(steps.s.integrator, "exponential-collocation");
        CHECK(apart(&leaps, &steps) < 1e-8);
        done(&leaps);
        done(&steps);
    }
}

/* A blow of a millisecond bounds the leaps while it lasts. */
TEST(a_short_pulse_costs_a_slider_no_steps_before_and_after_it)
{
    static const char *const pulses[] = {
        "", ",{'dof':'x1','type':'half_sine','start':50,'duration':0.001,'amplitude':9}"
    };
    char text[500];
    double steps[2];

    for (int i = 0; i < 2; i++) {
        snprintf(text, sizeof text, "{'structure':{'type':'chain','masses':[1],'springs':[1,1],"
                 "'dampers':[0.03,0.03]},'effects':[{'type':'coulomb','dof':'x1','limit':0.1}],"
                 "'excitation':[{'dof':'x1','k':1,'cos':0.3}%s],'omega':0.7,"
                 "'time':{'duration':100,'dt':0.1}}", pulses[i]);
        struct outcome o = run(text, sparse_motion, 0);
        steps[i] = (double)o.s.steps;
        done(&o);
    }
    CHECK(steps[1] < 1.5 * steps[0]);
}

TEST(contacts_that_all_touch_at_times_of_their_own_cost_what_each_does)
{
    static const char each[] = "{'type':'gap','dof':'x%d','stiffness':1000,'clearance':0.01}";

    CHECK(asked_a_law(400, each) < 2 * asked_a_law(100, each));
}

TEST(contacts_far_from_the_motion_cost_no_steps)
{
    far_dofs_cost_no_steps("{'type':'gap','dof':'x%d','stiffness':1,'clearance':0.3}");
}

/* Every mass by itself, against its own stop: 40 of them touch at times of their own.  Free flight
 * x = sin t from x = 0, v = 1 until c; in contact w^2 = 1 + k about x0 = k c / w^2. */
TEST(forty_contacts_touch_at_their_own_times)
{
    enum { N = 40 };
    static const double stiffness = 7;
    char text[12000], *at = text;
    double c[N];

    at += sprintf(at, "{'structure':{'type':'matrices','M':[");
    for (int matrix = 0; matrix < 2; matrix++) {
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                at += sprintf(at, "%s%d%s", j > 0 ? "," : i > 0 ? ",[" : "[", i == j,
                              j == N - 1 ? "]" : "");
        at += sprintf(at, "%s", matrix == 0 ? "],'K':[" : "]},'effects':[");
    }
    for (int i = 0; i < N; i++) {
        c[i] = 0.1 + 0.8 * i / N;
        at += sprintf(at, "%s{'type':'gap','dof':'x%d','stiffness':%g,'clearance':%.17g}",
                      i > 0 ? "," : "", i + 1, stiffness, c[i]);
    }
    at += sprintf(at, "],'time':{'dt':0.05,'duration':1.5},'initial':{'v':{");
    for (int i = 0; i < N; i++)
        at += sprintf(at, "%s'x%d':1", i > 0 ? "," : "", i + 1);
    sprintf(at, "}}}");
    struct outcome o = run(text, simulate, 0);

    CHECK_STRING(o.s.integrator, "dormand-prince-8");
    for (int i = 0; i < N; i++)
        for (long k = 0; k < o.t.samples; k++) {
            double t = 0.05 * (double)k, hit = asin(c[i]), w = sqrt(1 + stiffness),
                   x0 = stiffness * c[i] / (w * w), rate = cos(hit), tau = t - hit,
                   in = x0 + (c[i] - x0) * cos(w * tau) + rate / w * sin(w * tau);
            if (tau < 0)
                CHECK_NEAR(o.x[k * N + i], sin(t), 1e-8);
            else if (tau < 0.3)                    /* not out again */
                CHECK_NEAR(o.x[k * N + i], in, 1e-8);
        }
    done(&o);
}

TEST(rigid_sliders_between_dofs_and_laws_with_a_history_are_not_asked_dof_by_dof)
{
    static const char *const no[] = {
        "{'structure':{'type':'chain','masses':[1,1],'springs':[1,1,0]},'effects':["
        "{'type':'coulomb','dof':'x1','to':'x2','limit':1}]}",
        "{'structure':{'type':'matrices','M':[[2,1],[1,2]],'K':[[2,0],[0,2]]},'effects':["
        "{'type':'coulomb','dof':'x1','limit':1}]}",
        "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'effects':[{'type':'lua',"
        "'dof':'x1','source':'function force(t, x, v, memory) return x end'}]}"
    };

    for (size_t i = 0; i < sizeof no / sizeof *no; i++) {
        struct program *p = program_text(no[i]);
        CHECK(!dofwise_serves(p));
        program_free(p);
    }
}

/* A step's events against closed form: x = sin t meets c at asin c. */
TEST(an_event_within_a_leap_is_found_to_the_leaps_own_error)
{
    struct program *p = program_text(
        "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'effects':["
        "{'type':'gap','dof':'x1','stiffness':1e-30,'clearance':0.2}]}");
    struct dofwise *f;
    struct leap l;
    struct workspace space = { 0 };
    double stage[2], theta, none[1] = { 0 };

    CHECK(dofwise_new(p, &f, NULL) == MODAL_OK);
    leap_init(&l, f, stage, &space);
    l.set = &f->all;
    l.h = 0.4;
    l.from[1] = 1;
    CHECK(leap_slope(&l, 0, l.from, none, l.slope[0], NULL) == MODAL_OK);
    CHECK(leap_make(&l, none, NULL) == MODAL_OK);
    CHECK_NEAR(l.to[0], sin(0.4), pow(0.4, 9) / 362880);   /* h^9 / 9! */
    CHECK_NEAR(l.to[1], cos(0.4), pow(0.4, 9) / 362880);
    for (int k = 0; k <= 10; k++)
        CHECK_NEAR(leap_at(&l, 0, 0.1 * k), sin(0.04 * k), 1e-9);
    CHECK(leap_find_event(&l, none, 0, 1, &theta, NULL) == MODAL_OK);
    CHECK_NEAR(0.4 * theta, asin(0.2), 1e-9);
    workspace_free(&space);
    dofwise_free(f);
    program_free(p);
}

/* Dofs 3, 4 and 7 of ten: the rim are their neighbours, the laws those that touch them. */
TEST(a_set_of_dofs_has_its_runs_its_rim_and_its_laws)
{
    char *text = chain(10, "{'type':'cubic_spring','dof':'x%d','coefficient':1}",
                       "'time':{'dt':1,'duration':1}");
    struct program *p = program_text(text);
    struct dofwise *f;
    struct dof_set set;
    static const int dof[] = { 3, 4, 7 }, rim[] = { 2, 5, 6, 8 };

    CHECK(dofwise_new(p, &f, NULL) == MODAL_OK);
    CHECK(dofwise_set_new(f, &set, NULL) == MODAL_OK);
    dofwise_set(f, dof, 3, &set);
    CHECK(set.runs == 2 && set.run[0].from == 3 && set.run[0].to == 5 && set.run[1].from == 7);
    CHECK(set.rims == 4 && memcmp(set.rim, rim, sizeof rim) == 0);
    CHECK(set.laws == 3 && set.law[0] == 3 && set.law[1] == 4 && set.law[2] == 7);
    CHECK(!set.whole);
    dofwise_free(f);
    program_free(p);
    free(text);
}

static bool always(void *context)
{
    (void)context;
    return true;
}

TEST(a_motion_that_grows_past_all_numbers_or_is_cancelled_says_so)
{
    char *text = chain(120, "{'type':'polynomial_damper','dof':'x%d','coefficients':[-9]}",
                       "'time':{'dt':0.1,'duration':2000},'initial':{'x':{'x3':1}},"
                       "'sensors':[{'dof':'x3'}]");
    struct program *p = program_text(text);
    cJSON *scene = scene_text(text);
    struct scene_time t;
    struct simulate_options stop = { .cancelled = always }, plain = { 0 };
    struct simulate_result s = { "untouched", 0, 0, 0, 0 };
    struct modal_error err;

    CHECK(scene_time(scene, p, &t, &err) == MODAL_OK);
    double *x = malloc((size_t)t.samples * sizeof *x);
    CHECK(simulate(p, &t, &stop, x, &s, &err) == MODAL_CANCELLED);
    CHECK(simulate(p, &t, &plain, x, &s, &err) == MODAL_OVERFLOW);
    CHECK(strstr(err.message, "range of doubles") != NULL);
    CHECK_STRING(s.integrator, "untouched");
    cJSON_Delete(scene);
    program_free(p);
    free(text);
    free(x);
}
