/* peers.h - who is at the other end of a ROUTER: a number for each connection,
 * and a bounded queue to it
 *
 * A connection's routing id is libzmq's own, of five bytes, and comes once (intake.c): what is
 * meant for one reaches no other.
 */
#ifndef BROKER_PEERS_H
#define BROKER_PEERS_H
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include "broker/kit/blob.h"
#include "broker/kit/map.h"

enum {
    PEER_MESSAGES_MOST = 1024,    /* that wait for one connection: whoever reads none has no more */
    PEER_BYTES_MOST = 8 << 20,    /* of them: eight bodies */
    ROUTING_MOST = 5,             /* bytes of libzmq's own routing ids */
};

struct peer {
    uint64_t number;
    unsigned char routing[ROUTING_MOST];
    unsigned char routing_size;
    struct outgoing *first, **end; /* that wait for it; peers.c */
    int messages;
    size_t bytes;
    struct lent *lent;             /* and what libzmq has of them */
    int fd;                        /* its connection's, until accept_free */
    size_t said_long;              /* a worker's: bytes of long headers since its last RUN */
    bool full;                     /* its queue is over half: events wait */
    size_t waiting;                /* bytes of its requests at the ledger's door; door.c */
    bool ended;                    /* too much waited for it: nothing more is sent */
    struct peer *next_blocked;     /* of those that have a queue */
    bool blocked;
};

enum peer_change { PEER_SAME, PEER_FULL, PEER_READY, PEER_GONE };

struct peers {
    void *socket;                  /* ROUTER with ZMQ_ROUTER_MANDATORY */
    const char *version;           /* frame 0 */
    struct map by_routing, by_number, by_fd;
    uint64_t next;
    struct peer *blocked;
    int64_t dropped;
    atomic_size_t held, leaving;   /* bytes that wait; of those such as go with who is ended */
};

/* The peer whose routing id ROUTING is, made where it is new, on the connection of FD; NULL: that
 * is no id of libzmq's. */
struct peer *peers_by_routing(struct peers *peers, const void *routing, size_t size, int fd);
/* NULL: it is gone. */
struct peer *peers_by_number(const struct peers *peers, uint64_t number);

enum { PEER_ADDRESS_MOST = 80 };     /* an IPv6 address, its zone and its port */
/* Where NUMBER's connection comes from: an address and its port, or the process of this host that
 * made it (pid:N).  False: it is gone, or nobody knows. */
bool peers_address(const struct peers *peers, uint64_t number, char *text, size_t size);
/* Send, or queue; takes HEADER and BODY in every case.  Where too much waits, BODY is
 * dropped, or a connection that does not read is ended.  PEER_GONE: libzmq no longer knows it, and
 * it is freed. */
enum peer_change peers_send(struct peers *peers, struct peer *peer, const char *verb, char *header,
                            struct blob *body);
/* Try again what is queued; CHANGED is called for each peer whose state changes.  Whether anything
 * went out. */
bool peers_flush(struct peers *peers,
                 void (*changed)(void *context, uint64_t number, enum peer_change), void *context);
/* The connection of FD has ended: its peer is forgotten.  Its number; 0: it had none. */
uint64_t peers_ended(struct peers *peers, int fd);
/* All of them; the socket stays. */
void peers_done(struct peers *peers);
#endif
