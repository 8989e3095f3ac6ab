/* live_windows.h - the live windows that a worker keeps between one RUN and the next */
#ifndef WORKER_LIVE_WINDOWS_H
#define WORKER_LIVE_WINDOWS_H
#include <stdint.h>
#include "modal/batch.h"
#include "base/error.h"
#include "base/json.h"

/* What is kept at most; past that windows are dropped, and found from nothing when they come again.
 * One that is larger alone is kept until another comes. */
enum {
    WINDOWS_MOST = 4096,              /* streams: as many as a user may have open */
    WINDOWS_BYTES = 256 << 20,        /* a quarter of the least memory that a worker of
                                       * a daemon with keys is given */
    WINDOW_BESIDES = 64 << 10,        /* what one takes beside them: 50 to 80 kB of plans and bases
                                       * at two channels, 90 at eight */
};

struct live_windows;

/* None yet; NULL: no memory.  Freeing accepts NULL. */
struct live_windows *live_windows_new(void);
void live_windows_free(struct live_windows *windows);

/*
 * One RUN with the member "live": {"stream":text,"epoch":e,"to":i,"window":n,"hop":n,
 * "tracks"?:text}.  BATCH holds the samples up to number `to`: the whole window, with what is known
 * of tracks, or those that came since the last RUN of the stream.  The fit begins at the poles of
 * the stream's last window that was here, whatever lies between.  The caller deletes *document
 * (job/live.h).  Fails with MODAL_NOT_FOUND, field "live", where samples before BATCH are not here
 * any more: the whole window is wanted; and as live_next does.  After a failure the stream's window
 * is forgotten.
 */
enum modal_status live_windows_run(struct live_windows *windows, const cJSON *live,
                                   const cJSON *options, const struct batch *batch,
                                   cJSON **document, struct modal_error *err);
/* ms of real time that the last window took of the stream that LIVE, as above, names; INT64_MAX:
 * none of it is here. */
int64_t live_windows_took_ms(const struct live_windows *windows, const cJSON *live);
#endif
