/*
 * cycle.c - see cycle.h
 *
 * In the state space of statespace.h, y' = A y + B p(t) + U phi, phi_i = held_i limit_i where
 * slider i slips; those that stick (set C, rates R_C y = 0) hold with
 *
 *     phi_C = -(R_C U_C)^-1 R_C (A y + B p + U_S phi_S),                                        (1)
 *
 * so that a disturbance obeys y' = Q A y, Q = I - U_C (R_C U_C)^-1 R_C.  Slider i comes to rest
 * where its rate r = R_i y passes 0, from the vector field f- to f+ (sticking, or slipping the
 * other way); a disturbance passes there by
 *
 *     S = I + (f+ - f-) R_i / (R_i f-)                                                          (2)
 *
 * [LN04, section 7.1].  Breaking loose leaves f, and with it the disturbance, continuous.  The
 * product Pi of the exponentials and (2) is the derivative of the period map: its eigenvalues are
 * the multipliers, and Newton's step is (I - Pi)^-1 (P(y) - y).  A body that sticks all the time
 * has Pi = I somewhere: the step is the shortest, and the motion given has its slider at zero
 * (offset.h).  Where a step fails the next period is simply marched, and so are all beside other
 * laws.  Of those the period map is differenced where the laws keep no memory, so that the state is
 * all there is: (P(y + h e) - P(y - h e)) / 2h with two h, whose multipliers differ by about their
 * error.
 *
 * [LN04] Leine, Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer
 * 2004.
 */
#include "modal/steady/cycle.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/eigen.h"
#include "modal/linalg/expm.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/collocation.h"
#include "modal/scene/ports.h"
#include "modal/scene/sources.h"
#include "modal/scene/statespace.h"
#include "modal/scene/stepper.h"
#include "modal/steady/budget.h"
#include "modal/steady/offset.h"

static const double TWO_PI = 6.283185307179586477;   /* a period of theta */
/* Of a step of the stepper: its default for laws is 1e-10, and the closure adds up hundreds. */
static const double TOLERANCE = 1e-12;
/* The closure that ends Newton's steps: a few hundred roundings. */
static const double CLOSED = 1e-13;
/* Where a step no longer halves it, rounding of a stiff system is all that is left below this. */
static const double NEARLY = 1e-9;
/* The closure that ends plain periods, which come no nearer than the stepper's own errors. */
static const double STILL = 1e-11;
/* What sticks may hold with more than it has by this share: the stepper locates where it breaks
 * loose on a polynomial. */
static const double OVER = 1e-6;
/* Singular values of I - Pi below this share of the largest are 0: a body that sticks somewhere. */
static const double OPEN = 1e-11;
/* Differences of the period map, of the largest state: errors of TOLERANCE over SHORT are 1e-7, and
 * with one four times as long the curvature shows. */
static const double SHORT = 1e-5;
static const double LONG = 4e-5;
/* Of the rate that friction's limit alone gives within a period: a motion smaller is none. */
static const double NO_MOTION = 1e-3;
enum {
    STEPS = 64,            /* parts of a period; the longest step is one */
    FIRST = 4,             /* periods before closures count: transients */
    LAWS_MOST = OFFSET_LAWS_MOST,
    NONE = -2,             /* no law is held so */
    TRIES_MOST = 60000     /* steps: CYCLE_PERIODS_MOST periods of 100 */
};

/* What budget.h counts.  An exponential is six products, a solve worth 4/3 of one and as a rule
 * some squarings ([H05] of expm.c); Newton's method starts a step from the last force and ends in
 * three iterations; a step that an event ends is solved again, cut there. */
enum {
    PRODUCTS_OF_EXPONENTIAL = 10,    /* 6 + 4/3 and some squarings */
    ITERATIONS_OF_STEP = 3,          /* Newton's, from the last force */
    SOLUTIONS_OF_STEP = 2,           /* with an event: up to the end, and up to the event */
    FASTER_BY = 32                   /* rows: of 2 to 24 sliders the work stated is then one to two
                                      * nanoseconds an operation less, as that of others is */
};

/* Of the budget, what finding the motion may spend: as much is left to the balance, tried where
 * this fails. */
static const double SHARE_TO_CLOSE = 0.5;

struct follow {
    struct program p;                 /* at this omega */
    const struct cycle_options *opt;
    struct statespace *ss;
    struct sources *src;
    struct ports *ports;              /* for their U and R alone */
    struct stepper *stepper;          /* of nonlinear_stepper.c, `watch` its watcher */
    struct expm *exponential;         /* of a phase, N x N */
    int N, laws;
    double T;                         /* s: one period */
    double *y, *start, *last, *w, *load;      /* N, N, N (where the last step ended), nw, n */
    double *Pi, *Q, *E, *work;        /* N x N each */
    double *before, *after, *small;   /* f-, f+; laws x (laws + 1) */
    double *singular, *svd;           /* of newton_step: N, its workspace */
    int svd_size;
    int *held, *pivot;                /* of the phase under way, per law */
    bool *acts;                       /* the result's in the end */
    struct workspace space;           /* of the other arrays */
    double floor;                     /* of |y|: a thousandth of the rate that friction's
                                       * strength gives within T */
    double phase;                     /* time spent in it that Pi does not know of yet; < 0: a
                                       * period begins */
    bool followed;                    /* rigid friction alone, constant matrices: disturbances
                                       * can be */
    bool remembers;                   /* some law has a memory */
    int64_t tries, maps;              /* of the stepper, counted in the budget so far */
    double try_work, map_work;        /* of one, operations of budget.h */
    double allowed;                   /* the work at which to give up, */
    int64_t tries_allowed;            /* and the tries */
    bool watching, failed;
};

/* -1, 0 or 1: slipping back, sticking, slipping forth. */
static int held_of(const struct ports *ports, int l) { return ports->law[l].held; }
/* R_i: the row that reads slider I's rate off y; its entries are 2 `probes` apart. */
static const double *rate_row(const struct follow *f, int l)
{
    return f->ports->R + f->ports->probes + f->ports->law[l].channel;
}
/* U_i: what a unit of law L's force does to y'. */
static const double *pull(const struct follow *f, int l)
{
    return f->ports->U + (size_t)f->ports->law[l].channel * (size_t)f->N;
}
/* R_i y. */
static double rate(const struct follow *f, int l, const double *y)
{
    return cblas_ddot(f->N, rate_row(f, l), 2 * f->ports->probes, y, 1);
}

/* z <- Q z for every column of z, C the laws with held 0: what the stuck sliders hold back is taken
 * out, (1). */
static bool hold_back(struct follow *f, const int *held, double *z, int columns)
{
    int stuck[LAWS_MOST], count = 0;
    double *G = f->small, *rhs = f->small + f->laws * f->laws;

    for (int l = 0; l < f->laws; l++)
        if (held[l] == 0)
            stuck[count++] = l;
    if (count == 0)
        return true;
    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++)
            G[i + j * count] = rate(f, stuck[i], pull(f, stuck[j]));  /* R_C U_C */
    if (LAPACKE_dgetrf_work(LAPACK_COL_MAJOR, count, count, G, count, f->pivot) != 0)
        return false;
    for (int c = 0; c < columns; c++) {
        double *column = z + (size_t)c * (size_t)f->N;

        for (int i = 0; i < count; i++)
            rhs[i] = rate(f, stuck[i], column);         /* R_C z */
        LAPACKE_dgetrs_work(LAPACK_COL_MAJOR, 'N', count, 1, G, count, f->pivot, rhs, count);
        for (int i = 0; i < count; i++)
            /* z - U_C (R_C U_C)^-1 R_C z */
            cblas_daxpy(f->N, -rhs[i], pull(f, stuck[i]), 1, column, 1);
    }
    return true;
}

/* The vector field at (t, y) with sliders HELD. */
static bool field(struct follow *f, double t, const double *y, const int *held, double *out)
{
    int n = f->ss->n, N = f->N;

    sources_at(f->src, t, f->w);                        /* p(t) = P w(t) */
    memset(f->load, 0, (size_t)n * sizeof *f->load);
    if (f->src->nw > 0)
        cblas_dgemv(CblasColMajor, CblasNoTrans, n, f->src->nw, 1, f->src->P, n, f->w, 1, 0,
                    f->load, 1);
    cblas_dgemv(CblasColMajor, CblasNoTrans, N, N, 1, f->ss->A, N, y, 1, 0, out, 1);  /* A y */
    /* + B p */
    cblas_dgemv(CblasColMajor, CblasNoTrans, N, n, 1, f->ss->B, N, f->load, 1, 1, out, 1);
    for (int l = 0; l < f->laws; l++)
        cblas_daxpy(N, held[l] * f->p.law[l].limit, pull(f, l), 1, out, 1);  /* + U_S phi_S */
    return hold_back(f, held, out, 1);                  /* phi_C by (1) */
}

/* Operations of an exponential of order n. */
static double exponential_work(int n)
{
    return PRODUCTS_OF_EXPONENTIAL * 2.0 * n * n * n / BUDGET_DENSE;
}

/* Pi <- exp(phase Q A) Pi. */
static void end_phase(struct follow *f)
{
    size_t size = (size_t)f->N * (size_t)f->N;

    if (f->phase <= 0)
        return;
    budget_add(f->opt->budget, exponential_work(f->N));
    memcpy(f->Q, f->ss->A, size * sizeof *f->Q);
    f->failed |= !hold_back(f, f->held, f->Q, f->N);    /* Q A */
    cblas_dscal((int)size, f->phase, f->Q, 1);          /* times the phase's length */
    f->failed |= f->failed || expm(f->exponential, f->Q, f->E, NULL) != MODAL_OK;
    if (!f->failed) {
        square_multiply(f->N, 1, f->E, f->Pi, 0, f->work);
        memcpy(f->Pi, f->work, size * sizeof *f->Pi);
    }
    f->phase = 0;
}

/* (2) for slider l, from f->held to HELD. */
static void jump(struct follow *f, int l, double t, const double *y, int held)
{
    const double *row = rate_row(f, l);
    int stride = 2 * f->ports->probes, N = f->N;
    double speed;

    f->failed |= !field(f, t, y, f->held, f->before);
    f->held[l] = held;
    f->failed |= !field(f, t, y, f->held, f->after);
    speed = cblas_ddot(N, row, stride, f->before, 1);   /* R_i f- of (2) */
    if (speed == 0)                                     /* a grazing stop: (2) has no slope there */
        return;
    cblas_daxpy(N, -1, f->before, 1, f->after, 1);      /* f+ - f- */
    for (int c = 0; c < N; c++) {
        double *column = f->Pi + (size_t)c * (size_t)N;

        cblas_daxpy(N, cblas_ddot(N, row, stride, column, 1) / speed, f->after, 1, column, 1);
    }
}

/* A step of the motion followed: the disturbances' phases and jumps. */
static void watch(void *watcher, double t, double h, const double *y, struct ports *ports)
{
    struct follow *f = watcher;
    bool first = f->watching && f->phase < 0;

    for (int l = 0; !f->watching && l < f->laws; l++)
        f->held[l] = held_of(ports, l);
    for (int l = 0; l < f->laws; l++) {
        f->acts[l] |=
            ports->law[l].law->kind->set_valued ? held_of(ports, l) != 0 : ports->law[l].acted;
        ports->law[l].acted = false;
    }
    for (int l = 0; f->watching && l < f->laws; l++) {
        int held = held_of(ports, l);

        if (held == f->held[l])
            continue;
        if (!first)                              /* the phase that ends here was held the old way */
            end_phase(f);
        if (!first && f->held[l] != 0)                /* stops jump; breaking loose is continuous */
            jump(f, l, t, f->last, held);
        f->held[l] = held;
    }
    /* a stuck slider that is given a rate stops at once */
    if (first)
        f->failed |= !hold_back(f, f->held, f->Pi, f->N);
    f->phase = fmax(f->phase, 0) + h;
    memcpy(f->last, y, (size_t)f->N * sizeof *y);
}

/* The stepper's work since the last call, into the budget. */
static void count_work(struct follow *f)
{
    const struct stepper *s = f->stepper;
    int64_t tries = s->steps + s->rejected;

    budget_add(f->opt->budget, (double)(tries - f->tries) * f->try_work
                               + (double)(s->maps - f->maps) * f->map_work);
    f->tries = tries;
    f->maps = s->maps;
}

/* Whether the caller wants no answer any more. */
static bool cancelled(const struct follow *f)
{
    return f->opt->cancelled != NULL && f->opt->cancelled(f->opt->context);
}

/* Whether the steps or the work that `allow` gave are spent. */
static bool overdrawn(const struct follow *f)
{
    return f->tries > f->tries_allowed
        || (f->opt->budget != NULL && f->opt->budget->spent >= f->allowed);
}

/* From here on a SHARE of the work the budget allows in all, and TRIES_MOST more steps. */
static void allow(struct follow *f, double share)
{
    const struct budget *b = f->opt->budget;

    f->allowed = b != NULL && b->most > 0 ? share * b->most : HUGE_VAL;
    f->tries_allowed = f->tries + TRIES_MOST;
}

/* Asked by the stepper now and then: whether to give up. */
static bool spent(void *context)
{
    struct follow *f = context;

    count_work(f);
    return overdrawn(f) || cancelled(f);
}

/* One period from f->y on, disturbances watched if f->watching: P(y) into y, its derivative into
 * Pi. */
static enum modal_status period(struct follow *f, struct modal_error *err)
{
    size_t N = (size_t)f->N;
    enum modal_status rc = MODAL_OK;

    memset(f->Pi, 0, N * N * sizeof *f->Pi);
    for (size_t i = 0; i < N; i++)
        f->Pi[i * (N + 1)] = 1;                         /* disturbances begin as they are */
    for (int l = 0; l < f->laws; l++) {
        f->held[l] = NONE;                              /* to be seen at the first step */
        f->acts[l] = false;
    }
    memcpy(f->last, f->y, N * sizeof *f->y);
    f->phase = -1;                                      /* a period begins */
    f->failed = false;
    for (int i = 0; rc == MODAL_OK && i < STEPS; i++) {
        rc = f->stepper->advance(f->stepper, i * f->T / STEPS, f->T / STEPS, f->y, err);
        count_work(f);
        if (overdrawn(f) && !cancelled(f))
            rc = modal_fail(err, MODAL_NO_CONVERGENCE, "cycle: the work allowed did not close it");
    }
    if (f->watching)
        end_phase(f);
    return rc;
}

/* max |y_i|. */
static double largest(const double *y, int n) { return n > 0 ? fabs(y[cblas_idamax(n, y, 1)]) : 0; }

/* (P(y) - y) after a period from f->start, relative. */
static double closure(const struct follow *f)
{
    double most = 0, scale = fmax(f->floor, fmax(largest(f->y, f->N), largest(f->start, f->N)));

    for (int i = 0; i < f->N; i++)
        most = fmax(most, fabs(f->y[i] - f->start[i]));
    return scale > 0 ? most / scale : 0;
}

/* start + (I - Pi)^+ (P - start) into y, the shortest step: where a body that sticks leaves it open
 * it goes nowhere.  false: y stays P. */
static bool newton_step(struct follow *f)
{
    int N = f->N;
    double *d = f->before;
    int rank;

    for (int i = 0; i < N * N; i++)
        f->work[i] = (i % (N + 1) == 0) - f->Pi[i];     /* I - Pi */
    for (int i = 0; i < N; i++)
        d[i] = f->y[i] - f->start[i];                   /* P(y) - y */
    if (f->failed
        || LAPACKE_dgelss_work(LAPACK_COL_MAJOR, N, N, 1, f->work, N, d, N, f->singular, OPEN,
                               &rank, f->svd, f->svd_size)
               != 0)
        return false;
    /* a step longer than the motion is of another one */
    if (!(largest(d, N) <= 2 * fmax(largest(f->y, N), largest(f->start, N))))
        return false;
    for (int i = 0; i < N; i++)
        f->y[i] = f->start[i] + d[i];
    return true;
}

/* Newton's steps while they halve the closure, plain periods in between. */
static enum modal_status close_up(struct follow *f, struct cycle *out, struct modal_error *err)
{
    double before = HUGE_VAL;
    bool stepped = false;
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && !out->closed
           && out->periods < (f->followed ? CYCLE_NEWTON_MOST : CYCLE_PERIODS_MOST)) {
        if (cancelled(f))
            return modal_fail(err, MODAL_CANCELLED, "cancelled");
        /* Newton wants no derivative of a transient */
        f->watching = f->followed && out->periods >= FIRST;
        memcpy(f->start, f->y, (size_t)f->N * sizeof *f->y);
        rc = period(f, err);
        out->periods++;
        /* sliders that chatter, steps that vanish: it does not close */
        if (rc == MODAL_NO_CONVERGENCE)
            return MODAL_OK;
        if (rc != MODAL_OK || out->periods <= FIRST)
            continue;
        out->closure = closure(f);
        out->closed = out->closure <= (f->followed ? CLOSED : STILL)
                      || (stepped && out->closure <= NEARLY && out->closure >= before / 2);
        if (!out->closed)
            stepped = f->followed && (!stepped || out->closure < before / 2) && newton_step(f);
        before = out->closure;                          /* what the next step has to halve */
    }
    return rc;
}

/* The sliders' forces at T into sample J, those that stick by (1); false: one holds with more than
 * it has. */
static bool forces(struct follow *f, double t, int j, double *force)
{
    const double *back = f->small + f->laws * f->laws;        /* what hold_back took out */
    bool within = field(f, t, f->y, f->held, f->before);

    for (int l = 0; within && l < f->laws; l++) {
        /* what hold_back took out, in the laws' order */
        double limit = f->p.law[l].limit, phi = f->held[l] != 0 ? f->held[l] * limit : -*back++;

        force[(size_t)l * CYCLE_SAMPLES + (size_t)j] = phi;
        within = fabs(phi) <= limit * (1 + OVER);
    }
    return within;
}

/* The motion, closed, over one more period, and the forces on it; *KNOWN: these are. */
static enum modal_status sample(struct follow *f, double *x, double *force, bool *known,
                                double *one, struct modal_error *err)
{
    int n = f->ss->n;
    enum modal_status rc = MODAL_OK;

    f->watching = false;
    f->allowed = HUGE_VAL;                       /* one period more: counted, not refused */
    f->tries_allowed = INT64_MAX;
    for (int j = 0; rc == MODAL_OK && j < CYCLE_SAMPLES; j++) {
        statespace_motion(f->ss, f->y, one);      /* displacements of all dofs */
        for (int i = 0; i < n; i++)
            x[(size_t)i * CYCLE_SAMPLES + (size_t)j] = one[i];
        rc = f->stepper->advance(f->stepper, j * f->T / CYCLE_SAMPLES, f->T / CYCLE_SAMPLES, f->y,
                                 err);
        *known = *known && rc == MODAL_OK
                 && forces(f, (j + 1) * f->T / CYCLE_SAMPLES, (j + 1) % CYCLE_SAMPLES, force);
    }
    count_work(f);
    return rc;
}

/* Sliders that never move put where they belong; they act no more than if they had been there from
 * the start. */
static enum modal_status settle(struct follow *f, const struct cycle *c, struct modal_error *err)
{
    bool still[LAWS_MOST] = { false };
    struct offset_motion motion = { CYCLE_SAMPLES, c->x, c->force, still };
    enum modal_status rc = offset_remove(f->ss, f->ports, &motion, err);

    for (int l = 0; l < f->laws; l++)
        f->acts[l] = f->acts[l] && !still[l];
    return rc;
}

/* The multipliers: eigenvalues of Pi. */
static enum modal_status eigenvalues(struct follow *f, double complex *out, struct modal_error *err)
{
    struct matrix A = { f->N, f->N, f->N, f->work };

    memcpy(A.x, f->Pi, (size_t)f->N * (size_t)f->N * sizeof *f->Pi);    /* they destroy it */
    return eigen_by_size(&A, out, err);
}

/* The derivative of the period map at f->y, by differences of STEP of the largest state; f->y is
 * left undefined. */
static enum modal_status difference_map(struct follow *f, double step, const double *y,
                                        struct modal_error *err)
{
    int N = f->N;
    double h = step * fmax(largest(y, N), f->floor), *D = f->Q;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < N; i++)
        for (int side = 1; rc == MODAL_OK && side >= -1; side -= 2) {
            memcpy(f->y, y, (size_t)N * sizeof *y);
            f->y[i] += side * h;                        /* one state disturbed */
            rc = period(f, err);
            for (int k = 0; k < N; k++)
                D[k + (size_t)i * (size_t)N] =
                    (side > 0 ? 0 : D[k + (size_t)i * (size_t)N]) + side * f->y[k] / (2 * h);
        }
    memcpy(f->Pi, D, (size_t)N * (size_t)N * sizeof *D);
    return rc;
}

/* Multipliers of a closed motion beside laws without memory, and their error; *KNOWN false: there
 * are none. */
static enum modal_status difference_multipliers(struct follow *f, struct cycle *out, bool *known,
                                                struct modal_error *err)
{
    double *y = malloc(((size_t)f->N + 1) * sizeof *y);
    double complex *other = malloc(((size_t)f->N + 1) * sizeof *other);
    bool acts[LAWS_MOST];
    enum modal_status rc = y == NULL || other == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "cycle: out of memory")
                               : MODAL_OK;

    *known = false;
    memcpy(acts, f->acts, (size_t)f->laws * sizeof *acts);
    if (rc == MODAL_OK) {
        memcpy(y, f->y, (size_t)f->N * sizeof *y);
        f->watching = false;
        allow(f, 1);
        /* Two differences: their multipliers differ by about the error of either. */
        rc = difference_map(f, LONG, y, err);
        if (rc == MODAL_OK)
            rc = eigenvalues(f, other, err);
        if (rc == MODAL_OK)
            rc = difference_map(f, SHORT, y, err);
        if (rc == MODAL_OK)
            rc = eigenvalues(f, out->multiplier, err);
        *known = rc == MODAL_OK;
        rc = rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
        /* the motion, and what acted on it, as before they were disturbed */
        memcpy(f->y, y, (size_t)f->N * sizeof *y);
        memcpy(f->acts, acts, (size_t)f->laws * sizeof *acts);
    }
    for (int i = 0; *known && i < f->N; i++) {
        double nearest = HUGE_VAL;

        for (int k = 0; k < f->N; k++)
            /* not in order where two are close */
            nearest = fmin(nearest, cabs(out->multiplier[i] - other[k]));
        out->error = fmax(out->error, nearest);
    }
    free(y);
    free(other);
    return rc;
}

/* The multipliers of the motion found, out->states of them: of Pi where disturbances were followed,
 * else by differences where the state is all there is. */
static enum modal_status multipliers(struct follow *f, struct cycle *out, struct modal_error *err)
{
    bool found = false;
    enum modal_status rc = MODAL_OK;

    if (f->followed && !f->failed)
        return eigenvalues(f, out->multiplier, err);
    if (!f->followed && !f->remembers && out->closed && f->N <= CYCLE_DIFFERENCES_MOST)
        rc = difference_multipliers(f, out, &found, err);
    out->states = found ? f->N : 0;
    return rc;
}

/* Frees what F holds, made or half made. */
static void follow_done(struct follow *f)
{
    if (f->stepper != NULL)
        f->stepper->free(f->stepper);
    expm_free(f->exponential);
    ports_free(f->ports);
    sources_free(f->src);
    statespace_free(f->ss);
    workspace_free(&f->space);
    free(f->acts);
}

/* Room of F's sizes, all 0. */
static enum modal_status allocate(struct follow *f, struct modal_error *err)
{
    size_t N = (size_t)f->N, laws = (size_t)f->laws;

    f->svd_size = 8 * f->N + 64;              /* dgelss: 3 N + max(2 N, 1) at least */
    struct { double **x; size_t count; } all[] = {
        { &f->y, N }, { &f->start, N }, { &f->last, N }, { &f->w, (size_t)f->src->nw },
        { &f->load, (size_t)f->ss->n }, { &f->Pi, N * N }, { &f->Q, N * N }, { &f->E, N * N },
        { &f->work, N * N }, { &f->before, N }, { &f->after, N }, { &f->small, laws * (laws + 1) },
        { &f->singular, N }, { &f->svd, (size_t)f->svd_size } };

    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        *all[i].x = workspace_zeros(&f->space, all[i].count, sizeof **all[i].x);
    f->held = workspace_zeros(&f->space, laws, sizeof *f->held);
    f->pivot = workspace_zeros(&f->space, N + laws, sizeof *f->pivot);
    /* What the phase under way holds, and what acted. */
    f->acts = calloc(laws + 1, sizeof *f->acts);
    return f->space.failed || f->acts == NULL
               ? modal_fail(err, MODAL_NO_MEMORY, "cycle: out of memory")
               : MODAL_OK;
}

/*
 * What a try of a step and a map of it cost.  An iteration asks every law at each node and solves
 * for the m STAGES forces there, m of them a node, by a matrix that takes 4 m^3 STAGES^2 more to
 * make, FASTER_BY rows of it twice as fast an operation as few; the step carries N states over.  A
 * map is an exponential a node (collocation.c, (3)): of all states or, where they decouple, of each
 * mode by itself.
 */
void cycle_price(const struct ports *p, int sources, double *try_work, double *map_work)
{
    const struct statespace *ss = p->ss;
    double m = p->channels, S = COLLOCATION_STAGES, size = m * S, driven = S + sources;
    double iteration = S * p->laws * BUDGET_SAMPLE
                       + (4 * m * size * size + 2.0 / 3 * size * size * size)
                         / (BUDGET_DENSE * (1 + size / FASTER_BY));

    *try_work = SOLUTIONS_OF_STEP * ITERATIONS_OF_STEP * iteration
                + 2.0 * ss->N * (ss->N + 3 * size) / BUDGET_DENSE;
    *map_work = S
                * (ss->modal ? ss->n * exponential_work(2 + (int)driven)
                             : exponential_work(ss->N + (int)size + sources));
}

/* The stepper of F's program and what disturbances need. */
static enum modal_status follow_init(struct follow *f, struct modal_error *err)
{
    struct stepper_options how = { .dt = f->T / STEPS,
                                   .tolerance = TOLERANCE,
                                   .cancelled = spent,
                                   .context = f,
                                   .accepted = watch,
                                   .watcher = f };
    enum modal_status rc = statespace_new(&f->p, &f->ss, err);

    if (rc == MODAL_OK)
        rc = sources_new(&f->p, true, &f->src, err);
    if (rc == MODAL_OK)
        rc = ports_new(f->ss, &f->ports, err);
    if (rc == MODAL_OK)
        rc = nonlinear_stepper_new(f->ss, f->src, &how, &f->stepper, err);
    if (rc != MODAL_OK)
        return rc;
    f->N = f->ss->N;
    /* Friction's strength alone, over a period: what a motion is compared with. */
    for (int l = 0; l < f->laws; l++)
        if (f->p.law[l].kind->set_valued)
            f->floor =
                fmax(f->floor, NO_MOTION * f->p.law[l].limit * largest(pull(f, l), f->N) * f->T);
    cycle_price(f->ports, f->src->nw, &f->try_work, &f->map_work);
    rc = expm_new(f->N, &f->exponential, err);
    return rc == MODAL_OK ? allocate(f, err) : rc;
}

bool cycle_takes(const struct program *p)
{
    bool rigid = false;

    for (int l = 0; l < p->laws; l++) {
        rigid |= p->law[l].kind->set_valued;
        if (p->law[l].kind->restart != NULL)
            return false;
    }
    return rigid && p->laws <= LAWS_MOST && 2 * p->n + p->n_linear <= CYCLE_STATES_MOST;
}

enum modal_status cycle_find(const struct program *p, double omega, const double *x0,
                             const double *v0, const struct cycle_options *opt, struct cycle *out,
                             struct modal_error *err)
{
    struct follow f = {
        .p = *p, .opt = opt, .laws = p->laws, .T = TWO_PI / omega, .followed = p->harmonics == 0
    };
    double *rest = calloc(2 * (size_t)p->n + 1, sizeof *rest);
    bool known;
    enum modal_status rc =
        rest == NULL ? modal_fail(err, MODAL_NO_MEMORY, "cycle: out of memory") : MODAL_OK;

    memset(out, 0, sizeof *out);
    for (int l = 0; l < p->laws; l++) {
        f.followed &= p->law[l].kind->set_valued;
        f.remembers |= p->law[l].memory > 0;
    }
    known = f.followed;                                 /* forces of laws beside are not sampled */
    f.p.omega = omega;                              /* the program is of another frequency, maybe */
    f.p.period = f.T;
    f.p.x0 = x0 != NULL ? (double *)x0 : rest;          /* read only, by statespace_start */
    f.p.v0 = v0 != NULL ? (double *)v0 : rest;
    if (rc == MODAL_OK)
        rc = follow_init(&f, err);
    if (rc == MODAL_OK) {
        statespace_start(f.ss, f.y);
        allow(&f, SHARE_TO_CLOSE);
        rc = close_up(&f, out, err);
    }
    /* Half done or not, out owns what it has: cycle_done frees it. */
    out->states = f.N;
    out->x = calloc((size_t)p->n * CYCLE_SAMPLES + 1, sizeof *out->x);
    out->force = calloc((size_t)p->laws * CYCLE_SAMPLES + 1, sizeof *out->force);
    out->multiplier = calloc((size_t)f.N + 1, sizeof *out->multiplier);
    if (rc == MODAL_OK && (out->x == NULL || out->force == NULL || out->multiplier == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "cycle: out of memory");
    if (rc == MODAL_OK)
        rc = multipliers(&f, out, err);
    if (rc == MODAL_OK && out->closed)
        rc = sample(&f, out->x, out->force, &known, rest, err);
    if (rc == MODAL_OK && out->closed && known)
        rc = settle(&f, out, err);
    if (!known || !out->closed) {
        free(out->force);
        out->force = NULL;
    }
    out->acts = f.acts;
    f.acts = NULL;
    out->evaluations = f.stepper != NULL ? (long)f.stepper->steps : 0;
    follow_done(&f);
    free(rest);
    if (rc != MODAL_OK)
        cycle_done(out);
    return rc;
}

void cycle_done(struct cycle *c)
{
    free(c->x);
    free(c->force);
    free(c->multiplier);
    free(c->acts);
    memset(c, 0, sizeof *c);
}
