/* connection.h - the socket to the daemon, its keys, and its own account of the handshake */
#ifndef STREAM_CONNECTION_H
#define STREAM_CONNECTION_H
#include "state.h"

/* WHAT is wrong for all streams of L, once. */
static void warn_all(struct link *l, const char *what);

/* Libzmq's context, or none.  The process's first reads the environment (libpgm's pgm_init), which
 * the host must not change meanwhile. */
static void make_context(struct link *l);

/* Read the keys, once: a host may give up the right to them; begin to connect.  False: neither a
 * context nor a socket, or no keys where a file of them is named. */
static bool connect_socket(struct link *l);

/* End it all: the socket, the context, the keys in memory. */
static void close_socket(struct link *l);

/* A socket on its way to the daemon; false: none now, and L->begin_at says when to try again. */
static bool open_link(struct link *l);

/* Nothing more is said or heard on this link; the next begins after a pause. */
static void drop_link(struct link *l);

/* Take in what the monitor has to say: L->ready, L->lost, or a line on why we are not let in. */
static void read_monitor(struct link *l);
#endif
