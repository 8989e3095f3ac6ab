/*
 * fair_queue.c - round robin over who has tasks
 *
 * With n who have some, at most n - 1 tasks of the others are done before the next of any of them:
 * what one puts up makes nobody else wait longer than one of it does.
 */
#include "broker/shell/fair_queue.h"
#include "broker/kit/memory.h"
#include <stdlib.h>

struct turn {
    uint64_t number;
    struct task *first, **end;
    struct turn *next;
};

static bool has_number(const void *value, const void *key)
{
    return ((const struct turn *)value)->number == *(const uint64_t *)key;
}

static void append(struct fair_queue *queue, struct turn *turn)
{
    turn->next = NULL;
    if (queue->first == NULL)
        queue->first = turn;
    else
        queue->last->next = turn;
    queue->last = turn;
}

static struct turn *turn_new(struct fair_queue *queue, uint64_t number)
{
    struct turn *turn = grab(sizeof *turn);

    turn->number = number;
    turn->end = &turn->first;
    if (!map_put(&queue->by_turn, map_hash_number(number), turn))
        abort();
    append(queue, turn);
    return turn;
}

void fair_queue_put(struct fair_queue *queue, struct task *task)
{
    struct turn *turn =
        map_find(&queue->by_turn, map_hash_number(task->turn), has_number, &task->turn);

    if (turn == NULL)
        turn = turn_new(queue, task->turn);
    task->next = NULL;
    *turn->end = task;
    turn->end = &task->next;
}

struct task *fair_queue_take(struct fair_queue *queue)
{
    struct turn *turn = queue->first;
    struct task *task;

    if (turn == NULL)
        return NULL;
    queue->first = turn->next;
    task = turn->first;
    turn->first = task->next;
    if (turn->first != NULL)
        append(queue, turn);
    else {
        map_remove(&queue->by_turn, map_hash_number(turn->number), turn);
        free(turn);
    }
    if (queue->first == NULL)
        map_done(&queue->by_turn);
    return task;
}
