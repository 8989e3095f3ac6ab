/* live_windows.h - the live windows that a worker keeps between one RUN and the next */
#ifndef WORKER_LIVE_WINDOWS_H
#define WORKER_LIVE_WINDOWS_H
#include "modal/batch.h"
#include "base/error.h"
#include "base/json.h"

/* streams; past that the one that was used longest ago is dropped, and found from nothing when it
 * comes again */
enum { WINDOWS_MOST = 16 };

struct live_windows;

/* None yet; NULL: no memory.  Freeing accepts NULL. */
struct live_windows *live_windows_new(void);
void live_windows_free(struct live_windows *windows);

/*
 * One RUN with the member "live": {"stream":text,"epoch":e,"to":i,"window":n,"hop":n,
 * "tracks"?:text}.  BATCH holds the samples up to number `to`: the whole window, with what is known
 * of tracks, or those that came since the last RUN of the stream.  The caller deletes *document
 * (job/live.h).  Fails with MODAL_NOT_FOUND, field "live", where samples before BATCH are not here
 * any more: the whole window is wanted; and as live_next does.  After a failure the stream's window
 * is forgotten.
 */
enum modal_status live_windows_run(struct live_windows *windows, const cJSON *live,
                                   const cJSON *options, const struct batch *batch,
                                   cJSON **document, struct modal_error *err);
#endif
