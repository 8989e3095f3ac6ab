/* result_show.h - a result as it was asked for: --json, --csv, --plot, or a table to read */
#ifndef CTL_RESULT_SHOW_H
#define CTL_RESULT_SHOW_H
#include "input.h"

/* Do --json, --csv and --plot of ARGS go together, and can the picture be written?  Asked before
 * the work is done; else MODAL_BAD_INPUT, field "plot" or "csv". */
enum modal_status result_show_check(const struct args *args, struct modal_error *err);

/* Say RESULT.  INPUT is what it ran on; NULL: not at hand.  Fails as plot_result
 * and result_csv do; MODAL_IO. */
enum modal_status result_show(const struct args *args, const cJSON *result,
                              const struct input *input, struct modal_error *err);
#endif
