/* events.h - subscriptions and the events that are in memory; for events.c */
#ifndef BROKER_EVENTS_H
#define BROKER_EVENTS_H
#include "broker/core/state.h"

/* A connection that subscribes, or takes no more. */
struct listener {
    struct listener *next;
    uint64_t peer;
    struct subscription *subscriptions, *at;   /* at: whose turn it is; NULL: the first's */
    bool full;                            /* it takes no more for now */
    bool reading;                         /* a TASK_READ_EVENTS for one of them is under way */
};

struct subscription {
    struct subscription *next;
    struct listener *listener;
    uint64_t number;
    struct user *user;
    char key[KEY_TEXT];                   /* by which it was asked for */
    struct reply reply;
    int64_t next_event;                   /* the number it has not seen */
    int64_t job;                          /* 0: all */
    char *stream;
    unsigned kinds;                       /* bits of wire_events; 0: all */
};

enum { RING = 1024 };                     /* events in memory: a second's worth at the fastest */

struct events {
    struct listener *listeners, *at;      /* at: whose turn it is; NULL: the first's */
    uint64_t next_subscription;
    struct event_row ring[RING];          /* committed events, by number % RING */
    int64_t pruned;                       /* last_event at the latest pruning */
    bool stirred;                         /* somebody may have something to be told */
};
#endif
