/*
 * bench_pieces.c - ZeroMQ alone: 100 MB in pieces of 1 MiB over CURVE on loopback, four under way
 *
 * What bench_remote.py holds the daemon's INPUT and CHUNK against: a ROUTER that answers from
 * memory and a DEALER that copies what comes to its place, a thread each with a context of its own,
 * and nothing else.  The bytes are checked before the figure is told.
 */
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <zmq.h>

enum {
    PIECE  = 1 << 20,          /* WIRE_BODY_MOST */
    CREDIT = 4,                /* WIRE_PULLS_MOST */
    PIECES = 100,
    KEY    = 41,               /* of Z85, with its end */
    NAME   = 64,               /* an endpoint; a routing id */
};

struct raw {
    char public[KEY], secret[KEY], endpoint[NAME];
    void *server;
    unsigned char *data;
};

static void need(int good, const char *what)
{
    if (good)
        return;
    fprintf(stderr, "bench_pieces: %s: %s\n", what, zmq_strerror(zmq_errno()));
    exit(1);
}

static double seconds(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* As many answers as there are pieces, and one before. */
static void *serve(void *argument)
{
    struct raw *raw = argument;
    char peer[NAME];
    uint32_t at;

    for (int i = 0; i <= PIECES; i++) {
        const int length = zmq_recv(raw->server, peer, sizeof peer, 0);

        need(length > 0 && zmq_recv(raw->server, &at, sizeof at, 0) == sizeof at, "a request");
        need(zmq_send(raw->server, peer, (size_t)length, ZMQ_SNDMORE) >= 0
                 && zmq_send(raw->server, &at, sizeof at, ZMQ_SNDMORE) >= 0
                 && zmq_send(raw->server, raw->data + (size_t)at * PIECE, PIECE, 0) == PIECE,
             "an answer");
    }
    return NULL;
}

static void start_server(struct raw *raw, void *context)
{
    const int yes = 1;
    size_t length = sizeof raw->endpoint;

    raw->server = zmq_socket(context, ZMQ_ROUTER);
    need(zmq_curve_keypair(raw->public, raw->secret) == 0
             && zmq_setsockopt(raw->server, ZMQ_CURVE_SERVER, &yes, sizeof yes) == 0
             && zmq_setsockopt(raw->server, ZMQ_CURVE_SECRETKEY, raw->secret, KEY) == 0
             && zmq_bind(raw->server, "tcp://127.0.0.1:*") == 0
             && zmq_getsockopt(raw->server, ZMQ_LAST_ENDPOINT, raw->endpoint, &length) == 0,
         "the server");
}

static void *start_client(const struct raw *raw, void *context)
{
    void *client = zmq_socket(context, ZMQ_DEALER);
    char public[KEY], secret[KEY];

    need(zmq_curve_keypair(public, secret) == 0
             && zmq_setsockopt(client, ZMQ_CURVE_SERVERKEY, raw->public, KEY) == 0
             && zmq_setsockopt(client, ZMQ_CURVE_PUBLICKEY, public, KEY) == 0
             && zmq_setsockopt(client, ZMQ_CURVE_SECRETKEY, secret, KEY) == 0
             && zmq_connect(client, raw->endpoint) == 0,
         "the client");
    return client;
}

static void ask(void *client, uint32_t at)
{
    need(zmq_send(client, &at, sizeof at, 0) >= 0, "a request");
}

/* A piece to its place in OUT. */
static void hear(void *client, unsigned char *out)
{
    zmq_msg_t body;
    uint32_t at;

    zmq_msg_init(&body);
    need(zmq_recv(client, &at, sizeof at, 0) == sizeof at
             && zmq_msg_recv(&body, client, 0) == PIECE && at < PIECES, "a piece");
    memcpy(out + (size_t)at * PIECE, zmq_msg_data(&body), PIECE);
    zmq_msg_close(&body);
}

/* All pieces into OUT; bytes a second from the first request to the last piece, once the connection
 * stands. */
static double pull(void *client, unsigned char *out)
{
    uint32_t asked = 0;
    double began;

    ask(client, 0);
    hear(client, out);
    began = seconds();
    for (int got = 0; got < PIECES; got++) {
        for (; asked < PIECES && (int)asked - got < CREDIT; asked++)
            ask(client, asked);
        hear(client, out);
    }
    return (double)PIECES * PIECE / (seconds() - began);
}

int main(void)
{
    void *here = zmq_ctx_new(), *there = zmq_ctx_new(), *client;
    unsigned char *out = calloc(PIECES, PIECE);
    struct raw raw = { .data = malloc((size_t)PIECES * PIECE) };
    pthread_t thread;
    uint64_t state = 1;
    double rate;

    need(out != NULL && raw.data != NULL && here != NULL && there != NULL, "memory");
    for (size_t i = 0; i < (size_t)PIECES * PIECE; i++) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        raw.data[i] = (unsigned char)(state >> 56);
    }
    start_server(&raw, there);
    client = start_client(&raw, here);
    need(pthread_create(&thread, NULL, serve, &raw) == 0, "a thread");
    rate = pull(client, out);
    pthread_join(thread, NULL);
    need(memcmp(out, raw.data, (size_t)PIECES * PIECE) == 0, "the bytes");
    printf("{\"bench\":\"pieces\",\"case\":\"100 MB raw\",\"value\":%.1f,\"unit\":\"MB/s\","
           "\"peer\":null,\"ratio\":null,\"n\":1}\n", rate / 1e6);
    zmq_close(client);
    zmq_close(raw.server);
    zmq_ctx_term(here);
    zmq_ctx_term(there);
    free(out);
    free(raw.data);
    return 0;
}
