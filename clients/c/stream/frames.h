/* frames.h - slots of the ring to frames of equal steps, and the window of those in flight */
#ifndef STREAM_FRAMES_H
#define STREAM_FRAMES_H
#include "state.h"

/* The memory of the window, of the frame being built and of what resampling needs, which stays with
 * S until it is freed; false: there is none. */
static bool frames_new(modald_stream *s);

/* Slots into frames while there is room. */
static void build_frames(modald_stream *s);

/* The frame being built into the window, or, while spilling, into the file; false: no room now. */
static bool finish_build(modald_stream *s);

/* The same, where it is due (ALL: in any case); false: it is not, or there is no room now. */
static bool send_due(modald_stream *s, bool all);

/* The rest of an uneven record: its last point has none beyond. */
static void end_resampling(modald_stream *s);

/* Where the ring overflows (ALL: in any case) the window goes into the spill file: the daemon
 * does not keep up, and from now on everything goes through it. */
static void spill_if_needed(modald_stream *s, bool all);

/* Frames from the spill file into the window, as many as have room. */
static void fill_window(modald_stream *s);

/* Frames acknowledged from the front on leave the window, their slots or file space with them. */
static void retire(modald_stream *s);
#endif
