/* Tests as well: collocation.c cubic_spring.c holding.c linear_stepper.c lua.c nonlinear_stepper.c
 * periodic_stepper.c polynomial.c polynomial_damper.c ports.c readout.c regime_events.c
 * rk4_stepper.c sources.c user_law.c */
#include "check.h"
#include <float.h>
#include "modal/scene/simulate.h"
#include "scene_text.h"

/* Steps of nonlinear scenes against motions known in closed form, piece by piece. */

static double *run(const char *text, double tolerance, long *samples, struct simulate_result *s,
                   struct program **out)
{
    struct modal_error err;
    struct program *p = program_text(text);
    cJSON *scene = scene_text(text);
    struct scene_time t;
    struct simulate_options o = { .tolerance = tolerance };
    double *x;

    if (scene_time(scene, p, &t, &err) != MODAL_OK)
        fail_msg("%s: %s", text, err.message);
    x = malloc((size_t)t.samples * (size_t)p->outputs * sizeof *x);
    if (simulate(p, &t, &o, x, s, &err) != MODAL_OK)
        fail_msg("%s: %s", text, err.message);
    *samples = t.samples;
    if (out != NULL)
        *out = p;
    else
        program_free(p);
    cJSON_Delete(scene);
    return x;
}

/* m v^2/2 + k x^2/2 + c x^4/4 over 10^5 steps. */
TEST(a_duffing_oscillator_keeps_its_energy_over_a_hundred_thousand_steps)
{
    struct simulate_result s;
    long samples;
    double *x = run("{'structure':{'type':'chain','masses':[1.3],'springs':[2,0]},'effects':"
                    "[{'type':'cubic_spring','dof':'x1','coefficient':1.7}],'initial':{'x':"
                    "{'x1':1.1}},'time':{'dt':0.03,'duration':3000},'sensors':[{'dof':'x1'},"
                    "{'dof':'x1','derivative':1},{'dof':'x1','derivative':2}]}",
                    0, &samples, &s, NULL);
    double worst = 0, e0 = 1.1 * 1.1 + 1.7 / 4 * pow(1.1, 4);

    CHECK_STRING(s.integrator, "exponential-collocation");
    CHECK(samples == 100001 && s.steps >= 100000);
    for (long k = 0; k < samples; k++) {
        double q = x[3 * k], v = x[3 * k + 1];
        worst = fmax(worst, fabs((0.65 * v * v + q * q + 1.7 / 4 * q * q * q * q) / e0 - 1));
        CHECK_NEAR(1.3 * x[3 * k + 2], -2 * q - 1.7 * q * q * q, 1e-12);
    }
    CHECK_NEAR(worst, 0, 1e-9);
    free(x);
}

/* Three masses with cubic springs to each other and to the ground, motion between all modes:
 * kinetic and elastic energy together. */
TEST(a_chain_with_cubic_springs_keeps_its_energy_over_a_hundred_thousand_steps)
{
    struct simulate_result s;
    long samples;
    double *x = run("{'structure':{'type':'chain','masses':[1,2,0.7],'springs':[3,1,2,0]},"
                    "'effects':[{'type':'cubic_spring','dof':'x1','to':'x2','coefficient':4},"
                    "{'type':'cubic_spring','dof':'x3','coefficient':2}],'initial':{'x':"
                    "{'x1':0.8},'v':{'x3':-0.5}},'time':{'dt':0.02,'duration':2000},'sensors':"
                    "[{'dof':'x1'},{'dof':'x2'},{'dof':'x3'},{'dof':'x1','derivative':1},"
                    "{'dof':'x2','derivative':1},{'dof':'x3','derivative':1}]}",
                    0, &samples, &s, NULL);
    double worst = 0, start = 0;

    CHECK(samples == 100001);
    for (long k = 0; k < samples; k++) {
        const double *q = x + 6 * k, *v = q + 3;
        double a = q[0] - q[1], b = q[1] - q[2];
        double e = (v[0] * v[0] + 2 * v[1] * v[1] + 0.7 * v[2] * v[2] + 3 * q[0] * q[0] + a * a +
                    2 * b * b) /
                       2 +
                   a * a * a * a + q[2] * q[2] * q[2] * q[2] / 2;
        start = k == 0 ? e : start;
        worst = fmax(worst, fabs(e / start - 1));
    }
    CHECK_NEAR(worst, 0, 1e-8);
    free(x);
}

/* Rigid friction takes 2 mu off each half swing of a unit oscillator and holds it once the spring
 * pulls less. */
TEST(rigid_friction_shortens_each_swing_by_twice_its_limit_and_then_holds)
{
    struct simulate_result s;
    struct program *p;
    long samples;
    double *x = run("{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'effects':"
                    "[{'type':'coulomb','dof':'x1','limit':0.07}],'initial':{'x':{'x1':1}},'time':"
                    "{'dt':0.437,'duration':43.7}}",
                    0, &samples, &s, &p);

    for (long k = 0; k < samples; k++) {
        double t = 0.437 * (double)k, a = 1, sign = 1;
        while (a > 0.07 && t > M_PI) {
            t -= M_PI;
            a -= 0.14;
            sign = -sign;
        }
        CHECK_NEAR(x[k], sign * (a > 0.07 ? (a - 0.07) * cos(t) + 0.07 : a), 1e-11);
    }
    CHECK(p->effect[0].active);
    program_free(p);
    free(x);
}

/* Half of each cycle on the stop of stiffness 100 beside the spring, half off it. */
TEST(a_stop_is_met_and_left_at_the_instant)
{
    struct simulate_result s;
    long samples;
    double w = sqrt(101), period = M_PI / w + M_PI;
    double *x = run("{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'effects':"
                    "[{'type':'gap','dof':'x1','stiffness':100,'clearance':0}],'initial':{'v':"
                    "{'x1':1}},'time':{'dt':0.1,'duration':200}}",
                    0, &samples, &s, NULL);

    for (long k = 0; k < samples; k++) {
        double t = fmod(0.1 * (double)k, period);
        CHECK_NEAR(x[k], t < M_PI / w ? sin(w * t) / w : -sin(t - M_PI / w), 1e-11);
    }
    free(x);
}

/* A stop that is never reached leaves the linear motion, and says so. */
TEST(a_stop_out_of_reach_is_never_active)
{
    struct simulate_result s;
    struct program *p;
    long samples;
    double *x = run("{'structure':{'type':'chain','masses':[1,1],'springs':[1,1,1]},'effects':"
                    "[{'type':'gap','dof':'x1','stiffness':100,'clearance':5},{'type':'friction',"
                    "'dof':'x2','stiffness':0.5,'limit':9}],'initial':{'x':{'x1':1,'x2':1}},"
                    "'time':{'dt':0.3,'duration':30}}",
                    0, &samples, &s, &p);

    CHECK(!p->effect[0].active && !p->effect[1].active && p->effect[0].evaluations > 0);
    /* x1, x2 with springs 1, 1, 1 and 0.5 more on x2: K = [2 -1; -1 2.5] */
    double mean = 2.25, half = sqrt(0.0625 + 1), a = mean - half, b = mean + half;
    for (long k = 0; k < samples; k++) {
        /* modes (1, 2 - w^2): 1 = u + w, 1 = u (2 - a) + w (2 - b) */
        double t = 0.3 * (double)k, u = (1 - (2 - b)) / (b - a);
        CHECK_NEAR(x[2 * k], u * cos(sqrt(a) * t) + (1 - u) * cos(sqrt(b) * t), 1e-11);
    }
    program_free(p);
    free(x);
}

/*
 * Mass 1, spring 1, Jenkins element (1, L = 0.53), released at x = 2.17: the slider has followed to
 * z = 2.17 - L.  Stuck, x'' = -x - (x - z) until |x - z| = L; slipping, x'' = -x - sign(v) L until
 * v = 0.  (From t = 14.4 on its stuck swing just reaches the limit: grazing, where any rounding
 * decides.)
 */
TEST(a_jenkins_element_sticks_and_slips_as_its_pieces)
{
    struct simulate_result s;
    long samples;
    double *x = run("{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'effects':"
                    "[{'type':'friction','dof':'x1','stiffness':1,'limit':0.53}],'initial':{'x':"
                    "{'x1':2.17}},'time':{'dt':0.05,'duration':14}}",
                    0, &samples, &s, NULL);
    double L = 0.53, t0 = 0, a = 2.17, v = 0, z = 1.64;
    int mode = 0;
    long k = 0;

    while (k < samples) {
        double w = mode == 0 ? sqrt(2) : 1, centre = mode == 0 ? z / 2 : -mode * L, end = HUGE_VAL;
        /* x = centre + A cos(w t + phase) */
        double amplitude = hypot(a - centre, v / w), phase = atan2(-v / w, a - centre);
        if (mode == 0) {
            for (int sign = -1; sign <= 1; sign += 2) {   /* x = z + sign L, moving that way */
                double c = (z + sign * L - centre) / amplitude;
                if (fabs(c) > 1)
                    continue;
                double angle = sign > 0 ? -acos(c) : acos(c), turn = angle - phase;
                while (turn <= 1e-9)
                    turn += 2 * M_PI;
                end = fmin(end, turn / w);
            }
        } else {
            double turn = -phase;
            while (turn <= 1e-9)
                turn += M_PI;
            end = turn / w;
        }
        for (; k < samples && 0.05 * (double)k <= t0 + end; k++)
            CHECK_NEAR(x[k], centre + amplitude * cos(w * (0.05 * (double)k - t0) + phase), 1e-11);
        a = centre + amplitude * cos(w * end + phase);
        v = -w * amplitude * sin(w * end + phase);
        t0 += end;
        if (mode == 0)
            mode = a > z ? 1 : -1;
        else {
            z = a - mode * L;
            mode = 0;
            v = 0;
        }
    }
    free(x);
}

/* A law of no effect at this amplitude, beside a pulsating spring: the Magnus steps' motion. */
TEST(pulsating_stiffness_beside_a_law_is_stepped_as_alone)
{
#define PULSATING \
    "{'structure':{'type':'chain','masses':[1,2],'springs':[3,1,2],'dampers':[0.1,0.02,0]},'" \
    "omega':2.1,'initial':{'x':{'x1':1e-6}}," \
    "'time':{'dt':0.1,'duration':30},'effects':[{'type':'parametric_stiffness','dof':'x1','to':'" \
    "x2','stiffness':0.8,'k':2,'phase':0.3}"
    struct simulate_result s, r;
    long samples;
    double *x = run(PULSATING "]}", 0, &samples, &s, NULL);
    double *y = run(PULSATING ",{'type':'cubic_spring','dof':'x2','coefficient':1e-3}]}", 1e-12,
                    &samples, &r, NULL);

    CHECK_STRING(s.integrator, "magnus-maps");
    CHECK_STRING(r.integrator, "exponential-collocation");
    for (long k = 0; k < samples; k++)
        CHECK_NEAR(y[2 * k], x[2 * k], 1e-16);
    free(x);
    free(y);
}

/*
 * A contact that opens six times, sticks and slips either way: x1, x2 at t = 3, 6, .. 24 by DOP853
 * (scipy, relative tolerance 2.3e-14) from regime to regime, each regime's end located on its dense
 * output.
 */
static const double REGIMES[8][2] = {
    { -0.2351226785886, -0.01493607834031 }, { -0.2049153747263, 0.4627692547459 },
    { -1.078140742272, -2.015350198742 },    { 0.7359757419167, 1.350764697675 },
    { -1.530930602103, -1.309063463974 },    { -1.443644740213, -1.859107773069 },
    { 1.108152398788, 2.078458086493 },      { -2.863192781863, -3.283453057858 }
};

/* The largest difference from REGIMES with 0.3 / PARTS between samples. */
static double regimes_error(int parts, double tolerance)
{
    struct simulate_result s;
    char text[1024];
    double *x, worst = 0;
    long samples;

    snprintf(text, sizeof text,
             "{'structure':{'type':'matrices','M':[[1,0],[0,0.93]],'C':[[0.208,-0.097],"
             "[-0.097,0.208]],'K':[[1.883,-0.883],[-0.883,1.883]]},'omega':1.333,'effects':"
             "[{'type':'contact_friction','normal':'x1','tangential':'x2',"
             "'normal_stiffness':2.233,'preload':0.898,'tangential_stiffness':1.763,'mu':0.843}],"
             "'excitation':[{'dof':'x1','k':1,'cos':0.345},{'dof':'x2','k':1,'sin':1.043},"
             "{'dof':'x2','k':2,'cos':0.339}],'time':{'dt':%.17g,'duration':24}}",
             0.3 / parts);
    x = run(text, tolerance, &samples, &s, NULL);
    CHECK(samples == 80 * parts + 1);
    for (long k = 0; k < 8; k++)
        for (long i = 0; i < 2; i++)
            worst = fmax(worst, fabs(x[2 * 10 * parts * (k + 1) + i] - REGIMES[k][i]));
    free(x);
    return worst;
}

/*
 * The reference is known to a few 1e-13 (its tolerance, its digits) and the default tolerance is
 * 1e-10; one step a sample, let alone by a tolerance of 1 but for its events, has the order of
 * smooth motions, 7: an instant located to first order in the step would show.
 */
TEST(contact_with_friction_follows_its_regimes_whatever_the_step)
{
    for (int parts = 1; parts <= 64; parts *= 4)
        CHECK_NEAR(regimes_error(parts, 0), 0, 5e-12);
    CHECK_NEAR(log2(regimes_error(1, 1) / regimes_error(2, 1)), 7, 0.5);
    CHECK_NEAR(log2(regimes_error(2, 1) / regimes_error(4, 1)), 7, 0.5);
}

/* The error of a smooth motion falls with the tolerance (a user's order of magnitude), and the
 * strict one is exact. */
TEST(the_tolerance_bounds_the_error)
{
#define ROUGH \
    "{'structure':{'type':'chain','masses':[1,1.4],'springs':[1,0.8,0],'dampers':[0.3,0,0.01]},'" \
    "omega':1.1,'excitation':[{'dof':'x2','cos':2}]," \
    "'effects':[{'type':'cubic_spring','dof':'x1','coefficient':2},{'type':'polynomial_damper','" \
    "dof':'x2','coefficients':[-0.1,0,0.3]}]," \
    "'initial':{'x':{'x1':1}},'time':{'dt':0.2,'duration':40}}"
    struct simulate_result s;
    long samples;
    double *exact = run(ROUGH, 1e-13, &samples, &s, NULL), before = HUGE_VAL;

    for (double tolerance = 1e-6; tolerance > 1e-11; tolerance /= 100) {
        double *x = run(ROUGH, tolerance, &samples, &s, NULL), worst = 0;
        for (long k = 0; k < 2 * samples; k++)
            worst = fmax(worst, fabs(x[k] - exact[k]));
        CHECK(worst < 100 * tolerance && worst <= before);
        before = worst;
        free(x);
    }
    free(exact);
}

/* Its end state with one step a sample, DT long: a tolerance of 1 leaves the step alone. */
static double end_error(double dt, bool rk4)
{
    struct simulate_options rough = { .tolerance = 1, .rk4 = rk4, .substeps = 1 },
                            strict = { .tolerance = 1e-13 };
    char text[1024];
    double worst = 0, *x[2];
    struct scene_time t;

    snprintf(
        text, sizeof text,
        "{'structure':{'type':'chain','masses':[1,1.4],'springs':[1,0.8,0],'dampers':"
        "[0.3,0,0.01]},'omega':1.1,'excitation':[{'dof':'x2','cos':2}],'effects':"
        "[{'type':'cubic_spring','dof':'x1','coefficient':2},{'type':'polynomial_damper',"
        "'dof':'x2','coefficients':[-0.1,0,0.3]}],'initial':{'x':{'x1':1}},'time':{'dt':%.17g,"
        "'duration':16}}",
        dt);
    for (int i = 0; i < 2; i++) {
        struct program *p = program_text(text);
        struct simulate_result s;
        cJSON *scene = scene_text(text);

        CHECK(scene_time(scene, p, &t, NULL) == MODAL_OK);
        x[i] = malloc((size_t)t.samples * 2 * sizeof *x[i]);
        CHECK(simulate(p, &t, i == 0 ? &rough : &strict, x[i], &s, NULL) == MODAL_OK);
        CHECK(i == 1 || s.steps == t.samples - 1);
        program_free(p);
        cJSON_Delete(scene);
    }
    for (long k = 2 * t.samples - 2; k < 2 * t.samples; k++)
        worst = fmax(worst, fabs(x[0][k] - x[1][k]));
    free(x[0]);
    free(x[1]);
    return worst;
}

/* Radau's four nodes make 2 * 4 - 1, the classical Runge-Kutta method 4; the next order moves the
 * measured one by some h. */
TEST(halving_the_step_shows_the_orders_seven_and_four)
{
    CHECK_NEAR(log2(end_error(0.1, false) / end_error(0.05, false)), 7, 0.5);
    CHECK_NEAR(log2(end_error(0.1, true) / end_error(0.05, true)), 4, 0.1);
}

/* Asked once a step, in order, a user's cubic spring is the built-in one up to the first of 64 x
 * 100 steps, which knows one value only: it errs by f' h^2 / 2 = 3 (0.05 / 64)^2, of order 1e-9 in
 * x after the second integral. */
TEST(a_force_in_lua_moves_like_the_same_force_in_c)
{
#define CUBIC \
    "{'structure':{'type':'chain','masses':[1.3],'springs':[2,0]},'initial':{'x':{'x1':1.1}},'" \
    "time':{'dt':0.05,'duration':5},'effects':[{"
    struct simulate_result s;
    long samples;
    double *x =
        run(CUBIC "'type':'cubic_spring','dof':'x1','coefficient':1.7}]}", 0, &samples, &s, NULL);
    double *y = run(CUBIC "'type':'lua','dof':'x1',"
                          "'source':'function force(t, x, v, memory) memory.n = (memory.n or 0) + "
                          "1 return 1.7 * x^3 end'}]}",
                    0, &samples, &s, NULL);

    for (long k = 0; k < samples; k++)
        CHECK_NEAR(y[k], x[k], 1e-8);
    free(x);
    free(y);
}

TEST(a_force_that_fails_names_itself)
{
    const char *text = "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'initial':{'x':"
                       "{'x1':1}},'time':{'dt':0.1,'duration':1},'effects':[{'type':'lua',"
                       "'dof':'x1','source':'function force(t, x, v, m) return nil end'}]}";
    struct program *p = program_text(text);
    struct scene_time t = { .dt = 0.1, .samples = 11, .duration = 1 };
    struct simulate_result s;
    struct modal_error err;
    double x[11];

    CHECK(simulate(p, &t, NULL, x, &s, &err) == MODAL_ELEMENT_FAILED);
    program_free(p);
}

/* The message of a Lua force that fails in its first step. */
static void fails_with(const char *source, const char *message)
{
    char text[1024];
    struct scene_time t = { .dt = 0.1, .samples = 11, .duration = 1 };
    struct simulate_result s;
    struct modal_error err;
    struct program *p;
    double x[11];

    snprintf(text, sizeof text, "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},"
             "'initial':{'x':{'x1':1}},'time':{'dt':0.1,'duration':1},"
             "'effects':[{'type':'lua','dof':'x1','source':'%s'}]}", source);
    p = program_text(text);
    CHECK(simulate(p, &t, NULL, x, &s, &err) == MODAL_ELEMENT_FAILED);
    CHECK_STRING(err.field, "effects[0].source");
    if (strstr(err.message, message) == NULL)
        fail_msg("%s: %s", source, err.message);
    program_free(p);
}

/* Lua gives memory back on its way out of an error: the limit is still the one that was passed. */
TEST(a_force_that_calls_itself_without_end_fails_by_its_limit)
{
    fails_with("function f(n) return 1 + f(n + 1) end function force(t, x, v, m) return f(1) end",
               "an element has at most 8388608 bytes");
    fails_with("function force(t, x, v, m) local k = {} while true do k = {k} end end",
               "an element has at most 8388608 bytes");
}

/* Joining and comparing are an instruction each, whatever the strings: of megabytes a million of
 * them took minutes, within which nothing is asked whether it is to end. */
TEST(a_force_has_no_strings_that_make_an_instruction_long)
{
    fails_with("function force(t, x, v, m) local s = \\\"x\\\" while true do s = s .. s end end",
               "a string is longer than some 256 bytes");
}

/* Each call keeps 2000 tables of 56 bytes and more; steps enough pass the budget of one, and the
 * stepping ends with its words. */
TEST(a_force_that_keeps_more_and_more_fails_by_its_limit)
{
    const char *text = "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},"
                       "'initial':{'x':{'x1':1}},'time':{'dt':0.1,'duration':100},"
                       "'effects':[{'type':'lua','dof':'x1','source':'local k = {} function "
                       "force(t, x, v, m) for i = 1, 2000 do k[#k + 1] = {} end return 0 end'}]}";
    struct program *p = program_text(text);
    struct scene_time t = { .dt = 0.1, .samples = 1001, .duration = 100 };
    struct simulate_result s;
    struct modal_error err;
    double x[1001];

    CHECK(simulate(p, &t, NULL, x, &s, &err) == MODAL_ELEMENT_FAILED);
    CHECK_STRING(err.field, "effects[0].source");
    CHECK(strstr(err.message, "an element has at most 8388608 bytes") != NULL);
    program_free(p);
}
