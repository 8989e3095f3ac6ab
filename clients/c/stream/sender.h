/* sender.h - the thread that sends */
#ifndef STREAM_SENDER_H
#define STREAM_SENDER_H
#include "state.h"

/* The thread of the modald_stream ARGUMENT, until its S->stop is set and it is finished; NULL. */
static void *sender(void *argument);

/* Is everything that was pushed acknowledged? */
static bool drained(const modald_stream *s);

/* Send what is left and, if S->seal, close the stream, until UNTIL (of now()). */
static void finish(modald_stream *s, double until);
#endif
