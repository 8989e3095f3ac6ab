/* fair_queue.h - what many wait with, of whom each has one in turn; of one it comes in its order */
#ifndef BROKER_FAIR_QUEUE_H
#define BROKER_FAIR_QUEUE_H
#include "broker/kit/map.h"

/* The first member of what waits. */
struct fair_item {
    uint64_t turn;                        /* whose it is */
    size_t size;                          /* bytes, for who asks how many wait */
    struct fair_item *next;
};

/* Zero has no items. */
struct fair_queue {
    struct map by_turn;
    struct turn *first, *last;            /* whose turn is next; who has an item is in it once */
    size_t size;                          /* of all items */
};

/* ITEM, which is QUEUE's until it is taken, behind the others of its turn. */
void fair_queue_put(struct fair_queue *queue, struct fair_item *item);
/* Whether TURN's may be taken now. */
typedef bool fair_may(const void *context, uint64_t turn);

/* The item of the first who MAY, who is last then if he has more; NULL: there is none.  MAY NULL:
 * everybody. */
struct fair_item *fair_queue_take(struct fair_queue *queue, fair_may *may, const void *context);
/* The sizes of TURN's items together. */
size_t fair_queue_size(const struct fair_queue *queue, uint64_t turn);
#endif
