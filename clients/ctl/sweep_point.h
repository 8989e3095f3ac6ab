/* sweep_point.h - a point of a sweep's result as its tables show it */
#ifndef CTL_SWEEP_POINT_H
#define CTL_SWEEP_POINT_H
#include "base/json.h"

/* NAN and "": there is no motion */
struct sweep_amplitude { double size; const char *dof; };
/* The largest |X_k|, k >= 1, of POINT over the dofs reported, and whose. */
struct sweep_amplitude sweep_amplitude(const cJSON *point);

/* The value of AXIS, the I-th of the grid, at POINT. */
double sweep_value(const cJSON *axis, const cJSON *point, int i);

/* Why POINT failed, or was not converged to; "": neither.  The text is the result's. */
const char *sweep_failure(const cJSON *point);

/* The exit status of RESULT, 1 where points of a sweep failed, which stderr is told: how many, and
 * what the first one's error is.  Of other kinds 0. */
int sweep_exit(const cJSON *result);
#endif
