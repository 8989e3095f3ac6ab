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

/* TEXT is changed.  PATH is for messages.  Of OPTIONS only ignore_time and whether there is a dt:
 * with the former a column of time is only taken out, whatever it holds;
 * with the latter uneven time is refused as field "dt". */
enum modal_status csv_read(char *text, const char *path, const struct signals_options *options,
                           struct signals *out, struct modal_error *err);

#endif
