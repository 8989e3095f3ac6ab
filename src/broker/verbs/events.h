/* events.h - subscriptions and the events that are in memory; for events.c */
#ifndef BROKER_EVENTS_H
#define BROKER_EVENTS_H
#include "broker/core/state.h"

struct subscription {
    struct subscription *next;
    uint64_t number, peer;
    struct user *user;
    char key[KEY_TEXT];                   /* by which it was asked for */
    struct reply reply;
    int64_t next_event;                   /* the number it has not seen */
    int64_t job;                          /* 0: all */
    char *stream;
    unsigned kinds;                       /* bits of wire_events; 0: all */
    bool reading;                         /* a TASK_READ_EVENTS is under way */
    bool gone;
};

enum { RING = 1024 };                     /* events in memory: a second's worth at the fastest */

struct events {
    struct subscription *subscriptions;
    uint64_t next_subscription;
    struct event_row ring[RING];          /* committed events, by number % RING */
    uint64_t *full; size_t full_count, full_room;     /* peers that take no more for now */
    int64_t pruned;                       /* last_event at the latest pruning */
    bool stirred;                         /* somebody may have something to be told */
};
#endif
