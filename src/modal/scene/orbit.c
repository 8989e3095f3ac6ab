/*
 * orbit.c - turns and crossings of a trigonometric polynomial
 *
 * Between samples a turn is bracketed by a change of the rate's sign.  A pair of turns inside one
 * step of the samples shows no such change; where the rate's size has a minimum, a parabola through
 * three samples tells whether it may reach 0, and then its extremum is polished too.  What is still
 * missed is a wiggle narrower than a step, of height O(step^3) times the third rate.
 *
 * Roots start from the cubic that the samples beside them give and go by Newton's method (turns) or
 * Halley's (crossings), kept inside their bracket by bisection, until a step is below ROOT_STEP, or
 * CUBIC_STEP where Halley's method is at home: as they converge quadratically and cubically, the
 * root is then good to rounding.
 */
#include "modal/scene/orbit.h"
#include <fftw3.h>
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"

static const double TWO_PI = 6.283185307179586477;   /* a period of theta */
/* Steps after which a root is good to rounding, by Newton's and by Halley's order: see above. */
static const double ROOT_STEP = 1e-6;
static const double CUBIC_STEP = 2e-5;
static const double STRAIGHT = 1e-4;    /* a bend below which Halley's method is at home */
/* What the parabola's vertex may be off by, of its bend: a quarter, chosen, is all that the vertex
 * of a true parabola lies below the nearer sample (1/8) and as much again for the cubic. */
static const double BEND_SHARE = 0.25;
enum { ROOT_STEPS_MOST = 80 };          /* bisection alone takes some 53 */

struct orbit_grid {
    int N;  /* samples */
    double *x;  /* N */
    fftw_complex *X;  /* N / 2 + 1 */
    fftw_plan to_time, to_harmonics;  /* between the two; the latter NULL: synthesis alone */
    long transforms;  /* for plan.ffts */
};

/* A grid with a plan to harmonics where that is WANTED. */
static enum modal_status grid_new(int N, bool wanted, struct orbit_grid **out,
                                  struct modal_error *err)
{
    struct orbit_grid *g;

    if (N < 1 || N > ORBIT_SAMPLES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "steady.samples",
                                "%d samples; accepted: 1 to %d", N, ORBIT_SAMPLES_MOST);
    g = calloc(1, sizeof *g);
    if (g == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "orbit: no memory for a grid");
    g->N = N;
    g->x = fftw_alloc_real((size_t)N);
    g->X = fftw_alloc_complex((size_t)N / 2 + 1);
    if (g->x != NULL && g->X != NULL) {
        /* ESTIMATE: the same plan, and digits, on every run */
        g->to_time = fftw_plan_dft_c2r_1d(N, g->X, g->x, FFTW_ESTIMATE);
        if (wanted)
            g->to_harmonics = fftw_plan_dft_r2c_1d(N, g->x, g->X, FFTW_ESTIMATE);
    }
    if (g->to_time == NULL || (wanted && g->to_harmonics == NULL)) {
        orbit_grid_free(g);
        return modal_fail(err, MODAL_NO_MEMORY, "orbit: no memory for %d samples", N);
    }
    *out = g;
    return MODAL_OK;
}

enum modal_status orbit_grid_new(int N, struct orbit_grid **out, struct modal_error *err)
{
    return grid_new(N, true, out, err);
}

enum modal_status orbit_grid_to_time(int N, struct orbit_grid **out, struct modal_error *err)
{
    return grid_new(N, false, out, err);
}

void orbit_grid_free(struct orbit_grid *g)
{
    if (g == NULL)
        return;
    if (g->to_time != NULL)
        fftw_destroy_plan(g->to_time);
    if (g->to_harmonics != NULL)
        fftw_destroy_plan(g->to_harmonics);
    fftw_free(g->x);
    fftw_free(g->X);
    free(g);
}

long orbit_grid_transforms(const struct orbit_grid *g)
{
    return g->transforms;
}

void orbit_synthesize(struct orbit_grid *g, int H, const double complex *X, int derivative,
                      double *x)
{
    memset(g->X, 0, (size_t)(g->N / 2 + 1) * sizeof *g->X);
    if (derivative == 0)
        g->X[0] = creal(X[0]);
    for (int k = 1; k <= H && 2 * k < g->N; k++) {  /* past N/2 a harmonic would fold */
        double complex c = X[k] / 2;  /* one-sided (1) into FFTW's two sides */

        if (derivative >= 1)
            c *= I * k;
        if (derivative == 2)
            c *= I * k;
        g->X[k] = c;
    }
    fftw_execute(g->to_time);
    g->transforms++;
    memcpy(x, g->x, (size_t)g->N * sizeof *x);
}

double orbit_peak(struct orbit_grid *g, int H, const double complex *X, double *x)
{
    orbit_synthesize(g, H, X, 0, x);
    return numbers_largest(x, (size_t)g->N);
}

void orbit_analyze(struct orbit_grid *g, const double *x, int H, double complex *X)
{
    memcpy(g->x, x, (size_t)g->N * sizeof *x);
    fftw_execute(g->to_harmonics);
    g->transforms++;
    X[0] = creal(g->X[0]) / g->N;  /* c_0 = 1 */
    for (int k = 1; k <= H; k++)
        X[k] = 2 * k < g->N ? g->X[k] * (2.0 / g->N) : 0;  /* c_k = 2 */
}

void orbit_analyze_gain(struct orbit_grid *g, const double *x, int M, double complex *G)
{
    int N = g->N;

    memcpy(g->x, x, (size_t)N * sizeof *x);
    fftw_execute(g->to_harmonics);
    g->transforms++;
    for (int m = 0; m <= M; m++) {
        int r = m % N;  /* period N in m */

        G[m] = (2 * r <= N ? g->X[r] : conj(g->X[N - r])) / N;
    }
}

enum modal_status orbit_init(struct orbit *o, int H, int N, struct modal_error *err)
{
    memset(o, 0, sizeof *o);
    o->H = H;
    o->N = N;
    o->turns = -1;  /* of another motion */
    o->D = calloc((size_t)H + 2, sizeof *o->D);  /* D[top + 1] = 0: see orbit_at */
    o->d = calloc((size_t)N, sizeof *o->d);
    o->v = calloc((size_t)N, sizeof *o->v);
    if (o->D != NULL && o->d != NULL && o->v != NULL)
        return MODAL_OK;
    orbit_done(o);
    return modal_fail(err, MODAL_NO_MEMORY, "orbit: no memory for %d harmonics and %d samples", H,
                      N);
}

void orbit_done(struct orbit *o)
{
    free(o->D);
    free(o->d);
    free(o->v);
    free(o->turn);
    memset(o, 0, sizeof *o);
}

void orbit_sample(struct orbit *o, struct orbit_grid *g, double omega)
{
    o->omega = omega;
    o->turns = -1;
    for (o->top = o->H; o->top > 0 && o->D[o->top] == 0; o->top--)
        ;
    orbit_synthesize(g, o->H, o->D, 0, o->d);
    orbit_synthesize(g, o->H, o->D, 1, o->v);
}

void orbit_combine(struct orbit *o, double a, const struct orbit *x, double b,
                   const struct orbit *y)
{
    o->omega = x->omega;
    o->turns = -1;
    o->top = x->top > y->top ? x->top : y->top;
    for (int k = 0; k <= o->H; k++)
        o->D[k] = a * x->D[k] + b * y->D[k];
    for (int j = 0; j < o->N; j++) {
        o->d[j] = a * x->d[j] + b * y->d[j];
        o->v[j] = a * x->v[j] + b * y->v[j];
    }
}

typedef double pair __attribute__((vector_size(2 * sizeof(double))));

/* Both lanes the same. */
static pair both(double x) { return (pair) { x, x }; }

/* Horner's rule in z^2, z = e^{i theta}, for the three sums at once: even harmonics and odd ones
 * side by side, neither waiting for the other.  D[top + 1] is 0. */
void orbit_at(const struct orbit *o, double theta, double out[3])
{
    double c = cos(theta), s = sin(theta);
    /* z^2 */
    pair C = both(c * c - s * s), T = both(2 * c * s), r0 = both(0), i0 = r0, r1 = r0, i1 = r0,
         r2 = r0, i2 = r0, k = { o->top & ~1, o->top | 1 };

    for (const double complex *D = o->D + (o->top & ~1); D >= o->D; D -= 2, k -= 2) {
        pair re = { creal(D[0]), creal(D[1]) }, im = { cimag(D[0]), cimag(D[1]) }, t;

        t = r0 * C - i0 * T + re;
        i0 = r0 * T + i0 * C + im;
        r0 = t;
        re *= k;
        im *= k;
        t = r1 * C - i1 * T + re;
        i1 = r1 * T + i1 * C + im;
        r1 = t;
        t = r2 * C - i2 * T + k * re;
        i2 = r2 * T + i2 * C + k * im;
        r2 = t;
    }
    out[0] = r0[0] + (c * r0[1] - s * i0[1]);  /* even + z odd, real part: (1) */
    out[1] = -(i1[0] + (c * i1[1] + s * r1[1]));  /* i k D_k: the imaginary part, negative */
    out[2] = -(r2[0] + (c * r2[1] - s * i2[1]));  /* -k^2 D_k */
}

/* Where in (0, 1) the cubic of values Y0 < 0 < Y1 (or the other way), slopes M0 and M1, is 0: a
 * guess, by Newton's method from the secant. */
static double cubic_root(double y0, double y1, double m0, double m1)
{
    /* the secant's root */
    double c = 3 * (y1 - y0) - 2 * m0 - m1, e = m0 + m1 - 2 * (y1 - y0), s = y0 / (y0 - y1);

    for (int i = 0; i < 2; i++) {
        double slope = m0 + s * (2 * c + s * 3 * e),
               next = s - (y0 + s * (m0 + s * (c + s * e))) / slope;

        if (!(next > 0 && next < 1))  /* a guess out of the bracket is none */
            break;
        s = next;
    }
    return s;
}

/* A step of Newton's method (order 1) or Halley's (order 0) towards the root of what AT holds less
 * LEVEL; whether it is good enough to be the last: the error it leaves is of its second power, or
 * third. */
static double root_step(const double at[3], int order, double level, bool *last)
{
    double step = (level - at[order]) / at[order + 1],
           bend = order == 0 ? 0.5 * step * at[2] / at[1] : 0;

    *last = fabs(step) < (order == 0 && fabs(bend) < STRAIGHT ? CUBIC_STEP : ROOT_STEP);
    return fabs(bend) < 0.5 ? step / (1 + bend) : step;  /* far off, Newton's step alone */
}

/* The root of the order-th derivative (0 or 1) - level in [a, b], where it changes sign; starts
 * at GUESS.  *D: d there. */
static double polish(const struct orbit *o, int order, double level, double a, double b,
                     double guess, bool rising, double *d)
{
    double theta = guess > a && guess < b ? guess : 0.5 * (a + b), at[3] = { 0 }, step = 0;
    bool last = false;

    for (int i = 0; i < ROOT_STEPS_MOST && !last && b - a >= 4 * DBL_EPSILON * (1 + fabs(b)); i++) {
        double next;

        orbit_at(o, theta, at);
        step = 0;
        if (at[order] == level)
            break;
        if ((at[order] > level) == rising)  /* the bracket shrinks to this side */
            b = theta;
        else
            a = theta;
        step = root_step(at, order, level, &last);
        next = theta + step;
        if (!(next >= a && next <= b)) {
            next = 0.5 * (a + b);  /* bisection where the step leaves it */
            step = next - theta;
            last = fabs(step) < ROOT_STEP;
        }
        theta = next;
    }
    if (d != NULL)
        /* d where the last step ended, without a further sum */
        *d = at[0] + step * (at[1] + 0.5 * step * at[2]);
    return theta;
}

/* The turn in (a, b) near GUESS. */
static enum modal_status add_turn(struct orbit *o, double a, double b, double guess, bool rising,
                                  struct modal_error *err)
{
    double theta, d;

    if (o->turns == o->turns_room) {
        int room = o->turns_room > 0 ? 2 * o->turns_room : 16;
        struct orbit_turn *more = realloc(o->turn, (size_t)room * sizeof *more);

        if (more == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "orbit: no memory for %d turns", room);
        o->turn = more;
        o->turns_room = room;
    }
    theta = polish(o, 1, 0, a, b, guess, rising, &d);
    o->turn[o->turns++] = (struct orbit_turn) { theta, d };
    return MODAL_OK;
}

/* Where the rate changes sign between samples J and J + 1, by the cubic through four. */
static double turn_guess(const struct orbit *o, int j)
{
    int N = o->N;
    double p = o->v[(j + N - 1) % N], q = o->v[j], r = o->v[(j + 1) % N], s = o->v[(j + 2) % N];

    return TWO_PI / N
           * (j
              + cubic_root(q, r, (6 * r - 2 * p - 3 * q - s) / 6, (p - 6 * q + 3 * r + 2 * s) / 6));
}

/* Two turns between samples: the rate's extremum near sample J reaches past 0 (see the opening). */
static enum modal_status hidden_turns(struct orbit *o, int j, struct modal_error *err)
{
    double h = TWO_PI / o->N, p = o->v[(j + o->N - 1) % o->N], q = o->v[j],
           r = o->v[(j + 1) % o->N];
    /* vertex of the parabola through three rates */
    double bend = p - 2 * q + r, shift = bend != 0 ? 0.5 * (p - r) / bend : 0,
           theta = h * (j + shift), at[3], slope;
    enum modal_status rc;
    bool positive = q > 0;

    if (fabs(q - 0.125 * (p - r) * (p - r) / (bend != 0 ? bend : 1))
        > 0.5 * fabs(q) + BEND_SHARE * fabs(bend))
        return MODAL_OK;
    orbit_at(o, theta, at);
    slope = bend / (h * h);  /* of the rate's slope, by differences */
    /* to the rate's extremum, by chords */
    for (int i = 0; i < 4 && slope != 0 && (at[1] > 0) == positive; i++) {
        double next = theta - at[2] / slope;

        if (fabs(next - h * j) > h || fabs(next - theta) < ROOT_STEP)
            break;
        theta = next;
        orbit_at(o, theta, at);
    }
    if ((at[1] > 0) == positive || at[1] == 0)
        return MODAL_OK;
    rc = add_turn(o, h * (j - 1), theta, 0.5 * (h * (j - 1) + theta), !positive, err);
    return rc != MODAL_OK
               ? rc
               : add_turn(o, theta, h * (j + 1), 0.5 * (h * (j + 1) + theta), positive, err);
}

/* For qsort: ascending. */
static int by_theta(const void *a, const void *b)
{
    const struct orbit_turn *x = a, *y = b;

    return (x->theta > y->theta) - (x->theta < y->theta);
}

enum modal_status orbit_find_turns(struct orbit *o, struct modal_error *err)
{
    double h = TWO_PI / o->N;
    enum modal_status rc = MODAL_OK;
    bool sort = false;

    o->turns = 0;
    for (int j = 0; rc == MODAL_OK && j < o->N; j++) {
        double v0 = o->v[j], v1 = o->v[j + 1 < o->N ? j + 1 : 0],
               before = o->v[j > 0 ? j - 1 : o->N - 1];

        if ((v0 > 0) != (v1 > 0)) {
            if (v0 != v1)
                rc = add_turn(o, h * j, h * (j + 1), turn_guess(o, j), v1 > 0, err);
        } else if (fabs(v0) <= fabs(before) && fabs(v0) < fabs(v1) && (before > 0) == (v0 > 0)
                   && v0 != 0) {
            int had = o->turns;  /* found or not */

            rc = hidden_turns(o, j, err);
            sort |= o->turns != had;  /* found out of order */
        }
    }
    for (int i = 0; i < o->turns; i++)
        if (o->turn[i].theta >= TWO_PI || o->turn[i].theta < 0) {
            /* polished across the period's end */
            o->turn[i].theta -= TWO_PI * floor(o->turn[i].theta / TWO_PI);
            sort = true;
        }
    if (sort)
        qsort(o->turn, (size_t)o->turns, sizeof *o->turn, by_theta);
    return rc;
}

/* Sample j, any j: the motion repeats. */
static struct orbit_end sample_at(const struct orbit *o, long j)
{
    int i = (int)(((j % o->N) + o->N) % o->N);

    return (struct orbit_end) { TWO_PI / o->N * (double)j, o->d[i], o->v[i] };
}

double orbit_crossing(const struct orbit *o, struct orbit_end from, struct orbit_end to,
                      double level)
{
    double h = TWO_PI / o->N;
    long low = (long)ceil(from.theta / h), high = (long)floor(to.theta / h);
    bool rising = to.d > from.d;  /* monotone between its ends */

    while (low <= high) {                       /* samples inside narrow the bracket */
        long middle = (low + high) / 2;
        struct orbit_end sample = sample_at(o, middle);

        if ((sample.d > level) == rising) {
            to = sample;
            high = middle - 1;
        } else {
            from = sample;
            low = middle + 1;
        }
    }
    h = to.theta - from.theta;
    if (!(h > 0))  /* two ends in one place: a sample at the level */
        return from.theta;
    return polish(o, 0, level, from.theta, to.theta,
                  from.theta + h * cubic_root(from.d - level, to.d - level, h * from.v, h * to.v),
                  rising, NULL);
}

struct orbit_end orbit_turn_end(const struct orbit *o, int i)
{
    const struct orbit_turn *turn = &o->turn[i % o->turns];

    return (struct orbit_end) { turn->theta + TWO_PI * (i / o->turns), turn->d, 0 };
}

int orbit_crossings(const struct orbit *o, double level, double *theta, int most)
{
    int count = 0, wrapped = 0;

    for (int i = 0; i < o->turns; i++) {
        struct orbit_end from = orbit_turn_end(o, i), to = orbit_turn_end(o, i + 1);

        if ((from.d > level) == (to.d > level))
            continue;
        if (count == most)
            return -1;
        theta[count++] = orbit_crossing(o, from, to, level);
    }
    if (count > 0 && theta[count - 1] >= TWO_PI)
        wrapped = 1;
    if (wrapped) {                              /* at most one branch reaches past 2 pi */
        double last = theta[count - 1] - TWO_PI;

        /* the last becomes the first: ascending in [0, 2 pi) */
        memmove(theta + 1, theta, (size_t)(count - 1) * sizeof *theta);
        theta[0] = last;
    }
    return count;
}

double orbit_rate_crossing(const struct orbit *o, double from, double to, double level)
{
    double at[3];

    orbit_at(o, to, at);
    return polish(o, 1, level, from, to, 0.5 * (from + to), at[1] > level, NULL);
}
