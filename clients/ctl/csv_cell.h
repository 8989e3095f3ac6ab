/* csv_cell.h - cells of a table in CSV; what stands FIRST in a row has no comma before it */
#ifndef CTL_CSV_CELL_H
#define CTL_CSV_CELL_H
#include <stdbool.h>
#include <stdio.h>
#include "base/json.h"

/* NAME and what follows it, in quotes where they hold a comma, a quote or an end of line. */
void csv_name(FILE *to, bool first, const char *name, const char *after);
/* All digits of VALUE; nothing where it is not finite. */
void csv_number(FILE *to, bool first, double value);
/* A number; true and false as 1 and 0; of all else nothing. */
void csv_item(FILE *to, bool first, const cJSON *value);
#endif
