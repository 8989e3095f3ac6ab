/* scene_jobs.h - the kinds on a scene that need no steady state: simulate, floquet, ablate */
#ifndef JOB_SCENE_JOBS_H
#define JOB_SCENE_JOBS_H
#include "job/job.h"

struct floquet;

/* Options: integrator (auto, rk4), tolerance (auto: of a step, relative), substeps (rk4: of dt), without (numbers of effects left
 * out).  The signals come in job_result.batch. */
enum modal_status simulate_run(const struct job_request *request, struct job_result *out, struct modal_error *err);

/* Options: tolerance (of the monodromy matrix), hill (bool, default true where periodic), hill.harmonics. */
enum modal_status floquet_run(const struct job_request *request, struct job_result *out, struct modal_error *err);

/* Into R: `period` and `multipliers`, where F has a period, and `exponents`; null where not
 * resolved. */
void floquet_values(cJSON *r, const struct floquet *f);

/* What F says of stability, as the `stability` of a result; `stable` null: its error bar does not decide.  The caller's. */
cJSON *floquet_stability(const struct floquet *f);

/* Options: those of steady, where the scene has an excitation. */
enum modal_status ablate_run(const struct job_request *request, struct job_result *out, struct modal_error *err);

#endif
