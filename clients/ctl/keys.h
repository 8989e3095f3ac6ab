/* keys.h - what `-o KEY=VALUE` can say to each kind of job, for the help of a verb */
#ifndef CTL_KEYS_H
#define CTL_KEYS_H
#include <stdio.h>

/* Print the keys that jobs of KIND take, one a line, and their meaning; nothing where there are none. */
void keys_help(FILE *to, const char *kind);
#endif
