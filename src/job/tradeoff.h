/* tradeoff.h - a job's error against its time, over a ladder of settings: kind `tradeoff`
 *
 * A batch is traded off by identify; a scene by what the option `of` names.  Each is a row of the
 * table in tradeoff.c and a function in a file of its own, which climbs by modal/ladder.h and
 * prints with tradeoff_print.
 */
#ifndef JOB_TRADEOFF_H
#define JOB_TRADEOFF_H
#include "job/job.h"

/* The kind `tradeoff`: looks up `of` and runs its row. */
enum modal_status tradeoff_run(const struct job_request *request, struct job_result *out,
                               struct modal_error *err);
#endif
