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

/* What NAME says behind a word for time, such as " [s]" of "Time [s]" or "_ms" of "t_ms"; NULL: it
 * is no name of times. */
const char *steps_behind_time(const char *name);
/* The unit of time in TEXT, such as "[ms]" or "_min"; "s" for the second however it is written, "":
 * none.  Of "ms since 2020-01-01" it is the first word. */
const char *steps_unit(const char *text);
/* As steps_unit, of a sampling rate: "Hz", "kHz", "MHz", "mHz", "GHz" or "". */
const char *steps_rate_unit(const char *text);
/* MODAL_BAD_INPUT, field "time", where UNIT is neither "s" nor "": times that WHAT says in it are
 * another step than they seem, and OPTIONS do not pass them over. */
enum modal_status steps_unit_check(const char *unit, const char *path, const char *what,
                                   const struct signals_options *options, struct modal_error *err);

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
