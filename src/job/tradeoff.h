/* tradeoff.h - a job's error against its time, over a ladder of settings: kind `tradeoff`
 *
 * A batch is traded off by identify; a scene by what the option `of` names.  Each is a row of the
 * table in tradeoff.c and a function in a file of its own, which climbs by modal/ladder.h and
 * prints with tradeoff_print.
 */
#ifndef JOB_TRADEOFF_H
#define JOB_TRADEOFF_H
#include "job/job.h"
#include "modal/ladder.h"

/* The kind `tradeoff`: looks up `of` and runs its row. */
enum modal_status tradeoff_run(const struct job_request *request, struct job_result *out,
                               struct modal_error *err);

/*
 * The document of contracts.md: {"kind":"tradeoff", "of", "reference",
 * "rungs":[{"settings","error","seconds","pareto"}], "recommended"}.  SETTINGS[i] is rung i's
 * options, as they can be pasted back; it and REFERENCE (what errors are measured against:
 * settings, or text) become the document's, also on failure.  A rung that did not run has error and
 * (unless forecast) seconds null.
 */
enum modal_status tradeoff_print(const char *of, cJSON *reference, cJSON **settings,
                                 const struct ladder_rung *rungs, int count, int recommended,
                                 cJSON **out, struct modal_error *err);

/* Tell REQUEST's owner that rung I of RUNGS is about to run. */
void tradeoff_tell(const struct job_request *request, int i, int rungs);

/* Processor seconds of this process, all its threads: the clock of ladders. */
double tradeoff_clock(void *context);
#endif
