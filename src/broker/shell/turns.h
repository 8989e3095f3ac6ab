/* turns.h - tasks of many, of whom each has one in turn; of one they come in their order */
#ifndef BROKER_TURNS_H
#define BROKER_TURNS_H
#include "broker/core/core.h"
#include "broker/kit/map.h"

/* Zero has no tasks. */
struct turns {
    struct map by_turn;
    struct turn *first, *last;            /* whose turn is next; who has a task is in it once */
};

/* TASK, which is TURNS' until it is taken, behind the others of its turn. */
void turns_put(struct turns *turns, struct task *task);
/* The task of who is first, who is last then if he has more; NULL: there is none. */
struct task *turns_take(struct turns *turns);
#endif
