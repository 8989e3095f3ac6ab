/* open.h - a stream from its first call to its last */
#ifndef STREAM_OPEN_H
#define STREAM_OPEN_H
#include "state.h"

/* A stream that is not sending yet, of CHANNELS and DT seconds to URL, without a ring.  What the
 * environment says is read here, in the host's thread.  NULL: no memory. */
static modald_stream *stream_new(const char *name, int channels, double dt, const char *url);

/* Free what S holds; its descriptors are the caller's.  The handle itself stays for a while. */
static void stream_free(modald_stream *s);

/* A link for S that is not connected yet, nor one of the process's; NULL: no memory. */
static struct link *link_new(const modald_stream *s);

/* Free what L holds; its streams are the caller's. */
static void link_free(struct link *l);
#endif
