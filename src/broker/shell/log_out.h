/* log_out.h - the daemon's lines on their way to stderr, for which it never waits */
#ifndef BROKER_SHELL_LOG_OUT_H
#define BROKER_SHELL_LOG_OUT_H
#include <stdbool.h>

/* From now on writes to stderr do not wait.  Where it is closed, /dev/null takes its place. */
void log_out_begin(void);

/* Keep what stands in STAMP and TEXT, one line, until log_out_flush.  Where those that wait for a
 * reader leave no room it is dropped, and all after it until that is told. */
void log_out_put(const char *stamp, const char *text);

/* Write what stderr takes; what it refuses, as on a full disk, is dropped too.  How many lines were
 * dropped, once one behind them is written: to be told in the next, and counted anew from here. */
unsigned long log_out_flush(void);

/* Whether lines wait for stderr to take them. */
bool log_out_waits(void);

/* TEXT, a line, from a signal's handler: none of those that wait, none after it. */
void log_out_last(const char *text);

/* The last: what a reader takes within a second is written. */
void log_out_end(void);
#endif
