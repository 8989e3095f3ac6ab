/* curve.h - steady states over a parameter: swept in steps, or followed around folds */
#ifndef JOB_CURVE_H
#define JOB_CURVE_H
#include "job/job.h"

struct cost;
struct program;
struct steady_settings;

/* The document {"kind":"curve", "parameter", "points", "folds", "bifurcations"} for
 * settings->sweep or ->follow; P is the scene lowered, and gets the effects' counts. */
enum modal_status curve_run(const struct job_request *request, struct program *p,
                            struct steady_settings *settings, struct cost *cost, cJSON **doc,
                            struct modal_error *err);
#endif
