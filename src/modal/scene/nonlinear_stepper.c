/*
 * nonlinear_stepper.c - steps of programs with laws: exact in what is linear, collocation in the
 * forces of the laws
 *
 * Over a step the channels' forces are a polynomial through their values at Radau's nodes; the
 * linear part answers it exactly (collocation.h).  The unknowns are those values alone,
 *
 *     phi_i = f(t_i, probes_i),   probes_i = RE_i y + RG_i w + sum_j H_ij phi_j,                (1)
 *
 * solved by Newton's method with the laws' exact derivatives: channels x STAGES unknowns whatever
 * the number of states.  A rigid slider that sticks has its rate, 0, in place of (1), and its force
 * is what holds it.
 *
 * Error and step.  The polynomial, continued to the step's start, misses the force there by delta;
 * the miss times h and the channel's effect bounds what a force of one degree more would change,
 * and is kept below tolerance times the largest state so far.  Steps are dt / 2^k so that their
 * maps can be kept.
 *
 * Events.  Where a law leaves its smooth piece (regime_events.h) the step is cut there and solved
 * again, until the end of the step and the event agree to 1e-10 of it: no step has a kink inside.
 *
 * Laws that keep a history of their own (a user's) cannot be asked twice about one time: they are
 * asked once at the end of each of the STEPS_SEQUENTIAL equal steps of dt, in order, and enter (1)
 * by the polynomial through their last four values (fewer in the first steps, and after corners of
 * the excitation).
 */
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/collocation.h"
#include "modal/scene/regime_events.h"
#include "modal/scene/holding.h"
#include "modal/scene/ports.h"
#include "modal/scene/stepper.h"

enum { UNKNOWNS_MOST = 4000 };    /* of a step: its dense matrix has 128 MB */

enum {
    S = COLLOCATION_STAGES,  /* the opening's STAGES */
    LEVELS = 40,               /* dt / 2^40 is 1e-12 dt: below it t + h is t but for rounding */
    /* quadratic: a handful serves, and a shorter step is the better cure */
    NEWTON_MOST = 25,
    /* each cut gains as many digits as the last; the end is taken then */
    CUTS_MOST = 12,
    SWITCHES_MOST = 3,         /* of sliders before one step: more would go round in a circle */
    TURNING_CUTS = 4,          /* after so many cuts an event is a turning point: see TURNING */
    TINY_MOST = 4,             /* tiny steps on end: one may be a coincidence of two events */
    /* a step without events is dt / 2^10: its kink costs h^2 of a force */
    BLIND = 10,
    STEPS_MOST = 100000,       /* within one dt: a rattle that dies out has cost a second by then */
    STALLED_MOST = 1000,       /* steps of no length: events that accumulate (Zeno) */
    STEPS_SEQUENTIAL = 64,     /* of dt: PAST values then miss a force by some 64^-4 */
    /* values that a sequential law's force is extrapolated by: a cubic */
    PAST = 4,
    CALM_STEPS = 2,            /* accepted in a row before the step is doubled: no seesaw */
    ORDER_GAIN = 64,           /* 2^(S + 1) and more: what doubling the step may cost in accuracy */
    ASK_EVERY = 1024,          /* steps between two looks at `cancelled`: milliseconds */
    UNITS = 64,                /* in the last place: what sums of some hundred terms are off by */
};
/* of a step: where its end may stand for an event beside it, the polynomial being a line there */
static const double NEAR = 0.05;
/* a step that was cut too early is found too short here */
static const double PAST_END = 1.2;
static const double AGREED = 1e-10;        /* of a step: end and event, no kink inside to this */
static const double TURNING = 1e-6;        /* a turning point is known to sqrt(eps), and some */
static const double SETTLED = 1e-9;        /* of the scale: rounding may keep Newton from more */
static const double LOST = 1e300;          /* past it sums of squares overflow */
/* a force's miss at the start acts over part of a step */
static const double MISS_SHARE = 0.05;
static const double WHOLE = 1e-14;         /* of h: sums of steps are off by as much */
static const double STALL = 1e-12;         /* of dt: a step that does not move t */
static const double TINY = 1e-9;           /* of what was asked: an event right at the start */
static const double OVER = 1e-12;          /* of a limit: a force past it, rounding apart */
static const double ALMOST = 1e-9;         /* of a limit: a force at it, early in the step */
static const double AT_REST = 1e-9;        /* of the largest rate: a slider that does not move */
/* of limit dt: a motion so small no force would notice */
static const double REST_SHARE = 1e-3;
static const double UP_TO_ROUNDING = 1.001;    /* of a halved step's length */

struct nonlinear_stepper {
    struct stepper face;  /* first: a stepper is cast to its own */
    const struct statespace *ss;  /* borrowed */
    const struct sources *src;  /* borrowed */
    struct ports *ports;  /* channels and probes; its own */
    struct collocation *collocation;
    struct holding *holding;  /* what stuck sliders hold with, exactly */
    struct stepper_options opt;  /* tolerance filled in */
    int level, calm;                  /* the step is dt / 2^level; accepted in a row */
    bool sequential, started;  /* a user's law is among them; forces at the start are known */
    /* the next step looks for no event: a slider just loose, its rate still rounding, was caught
     * again */
    bool blind;
    double scale;                     /* the largest |y| so far */
    double missed;                    /* of the last step */
    double *weight;                   /* of each channel: |U| */
    /* of each channel: a rate and a displacement that may be rounding */
    double *quiet, *blur;
    double *memory, *after, *w, *y, *probe0, *base, *probes, *phi, *phi_end, *force0, *hold,
        *force1, *y1, *w1, *slope, *J, *residual, *knots, *past;
    int pasts;  /* values known, the newest first in `past` */
    int *pivot;  /* of J */
    struct workspace space;           /* of the arrays */
};

/* The largest magnitude. */
static double norm(const double *x, int n)
{
    return n > 0 ? fabs(x[cblas_idamax(n, x, 1)]) : 0;
}

/* Probes at y. */
static void probe(const struct nonlinear_stepper *s, const double *y, double *out)
{
    int r = 2 * s->ports->probes;

    cblas_dgemv(CblasColMajor, CblasNoTrans, r, s->ss->N, 1, s->ports->R, r, y, 1, 0, out, 1);
}

/* The part of the nodes' probes that does not depend on phi: RE_i y + RG_i w. */
static void bases(struct nonlinear_stepper *s, const struct collocation_map *map)
{
    int r = 2 * s->ports->probes, N = s->ss->N, nw = s->src->nw;

    for (int i = 0; i < S; i++) {
        double *out = s->base + (size_t)i * (size_t)r;
        cblas_dgemv(CblasColMajor, CblasNoTrans, r, N, 1,
                    map->RE + (size_t)i * (size_t)r * (size_t)N, r, s->y, 1, 0, out, 1);
        if (nw > 0)
            cblas_dgemv(CblasColMajor, CblasNoTrans, r, nw, 1,
                        map->RG + (size_t)i * (size_t)r * (size_t)nw, r, s->w, 1, 1, out, 1);
    }
}

/* (1)'s probes: the bases and what the forces add. */
static void probes_of_phi(struct nonlinear_stepper *s, const struct collocation_map *map)
{
    int r = 2 * s->ports->probes, m = s->ports->channels;

    for (int i = 0; i < S; i++) {
        double *out = s->probes + (size_t)i * (size_t)r;
        memcpy(out, s->base + (size_t)i * (size_t)r, (size_t)r * sizeof *out);
        cblas_dgemv(CblasColMajor, CblasNoTrans, r, m * S, 1,
                    map->H + (size_t)i * S * (size_t)r * (size_t)m, r, s->phi, 1, 1, out, 1);
    }
}

/* A rigid slider at rest, whose force is an unknown and not a law. */
static bool stuck(const struct port_law *l)
{
    return l->law->kind->set_valued && l->held == 0;
}

/* Rows of node I of residual and Jacobian (1). */
static enum modal_status equations(struct nonlinear_stepper *s, const struct collocation_map *map,
                                   double t, int i, struct modal_error *err)
{
    struct ports *p = s->ports;
    int m = p->channels, q = p->probes, r = 2 * q, size = m * S;
    const double *H = map->H + (size_t)i * S * (size_t)r * (size_t)m,
                 *at = s->probes + (size_t)i * (size_t)r;
    double *R = s->residual + (size_t)i * (size_t)m;
    enum modal_status rc = ports_force(p, t, at, s->memory, R, s->slope, NULL, err);

    if (rc != MODAL_OK)
        return rc;
    for (int k = 0; k < m; k++)
        R[k] = s->phi[i * m + k] - R[k];  /* (1) as a residual */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, m, size, r, -1, s->slope, m, H, r, 0,
                s->J + i * m, size);
    for (int k = 0; k < m; k++)
        /* d phi_i; the product is minus (1)'s right side */
        s->J[(size_t)(i * m + k) + (size_t)(i * m + k) * (size_t)size] += 1;
    for (int l = 0; l < p->laws; l++) {
        int c = p->law[l].channel, row = i * m + c;
        if (!stuck(&p->law[l]))  /* else the rate's row takes the place of (1) */
            continue;
        /* the rate as a force: its row scaled to 1 */
        double most = DBL_MIN;
        for (int k = 0; k < size; k++)
            most = fmax(most, fabs(H[(size_t)(q + c) + (size_t)k * (size_t)r]));
        s->residual[row] = at[q + c] / most;
        for (int k = 0; k < size; k++)
            s->J[(size_t)row + (size_t)k * (size_t)size] =
                H[(size_t)(q + c) + (size_t)k * (size_t)r] / most;
    }
    return MODAL_OK;
}

/* Channels of laws with their own history: what the last values extrapolate to at the nodes;
 * they are not iterated. */
static void fix_sequential(struct nonlinear_stepper *s)
{
    struct ports *p = s->ports;
    int m = p->channels, size = m * S;
    const double *node = collocation_nodes(s->collocation);

    for (int l = 0; l < p->laws; l++)
        for (int c = p->law[l].channel; p->law[l].law->kind->restart != NULL
                                        && c < p->law[l].channel + p->law[l].law->kind->inputs;
             c++)
            for (int i = 0; i < S; i++) {
                double value = 0;
                /* Lagrange on theta = 0, -1, -2, -3 */
                for (int a = 0; a < s->pasts; a++) {
                    double weight = 1;
                    for (int b = 0; b < s->pasts; b++)
                        weight *= a == b ? 1 : (node[i] + b) / (b - a);
                    value += weight * s->past[a * m + c];
                }
                int row = i * m + c;
                /* phi is the extrapolated value, nothing else */
                s->residual[row] = s->phi[row] - value;
                for (int k = 0; k < size; k++)
                    s->J[(size_t)row + (size_t)k * (size_t)size] = k == row;
            }
}

/* Newton's iteration on (1); *converged says whether it ended. */
static enum modal_status solve(struct nonlinear_stepper *s, const struct collocation_map *map,
                               double t, bool *converged, struct modal_error *err)
{
    int m = s->ports->channels, size = m * S;
    const double *node = collocation_nodes(s->collocation);
    double before = HUGE_VAL;

    *converged = false;
    bases(s, map);  /* once: what does not depend on phi */
    for (int k = 0; k < NEWTON_MOST; k++) {
        enum modal_status rc = MODAL_OK;
        probes_of_phi(s, map);
        for (int i = 0; i < S && rc == MODAL_OK; i++)
            rc = equations(s, map, t + node[i] * map->h, i, err);
        if (rc != MODAL_OK)
            return rc;
        if (s->sequential)
            fix_sequential(s);
        if (LAPACKE_dgesv_work(LAPACK_COL_MAJOR, size, 1, s->J, size, s->pivot, s->residual, size)
            != 0)
            return MODAL_OK;
        double change = 0;
        for (int i = 0; i < size; i++) {
            s->phi[i] -= s->residual[i];
            /* a force by what it does to the state in a step */
            change = fmax(change, fabs(s->residual[i]) * s->weight[i % m] * map->h);
        }
        if (!(change < LOST))
            return MODAL_OK;
        if (change <= 4 * DBL_EPSILON * s->scale
            || (change <= SETTLED * s->scale && change >= before / 2)) {
            *converged = true;
            probes_of_phi(s, map);
            return MODAL_OK;
        }
        before = change;
    }
    return MODAL_OK;
}

/* What the polynomial misses at the start, as a share of the largest state; stuck and sequential
 * channels do not count. */
static double miss(struct nonlinear_stepper *s, const struct collocation_map *map)
{
    const double *zero = collocation_at_zero(s->collocation);
    int m = s->ports->channels;
    double worst = 0;

    for (int c = 0; c < m; c++) {
        double p0 = 0;
        for (int j = 0; j < S; j++)
            p0 += zero[j] * s->phi[j * m + c];
        if (!isnan(s->force0[c]))
            worst = fmax(worst, fabs(p0 - s->force0[c]) * s->weight[c]);  /* delta of the opening */
    }
    collocation_finish(s->collocation, map, s->w, s->phi, s->y);
    s->scale = fmax(s->scale, norm(s->y, s->ss->N));
    return MISS_SHARE * map->h * worst / s->scale;
}

/* A sum of N products is known to so many units in the last place of its terms. */
static void rounding_of_probes(struct nonlinear_stepper *s, const double *y)
{
    int q = s->ports->probes, r = 2 * q;

    for (int c = 0; c < s->ports->channels; c++) {
        double rate = 0, place = 0;
        for (int k = 0; k < s->ss->N; k++) {
            rate += fabs(s->ports->R[(size_t)(q + c) + (size_t)k * (size_t)r] * y[k]);
            place += fabs(s->ports->R[(size_t)c + (size_t)k * (size_t)r] * y[k]);
        }
        s->quiet[c] = UNITS * DBL_EPSILON * rate;
        s->blur[c] = UNITS * DBL_EPSILON * place;
    }
}

/* What does not change while the step is solved, cut and solved again: probes, sources, forces
 * at its start. */
static enum modal_status begin_step(struct nonlinear_stepper *s, double t, const double *y,
                                    struct modal_error *err)
{
    struct ports *p = s->ports;
    enum modal_status rc = MODAL_OK;

    memcpy(s->y, y, (size_t)s->ss->N * sizeof *y);
    s->scale = fmax(s->scale, fmax(norm(y, s->ss->N), DBL_MIN));
    sources_at(s->src, t, s->w);
    probe(s, y, s->probe0);
    if (s->sequential)
        return MODAL_OK;
    rounding_of_probes(s, y);
    rc = ports_force(p, t, s->probe0, s->memory, s->force0, NULL, NULL, err);
    /* or NaN: two that share one load */
    bool known = rc == MODAL_OK && holding_forces(s->holding, y, s->w, s->force0);
    for (int c = 0; c < p->channels; c++)
        s->hold[c] = known ? s->force0[c] : NAN;
    for (int l = 0; l < p->laws; l++)
        if (stuck(&p->law[l]))
            s->force0[p->law[l].channel] = NAN;  /* no law says what it is: `miss` passes over it */
    return rc;
}

/* From the last step's end forces as a first guess. */
static enum modal_status solve_step(struct nonlinear_stepper *s, double t, double h,
                                    const struct collocation_map **map, bool *converged,
                                    struct modal_error *err)
{
    int m = s->ports->channels, r = 2 * s->ports->probes;
    enum modal_status rc = collocation_map(s->collocation, h, map, err);

    s->face.maps = collocation_maps_made(s->collocation);
    for (int i = 0; i < m * S; i++)
        s->phi[i] = s->phi_end[i % m];  /* forces of the last step's end as a guess */
    if (rc == MODAL_OK)
        rc = solve(s, *map, t, converged, err);
    /* start and nodes: the interpolant of events */
    memcpy(s->knots, s->probe0, (size_t)r * sizeof *s->knots);
    memcpy(s->knots + r, s->probes, (size_t)r * S * sizeof *s->knots);
    return rc;
}

/* The step's end becomes the state. */
static enum modal_status accept(struct nonlinear_stepper *s, const struct collocation_map *map,
                                double t, double *y, struct modal_error *err)
{
    int m = s->ports->channels;
    size_t last = (size_t)(S - 1);
    enum modal_status rc = MODAL_OK;

    collocation_finish(s->collocation, map, s->w, s->phi, y);
    memcpy(s->phi_end, s->phi + last * (size_t)m, (size_t)m * sizeof *s->phi);
    if (!s->sequential) {
        rc = ports_force(s->ports, t + map->h, s->probes + last * 2 * (size_t)s->ports->probes,
                         s->memory, s->force0, NULL, s->after, err);
        memcpy(s->memory, s->after, (size_t)s->ports->memory * sizeof *s->memory);
    }
    s->face.steps++;
    return rc;
}

/* A rigid slider whose piece ended: from slipping to sticking, from sticking to slipping the way
 * it is pushed. */
static void switch_slider(struct nonlinear_stepper *s, int law)
{
    struct port_law *l = &s->ports->law[law];

    if (!l->law->kind->set_valued)
        return;
    /* one that sticks slips the way its force points */
    l->held = l->held != 0 ? 0 : s->phi_end[l->channel] > 0 ? 1 : -1;
}

/* The polynomial of channel C's force at theta. */
static double force_at(const struct nonlinear_stepper *s, int c, double theta)
{
    double at[S], force = 0;

    collocation_lagrange(s->collocation, theta, at);
    for (int j = 0; j < S; j++)
        force += at[j] * s->phi[j * s->ports->channels + c];
    return force;
}

/*
 * Where in the step slider LAW, stuck, breaks loose: from what holds it at the step's end by the
 * equation of motion, and the polynomial's slope there.  Let go while the polynomial alone says so,
 * it would be pushed back by that error and caught again.
 */
static enum modal_status refine_release(struct nonlinear_stepper *s,
                                        const struct collocation_map *map, double t, int law,
                                        double *theta, struct modal_error *err)
{
    const struct port_law *l = &s->ports->law[law];
    double limit = l->law->limit,
           slope = (force_at(s, l->channel, 1) - force_at(s, l->channel, 1 - NEAR)) / NEAR, excess;
    enum modal_status rc;

    memcpy(s->y1, s->y, (size_t)s->ss->N * sizeof *s->y);
    collocation_finish(s->collocation, map, s->w, s->phi, s->y1);
    sources_at(s->src, t + map->h, s->w1);
    rc = ports_force(s->ports, t + map->h,
                     s->probes + (size_t)(S - 1) * 2 * (size_t)s->ports->probes, s->memory,
                     s->force1, NULL, NULL, err);
    if (rc != MODAL_OK || !holding_forces(s->holding, s->y1, s->w1, s->force1))
        return rc;
    excess = fabs(s->force1[l->channel]) - limit;
    slope *= s->force1[l->channel] > 0 ? 1 : -1;  /* of |force| */
    if (fabs(excess) <= UNITS * DBL_EPSILON * limit)
        *theta = 1;
    else if (slope > 0 && fabs(excess) < slope * NEAR)
        *theta = 1 - excess / slope;  /* a line is enough: NEAR is a twentieth of a step */
    return MODAL_OK;
}

/* A slider that is already past its piece where the step begins is switched before the step is
 * believed; true: one was. */
static bool correct_sliders(struct nonlinear_stepper *s)
{
    struct ports *p = s->ports;
    int q = p->probes;
    bool any = false;

    for (int l = 0; l < p->laws; l++) {
        struct port_law *law = &p->law[l];
        if (!law->law->kind->set_valued)
            continue;
        /* at the first node */
        double force = s->phi[law->channel], rate = s->knots[2 * q + q + law->channel];
        if (law->held == 0 && fabs(force) > law->law->limit * (1 + OVER)) {
            double early = s->hold[law->channel];
            if (isnan(early))
                early = force_at(s, law->channel, 0);
            if (fabs(early) > law->law->limit * (1 - ALMOST)) {
                law->held = force > 0 ? 1 : -1;  /* it slips from the start on */
                any = true;
            }
        } else if (law->held != 0 && rate * law->held < -s->quiet[law->channel]
                   && s->knots[q + law->channel] * law->held
                          <= AT_REST * s->scale * s->weight[law->channel]) {
            law->held = 0;
            any = true;
        }
    }
    return any;
}

/*
 * One step of at most H from t: on return *taken is its length (0: none could be, *H was halved),
 * and an event may have ended it.
 */
static enum modal_status try_step(struct nonlinear_stepper *s, double t, double *h, double *y,
                                  double *taken, struct modal_error *err)
{
    const struct collocation_map *map = NULL;
    struct event event = { HUGE_VAL, -1 };
    double step = *h;
    bool converged, cut = false;
    enum modal_status rc = begin_step(s, t, y, err);

    *taken = 0;
    for (int k = 0; k < CUTS_MOST && rc == MODAL_OK; k++) {
        rc = solve_step(s, t, step, &map, &converged, err);
        if (rc != MODAL_OK || !converged)
            break;
        if (s->blind)
            break;
        if (k < SWITCHES_MOST && correct_sliders(s)) {
            rc = begin_step(s, t, y, err);
            continue;
        }
        rc = events_find(s->ports, s->collocation, t, step, s->knots, s->phi, s->memory, s->quiet,
                         s->blur, s->hold, cut ? PAST_END : 1, &event, err);
        if (rc == MODAL_OK && event.law >= 0 && stuck(&s->ports->law[event.law])
            && fabs(event.theta - 1) < NEAR)
            rc = refine_release(s, map, t, event.law, &event.theta, err);
        /* a turning point is known to the root of rounding only */
        double off = fabs(event.theta - 1);
        if (rc != MODAL_OK || event.law < 0 || off < AGREED || (k >= TURNING_CUTS && off < TURNING)
            || k + 1 == CUTS_MOST)
            break;
        cut = true;
        step = fmin(step * event.theta, *h);  /* the event becomes the step's end */
    }
    if (rc != MODAL_OK)
        return rc;
    s->missed = converged ? miss(s, map) : HUGE_VAL;
    if (s->missed > s->face.tolerance) {
        s->face.rejected++;
        *h = step / 2;  /* maps are kept by length: halves come again */
        return MODAL_OK;
    }
    rc = accept(s, map, t, y, err);
    *taken = map->h;
    if (rc == MODAL_OK && s->opt.accepted != NULL)
        s->opt.accepted(s->opt.watcher, t, map->h, s->y, s->ports);
    if (rc == MODAL_OK && event.law >= 0 && fabs(event.theta - 1) < TURNING)
        switch_slider(s, event.law);  /* only where the step really ends at the event */
    return rc;
}

/* Steps of dt / 2^level, each as far as events allow, until H is done. */
static enum modal_status advance_adaptive(struct nonlinear_stepper *s, double t, double h,
                                          double *y, struct modal_error *err)
{
    double done = 0;
    int64_t before = s->face.steps + s->face.rejected;
    int stalled = 0;                  /* steps on end too short to matter */
    int tiny = 0;
    enum modal_status rc = MODAL_OK;

    while (done < h * (1 - WHOLE) && rc == MODAL_OK) {
        double size = ldexp(s->opt.dt, -s->level), left = h - done,
               step = left < size * (1 + TINY) ? left : size, asked = step, taken;
        if (s->opt.cancelled != NULL && (s->face.steps + s->face.rejected) % ASK_EVERY == 0
            && s->opt.cancelled(s->opt.context))
            return modal_fail(err, MODAL_CANCELLED, "simulate: cancelled at t = %.9g s", t + done);
        if (s->face.steps + s->face.rejected - before > STEPS_MOST || stalled > STALLED_MOST)
            return modal_fail(
                err, MODAL_NO_CONVERGENCE,
                "contacts or slips accumulate at t = %.9g s: %lld steps did not pass dt = %g s",
                t + done, (long long)(s->face.steps + s->face.rejected - before), s->opt.dt);
        if (s->opt.steps_most > 0 && s->face.steps + s->face.rejected > s->opt.steps_most)
            return modal_fail(err, MODAL_TOO_LARGE, "simulate: more than %lld steps by t = %.9g s",
                              (long long)s->opt.steps_most, t + done);
        if (s->opt.maps_most > 0 && s->face.maps > s->opt.maps_most)
            return modal_fail(err, MODAL_TOO_LARGE, "simulate: more than %lld maps by t = %.9g s",
                              (long long)s->opt.maps_most, t + done);
        if (s->blind)
            step = fmin(step, ldexp(s->opt.dt, -BLIND));
        rc = try_step(s, t + done, &step, y, &taken, err);
        if (rc != MODAL_OK)
            return rc;
        done += taken;
        stalled = taken < STALL * s->opt.dt ? stalled + 1 : 0;
        tiny = taken > 0 && taken < TINY * asked ? tiny + 1 : taken > 0 ? 0 : tiny;
        s->blind = tiny > TINY_MOST;  /* caught and let go at one place: step past it */
        if (taken == 0) {
            while (s->level < LEVELS && ldexp(s->opt.dt, -s->level) > step * UP_TO_ROUNDING)
                s->level++;
            s->calm = 0;
            if (s->level >= LEVELS)
                return modal_fail(err, MODAL_NO_CONVERGENCE,
                                  "steps of %g s at t = %.9g s still miss the tolerance %g", step,
                                  t + done, s->face.tolerance);
        } else if (taken == asked && asked == size) {
            s->calm++;  /* full steps alone count */
            if (s->level > 0 && s->calm >= CALM_STEPS
                && s->missed < s->face.tolerance / ORDER_GAIN) {
                s->level--;
                s->calm = 0;
            }
        }
        if (!(norm(y, s->ss->N) < LOST))
            return modal_fail(err, MODAL_OVERFLOW, "overflow");
    }
    return rc;
}

/* Laws with a history: the value at the end of each step, in order. */
static enum modal_status remember(struct nonlinear_stepper *s, double t, const double *y,
                                  struct modal_error *err)
{
    int m = s->ports->channels;
    enum modal_status rc;

    /* the oldest falls out */
    memmove(s->past + m, s->past, (size_t)(PAST - 1) * (size_t)m * sizeof *s->past);
    probe(s, y, s->probes);
    rc = ports_force(s->ports, t, s->probes, s->memory, s->past, NULL, s->after, err);
    memcpy(s->memory, s->after, (size_t)s->ports->memory * sizeof *s->memory);
    s->pasts = s->pasts < PAST ? s->pasts + 1 : PAST;
    return rc;
}

/* Equal steps, each asked of once: a user's law may keep what it is told. */
static enum modal_status advance_sequential(struct nonlinear_stepper *s, double t, double h,
                                            double *y, struct modal_error *err)
{
    int steps = (int)fmax(1, ceil(STEPS_SEQUENTIAL * h / s->opt.dt - 1e-9));
    double step = h / steps;
    bool regular = step == s->opt.dt / STEPS_SEQUENTIAL;
    enum modal_status rc = MODAL_OK;

    if (!regular)
        /* values at other distances do not extrapolate */
        s->pasts = s->pasts > 1 ? 1 : s->pasts;
    for (int k = 0; k < steps && rc == MODAL_OK; k++) {
        const struct collocation_map *map = NULL;
        bool converged = false;
        double at = t + k * step;
        rc = begin_step(s, at, y, err);
        if (rc == MODAL_OK)
            rc = solve_step(s, at, step, &map, &converged, err);
        if (rc == MODAL_OK && !converged)
            rc = modal_fail(err, MODAL_NO_CONVERGENCE,
                            "the step of %g s at t = %.9g s did not converge", step, at);
        if (rc == MODAL_OK)
            rc = accept(s, map, at, y, err);
        if (rc == MODAL_OK)
            rc = remember(s, at + step, y, err);
        if (rc == MODAL_OK && !regular)
            s->pasts = 1;
    }
    return rc;
}

/* Impulses and first steps: a slider that moves slips, wherever it was thought to be. */
static void release_sliders(struct nonlinear_stepper *s, const double *y)
{
    struct ports *p = s->ports;

    probe(s, y, s->probe0);
    for (int l = 0; l < p->laws; l++) {
        double rate = s->probe0[p->probes + p->law[l].channel];
        if (p->law[l].law->kind->set_valued
            && fabs(rate) > AT_REST * fmax(norm(y, s->ss->N), s->scale)
                                * s->weight[p->law[l].channel])
            p->law[l].held = rate > 0 ? 1 : -1;
    }
}

/* The first call: forces at the start, and which rigid sliders slip. */
static enum modal_status start(struct nonlinear_stepper *s, double t, const double *y,
                               struct modal_error *err)
{
    struct ports *p = s->ports;
    enum modal_status rc = MODAL_OK;

    s->scale = fmax(norm(y, s->ss->N), s->scale);
    /* a body held at rest has no motion to be small against */
    for (int l = 0; l < p->laws; l++)
        if (p->law[l].law->kind->set_valued)
            s->scale = fmax(s->scale,
                            REST_SHARE * p->law[l].law->limit * s->weight[p->law[l].channel]
                                * s->opt.dt);
    probe(s, y, s->probe0);
    if (s->sequential) {
        for (int l = 0; l < p->laws; l++)
            if (p->law[l].law->kind->restart != NULL)
                p->law[l].law->kind->restart(p->law[l].law);
        rc = remember(s, t, y, err);
        memcpy(s->phi_end, s->past, (size_t)p->channels * sizeof *s->phi_end);
    } else {
        release_sliders(s, y);
        rc = ports_force(p, t, s->probe0, s->memory, s->phi_end, NULL, s->after, err);
        /* a slider put past its bound has followed */
        memcpy(s->memory, s->after, (size_t)p->memory * sizeof *s->memory);
        sources_at(s->src, t, s->w);
        if (rc == MODAL_OK)
            holding_within_limits(s->holding, y, s->w, s->phi_end);
    }
    s->started = true;
    return rc;
}

/* stepper.advance; impulses have changed rates since the last call. */
static enum modal_status advance(struct stepper *face, double t, double h, double *y,
                                 struct modal_error *err)
{
    struct nonlinear_stepper *s = (struct nonlinear_stepper *)face;
    enum modal_status rc = s->started && !face->anew ? MODAL_OK : start(s, t, y, err);

    face->anew = false;
    release_sliders(s, y);
    if (rc == MODAL_OK)
        rc =
            s->sequential ? advance_sequential(s, t, h, y, err) : advance_adaptive(s, t, h, y, err);
    face->products = face->steps;
    return rc;
}

/* B (P w - f): what loads and laws add, for accelerations. */
static enum modal_status force(struct stepper *face, double t, const double *y, double *F,
                               struct modal_error *err)
{
    struct nonlinear_stepper *s = (struct nonlinear_stepper *)face;
    int N = s->ss->N;
    double *p = calloc((size_t)s->ss->n + 1, sizeof *p);
    enum modal_status rc = p == NULL ? modal_fail(err, MODAL_NO_MEMORY, "stepping: out of memory")
                           : s->started ? MODAL_OK
                                        : start(s, t, y, err);

    if (rc == MODAL_OK) {
        memset(F, 0, (size_t)N * sizeof *F);
        sources_at(s->src, t, s->w);
        if (s->src->nw > 0)
            cblas_dgemv(CblasColMajor, CblasNoTrans, s->ss->n, s->src->nw, 1, s->src->P, s->ss->n,
                        s->w, 1, 0, p, 1);
        cblas_dgemv(CblasColMajor, CblasNoTrans, N, s->ss->n, 1, s->ss->B, N, p, 1, 0, F, 1);
        cblas_dgemv(CblasColMajor, CblasNoTrans, N, s->ports->inputs, 1, s->ports->U, N, s->phi_end,
                    1, 1, F, 1);
    }
    free(p);
    return rc;
}

/* stepper.report */
static void report(struct stepper *face, struct program *p)
{
    ports_report(((struct nonlinear_stepper *)face)->ports, p);
}

/* stepper.free; also of one half made. */
static void nonlinear_free(struct stepper *face)
{
    struct nonlinear_stepper *s = (struct nonlinear_stepper *)face;

    workspace_free(&s->space);
    collocation_free(s->collocation);
    holding_free(s->holding);
    ports_free(s->ports);
    free(s);
}

/* All of one stepper's arrays: stepping itself allocates nothing but maps. */
static enum modal_status allocate(struct nonlinear_stepper *s, struct modal_error *err)
{
    size_t m = (size_t)s->ports->channels, r = 2 * (size_t)s->ports->probes, N = (size_t)s->ss->N,
           size = m * S;
    struct { double **x; size_t count;
    } all[] = { { &s->weight, m },
                { &s->quiet, m },
                { &s->blur, m },
                { &s->memory, (size_t)s->ports->memory },
                { &s->after, (size_t)s->ports->memory },
                { &s->w, (size_t)s->src->nw },
                { &s->y, N },
                { &s->probe0, r },
                { &s->base, r * S },
                { &s->probes, r * S },
                { &s->phi, size },
                { &s->phi_end, m },
                { &s->force0, m },
                { &s->hold, m },
                { &s->force1, m },
                { &s->y1, N },
                { &s->w1, (size_t)s->src->nw },
                { &s->slope, m * r },
                { &s->J, size * size },
                { &s->residual, size },
                { &s->knots, r * (S + 1) },
                { &s->past, m * PAST } };

    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        *all[i].x = workspace_zeros(&s->space, all[i].count, sizeof **all[i].x);
    s->pivot = workspace_zeros(&s->space, size, sizeof *s->pivot);
    for (size_t c = 0; !s->space.failed && c < m; c++)
        s->weight[c] = norm(s->ports->U + c * N, (int)N);
    return workspace_check(&s->space, "stepping: out of memory", err);
}

enum modal_status nonlinear_stepper_new(const struct statespace *ss, const struct sources *src,
                                        const struct stepper_options *opt, struct stepper **out,
                                        struct modal_error *err)
{
    struct nonlinear_stepper *s = calloc(1, sizeof *s);
    enum modal_status rc;

    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "stepping: out of memory");
    s->face = (struct stepper){ .name = "exponential-collocation",
                                .advance = advance,
                                .force = force,
                                .report = report,
                                .free = nonlinear_free };
    s->ss = ss;
    s->src = src;
    s->opt = *opt;
    s->face.tolerance = opt->tolerance > 0 ? opt->tolerance : 1e-10;
    rc = ports_new(ss, &s->ports, err);
    if (rc == MODAL_OK && 2 * s->ports->probes * S > UNKNOWNS_MOST)
        rc = modal_fail_field(
            err, MODAL_TOO_LARGE, "effects",
            "%d places of nonlinear or pulsating forces are too many to step; at most %d",
            s->ports->probes, 2000 / S);
    if (rc == MODAL_OK)
        rc = collocation_new(ss, src, s->ports->channels, s->ports->U, 2 * s->ports->probes,
                             s->ports->R, &s->collocation, err);
    if (rc == MODAL_OK)
        rc = holding_new(s->ports, src, &s->holding, err);
    if (rc == MODAL_OK)
        rc = allocate(s, err);
    for (int i = 0; rc == MODAL_OK && i < s->ports->laws; i++)
        s->sequential = s->sequential || s->ports->law[i].law->kind->restart != NULL;
    s->face.memory = s->memory;
    s->face.memories = s->ports != NULL ? s->ports->memory : 0;
    if (rc == MODAL_OK)
        *out = &s->face;
    else
        nonlinear_free(&s->face);
    return rc;
}
