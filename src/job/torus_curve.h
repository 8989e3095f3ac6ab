/* torus_curve.h - steady states under several tones over one number: a tone or one of the scene */
#ifndef JOB_TORUS_CURVE_H
#define JOB_TORUS_CURVE_H
#include "job/job.h"

struct cost;
struct program;
struct steady_settings;

/* The document of curve.h for settings->sweep or ->follow under SETTINGS' tones: points, a followed
 * branch's folds, no bifurcations.  P is the scene lowered, and gets the effects' counts.
 * MODAL_BAD_INPUT, field `sweep` or `continue`, for a place that is none; else as torus_run. */
enum modal_status torus_curve(const struct job_request *request, struct program *p,
                              const struct steady_settings *settings, struct cost *cost,
                              cJSON **doc, struct modal_error *err);
#endif
