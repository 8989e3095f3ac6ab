/* transaction.c - changes that are committed together, and what follows from it */
#include "broker/core/state.h"
#include "base/crc32c.h"
#include <stdlib.h>
#include <string.h>

struct transaction *transaction_new(void)
{
    struct transaction *t = grab(sizeof *t);

    t->after_end = &t->after;
    return t;
}

struct ledger_change *transaction_add(struct transaction *t, enum ledger_verb verb)
{
    struct ledger_change *change;

    if (t->count == t->room) {
        t->room = t->room ? 2 * t->room : 3;
        t->changes = regrab(t->changes, t->room * sizeof *t->changes);
    }
    change = &t->changes[t->count++];
    memset(change, 0, sizeof *change);
    change->verb = verb;
    return change;
}

const char *transaction_text(struct transaction *t, const char *text)
{
    return arena_text(&t->arena, text);
}

void transaction_keep(struct transaction *t, struct blob *blob, size_t size)
{
    t->cost += (int64_t)size;
    for (size_t i = 0; i < sizeof t->keep / sizeof *t->keep; i++)
        if (t->keep[i] == NULL) {
            t->keep[i] = blob_share(blob);
            return;
        }
    abort();                                 /* no transaction has more bodies: a bug */
}

void transaction_add_sums(struct transaction *t, int64_t input, const struct sums *sums)
{
    for (size_t i = 0; i < sums->count; i++) {
        struct ledger_change *change = transaction_add(t, LEDGER_CHUNK_PUT);
        change->input_id = input;
        change->chunk = sums->items[i];
    }
}

/* It joins those before while all of them are not more than a chunk may be, so that chunks of a
 * byte have no rows each, which nobody is charged for. */
void transaction_add_chunk(struct transaction *t, int64_t input, struct chunk_record *row,
                           const struct chunk_record *chunk)
{
    bool joins = row->length > 0 && row->offset + row->length == chunk->offset
                 && row->length + chunk->length <= WIRE_CHUNK_MOST;
    struct ledger_change *change;

    if (joins) {
        row->crc = crc32c_join(row->crc, chunk->crc, chunk->length);
        row->length += chunk->length;
    } else
        *row = *chunk;
    change = joins && t->count > 0 ? &t->changes[t->count - 1]
                                   : transaction_add(t, LEDGER_CHUNK_PUT);
    change->input_id = input;
    change->chunk = *row;
}

struct after *after_new(enum after_type type, const struct reply *reply)
{
    struct after *after = grab(sizeof *after);

    after->type = type;
    if (reply != NULL)
        after->reply = *reply;
    return after;
}

void after_free(struct after *after)
{
    while (after != NULL) {
        struct after *next = after->next;
        free(after->text);
        free(after->err);
        task_free(after->task);
        free(after);
        after = next;
    }
}

void after_append(struct after **list, struct after *after)
{
    while (*list != NULL)
        list = &(*list)->next;
    *list = after;
}

struct after *transaction_after(struct transaction *t, enum after_type type)
{
    struct after *after = after_new(type, NULL);

    transaction_join(t, after);
    return after;
}

void transaction_join(struct transaction *t, struct after *after)
{
    *t->after_end = after;
    while (*t->after_end != NULL)
        t->after_end = &(*t->after_end)->next;
}

/* What the ledger has before it is some two groups of commits, the one that is written and the one
 * behind it.  Who has nothing there goes into the latter at once: he waits for less than two syncs
 * where another's flood is, for one where none is.  A transaction of a few rows takes as long as
 * some COST bytes more in one that has many (30 us, at 150 MB/s), so that what one alone may have,
 * half of BEHIND_MOST, is 15 ms of work, or 512 submissions a sync where the disk is slow.  On a
 * full disk that refuses the rest, what must pass may wait for room for long, and those behind it
 * are to be told. */
enum {
    COST = 4096,                  /* bytes, as above */
    BEHIND_MOST = 4 << 20,        /* bytes, as above */
    HEAVY = BEHIND_MOST / 16      /* 2 ms of work: about as long as a sync */
};

bool core_admits(const struct core *c, uint64_t turn)
{
    return c->disk.full || shares_admit(&c->behind, turn, BEHIND_MOST);
}

bool core_bars(const struct core *c, uint64_t turn)
{
    return !c->disk.full && spell_bars(&c->spell, turn, c->now.mono_ns);
}

int64_t core_lets_in(const struct core *c)
{
    return c->disk.full ? 0 : spell_next_ns(&c->spell);
}

void core_commit(struct core *c, struct transaction *t)
{
    t->cost += COST;
    t->turn = c->asking;
    t->heavy = c->waited || (t->turn != 0 && shares_of(&c->behind, t->turn) >= HEAVY);
    if (t->heavy)
        spell_put(&c->spell, t, c->now.mono_ns);
    shares_add(&c->behind, t->turn, t->cost);
    c->uncommitted++;
    t->before = c->newest;
    *(c->newest == NULL ? &c->oldest : &c->newest->after_it) = t;
    c->newest = t;
    core_act(c, (struct action) { .type = ACT_COMMIT, .transaction = t });
}

void core_committed(struct core *c, struct transaction *t)
{
    *(t->before == NULL ? &c->oldest : &t->before->after_it) = t->after_it;
    *(t->after_it == NULL ? &c->newest : &t->after_it->before) = t->before;
    shares_add(&c->behind, t->turn, -t->cost);
    c->uncommitted--;
}

struct task *task_new(enum task_type type, int64_t id)
{
    struct task *task = grab(sizeof *task);

    task->type = type;
    task->id = id;
    return task;
}

void core_task(struct core *c, struct task *task, uint64_t turn)
{
    task->fair.turn = turn;
    c->tasks++;
    core_act(c, (struct action) { .type = ACT_TASK, .task = task });
}

void core_task_settled(struct core *c, struct task *task, uint64_t turn)
{
    struct transaction *t = transaction_new();

    task->fair.turn = turn;
    t->refusable = FIRST_REFUSED;
    transaction_add(t, LEDGER_SAMPLES_SETTLE)->id = task->stream;
    transaction_after(t, AFTER_TASK)->task = task;
    core_commit(c, t);
}

void transaction_free(struct transaction *t)
{
    if (t == NULL)
        return;
    for (size_t i = 0; i < sizeof t->keep / sizeof *t->keep; i++)
        blob_drop(t->keep[i]);
    after_free(t->after);
    arena_free(t->arena);
    free(t->changes);
    free(t);
}

void task_free(struct task *task)
{
    if (task == NULL)
        return;
    for (int i = 0; i < task->count; i++)
        blob_drop(task->chunks[i]);
    for (int i = 0; i < task->event_count; i++) {
        free(task->events[i].user);
        free(task->events[i].topic);
        free(task->events[i].text);
    }
    free(task->events);
    free(task->sums.items);
    blob_drop(task->text);
    after_free(task->after);
    free(task);
}
