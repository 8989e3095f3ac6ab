/* result_csv.h - --csv: the table of a result, a line each, with a header */
#ifndef CTL_RESULT_CSV_H
#define CTL_RESULT_CSV_H
#include <stdio.h>
#include "base/error.h"
#include "base/json.h"

/*
 * Print to TO the modes of an identification (frequency_hz, frequency_hz_std, damping_ratio,
 * damping_ratio_std, re, im, amplitude, residual, k) or the points of a sweep; a number that is not
 * known is an empty cell.  JOB (NULL: none) is a first column of its own, whose header stands only
 * where HEADER is.  MODAL_BAD_INPUT, field "csv": a kind that has no such table; MODAL_IO.
 */
enum modal_status result_csv(FILE *to, const cJSON *result, const char *job, bool header,
                             struct modal_error *err);
#endif
