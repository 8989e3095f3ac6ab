/* ambient_lift.h - the samples of each period side by side: a periodic system as a constant one,
 * where all of it keeps to the angle, whose speed may wander (see ambient_lift.c) */
#ifndef MODAL_AMBIENT_LIFT_H
#define MODAL_AMBIENT_LIFT_H
#include <complex.h>
#include "base/error.h"
#include "modal/identify/result.h"
#include "modal/linalg/matrix.h"

/* Whole periods of Y (samples x channels), less the mean of each phase: what repeats with the
 * period.  Rows beyond them go; a channel of which rounding is left becomes zero. */
void ambient_lift_settle(struct matrix *Y, int phases);

/* *out, the caller's: periods x (phases channels), sample k of a period of channel s in column
 * k + phases s; of the first ROWS samples of Y.  Fails with MODAL_NO_MEMORY. */
enum modal_status ambient_lift(const struct matrix *Y, int rows, int phases, struct matrix *out,
                               struct modal_error *err);

/* What moves at the exponent TURN a period, of one channel's phases that a mode moves by B. */
double complex ambient_lift_component(const double complex *b, int phases, double complex turn);

/* m->harmonics, resolved_k, runner_up and resolved, of a mode whose exponent is known and that
 * moves phase k of channel s by b[k + phases s].  Fails with MODAL_NO_MEMORY. */
enum modal_status ambient_lift_resolve(const double complex *b, int phases, int channels,
                                       double period, struct identify_mode *m,
                                       struct modal_error *err);
#endif
