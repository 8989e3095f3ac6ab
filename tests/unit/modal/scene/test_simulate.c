#include "check.h"
#include <complex.h>
#include <float.h>
#include "modal/scene/floquet.h"
#include "modal/scene/simulate.h"
#include "scene_text.h"

/* The signals of TEXT, sample by sample; the caller frees. */
static double *run(const char *text, struct scene_time *t, struct simulate_result *s)
{
    struct modal_error err;
    struct program *p = program_text(text);
    cJSON *scene = scene_text(text);
    double *x;

    if (scene_time(scene, p, t, &err) != MODAL_OK)
        fail_msg("%s: %s", text, err.message);
    x = malloc((size_t)t->samples * (size_t)p->outputs * sizeof *x);
    if (simulate(p, t, NULL, x, s, &err) != MODAL_OK)
        fail_msg("%s: %s", text, err.message);
    program_free(p);
    cJSON_Delete(scene);
    return x;
}

/* The unit oscillator of mass 1, stiffness w^2 = 9, damping 2 zeta w = 0.3. */
#define ONE "'structure':{'type':'chain','masses':[1],'springs':[9,0],'dampers':[0.3,0]}"
static const double sigma = 0.15;
#define WD sqrt(9 - sigma * sigma)

static double impulse_response(double t) { return t > 0 ? exp(-sigma * t) * sin(WD * t) / WD : 0; }

TEST(free_vibration_is_the_closed_form_at_every_sample)
{
    struct scene_time t;
    struct simulate_result s;
    double *x =
        run("{" ONE ",'initial':{'x':{'x1':0.7},'v':{'x1':-1.1}},'time':{'dt':0.37,'duration':74},"
            "'sensors':[{'dof':'x1'},{'dof':'x1','derivative':1},{'dof':'x1','derivative':2}]}",
            &t, &s);

    CHECK(t.samples == 201 && s.maps == 1 && s.products == 200);
    CHECK_STRING(s.integrator, "modal-exponential");
    for (int k = 0; k < 201; k++) {
        double at = 0.37 * k, b = (-1.1 + sigma * 0.7) / WD, e = exp(-sigma * at), c = cos(WD * at),
               d = sin(WD * at);
        double q = e * (0.7 * c + b * d), v = -sigma * q + e * WD * (b * c - 0.7 * d);
        CHECK_NEAR(x[3 * k], q, 1e-14);
        CHECK_NEAR(x[3 * k + 1], v, 5e-14);
        CHECK_NEAR(x[3 * k + 2], -9 * q - 0.3 * v, 5e-13);
    }
    free(x);
}

/* Released in the first mode of 300 unit masses and springs, w = 2 sin(pi / 602), damped by beta K:
 * that mode alone, in 2 x 2 blocks although the products with 300 modes round 300 times. */
TEST(a_long_chain_with_proportional_damping_steps_by_modes)
{
    enum { N = 300 };
    char *text = malloc(40 * N + 500), *at = text;
    struct scene_time t;
    struct simulate_result s;
    double w = 2 * sin(M_PI / (2 * N + 2)), beta = 3, decay = beta * w * w / 2,
           wd = sqrt(w * w - decay * decay);

    at += sprintf(at, "{'structure':{'type':'chain','masses':[1");
    for (int i = 1; i < N; i++)
        at += sprintf(at, ",1");
    at += sprintf(at, "],'springs':[1");
    for (int i = 0; i < N; i++)
        at += sprintf(at, ",1");
    at += sprintf(at,
                  "]},'effects':[{'type':'rayleigh_damping','beta':%g}],'sensors':"
                  "[{'dof':'x100'}],'time':{'dt':7,'duration':700},'initial':{'x':{",
                  beta);
    for (int i = 1; i <= N; i++)
        at += sprintf(at, "%s'x%d':%.17g", i > 1 ? "," : "", i, sin(M_PI * i / (N + 1)));
    sprintf(at, "}}}");
    double *x = run(text, &t, &s), shape = sin(M_PI * 100 / (N + 1));
    CHECK_STRING(s.integrator, "modal-exponential");
    for (int k = 0; k <= 100; k++)
        CHECK_NEAR(x[k],
                   shape * exp(-decay * 7 * k) * (cos(wd * 7 * k) + decay / wd * sin(wd * 7 * k)),
                   1e-10);
    free(x);
    free(text);
}

TEST(an_impulse_between_samples_is_hit_exactly)
{
    struct scene_time t;
    struct simulate_result s;
    double *x = run("{" ONE ",'excitation':[{'dof':'x1','type':'impulse','amplitude':2.5,'start':0."
                            "123}],'time':{'dt':0.1,'duration':5}}",
                    &t, &s);

    for (int k = 0; k < 51; k++)
        CHECK_NEAR(x[k], 2.5 * impulse_response(0.1 * k - 0.123), 1e-14);
    free(x);
}

/* Simpson's rule of Duhamel's integral over 2000 panels: error (h w)^4 / 2880 of the force, below
 * 1e-11 here. */
static double duhamel(double (*p)(double), double end, double t)
{
    enum { n = 2000 };
    double upper = t < end ? t : end, h = upper / n, sum = 0;

    if (upper <= 0)
        return 0;
    for (int i = 0; i <= n; i++)
        sum += (i == 0 || i == n ? 1
                : i % 2          ? 4
                                 : 2) *
               p(i * h) * impulse_response(t - i * h + 1e-300);
    return sum * h / 3;
}

static double half_sine(double t) { return 10 * sin(M_PI * t / 0.55); }
static double one_minus(double t) { return 10 * (1 - cos(2 * M_PI * t / 0.55)); }
static double step(double t) { (void)t; return 10; }
static double ramp(double t) { return 4 + 8 * t; }

TEST(pulses_whose_ends_lie_between_samples_follow_duhamel_s_integral)
{
    static const struct { const char *load; double (*p)(double); double end; } cases[] = {
        { "'type':'half_sine','amplitude':10,'duration':0.55", half_sine, 0.55 },
        { "'type':'one_minus_cosine','amplitude':10,'duration':0.55", one_minus, 0.55 },
        { "'type':'step','amplitude':10,'duration':0.55", step, 0.55 },
        { "'type':'table','points':[[0,2],[0.25,3],[0.55,4.2]],'amplitude':2", ramp, 0.55 } };
    char text[512];

    for (int i = 0; i < 4; i++) {
        struct scene_time t;
        struct simulate_result s;
        snprintf(text, sizeof text,
                 "{" ONE ",'excitation':[{'dof':'x1',%s}],'time':{'dt':0.2,'duration':4}}",
                 cases[i].load);
        double *x = run(text, &t, &s);
        for (int k = 0; k <= 20; k++)
            CHECK_NEAR(x[k], duhamel(cases[i].p, cases[i].end, 0.2 * k), 2e-10);
        free(x);
    }
}

/* x = Re X e^(i k w t), X = p / (9 - (k w)^2 + 0.3 i k w), from the state on it. */
TEST(a_harmonic_excitation_keeps_its_steady_state)
{
    struct scene_time t;
    struct simulate_result s;
    /* a cos + b sin = Re (a - ib) e */
    double w = 2 * 1.3, re = 9 - w * w, im = 0.3 * w, d = re * re + im * im, a = 1.5, b = -0.8;
    double c = (a * re - b * im) / d, e = (b * re + a * im) / d;   /* x = c cos + e sin */
    char text[512];

    snprintf(text, sizeof text,
             "{" ONE ",'omega':1.3,'excitation':[{'dof':'x1','k':2,'cos':1.5,'sin':-0.8}],'initial'"
                     ":{'x':{'x1':%.17g},'v':{'x1':%.17g}},'time':{'dt':0.05,'duration':500}}",
             c, w * e);
    double *x = run(text, &t, &s);
    for (int k = 0; k <= 10000; k += 7)
        CHECK_NEAR(x[k], c * cos(w * 0.05 * k) + e * sin(w * 0.05 * k), 1e-12);
    free(x);
}

/*
 * [Z1, Z; Z, Z2] (X1, X2) = (p, 0), Z1 = 9 - w^2 + 0.3 i w, Z2 = 4e12 - w^2 + 2e3 i w, Z = 0.5 i w.
 * The free motion, of decay 0.15, is gone after 300 s; one step of that length, 2^30 of the stiff
 * dof's own time, would leave 3e-8 of it.
 */
TEST(a_record_that_starts_late_is_as_exact_beside_a_stiff_dof)
{
    struct scene_time t;
    struct simulate_result s;
    double w = 1.3;
    double complex Z1 = CMPLX(9 - w * w, 0.3 * w), Z2 = CMPLX(4e12 - w * w, 2e3 * w),
                   Z = CMPLX(0, 0.5 * w), X1 = Z2 * 1.5 / (Z1 * Z2 - Z * Z);
    double *x = run("{'structure':{'type':'matrices','M':[[1,0],[0,1]],'K':[[9,0],[0,4e12]],'C':"
                    "[[0.3,0.5],[0.5,2e3]]},'omega':1.3,'excitation':[{'dof':'x1','cos':1.5}],"
                    "'time':{'dt':0.05,'duration':10,'start':300},'sensors':[{'dof':'x1'}]}",
                    &t, &s);

    for (int k = 0; k <= 200; k++)
        CHECK_NEAR(x[k], creal(X1 * cexp(I * w * (300 + 0.05 * k))), 1e-10 * cabs(X1));
    free(x);
}

/* Undamped, two masses: energy after 10^5 steps of about a tenth of a period. */
TEST(energy_is_kept_over_a_hundred_thousand_steps)
{
    static const char *const texts[] = {
        "{'structure':{'type':'chain','masses':[1.5,2.5],'springs':[3,4,5]},'initial':{'x':"
        "{'x1':1},'v':{'x2':0.7}},'time':{'dt':0.3,'duration':30000},'sensors':[{'dof':'x1'},"
        "{'dof':'x2'},{'dof':'x1','derivative':1},{'dof':'x2','derivative':1}]}",
        "{'structure':{'type':'matrices','M':[[1.5,0],[0,2.5]],'K':[[7,-4],[-4,9]],'G':[[0,1],"
        "[-1,0]],'speed':2},'initial':{'x':{'x1':1},'v':{'x2':0.7}},'time':{'dt':0.3,"
        "'duration':30000},'sensors':[{'dof':'x1'},{'dof':'x2'},{'dof':'x1','derivative':1},"
        "{'dof':'x2','derivative':1}]}"
    };

    for (int i = 0; i < 2; i++) {
        struct scene_time t;
        struct simulate_result s;
        double *x = run(texts[i], &t, &s), e0 = 0, worst = 0;
        for (long k = 0; k < t.samples; k++) {
            const double *y = x + 4 * k;
            double e = (7 * y[0] * y[0] - 8 * y[0] * y[1] + 9 * y[1] * y[1] + 1.5 * y[2] * y[2] +
                        2.5 * y[3] * y[3]) /
                       2;
            e0 = k == 0 ? e : e0;
            worst = fmax(worst, fabs(e / e0 - 1));
        }
        CHECK(t.samples == 100001 && s.products == 100000);
        CHECK_NEAR(worst, 0, 1e-9);
        free(x);
    }
}

/* After n periods a state is Phi^n times itself: with rho_1 + rho_2 = tr Phi and rho_1 rho_2 = det
 * Phi, any motion of a single mass obeys x_(k+2) - tr x_(k+1) + det x_k = 0 at the same phase of
 * each period (Cayley and Hamilton). */
TEST(a_periodic_scene_repeats_its_multipliers_at_every_phase)
{
    const char *text = "{'structure':{'type':'matrices','M':[[1]],'K':[[1]],'C':[[0.02]]},"
                       "'omega':1.9,'initial':{'x':{'x1':1}},'effects':"
                       "[{'type':'parametric_stiffness','dof':'x1','stiffness':-0.4}],'time':"
                       "{'dt':0.3306939635357677,'periods':6}}";
    struct scene_time t;
    struct simulate_result s;
    struct floquet f;
    struct program *p = program_text(text);
    double *x = run(text, &t, &s);             /* dt = T / 10 */

    CHECK(floquet(p, NULL, &f, NULL) == MODAL_OK);
    double trace = creal(f.multiplier[0] + f.multiplier[1]),
           det = creal(f.multiplier[0] * f.multiplier[1]);
    CHECK(t.samples == 61 && s.maps == 10 && s.products == 60);
    CHECK_STRING(s.integrator, "magnus-maps");
    for (int k = 0; k + 20 < 61; k++)
        CHECK_NEAR(x[k + 20] - trace * x[k + 10] + det * x[k], 0, 1e-12);
    floquet_done(&f);
    program_free(p);
    free(x);
}

TEST(a_step_that_does_not_divide_the_period_gives_the_same_motion)
{
#define PULSED \
    "{'structure':{'type':'matrices','M':[[1,0],[0,2]],'K':[[3,-1],[-1,4]],'C':[[0.02,0],[0,0.01]" \
    "]},'omega':2,'initial':{'x':{'x1':1}}," \
    "'effects':[{'type':'parametric_stiffness','dof':'x2','stiffness':1,'phase':0.4}],'" \
    "excitation':[{'dof':'x1','type':'half_sine','amplitude':3,'duration':0.777}]"
    struct scene_time t, u;
    struct simulate_result s;
    /* T / 100 */
    double *x =
        run(PULSED ",'time':{'dt':0.031415926535897934,'duration':12.566370614359172}}", &t, &s);
    double *y = run(PULSED ",'time':{'dt':1.5707963267948966,'start':6.2831853071795862,"
                           "'duration':6.283185307179586}}",
                    &u, &s);

    CHECK(t.samples == 401 && u.samples == 5);
    for (int k = 0; k < 5; k++) {
        CHECK_NEAR(y[2 * k], x[2 * (200 + 50 * k)], 1e-11);
        CHECK_NEAR(y[2 * k + 1], x[2 * (200 + 50 * k) + 1], 1e-11);
    }
    double *z = run(PULSED ",'time':{'dt':0.1,'duration':12.5}}", &t, &s);   /* T / dt irrational */
    double *w = run(PULSED ",'time':{'dt':12.5,'duration':12.5}}", &u, &s);
    CHECK_NEAR(z[2 * 125], w[2], 1e-11);
    free(w);
    free(x);
    free(y);
    free(z);
}

TEST(growth_past_the_range_of_doubles_says_when)
{
    const char *text = "{'structure':{'type':'chain','masses':[1],'springs':[-100,0]},'initial':"
                       "{'x':{'x1':1}},'time':{'dt':0.5,'duration':1000}}";
    struct program *p = program_text(text);
    cJSON *scene = scene_text(text);
    struct scene_time t;
    struct simulate_result s;
    struct modal_error err;
    double *x, from, to;

    CHECK(scene_time(scene, p, &t, &err) == MODAL_OK);
    x = malloc((size_t)t.samples * sizeof *x);
    CHECK(simulate(p, &t, NULL, x, &s, &err) == MODAL_OVERFLOW);
    CHECK(sscanf(strstr(err.message, "t ="), "t = %lf and %lf", &from, &to) == 2);
    CHECK(from < 69.2 && to > 68.8);                        /* e^(10 t) / 2 = 1e300 at t = 69.1 */
    free(x);
    program_free(p);
    cJSON_Delete(scene);
}

/* The force of 1 N on 5e-315 kg: the state is there, its acceleration is not. */
TEST(an_output_past_the_range_of_doubles_is_refused_by_its_name)
{
    const char *text = "{'structure':{'type':'matrices','M':[[1,0],[0,5e-315]],'K':[[0,0],[0,0]]},"
                       "'omega':1,'effects':[{'type':'gap','dof':'x1','stiffness':0,"
                       "'clearance':0.1}],'excitation':[{'dof':'x2','k':5,'cos':1}],"
                       "'time':{'dt':0.1,'duration':0.3}}";
    struct program *p = program_text(text);
    cJSON *scene = scene_text(text);
    struct scene_time t;
    struct simulate_result s;
    struct modal_error err = { 0 };
    double *x;

    CHECK(scene_time(scene, p, &t, &err) == MODAL_OK);
    x = calloc((size_t)t.samples * (size_t)p->outputs + 1, sizeof *x);
    CHECK(simulate(p, &t, NULL, x, &s, &err) == MODAL_OVERFLOW);
    CHECK(strstr(err.message, "leaves the range of doubles") != NULL);
    free(x);
    program_free(p);
    cJSON_Delete(scene);
}

static bool always(void *context)
{
    (void)context;
    return true;
}

TEST(a_cancelled_simulation_stops)
{
    const char *text = "{" ONE ",'time':{'dt':0.1,'duration':1000}}";
    struct program *p = program_text(text);
    cJSON *scene = scene_text(text);
    struct scene_time t;
    struct simulate_result s = { .maps = -3 };
    struct simulate_options o = { .cancelled = always };
    double x[10001];

    CHECK(scene_time(scene, p, &t, NULL) == MODAL_OK);
    CHECK(simulate(p, &t, &o, x, &s, NULL) == MODAL_CANCELLED && s.maps == -3);
    program_free(p);
    cJSON_Delete(scene);
}

/* One body slips at the start, one is held, one breaks away: -limit, 0, and (limit - k x) / m. */
TEST(the_first_accelerations_have_the_force_of_rigid_sliders)
{
    const char *text = "{'structure':{'type':'matrices','M':[[1,0,0],[0,2,0],[0,0,2]],"
                       "'K':[[1,0,0],[0,1,0],[0,0,1]],'dofs':['a','b','c']},"
                       "'effects':[{'type':'coulomb','dof':'a','limit':0.8},"
                       "{'type':'coulomb','dof':'b','limit':0.8},"
                       "{'type':'coulomb','dof':'c','limit':0.3}],"
                       "'initial':{'x':{'b':0.5,'c':0.5},'v':{'a':1}},"
                       "'sensors':[{'dof':'a','derivative':2},{'dof':'b','derivative':2},"
                       "{'dof':'c','derivative':2}],'time':{'dt':0.01,'duration':0.02}}";
    struct scene_time t;
    struct simulate_result s;
    double *x = run(text, &t, &s);

    CHECK_NEAR(x[0], -0.8, 1e-14);
    CHECK_NEAR(x[1], 0, 1e-14);
    CHECK_NEAR(x[2], -0.1, 1e-14);
    free(x);
}

/* Coulomb's slider is let go at 0.23915 s, where its rate is rounding of either sign, sticks at
 * 1.572 s and is let go again at 1.626 s.  The expected motion is DOP853's at 1e-13, in pieces
 * between the switches as its dense output has them. */
TEST(a_slider_let_go_at_rest_slips_on)
{
    const char *text = "{'structure':{'type':'matrices','M':[[1,0.1],[0.1,1]],'K':[[3,-1],[0,4]],"
                       "'C':[[0.2,0],[0,0.2]],'G':[[0,1],[-1,0]],'speed':2,'dofs':['a','b']},"
                       "'effects':[{'type':'coulomb','dof':'b','limit':2.2}],'initial':{'x':"
                       "{'a':2}},'time':{'dt':0.1,'duration':2}}";
    struct scene_time t;
    struct simulate_result s;
    double *x = run(text, &t, &s);

    CHECK_NEAR(x[5 * 2], 1.32498719, 1e-7);
    CHECK_NEAR(x[5 * 2 + 1], -0.02951361, 1e-7);
    CHECK_NEAR(x[10 * 2], 0.03481544, 1e-7);
    CHECK_NEAR(x[20 * 2 + 1], -0.95591148, 1e-7);
    free(x);
}
