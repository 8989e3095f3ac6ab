/* screen.h - a terminal taken over for a live picture, and given back however the process ends */
#ifndef CTL_SCREEN_H
#define CTL_SCREEN_H
#include <stdbool.h>

/*
 * Take the terminal of stdin and stdout: another screen, no cursor, keys without Enter and unseen.
 * It is given back by screen_end(), at exit(), by signals that end a process, which then do so, and
 * while SIGTSTP holds it.  Once in a process.
 */
void screen_begin(void);
void screen_end(void);

/* Show TEXT, lines that are cut to the size that the terminal has now. */
void screen_show(const char *text);

/* Columns and rows, now. */
void screen_size(int *columns, int *rows);

/* A key within SECONDS; 0: none came, or the size has changed. */
int screen_key(double seconds);
#endif
