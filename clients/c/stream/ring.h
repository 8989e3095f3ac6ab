/* ring.h - samples between the host and its sender: a ring in memory or in a file, and the pushes
 */
#ifndef STREAM_RING_H
#define STREAM_RING_H
#include "state.h"

/* Make the ring of S in BYTES of memory or in FILE (NULL or "": memory; %s in it: the stream's
 * name); where the file cannot be used, a line on stderr and memory.  False: no memory. */
static bool ring_open(modald_stream *s, size_t bytes, const char *file);

/* Slots before TAIL are read, and the host's again soon; a TAIL that is behind it changes nothing.
 */
static void release(modald_stream *s, uint64_t tail);

/* Slots that wait: pushed, and neither acknowledged nor in the spill file. */
static uint64_t waiting_in(const modald_stream *s);

/* Have the pages ready that a host writes next at its present pace. */
static void keep_ahead(modald_stream *s);
#endif
