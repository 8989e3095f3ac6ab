/* iterate.h - the solvers of one balance from one start: direct iteration and Newton's method
 *
 * Both end at an answer whether or not they converge: the best iterate, how far it is, and why they
 * stopped.  The residual is relative to the largest force that acts, a step to each dof's own
 * motion, so that neither depends on units. */
#ifndef MODAL_ITERATE_H
#define MODAL_ITERATE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct balance;

struct iterate_options {
    double tolerance;         /* of the relative step; 0: 1e-12 */
    int most;                 /* iterations; 0: 60 */
    double relaxation;        /* direct iteration: new = relaxation * new + ...; 0: 1 */
    bool rough;               /* Newton: a start for another balance; the residual at its end is
                               * not looked at */
    bool evaluated;           /* Newton: the balance's last residual is that of the start */
    bool by_differences;      /* Newton: the derivative by central difference quotients of the
                               * residual */
    double cutoff;            /* Newton: only harmonics with |X_k| >= cutoff * largest, the rest
                               * by (7); 0: all */
    double slope;             /* the laws' largest, N/m, where another balance has shown it; 0:
                               * an evaluation shows it */
    bool (*cancelled)(void *context);
    void *context;
};

struct iterate_report {
    bool converged;
    int iterations;
    double step;              /* the last, relative */
    double residual;          /* relative */
    bool open;                /* converged, with a direction in which the motion may be moved: a
                               * body that nothing holds in place */
    double bend;              /* Newton: h_0 of iterate.c (4), below 2 where nothing lies between
                               * start and end; HUGE_VAL where a step was not taken whole */
    const char *reason;       /* why it ended, where not converged; static text */
};

/*
 * Direct iteration, [CG89] (7): S_k X_k <- p_k - F_k(X) - T_k(X), S_k factored once.  X is start
 * and end: the best iterate.  An S_k singular to rounding is a reason not to converge.  Fails as
 * aft_force does, or MODAL_CANCELLED.
 */
enum modal_status iterate_direct(struct balance *b, const struct iterate_options *opt,
                                 double complex *X, struct iterate_report *report,
                                 struct modal_error *err);
/* The gain that (7) multiplies an error by, at most: max_k |S_k^-1| times the laws' slope; HUGE_VAL
 * where S_k is singular. */
double iterate_gain(const struct balance *b, double slope);

/* The HJ < 2 H / 3 past which harmonics have a gain SLOPE / |S_k| so small that (7) serves them as
 * well as Newton's method; H where there is none.  SLOPE of the laws, 0: that of the last force. */
int iterate_order(const struct balance *b, double slope);

/* Newton's method, damped until the simplified step shrinks [D04]. */
enum modal_status iterate_newton(struct balance *b, const struct iterate_options *opt,
                                 double complex *X, struct iterate_report *report,
                                 struct modal_error *err);
#endif
