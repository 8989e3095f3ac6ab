/*
 * turns.c - round robin over who has tasks
 *
 * With n who have some, the next task of any of them has at most n - 1 of the others' before it, and
 * its own before those: what one puts up makes nobody else wait longer than one of it does.
 */
#include "broker/shell/turns.h"
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

static void append(struct turns *turns, struct turn *turn)
{
    turn->next = NULL;
    if (turns->first == NULL)
        turns->first = turn;
    else
        turns->last->next = turn;
    turns->last = turn;
}

static struct turn *turn_new(struct turns *turns, uint64_t number)
{
    struct turn *turn = grab(sizeof *turn);

    turn->number = number;
    turn->end = &turn->first;
    if (!map_put(&turns->by_turn, map_hash_number(number), turn))
        abort();
    append(turns, turn);
    return turn;
}

void turns_put(struct turns *turns, struct task *task)
{
    struct turn *turn = map_find(&turns->by_turn, map_hash_number(task->turn), has_number,
                                 &task->turn);

    if (turn == NULL)
        turn = turn_new(turns, task->turn);
    task->next = NULL;
    *turn->end = task;
    turn->end = &task->next;
}

struct task *turns_take(struct turns *turns)
{
    struct turn *turn = turns->first;
    struct task *task;

    if (turn == NULL)
        return NULL;
    turns->first = turn->next;
    task = turn->first;
    turn->first = task->next;
    if (turn->first != NULL)
        append(turns, turn);
    else {
        map_remove(&turns->by_turn, map_hash_number(turn->number), turn);
        free(turn);
    }
    if (turns->first == NULL)
        map_done(&turns->by_turn);
    return task;
}
