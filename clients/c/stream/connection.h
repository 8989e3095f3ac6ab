/* connection.h - the socket to the daemon, its keys, and its own account of the handshake */
#ifndef STREAM_CONNECTION_H
#define STREAM_CONNECTION_H
#include "state.h"

/* Read the keys, once: a host may give up the right to them; begin to connect.  False: neither a
 * context nor a socket, or no keys where a file of them is named. */
static bool connect_socket(modald_stream *s);

/* End it all: the socket, the context, the keys in memory. */
static void close_socket(modald_stream *s);

/* A socket on its way to the daemon; false: none now, and S->begin_at says when to try again. */
static bool open_link(modald_stream *s);

/* Nothing more is said or heard on this link; the next begins after a pause. */
static void drop_link(modald_stream *s);

/* Take in what the monitor has to say: S->ready, S->lost, or a line on why we are not let in. */
static void read_monitor(modald_stream *s);
#endif
