/* ring.h - samples between the host and its sender: a ring in memory or in a file, and the pushes
 */
#ifndef STREAM_RING_H
#define STREAM_RING_H
#include "state.h"

/* Make the ring of S in BYTES of memory or in FILE (NULL or "": memory; %s in it: the stream's
 * name); where the file cannot be used, a line on stderr and memory.  False: no memory. */
static bool ring_open(modald_stream *s, size_t bytes, const char *file);

/* Slots before TAIL are the host's again; a TAIL that is behind it changes nothing. */
static void release(modald_stream *s, uint64_t tail);
#endif
