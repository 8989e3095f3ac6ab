/* result_lines.h - the results of many jobs: a line of JSON each, or one table */
#ifndef CTL_RESULT_LINES_H
#define CTL_RESULT_LINES_H
#include <stdbool.h>
#include "base/error.h"
#include "base/json.h"

/* All zero but `csv`: nothing was said yet. */
struct result_lines {
    bool csv;       /* the tables, one below the other, in place of the documents */
    bool begun;     /* its heading stands */
    int status;     /* the exit status of the last job without a result; 0: all have one */
};

/* {"line", "job", "result"}, or RESULT's rows with NAME in the first column.  Fails as result_csv
 * and outcome_json do. */
enum modal_status result_lines_add(struct result_lines *lines, long number, const char *name,
                                   cJSON *result, struct modal_error *err);
/* {"line", "job", "error"}, or, with csv, a line on stderr: ERR is why there is no result. */
enum modal_status result_lines_fail(struct result_lines *lines, long number, const char *name,
                                    const cJSON *detail, struct modal_error *err);
#endif
