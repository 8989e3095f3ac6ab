/* progress.h - how far something is, on stderr: on a terminal over itself, else a line now and
 * then */
#ifndef CTL_PROGRESS_H
#define CTL_PROGRESS_H
#include <stddef.h>

/* WHAT is FRACTION done; 0: it does not say, so at least the time that it takes is shown.  Not for
 * two threads at once. */
void progress_tell(const char *what, double fraction);

/* Of ALL things DONE have ended, FAILED of them badly: a bar, and the time that is left by the
 * pace so far. */
void progress_count(const char *what, size_t done, size_t all, size_t failed);

/* What was begun has ended: the line on a terminal goes. */
void progress_end(void);
#endif
