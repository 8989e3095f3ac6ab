/* messages.h - what is said to the daemon, and what its words mean */
#ifndef STREAM_MESSAGES_H
#define STREAM_MESSAGES_H
#include "state.h"

/* Ask to open the stream, and for its events. */
static void send_open(modald_stream *s);

/* Send the window's frames that are not sent yet, within the daemon's credit; false: there was
 * none, or no room. */
static bool send_frames(modald_stream *s);

/* What frames that go together are begun goes out; false: it could not, and is not sent. */
static bool send_together(struct link *l);

/* Is something that was sent together without an answer for too long? */
static bool is_overdue(const struct link *l);

/* Nothing that was sent together will be answered. */
static void forget_together(struct link *l);

/* Ask to seal the stream. */
static void send_close(modald_stream *s);

/* Nothing that was sent counts: the link is new or gone, or the daemon wants S opened again. */
static void begin_anew(modald_stream *s);

/* The daemon names S so; "": it does not, and no event is S's. */
static void set_name(modald_stream *s, const char *name);

/* Take in one message; its cost in bytes of libzmq's memory; 0: there is none. */
static size_t receive(struct link *l);
#endif
