/*
 * large_stability.c - see large_stability.h
 *
 * Disturbances are carried by the period map of period_map.h: the laws' slopes are its functions,
 * constant between events where a law has pieces, and otherwise the Fourier series of their
 * samples, which are doubled until the series ends.  Asked is (leading.h):
 *
 * - The multipliers of largest modulus, by Arnoldi's method.  Settled ones decide, each told from
 *   1 by its residual times its condition; one outside decides though others are not settled.
 * - The same by windows of Hill's matrix (hill_leading.h), where steps are too many, as a stiff
 *   structure asks for, and all slopes have series: then the motion's disturbances are those of a
 *   periodic program (linearised.h).  Harmonics that move no multiplier by more than DROPPED of
 *   itself are left out, and that is added to the residuals.
 * - Where they are too many of one modulus to be told apart, as with damping by mass, whether all
 *   disturbances decay: a bound below 1 of every multiplier.
 */
#include "modal/steady/large_stability.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"
#include "modal/scene/hill_leading.h"
#include "modal/scene/leading.h"
#include "modal/scene/orbit.h"
#include "modal/scene/period_map.h"
#include "modal/scene/pieces.h"
#include "modal/scene/program.h"
#include "modal/steady/budget.h"
#include "modal/steady/disturbance.h"
#include "modal/steady/linearised.h"
#include "modal/steady/point.h"
#include "modal/steady/session.h"
#include "modal/steady/stability.h"

static const double TOLERANCE = 1e-11;   /* of residuals: they fall fast once they do */
static const double SERIES_END = 1e-14;  /* of the largest harmonic: less is rounding of samples */
static const double COEFFICIENT_END = 1e-17;     /* of the largest: less is no part of a sum */
static const double DROPPED = 1e-9;      /* of a multiplier: a tenth of STABILITY_ON_CIRCLE */
enum {
    WANTED = 10,                 /* multipliers: chosen, as floquet's */
    IN_WINDOWS = 4,              /* wanted of windows, each of which costs: chosen */
    WINDOW = 4,                  /* of their harmonics to begin with, for the highest of slopes: */
                                 /* chosen */
    IN_VAIN = 3,                 /* points' work that windows may spend without a verdict: chosen */
    FIRST = 200,                 /* periods before the bound is asked for: chosen */
    SERIES = 100,                /* operations of a harmonic's coefficients over a step, */
    PIECE = 10,                  /* of whether a piece holds there, */
    AGAIN = 1,                   /* and of a number that is as before */
    SAMPLES_LEAST = 64,          /* of a slope */
    SAMPLES_MOST = 4096,         /* jumps that a sampled law makes are as fine as that */
};

enum slope_kind { BY_PLACE, BY_RATE, OF_SLIDER };

/* One slope of a law, as a function of time. */
struct law_slope {
    int law, out, in;            /* f_out; d_in, or the law's slider */
    enum slope_kind kind;
    int top;                     /* of the series; law without pieces */
    double complex *harmonic;
    bool constant;               /* between the ends of its law's pieces: VALUE, of FROM <= theta <
                                  * UNTIL, once it is known there */
    double value, from, until;
    double work;                 /* operations of its coefficients over a step, where not known */
};

struct large {
    struct disturbance *u;
    struct period_parts parts;
    struct law_slope *slope;     /* parts.functions of them */
    struct law_end *held;        /* of each slider: the number it holds */
    struct workspace space;
};

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "stability: no memory");
}

/* What Re C e^{ik omega h s}, k omega h = TURN, adds to the coefficients of a step. */
static void add_wave(double complex C, double turn, int most, double *out)
{
    const double derivative[] = { creal(C), -cimag(C), -creal(C), cimag(C) };  /* of i^m C */
    double factor = 1;                                       /* turn^m / m!, which rises first */

    for (int m = 0; m < most && (factor > COEFFICIENT_END || m <= turn); m++) {
        out[m] += factor * derivative[m % 4];
        factor *= turn / (m + 1);
    }
}

/* What D(theta) = Re sum X_k e^{ik theta} adds to the coefficients of a step, SCALE times; where
 * OMEGA is not 0, what its rate does. */
static void add_series(const double complex *X, int top, double scale, double omega, double theta,
                       double turn, int most, double *out)
{
    for (int k = 0; k <= top; k++) {
        double complex rate = omega != 0 ? CMPLX(0, k * omega) : 1;

        if (X[k] != 0)
            add_wave(scale * rate * X[k] * cexp(CMPLX(0, k * theta)), k * turn, most, out);
    }
}

/* Of a law with pieces: those that hold in the middle of the step. */
static void pieces_taylor(const struct disturbance *u, const struct law_slope *f, double theta,
                          double turn, int most, double *out)
{
    const struct law_pieces *pieces = &u->pieces[f->law];
    const struct orbit *o = &u->in[f->law * LAW_INPUTS_MOST];

    for (int i = 0; i < pieces->count; i++) {
        const struct law_piece *p = &pieces->piece[i];
        if (!disturbance_covers(p, disturbance_wrap(theta + turn / 2)))
            continue;
        if (f->kind == OF_SLIDER) {
            if (p->holds && p->slider == f->in)
                out[0] += p->gain[u->p->law[f->law].kind->inputs - 1];
        } else if (p->output == f->out) {
            out[0] += f->kind == BY_PLACE ? p->gain[f->in] : f->in == 0 ? p->damp : 0;
            if (p->cross != 0 && f->in == 0)           /* of cross d v: by d, v; by v, d */
                add_series(o->D, o->top, p->cross, f->kind == BY_PLACE ? u->point->omega : 0, theta,
                           turn, most, out);
        }
    }
}

/* Whether a slope of F follows the motion within pieces. */
static bool varies(const struct disturbance *u, const struct law_slope *f)
{
    const struct law_pieces *pieces = &u->pieces[f->law];

    for (int i = 0; f->kind != OF_SLIDER && f->in == 0 && i < pieces->count; i++)
        if (pieces->piece[i].cross != 0 && pieces->piece[i].output == f->out)
            return true;
    return false;
}

/* Operations that the coefficients of F over a step take, nearly. */
static double taylor_work(const struct disturbance *u, const struct law_slope *f)
{
    if (f->harmonic != NULL)
        return SERIES * (f->top + 1.0);
    return u->pieces[f->law].count * PIECE
         + (f->constant ? 0 : SERIES * (u->in[f->law * LAW_INPUTS_MOST].top + 1.0));
}

/* The same in the mean of all steps: what is constant is asked for anew at most at each end of its
 * law's pieces. */
static double mean_work(const struct disturbance *u, const struct law_slope *f)
{
    double ends = 2.0 * u->pieces[f->law].count + 1;

    return f->constant ? AGAIN + f->work * fmin(ends / u->cuts, 1) : f->work;
}

/* F's value at THETA, where it is constant, and between which ends of pieces it holds: events of
 * other laws, of which there may be thousands, change nothing of it. */
static void take_value(const struct disturbance *u, struct law_slope *f, double theta)
{
    const struct law_pieces *pieces = &u->pieces[f->law];

    f->value = 0;
    pieces_taylor(u, f, theta, 0, 1, &f->value);
    f->from = 0;
    f->until = 2 * M_PI;
    for (int i = 0; i < 2 * pieces->count; i++) {
        const struct law_piece *p = &pieces->piece[i / 2];
        double end = disturbance_wrap(i % 2 == 0 ? p->from : p->to);
        if (end <= theta)
            f->from = fmax(f->from, end);
        else
            f->until = fmin(f->until, end);
    }
    budget_add(u->budget, f->work);
}

/* period_parts.taylor */
static int taylor(void *context, int function, double t, double h, int most, double *out)
{
    struct large *l = context;
    struct law_slope *f = &l->slope[function];
    double theta = t * l->u->point->omega, turn = h * l->u->point->omega, largest;
    int count = 1;

    if (f->constant) {
        double middle = disturbance_wrap(theta + turn / 2);
        if (middle < f->from || middle >= f->until)
            take_value(l->u, f, middle);
        out[0] = f->value;
        return 1;
    }
    memset(out, 0, (size_t)most * sizeof *out);
    if (f->harmonic != NULL)
        add_series(f->harmonic, f->top, 1, 0, theta, turn, most, out);
    else
        pieces_taylor(l->u, f, theta, turn, most, out);
    budget_add(l->u->budget, f->work);
    largest = numbers_largest(out, (size_t)most);
    for (int m = 1; m < most; m++)
        count = fabs(out[m]) > COEFFICIENT_END * largest ? m + 1 : count;
    return count;
}

/* A slope with its channel: from input IN, or the slider IN of the law, to output OUT. */
static void add_slope(struct large *l, struct law_slope slope)
{
    const struct law *law = &l->u->p->law[slope.law];
    struct period_channel *c = &l->parts.channel[l->parts.channels++];
    int out = slope.out, in = slope.in;

    *c = (struct period_channel){ .out = law->end + law->start[out],
                                  .outs = law->start[out + 1] - law->start[out],
                                  .rate = slope.kind == BY_RATE,
                                  .function = l->parts.functions };
    if (slope.kind == OF_SLIDER) {
        c->in = &l->held[l->u->first_slider[slope.law] + in];
        c->ins = 1;
    } else {
        c->in = law->end + law->start[in];
        c->ins = law->start[in + 1] - law->start[in];
    }
    slope.constant = slope.harmonic == NULL && !varies(l->u, &slope);
    slope.work = taylor_work(l->u, &slope);
    /* of a vector's share: so many are carried */
    l->parts.step_work += mean_work(l->u, &slope) / FIRST;
    l->slope[l->parts.functions++] = slope;
}

/* Which slopes law L with pieces has; those that are 0 all along are none. */
static void pieces_slopes(struct large *l, int number)
{
    const struct law_pieces *pieces = &l->u->pieces[number];
    const struct law *law = &l->u->p->law[number];
    int inputs = law->kind->inputs;
    bool has[2][LAW_PIECE_INPUTS][LAW_PIECE_INPUTS] = { 0 };

    for (int i = 0; i < pieces->count; i++) {
        const struct law_piece *p = &pieces->piece[i];
        for (int j = 0; j < inputs; j++)
            has[BY_PLACE][p->output][j] |= p->gain[j] != 0 || (j == 0 && p->cross != 0);
        has[BY_RATE][p->output][0] |= p->damp != 0 || p->cross != 0;
    }
    for (enum slope_kind kind = BY_PLACE; kind <= BY_RATE; kind++)
        for (int o = 0; o < inputs; o++)
            for (int j = 0; j < inputs; j++)
                if (has[kind][o][j])
                    add_slope(l, (struct law_slope){ .law = number, .out = o, .in = j,
                                                     .kind = kind });
    for (int e = 0; e < law->memory; e++)        /* the last input is what its sliders resist */
        add_slope(l, (struct law_slope){ .law = number, .out = inputs - 1, .in = e,
                                         .kind = OF_SLIDER });
}

/* Slope I of a law without pieces: by place, then by rate, outputs first. */
static struct law_slope slope_of(int number, int i, int inputs)
{
    return (struct law_slope){ .law = number, .out = i / inputs % inputs, .in = i % inputs,
                               .kind = i < inputs * inputs ? BY_PLACE : BY_RATE };
}

/* N samples of each slope of law NUMBER, one after another. */
static enum modal_status sample_slopes(const struct disturbance *u, int number, int N, double *x,
                                       struct modal_error *err)
{
    int inputs = u->p->law[number].kind->inputs, count = 2 * inputs * inputs;
    double held[LAW_TERMS_MOST], g[2][LAW_INPUTS_MOST][LAW_INPUTS_MOST];
    enum modal_status rc = MODAL_OK;

    for (int j = 0; rc == MODAL_OK && j < N; j++) {
        rc = disturbance_slopes(u, number, 2 * M_PI * j / N, g[0], g[1], held, err);
        for (int i = 0; rc == MODAL_OK && i < count; i++) {
            struct law_slope f = slope_of(number, i, inputs);
            x[(size_t)i * (size_t)N + (size_t)j] = g[f.kind][f.out][f.in];
        }
    }
    return rc;
}

/* The last of X's harmonics 0 .. COUNT - 1 that is above rounding; -1: all are 0. */
static int last_of(const double complex *X, int count)
{
    double largest = numbers_modulus(X, (size_t)count);
    int top = -1;

    for (int k = 0; k < count; k++)
        top = cabs(X[k]) > SERIES_END * largest ? k : top;
    return top;
}

/* The series of all slopes of a law without pieces: samples doubled until each ends. */
static enum modal_status sampled_slopes(struct large *l, int number, struct modal_error *err)
{
    int inputs = l->u->p->law[number].kind->inputs, count = 2 * inputs * inputs;
    enum modal_status rc = MODAL_OK;

    for (int N = SAMPLES_LEAST, done = 0; rc == MODAL_OK && !done; N *= 2) {
        struct workspace scratch = { 0 };
        struct orbit_grid *g = NULL;
        size_t size = (size_t)N;
        double *x = workspace_zeros(&scratch, (size_t)count * size, sizeof *x);
        double complex *X = workspace_zeros(&scratch, size / 2, sizeof *X);

        rc = scratch.failed ? no_memory(err) : orbit_grid_new(N, &g, err);
        if (rc == MODAL_OK)
            rc = sample_slopes(l->u, number, N, x, err);
        done = 1;
        for (int i = 0; rc == MODAL_OK && i < count && N < SAMPLES_MOST; i++) {
            orbit_analyze(g, x + (size_t)i * size, N / 2 - 1, X);
            done &= last_of(X, N / 2) < N / 4;
        }
        for (int i = 0; rc == MODAL_OK && i < count && done; i++) {
            struct law_slope f = slope_of(number, i, inputs);
            orbit_analyze(g, x + (size_t)i * size, N / 2 - 1, X);
            f.top = last_of(X, N / 2);
            f.harmonic = workspace_zeros(&l->space, (size_t)(f.top + 1), sizeof *X);
            if (f.harmonic == NULL) {
                rc = no_memory(err);
                break;
            }
            memcpy(f.harmonic, X, (size_t)(f.top + 1) * sizeof *X);
            if (f.top >= 0)
                add_slope(l, f);
        }
        orbit_grid_free(g);
        workspace_free(&scratch);
    }
    return rc;
}

/* The first cut at THETA: cuts ascend. */
static int cut_at(const struct disturbance *u, double theta)
{
    int low = 0, high = u->cuts;

    while (low < high) {
        int middle = (low + high) / 2;
        if (u->cut[middle] < theta)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* qsort: ascending by cut, then as they were made: `held` of one law ascend. */
static int by_cut(const void *a, const void *b)
{
    const struct period_reset *x = a, *y = b;

    return x->cut != y->cut ? x->cut - y->cut : x->held - y->held;
}

/* Where sliders come to rest or leave it; END has room for what they see. */
static void add_resets(struct large *l, struct law_end *end)
{
    const struct disturbance *u = l->u;

    for (int number = 0; number < u->p->laws; number++)
        for (int i = 0; u->exact[number] && i < u->pieces[number].count; i++) {
            const struct law_piece *piece = &u->pieces[number].piece[i];
            const struct law *law = &u->p->law[number];
            struct period_reset *r = &l->parts.reset[l->parts.resets];
            int inputs = law->kind->inputs;
            double gain = piece->gain[inputs - 1];

            if (piece->slider < 0 || (piece->holds && !piece->starts))
                continue;
            l->parts.resets++;
            *r = (struct period_reset){ .cut = cut_at(u, disturbance_wrap(piece->from)),
                                        .held = u->first_slider[number] + piece->slider };
            r->end = end;
            for (int j = 0; piece->holds && j < inputs; j++)
                for (int e = law->start[j]; e < law->start[j + 1]; e++, r->count++)
                    *end++ = (struct law_end){ law->end[e].dof,
                                               piece->ref[j] / gain * law->end[e].weight };
        }
    qsort(l->parts.reset, (size_t)l->parts.resets, sizeof *l->parts.reset, by_cut);
}

/* The largest that a slope becomes. */
static double slope_most(const struct large *l, const struct law_slope *f)
{
    const struct law_pieces *pieces = &l->u->pieces[f->law];
    double most = 0;

    for (int k = 0; f->harmonic != NULL && k <= f->top; k++)
        most += cabs(f->harmonic[k]);
    for (int i = 0; f->harmonic == NULL && i < pieces->count; i++) {
        const struct law_piece *p = &pieces->piece[i];
        if (f->kind != OF_SLIDER && p->output == f->out)
            most = fmax(most, fabs(f->kind == BY_PLACE ? p->gain[f->in] : p->damp));
    }
    return most;
}

/* rad/s that the laws add to the fastest motion: their stiffness and damping over the masses they
 * act on, and the series' own. */
static enum modal_status set_fastest(struct large *l, struct modal_error *err)
{
    const struct sparse *M = &l->u->p->constant[PROGRAM_M];
    size_t n = (size_t)l->u->n;
    double *sum[2], top = 0, stiff = 0, damped = 0;

    for (int i = 0; i < 2; i++)
        sum[i] = workspace_zeros(&l->space, n, sizeof **sum);
    if (l->space.failed)
        return no_memory(err);
    for (int c = 0; c < l->parts.channels; c++) {
        const struct period_channel *at = &l->parts.channel[c];
        double seen = 0, most = slope_most(l, &l->slope[at->function]);
        for (int e = 0; e < at->ins; e++)
            seen += fabs(at->in[e].weight);
        for (int e = 0; e < at->outs; e++)
            sum[at->rate][at->out[e].dof] += fabs(at->out[e].weight) * seen * most;
    }
    for (int f = 0; f < l->parts.functions; f++)
        top = fmax(top, l->slope[f].top);
    for (int i = 0; i < l->u->n; i++)
        for (int k = M->start[i]; k < M->start[i + 1]; k++)
            if (M->index[k] == i && M->value[k] > 0) {
                stiff = fmax(stiff, sum[0][i] / M->value[k]);
                damped = fmax(damped, sum[1][i] / M->value[k]);
            }
    l->parts.fastest = sqrt(stiff) + damped + top * l->u->point->omega;
    return MODAL_OK;
}

/* The laws as parts of a period map. */
static enum modal_status take_laws(struct large *l, struct modal_error *err)
{
    struct disturbance *u = l->u;
    size_t slopes = 0, resets = 0, ends = 0;
    struct law_end *end;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < u->p->laws; i++) {
        const struct law *law = &u->p->law[i];
        slopes += 2 * (size_t)(law->kind->inputs * law->kind->inputs)
                + (u->exact[i] ? (size_t)law->memory : 0);
        resets += (size_t)u->pieces[i].count;
        ends += (size_t)u->pieces[i].count * (size_t)law_ends(law);
    }
    l->slope = workspace_zeros(&l->space, slopes, sizeof *l->slope);
    l->parts.channel = workspace_zeros(&l->space, slopes, sizeof *l->parts.channel);
    l->held = workspace_zeros(&l->space, (size_t)u->sliders, sizeof *l->held);
    end = workspace_zeros(&l->space, ends, sizeof *end);
    l->parts.reset = workspace_zeros(&l->space, resets, sizeof *l->parts.reset);
    l->parts.cut = workspace_zeros(&l->space, (size_t)u->cuts, sizeof *l->parts.cut);
    if (l->space.failed)
        return no_memory(err);
    for (int i = 0; i < u->sliders; i++)
        l->held[i] = (struct law_end){ u->n + i, 1 };
    for (int i = 0; rc == MODAL_OK && i < u->p->laws; i++)
        if (u->exact[i])
            pieces_slopes(l, i);
        else
            rc = sampled_slopes(l, i, err);
    if (rc != MODAL_OK)
        return rc;
    l->parts.held = u->sliders;
    l->parts.cuts = u->cuts;
    for (int c = 0; c < u->cuts; c++)
        l->parts.cut[c] = u->cut[c] / u->point->omega;
    add_resets(l, end);
    l->parts.taylor = taylor;
    l->parts.context = l;
    return set_fastest(l, err);
}

/* By the multipliers found: UNKNOWN where they are not settled and none is outside. */
static void judge_found(const struct arnoldi *a, struct stability *out)
{
    bool outside = false, inside = true;

    out->error = 0;
    for (int i = 0; i < a->count; i++) {
        double bar = a->condition[i] * fmax(a->residual[i], DBL_EPSILON),
               margin = fmax(STABILITY_ON_CIRCLE, bar);
        outside |= cabs(a->w[i]) > 1 + margin;
        inside &= cabs(a->w[i]) < 1 - margin;
        out->error = fmax(out->error, bar);
    }
    out->largest = cabs(a->w[0]);
    out->verdict = outside       ? STABILITY_UNSTABLE
                   : !a->settled ? STABILITY_UNKNOWN
                   : inside      ? STABILITY_STABLE
                                 : STABILITY_UNDECIDED;
}

/* The multipliers found into OUT. */
static enum modal_status take_found(const struct arnoldi *a, struct stability *out,
                                    struct modal_error *err)
{
    free(out->multiplier);
    out->multiplier = calloc((size_t)a->count + 1, sizeof *out->multiplier);
    if (out->multiplier == NULL)
        return no_memory(err);
    memcpy(out->multiplier, a->w, (size_t)a->count * sizeof *a->w);
    out->count = a->count;
    judge_found(a, out);
    return MODAL_OK;
}

/* Leading multipliers by at most PERIODS of one vector, and what they say. */
static enum modal_status ask_leading(struct large *l, struct period_map *map, int periods,
                                     struct stability *out, struct modal_error *err)
{
    struct leading found = { 0 };
    enum modal_status rc = leading_multipliers(map, WANTED, TOLERANCE, periods, &found, err);

    budget_add(l->u->budget, found.periods * period_map_work(map));
    if (rc == MODAL_OK)
        rc = take_found(&found.found, out, err);
    leading_done(&found);
    return rc;
}

/* Periods of one vector that the budget still has. */
static int periods_left(const struct large *l, const struct period_map *map)
{
    double left = (l->u->budget->most - l->u->budget->spent) / period_map_work(map);

    return left < 0 ? 0 : left > ARNOLDI_MOST ? ARNOLDI_MOST : (int)left;
}

/* Whether all disturbances decay, by half of the way from the largest found to 1, if the half of
 * what is left may show it. */
static enum modal_status ask_bound(struct large *l, struct period_map *map, struct stability *out,
                                   struct modal_error *err)
{
    int left = periods_left(l, map) / 2, periods = 0;
    double bound = HUGE_VAL, enough = (1 + out->largest) / 2;
    enum modal_status rc = MODAL_OK;

    if (out->largest < 1 && leading_bound_periods(map, out->largest, enough) <= left)
        rc = leading_bound(map, enough, left, &bound, &periods, err);
    budget_add(l->u->budget, periods * period_map_work(map));
    if (rc == MODAL_OK && bound < 1 - STABILITY_ON_CIRCLE) {
        out->verdict = STABILITY_STABLE;
        out->error = bound - out->largest;
    }
    return rc;
}

static enum modal_status ask(struct large *l, struct period_map *map, struct stability *out,
                             struct modal_error *err)
{
    int left = periods_left(l, map);
    enum modal_status rc;

    if (left < FIRST) {
        l->u->reason = "carrying disturbances over the period takes more work than is allowed";
        return MODAL_OK;
    }
    rc = ask_leading(l, map, FIRST, out, err);
    if (rc == MODAL_OK && out->verdict == STABILITY_UNKNOWN)
        rc = ask_bound(l, map, out, err);
    left = periods_left(l, map);
    if (rc == MODAL_OK && out->verdict == STABILITY_UNKNOWN && left > FIRST)
        rc = ask_leading(l, map, left, out, err);
    if (rc == MODAL_OK && out->verdict == STABILITY_UNKNOWN)
        l->u->reason = "the work allowed was spent before the leading multipliers were settled, or "
                       "all of them known to be below 1";
    return rc;
}

/* What D cos(k omega t), D = 1, in channel AT moves a multiplier by, over its size and
 * its condition, at most: over a period, to first order, in hill_window.c's norm of roots of
 * energies. */
static double moves_by(const struct large *l, const struct period_channel *at)
{
    const struct sparse *M = &l->u->p->constant[PROGRAM_M];
    double sum[2] = { 0 }, turn = 2 * M_PI / l->u->point->omega;

    for (int side = 0; side < 2; side++)
        for (int e = 0; e < (side == 0 ? at->ins : at->outs); e++) {
            const struct law_end *end = side == 0 ? &at->in[e] : &at->out[e];
            for (int k = M->start[end->dof]; k < M->start[end->dof + 1]; k++)
                if (M->index[k] == end->dof)
                    sum[side] += end->weight * end->weight / M->value[k];
        }
    return sqrt(sum[0] * sum[1]) * turn / (at->rate ? 1 : l->u->point->omega);
}

/* Channel C as a slope without the harmonics that move multipliers by less than its part of
 * DROPPED. */
static enum modal_status take_slope(struct large *l, int c, struct linearised_slope *out,
                                    struct modal_error *err)
{
    const struct period_channel *at = &l->parts.channel[c];
    const struct law_slope *f = &l->slope[at->function];
    double least = DROPPED / l->parts.channels / (f->top + 1) / moves_by(l, at);
    double complex *kept = workspace_zeros(&l->space, (size_t)f->top + 1, sizeof *kept);

    if (kept == NULL)
        return no_memory(err);
    *out = (struct linearised_slope){ at, 0, kept };
    for (int k = 0; k <= f->top; k++) {
        kept[k] = k == 0 || cabs(f->harmonic[k]) > least ? f->harmonic[k] : 0;
        out->top = kept[k] != 0 ? k : out->top;
    }
    return MODAL_OK;
}

/* Leading multipliers of P by windows of Hill's matrix, and what they say. */
static enum modal_status ask_windows(struct large *l, const struct program *p,
                                     struct stability *out, struct modal_error *err)
{
    struct hill_ask ask = { .wanted = IN_WINDOWS, .harmonics = WINDOW, .all_sums = true,
                            .uncounted = true,
                            .most = l->u->budget->most - l->u->budget->spent };
    struct hill_leading h = { 0 };
    enum modal_status rc = hill_leading(p, 2 * M_PI / l->u->point->omega, &ask, &h, err);

    budget_add(l->u->budget, h.work);
    for (int i = 0; rc == MODAL_OK && i < h.count; i++)
        h.residual[i] += h.rounding[i] + DROPPED * cabs(h.multiplier[i]);
    if (rc == MODAL_OK)
        rc = take_found(&(struct arnoldi){ .count = h.count, .w = h.multiplier,
                                           .residual = h.residual, .condition = h.condition,
                                           .settled = h.settled }, out, err);
    if (rc == MODAL_OK && out->verdict == STABILITY_UNKNOWN)
        l->u->reason = "not all leading multipliers were found";
    if (out->verdict == STABILITY_UNKNOWN)
        l->u->s->in_vain += h.work;
    hill_leading_done(&h);
    return rc;
}

/* By windows, which no stiff motion makes dear, where all slopes are smooth: else, and past what
 * they may take, MODAL_TOO_LARGE.  A curve's points, hundreds, do not all try in vain. */
static enum modal_status ask_smooth(struct large *l, struct stability *out,
                                    struct modal_error *err)
{
    struct linearised_slope *slope =
        workspace_zeros(&l->space, (size_t)l->parts.channels, sizeof *slope);
    struct linearised linear = { 0 };
    enum modal_status rc = slope == NULL ? no_memory(err) : MODAL_OK;

    if (l->u->s->in_vain > IN_VAIN * l->u->budget->most)
        return modal_fail(err, MODAL_TOO_LARGE, "points before this one had no verdict");
    for (int f = 0; f < l->parts.functions; f++)
        if (l->slope[f].harmonic == NULL)
            return modal_fail(err, MODAL_TOO_LARGE, "a law has pieces");
    for (int c = 0; rc == MODAL_OK && c < l->parts.channels; c++)
        rc = take_slope(l, c, &slope[c], err);
    if (rc == MODAL_OK)
        rc = linearised_make(l->u->p, slope, l->parts.channels, &linear, err);
    linear.program.omega = l->u->point->omega;
    if (rc == MODAL_OK)
        rc = ask_windows(l, &linear.program, out, err);
    linearised_done(&linear);
    return rc;
}

enum modal_status large_stability(struct disturbance *u, struct stability *out,
                                  struct modal_error *err)
{
    struct large l = { .u = u };
    struct period_map *map = NULL;
    struct modal_error why;
    enum modal_status rc = MODAL_OK;

    if (!period_map_serves(u->p))
        u->reason = "more states than the monodromy matrix is computed for, with linear states or "
                    "a mass that pulsates";
    else
        rc = take_laws(&l, err);
    if (rc == MODAL_OK && u->reason == NULL) {
        rc = period_map_new(u->p, &l.parts, 2 * M_PI / u->point->omega,
                            (u->budget->most - u->budget->spent) / FIRST, &map, &why);
        if (rc == MODAL_OK)
            rc = ask(&l, map, out, &why);
        else if (rc == MODAL_TOO_LARGE)
            rc = ask_smooth(&l, out, &why);
        u->reason = rc == MODAL_OVERFLOW       ? "the disturbances overflow"
                    : rc == MODAL_TOO_LARGE    ? "carrying disturbances over the period takes more "
                                              "work, or numbers, than are allowed"
                    : rc == MODAL_BAD_INPUT    ? "the mass matrix is singular"
                    : rc == MODAL_NO_CONVERGENCE ? "disturbances could not be carried over the "
                                                   "period"
                                               : u->reason;
        if (rc == MODAL_NO_MEMORY || rc == MODAL_CANCELLED)
            modal_fail(err, rc, "%s", why.message);
        else
            rc = MODAL_OK;
    }
    period_map_free(map);
    workspace_free(&l.space);
    return rc;
}
