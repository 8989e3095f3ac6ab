/* rows.h - rows of numbers from a pipe, each as it comes
 *
 * What stands before them (a preamble, names, units) and which column is time are told as in a file
 * of text (csv.h), by the first rows: by 64 of them, or as soon as there is one below a line of
 * names where the step is given.
 */
#ifndef CTL_ROWS_H
#define CTL_ROWS_H
#include "signals.h"

struct rows;

enum rows_state { ROWS_ROW, ROWS_NONE_YET, ROWS_END };

/*
 * Read FD (borrowed, as are PATH, for messages, and OPTIONS) until it is known what its rows are;
 * *HEAD has those that came until then, and signals_done frees it.  Fails as signals_read, and
 * MODAL_TOO_LARGE: no row in the first MiB.
 */
enum modal_status rows_open(int fd, const char *path, const struct signals_options *options,
                            struct rows **out, struct signals *head, struct modal_error *err);

/*
 * The next row's channels into X, which has room for one more, waiting for WAIT_MS at most.
 * MODAL_BAD_INPUT: a row of other columns, not numbers, or a time (field "time") that is not a step
 * behind the last.
 */
enum modal_status rows_next(struct rows *rows, double *x, int wait_ms, enum rows_state *state,
                            struct modal_error *err);
void rows_close(struct rows *rows);

#endif
