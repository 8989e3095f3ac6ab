/* live_events.h - what the daemon tells of one stream, said while its samples are being pushed
 *
 * A connection of its own: events wait there for whoever pushes, who never waits for them.
 */
#ifndef CTL_LIVE_EVENTS_H
#define CTL_LIVE_EVENTS_H
#include <stdbool.h>
#include "link.h"
#include "live_modes.h"

struct live_events {
    struct link *link;          /* the caller's: opened before, closed after */
    const char *stream;         /* borrowed */
    bool json;
    double sample;              /* the last of the latest window that was told; -1: none yet */
    double next;                /* the number to go on from; -1: from now on */
    bool subscribed;            /* on this connection, or asked to be */
    bool refused;               /* by the daemon, which was said */
    struct live_modes modes;
};

/* Ask for the events of the stream from now on, which may be yet to come: before its samples are
 * pushed.  A daemon that grants no subscription is heard on stderr, once.  Fails as link_question
 * does otherwise. */
enum modal_status live_events_begin(struct live_events *live, double deadline,
                                    struct modal_error *err);

/* Say what came since the call before, each as `watch` says it.  JSON has besides `sample`, the
 * last of its window; a window the flat members of proto/PROTOCOL.md, section 11, also where the
 * daemon left them out, and `std`, their standard errors.  After a lost connection it goes on where
 * it was. */
void live_events_show(struct live_events *live);

/* Say all that the daemon told before this call, waiting until DEADLINE at most. */
void live_events_finish(struct live_events *live, double deadline);
#endif
