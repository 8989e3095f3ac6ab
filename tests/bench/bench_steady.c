/* bench_steady.c - steady states: milliseconds of processor time a point, and against Runge-Kutta
 * at equal true error */
#include <complex.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "base/json.h"
#include "modal/scene/scene.h"
#include "modal/steady/solve.h"

enum { ROUNDS = 5 };

static double cpu(void)
{
    struct timespec t;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static void line(const char *name, double value, const char *unit, const char *peer, double ratio,
                 int n)
{
    printf("{\"bench\":\"steady\",\"case\":\"%s\",\"value\":%.6g,\"unit\":\"%s\",\"peer\":\"%s\","
           "\"ratio\":%.4g,\"n\":%d}\n",
           name, value, unit, peer, ratio, n);
    fflush(stdout);
}

static void fail(const char *what)
{
    fprintf(stderr, "bench_steady: %s\n", what);
    exit(1);
}

static struct program *lower(const char *text)
{
    struct modal_error err = { 0 };
    struct program *p = NULL;
    cJSON *scene = NULL;

    if (json_read(text, strlen(text), &scene, &err) != MODAL_OK ||
        scene_lower(scene, NULL, &p, &err) != MODAL_OK)
        fail(err.message);
    cJSON_Delete(scene);
    return p;
}

/* Median ms a point of a path of POINTS frequencies, every point converged; the peer's ms for the
 * ratio. */
static double path(const char *name, const char *scene, int H, int N, double from, double to,
                   int points, const char *peer, double peer_ms)
{
    struct program *p = lower(scene);
    struct steady_options opt = { .harmonics = H, .samples = N, .estimate_later = true };
    struct modal_error err = { 0 };
    double ms[ROUNDS];

    for (int round = 0; round < ROUNDS; round++) {
        struct steady *s;
        struct steady_point last = { 0 };
        double spent = 0;

        if (steady_new(p, &opt, &s, &err) != MODAL_OK || steady_reduce(s, points, &err) != MODAL_OK)
            fail(err.message);
        for (int i = 0; i < points; i++) {
            struct steady_start start = { last.q, last.H, last.X };
            struct steady_point point;
            double t = cpu();

            if (steady_solve(s, from + (to - from) * i / (points - 1),
                             last.X != NULL ? &start : NULL, &point, &err) != MODAL_OK ||
                !point.converged)
                fail(name);
            spent += cpu() - t;
            steady_point_done(&last);
            last = point;
        }
        ms[round] = 1e3 * spent / points;
        steady_point_done(&last);
        steady_free(s);
    }
    program_free(p);
    qsort(ms, ROUNDS, sizeof *ms, by_value);
    line(name, ms[ROUNDS / 2], "ms/point", peer, peer_ms / ms[ROUNDS / 2], points);
    return ms[ROUNDS / 2];
}

static void chain_scene(char *text, size_t room, int n)
{
    size_t at = (size_t)snprintf(text, room, "{\"structure\":{\"type\":\"chain\",\"masses\":[");

    for (int i = 0; i < n; i++)
        at += (size_t)snprintf(text + at, room - at, "%s1", i ? "," : "");
    at += (size_t)snprintf(text + at, room - at, "],\"springs\":[");
    for (int i = 0; i <= n; i++)
        at += (size_t)snprintf(text + at, room - at, "%s1", i ? "," : "");
    snprintf(text + at, room - at,
             "]},\"omega\":0.3,\"effects\":[{\"type\":\"rayleigh_damping\",\"alpha\":0.02,"
             "\"beta\":0.01},{\"type\":\"friction\",\"dof\":\"x%d\",\"stiffness\":0.5,"
             "\"limit\":0.3}],\"excitation\":[{\"dof\":\"x%d\",\"k\":1,\"cos\":1}]}",
             n / 2, n / 4 + 1);
}

static void cantilever_scene(char *text, size_t room, int dofs)
{
    snprintf(text, room,
             "{\"structure\":{\"type\":\"beam\",\"length\":1,\"elements\":%d,\"EI\":1,"
             "\"mass_per_length\":1,\"supports\":[\"clamped\",\"free\"]},\"omega\":3.4,"
             "\"effects\":[{\"type\":\"rayleigh_damping\",\"alpha\":0.02,\"beta\":0.0005},"
             "{\"type\":\"friction\",\"dof\":\"w%d\",\"stiffness\":5,\"limit\":0.5}],"
             "\"excitation\":[{\"dof\":\"w%d\",\"k\":1,\"cos\":0.3}]}",
             dofs / 2, dofs / 2, dofs / 2);
}

/* The friction damper of Cameron and Griffin (1989), marched by classical Runge-Kutta with y kept
 * as their (8) says. */
struct state { double x, v, y; };

static double load(double t) { return 0.75 * sin(0.5 * t) + 0.5 * sin(0.75 * t) + 0.375 * sin(t); }

static struct state rate(double t, struct state s)
{
    bool slips = (s.y >= 1 && s.v > 0) || (s.y <= -1 && s.v < 0);

    return (struct state) { s.v, load(t) - 0.02 * s.v - 0.75 * s.x - 0.25 * s.y, slips ? 0 : s.v };
}

static struct state step(double t, double h, struct state s)
{
    struct state a = rate(t, s), b, c, d, m;

    m = (struct state) { s.x + h / 2 * a.x, s.v + h / 2 * a.v,
                        fmin(1, fmax(-1, s.y + h / 2 * a.y)) };
    b = rate(t + h / 2, m);
    m = (struct state) { s.x + h / 2 * b.x, s.v + h / 2 * b.v,
                        fmin(1, fmax(-1, s.y + h / 2 * b.y)) };
    c = rate(t + h / 2, m);
    m = (struct state) { s.x + h * c.x, s.v + h * c.v, fmin(1, fmax(-1, s.y + h * c.y)) };
    d = rate(t + h, m);
    s.x += h / 6 * (a.x + 2 * b.x + 2 * c.x + d.x);
    s.v += h / 6 * (a.v + 2 * b.v + 2 * c.v + d.v);
    s.y = fmin(1, fmax(-1, s.y + h / 6 * (a.y + 2 * b.y + 2 * c.y + d.y)));
    return s;
}

enum { CHECKS = 64 };

/* Periods until the largest error at the checks is below TARGET, from rest; 0: never in 60. */
static int march(int N, const double exact[CHECKS], double target, double *error)
{
    const double T = 8 * M_PI, h = T / N;
    struct state s = { 0, 0, 0 };

    for (int period = 1; period <= 60; period++) {
        double worst = 0;

        for (int n = 0; n < N; n++) {
            if (n % (N / CHECKS) == 0)
                worst = fmax(worst, fabs(s.x - exact[n / (N / CHECKS)]));
            s = step(h * n, h, s);
        }
        *error = worst;
        if (worst <= target)
            return period;
    }
    return 0;
}

static void waveform(const double complex *X, int H, double *x)
{
    for (int j = 0; j < CHECKS; j++) {
        x[j] = creal(X[0]);
        for (int k = 1; k <= H; k++)
            x[j] += creal(X[k] * cexp(2 * M_PI * I * k * j / CHECKS));
    }
}

enum { SOLVES = 10 };

/* Seconds of a solution from rest, one of SOLVES; the session is made before, as once for a scene.
 */
static double solve_damper(const struct program *p, int H, double tolerance, double x[CHECKS])
{
    struct steady_options opt = { .harmonics = H, .tolerance = tolerance, .estimate_later = true };
    struct modal_error err = { 0 };
    double t = 0;
    struct steady *s;
    struct steady_point point;

    if (steady_new(p, &opt, &s, &err) != MODAL_OK)
        fail(err.message);
    for (int i = 0; i <= SOLVES; i++) {   /* the first plans its transforms */
        if (i == 1)
            t = cpu();
        if (steady_solve(s, 0.25, NULL, &point, &err) != MODAL_OK || !point.converged)
            fail("the friction damper was not solved");
        if (i == SOLVES) {
            t = (cpu() - t) / SOLVES;
            waveform(point.X, H, x);
        }
        steady_point_done(&point);
    }
    steady_free(s);
    return t;
}

static double distance(const double *x, const double *y)
{
    double worst = 0;

    for (int j = 0; j < CHECKS; j++)
        worst = fmax(worst, fabs(x[j] - y[j]));
    return worst;
}

/* The cheapest order and tolerance whose true error is below TARGET; seconds. */
static double best_order(const struct program *p, double target, const double *exact, int *H,
                         double *tolerance)
{
    static const int orders[] = { 12, 14, 16, 18, 20, 22, 24, 28,  32, 40,
                                  48, 56, 64, 72, 80, 88, 96, 112, 128 };
    static const double loose[] = { 1, 0.3, 0.1, 0.03, 0.01 };
    double least = HUGE_VAL, x[CHECKS];

    for (size_t i = 0; i < sizeof orders / sizeof *orders; i++)
        for (size_t j = 0; j < sizeof loose / sizeof *loose; j++) {
            double t = solve_damper(p, orders[i], loose[j] * target, x);

            if (distance(x, exact) > target || t >= least)
                continue;
            least = t;
            *H = orders[i];
            *tolerance = loose[j] * target;
        }
    return least;
}

/* The step that marches to TARGET with the fewest steps in all; the periods it takes, or 0. */
static int best_step(double target, const double *exact, int *N)
{
    int best = 0;
    double error;

    for (int n = CHECKS; n <= 1 << 16 && (best == 0 || n < 2 * *N); n += CHECKS) {
        int periods = march(n, exact, target, &error);

        if (periods > 0 && (best == 0 || n * periods < *N * best)) {
            best = periods;
            *N = n;
        }
    }
    return best;
}

static void against_marching(double target)
{
    struct program *p = lower("{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.02]],"
                              "\"K\":[[0.75]]},\"omega\":0.25,\"effects\":[{\"type\":\"friction\","
                              "\"dof\":\"x1\",\"stiffness\":0.25,\"limit\":0.25}],\"excitation\":"
                              "[{\"dof\":\"x1\",\"k\":2,\"sin\":0.75},{\"dof\":\"x1\",\"k\":3,"
                              "\"sin\":0.5},{\"dof\":\"x1\",\"k\":4,\"sin\":0.375}]}");
    double exact[CHECKS], x[CHECKS], error, tolerance = 0, aft[9], rk[9];
    int H = 0, N = 0, periods;
    char name[80];

    solve_damper(p, 512, 1e-12, exact);
    periods = best_step(target, exact, &N);
    if (best_order(p, target, exact, &H, &tolerance) == HUGE_VAL || periods == 0)
        fail("no setting reached the error asked for");
    for (int i = 0; i < 9; i++) {   /* side by side, so that a busy machine slows both */
        double t = cpu();

        march(N, exact, target, &error);
        rk[i] = cpu() - t;
        aft[i] = solve_damper(p, H, tolerance, x);
    }
    qsort(aft, 9, sizeof *aft, by_value);
    qsort(rk, 9, sizeof *rk, by_value);
    snprintf(name, sizeof name, "friction damper to %g: H=%d, RK4 N=%d x %d", target, H, N,
             periods);
    line(name, 1e3 * aft[4], "ms", "rk4 marched", rk[4] / aft[4], 9);
    program_free(p);
}

int main(void)
{
    static char text[200000];
    double small;

    path("sdof jenkins H=7 N=256",
         "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.02]],\"K\":[[1]]},"
         "\"omega\":1,\"effects\":[{\"type\":\"friction\",\"dof\":\"x1\",\"stiffness\":1,"
         "\"limit\":1}],\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":1}]}",
         7, 256, 1.1, 1.6, 101, "goal 0.08 ms", 0.08);
    path("duffing H=7 N=29",
         "{\"structure\":{\"type\":\"matrices\",\"M\":[[1]],\"C\":[[0.05]],\"K\":[[1]]},"
         "\"omega\":1,\"effects\":[{\"type\":\"cubic_spring\",\"dof\":\"x1\","
         "\"coefficient\":0.1}],\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":0.18}]}",
         7, 29, 0.5, 1.1, 101, "goal 0.08 ms", 0.08);
    cantilever_scene(text, sizeof text, 10);
    path("cantilever 10 dofs H=5 N=128", text, 5, 128, 3.4, 5, 101, "goal 0.2 ms", 0.2);
    cantilever_scene(text, sizeof text, 40);
    path("cantilever 40 dofs H=5 N=128", text, 5, 128, 3.4, 5, 101, "goal 0.2 ms", 0.2);
    chain_scene(text, sizeof text, 10);
    small = path("chain 10 dofs, one slider, H=7", text, 7, 256, 0.3, 0.5, 51, "itself", 1);
    chain_scene(text, sizeof text, 2000);
    path("chain 2000 dofs, one slider, H=7", text, 7, 256, 0.3, 0.5, 51, "chain 10 dofs", small);
    against_marching(1e-3);
    against_marching(1e-5);
    return 0;
}
