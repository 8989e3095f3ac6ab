/* readers.h - those who hear events: server-sent, each at his own pace, up to a limit */
#ifndef WEB_READERS_H
#define WEB_READERS_H
#include "feed.h"
#include "visit.h"

enum {
    READERS_MOST = 128,          /* at once; more are told to come again */
    READERS_BEAT_S = 5,          /* a comment after so long: a proxy waits a minute, and it is found
                                    out that nobody is there */
};

struct reader;
struct readers { struct reader *first; int count; double beat_at; unsigned long dropped; };

/* Answer VISIT, whose page is URL_EVENTS, by events of FEED from now on, or from where the header
 * Last-Event-ID or the argument `from` say. */
enum MHD_Result readers_add(struct readers *readers, struct feed *feed, struct visit *visit);
/* There may be something for all of them. */
void readers_wake(struct readers *readers);
/* What is due: call it once a second or more often. */
void readers_step(struct readers *readers);
#endif
