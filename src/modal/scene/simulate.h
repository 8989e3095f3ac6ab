/* simulate.h - a program's motion from its initial state, read out at equal steps */
#ifndef MODAL_SIMULATE_H
#define MODAL_SIMULATE_H
#include <stdbool.h>
#include "modal/scene/program.h"
#include "modal/scene/scene.h"

enum { SIMULATE_VALUES_MOST = 200000000 };    /* samples x channels: 1.6 GB */

struct simulate_options {
    double tolerance;                          /* see stepper.h; 0: the default of the class */
    /* classical Runge-Kutta steps dt / substeps in place of the class's own */
    bool rk4;
    int substeps;
    int64_t steps_most;                        /* see stepper.h */
    bool leaps;                                /* by sparse_motion.h, which serves */
    bool (*cancelled)(void *context);          /* asked every few thousand samples; may be NULL */
    void (*progress)(void *context, double fraction);    /* may be NULL */
    void *context;
};

struct simulate_result {
    const char *integrator;
    int64_t products, maps, steps, rejected;   /* see stepper.h */
};

/*
 * Samples k = 0 .. time->samples - 1 at time->start + k dt of the program's outputs into SIGNALS,
 * which holds samples x outputs numbers, sample by sample.  The motion starts at t = 0; corners of
 * the excitation and impulses are hit exactly.  What laws did is written into program.effect
 * (evaluations, active).
 *
 * Fails with MODAL_OVERFLOW (the text says when the motion left the range of doubles),
 * MODAL_TOO_LARGE, MODAL_CANCELLED, MODAL_NO_CONVERGENCE, MODAL_ELEMENT_FAILED, MODAL_NO_MEMORY.
 */
enum modal_status simulate(struct program *p, const struct scene_time *time,
                           const struct simulate_options *opt, double *signals,
                           struct simulate_result *out, struct modal_error *err);

#endif
