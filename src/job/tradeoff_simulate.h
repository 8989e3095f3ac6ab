/* tradeoff_simulate.h - a simulation's error against its time */
#ifndef JOB_TRADEOFF_SIMULATE_H
#define JOB_TRADEOFF_SIMULATE_H
#include "base/key_table.h"
#include "job/job.h"

/* Its options. */
extern const struct key_row tradeoff_simulate_rows[];

/*
 * `tradeoff` of `simulate` on a scene.  Rungs: the class's own integrator at falling tolerances,
 * each effect left out, half and twice the elements, the orders of inflow beside the scene's own,
 * classical Runge-Kutta at rising substeps; errors are max |x - ref| / max |ref| over all samples,
 * channel by channel, the worst.  Reference: the scene as it stands by the own integrator at the
 * tolerance 1e-13, so that a finer mesh's error is what the scene's own leaves out.
 */
enum modal_status tradeoff_simulate(const struct job_request *request, struct job_result *out,
                                    struct modal_error *err);

#endif
