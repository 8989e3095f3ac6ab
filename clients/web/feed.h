/* feed.h - the last events, as they go to readers: one subscription's, kept once for all of them
 *
 * A reader has a place in it and no buffer of his own.  Who is so slow that what comes next for
 * him is no more here has lost his place.
 */
#ifndef WEB_FEED_H
#define WEB_FEED_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>
#include "base/json.h"

enum {
    FEED_EVENTS = 8192,              /* at most; of jobs, some 2 MB */
    FEED_BYTES = 6291456,            /* at most: 2000 windows of a few modes */
    FEED_WORD_MOST = 132,            /* bytes of a stream's name, or of a job's id */
};

struct feed;

/* NULL: no memory. */
struct feed *feed_new(void);
void feed_free(struct feed *feed);

/* Keep EVENT, an EVENT's header, and say it to who comes; its number becomes feed_number(). */
void feed_add(struct feed *feed, const cJSON *event);
/* Say TEXT, lines of server-sent events, to all, in its place among the events. */
void feed_say(struct feed *feed, const char *text);
/* Forget all; what comes has the number FROM or later. */
void feed_clear(struct feed *feed, int64_t from);

/* The number of the last event; that before the first where none came yet. */
int64_t feed_number(const struct feed *feed);
/* The number from which on all are kept. */
int64_t feed_first(const struct feed *feed);
/* How many of the kept events of KIND ("modes", NULL: any) were at SINCE or later, in UTC. */
int feed_count(const struct feed *feed, const char *kind, double since);

/* What a reader wants: "" any, else that stream's, that job's; KINDS "" any, else a list with
 * commas between. */
struct feed_place {
    uint64_t at;                     /* the entry that comes next */
    size_t offset;                   /* bytes of it that he has */
    char stream[FEED_WORD_MOST + 1], job[FEED_WORD_MOST + 1], kinds[FEED_WORD_MOST + 1];
};

/* Set PLACE to the first event of number FROM or later; < 0: to what comes next.  False: there
 * were others between, or FROM is of other numbers than these; feed_first() is what is kept. */
bool feed_seek(const struct feed *feed, struct feed_place *place, int64_t from);

/* Up to ROOM bytes for the reader at PLACE into BUFFER; 0: nothing for now; -1: his place is
 * lost. */
ssize_t feed_read(const struct feed *feed, struct feed_place *place, char *buffer, size_t room);
#endif
