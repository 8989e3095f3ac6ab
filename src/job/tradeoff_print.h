/* tradeoff_print.h - what every tradeoff has: its document, its progress and its clock */
#ifndef JOB_TRADEOFF_PRINT_H
#define JOB_TRADEOFF_PRINT_H
#include "job/job.h"
#include "modal/ladder.h"

/*
 * The document: {"kind":"tradeoff", "of", "reference",
 * "rungs":[{"settings","error","seconds","pareto"}], "recommended"}.  SETTINGS[i] is rung i's
 * options, as they can be pasted back; it and REFERENCE (what errors are measured against:
 * settings, or text) become the document's, also on failure.  A rung that did not run has error and
 * (unless forecast) seconds null.
 */
enum modal_status tradeoff_print(const char *of, cJSON *reference, cJSON **settings,
                                 const struct ladder_rung *rungs, int count, int recommended,
                                 cJSON **out, struct modal_error *err);

/* Tell REQUEST's owner that rung I of RUNGS is about to run. */
void tradeoff_report(const struct job_request *request, int i, int rungs);

/* Processor seconds of this process, all its threads: the clock of ladders. */
double tradeoff_clock(void *context);
#endif
