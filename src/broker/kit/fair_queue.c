/*
 * fair_queue.c - round robin over who has something
 *
 * With n who have some, at most n - 1 items of the others are taken before the next of any of them:
 * what one puts up makes nobody else wait longer than one of it does.
 */
#include "broker/kit/fair_queue.h"
#include "broker/kit/memory.h"
#include <stdlib.h>

struct turn {
    uint64_t number;
    size_t size;                          /* of all its items */
    struct fair_item *first, **end;
    struct turn *next;
};

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

static struct turn *find(const struct fair_queue *queue, uint64_t number)
{
    return map_find_number(&queue->by_turn, number);
}

void fair_queue_put(struct fair_queue *queue, struct fair_item *item)
{
    struct turn *turn = find(queue, item->turn);

    if (turn == NULL)
        turn = turn_new(queue, item->turn);
    item->next = NULL;
    *turn->end = item;
    turn->end = &item->next;
    turn->size += item->size;
    queue->size += item->size;
}

/* The first who MAY, who is in the round no more; NULL: none. */
static struct turn *leave(struct fair_queue *queue, fair_may *may, const void *context)
{
    struct turn *before = NULL, *turn = queue->first;

    while (turn != NULL && may != NULL && !may(context, turn->number)) {
        before = turn;
        turn = turn->next;
    }
    if (turn == NULL)
        return NULL;
    *(before == NULL ? &queue->first : &before->next) = turn->next;
    if (queue->last == turn)
        queue->last = before;
    return turn;
}

struct fair_item *fair_queue_take(struct fair_queue *queue, fair_may *may, const void *context)
{
    struct turn *turn = leave(queue, may, context);
    struct fair_item *item;

    if (turn == NULL)
        return NULL;
    item = turn->first;
    turn->first = item->next;
    turn->size -= item->size;
    queue->size -= item->size;
    if (turn->first != NULL)
        append(queue, turn);
    else {
        map_remove(&queue->by_turn, map_hash_number(turn->number), turn);
        free(turn);
    }
    if (queue->first == NULL)
        map_done(&queue->by_turn);
    return item;
}

size_t fair_queue_size(const struct fair_queue *queue, uint64_t number)
{
    const struct turn *turn = find(queue, number);

    return turn == NULL ? 0 : turn->size;
}
