/* fair_queue.h - tasks of many, of whom each has one in turn; of one they come in their order */
#ifndef BROKER_FAIR_QUEUE_H
#define BROKER_FAIR_QUEUE_H
#include "broker/core/core.h"
#include "broker/kit/map.h"

/* Zero has no tasks. */
struct fair_queue {
    struct map by_turn;
    struct turn *first, *last;            /* whose turn is next; who has a task is in it once */
};

/* TASK, which is QUEUE's until it is taken, behind the others of its turn. */
void fair_queue_put(struct fair_queue *queue, struct task *task);
/* The task of who is first, who is last then if he has more; NULL: there is none. */
struct task *fair_queue_take(struct fair_queue *queue);
#endif
