/* show.h - results as tables a person likes to read */
#ifndef CTL_SHOW_H
#define CTL_SHOW_H
#include "base/json.h"

/* Print the result of a job of kind KIND to stdout. */
void show_result(const char *kind, const cJSON *result);

#endif
