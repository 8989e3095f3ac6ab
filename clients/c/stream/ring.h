/* ring.h - samples between the host and its sender: a ring in memory or in a file, and the pushes
 */
#ifndef STREAM_RING_H
#define STREAM_RING_H
#include "state.h"

/* Make the ring of S in BYTES of memory or in FILE (NULL or "": memory; %s in it: the stream's
 * name); where the file cannot be used, a line on stderr and memory.  False: no memory. */
static bool ring_open(modald_stream *s, size_t bytes, const char *file);

/* Slots before END are acknowledged or in the spill file; one that is behind changes nothing. */
static void release(modald_stream *s, uint64_t end);

/* The slot that was pushed as the COUNT-th, which has not been released. */
static const double *slot_at(const modald_stream *s, uint64_t count);

/* Slots before `taken` are in frames: pieces of a ring in memory that are all read are free. */
static void release_copied(modald_stream *s);

/* May another slot be put into a frame?  Of a ring in memory frames hold as much again, no more. */
static bool may_copy(const modald_stream *s);

/* Is half of the ring full of what is not acknowledged?  Where frames are being sent, and the ring
 * is in memory, of what cannot go into frames. */
static bool overflows(const modald_stream *s);

/* Slots that wait: pushed, and neither acknowledged nor in the spill file. */
static uint64_t waiting_in(const modald_stream *s);

/* Pieces beyond RING_TOUCHED that were not used for a while go back to the system. */
static void rest_ring(modald_stream *s);
#endif
