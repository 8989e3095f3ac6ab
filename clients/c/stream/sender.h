/* sender.h - the thread that sends */
#ifndef STREAM_SENDER_H
#define STREAM_SENDER_H
#include "state.h"

/* The thread of the struct link ARGUMENT, until it is to stop and has no stream; NULL. */
static void *sender(void *argument);

/* S is one of L's from now on; the sender's thread, or who has none. */
static void take_in(struct link *l, modald_stream *s);

/* What came in.  True: something did. */
static bool receive_all(struct link *l);

/* What was pushed to S, and what goes out of it; from S->until on also its end.  True: something
 * did. */
static bool serve(modald_stream *s);

/* Is everything that was pushed acknowledged? */
static bool drained(const modald_stream *s);

/* Is S, which is closed, done: sent and sealed, refused, or out of time? */
static bool is_over(const modald_stream *s);
#endif
