/* front.h - the first page: streams, alarms, queue, machine and users at a glance
 *
 * However many look, the daemon is asked ten times a second at most: all who come meanwhile wait
 * for the same answers, which were asked for after they came.
 */
#ifndef WEB_FRONT_H
#define WEB_FRONT_H
#include "base/json.h"

struct site;
struct visit;

/* Counters of the daemon's at one moment. */
struct front_sample { double at, attempts, windows, received, sent; };

struct front {
    double asked;                        /* when all was asked for; 0: never */
    int due;                             /* answers that are to come */
    bool failed;
    cJSON *stats, *jobs;
    char *metrics;
    struct visit *waiting, *served;      /* for the next answers; for those that are to come */
    struct front_sample before, last;    /* 10 s apart or more, as soon as there are such */
};

/* Those who wait, and are not asked for yet, are told that the daemon is away. */
void front_fail(struct front *front);
void front_done(struct front *front);
/* Answer VISIT by the first page; with an argument `after` or `state` by a page of the queue. */
void front_show(struct visit *visit);
/* Ask for those who wait, where it is time. */
void front_step(struct site *site);
#endif
