/*
 * window_turns.c - whose window is next where there are more than workers
 *
 * Each stream whose window is due gets its newest one in its turn.  While nobody who waits is late,
 * whose window is left out first is first: who has short hops waits for none of those that have
 * time.  Once one is late, turns go round by round, over a restart, too: who waits gets a window
 * before anybody gets two, so that no stream has more than its share, whatever the order within a
 * round.  That is free, and a window goes rather to the worker that had the one before: that gets
 * only what is new.  So each worker has a heap of those that it is to go on with, and a turn looks
 * at the first of each alone, however many wait.
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
 * Where A is more than C it takes the stream for good, and only while less comes due at it, the
 * stream with it, than at the worker that has the stream: for A its own streams wait, and what they
 * lose by that is no reason to move them in their turn.  Each such move makes the sum of squares of
 * what comes due at the workers less, so of streams that stay the same they come to an end, where
 * no worker has more to do than any other with one stream more: than the mean, and one stream.
 *
 * Where all have too much to do nobody rests, and each worker goes round its own streams, a lap of
 * the sum of their C.  Laps that differ by less than FAIR are even: 3 streams beside 2.  What a
 * worker does beyond that, whose lap is L where the longest is M, is its lead: 1 - FAIR L / M of a
 * window for each of its streams in a lap.  It takes one of the longest lap's in its turn once its
 * lead, L s each, is twice what that takes more from nothing, A - C: half of what anybody has
 * beyond its share is spent on evening that out.  Where a lap of three or more shortens, and the
 * taker's stays shorter than that was, it is for good: of streams that stay the sum of squares of
 * laps falls.  Where no such is left, that of three or more is nowhere FAIR times another: the
 * least of them takes a third of it at most, and who could not take that has a lap of two thirds.
 * A lap of two may be longer.  No place is fair to both then, so they change places, first who has
 * been there longest: over many laps each stream is alone, and one of two, as long as any.
 */
#include "broker/verbs/window_turns.h"
#include "broker/core/slots.h"
#include "broker/verbs/streams.h"
#include <math.h>
#include <stdlib.h>

/* A stream that rests has its turn as well. */
static const double LATE_MOST_S = 60;
/* What came due this long ago counts 1/e of what does now: the longest that a window takes
 * (windows.c), so that streams of longer windows are none; one that rests is soon forgotten. */
static const double MEMORY_S = 60;
/* Streams that have so many times the windows of others for good have more than their share: as
 * many as three have beside two of a worker. */
static const double FAIR = 1.5;
/* Weight of one cost in their average: where they scatter by as much as they are, that scatters by
 * 1 / sqrt(2 COSTS - 1), a quarter. */
enum { COSTS = 8 };

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

/* S waits; of those that are left out at the same time, first who has waited longest. */
static void put(struct core *c, struct stream *s)
{
    struct waiting *list = list_of(c, s);
    const struct heap_item item = { s->window.late_ns, c->slots->turns++, s, 0 };

    s->window.queued = true;
    if (!heap_push(&list->streams, item))
        abort();
    list->cost_s += s->window.cost_s;
    c->slots->due_count++;
    c->slots->due_now += s->window.round < c->slots->round;
}

/* When the window of S, which is due, is left out: at the pace since it waited last, or that of its
 * own clock where that is not known. */
static void expect_next(const struct core *c, struct stream *s)
{
    struct window *w = &s->window;
    const int64_t now_ns = c->now.mono_ns;
    const uint64_t end = w->next + w->hop;
    double sample_s = s->dt, left_s;

    if (w->paced_ns > 0 && s->durable > w->paced)
        sample_s = (double)(now_ns - w->paced_ns) / 1e9 / (double)(s->durable - w->paced);
    left_s = s->durable < end ? sample_s * (double)(end - s->durable) : 0;
    w->late_ns = now_ns + (int64_t)(fmin(left_s, LATE_MOST_S) * 1e9);
    w->paced = s->durable;
    w->paced_ns = now_ns;
}

void turn_wait(struct core *c, struct stream *s)
{
    expect_next(c, s);
    put(c, s);
}

static struct stream *first_of(const struct waiting *list)
{
    const struct heap_item *least = heap_least(&list->streams);

    return least != NULL ? least->value : NULL;
}

/* The first of LIST, out of it. */
static struct stream *first_out(struct core *c, struct waiting *list)
{
    struct stream *s = heap_pop(&list->streams).value;

    list->cost_s = list->streams.count > 0 ? list->cost_s - s->window.cost_s : 0;
    s->window.queued = false;
    c->slots->due_count--;
    c->slots->due_now -= s->window.round < c->slots->round;
    return s;
}

/* The first of LIST whose window is due still: others have begun anew, and wait no more. */
static struct stream *first_due(struct core *c, struct waiting *list)
{
    while (list->streams.count > 0 && !window_is_due(first_of(list)))
        first_out(c, list);
    return first_of(list);
}

/* Is the first of A left out before that of B?  An empty list is last. */
static bool comes_before(const struct waiting *a, const struct waiting *b)
{
    const struct heap_item *p = heap_least(&a->streams), *q = heap_least(&b->streams);

    return p != NULL && (q == NULL || p->key < q->key || (p->key == q->key && p->order < q->order));
}

/* Where nobody waits of this round, the next begins with all who wait. */
static void begin_round(struct slots *slots)
{
    if (slots->due_now > 0)
        return;
    slots->round++;
    slots->due_now = slots->due_count;
}

/* ---- what workers have to do ----------------------------------------------------------------- */

/* D by now: MEMORY_S times what comes due of it in a second. */
static double demand_s(const struct core *c, const struct demand *d)
{
    return d->s * exp((double)(d->at_ns - c->now.mono_ns) / 1e9 / MEMORY_S);
}

static void demand_add(const struct core *c, struct demand *d, double work_s)
{
    d->s = demand_s(c, d) + work_s;
    d->at_ns = c->now.mono_ns;
}

void turn_leave(struct core *c, struct stream *s)
{
    struct window *w = &s->window;

    if (w->slot >= 0 && window_is_with(c, s, w->slot))
        demand_add(c, &c->slots->at[w->slot].demand, -demand_s(c, &w->demand));
    w->slot = -1;
}

void turn_move(struct core *c, struct stream *s, int slot)
{
    struct window *w = &s->window;

    turn_leave(c, s);
    demand_add(c, &c->slots->at[slot].demand, demand_s(c, &w->demand));
    w->lost = 0;
    w->slot = slot;
    c->slots->at[slot].latest = s->id;
    w->process = c->slots->at[slot].process;
}

void turn_took(struct core *c, struct stream *s, int slot, double cost_s)
{
    struct window *w = &s->window;
    double work_s;

    if (w->anew)
        w->anew_s = cost_s;
    else
        w->cost_s += w->cost_s > 0 ? (cost_s - w->cost_s) / COSTS : cost_s;
    work_s = (double)(w->skipped + 1) * w->cost_s;
    demand_add(c, &w->demand, work_s);
    if (window_is_with(c, s, slot))                     /* else an epoch has begun since */
        demand_add(c, &c->slots->at[slot].demand, work_s);
}

/* ---- a turn ---------------------------------------------------------------------------------- */

/* The worker of SLOT will go on with the windows that it has. */
static bool is_coming(const struct core *c, int slot)
{
    const struct slot *own = &c->slots->at[slot];

    return slot_takes_windows(c, slot)
        && (own->state == SLOT_IDLE || own->state == SLOT_TAKEN || own->live != NULL);
}

/* Does it pay that TAKER does S's window, not the worker of SLOT, which has LIST?  What that worker
 * does at present takes as long again as it has taken so far. */
static bool pays(const struct core *c, int taker, int slot, const struct waiting *list,
                 const struct stream *s)
{
    const struct slot *own = &c->slots->at[slot];
    const struct window *w = &s->window;
    const double anew_s = w->anew_s;
    const double cost_s = w->cost_s > 0 ? w->cost_s : anew_s;      /* not known yet: as the first */
    double left_s = list->cost_s + own->ahead_s;

    if (anew_s > cost_s
        && demand_s(c, &c->slots->at[taker].demand) + demand_s(c, &w->demand)
               >= demand_s(c, &own->demand))
        return false;
    if (own->live != NULL)
        left_s += (double)(c->now.mono_ns - own->started_ns) / 1e9;
    return left_s > anew_s / 2 + (cost_s > 0 ? anew_s * anew_s / (4 * cost_s) : 0)
        || (w->cost_s > 0 && (double)w->lost * cost_s >= anew_s - cost_s);
}

/* May TAKER take S, the first of LIST, which the worker of SLOT has? */
static bool may_leave(const struct core *c, int taker, int slot, const struct waiting *list,
                      const struct stream *s)
{
    return !window_is_with(c, s, slot) || !is_coming(c, slot) || pays(c, taker, slot, list, s);
}

/* The list at WHICH whose first is left out first, of those that the worker of SLOT may take: its
 * own, those that none has, and those that may leave their own worker. */
static struct waiting *most_urgent(struct core *c, int slot, int which)
{
    struct waiting *found = &c->slots->due[which];

    first_due(c, found);
    for (int i = slot_after(c, -1); i >= 0; i = slot_after(c, i)) {
        struct waiting *list = &c->slots->at[i].due[which];
        const struct stream *s = first_due(c, list);
        if (s != NULL && comes_before(list, found)
            && (i == slot || may_leave(c, slot, i, list, s)))
            found = list;
    }
    return found->streams.count > 0 ? found : NULL;
}

/* Is a window that waits left out by now? */
static bool any_is_late(struct core *c)
{
    for (int i = slot_after(c, -1); i >= 0; i = slot_after(c, i))
        for (int which = 0; which < 2; which++) {
            const struct stream *s = first_due(c, &c->slots->at[i].due[which]);
            if (s != NULL && s->window.late_ns <= c->now.mono_ns)
                return true;
        }
    for (int which = 0; which < 2; which++) {
        const struct stream *s = first_due(c, &c->slots->due[which]);
        if (s != NULL && s->window.late_ns <= c->now.mono_ns)
            return true;
    }
    return false;
}

/* Where the worker of SLOT finds what nobody asks whether it may take; NULL: there is none. */
static struct waiting *own_list(struct core *c, int slot)
{
    struct slots *slots = c->slots;
    const int now = (int)(slots->round % 2);
    struct waiting *own = slots->at[slot].due;
    struct waiting *others[] = { &own[1 - now], &slots->due[now], &slots->due[1 - now] };
    struct waiting *found = &own[now], *soonest = found;

    first_due(c, found);
    for (int i = 0; i < 3; i++)
        if (first_due(c, others[i]) != NULL && comes_before(others[i], soonest))
            soonest = others[i];
    if (soonest != found && !any_is_late(c))           /* which looks at all workers' */
        found = soonest;
    return found->streams.count > 0 ? found : NULL;
}

/* ---- who has more than its share ------------------------------------------------------------- */

/* s that the worker of OWN takes for a window of each of its streams, and how many these are. */
static double lap_s(const struct slot *own, size_t *streams)
{
    double s = own->due[0].cost_s + own->due[1].cost_s + own->ahead_s;

    *streams = own->due[0].streams.count + own->due[1].streams.count + (size_t)own->ahead
             + (own->live != NULL);
    return own->live != NULL ? s + own->live->window.cost_s : s;
}

/* The longest lap of a worker that has more streams than one. */
static double longest_lap_s(const struct core *c)
{
    double longest = 0;
    size_t streams;

    for (int i = slot_after(c, -1); i >= 0; i = slot_after(c, i)) {
        const double lap = lap_s(&c->slots->at[i], &streams);
        longest = streams > 1 && is_coming(c, i) ? fmax(longest, lap) : longest;
    }
    return longest;
}

/* The worker of SLOT takes S, which it has, in its turn.  What is on time is no more than S's. */
static void count_lead(const struct core *c, int slot, const struct stream *s)
{
    const struct window *w = &s->window;
    struct slot *own = &c->slots->at[slot];
    const bool late = s->durable >= w->next + w->hop;
    size_t streams;
    double lap, longest, more;

    if (!late && !(own->lead > 0))
        return;
    lap = lap_s(own, &streams), longest = longest_lap_s(c);
    more = lap > 0 && longest > 0 ? w->cost_s * (1 / lap - FAIR / longest) : -own->lead;
    if (late || more < 0)
        own->lead = fmax(0, own->lead + more);
}

/* Whose streams are served better where TAKER has one of them, of these the one with the longest
 * lap; -1: there is none. */
static int crowded(const struct core *c, int taker)
{
    size_t streams;
    const double own = lap_s(&c->slots->at[taker], &streams);
    double longest = FAIR * own;
    int found = -1;

    for (int i = slot_after(c, -1); i >= 0; i = slot_after(c, i)) {
        const double lap = lap_s(&c->slots->at[i], &streams);
        if (lap > longest && is_coming(c, i)
            && (streams == 2 || (streams > 2 && own + lap / (double)streams < lap)))
            found = i, longest = lap;
    }
    return found;
}

/* Has TAKER so much more than its share that it takes S, which waits for the worker of SLOT? */
static bool evens_out(const struct core *c, int taker, int slot, const struct stream *s)
{
    const struct slot *own = &c->slots->at[slot], *other = &c->slots->at[taker];
    const struct window *w = &s->window;
    size_t streams, others;
    const double lap = lap_s(own, &streams), others_lap = lap_s(other, &others);

    if (!(other->lead * others_lap > 2 * fmax(0, w->anew_s - w->cost_s)) || w->alone
        || w->cost_s <= 0 || others == 0)
        return false;
    return (streams > 2 ? others_lap + w->cost_s < lap : s->id != own->latest)
        && crowded(c, taker) == slot;
}

/* Where the worker of SLOT, which is to go on with one that it has, takes another's before; NULL:
 * nowhere. */
static struct waiting *of_crowd(struct core *c, int slot)
{
    struct waiting *found = NULL;
    int crowd = c->slots->at[slot].lead > 0 ? crowded(c, slot) : -1;

    /* those of this round first */
    for (int which = 0; which < 2 && crowd >= 0 && found == NULL; which++) {
        struct waiting *list = &c->slots->at[crowd].due[(c->slots->round + which) % 2];
        const struct stream *s = first_due(c, list);
        found = s != NULL && evens_out(c, slot, crowd, s) ? list : NULL;
    }
    return found;
}

/* Is S, which the worker of SLOT has, to be left to another? */
static bool is_wanted(const struct core *c, int slot, const struct stream *s)
{
    bool is = false;

    for (int i = slot_after(c, -1); i >= 0 && !is; i = slot_after(c, i))
        is = c->slots->at[i].lead > 0 && i != slot && is_coming(c, i) && evens_out(c, i, slot, s);
    return is;
}

/* The worker of SLOT takes one of another's (of_crowd).  Of as many as are crowded one is helped,
 * and that share of what others have too much is used up with it. */
static void spend_lead(struct core *c, int slot)
{
    size_t streams;
    const double lap = lap_s(&c->slots->at[slot], &streams);
    int crowds = 0;

    for (int i = slot_after(c, -1); i >= 0; i = slot_after(c, i))
        crowds += lap_s(&c->slots->at[i], &streams) > FAIR * lap && streams > 1 && is_coming(c, i);
    for (int i = slot_after(c, -1); i >= 0; i = slot_after(c, i))
        c->slots->at[i].lead *= 1 - 1.0 / crowds;       /* that other is one */
    c->slots->at[slot].lead = 0;
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
    struct waiting *list, *other = NULL;
    struct stream *s;

    if (slots->due_count == 0)
        return NULL;
    begin_round(slots);
    list = own_list(c, slot);
    if (list == NULL)
        list = most_urgent(c, slot, (int)(slots->round % 2));
    if (list == NULL)
        list = most_urgent(c, slot, (int)((slots->round + 1) % 2));
    if (list == &worker->due[0] || list == &worker->due[1])
        other = of_crowd(c, slot);
    list = other != NULL ? other : list;
    s = list != NULL ? first_of(list) : NULL;
    if (s == NULL || (other == NULL && worker->live != NULL
                      && (s->window.alone || is_anothers(c, s, slot) || is_wanted(c, slot, s))))
        return NULL;
    if (other != NULL)
        spend_lead(c, slot);
    else if (window_is_with(c, s, slot))
        count_lead(c, slot, s);
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
    c->slots->at[slot].demand.s = c->slots->at[slot].lead = 0;
    for (int which = 0; which < 2; which++) {
        struct waiting *list = &c->slots->at[slot].due[which];
        while (list->streams.count > 0) {
            struct stream *s = first_out(c, list);
            s->window.slot = -1;
            put(c, s);
        }
    }
}
