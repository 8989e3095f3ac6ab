/* csv.h - columns of numbers in text, as signals
 *
 * Separators: ';' or tab (decimals then with ',' or '.'), ',', or blanks.  Lines that begin with #
 * or % are passed over.  The first line may name the columns, the next may give their units; lines
 * before them that are no table (OpenFAST's .out) are passed over and counted.  A
 * column named t or time is time, and so is an unnamed first column that grows in equal steps.
 */
#ifndef CTL_CSV_H
#define CTL_CSV_H
#include "signals.h"

/* What rows that come later are like. */
struct csv_shape {
    char separator;             /* ' ': any blanks */
    size_t columns;             /* with that of time */
    int time;                   /* the column of time, or -1 */
    double before;              /* the time of the last row */
};

/* TEXT is changed.  PATH is for messages.  Of OPTIONS only ignore_time and whether there is a dt:
 * with the former a column of time is only taken out, whatever it holds;
 * with the latter uneven time is refused as field "dt".  SHAPE may be NULL. */
enum modal_status csv_read(char *text, const char *path, const struct signals_options *options,
                           struct signals *out, struct csv_shape *shape, struct modal_error *err);

/* A copy of a line, for free(): where there is no memory for it the program ends as for a document
 * (json_memory_by), for of a line that is not looked at another table would be made. */
char *csv_copy(const char *line, size_t length);

/* Columns of LINE, if it is nothing but numbers; else 0. */
size_t csv_is_row(const char *line);

/*
 * LINE, the NUMBERth, which is changed, as one more row: its channels into X, which has room for
 * SHAPE's columns.  Its time must follow the row before by DT, two samples being each as far from
 * their places as a file's may be, and as its digits show it; DT 0: it is not looked at.
 */
enum modal_status csv_row(struct csv_shape *shape, char *line, const char *path, size_t number,
                          double dt, double *x, struct modal_error *err);

#endif
