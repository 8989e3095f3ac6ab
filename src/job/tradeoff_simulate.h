/* tradeoff_simulate.h - a simulation's error against its time */
#ifndef JOB_TRADEOFF_SIMULATE_H
#define JOB_TRADEOFF_SIMULATE_H
#include "job/job.h"

/*
 * `tradeoff` of `simulate` on a scene.  Rungs: the class's own integrator at falling tolerances, classical Runge-Kutta at
 * rising substeps, and each effect left out; errors are max |x - ref| / max |ref| over all samples, channel by channel,
 * the worst.  Reference: the own integrator at the tolerance 1e-13.  Options: repetitions, target.error,
 * target.seconds.
 */
enum modal_status tradeoff_simulate(const struct job_request *request, struct job_result *out, struct modal_error *err);

#endif
