/* steps.h - times of samples, and the step that they keep
 *
 * Time t_k, k = 0 .. n-1, is taken as t_0 + k dt with dt = (t_{n-1} - t_0) / (n - 1); the deviation
 * is max_k |t_k - t_0 - k dt| / dt, in steps.  A file is refused where it passes STEPS_UNEVEN_MOST:
 * a sample displaced by a part d of a step is wrong by about omega dt d of its amplitude.
 */
#ifndef CTL_FILES_STEPS_H
#define CTL_FILES_STEPS_H
#include "ctl/signals.h"

/* Time is even if no sample is further than this part of a step from its place. */
#define STEPS_UNEVEN_MOST 1e-3

/* The deviation of t[0], t[stride], ..., N of them, and *DT; HUGE_VAL where they do not grow. */
double steps_deviation(const double *t, size_t n, size_t stride, double *dt);
/* The first whose time is not after the one before, or 0. */
size_t steps_turn_back(const double *t, size_t n, size_t stride);

/*
 * The step of OUT by the N times T, which WHAT names ("column 1", "its array `time`") and whose
 * numbers are good to the part DIGITS of them (0: doubles).  MODAL_BAD_INPUT: uneven, field "time",
 * or "dt" where OPTIONS have one.
 */
enum modal_status steps_read(const double *t, size_t n, double digits, const char *path,
                             const char *what, const struct signals_options *options,
                             struct signals *out, struct modal_error *err);

/* Refuse uneven times as steps_read does, for who has found the deviation OFF. */
enum modal_status steps_refuse(const double *t, size_t n, size_t stride, double off,
                               const char *path, const char *what,
                               const struct signals_options *options, struct modal_error *err);
#endif
