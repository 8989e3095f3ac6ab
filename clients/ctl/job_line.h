/* job_line.h - a queue document as a line of a table */
#ifndef CTL_JOB_LINE_H
#define CTL_JOB_LINE_H
#include <stdio.h>
#include "base/json.h"

/* The names of the columns, and a line for the document DOC. */
void job_line_heading(FILE *to);
void job_line(FILE *to, const cJSON *doc);
#endif
