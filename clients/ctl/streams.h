/* streams.h - streams as a table; verb `streams` */
#ifndef CTL_STREAMS_H
#define CTL_STREAMS_H
#include <stdio.h>
#include "base/json.h"

enum { STREAMS_AGE_ROOM = 24 };      /* 17 digits and a unit */

/* SECONDS as people say it: "12 s", "3 min", "5 h", "2 d"; NAN: "-". */
void streams_age(double seconds, char text[STREAMS_AGE_ROOM]);

/* The names of the columns, and a line for ONE of the answer to STREAMS. */
void streams_heading(FILE *to);
void streams_line(FILE *to, const cJSON *one);
#endif
