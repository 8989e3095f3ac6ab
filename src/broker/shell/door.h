/* door.h - requests that wait for the ledger outside of the core, of whom each has one in turn */
#ifndef BROKER_DOOR_H
#define BROKER_DOOR_H
#include "broker/kit/fair_queue.h"
#include "broker/shell/received.h"

/* Bytes that wait. */
enum {
    DOOR_MOST = 64 << 20,           /* past it nobody waits with more than an equal share of it */
    DOOR_FULL = 2 * DOOR_MOST,      /* which pushes of streams alone may fill: no more is read */
    DOOR_OWN = 2 << 20              /* of a connection, as much as enters the ledger at once */
};

#define DOOR_DEAF_NS INT64_C(1000000000)     /* of 20 s in which a heartbeat is answered */

/* Zero: nobody waits. */
struct door { struct fair_queue waiting; };

/* May R of TURN wait? */
bool door_admits(const struct door *door, const struct received *r, uint64_t turn);
/* R waits, whose frames are the door's. */
void door_put(struct door *door, struct received *r, uint64_t turn);
/* Whose turn it is of those who MAY, as fair_queue_take has it, without its peer, into R, the
 * caller's to release, and TURN; false: nobody. */
bool door_take(struct door *door, fair_may *may, const void *context, struct received *r,
               uint64_t *turn);
/* R, which was taken, waits no more: a request of PEER's, NULL: who is gone. */
void door_left(struct peer *peer, const struct received *r);
/* Each of PEERS is read again, until more of its requests wait. */
void door_hear_all(const struct peers *peers);
/* Nobody waits any more. */
void door_done(struct door *door);
#endif
