/* backbone.h - nonlinear modes: extended periodic motions, frequency, damping and energy over
 * amplitude
 *
 *     M x'' + (C - 2 zeta omega M) x' + K x + sum_laws f(d, d', memory) = 0                     (1)
 *
 * is periodic at omega for one zeta where the damping that is added back makes up for what the
 * motion loses [K15]: zeta is the modal damping ratio at that amplitude, omega the modal
 * frequency. */
#ifndef MODAL_BACKBONE_H
#define MODAL_BACKBONE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct program;

enum { BACKBONE_UNKNOWNS_MOST = 3000 };   /* a full matrix of 72 MB, factored in seconds */

struct backbone;

struct backbone_point {
    bool converged;
    int iterations;
    double amplitude;             /* a: X_1^H M X_1 = a^2, as a times a mode of unit modal mass
                                   * has it */
    double omega;                 /* rad/s */
    double damping_ratio;         /* positive decays */
    double energy;                /* J: the largest kinetic energy of the period; without
                                   * damping, of a motion about 0, the whole energy */
    double step, residual;        /* relative: of the last Newton step, of (1) */
    const double complex *X;      /* [dof (H+1) + k], the session's, until its next call; X_1 of
                                   * the mode's largest dof is real */
};

/*
 * Mode MODE (from 1, ascending frequency of the motion linearised at rest: sliders stuck) of P
 * (borrowed), on H harmonics and N samples (0: enough).  Loads are left out.  Fails with
 * MODAL_BAD_INPUT (field "backbone": no such mode, rigid friction, a user's law, periodic matrices,
 * linear states, laws that read time, a matrix that is not symmetric positive), MODAL_TOO_LARGE,
 * MODAL_NO_MEMORY.
 */
enum modal_status backbone_new(const struct program *p, int mode, int H, int N,
                               struct backbone **out, struct modal_error *err);
/* Frees B and all that it made; NULL is none. */
void backbone_free(struct backbone *b);
/* rad/s and damping ratio of the linear mode. */
double backbone_linear(const struct backbone *b, double *damping_ratio);

/* How often law LAW has been evaluated up to the last motion looked at. */
long backbone_evaluations(const struct backbone *b, int law);
/* Whether law LAW slipped or touched in it. */
bool backbone_acts(const struct backbone *b, int law);

/* The motion of amplitude A, from the last one found or, at first, the linear mode.  No convergence
 * is an answer. */
enum modal_status backbone_at(struct backbone *b, double a, struct backbone_point *out,
                              struct modal_error *err);

/*
 * The next motion along the curve by its length ((4) of backbone.c), after backbone_at or the last
 * of these: folds of the amplitude are gone round, so that tongues of internal resonance are run
 * through to their ends.  It sets out in the direction of amplitude TO, and where it crosses TO, or
 * comes to it first, it is the motion of that amplitude.  No convergence, with steps as short as
 * may be, is an answer.
 */
enum modal_status backbone_next(struct backbone *b, double to, struct backbone_point *out,
                                struct modal_error *err);
#endif
