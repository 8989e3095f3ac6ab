/* regime_events.h - the first instant within a step at which a law leaves its smooth piece */
#ifndef MODAL_REGIME_EVENTS_H
#define MODAL_REGIME_EVENTS_H
#include "modal/scene/collocation.h"
#include "modal/scene/ports.h"

struct event {
    double theta;                /* of the step, 0 .. limit; HUGE_VAL: none */
    int law;                     /* whose it is; -1: none */
};

/*
 * A step from t of length h has been solved: KNOTS holds the probes (2 x probes numbers each) at
 * the start and at the nodes, PHI the channels' forces at the nodes, MEMORY what laws remember at
 * the start, QUIET and BLUR each channel's rate and displacement that may be rounding, HOLD each
 * stuck slider's exact force at the start (NaN: unknown).  Looks up to theta = LIMIT (a little past
 * 1, on the same interpolant) and sets *OUT.
 */
enum modal_status events_find(struct ports *p, const struct collocation *c, double t, double h,
                              const double *knots, const double *phi, const double *memory,
                              const double *quiet, const double *blur, const double *hold,
                              double limit, struct event *out, struct modal_error *err);

#endif
