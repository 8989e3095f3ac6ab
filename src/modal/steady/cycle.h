/* cycle.h - a periodic motion under rigid friction, followed from event to event
 *
 * Harmonic balance has no force to sample where rigid friction holds a body: it is whatever the
 * balance asks for.  Time integration has: a body slips, stops, sticks and breaks loose at located
 * instants (nonlinear_stepper.c), and between them the motion is solved exactly.  The motion that
 * repeats after a period is found by Newton's method on that map. */
#ifndef MODAL_CYCLE_H
#define MODAL_CYCLE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct budget;
struct ports;
struct program;

enum {
    CYCLE_STATES_MOST = 120,        /* chosen: each step has a dense exponential */
    CYCLE_SAMPLES = 8192,           /* eight times the most harmonics of by_cycle.c */
    CYCLE_NEWTON_MOST = 150,        /* periods, chosen: Newton's method takes tens or never ends */
    CYCLE_PERIODS_MOST = 600,       /* marched alone: a decay of 1 % a period falls by 400 */
    CYCLE_DIFFERENCES_MOST = 32     /* states, chosen: a period of its own for each, twice */
};

struct cycle {
    bool closed;                  /* it repeats */
    int periods;                  /* marched */
    double closure;               /* |y(T) - y(0)| / max |y| */
    double *x;                    /* where closed: x[dof * CYCLE_SAMPLES + j] at t = j T /
                                   * CYCLE_SAMPLES; the caller frees by cycle_done */
    double *force;                /* where x is and the disturbances are followed: of law l at
                                   * the same instants, [l * CYCLE_SAMPLES + j]; sticking, what
                                   * holds the body, within `limit` (1 + 1e-6) of it; else NULL */
    int states;                   /* of the multipliers; 0: not known (a law beside has a memory,
                                   * or more states than are differenced) */
    double complex *multiplier;   /* |.| descending */
    double error;                 /* of the multipliers, where they are of differences: beside
                                   * other laws or periodic matrices */
    bool *acts;                   /* per law: slips, touches, ... somewhere in the period */
    long evaluations;             /* of every law */
};

/* What ends the search before it is found. */
struct cycle_options {
    bool (*cancelled)(void *context);     /* may be NULL */
    void *context;
    struct budget *budget;                /* where the steps are counted, and whose half they may
                                           * spend until the motion closes; NULL: nowhere, and
                                           * without limit */
};

/* Whether P is of the kind followed here: rigid friction among its laws, none of them a user's, few
 * states. */
bool cycle_takes(const struct program *p);

/*
 * The motion of P (cycle_takes) at OMEGA that is reached from displacements X0 and rates V0 by dof
 * (NULL: from rest).  Not to close within CYCLE_NEWTON_MOST periods, or beside other laws
 * CYCLE_PERIODS_MOST, or the budget is an answer.  Fails with MODAL_NO_MEMORY, MODAL_CANCELLED or
 * MODAL_OVERFLOW.
 */
enum modal_status cycle_find(const struct program *p, double omega, const double *x0,
                             const double *v0, const struct cycle_options *opt, struct cycle *out,
                             struct modal_error *err);
/* Operations (budget.h) that a try of a step costs through PORTS, beside SOURCES states of loads,
 * and a map of it. */
void cycle_price(const struct ports *ports, int sources, double *try_work, double *map_work);
/* Frees what C holds. */
void cycle_done(struct cycle *c);
#endif
