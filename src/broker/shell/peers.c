/*
 * peers.c - see peers.h
 *
 * With ZMQ_ROUTER_MANDATORY the first frame says what will become of a message: EAGAIN (the peer's
 * pipe is full), or EHOSTUNREACH (the peer is gone); the frames after it are taken.  libzmq does
 * not say when a pipe has room again, so the loop tries while there are queues, and only then.
 *
 * A pipe counts messages and no bytes, 64 of 1 MiB, and connections are many.  So libzmq is lent
 * what it has of each peer's and gives it back once it is written; and past HELD_MOST of all peers
 * those bodies are dropped that are for whom more waits than an equal share.  Whoever has less is
 * sent his, and of those with more than a share the one that has read nothing for longest is ended
 * in their place: where each that came had a share of his time, a thousand in turn had 256 MiB and
 * a logarithm of them.
 */
#include "broker/shell/peers.h"
#include "broker/shell/intake.h"
#include <errno.h>
#include <netdb.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <zmq.h>

/* Messages that wait while a peer is told full, and under which it is ready again: apart, so that
 * events neither stop nor go on with each message. */
enum {
    FULL_FROM = 16,      /* of 1 MiB at most: 16 MiB a peer that reads nothing */
    READY_BELOW = 4,     /* not 0: there is something to send meanwhile */
};

enum { HELD_MOST = 32 * PEER_BYTES_MOST };      /* bytes of all peers: of 32 that read nothing */

/* What libzmq has of a peer's, which may be gone before it is given back. */
struct lent {
    struct peers *of;
    atomic_int holders;            /* the peer, and messages; the last frees it */
    atomic_size_t bytes;
    atomic_llong moved;            /* ns: when some were given back, or the first lent */
    size_t leaving;                /* of `bytes`, when the peer was ended */
};

/* A message, queued or lent. */
struct outgoing {
    struct outgoing *next;
    struct lent *lent;
    const char *verb;
    char *header;
    struct blob *body;
    size_t size;
    atomic_int frames;             /* of header and body, lent */
};

struct routing { const void *data; size_t size; };

static bool has_routing(const void *value, const void *key)
{
    const struct peer *peer = value;
    const struct routing *r = key;

    return peer->routing_size == r->size && memcmp(peer->routing, r->data, r->size) == 0;
}

struct peer *peers_by_number(const struct peers *peers, uint64_t number)
{
    return map_find_number(&peers->by_number, number);
}

bool peers_address(const struct peers *peers, uint64_t number, char *text, size_t size)
{
    const struct peer *peer = peers_by_number(peers, number);
    struct sockaddr_storage from;
    socklen_t length = sizeof from, credentials = sizeof(struct ucred);
    char host[64], port[8];
    struct ucred who;

    if (peer == NULL || getpeername(peer->fd, (struct sockaddr *)&from, &length) != 0)
        return false;
    if (from.ss_family == AF_UNIX) {
        if (getsockopt(peer->fd, SOL_SOCKET, SO_PEERCRED, &who, &credentials) != 0)
            return false;
        snprintf(text, size, "pid:%d", (int)who.pid);
        return true;
    }
    if (getnameinfo((struct sockaddr *)&from, length, host, sizeof host, port, sizeof port,
                    NI_NUMERICHOST | NI_NUMERICSERV) != 0)
        return false;
    snprintf(text, size, from.ss_family == AF_INET6 ? "[%s]:%s" : "%s:%s", host, port);
    return true;
}

struct peer *peers_by_routing(struct peers *peers, const void *data, size_t size, int fd)
{
    struct routing key = { data, size };
    uint64_t hash = map_hash(data, size);
    struct peer *peer =
        size > ROUTING_MOST ? NULL : map_find(&peers->by_routing, hash, has_routing, &key);

    if (peer != NULL || size > ROUTING_MOST)
        return peer;
    peer = calloc(1, sizeof *peer);
    if (peer == NULL || (peer->lent = calloc(1, sizeof *peer->lent)) == NULL) {
        free(peer);
        return NULL;
    }
    peer->lent->of = peers;
    atomic_init(&peer->lent->holders, 1);
    peer->number = ++peers->next;
    peer->fd = fd;
    memcpy(peer->routing, data, size);
    peer->routing_size = (unsigned char)size;
    peer->end = &peer->first;
    if (!map_put(&peers->by_routing, hash, peer)
        || !map_put(&peers->by_number, map_hash_number(peer->number), peer)
        || !map_put(&peers->by_fd, map_hash_number((uint64_t)fd), peer))
        abort();
    return peer;
}

static void drop_lent(struct lent *lent)
{
    if (atomic_fetch_sub(&lent->holders, 1) > 1)
        return;
    atomic_fetch_sub_explicit(&lent->of->leaving, lent->leaving, memory_order_relaxed);
    free(lent);
}

static void free_outgoing(struct outgoing *o)
{
    atomic_fetch_sub_explicit(&o->lent->of->held, o->size, memory_order_relaxed);
    free(o->header);
    blob_drop(o->body);
    free(o);
}

static void unblock(struct peers *peers, struct peer *peer)
{
    struct peer **link = &peers->blocked;

    while (*link != NULL && *link != peer)
        link = &(*link)->next_blocked;
    if (*link == peer)
        *link = peer->next_blocked;
    peer->blocked = false;
}

static void drop_queue(struct peers *peers, struct peer *peer)
{
    while (peer->first != NULL) {
        struct outgoing *next = peer->first->next;
        free_outgoing(peer->first);
        peer->first = next;
    }
    peer->end = &peer->first;
    peer->messages = 0;
    peer->bytes = 0;
    if (peer->blocked)
        unblock(peers, peer);
}

static void forget(struct peers *peers, struct peer *peer)
{
    drop_queue(peers, peer);
    map_remove(&peers->by_routing, map_hash(peer->routing, peer->routing_size), peer);
    map_remove(&peers->by_number, map_hash_number(peer->number), peer);
    map_remove(&peers->by_fd, map_hash_number((uint64_t)peer->fd), peer);
    drop_lent(peer->lent);
    free(peer);
}

/* LENT has moved: now, to the few ms of a clock that costs no system call. */
static void note_moved(struct lent *lent)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC_COARSE, &t);
    atomic_store_explicit(&lent->moved, t.tv_sec * INT64_C(1000000000) + t.tv_nsec,
                          memory_order_relaxed);
}

/* libzmq is done with a frame of the message HINT, in its thread or ours. */
static void give_back(void *data, void *hint)
{
    struct outgoing *o = hint;
    struct lent *lent = o->lent;

    (void)data;
    if (atomic_fetch_sub(&o->frames, 1) > 1)
        return;
    atomic_fetch_sub_explicit(&lent->bytes, o->size, memory_order_relaxed);
    note_moved(lent);
    free_outgoing(o);
    drop_lent(lent);
}

/* A frame of O behind those that are taken, which are taken as well. */
static void lend(struct peers *peers, struct outgoing *o, const void *data, size_t size, int flags)
{
    zmq_msg_t message;

    zmq_msg_init_data(&message, (void *)data, size, give_back, o);
    if (zmq_msg_send(&message, peers->socket, flags | ZMQ_DONTWAIT) < 0)
        zmq_msg_close(&message);
}

/* 0: sent, O taken; else the error, nothing taken. */
static int try_send(struct peers *peers, const struct peer *peer, struct outgoing *o)
{
    const struct blob *body = o->body;

    if (zmq_send(peers->socket, peer->routing, peer->routing_size, ZMQ_SNDMORE | ZMQ_DONTWAIT) < 0)
        return errno;
    zmq_send(peers->socket, peers->version, strlen(peers->version), ZMQ_SNDMORE | ZMQ_DONTWAIT);
    zmq_send(peers->socket, o->verb, strlen(o->verb), ZMQ_SNDMORE | ZMQ_DONTWAIT);
    atomic_fetch_add(&o->lent->holders, 1);
    if (atomic_fetch_add_explicit(&o->lent->bytes, o->size, memory_order_relaxed) == 0)
        note_moved(o->lent);
    atomic_init(&o->frames, body != NULL ? 2 : 1);
    /* the last frame may take O with it before this returns */
    lend(peers, o, o->header, strlen(o->header), body != NULL ? ZMQ_SNDMORE : 0);
    if (body != NULL)
        lend(peers, o, body->data, body->size, 0);
    return 0;
}

static size_t waits_for(const struct peer *peer)
{
    return peer->bytes + atomic_load_explicit(&peer->lent->bytes, memory_order_relaxed);
}

/* Nothing more is sent to PEER, and what waits for it goes with its connection. */
static void end_peer(struct peers *peers, struct peer *peer)
{
    drop_queue(peers, peer);
    peer->ended = true;
    peer->lent->leaving = waits_for(peer);
    atomic_fetch_add_explicit(&peers->leaving, peer->lent->leaving, memory_order_relaxed);
    intake_hang_up(peer->fd);
}

/* Of those for whom more waits than SHARE, the one that has read nothing for longest; NULL: there
 * is none. */
static struct peer *most_deaf(const struct peers *peers, size_t share)
{
    struct peer *found = NULL, *peer;
    size_t at = 0;

    while ((peer = map_next(&peers->by_number, &at)) != NULL)
        if (!peer->ended && waits_for(peer) > share
            && (found == NULL || atomic_load(&peer->lent->moved)
                                     < atomic_load(&found->lent->moved)))
            found = peer;
    return found;
}

/* May O wait for PEER?  Where too much waits for all, O being a body, it must be within PEER's
 * share, and then another gives way, who has more than his. */
static bool may_wait(struct peers *peers, const struct peer *peer, const struct outgoing *o)
{
    size_t own = waits_for(peer), share;
    struct peer *other;

    if (o->body == NULL
        || atomic_load_explicit(&peers->held, memory_order_relaxed)
               <= HELD_MOST + atomic_load_explicit(&peers->leaving, memory_order_relaxed))
        return true;
    share = HELD_MOST / peers->by_number.count;
    if (own > 0 && own + o->size > share)
        return false;
    other = most_deaf(peers, share);
    if (other != NULL)
        end_peer(peers, other);
    return true;
}

static void enqueue(struct peers *peers, struct peer *peer, struct outgoing *o)
{
    if (peer->messages >= PEER_MESSAGES_MOST || peer->bytes + o->size > PEER_BYTES_MOST) {
        peers->dropped++;                          /* it asks again when it reads again */
        free_outgoing(o);
        return;
    }
    *peer->end = o;
    peer->end = &o->next;
    peer->messages++;
    peer->bytes += o->size;
    if (!peer->blocked) {
        peer->blocked = true;
        peer->next_blocked = peers->blocked;
        peers->blocked = peer;
    }
}

enum peer_change peers_send(struct peers *peers, struct peer *peer, const char *verb, char *header,
                            struct blob *body)
{
    struct outgoing *o = calloc(1, sizeof *o);
    int error;

    if (o == NULL)
        abort();
    *o = (struct outgoing) { .verb = verb, .header = header, .body = body, .lent = peer->lent,
                             .size = strlen(header) + (body == NULL ? 0 : body->size) };
    atomic_fetch_add_explicit(&peers->held, o->size, memory_order_relaxed);
    if (peer->ended || !may_wait(peers, peer, o)) {
        peers->dropped++;                          /* it asks again when it reads again */
        free_outgoing(o);
        return PEER_SAME;
    }
    error = peer->first != NULL ? EAGAIN : try_send(peers, peer, o);
    if (error == EAGAIN) {
        enqueue(peers, peer, o);
        if (peer->full || peer->messages < FULL_FROM)
            return PEER_SAME;
        peer->full = true;
        return PEER_FULL;
    }
    if (error == 0)
        return PEER_SAME;
    free_outgoing(o);
    forget(peers, peer);
    return PEER_GONE;
}

/* What is queued for PEER, as far as it goes. */
static int drain(struct peers *peers, struct peer *peer)
{
    int error = 0;

    while (peer->first != NULL) {
        struct outgoing *o = peer->first, *next = o->next;
        size_t size = o->size;
        if ((error = try_send(peers, peer, o)) != 0)
            break;
        peer->first = next;
        if (next == NULL)
            peer->end = &peer->first;
        peer->messages--;
        peer->bytes -= size;
    }
    return error;
}

bool peers_flush(struct peers *peers, void (*changed)(void *, uint64_t, enum peer_change),
                 void *context)
{
    bool moved = false;

    for (struct peer *peer = peers->blocked, *next; peer != NULL; peer = next) {
        const struct outgoing *before = peer->first;
        int error = drain(peers, peer);

        moved |= peer->first != before;

        next = peer->next_blocked;
        if (error != 0 && error != EAGAIN) {
            uint64_t number = peer->number;
            forget(peers, peer);
            changed(context, number, PEER_GONE);
            continue;
        }
        if (peer->first == NULL)
            unblock(peers, peer);
        if (peer->full && peer->messages < READY_BELOW) {
            peer->full = false;
            changed(context, peer->number, PEER_READY);
        }
    }
    return moved;
}

uint64_t peers_ended(struct peers *peers, int fd)
{
    struct peer *peer = map_find_number(&peers->by_fd, (uint64_t)fd);
    uint64_t number = peer == NULL ? 0 : peer->number;

    if (peer != NULL)
        forget(peers, peer);
    return number;
}

void peers_done(struct peers *peers)
{
    size_t at = 0;
    struct peer *peer;

    while ((peer = map_next(&peers->by_number, &at)) != NULL)
        forget(peers, peer);
    map_done(&peers->by_number);
    map_done(&peers->by_routing);
    map_done(&peers->by_fd);
}
