/* service.h - the daemon as the page has it: there or away, who we are to it, and its events by
 * one subscription that is taken up again by itself */
#ifndef WEB_SERVICE_H
#define WEB_SERVICE_H
#include "ask.h"
#include "board.h"
#include "feed.h"

enum {
    SERVICE_HISTORY = 4096,      /* events asked for at the start: of jobs, half of what is kept */
    SERVICE_WORD_MOST = 128,     /* bytes of a role, a user, a version, an identifier */
};

struct service {
    struct ask ask;
    struct feed *feed;
    struct board board;
    bool here;                   /* the subscription stands */
    bool asking;                 /* for it */
    double ask_at;               /* when it is asked for again */
    char subscription[SERVICE_WORD_MOST + 1];
    char store[SERVICE_WORD_MOST + 1];           /* whose numbers the events have */
    char server[SERVICE_WORD_MOST + 1], user[SERVICE_WORD_MOST + 1], role[SERVICE_WORD_MOST + 1];
    void (*changed)(void *context);              /* events came: told once a step */
    void *context;
};

/* SERVICE, of zeros, over LINK, which stays the caller's; false: no memory. */
bool service_init(struct service *service, struct link *link);
/* Whoever still asks is told that there is no answer. */
void service_done(struct service *service);
/* Take in what has come, and do what is due; waits for nothing. */
void service_step(struct service *service);
#endif
