/*
 * settle.c - see settle.h
 *
 * The state is u = (y, z): y of statespace.h, z what laws remember.  With P the map of u over a
 * period, PERIODS_FIRST of them are marched; then a step of Newton's method,
 *
 *     (I - dP/du) s = P(u) - u,      u <- u + lambda s,                                         (1)
 *
 * is taken if it leaves less of P(u) - u, lambda 1, 1/2, 1/4, ...; if none does, more periods are
 * marched, twice as many each time.  dP/du is by differences, once; after a step it becomes the
 * nearest matrix that maps s as P did [B65], and is made anew where such a one serves no more.
 * (1) is solved for the shortest s: what is held by nothing, as the place of a slider that never
 * slips, stays.  States are measured in units of their kind: y, an energy's root, by its largest,
 * or where that is less by what such a rate makes of s_i q_i in a radian of omega, as little holds
 * soft modes and nothing rigid ones; z by the largest displacement that a law sees.
 *
 * A start need not be that good: it is found with the fixed steps of rk4_stepper.c, whose map is of
 * a motion near and repeats to rounding.  They are halved until half of them change nothing that
 * matters; where they come to cost more than the stepper's own, as of stiff contacts, that is
 * taken, roughly and then to the end.  The answer (settle_close) is always the stepper's.
 *
 * [B65] Broyden, Math. Comp. 19 (1965) 577-593.
 */
#include "modal/steady/settle.h"
#include <cblas.h>
#include <complex.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/eigen.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/ports.h"
#include "modal/scene/sources.h"
#include "modal/scene/statespace.h"
#include "modal/scene/stepper.h"
#include "modal/steady/budget.h"
#include "modal/steady/cycle.h"

static const double TWO_PI = 6.283185307179586477;   /* a period of theta */
/* How well periods are followed: the tolerance of the stepper's steps; the closure that is asked
 * for, to which hundreds of them add up; and differences of the map, of a state's unit, between a
 * period's errors and the map's curvature.  A fifth of the fine steps serves until it is near. */
struct stage { double tolerance, closed, difference; };
static const struct stage ROUGH = { 1e-6, 1e-3, 1e-3 };
static const struct stage QUICK = { 0, 1e-6, 1e-5 };    /* of fixed steps */
/* Of the work allowed, what the quick steps may take, which come far with it. */
static const double SHARE_OF_QUICK = 0.5;
/* What halved steps may change of a period, of a state's unit: a start for the balance. */
static const double QUICK_ENOUGH = 1e-2;
static const struct stage FINE = { 1e-11, 1e-9, 1e-5 };
/* The same of displacements, as shares of what moves most. */
static const double CLOSED_IN_TIME = 1e-7;
/* Multipliers by differences so many times as long differ by about their error. */
static const double LONGER = 4;
/* A period that takes so many times the steps of those before is given up: contacts accumulate. */
static const double HARD = 20;
/* What an attracting motion leaves open of a period once it is near: Newton's method that sets out
 * from there stays there. */
static const double ATTRACTS = 1e-2;
/* Of what a period leaves open, a share that no step explains: what nothing holds moves on. */
static const double DRIFTS = 0.5;
/* Singular values below this share of the largest are 0, to what differences tell. */
static const double OPEN = 1e-6;
/* A step of (1) many times as long as the motion is of another one. */
static const double FAR = 10;
/* A step is taken if it leaves less than 1 - FALLS lambda of the closure, and made anew by
 * differences if a corrected matrix leaves more than SLOW of it. */
static const double FALLS = 0.5;
static const double SLOW = 0.3;
static const double LAMBDA_LEAST = 0.1;
enum {
    STEPS = SETTLE_INSTANTS,    /* parts of a period; the longest step is one */
    STEPS_FIRST = 1024,    /* of a period, before any was marched */
    QUICK_STEPS = 4,       /* rk4's of such a part, to begin with */
    PERIODS_FIRST = 12,    /* marched, so that fast transients are gone */
    TRIES_MOST = 400000,   /* steps in all, whatever they cost */
    QUICK_CALLS = 100,     /* operations of a stage that its calls take, whatever the size, */
    QUICK_LAW = 20,        /* and a law's force, an input, which needs no transform */
    SVD_ROOM = 8           /* dgelss: 5 of the order at least */
};

/* A stepper and its work. */
struct pace {
    struct stepper *by;
    double try_work, map_work;        /* of one, operations of budget.h */
    int64_t tries, maps;              /* counted so far */
};

struct settle {
    struct program p;                 /* at this omega */
    struct cycle_options opt;
    struct statespace *ss;
    struct sources *src;
    struct ports *ports;              /* for their R alone */
    struct pace quick, own, *pace;    /* rk4's fixed steps; the stepper's own; the one at hand */
    int n, N, order;                  /* dofs; of y; of u */
    double T;                         /* s: one period */
    double *u, *end, *r;              /* a start, P of it, their difference in units; order each */
    double *trial, *trial_end, *trial_r, *step, *unit;
    double *J, *work, *svd, *singular;    /* I - dP/du in units, order^2; scratch */
    double *probes;                   /* 2 probes: what laws see at y */
    double *motion;                   /* displacements by dof */
    double size_y, size_z;            /* the largest so far */
    double *from;                     /* the state that is marched from */
    double most;                      /* operations, allowed; */
    double spent;                     /* so far */
    int64_t tries_of_map;             /* at which a period is given up */
    const struct stage *stage;
    int periods, svd_size;
    bool attracted;                   /* what is near may be closed, not what is far */
    bool drifts;                      /* what nothing holds moves on by as much each period */
    bool *acts;
    struct workspace space;           /* of the arrays */
};

/* The stepper's work since the last call. */
static void count_work(struct settle *s)
{
    struct pace *pace = s->pace;
    int64_t tries = pace->by->steps + pace->by->rejected;
    double work = (double)(tries - pace->tries) * pace->try_work
                  + (double)(pace->by->maps - pace->maps) * pace->map_work;

    budget_add(s->opt.budget, work);
    s->spent += work;
    pace->tries = tries;
    pace->maps = pace->by->maps;
}

/* Whether the caller wants no answer any more. */
static bool cancelled(const struct settle *s)
{
    return s->opt.cancelled != NULL && s->opt.cancelled(s->opt.context);
}

/* Whether the work is done, or no answer is wanted. */
static bool is_over(const struct settle *s)
{
    return s->spent >= s->most || s->own.tries > TRIES_MOST || cancelled(s);
}

/* Asked by the stepper now and then, and between its calls: whether to give up the period. */
static bool leaves_off(void *context)
{
    struct settle *s = context;

    count_work(s);
    return is_over(s) || s->pace->tries > s->tries_of_map;
}

/* A step was accepted: which laws act. */
static void watch(void *watcher, double t, double h, const double *y, struct ports *ports)
{
    struct settle *s = watcher;

    (void)t, (void)h, (void)y;
    for (int l = 0; l < ports->laws; l++) {
        s->acts[l] |= ports->law[l].acted;
        ports->law[l].acted = false;
    }
}

/* Sizes that have grown, from the state U. */
static void measure(struct settle *s, const double *u)
{
    int rows = 2 * s->ports->probes;

    cblas_dgemv(CblasColMajor, CblasNoTrans, rows, s->N, 1, s->ports->R, rows, u, 1, 0, s->probes,
                1);
    for (int i = 0; i < s->ports->probes; i++)
        s->size_z = fmax(s->size_z, fabs(s->probes[i]));
    for (int i = 0; i < s->N; i++)
        s->size_y = fmax(s->size_y, fabs(u[i]));
    for (int i = s->N; i < s->order; i++)
        s->size_z = fmax(s->size_z, fabs(u[i]));
    for (int i = 0; i < s->order; i++)
        s->unit[i] = i < s->N ? s->size_y : s->size_z;
    for (int i = 0; i < s->n; i++)
        s->unit[i] *= fmin(1, s->ss->s[i] / s->p.omega);
}

/* The stepper at the state FROM, which is copied into Y; nothing has acted. */
static void begin_at(struct settle *s, const double *from, double *y)
{
    memcpy(y, from, (size_t)s->order * sizeof *y);
    if (s->pace->by->memories > 0)
        memcpy(s->pace->by->memory, from + s->N, (size_t)s->pace->by->memories * sizeof *from);
    s->pace->by->anew = true;
    memset(s->acts, 0, (size_t)s->p.laws * sizeof *s->acts);
}

/* TO = P(FROM) and R their difference in units; X, if not NULL, as settle_look's.
 * MODAL_NO_CONVERGENCE where it did not come to its end. */
static enum modal_status map_seen(struct settle *s, const double *from, double *to, double *r,
                                  double *x, struct modal_error *err)
{
    size_t N = (size_t)s->N, memories = (size_t)s->pace->by->memories;
    enum modal_status rc = MODAL_OK;

    begin_at(s, from, to);
    s->tries_of_map = s->pace->tries
                      + (int64_t)(HARD * (double)(s->pace->tries + STEPS_FIRST) / (s->periods + 1));
    if (s->pace == &s->quick)
        s->tries_of_map = INT64_MAX;                    /* as many each period */
    for (int i = 0; rc == MODAL_OK && i < STEPS; i++) {
        if (x != NULL)
            statespace_motion(s->ss, to, s->motion);
        for (int d = 0; x != NULL && d < s->n; d++)
            x[d * STEPS + i] = s->motion[d];
        rc = s->pace->by->advance(s->pace->by, i * s->T / STEPS, s->T / STEPS, to, err);
        if (rc == MODAL_OK && leaves_off(s))
            rc = MODAL_CANCELLED;
    }
    if (memories > 0)
        memcpy(to + N, s->pace->by->memory, memories * sizeof *to);
    s->periods++;
    if (rc == MODAL_OK)
        measure(s, to);
    for (int i = 0; i < s->order; i++)
        r[i] = s->unit[i] > 0 ? (to[i] - from[i]) / s->unit[i] : 0;
    if (rc == MODAL_CANCELLED && cancelled(s))
        return modal_fail(err, MODAL_CANCELLED, "cancelled");
    return rc == MODAL_OK || rc == MODAL_NO_MEMORY ? rc : MODAL_NO_CONVERGENCE;
}

/* TO = P(FROM) and R their difference in units.  Fails as map_seen. */
static enum modal_status map(struct settle *s, const double *from, double *to, double *r,
                             struct modal_error *err)
{
    return map_seen(s, from, to, r, NULL, err);
}

/* max |r_i|. */
static double largest(const double *r, int n) { return n > 0 ? fabs(r[cblas_idamax(n, r, 1)]) : 0; }

/* I - dP/du at s->u, whose map is s->end, by differences of STEP. */
static enum modal_status differences(struct settle *s, double step, struct modal_error *err)
{
    size_t order = (size_t)s->order;
    enum modal_status rc = MODAL_OK;

    for (size_t c = 0; rc == MODAL_OK && c < order; c++) {
        double h = step;

        for (int side = 0; side < 2; side++, h = -h) {  /* back, where forth it finds no end */
            memcpy(s->trial, s->u, order * sizeof *s->u);
            s->trial[c] += h * s->unit[c];
            rc = map(s, s->trial, s->trial_end, s->trial_r, err);
            if (rc != MODAL_NO_CONVERGENCE || is_over(s))
                break;
        }
        /* r = P - u, so that its derivative is minus what is sought */
        for (size_t i = 0; i < order; i++)
            s->J[c * order + i] = -(s->trial_r[i] - s->r[i]) / h;
    }
    return rc;
}

/* The shortest step of (1), in units; false: none, or another motion's. */
static bool solve_step(struct settle *s)
{
    int order = s->order, rank;

    memcpy(s->work, s->J, (size_t)order * (size_t)order * sizeof *s->J);
    memcpy(s->step, s->r, (size_t)order * sizeof *s->r);
    return LAPACKE_dgelss_work(LAPACK_COL_MAJOR, order, order, 1, s->work, order, s->step, order,
                               s->singular, OPEN, &rank, s->svd, s->svd_size) == 0
        && largest(s->step, order) <= FAR;
}

/* J becomes the nearest matrix with J (lambda step) = r_before - r_after [B65]. */
static void correct(struct settle *s, double lambda)
{
    int order = s->order;
    double square = cblas_ddot(order, s->step, 1, s->step, 1) * lambda * lambda;

    if (!(square > 0))
        return;
    for (int i = 0; i < order; i++)
        s->work[i] = s->r[i] - s->trial_r[i];
    cblas_dgemv(CblasColMajor, CblasNoTrans, order, order, -lambda, s->J, order, s->step, 1, 1,
                s->work, 1);
    cblas_dger(CblasColMajor, order, order, lambda / square, s->work, 1, s->step, 1, s->J, order);
}

/* The trial and its map become where the search is. */
static void take_trial(struct settle *s)
{
    size_t size = (size_t)s->order * sizeof *s->u;

    memcpy(s->u, s->trial, size);
    memcpy(s->end, s->trial_end, size);
    memcpy(s->r, s->trial_r, size);
}

/* A damped step of (1) from s->u, *LEFT what it leaves of the closure; 1: none was taken. */
static enum modal_status take_step(struct settle *s, double *left, struct modal_error *err)
{
    double before = cblas_dnrm2(s->order, s->r, 1);
    enum modal_status rc = MODAL_OK;

    *left = 1;
    if (!solve_step(s))
        return MODAL_OK;
    for (double lambda = 1; rc == MODAL_OK && lambda >= LAMBDA_LEAST; lambda /= 2) {
        double after;

        for (int i = 0; i < s->order; i++)
            s->trial[i] = s->u[i] + lambda * s->unit[i] * s->step[i];
        rc = map(s, s->trial, s->trial_end, s->trial_r, err);
        if (rc == MODAL_NO_CONVERGENCE && !is_over(s)) {
            rc = MODAL_OK;
            continue;
        }
        if (rc != MODAL_OK)
            break;
        after = cblas_dnrm2(s->order, s->trial_r, 1);
        if (after < (1 - FALLS * lambda) * before) {
            correct(s, lambda);
            take_trial(s);
            *left = after / before;
            break;
        }
    }
    return rc;
}

/* COUNT periods from where the last one ended. */
static enum modal_status march_on(struct settle *s, int count, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < count
                    && !(i > 1 && largest(s->r, s->order) <= s->stage->closed); i++) {
        memcpy(s->u, s->end, (size_t)s->order * sizeof *s->u);
        rc = map(s, s->u, s->end, s->r, err);
    }
    return rc;
}

/* Whether what is open at s->r is of no step: J s = r leaves most of it. */
static bool unexplained(struct settle *s)
{
    int order = s->order;

    memcpy(s->work, s->r, (size_t)order * sizeof *s->r);
    cblas_dgemv(CblasColMajor, CblasNoTrans, order, order, -1, s->J, order, s->step, 1, 1, s->work,
                1);
    return largest(s->work, order) > DRIFTS * largest(s->r, order);
}

/* Whether differences and a step leave half of the work. */
static bool affords_newton(const struct settle *s)
{
    return s->spent / s->periods * s->order < (s->most - s->spent) / 2;
}

/* Newton's method from here, until it closes or no step helps. */
static enum modal_status close_by_newton(struct settle *s, struct modal_error *err)
{
    double left = 1;
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && largest(s->r, s->order) > s->stage->closed) {
        bool fresh = left > SLOW;     /* the matrix is of differences right here */

        if (fresh && !affords_newton(s))
            break;
        if (fresh)
            rc = differences(s, s->stage->difference, err);
        if (rc == MODAL_OK)
            rc = take_step(s, &left, err);
        if (rc == MODAL_OK && left == 1 && fresh) {
            s->drifts = s->stage != &ROUGH && unexplained(s);
            break;
        }
    }
    return rc == MODAL_NO_CONVERGENCE && !is_over(s) ? MODAL_OK : rc;
}

/* Until it closes as STAGE asks, or moves on for ever, or the work is done. */
static enum modal_status close_up(struct settle *s, const struct stage *stage,
                                  struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    int more = PERIODS_FIRST;

    s->stage = stage;
    s->pace->by->tolerance = stage->tolerance;
    rc = march_on(s, 1, err);                           /* as well as is asked from here on */
    if (rc == MODAL_OK && stage == &FINE)
        rc = close_by_newton(s, err);
    for (; rc == MODAL_OK && !s->drifts && largest(s->r, s->order) > stage->closed; more *= 2) {
        rc = march_on(s, more, err);
        if (rc == MODAL_OK && !(s->attracted && largest(s->r, s->order) > ATTRACTS))
            rc = close_by_newton(s, err);
    }
    return rc;
}

/* rk4 with COUNT steps a part of a period, at hand; false: they cost more than the stepper's own,
 * or than is left. */
static enum modal_status set_quick(struct settle *s, int count, bool *serves,
                                   struct modal_error *err)
{
    struct stepper_options how = { .dt = s->T / STEPS, .substeps = count };
    double work, stages = 4, N = s->N, probes = 2.0 * s->ports->probes,
           /* what laws remember moves once a step more */
           asked = s->own.by->memories > 0 ? stages + 1 : stages;

    if (s->quick.by != NULL)
        s->quick.by->free(s->quick.by);
    s->quick = (struct pace){ 0 };
    work = stages * (QUICK_CALLS + 2 * N * (N + s->src->nw) / BUDGET_DENSE)
           + asked * (s->ports->inputs * QUICK_LAW
                      + 2 * N * (probes + s->ports->channels) / BUDGET_DENSE);
    *serves = STEPS * count * work < STEPS_FIRST * s->own.try_work
           && STEPS * count * work * PERIODS_FIRST < s->most - s->spent;
    s->pace = &s->quick;
    s->quick.try_work = work;
    s->periods = 0;
    return *serves ? rk4_stepper_new(s->ss, s->src, &how, &s->quick.by, err) : MODAL_OK;
}

/* Whether COUNT steps were enough: twice as many, at hand after this, end the period from s->u
 * where they did; *SERVES as set_quick's. */
static enum modal_status are_enough(struct settle *s, int count, bool *enough, bool *serves,
                                    struct modal_error *err)
{
    enum modal_status rc = set_quick(s, 2 * count, serves, err);

    *enough = !*serves;
    if (rc != MODAL_OK || !*serves)
        return rc;
    rc = map(s, s->u, s->trial_end, s->trial_r, err);
    *enough = rc == MODAL_OK;
    for (int i = 0; i < s->order; i++)
        *enough &= !(s->unit[i] > 0)
                || fabs(s->trial_end[i] - s->end[i]) <= QUICK_ENOUGH * s->unit[i];
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

/* From s->from, with steps that are enough where they end; *SERVES false: none are. */
static enum modal_status close_quickly(struct settle *s, bool *serves, struct modal_error *err)
{
    bool enough = false;
    enum modal_status rc = set_quick(s, QUICK_STEPS, serves, err);

    for (int count = QUICK_STEPS; rc == MODAL_OK && *serves && !enough; count *= 2) {
        s->drifts = false;
        s->size_y = s->size_z = 0;
        memcpy(s->end, s->from, (size_t)s->order * sizeof *s->end);
        s->stage = &QUICK;
        rc = march_on(s, PERIODS_FIRST, err);           /* steps too long are told soon */
        if (rc == MODAL_OK)
            rc = are_enough(s, count, &enough, serves, err);
        if (rc == MODAL_OK && enough && *serves)
            rc = close_up(s, &QUICK, err);
        else if (rc == MODAL_NO_CONVERGENCE && !is_over(s)) {
            enough = false;                             /* grown without bound */
            rc = set_quick(s, 2 * count, serves, err);
        }
    }
    return rc;
}

/* A motion near by the quick steps; where they do not serve, roughly and then the motion itself. */
static enum modal_status close_near(struct settle *s, struct cycle *out, struct modal_error *err)
{
    double most = s->most, began = s->spent;
    bool serves = false;
    enum modal_status rc;

    s->most = began + SHARE_OF_QUICK * (most - began);
    rc = close_quickly(s, &serves, err);
    s->most = most;
    if (rc == MODAL_OK && !serves) {
        s->pace = &s->own;
        s->periods = 0;
        s->drifts = false;
        memcpy(s->end, s->from, (size_t)s->order * sizeof *s->end);
        rc = close_up(s, &ROUGH, err);
        if (rc == MODAL_OK)
            rc = close_up(s, &FINE, err);
    }
    out->closure = largest(s->r, s->order);
    out->closed = rc == MODAL_OK && !s->drifts && out->closure <= s->stage->closed;
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

/* Whether displacements ONE a period after the first samples of X are those, to CLOSED_IN_TIME of
 * what any of them moves: a norm of states says little of what is held softly. */
static bool repeats(const double *x, const double *one, int n)
{
    double left = 0, span = 0;

    for (int i = 0; i < n; i++) {
        const double *at = x + (size_t)i * CYCLE_SAMPLES;
        double least = at[0], most = at[0];

        for (int j = 1; j < CYCLE_SAMPLES; j++) {
            least = fmin(least, at[j]);
            most = fmax(most, at[j]);
        }
        span = fmax(span, most - least);
        left = fmax(left, fabs(one[i] - at[0]));
    }
    return left <= CLOSED_IN_TIME * span;
}

/* The period that is closed into out->x. */
static enum modal_status sample(struct settle *s, struct cycle *out, struct modal_error *err)
{
    size_t n = (size_t)s->n;
    double *one = s->work;
    enum modal_status rc = MODAL_OK;

    begin_at(s, s->u, s->trial);
    s->tries_of_map = INT64_MAX;
    s->most = HUGE_VAL;                          /* one period more: counted, not refused */
    for (size_t j = 0; rc == MODAL_OK && j < CYCLE_SAMPLES; j++) {
        statespace_motion(s->ss, s->trial, one);
        for (size_t i = 0; i < n; i++)
            out->x[i * CYCLE_SAMPLES + j] = one[i];
        rc = s->pace->by->advance(s->pace->by, (double)j * s->T / CYCLE_SAMPLES,
                                  s->T / CYCLE_SAMPLES, s->trial, err);
    }
    count_work(s);
    if (rc == MODAL_OK)
        statespace_motion(s->ss, s->trial, one);
    /* quick steps of another length close at another place, which a start may */
    out->closed &= rc == MODAL_OK && (s->pace == &s->quick || repeats(out->x, one, s->n));
    return rc;
}

/* Room for N numbers of y and the rest, of s->space; S's sizes are set. */
static enum modal_status allocate(struct settle *s, struct modal_error *err)
{
    size_t order = (size_t)s->order;
    struct { double **x; size_t count; } all[] = {
        { &s->u, order }, { &s->from, order }, { &s->end, order }, { &s->r, order },
        { &s->trial, order }, { &s->trial_end, order }, { &s->trial_r, order },
        { &s->step, order }, { &s->unit, order },
        { &s->J, order * order }, { &s->work, order * order }, { &s->singular, order },
        { &s->svd, (size_t)s->svd_size }, { &s->probes, 2 * (size_t)s->ports->probes },
        { &s->motion, (size_t)s->n } };

    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        *all[i].x = workspace_zeros(&s->space, all[i].count, sizeof **all[i].x);
    s->acts = workspace_zeros(&s->space, (size_t)s->p.laws, sizeof *s->acts);
    return workspace_check(&s->space, "settle: no memory", err);
}

bool settle_takes(const struct program *p)
{
    int memory = 0;

    for (int l = 0; l < p->laws; l++) {
        memory += p->law[l].memory;
        if (p->law[l].kind->set_valued || p->law[l].kind->restart != NULL)
            return false;
    }
    return p->laws > 0 && 2 * p->n + p->n_linear + memory <= CYCLE_STATES_MOST;
}

enum modal_status settle_new(const struct program *p, double omega, const struct cycle_options *opt,
                             struct settle **out, struct modal_error *err)
{
    struct settle *s = calloc(1, sizeof *s);
    struct stepper_options how = { .tolerance = FINE.tolerance,
                                   .cancelled = leaves_off,
                                   .context = s,
                                   .accepted = watch,
                                   .watcher = s };
    enum modal_status rc;

    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "settle: no memory");
    s->p = *p;
    s->opt = *opt;
    s->n = p->n;
    s->p.omega = omega;
    s->p.period = s->T = TWO_PI / omega;
    how.dt = s->T / STEPS;
    rc = statespace_new(&s->p, &s->ss, err);
    if (rc == MODAL_OK)
        rc = sources_new(&s->p, true, &s->src, err);
    if (rc == MODAL_OK)
        rc = ports_new(s->ss, &s->ports, err);
    if (rc == MODAL_OK)
        rc = nonlinear_stepper_new(s->ss, s->src, &how, &s->own.by, err);
    if (rc == MODAL_OK) {
        s->N = s->ss->N;
        s->order = s->N + s->own.by->memories;
        s->svd_size = SVD_ROOM * (s->order + SVD_ROOM);
        cycle_price(s->ports, s->src->nw, &s->own.try_work, &s->own.map_work);
        rc = allocate(s, err);
    }
    if (rc != MODAL_OK) {
        settle_free(s);
        return rc;
    }
    *out = s;
    return MODAL_OK;
}

void settle_free(struct settle *s)
{
    if (s == NULL)
        return;
    if (s->own.by != NULL)
        s->own.by->free(s->own.by);
    if (s->quick.by != NULL)
        s->quick.by->free(s->quick.by);
    ports_free(s->ports);
    sources_free(s->src);
    statespace_free(s->ss);
    workspace_free(&s->space);
    free(s);
}

/* OUT with room for a motion, nothing known of it. */
static enum modal_status room_for(const struct settle *s, struct cycle *out,
                                  struct modal_error *err)
{
    *out = (struct cycle) { .x = calloc((size_t)s->n * CYCLE_SAMPLES, sizeof *out->x),
                            .acts = calloc((size_t)s->p.laws + 1, sizeof *out->acts),
                            .multiplier = calloc((size_t)s->order + 1, sizeof *out->multiplier) };
    return out->x == NULL || out->acts == NULL || out->multiplier == NULL
               ? modal_fail(err, MODAL_NO_MEMORY, "settle: no memory")
               : MODAL_OK;
}

enum modal_status settle_find(struct settle *s, const double *x0, const double *v0, double most,
                              bool attracted, struct cycle *out, struct modal_error *err)
{
    double *rest = calloc((size_t)s->n + 1, sizeof *rest);
    enum modal_status rc = room_for(s, out, err);

    if (rc == MODAL_OK && rest == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "settle: no memory");
    if (rc == MODAL_OK) {
        s->p.x0 = x0 != NULL ? (double *)x0 : rest;     /* read only, by statespace_start */
        s->p.v0 = v0 != NULL ? (double *)v0 : rest;
        statespace_start(s->ss, s->from);
        s->most = s->spent + most;
        s->attracted = attracted;
        rc = close_near(s, out, err);
    }
    if (rc == MODAL_OK && out->closure <= SETTLE_NEAR)
        rc = sample(s, out, err);
    if (rc == MODAL_OK) {
        memcpy(out->acts, s->acts, (size_t)s->p.laws * sizeof *out->acts);
        out->periods = s->periods;
        out->evaluations = (long)s->pace->by->steps;
    } else
        cycle_done(out);
    free(rest);
    return rc;
}

/* What the stepper's own search, which ended with RC, has found, into OUT. */
static enum modal_status give_closed(struct settle *s, enum modal_status rc, struct cycle *out,
                                     struct modal_error *err)
{
    out->closure = largest(s->r, s->order);
    out->closed = rc == MODAL_OK && !s->drifts && out->closure <= FINE.closed;
    if (out->closed)
        rc = sample(s, out, err);
    if (rc == MODAL_OK) {
        memcpy(out->acts, s->acts, (size_t)s->p.laws * sizeof *out->acts);
        out->evaluations = (long)s->own.by->steps;
    }
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

enum modal_status settle_look(struct settle *s, const double *x0, const double *v0, double most,
                              double *x, bool *ended, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    s->p.x0 = (double *)x0;                             /* read only, by statespace_start */
    s->p.v0 = (double *)v0;
    statespace_start(s->ss, s->from);
    s->pace = &s->own;
    s->own.by->tolerance = FINE.tolerance;
    s->stage = &FINE;
    s->most = s->spent + most;
    s->periods = 0;
    memcpy(s->u, s->from, (size_t)s->order * sizeof *s->u);
    if (s->own.by->memories > 0)
        rc = map(s, s->u, s->end, s->r, err);
    if (rc == MODAL_OK && s->own.by->memories > 0)
        memcpy(s->u + s->N, s->end + s->N, (size_t)s->own.by->memories * sizeof *s->u);
    if (rc == MODAL_OK)
        rc = map_seen(s, s->u, s->end, s->r, x, err);
    *ended = rc == MODAL_OK;
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

enum modal_status settle_close_from(struct settle *s, double most, struct cycle *out,
                                    struct modal_error *err)
{
    enum modal_status rc = room_for(s, out, err);

    s->most = s->spent + most;
    if (rc == MODAL_OK)
        rc = close_by_newton(s, err);
    if (rc == MODAL_OK && !s->drifts && largest(s->r, s->order) > FINE.closed) {
        rc = march_on(s, PERIODS_FIRST, err);           /* what attracts is nearer then */
        if (rc == MODAL_OK)
            rc = close_by_newton(s, err);
    }
    if (rc == MODAL_OK || rc == MODAL_NO_CONVERGENCE)
        rc = give_closed(s, rc, out, err);
    out->periods = s->periods;
    if (rc != MODAL_OK)
        cycle_done(out);
    return rc;
}

enum modal_status settle_close(struct settle *s, double most, struct cycle *out,
                               struct modal_error *err)
{
    if (s->drifts || (out->closed && s->pace == &s->own))
        return MODAL_OK;                                /* it is as good as can be */
    s->pace = &s->own;
    s->periods = 0;
    s->most = s->spent + most;
    memcpy(s->end, s->u, (size_t)s->order * sizeof *s->end);
    return give_closed(s, close_up(s, &FINE, err), out, err);
}

/* Eigenvalues of I - J, J by differences of STEP. */
static enum modal_status multipliers_by(struct settle *s, double step, double complex *out,
                                        struct modal_error *err)
{
    int order = s->order;
    struct matrix A = { order, order, order, s->work };
    enum modal_status rc = differences(s, step, err);

    for (int i = 0; i < order * order; i++)
        s->work[i] = (i % (order + 1) == 0) - s->J[i];
    return rc == MODAL_OK ? eigen_by_size(&A, out, err) : rc;
}

enum modal_status settle_multipliers(struct settle *s, double most, struct cycle *out,
                                     struct modal_error *err)
{
    double complex *other = calloc((size_t)s->order + 1, sizeof *other);
    enum modal_status rc = other == NULL ? modal_fail(err, MODAL_NO_MEMORY, "settle: no memory")
                                         : MODAL_OK;

    s->most = s->spent + most;
    if (rc == MODAL_OK)
        rc = multipliers_by(s, LONGER * FINE.difference, other, err);
    if (rc == MODAL_OK)
        rc = multipliers_by(s, FINE.difference, out->multiplier, err);
    out->states = rc == MODAL_OK ? s->order : 0;
    /* how far the motion is, and not only what it leaves open */
    if (rc == MODAL_OK && solve_step(s))
        out->closure = fmax(out->closure, largest(s->step, s->order));
    for (int i = 0; i < out->states; i++) {
        double nearest = HUGE_VAL;

        for (int k = 0; k < out->states; k++)
            nearest = fmin(nearest, cabs(out->multiplier[i] - other[k]));
        out->error = fmax(out->error, nearest);
    }
    free(other);
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}
