/* terminal.h - stdout and stderr where a person reads them: nothing obeys what others wrote */
#ifndef TERMINAL_H
#define TERMINAL_H
#include <stdio.h>

/* From now on what is printed to stdout and stderr, where they are terminals, is written as
 * utf8_put does: names, messages and documents come from files, other users and servers. */
void terminal_guard(void);

/* stdout and stderr as they were before, for commands to the terminal. */
FILE *terminal_stdout(void);
FILE *terminal_stderr(void);
#endif
