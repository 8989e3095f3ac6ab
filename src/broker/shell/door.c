/*
 * door.c - the ledger is one queue, so who enters it does so in turn
 *
 * What is in the ledger's queue is committed in that order, whoever's it is: numbers of events and
 * edges of jobs follow each other.  So no more than a few groups of commits are let in, of which
 * nobody has so much that none is left for another (core_admits), and whatever else clients ask
 * that changes something waits here, in a queue of each user, or where there are no keys of each
 * connection.  What only reads passes by.
 *
 * A user may have a thousand connections, and each may send without reading an answer.  To stop
 * reading would make all others wait for one message of each; so who waits with more than his share
 * is answered `busy` at once.  Not so pushes of streams, where one that is refused among others
 * would be a gap: they have a credit.
 *
 * Nor is a flood taken in that only waits, or is told `busy` and sent again: a connection of which
 * DOOR_OWN wait is not read, so that its sender waits, and costs nothing.  Every DOOR_DEAF_NS each
 * is heard for a moment, for heartbeats are among what it sends.
 */
#include "broker/shell/door.h"
#include "broker/kit/memory.h"
#include "broker/shell/hold.h"
#include "wire/request.h"
#include <stdlib.h>
#include <string.h>

enum {
    OWN_COST = 1024,              /* of what holds a message, beside its frames */
    SHARED_MOST = 8192,           /* smaller frames are parts of a buffer of libzmq's, that stays */
};

struct waiting { struct fair_item fair; struct received received; };

static size_t size_of(const struct received *r)
{
    size_t size = OWN_COST;

    for (int i = 0; i < r->count && i < FRAMES_TAKEN; i++)
        size += r->frames[i]->size;
    return size;
}

bool door_admits(const struct door *door, const struct received *r, uint64_t turn)
{
    size_t size = size_of(r), own;

    if (door->waiting.size + size <= DOOR_MOST || received_verb(r) == WIRE_STREAM)
        return true;
    own = fair_queue_size(&door->waiting, turn);
    return own == 0 || own + size <= DOOR_MOST / (door->waiting.by_turn.count + 1);
}

static void own_frames(struct received *r)
{
    for (int i = 0; i < r->count && i < FRAMES_TAKEN; i++)
        if (r->frames[i]->size < SHARED_MOST) {
            size_t size = r->frames[i]->size;
            char *copy = grab(size + 1);

            memcpy(copy, r->frames[i]->data, size);
            blob_drop(r->frames[i]);
            r->frames[i] = blob_take(copy, size);
            if (r->frames[i] == NULL)
                abort();
        }
}

void door_put(struct door *door, struct received *r, uint64_t turn)
{
    struct waiting *w = grab(sizeof *w);

    if (r->peer != NULL) {
        r->peer->waiting += size_of(r);
        if (r->peer->waiting > DOOR_OWN)
            hold_set(r->peer->fd, true);
    }
    own_frames(r);
    w->received = *r;
    w->received.peer = NULL;
    w->fair.turn = turn;
    w->fair.size = size_of(r);
    fair_queue_put(&door->waiting, &w->fair);
    memset(r->frames, 0, sizeof r->frames);
    r->count = 0;
}

bool door_take(struct door *door, fair_may *may, const void *context, struct received *r,
               uint64_t *turn)
{
    struct waiting *w = (struct waiting *)fair_queue_take(&door->waiting, may, context);

    if (w == NULL)
        return false;
    *r = w->received;
    *turn = w->fair.turn;
    free(w);
    return true;
}

void door_left(struct peer *peer, const struct received *r)
{
    if (peer == NULL)
        return;
    peer->waiting -= size_of(r);
    if (peer->waiting < DOOR_OWN / 2)
        hold_set(peer->fd, false);
}

void door_hear_all(const struct peers *peers)
{
    struct peer *peer;

    for (size_t at = 0; (peer = map_next(&peers->by_number, &at)) != NULL;)
        if (peer->waiting >= DOOR_OWN / 2)
            hold_set(peer->fd, false);
}

void door_done(struct door *door)
{
    struct received r;
    uint64_t turn;

    while (door_take(door, NULL, NULL, &r, &turn))
        received_release(&r);
}
