/* spill.h - frames that the daemon does not take yet, in a file */
#ifndef STREAM_SPILL_H
#define STREAM_SPILL_H
#include "state.h"

/* Is anything in the file that is not acknowledged?  Then all that follows goes through it. */
static bool spilling(const modald_stream *s);

/* Append F; false: the disk or the limit is full, which is said once. */
static bool spill_write(modald_stream *s, struct frame *f);

/* The next frame of the file into F; false: no more, or no memory.  Records that are damaged are
 * passed over and counted; what a killed host was writing is torn, and the file ends before it. */
static bool spill_next(modald_stream *s, struct frame *f);

/* Where everything in the file is acknowledged, begin it anew. */
static void spill_drained(modald_stream *s);
#endif
