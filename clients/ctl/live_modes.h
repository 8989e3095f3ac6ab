/* live_modes.h - what a watcher reads of a stream's windows: each mode with its trend, as a line,
 * and as Prometheus text
 *
 * The trend of a mode is that of its damping ratio zeta since the window before:
 *
 *     falling, rising   |zeta - zeta'| > 3 (s + s')                  steady   within that
 *     unknown           one of the two windows gives no s: no fit that converged, or no free decay;
 *                       or its daemon is older than tracks
 *     new               its track was not there, or an epoch's first window
 *
 * with s the standard errors.  Their sum, not the root of their squares: samples that two windows
 * share are at the end of one and at the start of the other and have opposite weights in the two
 * estimates, whose errors may be wholly opposite.
 */
#ifndef CTL_LIVE_MODES_H
#define CTL_LIVE_MODES_H
#include "base/error.h"
#include "base/json.h"

enum { LIVE_MODES = 256 };                /* of a window remembered */

struct live_mode { double track, zeta, std; };

struct live_modes {
    struct live_mode mode[LIVE_MODES];
    int count;
    double epoch;
};

/* The stability that the window of EVENT told, in one word; OTHERWISE where it told none. */
const char *live_modes_verdict(const cJSON *event, const char *otherwise);
/* To each mode of EVENT its `trend` since the events before, which MODES remembers. */
void live_modes_trend(struct live_modes *modes, cJSON *event);
/* The rest of the line of an event of a stream: last sample, verdict, modes with bars and trend;
 * lag and gaps where there are any. */
void live_modes_show(const cJSON *event);
/* EVENT's window as Prometheus text in the file PATH, which who looks sees whole.  Events other
 * than `modes` change nothing.  Fails with MODAL_BAD_INPUT, field "prometheus": it cannot be
 * written. */
enum modal_status live_modes_prometheus(const char *path, const cJSON *event,
                                        struct modal_error *err);
#endif
