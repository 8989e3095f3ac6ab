/* live.h - the kind `identify` on a moving window: the same modes, verdict and diagnostics, hop
 * after hop, each mode with its track */
#ifndef JOB_LIVE_H
#define JOB_LIVE_H
#include <stddef.h>
#include <stdint.h>
#include "modal/batch.h"
#include "base/error.h"
#include "base/json.h"

struct live;

/*
 * A window of SHAPE->samples of SHAPE's channels, HOP samples between results (0: unknown).
 * OPTIONS are identify's (NULL: none).  SHAPE's signals are not looked at, nothing of it is kept.
 * The caller frees *out with live_free.  Fails as identify does, naming the option.
 */
enum modal_status live_new(const cJSON *options, const struct batch *shape, int hop,
                           struct live **out, struct modal_error *err);
void live_free(struct live *live);

/* The tracks of the windows before, as `tracks` of their last document has them.  Fails with
 * MODAL_BAD_INPUT, field "tracks". */
enum modal_status live_resume(struct live *live, const char *tracks, struct modal_error *err);

/* What comes next does not follow on the samples of before: the next window has none of them. */
void live_skip(struct live *live);

/*
 * COUNT samples more, the last of them number TO of EPOCH, then the modes of the last window as
 * identify's document has them: {"kind","modes","stability","diagnostics"}, each mode with the
 * number of its "track" (modal/identify/live/track.h), and
 *
 *   "update"       {"updated":bool,"why":text or null,"updates":n,"batches":n,"cpu_s":s}: whether
 *                  they were brought up to date or found from nothing, and why (moving.h)
 *   "tracks"       all that is known of tracks, for live_resume
 *   "track_edges"  [{"track":n,"state":"born"|"died"|"back","frequency_hz":f,"damping_ratio":z}]
 *
 * The caller deletes *document.  Fails as identify does; MODAL_BAD_INPUT while the window is not
 * full.
 */
enum modal_status live_next(struct live *live, uint64_t epoch, uint64_t to, const double *samples,
                            size_t count, cJSON **document, struct modal_error *err);
#endif
