/* curve.h - steady states over a parameter: swept in steps, or followed around folds */
#ifndef JOB_CURVE_H
#define JOB_CURVE_H
#include "job/job.h"

struct cost;
struct program;
struct steady_settings;

/* Values of the number of the scene at PATH. */
struct curve_range { char path[128]; double from, to; int count; };

/* TEXT, the value of option FIELD: PATH=A:B, and :N where COUNTED.  MODAL_BAD_INPUT. */
enum modal_status curve_range_read(const char *text, const char *field, bool counted,
                                   struct curve_range *range, struct modal_error *err);
/* Tells REQUEST of a point at VALUE, FRACTION of all done; STABLE: 1, -1 unstable, 0 not told. */
void curve_report(const struct job_request *request, const struct curve_range *range,
                  double fraction, double value, bool converged, double amplitude, int stable);
/* Of a counted range, value I of `count`. */
double curve_range_at(const struct curve_range *range, int i);

/* The document {"kind":"curve", "parameter", "points", "folds", "bifurcations"} for
 * settings->sweep or ->follow; P is the scene lowered, and gets the effects' counts. */
enum modal_status curve_run(const struct job_request *request, struct program *p,
                            struct steady_settings *settings, struct cost *cost, cJSON **doc,
                            struct modal_error *err);
#endif
