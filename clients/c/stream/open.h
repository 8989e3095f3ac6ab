/* open.h - a stream from its first call to its last */
#ifndef STREAM_OPEN_H
#define STREAM_OPEN_H
#include "state.h"

/* A stream that is not sending yet, of CHANNELS and DT seconds to URL, its ring in RING bytes of
 * memory or in RING_FILE (may be NULL).  The environment is read here, in the host's thread.  NULL:
 * no memory. */
static modald_stream *stream_new(const char *name, int channels, double dt, const char *url,
                                 size_t ring, const char *ring_file);

/* Free what S holds; its descriptors are the caller's.  The handle itself stays for a while. */
static void stream_free(modald_stream *s);
#endif
