/* scene_jobs.h - the kinds on a scene that need no steady state: simulate, floquet, ablate */
#ifndef JOB_SCENE_JOBS_H
#define JOB_SCENE_JOBS_H
#include "base/key_table.h"
#include "job/job.h"

struct floquet;

/* Options: simulate_option_rows.  The signals come in job_result.batch. */
extern const struct key_row simulate_option_rows[];
enum modal_status simulate_run(const struct job_request *request, struct job_result *out,
                               struct modal_error *err);

/* What a monodromy matrix may be asked for. */
#define FLOQUET_TOLERANCE_LEAST 1e-14    /* below, rounding of its entries is all there is */
#define FLOQUET_TOLERANCE_MOST 1e-2      /* above, not a digit of it holds */

/* Options: floquet_option_rows. */
extern const struct key_row floquet_option_rows[];
enum modal_status floquet_run(const struct job_request *request, struct job_result *out,
                              struct modal_error *err);

/* Into R: `period` and `multipliers`, where F has a period, and `exponents`; null where not
 * resolved. */
void floquet_values(cJSON *r, const struct floquet *f);

/* What F says of stability, as the `stability` of a result; `stable` null: its error bar does not
 * decide.  The caller's. */
cJSON *floquet_stability(const struct floquet *f);

/* Options: those of steady, where the scene has an excitation, else ablate_option_rows. */
extern const struct key_row ablate_option_rows[];
enum modal_status ablate_run(const struct job_request *request, struct job_result *out,
                             struct modal_error *err);

#endif
