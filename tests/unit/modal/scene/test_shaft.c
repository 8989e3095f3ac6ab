/* test_shaft.c - the paper's rotor against the reference's exact exponents
 * (tests/data/rotor/modes_*.csv)
 *
 * Sets S, C (bearings of 30 and 20 kN/m), Sd, Cd (with mu = 1 ms, 3 N s/m); models A0 (massless,
 * pinned), A1 (with end couplings of 10 N m/rad), FE6.  The tables print 10 digits; the bar is 1e-6
 * rad/s.
 */
/* Tests as well: bearing.c gyroscopic.c rotary_inertia.c shaft_axes.c shaft_massless.c
 * shaft_sensor.c shaft_supports.c sparse.c turning.c viscous_damping.c */
#include "check.h"
#include <complex.h>
#include <cblas.h>
#include <lapacke.h>
#include <stdlib.h>
#include "base/json.h"
#include "modal/linalg/eigen.h"
#include "modal/scene/program.h"
#include "modal/scene/scene.h"
#include "modal/scene/simulate.h"
#include "modal/scene/turning.h"

/* Matrices this small gain nothing from threads, which wait for each other on a busy machine. */
__attribute__((constructor)) static void one_thread(void)
{
    openblas_set_num_threads(1);
}

enum { STATES_MOST = 128 };

static struct program *lower(const char *text)
{
    cJSON *scene = NULL;
    struct program *p = NULL;
    struct modal_error err = { 0 };

    CHECK(json_read(text, strlen(text), &scene, &err) == MODAL_OK);
    if (scene_lower(scene, NULL, &p, &err) != MODAL_OK)
        fail_msg("%s: %s", err.field, err.message);
    cJSON_Delete(scene);
    return p;
}

static void check_refused(const char *text, const char *field)
{
    cJSON *scene = NULL;
    struct program *p = NULL;
    struct modal_error err = { 0 };

    CHECK(json_read(text, strlen(text), &scene, &err) == MODAL_OK);
    CHECK(scene_lower(scene, NULL, &p, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, field);
    CHECK(p == NULL);
    cJSON_Delete(scene);
}

/* The rotor of the reference: MODEL A0, A1 or FE6; kb in N/m. */
static void rotor(char *out, size_t room, const char *model, const char *frame, double kb,
                  bool damped, double speed, const char *more)
{
    bool massless = model[0] == 'A';
    char coupling[256] = "";

    if (strcmp(model, "A0") != 0)
        snprintf(coupling, sizeof coupling,
                 "{\"type\":\"coupling\",\"at\":\"left\",\"transverse\":1e8,\"rotational\":10},"
                 "{\"type\":\"coupling\",\"at\":\"right\",\"transverse\":1e8,\"rotational\":10},");
    else
        snprintf(coupling, sizeof coupling,
                 "{\"type\":\"coupling\",\"at\":\"left\",\"transverse\":1e8},"
                 "{\"type\":\"coupling\",\"at\":\"right\",\"transverse\":1e8},");
    snprintf(out, room,
             "{\"structure\":{\"type\":\"shaft\",\"length\":1,\"elements\":6,\"EI\":[98.9,175],"
             "\"mass_per_length\":0.00475,\"disk\":{\"position\":0.5,\"mass\":5,\"radius\":0.18},"
             "\"speed\":%.17g,\"frame\":\"%s\",\"model\":\"%s\"},\"effects\":"
             "[{\"type\":\"bearing\",\"at\":\"left\",\"transverse\":%.17g,\"damping\":%g},"
             "{\"type\":\"bearing\",\"at\":\"right\",\"transverse\":%.17g,"
             "\"damping\":%g},%s%s{\"type\":\"gyroscopic\"}]%s}",
             speed, frame, massless ? "massless" : "finite_elements", kb, damped ? 3.0 : 0.0, kb,
             damped ? 3.0 : 0.0, coupling,
             damped ? "{\"type\":\"strain_rate_damping\",\"mu\":1e-3}," : "", more);
}

static void add(const struct sparse *a, double factor, double *to, int ld, int i0, int j0)
{
    for (int i = 0; i < a->m; i++)
        for (int k = a->start[i]; k < a->start[i + 1]; k++)
            to[i0 + i + (j0 + a->index[k]) * ld] += factor * a->value[k];
}

/* All exponents of a linear constant program, from its first-order form [I; M; -Ba E] u' = [...] u.
 */
static int exponents(const struct program *p, double complex *lambda)
{
    static double L[STATES_MOST * STATES_MOST], R[STATES_MOST * STATES_MOST];
    int n = p->n, nz = p->n_linear, N = 2 * n + nz;
    lapack_int pivot[STATES_MOST];
    struct matrix state = { N, N, N, R };

    CHECK(N <= STATES_MOST && p->harmonics == 0);
    memset(L, 0, sizeof L);
    memset(R, 0, sizeof R);
    for (int i = 0; i < n; i++)
        L[i + i * N] = R[i + (n + i) * N] = 1;
    add(&p->constant[PROGRAM_M], 1, L, N, n, n);
    add(&p->Ba, -1, L, N, 2 * n, n);
    add(&p->E, 1, L, N, 2 * n, 2 * n);
    add(&p->constant[PROGRAM_K], -1, R, N, n, 0);
    add(&p->constant[PROGRAM_C], -1, R, N, n, n);
    add(&p->F, 1, R, N, n, 2 * n);
    add(&p->Bx, 1, R, N, 2 * n, 0);
    add(&p->Bv, 1, R, N, 2 * n, n);
    add(&p->A, 1, R, N, 2 * n, 2 * n);
    CHECK(LAPACKE_dgesv(LAPACK_COL_MAJOR, N, N, L, N, pivot, R, N) == 0);
    CHECK(eigen_general(&state, lambda, NULL, NULL, NULL) == MODAL_OK);
    return N;
}

static double distance(const double complex *lambda, int count, double complex to)
{
    double least = HUGE_VAL;

    for (int i = 0; i < count; i++)
        least = fmin(least, cabs(lambda[i] - to));
    return least;
}

/* Rows of MODEL in FILE against the program's exponents; counts the rows. */
static int check_table(const char *file, const char *model, double tolerance)
{
    double complex lambda[STATES_MOST];
    char line[512], set[8], of[8], text[4096];
    double speed, re, im, before = -1;
    int rows = 0, mode, count = 0, of_set = 0;
    FILE *f = fopen(file, "r");

    CHECK(f != NULL && fgets(line, sizeof line, f) != NULL);
    while (fgets(line, sizeof line, f) != NULL) {
        CHECK(sscanf(line, "%7[^,],%7[^,],%lf,%d,%lf,%lf", set, of, &speed, &mode, &re, &im) == 6);
        if (strcmp(of, model) != 0)
            continue;
        if (speed != before || set[0] != of_set) {
            rotor(text, sizeof text, model, "rotating", set[0] == 'S' ? 30e3 : 20e3, set[1] == 'd',
                  speed, "");
            struct program *p = lower(text);
            count = exponents(p, lambda);
            program_free(p);
            before = speed;
            of_set = set[0];
        }
        /* a static divergence splits the pair in two real exponents: near the edge they are
         * square-root sensitive */
        CHECK_NEAR(distance(lambda, count, re + im * I), 0, tolerance);
        rows++;
    }
    fclose(f);
    return rows;
}

TEST(the_massless_rotor_matches_A0_and_A1_undamped_and_damped)
{
    CHECK(check_table(TEST_DATA "/rotor/modes_undamped.csv", "A0", 1e-6) > 200);
    CHECK(check_table(TEST_DATA "/rotor/modes_undamped.csv", "A1", 1e-6) > 200);
    CHECK(check_table(TEST_DATA "/rotor/modes_damped.csv", "A0", 1e-6) > 200);
    CHECK(check_table(TEST_DATA "/rotor/modes_damped.csv", "A1", 1e-6) > 200);
}

TEST(six_elements_match_FE6_undamped_and_damped)
{
    CHECK(check_table(TEST_DATA "/rotor/modes_undamped.csv", "FE6", 1e-6) > 200);
    CHECK(check_table(TEST_DATA "/rotor/modes_damped.csv", "FE6", 1e-6) > 200);
}

/* TEXT with MORE put before the gyroscopic effect. */
static void insert(const char *text, const char *more, char *out, size_t room)
{
    const char *at = strstr(text, "{\"type\":\"gyroscopic\"}");

    CHECK(at != NULL);
    snprintf(out, room, "%.*s%s%s", (int)(at - text), text, more, at);
}

/* The same scene with one thing wrong; the path names it. */
TEST(every_wrong_key_is_named_by_its_path)
{
    static const struct { const char *from, *to, *field;
    } wrong[] = {
        { "\"at\":\"left\"", "\"at\":\"middle\"", "effects[0].at" },
        { "\"at\":\"left\",\"transverse\"", "\"transverse\"", "effects[0].at" },
        { "\"at\":\"right\"", "\"at\":\"left\"", "effects[1]" },
        { "\"position\":0.5", "\"position\":0.4", "structure.disk.position" },
        { "\"mass\":5", "\"mass\":-5", "structure.disk.mass" },
        { "\"EI\":[98.9,175]", "\"EI\":[98.9]", "structure.EI" },
        { "\"EI\":[98.9,175]", "\"EI\":[98.9,-175]", "structure.EI[1]" },
        { "\"frame\":\"rotating\"", "\"frame\":\"turning\"", "structure.frame" },
        { "\"speed\":24", "\"speed\":-24", "structure.speed" },
        { "\"elements\":6", "\"elements\":0", "structure.elements" },
        { "\"type\":\"gyroscopic\"", "\"type\":\"gyroscopic\",\"polar\":1", "effects[4].polar" },
        { "{\"type\":\"gyroscopic\"}",
          "{\"type\":\"clearance\",\"at\":\"right\",\"gap\":1e-3,\"stiffness\":1e7}",
          "effects[4].at" },
        { "{\"type\":\"gyroscopic\"}",
          "{\"type\":\"clearance\",\"at\":\"right\",\"gap\":-1e-3,\"stiffness\":1e7}",
          "effects[4].gap" },
        { "{\"type\":\"gyroscopic\"}", "{\"type\":\"rotary_inertia\"}", "effects[4].I_rho" },
        { "{\"type\":\"gyroscopic\"}", "{\"type\":\"axial_load\",\"mean\":1}", "effects[4].type" },
    };
    char text[4096], changed[4096];

    rotor(text, sizeof text, "FE6", "rotating", 2e4, false, 24, "");
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        const char *at = strstr(text, wrong[i].from);

        CHECK(at != NULL);
        snprintf(changed, sizeof changed, "%.*s%s%s", (int)(at - text), text, wrong[i].to,
                 at + strlen(wrong[i].from));
        check_refused(changed, wrong[i].field);
    }
    rotor(text, sizeof text, "FE6", "fixed", 2e4, false, 24, ",\"omega\":25");
    check_refused(text, "omega");
    rotor(text, sizeof text, "A0", "fixed", 2e4, true, 24, "");
    insert(text, "{\"type\":\"spring\",\"dof\":\"y3\",\"stiffness\":1},", changed, sizeof changed);
    check_refused(changed, "effects[5]");
}

static void check_same_matrices(const struct program *a, const struct program *b)
{
    static double got[64 * 64], expected[64 * 64];

    CHECK(a->n == b->n && a->n <= 64);
    for (int q = 0; q < 3; q++) {
        double scale = 0;

        memset(got, 0, sizeof got);
        memset(expected, 0, sizeof expected);
        add(&a->constant[q], 1, got, a->n, 0, 0);
        add(&b->constant[q], 1, expected, a->n, 0, 0);
        for (int i = 0; i < a->n * a->n; i++)
            scale = fmax(scale, fabs(expected[i]));
        for (int i = 0; i < a->n * a->n; i++)
            CHECK_NEAR(got[i], expected[i], 1e-14 * scale);
    }
}

/* On fixed axes the rotor is periodic; seen from turning ones it is the program written on turning
 * axes, whatever damps it. */
TEST(fixed_axes_seen_from_turning_ones_are_the_constant_program)
{
    static const struct { const char *model, *more; bool damped;
    } cases[] = {
        { "A0", "", false },
        { "A1", "", false },
        { "FE6", "", true },
        { "FE6", "{\"type\":\"rotary_inertia\",\"I_rho\":1.01e-5},", true },
        { "FE6",
          "{\"type\":\"viscous_damping\",\"per_length\":0.013},{\"type\":\"rayleigh_damping\","
          "\"alpha\":0.7,\"beta\":1e-4},",
          false },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[4096], whole[4096];
        struct program *fixed, *rotating, *turned = NULL;

        rotor(text, sizeof text, cases[i].model, "fixed", 2e4, cases[i].damped, 24, "");
        insert(text, cases[i].more, whole, sizeof whole);
        fixed = lower(whole);
        CHECK(program_class(fixed) == PROGRAM_LINEAR_PERIODIC && fixed->harmonic[0].k == 2);
        CHECK(program_turned(fixed, &turned, NULL) == MODAL_OK && turned != NULL);
        CHECK(program_class(turned) == PROGRAM_LINEAR_CONSTANT);
        rotor(text, sizeof text, cases[i].model, "rotating", 2e4, cases[i].damped, 24, "");
        insert(text, cases[i].more, whole, sizeof whole);
        rotating = lower(whole);
        check_same_matrices(turned, rotating);
        program_turned_free(turned);
        program_free(rotating);
        program_free(fixed);
    }
}

/* Samples of MODEL damped, told on FRAME's axes to move alike: x' on fixed axes is q' + W J q at t
 * = 0. */
static double *damped_motion(const char *model, const char *frame, double x0, double z0, double vx,
                             double vz, struct scene_time *t)
{
    char more[512], text[4096];
    struct modal_error err;
    struct simulate_result s;
    cJSON *scene = NULL;

    snprintf(more, sizeof more,
             ",\"initial\":{\"x\":{\"y3\":%.17g,\"z3\":%.17g},\"v\":{\"y3\":%.17g,\"z3\":%.17g}},"
             "\"excitation\":[{\"dof\":\"z3\",\"type\":\"half_sine\",\"amplitude\":10,"
             "\"duration\":0.05,\"frame\":\"fixed\"}],\"sensors\":[{\"dof\":\"y3\"},"
             "{\"dof\":\"z3\"},{\"dof\":\"y0\"},{\"dof\":\"z0\"}],\"time\":{\"dt\":0.004,"
             "\"duration\":0.4}",
             x0, z0, vx, vz);
    rotor(text, sizeof text, model, frame, 2e4, true, 24, more);
    CHECK(json_read(text, strlen(text), &scene, &err) == MODAL_OK);
    struct program *p = lower(text);
    CHECK(scene_time(scene, p, t, &err) == MODAL_OK);
    double *x = malloc((size_t)t->samples * 4 * sizeof *x);
    CHECK(simulate(p, t, NULL, x, &s, &err) == MODAL_OK);
    cJSON_Delete(scene);
    program_free(p);
    return x;
}

/* y + i z on fixed axes is e^{i W t} (y + i z) on turning ones, at the disk and at the damped end,
 * which has no mass. */
TEST(damped_ends_of_a_massless_shaft_are_seen_from_fixed_axes)
{
    static const char *const models[] = { "A0", "A1" };
    double W = 24;

    for (int i = 0; i < 2; i++) {
        struct scene_time t;
        double *fixed = damped_motion(models[i], "fixed", 1.3e-4, -2.1e-4, 0.013, 0.021, &t);
        double *turning = damped_motion(models[i], "rotating", 1.3e-4, -2.1e-4, 0.013 + W * -2.1e-4,
                                        0.021 - W * 1.3e-4, &t);

        CHECK(t.samples == 101);
        for (long k = 0; k < 2 * t.samples; k++) {
            double complex seen = CMPLX(fixed[2 * k], fixed[2 * k + 1]),
                           q = CMPLX(turning[2 * k], turning[2 * k + 1]);
            CHECK_NEAR(cabs(seen - q * cexp(I * W * 0.004 * (double)(k / 2))), 0, 1e-12 * 3e-3);
        }
        free(fixed);
        free(turning);
    }
}

/* A spring along the fixed y axis alone is a support that is not isotropic: the rotor stays
 * periodic. */
TEST(a_support_that_is_not_isotropic_does_not_turn)
{
    char text[4096], changed[4096];
    struct program *p, *turned = NULL;

    rotor(text, sizeof text, "FE6", "fixed", 2e4, false, 24, "");
    insert(text, "{\"type\":\"spring\",\"dof\":\"y0\",\"stiffness\":7},", changed, sizeof changed);
    p = lower(changed);
    CHECK(program_turned(p, &turned, NULL) == MODAL_OK && turned == NULL);
    program_free(p);
}

/* y' of a nonlinear program of few dofs, for the classical Runge-Kutta method. */
struct motion { const struct program *p; double inverse[16], C[16], K[16]; };

static void rates(const struct motion *m, double t, const double *y, double *dy)
{
    const struct law *law = m->p->law;
    double d[2], v[2], W = m->p->frame_speed, f[4], load = t < 0.05 ? 10 * sin(20 * M_PI * t) : 0;
    struct law_force out = { .memory = NULL };

    for (int i = 0; i < 2; i++) {
        d[i] = y[law->end[i].dof];
        v[i] = y[4 + law->end[i].dof];
    }
    CHECK(law->kind->force(law, &(struct law_point) { .t = t, .d = d, .v = v }, &out, NULL) ==
          MODAL_OK);
    for (int i = 0; i < 4; i++) {
        f[i] = 0;
        for (int j = 0; j < 4; j++)
            f[i] -= m->K[i + 4 * j] * y[j] + m->C[i + 4 * j] * y[4 + j];
    }
    f[law->end[0].dof] -= out.f[0];
    f[law->end[1].dof] -= out.f[1];
    f[program_dof(m->p, "z3")] += load * cos(W * t);
    f[program_dof(m->p, "y3")] += load * sin(W * t);
    for (int i = 0; i < 4; i++) {
        dy[i] = y[4 + i];
        dy[4 + i] = 0;
        for (int j = 0; j < 4; j++)
            dy[4 + i] += m->inverse[i + 4 * j] * f[j];
    }
}

static void step(const struct motion *m, double t, double h, double *y)
{
    double k[4][8], at[8];
    static const double c[4] = { 0, 0.5, 0.5, 1 };

    for (int s = 0; s < 4; s++) {
        for (int i = 0; i < 8; i++)
            at[i] = y[i] + (s > 0 ? c[s] * h * k[s - 1][i] : 0);
        rates(m, t + c[s] * h, at, k[s]);
    }
    for (int i = 0; i < 8; i++)
        y[i] += h / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
}

/* The journal without mass, over ten turns, disk in fixed axes; the reference (same method and
 * step) tells its own step error: 2e-7 m of 2.5 mm.  A change of 1e-7 in the load grows to 2e-5:
 * the bar is 1e-3 of the peak. */
static void check_clearance(double speed, const char *file)
{
    static const char scene[] =
        "{\"structure\":{\"type\":\"shaft\",\"length\":1,\"elements\":6,\"EI\":[98.9,175],"
        "\"disk\":{\"position\":0.5,\"mass\":5,\"radius\":0.18},\"speed\":%g,"
        "\"model\":\"massless\"},\"effects\":[{\"type\":\"bearing\",\"at\":\"left\","
        "\"transverse\":2e4},{\"type\":\"coupling\",\"at\":\"left\",\"transverse\":1e8,"
        "\"rotational\":10},{\"type\":\"gyroscopic\"},{\"type\":\"clearance\",\"at\":\"right\","
        "\"gap\":0.8e-3,\"stiffness\":15e6,\"dissipation\":1e-3}]}";
    struct motion m = { 0 };
    char text[1024], line[512];
    double y[8] = { 0 }, t, u2, u3, worst = 0, peak = 0, h = 2 * M_PI / speed / 2048, now = 0;
    double M[16] = { 0 };
    lapack_int pivot[4];
    FILE *f = fopen(file, "r");

    snprintf(text, sizeof text, scene, speed);
    struct program *p = lower(text);
    CHECK(p->n == 4 && p->laws == 1 && program_states(p) == 8);
    m.p = p;
    add(&p->constant[PROGRAM_M], 1, M, 4, 0, 0);
    add(&p->constant[PROGRAM_C], 1, m.C, 4, 0, 0);
    add(&p->constant[PROGRAM_K], 1, m.K, 4, 0, 0);
    for (int i = 0; i < 4; i++)
        m.inverse[5 * i] = 1;
    CHECK(LAPACKE_dgesv(LAPACK_COL_MAJOR, 4, 4, M, 4, pivot, m.inverse, 4) == 0);
    CHECK(f != NULL && fgets(line, sizeof line, f) != NULL);
    while (fgets(line, sizeof line, f) != NULL) {
        CHECK(sscanf(line, "%lf,%lf,%lf", &t, &u2, &u3) == 3);
        for (; now < t - h / 2; now += h)
            step(&m, now, h, y);
        double a = y[program_dof(p, "y3")], b = y[program_dof(p, "z3")], c = cos(speed * t),
               s = sin(speed * t);
        worst = fmax(worst, hypot(c * a - s * b - u2, s * a + c * b - u3));
        peak = fmax(peak, hypot(u2, u3));
    }
    fclose(f);
    CHECK(peak > 1e-3);
    CHECK_NEAR(worst, 0, 1e-3 * peak);
    program_free(p);
}

TEST(a_massless_journal_in_its_clearance_follows_the_reference)
{
    check_clearance(24, TEST_DATA "/rotor/clearance_traj_C_24.csv");
    check_clearance(45, TEST_DATA "/rotor/clearance_traj_C_45.csv");
}

/* Each effect that the rotor does not list leaves the same program, numbers and all, when its
 * module is not in the table. */
TEST(an_effect_not_listed_leaves_no_trace)
{
    static const char *const models[] = { "A0", "FE6" };
    char text[4096];
    int left_out = 0;

    for (int m = 0; m < 2; m++) {
        cJSON *scene = NULL;

        rotor(text, sizeof text, models[m], "rotating", 2e4, true, 24, "");
        CHECK(json_read(text, strlen(text), &scene, NULL) == MODAL_OK);
        for (int out = 0; scene_effects[out] != NULL; out++) {
            const struct scene_effect_kind *table[64];
            struct scene_options options = { .effects = table };
            struct program *with = NULL, *without = NULL;
            struct modal_error err = { 0 };
            int n = 0;

            for (int i = 0; scene_effects[i] != NULL && n < 63; i++)
                if (i != out)
                    table[n++] = scene_effects[i];
            table[n] = NULL;
            if (scene_lower(scene, &options, &without, &err) != MODAL_OK) {
                CHECK(strstr(err.field, ".type") != NULL);       /* the rotor lists it */
                continue;
            }
            CHECK(scene_lower(scene, NULL, &with, NULL) == MODAL_OK);
            CHECK_STRING(without->hash, with->hash);
            program_free(with);
            program_free(without);
            left_out++;
        }
        cJSON_Delete(scene);
    }
    CHECK(left_out >= 2 * 18);
}
