/* option_help.h - what `-o KEY=VALUE` can say to each kind of job, for the help of a verb */
#ifndef CTL_OPTION_HELP_H
#define CTL_OPTION_HELP_H
#include <stdio.h>

/* Print the keys that jobs of KIND take, one a line, with their meaning, unit, range and default;
 * nothing where there are none. */
void option_help(FILE *to, const char *kind);
#endif
