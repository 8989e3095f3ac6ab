/*
 * window_turns.c - whose window is next where there are more than workers
 *
 * Each stream whose window is due gets its newest one in its turn.  Turns go round by round, over a
 * restart, too: who waits gets a window before anybody gets two, so that no stream has more than
 * its share, whatever the order within a round.  That is free, and a window goes rather to the
 * worker that had the one before: that gets only what is new.  So each worker has a list of those
 * that it is to go on with, and a turn looks at the first of each list alone, however many wait.
 * Another worker that has nothing else to do takes the first of a list whose worker is not to have
 * windows any more, or where that pays for the A that the window takes from nothing, where it would
 * take C:
 *
 *   - Its worker has L to do.  The last of the list would be told after L, and is after A; each of
 *     the L / C before it by C sooner: 2 L - A of waiting is saved.  In A up to A / C of the other
 *     worker's own windows come due, and wait for half of A each.  It pays from
 *     L = A / 2 + A^2 / (4 C) on: at once where both take the same.
 *   - That never comes to be where few streams have a worker each, one of them too many.  So what
 *     was left out of a stream there counts as well, C each, up to the A - C that it takes more: as
 *     who rents buys once he has paid the price, it takes at most twice what the best would.
 *
 * Taken whenever it is late, where A is 15 C, it makes other windows late, which are taken then.
 */
#include "broker/verbs/window_turns.h"
#include "broker/core/slots.h"
#include "broker/verbs/streams.h"

bool window_is_due(struct stream *s)
{
    struct window *w = &s->window;
    uint64_t least = (s->run_from > w->here ? s->run_from : w->here) + w->samples;

    if (w->samples == 0 || w->recent == NULL || s->durable_epoch != s->epoch || s->durable < least)
        return false;
    if (w->next < least) {
        w->next = least;
        w->first = true;
    }
    return s->durable >= w->next;
}

bool window_is_with(const struct core *c, const struct stream *s, int slot)
{
    const struct slot *own = &c->slots->at[slot];

    return s->window.slot == slot && s->window.process == own->process
        && own->state != SLOT_EMPTY;
}

/* ---- the lists ------------------------------------------------------------------------------- */

/* Where S waits: its worker's, or that of all whom no worker has; of this round, or the next. */
static struct waiting *list_of(struct core *c, const struct stream *s)
{
    const int slot = s->window.slot;
    struct slots *slots = c->slots;
    struct waiting *lists = slot >= 0 && window_is_with(c, s, slot) ? slots->at[slot].due
                                                                    : slots->due;

    return &lists[(slots->round + (s->window.round == slots->round)) % 2];
}

void turn_wait(struct core *c, struct stream *s)
{
    struct waiting *list = list_of(c, s);

    s->window.queued = true;
    s->window.behind = NULL;
    s->window.turn = c->slots->turns++;
    *(list->first == NULL ? &list->first : list->end) = s;
    list->end = &s->window.behind;
    list->cost_s += s->window.cost_s;
    c->slots->due_count++;
    c->slots->due_now += s->window.round < c->slots->round;
}

/* The first of LIST, out of it. */
static struct stream *first_out(struct core *c, struct waiting *list)
{
    struct stream *s = list->first;

    list->first = s->window.behind;
    list->cost_s = list->first != NULL ? list->cost_s - s->window.cost_s : 0;
    s->window.queued = false;
    c->slots->due_count--;
    c->slots->due_now -= s->window.round < c->slots->round;
    return s;
}

/* The first of LIST whose window is due still: others have begun anew, and wait no more. */
static struct stream *first_due(struct core *c, struct waiting *list)
{
    while (list->first != NULL && !window_is_due(list->first))
        first_out(c, list);
    return list->first;
}

/* Where nobody waits of this round, the next begins with all who wait. */
static void begin_round(struct slots *slots)
{
    if (slots->due_now > 0)
        return;
    slots->round++;
    slots->due_now = slots->due_count;
}

/* ---- a turn ---------------------------------------------------------------------------------- */

/* The worker of SLOT will go on with the windows that it has. */
static bool is_coming(const struct core *c, int slot)
{
    const struct slot *own = &c->slots->at[slot];

    return slot_takes_windows(c, slot)
        && (own->state == SLOT_IDLE || own->state == SLOT_TAKEN || own->live != NULL);
}

/* Does it pay that another than the worker of SLOT, which has LIST, does S's window?  What that
 * worker does at present takes as long again as it has taken so far. */
static bool pays(const struct core *c, int slot, const struct waiting *list, const struct stream *s)
{
    const struct slot *own = &c->slots->at[slot];
    const struct window *w = &s->window;
    const double anew_s = w->anew_s;
    const double cost_s = w->cost_s > 0 ? w->cost_s : anew_s;      /* not known yet: as the first */
    double left_s = list->cost_s + own->ahead_s;

    if (own->live != NULL)
        left_s += (double)(c->now.mono_ns - own->started_ns) / 1e9;
    return left_s > anew_s / 2 + (cost_s > 0 ? anew_s * anew_s / (4 * cost_s) : 0)
        || (w->cost_s > 0 && (double)w->lost * cost_s >= anew_s - cost_s);
}

/* May another than its worker, which has LIST, take S, the first of it? */
static bool may_leave(const struct core *c, int slot, const struct waiting *list,
                      const struct stream *s)
{
    return !window_is_with(c, s, slot) || !is_coming(c, slot) || pays(c, slot, list, s);
}

/* The list at WHICH of the one that has waited longest of those that the worker of SLOT may take:
 * its own, those that none has, and those that may leave their own worker. */
static struct waiting *longest(struct core *c, int slot, int which)
{
    struct waiting *found = &c->slots->due[which];
    const struct stream *first = first_due(c, found);

    for (int i = slot_after(c, -1); i >= 0; i = slot_after(c, i)) {
        struct waiting *list = &c->slots->at[i].due[which];
        const struct stream *s = list->first == NULL ? NULL : first_due(c, list);
        if (s != NULL && (first == NULL || s->window.turn < first->window.turn)
            && (i == slot || may_leave(c, i, list, s)))
            found = list, first = s;
    }
    return first != NULL ? found : NULL;
}

/* Who works takes none ahead from another, who may be free before. */
static bool is_anothers(const struct core *c, const struct stream *s, int slot)
{
    const int own = s->window.slot;

    return own >= 0 && own != slot && window_is_with(c, s, own) && is_coming(c, own);
}

struct stream *turn_take(struct core *c, int slot)
{
    struct slots *slots = c->slots;
    const struct slot *worker = &slots->at[slot];
    struct waiting *list;
    struct stream *s;

    if (slots->due_count == 0)
        return NULL;
    begin_round(slots);
    list = &slots->at[slot].due[slots->round % 2];
    if (first_due(c, list) == NULL)
        list = longest(c, slot, (int)(slots->round % 2));
    if (list == NULL)
        list = longest(c, slot, (int)((slots->round + 1) % 2));
    if (list == NULL
        || (worker->live != NULL
            && (list->first->window.alone || is_anothers(c, list->first, slot))))
        return NULL;
    s = first_out(c, list);
    s->window.round = slots->round;
    return s;
}

void turn_recall(struct core *c, struct stream *s, int64_t round)
{
    s->window.round = round;
    if (round > c->slots->round)
        c->slots->round = round;
}

void turns_free(struct core *c, int slot)
{
    for (int which = 0; which < 2; which++) {
        struct waiting *list = &c->slots->at[slot].due[which];
        while (list->first != NULL) {
            struct stream *s = first_out(c, list);
            s->window.slot = -1;
            turn_wait(c, s);
        }
    }
}
