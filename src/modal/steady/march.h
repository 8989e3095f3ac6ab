/* march.h - steady states by time integration, for comparison: fixed and adaptive Runge-Kutta run
 * to periodicity, shooting */
#ifndef MODAL_MARCH_H
#define MODAL_MARCH_H
#include <stdbool.h>
#include "base/error.h"

struct program;

enum march_method { MARCH_RK4, MARCH_ADAPTIVE, MARCH_SHOOTING };
enum {
    MARCH_DOFS_MOST = 400,        /* a comparison: dense products at each step */
    MARCH_PERIODS_MOST = 4000,    /* a damping ratio of 1e-3 decays by 1e-11 in as many */
};

struct march_options {
    enum march_method method;
    int samples;              /* steps a period (rk4, shooting); samples given back (adaptive) */
    double tolerance;         /* adaptive: of a step, relative to the largest motion;
                               * periodicity: the same */
    double periodic;          /* end when a period's samples differ from the last's by less than
                               * this, relative */
    bool (*cancelled)(void *context);
    void *context;
};

struct march_report {
    bool converged;
    int periods;
    double change;            /* of the last period against the one before, relative */
    long evaluations;         /* of every law */
};

/* March P at OMEGA from rest; the samples of the last period, x[dof * samples + j].  Fails with
 * MODAL_BAD_INPUT (a singular mass, linear states, rigid friction), MODAL_TOO_LARGE,
 * MODAL_OVERFLOW, MODAL_CANCELLED, or as a law does. */
enum modal_status march_run(const struct program *p, double omega, const struct march_options *opt,
                            double *x, struct march_report *report, struct modal_error *err);
#endif
