/* Tests as well: ablate.c backbone_job.c chain.c cost.c curve.c damper.c floquet_job.c influence.c
 * job.c kind_run.c moving_signals.c plan.c scene_mesh.c scene_path.c simulate_job.c steady_print.c
 * steady_settings.c sweep.c tradeoff_print.c tradeoff_simulate.c tradeoff_steady.c */
#include "check.h"
#include <float.h>
#include <complex.h>
#include "job/job.h"
#include "job/sweep.h"
#include "modal/scene/influence.h"
#include "scene_text.h"

static cJSON *job(const char *kind, const char *scene_json, const char *options_json,
                  enum modal_status expected, struct modal_error *err)
{
    cJSON *scene = scene_text(scene_json),
          *options = options_json != NULL ? scene_text(options_json) : NULL, *result;
    struct job_request request = { .kind = kind, .scene = scene, .options = options };
    struct job_result r;
    struct modal_error why = { 0 };
    enum modal_status rc = job_run(&request, &r, &why);

    if (rc != expected)
        fail_msg("%s of %s: %s at %s: %s", kind, scene_json, modal_status_code(rc), why.field,
                 why.message);
    if (err != NULL)
        *err = why;
    result = r.result;
    r.result = NULL;
    job_result_done(&r);
    cJSON_Delete(scene);
    cJSON_Delete(options);
    return result;
}

static double number(const cJSON *json, const char *a, const char *b)
{
    const cJSON *x = cJSON_GetObjectItemCaseSensitive(json, a);

    if (b != NULL)
        x = cJSON_GetObjectItemCaseSensitive(x, b);
    return cJSON_IsNumber(x) ? x->valuedouble : NAN;
}

TEST(a_plan_names_class_states_hash_and_every_effect_in_order)
{
    cJSON *r = job("simulate",
                   "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'initial':{'x':"
                   "{'x1':1}},'time':{'dt':0.1,'duration':10},'effects':[{'type':'damper',"
                   "'dof':'x1','coefficient':0.1},{'type':'friction','dof':'x1','stiffness':1,"
                   "'limit':9},{'type':'gap','dof':'x1','stiffness':9,'clearance':0.2}]}",
                   NULL, MODAL_OK, NULL);
    const cJSON *plan = cJSON_GetObjectItem(r, "plan"),
                *effects = cJSON_GetObjectItem(plan, "effects");

    CHECK_STRING(cJSON_GetObjectItem(plan, "class")->valuestring, "nonlinear");
    CHECK(number(plan, "states", NULL) == 3 &&
          strlen(cJSON_GetObjectItem(plan, "hash")->valuestring) == 64);
    CHECK(cJSON_GetArraySize(effects) == 3 &&
          number(cJSON_GetArrayItem(effects, 0), "evaluations", NULL) == 0);
    CHECK(cJSON_IsFalse(cJSON_GetObjectItem(cJSON_GetArrayItem(effects, 1), "active")));
    CHECK(cJSON_IsTrue(cJSON_GetObjectItem(cJSON_GetArrayItem(effects, 2), "active")));
    CHECK(number(cJSON_GetArrayItem(effects, 2), "seconds", NULL) > 0);
    CHECK(number(r, "samples", NULL) == 101 &&
          cJSON_IsObject(cJSON_GetObjectItem(r, "provenance")));
    cJSON_Delete(r);
}

/* m = 1, k = 9 + 0.4: removing the spring takes w = sqrt(9.4) to 3, to first order by -0.4 / (2
 * sqrt 9.4); removing the damper takes Re lambda from -0.15 to 0, exactly so to first order in the
 * exponent. */
TEST(ablation_gives_each_effect_s_change_and_its_first_order)
{
    cJSON *r = job("ablate",
                   "{'structure':{'type':'chain','masses':[1],'springs':[9,0]},'effects':"
                   "[{'type':'spring','dof':'x1','stiffness':0.4},{'type':'damper','dof':'x1',"
                   "'coefficient':0.3}]}",
                   NULL, MODAL_OK, NULL);
    const cJSON *effects = cJSON_GetObjectItem(r, "effects"),
                *spring = cJSON_GetArrayItem(effects, 0), *damper = cJSON_GetArrayItem(effects, 1);
    const cJSON *mode =
        cJSON_GetArrayItem(cJSON_GetObjectItem(cJSON_GetObjectItem(spring, "change"), "modes"), 0);
    double w = sqrt(9.4);

    CHECK_NEAR(number(mode, "frequency_change_hz", NULL), (3 - w) / (2 * M_PI), 1e-14);
    CHECK_NEAR(number(mode, "frequency_first_order_hz", NULL), -0.4 / (2 * w) / (2 * M_PI), 1e-14);
    mode =
        cJSON_GetArrayItem(cJSON_GetObjectItem(cJSON_GetObjectItem(damper, "change"), "modes"), 0);
    CHECK_NEAR(number(mode, "damping_change", NULL), -0.15 / w, 1e-14);
    CHECK_NEAR(number(mode, "damping_first_order", NULL), -0.15 / w, 1e-14);
    CHECK_NEAR(number(damper, "change", "margin"), -0.15, 1e-14);
    CHECK(cJSON_IsNull(cJSON_GetObjectItem(
        cJSON_GetObjectItem(cJSON_GetObjectItem(damper, "without"), "stability"), "stable")));
    cJSON_Delete(r);
}

/* What the first-order estimate leaves out: |lambda' - lambda - d|, the largest of all modes. */
static double missed(double k)
{
    char text[512];
    struct program *p, *q;
    struct influence f;
    double most = 0;

    snprintf(text, sizeof text,
             "{'structure':{'type':'chain','masses':[1,2],'springs':[3,1,2]},'omega':1.3,"
             "'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':0.3},"
             "{'type':'damper','dof':'x1','coefficient':0.02},{'type':'spring','dof':'x2',"
             "'stiffness':%.17g},{'type':'damper','dof':'x2','coefficient':%.17g}]}",
             1 + k, 0.1 + k / 3);
    p = program_text(text);
    snprintf(text, sizeof text,
             "{'structure':{'type':'chain','masses':[1,2],'springs':[3,1,2]},'omega':1.3,"
             "'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':0.3},"
             "{'type':'damper','dof':'x1','coefficient':0.02},{'type':'spring','dof':'x2',"
             "'stiffness':1},{'type':'damper','dof':'x2','coefficient':0.1}]}");
    q = program_text(text);
    CHECK(influence(q, p, &f, NULL) == MODAL_OK && f.periodic);
    for (int i = 0; i < f.count; i++)
        most = fmax(most, cabs(f.to[i] - f.from[i] - f.first_order[i]));
    influence_done(&f);
    program_free(p);
    program_free(q);
    return most;
}

/* A second-order remainder: halving takes it to a quarter, up to its own relative change, which
 * halves each time too. */
TEST(the_first_order_estimate_of_a_periodic_scene_leaves_out_the_second_order)
{
    double a = missed(0.04), b = missed(0.02), c = missed(0.01);

    CHECK_NEAR(a / b, 4, 0.2);
    CHECK_NEAR(b / c, 4, 0.1);
}

/* Without the parametric spring x'' + 0.02 x' + x = 0 has exp((-0.01 +- i sqrt(1 - 1e-4)) T) over
 * T = 2 pi / 2; without the damper, undamped, the product of the two is 1 (Liouville). */
TEST(ablation_of_a_periodic_scene_gives_multipliers_with_and_without_each_effect)
{
    static const char scene[] = "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},"
        "'omega':2,'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':-0.3},"
        "{'type':'damper','dof':'x1','coefficient':0.02}]}";
    cJSON *r = job("ablate", scene, NULL, MODAL_OK, NULL);
    const cJSON *effects = cJSON_GetObjectItem(r, "effects"), *list[3], *x;
    double complex expected = cexp(CMPLX(-0.01, sqrt(1 - 1e-4)) * M_PI), product = 1;

    list[0] = cJSON_GetObjectItem(cJSON_GetObjectItem(r, "with"), "multipliers");
    for (int i = 0; i < 2; i++) {
        x = cJSON_GetObjectItem(cJSON_GetArrayItem(effects, i), "without");
        list[i + 1] = cJSON_GetObjectItem(x, "multipliers");
    }
    for (int i = 0; i < 3; i++)
        CHECK(cJSON_GetArraySize(list[i]) == 2);
    cJSON_ArrayForEach(x, list[1]) {
        CHECK_NEAR(cJSON_GetArrayItem(x, 0)->valuedouble, creal(expected), 1e-12);
        CHECK_NEAR(fabs(cJSON_GetArrayItem(x, 1)->valuedouble), fabs(cimag(expected)), 1e-12);
    }
    cJSON_ArrayForEach(x, list[2])
        product *= CMPLX(x->child->valuedouble, x->child->next->valuedouble);
    CHECK_NEAR(cabs(product - 1), 0, 1e-10);
    cJSON_Delete(r);
}

/* A pulse moves no exponent: 3 - sqrt(9.4) for the spring of 0.4 over 9, whatever starts the
 * motion. */
TEST(ablation_of_a_scene_with_pulses_alone_compares_exponents)
{
    static const char *const pulses[] = {
        "{'dof':'x1','type':'impulse','amplitude':2}",
        "{'dof':'x1','type':'half_sine','amplitude':2,'duration':0.1}",
        "{'dof':'x1','type':'table','time':[0,1,2],'force':[0,1,0]}"
    };
    char scene[512];

    for (size_t i = 0; i < sizeof pulses / sizeof *pulses; i++) {
        snprintf(scene, sizeof scene,
                 "{'structure':{'type':'chain','masses':[1],'springs':[9,0]},'excitation':[%s],"
                 "'effects':[{'type':'spring','dof':'x1','stiffness':0.4}]}",
                 pulses[i]);
        cJSON *r = job("ablate", scene, NULL, MODAL_OK, NULL);
        const cJSON *change =
            cJSON_GetObjectItem(cJSON_GetArrayItem(cJSON_GetObjectItem(r, "effects"), 0), "change");
        const cJSON *mode = cJSON_GetArrayItem(cJSON_GetObjectItem(change, "modes"), 0);
        CHECK_STRING(cJSON_GetObjectItem(r, "of")->valuestring, "floquet");
        CHECK_NEAR(number(mode, "frequency_change_hz", NULL), (3 - sqrt(9.4)) / (2 * M_PI), 1e-14);
        cJSON_Delete(r);
    }
}

/* "-o without=1" is the number 1; it must mean the list [1], and a number beyond the scene's
 * effects must be told. */
TEST(simulate_leaves_out_one_effect_by_its_number_and_no_effect_that_is_not_there)
{
    static const char scene[] = "{'structure':{'type':'chain','masses':[1],'springs':[9,0]},"
                                "'initial':{'x':{'x1':1}},'time':{'dt':0.1,'duration':1},"
                                "'effects':[{'type':'spring','dof':'x1','stiffness':0.4},"
                                "{'type':'damper','dof':'x1','coefficient':0.3}]}";
    static const char *const wrong[] = { "{'without':2}", "{'without':[0,2]}", "{'without':0.5}",
                                         "{'without':-1}", "{'without':'x'}" };
    cJSON *one = job("simulate", scene, "{'without':1}", MODAL_OK, NULL),
          *list = job("simulate", scene, "{'without':[1]}", MODAL_OK, NULL);

    for (int k = 0; k < 2; k++) {
        const cJSON *effects =
            cJSON_GetObjectItem(cJSON_GetObjectItem(k == 0 ? one : list, "plan"), "effects");
        CHECK(cJSON_GetArraySize(effects) == 1);
        CHECK_STRING(cJSON_GetObjectItem(cJSON_GetArrayItem(effects, 0), "type")->valuestring,
                     "spring");
    }
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct modal_error err;
        cJSON_Delete(job("simulate", scene, wrong[i], MODAL_BAD_INPUT, &err));
        CHECK(strncmp(err.field, "without", 7) == 0);
    }
    cJSON_Delete(one);
    cJSON_Delete(list);
}

/* A linear scene's motion is linear in its load: 2^70 times the load is 2^70 times the motion, to
 * rounding over the 100 steps. */
TEST(a_linear_motion_scales_with_its_load_over_twenty_decades)
{
    double factor = ldexp(1, 70);
    double last[2];
    char scene[512];

    for (int k = 0; k < 2; k++) {
        snprintf(scene, sizeof scene,
                 "{'structure':{'type':'chain','masses':[1],'springs':[9,0]},'omega':2,'time':"
                 "{'dt':0.01,'duration':1},'excitation':[{'dof':'x1','cos':%.17g}],'effects':"
                 "[{'type':'damper','dof':'x1','coefficient':0.3}]}",
                 k == 0 ? 1 : factor);
        cJSON *json = scene_text(scene);
        struct job_request request = { .kind = "simulate", .scene = json };
        struct job_result r;
        CHECK(job_run(&request, &r, NULL) == MODAL_OK);
        last[k] = r.batch.signals[r.batch.samples * r.batch.channels - 1];
        job_result_done(&r);
        cJSON_Delete(json);
    }
    CHECK_NEAR(last[1] / factor, last[0], 1e-13);
}

TEST(ablation_of_an_excited_scene_compares_steady_states)
{
    /* X = p / (k - w^2 + i c w): without the spring of 3, 1 / (6 - 4 + 0.2 i), with it 1 / (9 - 4 +
     * 0.2 i) */
    cJSON *r = job("ablate",
                   "{'structure':{'type':'chain','masses':[1],'springs':[6,0],'dampers':[0.1,0]},"
                   "'omega':2,'excitation':[{'dof':'x1','cos':1}],'effects':[{'type':'spring',"
                   "'dof':'x1','stiffness':3}]}",
                   NULL, MODAL_OK, NULL);
    const cJSON *change =
        cJSON_GetObjectItem(cJSON_GetArrayItem(cJSON_GetObjectItem(r, "effects"), 0), "change");
    double complex a = 1 / CMPLX(5, 0.2), b = 1 / CMPLX(2, 0.2);

    CHECK_STRING(cJSON_GetObjectItem(r, "of")->valuestring, "steady");
    CHECK_NEAR(number(change, "harmonics", NULL), cabs(b - a), 1e-12);
    CHECK_NEAR(number(change, "relative", NULL), cabs(b - a) / cabs(a), 1e-12);
    cJSON_Delete(r);
}

static const char *failure(const char *scene)
{
    static char code[64];
    cJSON *r = job("steady", scene, NULL, MODAL_OK, NULL);
    const cJSON *list = cJSON_GetObjectItem(r, "diagnostics");
    const cJSON *d = cJSON_GetObjectItem(cJSON_GetArrayItem(list, 0), "code");

    snprintf(code, sizeof code, "%s",
             cJSON_IsTrue(cJSON_GetObjectItem(r, "converged")) ? "converged" : d->valuestring);
    cJSON_Delete(r);
    return code;
}

#define AT_RESONANCE \
    "'structure':{'type':'chain','masses':[1],'springs':[1,0]},'omega':1,'steady':{'harmonics':7,"

#define SLIDER "'effects':[{'type':'friction','dof':'x1','stiffness':1,'limit':1}]}"

/* At resonance a slider of 1 N takes at most 4 / pi = 1.273 N of a harmonic load, and 1 N of a mean
 * one.  Off resonance a search that was cut short proves nothing. */
/* Friction far below the load leaves the linear multipliers: det e^{A T} = e^{-c T / m}, so that
 * each of the pair has the modulus e^{0.05 T}, T = 2 pi / 3. */
TEST(an_unstable_motion_under_rigid_friction_is_given_with_its_multipliers)
{
    cJSON *r = job("steady",
                   "{'structure':{'type':'chain','masses':[1],'springs':[4,0],'dampers':[-0.1,0]},"
                   "'omega':3,'effects':[{'type':'coulomb','dof':'x1','limit':1e-7}],'excitation':"
                   "[{'dof':'x1','k':1,'cos':1}],'steady':{'harmonics':5,'stability':true}}",
                   NULL, MODAL_OK, NULL);
    const cJSON *stability = cJSON_GetObjectItem(r, "stability");

    CHECK(cJSON_IsFalse(cJSON_GetObjectItem(stability, "stable")));
    CHECK_NEAR(number(stability, "max_multiplier", NULL), exp(0.05 * 2 * acos(-1) / 3), 1e-6);
    cJSON_Delete(r);
}

/* Twenty unit masses on springs of 1000 and dampers of 1, a cubic spring of 100 at each. The motion
 * found first is unstable; another is stable: the third harmonic of x20 in it by Newton's method
 * over a period of scipy's DOP853. */
TEST(a_stable_motion_beside_an_unstable_one_has_the_harmonics_that_its_own_error_asks_for)
{
    enum { N = 20 };
    char *text = malloc(100 * N + 400), *at = text;

    at += sprintf(at, "{'structure':{'type':'chain','masses':[1");
    for (int list = 0; list < 3; list++) {
        for (int i = 1; i < N; i++)
            at += sprintf(at, list == 1 ? ",1000" : ",1");
        at += sprintf(at, list == 0 ? "],'springs':[1000" : list == 1 ? ",0],'dampers':[1" : ",0]");
    }
    at += sprintf(at, "},'omega':5,'excitation':[{'dof':'x20','k':1,'cos':20}],'effects':[");
    for (int i = 1; i <= N; i++)
        at += sprintf(at, "%s{'type':'cubic_spring','dof':'x%d','coefficient':100}",
                      i > 1 ? "," : "", i);
    sprintf(at, "],'steady':{}}");
    cJSON *r = job("steady", text, NULL, MODAL_OK, NULL),
          *x20 = cJSON_GetArrayItem(cJSON_GetObjectItem(r, "harmonics"), N - 1),
          *re = cJSON_GetArrayItem(cJSON_GetObjectItem(x20, "re"), 3),
          *im = cJSON_GetArrayItem(cJSON_GetObjectItem(x20, "im"), 3);
    CHECK(cJSON_IsTrue(cJSON_GetObjectItem(r, "converged")));
    CHECK(cJSON_IsTrue(cJSON_GetObjectItem(cJSON_GetObjectItem(r, "stability"), "stable")));
    CHECK(number(r, "total_error", NULL) < 1e-9);
    CHECK(re != NULL && im != NULL);
    CHECK_NEAR(re->valuedouble, 0.032341885945903, 1e-10);
    CHECK_NEAR(im->valuedouble, -0.000684675762576, 1e-10);
    cJSON_Delete(r);
    free(text);
}

/* Two masses on stops, whose harmonics fall slowly: half of the work ends at 128 of them, with 1.6
 * times the error asked for; the stable answer needs no search and has the rest. */
TEST(a_stable_answer_has_all_the_work_for_its_target)
{
    cJSON *r = job("steady",
                   "{'structure':{'type':'chain','masses':[0.9242,0.6474],'springs':[0.8569,1.4031,"
                   "0],'dampers':[0.00727,0.00991,0]},'omega':2.0493,'effects':[{'type':'gap',"
                   "'dof':'x1','stiffness':2.208,'clearance':0},{'type':'gap','dof':'x2',"
                   "'stiffness':189.119,'clearance':-0.055}],'excitation':[{'dof':'x1','k':1,"
                   "'cos':0.174}],'steady':{}}",
                   NULL, MODAL_OK, NULL);

    CHECK(cJSON_IsTrue(cJSON_GetObjectItem(cJSON_GetObjectItem(r, "stability"), "stable")));
    CHECK(cJSON_GetArraySize(cJSON_GetObjectItem(r, "diagnostics")) == 0);
    CHECK(number(r, "total_error", NULL) > 0);
    cJSON_Delete(r);
}

/* A damper that drives leaves no motion stable: what is sought beside the unstable answer is of the
 * answer's budget, and told with it. */
TEST(the_search_beside_an_unstable_answer_is_of_its_budget)
{
    const char *scene = "{'structure':{'type':'matrices','M':[[1]],'C':[[-0.1]],'K':[[1]]},'omega':"
                        "0.7,'effects':[{'type':'cubic_spring','dof':'x1','coefficient':0.1}],"
                        "'excitation':[{'dof':'x1','k':1,'cos':0.5}],'steady':{}}";
    cJSON *alone = job("steady", scene, "{'stability':false}", MODAL_OK, NULL),
          *r = job("steady", scene, NULL, MODAL_OK, NULL);

    CHECK(cJSON_IsFalse(cJSON_GetObjectItem(cJSON_GetObjectItem(r, "stability"), "stable")));
    CHECK(number(r, "work", "allowed") > number(alone, "work", "allowed")); /* by its verdict */
    CHECK(number(r, "work", "allowed") <= 2 * number(alone, "work", "allowed"));
    CHECK(number(r, "work", "spent") > 2 * number(alone, "work", "spent"));
    CHECK(number(r, "work", "spent") < 1.1 * number(r, "work", "allowed"));
    cJSON_Delete(alone);
    cJSON_Delete(r);
}

/* On the way through sqrt(K / M) the point there has no motion: neither its neighbour's nor what
 * lay in memory. */
TEST(a_point_without_any_motion_has_zeros_and_not_the_motion_of_the_one_before)
{
    cJSON *r = job("steady", "{'structure':{'type':'matrices','M':[[1]],'K':[[100]]},'omega':10,"
                             "'excitation':[{'dof':'x1','cos':1}]}",
                   "{'sweep':'omega=9:11:3'}", MODAL_OK, NULL),
          *points = cJSON_GetObjectItem(r, "points");
    static const double is[] = { 1 / 19.0, 0, -1 / 21.0 };       /* 1 / (K - omega^2 M) */

    for (int i = 0; i < 3; i++) {
        cJSON *p = cJSON_GetArrayItem(points, i),
              *x = cJSON_GetArrayItem(cJSON_GetObjectItem(p, "harmonics"), 0),
              *re = cJSON_GetArrayItem(cJSON_GetObjectItem(x, "re"), 1);
        CHECK(cJSON_IsTrue(cJSON_GetObjectItem(p, "converged")) == (i != 1));
        CHECK(re != NULL);
        CHECK_NEAR(re->valuedouble, is[i], 8 * DBL_EPSILON);
    }
    cJSON_Delete(r);
}

TEST(that_there_is_no_periodic_solution_is_said_only_where_it_is_certain)
{
    CHECK_STRING(failure("{" AT_RESONANCE "'max_iterations':200},"
                         "'excitation':[{'dof':'x1','cos':1.3}]," SLIDER), "no_periodic_solution");
    CHECK_STRING(failure("{" AT_RESONANCE "'max_iterations':200},"
                         "'excitation':[{'dof':'x1','cos':1.2}]," SLIDER), "converged");
    CHECK_STRING(failure("{" AT_RESONANCE "'max_iterations':9},"
                         "'excitation':[{'dof':'x1','cos':1}]}"),
                 "no_periodic_solution");
    CHECK_STRING(failure("{'structure':{'type':'chain','masses':[1],'springs':[0,0]},'omega':1,"
                         "'excitation':[{'dof':'x1','k':0,'cos':2},{'dof':'x1','cos':1}],'steady':"
                         "{'harmonics':7,'max_iterations':50}," SLIDER),
                 "no_periodic_solution");
    CHECK_STRING(
        failure("{'structure':{'type':'chain','masses':[1],'springs':[1,0],'dampers':[0.02,0]},"
                "'omega':0.3,'excitation':[{'dof':'x1','cos':1}],'effects':[{'type':'friction',"
                "'dof':'x1','stiffness':1000,'limit':0.6}],'steady':{'harmonics':63,"
                "'max_iterations':1}}"),
        "not_converged");
}

TEST(no_sensors_are_no_fault_but_where_a_motion_is_recorded)
{
    static const char scene[] = "{'structure':{'type':'chain','masses':[1],'springs':[1,0],"
        "'dampers':[0.1,0]},'omega':1,'sensors':[],'excitation':[{'dof':'x1','cos':0.3}],"
        "'time':{'dt':0.1,'duration':1}}";
    struct modal_error err;
    cJSON *r = job("steady", scene, NULL, MODAL_OK, NULL);

    CHECK(cJSON_IsTrue(cJSON_GetObjectItem(r, "converged")));
    cJSON_Delete(r);
    cJSON_Delete(job("floquet", scene, NULL, MODAL_OK, NULL));
    cJSON_Delete(job("ablate", scene, NULL, MODAL_OK, NULL));
    CHECK(job("simulate", scene, NULL, MODAL_BAD_INPUT, &err) == NULL);
    CHECK_STRING(err.field, "sensors");
    CHECK(job("tradeoff", scene, "{'of':'simulate'}", MODAL_BAD_INPUT, &err) == NULL);
    CHECK_STRING(err.field, "sensors");
}

/* All but what reads the scene and what prints: no other stage takes a part of it. */
TEST(the_stage_solve_of_a_curve_is_all_the_work_of_its_points)
{
    static const char *const curves[] = { "{'sweep':'omega=0.8:1.2:5'}",
                                          "{'continue':'omega=0.8:1.2'}",
                                          "{'continue':'effects[0].coefficient=0.1:0.2'}" };

    for (size_t i = 0; i < sizeof curves / sizeof *curves; i++) {
        cJSON *r = job("steady",
                       "{'structure':{'type':'chain','masses':[1],'springs':[1,0],'dampers':"
                       "[0.1,0]},'omega':1,'excitation':[{'dof':'x1','cos':0.3}],'effects':"
                       "[{'type':'cubic_spring','dof':'x1','coefficient':0.1}],'steady':"
                       "{'harmonics':7}}",
                       curves[i], MODAL_OK, NULL);
        const cJSON *cost = cJSON_GetObjectItem(r, "cost"), *stage;
        double sum = 0;

        CHECK(cJSON_GetArraySize(cJSON_GetObjectItem(r, "points")) >= 5 &&
              number(cJSON_GetObjectItem(cost, "stages"), "solve", NULL) > 0);
        cJSON_ArrayForEach(stage, cJSON_GetObjectItem(cost, "stages")) {
            CHECK(strcmp(stage->string, "lower") == 0 || strcmp(stage->string, "solve") == 0 ||
                  strcmp(stage->string, "print") == 0);
            sum += stage->valuedouble;
        }
        CHECK(sum <= number(cost, "cpu_s", NULL));
        cJSON_Delete(r);
    }
}

#define GRID \
    "{'verb':'floquet','scene':{'structure':{'type':'matrices','M':[[1]],'K':[[1]],'C':[[0.01]]}," \
    "'omega':2,'effects':" \
    "[{'type':'parametric_stiffness','dof':'x1','stiffness':-0.3}]},'grid':[{'path':'effects[0]." \
    "stiffness','values':[-0.1,-0.3,-0.5]}," \
    "{'path':'omega','values':[1.6,1.9,2.0,2.3]}]}"

TEST(shares_of_a_sweep_put_together_are_the_sweep)
{
    cJSON *whole = job("sweep", GRID, NULL, MODAL_OK, NULL),
          *a = job("sweep", GRID, "{'count':5}", MODAL_OK, NULL);
    cJSON *b = job("sweep", GRID, "{'first':5}", MODAL_OK, NULL),
          *points = cJSON_GetObjectItem(whole, "points");
    int i = 0;
    const cJSON *point;

    CHECK(cJSON_GetArraySize(points) == 12);
    cJSON_ArrayForEach(point, points) {
        const cJSON *share =
            cJSON_GetArrayItem(cJSON_GetObjectItem(i < 5 ? a : b, "points"), i < 5 ? i : i - 5);
        CHECK(cJSON_Compare(point, share, 1));
        CHECK((int)cJSON_GetArrayItem(cJSON_GetObjectItem(point, "index"), 0)->valuedouble ==
              i / 4);
        i++;
    }
    /* the principal tongue at omega_p = 2: growth 2 mu / 4 less damping 0.005, so mu = 0.15 is
     * unstable, and at 1.6 stable */
    CHECK(cJSON_IsFalse(cJSON_GetObjectItem(
        cJSON_GetObjectItem(cJSON_GetArrayItem(points, 6), "stability"), "stable")));
    CHECK(cJSON_IsTrue(cJSON_GetObjectItem(
        cJSON_GetObjectItem(cJSON_GetArrayItem(points, 0), "stability"), "stable")));
    cJSON_Delete(whole);
    cJSON_Delete(a);
    cJSON_Delete(b);
}

TEST(a_point_that_cannot_be_computed_says_so_in_its_row)
{
    cJSON *r =
        job("sweep",
            "{'verb':'floquet','scene':{'structure':{'type':'chain','masses':[1],'springs':"
            "[1,0]}},'grid':[{'path':'structure.masses[0]','values':[1,-1]}]}",
            NULL, MODAL_OK, NULL);
    const cJSON *bad = cJSON_GetArrayItem(cJSON_GetObjectItem(r, "points"), 1);

    CHECK_STRING(cJSON_GetObjectItem(cJSON_GetObjectItem(bad, "error"), "field")->valuestring,
                 "structure.masses[0]");
    CHECK(cJSON_GetObjectItem(cJSON_GetArrayItem(cJSON_GetObjectItem(r, "points"), 0), "error") ==
          NULL);
    cJSON_Delete(r);
}

TEST(a_sweep_s_own_faults_are_named)
{
    static const struct { const char *text, *options, *field;
    } bad[] = { { "{'verb':'fly','scene':{},'grid':[]}", NULL, "verb" },
                { "{'verb':'floquet','grid':[{'path':'omega','values':[1]}]}", NULL, "scene" },
                { "{'verb':'floquet','scene':{},'grid':[]}", NULL, "grid" },
                { "{'verb':'floquet','scene':{'effects':[]},'grid':[{'path':'effects[0].limit',"
                  "'values':[1]}]}",
                  NULL, "grid[0].path" },
                { "{'verb':'floquet','scene':{},'grid':[{'path':'omega','values':[]}]}", NULL,
                  "grid[0].values" },
                { GRID, "{'first':12}", "first" } };

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct modal_error err;
        CHECK(job("sweep", bad[i].text, bad[i].options, MODAL_BAD_INPUT, &err) == NULL);
        if (strcmp(err.field, bad[i].field) != 0)
            fail_msg("%s: at %s: %s", bad[i].text, err.field, err.message);
    }
}

static int events;
static void count_event(void *context, const cJSON *event)
{
    (void)context;
    events += number(event, "fraction", NULL) > 0 &&
              cJSON_IsArray(cJSON_GetObjectItem(event, "points"));
}

static bool after_two(void *context)
{
    (void)context;
    return events >= 2;
}

TEST(a_sweep_reports_chunks_and_stops_when_cancelled)
{
    cJSON *scene = scene_text(GRID);
    struct job_request request = {
        .kind = "sweep", .scene = scene, .progress = count_event, .cancelled = after_two
    };
    struct job_result r;

    events = 0;
    CHECK(job_run(&request, &r, NULL) == MODAL_CANCELLED && events == 2);
    cJSON_Delete(scene);
}

static int asked;

static bool at_the_fortieth(void *context)
{
    (void)context;
    return ++asked > 40;
}

TEST(a_curve_that_is_cancelled_is_the_points_it_has)
{
#define OSCILLATOR \
    "{'structure':{'type':'chain','masses':[1],'springs':[1,0],'dampers':[0.1,0]},'omega':0.5," \
    "'effects':[{'type':'cubic_spring','dof':'x1','coefficient':0.3}]," \
    "'excitation':[{'dof':'x1','k':1,'cos':0.1}]}"
    static const char *const ways[] = { "{'continue':'omega=0.5:2'}",
                                        "{'sweep':'omega=0.5:2:50'}" };

    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++) {
        cJSON *scene = scene_text(OSCILLATOR), *options = scene_text(ways[i]), *points;
        struct job_request request = {
            .kind = "steady", .scene = scene, .options = options, .cancelled = at_the_fortieth
        };
        struct job_result r;
        asked = 0;
        CHECK(job_run(&request, &r, NULL) == MODAL_OK);
        points = cJSON_GetObjectItem(r.result, "points");
        CHECK(cJSON_GetArraySize(points) > 0 && cJSON_GetArraySize(points) < 50);
        CHECK(cJSON_IsFalse(cJSON_GetObjectItem(r.result, "complete")));
        CHECK(strcmp(cJSON_GetStringValue(cJSON_GetObjectItem(r.result, "reason")),
                     JOB_STOPPED) == 0);
        job_result_done(&r);
        asked = 1000;                                   /* before the first point there is none */
        CHECK(job_run(&request, &r, NULL) == MODAL_CANCELLED);
        cJSON_Delete(options);
        cJSON_Delete(scene);
    }
}

/* Explicit steps of order 4: four times the substeps, 256 times less error; and the rungs' settings
 * can be pasted back. */
TEST(the_trade_off_of_a_simulation_shows_the_order_of_its_peer)
{
#define MOTION \
    "{'structure':{'type':'chain','masses':[1.3],'springs':[2,0],'dampers':[0.1,0]},'initial':{'" \
    "x':{'x1':1.1}},'time':{'dt':0.4,'duration':20}," \
    "'effects':[{'type':'cubic_spring','dof':'x1','coefficient':1.7},{'type':'damper','dof':'x1'," \
    "'coefficient':0.2}]}"
    cJSON *r = job("tradeoff", MOTION, "{'of':'simulate'}", MODAL_OK, NULL),
          *rungs = cJSON_GetObjectItem(r, "rungs");
    const cJSON *rung;
    double coarse = NAN, fine = NAN, own = NAN, without = NAN;

    cJSON_ArrayForEach(rung, rungs) {
        const cJSON *s = cJSON_GetObjectItem(rung, "settings");
        double n = number(s, "substeps", NULL), error = number(rung, "error", NULL);
        coarse = n == 16 ? error : coarse;
        fine = n == 64 ? error : fine;
        if (number(s, "tolerance", NULL) == 1e-10)
            *(cJSON_GetObjectItem(s, "without") ? &without : &own) = error;
    }
    CHECK(log2(coarse / fine) > 7.5 && log2(coarse / fine) < 8.5);
    CHECK(own < 1e-9 && without > 0.1);
    job_result_done(&(struct job_result){
        .result = job("simulate", MOTION, "{'integrator':'rk4','substeps':16}", MODAL_OK, NULL) });
    cJSON_Delete(r);
}

static double rung_error(const cJSON *result, const char *key, double value)
{
    const cJSON *rung;

    cJSON_ArrayForEach(rung, cJSON_GetObjectItem(result, "rungs"))
        if (number(cJSON_GetObjectItem(rung, "settings"), key, NULL) == value)
            return number(rung, "error", NULL);
    return NAN;
}

/* Released from half a sine.  Frequencies of Hermite elements are off by h^4, so over a few periods
 * the motion is: what 2 elements of 4 leave out is (16 - 1) e, what 8 add is (1 - 1/16) e, a ratio
 * of 16 up to the next order, h^2 of it. */
TEST(the_trade_off_over_elements_shows_the_order_of_the_elements)
{
    cJSON *r = job("tradeoff",
                   "{'structure':{'type':'beam','length':2,'elements':4,'EI':90,"
                   "'mass_per_length':3},'effects':[{'type':'damper','dof':'w2',"
                   "'coefficient':0.1}],'initial':{'x':{'th0':0.29845130209103,"
                   "'w1':0.134350288425444,'th1':0.211036939562522,'w2':0.19,"
                   "'w3':0.134350288425444,'th3':-0.211036939562522,'th4':-0.29845130209103}},"
                   "'sensors':[{'dof':'w2'}],'time':{'dt':0.01,'duration':2}}",
                   "{'of':'simulate'}", MODAL_OK, NULL);
    double rough = rung_error(r, "elements", 2), fine = rung_error(r, "elements", 8);

    CHECK(fine > 1e-6 && fine < 1e-2);
    CHECK(rough / fine > 8 && rough / fine < 32);
    cJSON_Delete(r);
}

TEST(the_trade_off_over_inflow_has_the_orders_beside_the_scene_s)
{
    cJSON *r = job("tradeoff",
                   "{'structure':{'type':'wing','length':20,'chord':6,'elements':2,'EI':23.65e6,"
                   "'GJ':2.39e6,'mass_per_length':0.746,'I_rho':1.943,'x_cg':0.6},'effects':"
                   "[{'type':'airloads','speed':400,'density':2e-3,'x_qc':-0.5,"
                   "'inflow':'peters_he','inflow_states':20}],'initial':{'v':{'w1':0.5,'w2':1}},"
                   "'time':{'dt':0.005,'duration':0.5}}",
                   "{'of':'simulate'}", MODAL_OK, NULL);

    /* orders 5, 7 and 9 */
    CHECK(rung_error(r, "inflow_states", 12) > rung_error(r, "inflow_states", 30));
    CHECK(rung_error(r, "inflow_states", 30) > 1e-6);
    CHECK(rung_error(r, "elements", 4) > 1e-6);
    CHECK(isnan(rung_error(r, "elements", 1)));   /* w1 of 2 elements is no node of 1 */
    cJSON_Delete(r);
}

static void job_signals(const char *scene_json, const char *options_json, struct job_result *out)
{
    cJSON *scene = scene_text(scene_json), *options = scene_text(options_json);
    struct job_request request = { .kind = "simulate", .scene = scene, .options = options };

    CHECK(job_run(&request, out, NULL) == MODAL_OK);
    cJSON_Delete(scene);
    cJSON_Delete(options);
}

/* The same mesh again is the same motion; the places of another keep their names. */
TEST(another_mesh_keeps_places_and_names)
{
#define SHAFT_WITH(spring) \
    "{'structure':{'type':'shaft','length':1,'elements':4,'EI':[98,175],'mass_per_length':2,'" \
    "speed':20,'disk':{'position':0.5,'mass':5,'radius':0.1}}," \
    "'effects':[{'type':'bearing','at':'left','transverse':2e4},{'type':'bearing','at':'right','" \
    "transverse':2e4},{'type':'spring'," spring ",'stiffness':1e4}]," \
    "'excitation':[{'dof':'z2','type':'half_sine','amplitude':1,'duration':0.05}],'initial':{'x':" \
    "{'y2':0.01,'sy0':0.02}},'time':{'dt':0.01,'duration':0.2}}"
#define SHAFT SHAFT_WITH("'dof':'y1','to':'y3'")
    struct job_result own, same, finer, along;

    job_signals(SHAFT, "{}", &own);
    job_signals(SHAFT, "{'elements':4}", &same);
    job_signals(SHAFT, "{'elements':8}", &finer);
    CHECK(own.batch.channels == 20 && same.batch.channels == 20 && finer.batch.channels == 20);
    for (size_t i = 0; i < 20; i++)
        CHECK(strcmp(own.batch.names[i], finer.batch.names[i]) == 0);
    for (size_t i = 0; i < own.batch.samples * 20; i++)
        CHECK(own.signals[i] == same.signals[i]);
    job_signals(SHAFT_WITH("'direction':{'y1':1,'y3':-1}"), "{'elements':8}", &along);
    for (size_t i = 0; i < own.batch.samples * 20; i++)
        CHECK_NEAR(along.signals[i], finer.signals[i], 1e-12);
    job_result_done(&own);
    job_result_done(&same);
    job_result_done(&finer);
    job_result_done(&along);
    struct modal_error err;
    cJSON_Delete(job("simulate", SHAFT, "{'elements':3}", MODAL_BAD_INPUT, &err));
    CHECK_STRING(err.field, "elements");
    cJSON_Delete(job(
        "simulate",
        "{'structure':{'type':'chain','masses':[1],'springs':[1,0]},'time':{'dt':1,'duration':2}}",
        "{'elements':3}", MODAL_BAD_INPUT, &err));
    CHECK_STRING(err.field, "elements");
}
