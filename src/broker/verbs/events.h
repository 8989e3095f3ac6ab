/* events.h - subscriptions and the events that are in memory; for events.c */
#ifndef BROKER_EVENTS_H
#define BROKER_EVENTS_H
#include "broker/core/state.h"

/* A connection that subscribes, or takes no more. */
struct listener {
    struct listener *next;
    uint64_t peer;
    struct subscription *subscriptions;   /* all of them, by their `next` */
    /* those of no stream, by their `general`, and whose turn it is (NULL: the first's) */
    struct subscription *general, *at;
    /* those of a stream that may have something to be told, by their `ready`, in turn */
    struct subscription *ready, **ready_end;
    bool ready_first;                     /* they go before the general ones now */
    bool full;                            /* it takes no more for now */
    bool reading;                         /* a TASK_READ_EVENTS for one of them is under way */
};

/* A stream that somebody subscribes to, by name. */
struct topic {
    char *stream;
    struct subscription *subscriptions;   /* of all connections, by their `same` */
    int64_t last;                         /* the number of its latest event since; 0: none */
};

struct subscription {
    struct subscription *next, *general, *ready, *same;
    struct listener *listener;
    struct topic *topic;                  /* NULL: of no stream */
    bool waits;                           /* of a stream: it is among the ready ones */
    uint64_t number;
    struct user *user;
    char key[KEY_TEXT];                   /* by which it was asked for */
    struct reply reply;
    int64_t next_event;                   /* the number it has not seen */
    int64_t job;                          /* 0: all */
    unsigned kinds;                       /* bits of wire_events; 0: all */
};

enum { RING = 1024 };                     /* events in memory: a second's worth at the fastest */

struct events {
    struct listener *listeners, *at;      /* at: whose turn it is; NULL: the first's */
    struct map topics;                    /* by the stream's name */
    uint64_t next_subscription;
    struct event_row ring[RING];          /* committed events, by number % RING */
    int64_t after[RING];                  /* of each the next of its stream; 0: not known */
    int64_t pruned;                       /* last_event at the latest pruning */
    bool stirred;                         /* somebody may have something to be told */
};
#endif
