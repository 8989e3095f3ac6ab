/* zap.c - see zap.h */
#include "broker/shell/zap.h"
#include <stdio.h>
#include <string.h>
#include <zmq.h>

/* of a CURVE request, the sender's routing id and the delimiter among them, as RFC 27 has them */
enum { ROUTING, EMPTY, VERSION, REQUEST, DOMAIN, ADDRESS, IDENTITY, MECHANISM, KEY, FRAMES };
enum { KEY_BYTES = 32 };     /* a public key of CURVE; 40 characters in Z85 */

void *zap_open(void *context)
{
    void *socket = zmq_socket(context, ZMQ_ROUTER);

    if (socket != NULL && zmq_bind(socket, "inproc://zeromq.zap.01") != 0) {
        zmq_close(socket);
        return NULL;
    }
    return socket;
}

/* Frames of one request; the number read, more than FRAMES are dropped. */
static int receive(void *socket, zmq_msg_t frames[FRAMES])
{
    int count = 0, more = 1;

    while (more) {
        zmq_msg_t frame;
        zmq_msg_init(&frame);
        if (zmq_msg_recv(&frame, socket, ZMQ_DONTWAIT) < 0) {
            zmq_msg_close(&frame);
            return count;
        }
        more = zmq_msg_more(&frame);
        if (count < FRAMES) {
            zmq_msg_init(&frames[count]);
            zmq_msg_move(&frames[count++], &frame);
        }
        zmq_msg_close(&frame);
    }
    return count;
}

static bool is(zmq_msg_t *frame, const char *text)
{
    return zmq_msg_size(frame) == strlen(text)
        && memcmp(zmq_msg_data(frame), text, strlen(text)) == 0;
}

static void answer(void *socket, zmq_msg_t *routing, zmq_msg_t *version, zmq_msg_t *request,
                   const char *user)
{
    const char *parts[] = {
        user != NULL ? "200" : "400", user != NULL ? "OK" : "no such key",
        user != NULL ? user : "", "" };

    zmq_msg_send(routing, socket, ZMQ_SNDMORE | ZMQ_DONTWAIT);
    zmq_send(socket, "", 0, ZMQ_SNDMORE | ZMQ_DONTWAIT);
    zmq_msg_send(version, socket, ZMQ_SNDMORE | ZMQ_DONTWAIT);
    zmq_msg_send(request, socket, ZMQ_SNDMORE | ZMQ_DONTWAIT);
    for (int i = 0; i < 4; i++)
        zmq_send(socket, parts[i], strlen(parts[i]), (i < 3 ? ZMQ_SNDMORE : 0) | ZMQ_DONTWAIT);
}

/* The address is libzmq's own text, of digits, dots, colons and the like. */
static void note(struct zap_refused *refused, const char *key, zmq_msg_t *address)
{
    size_t size = zmq_msg_size(address) < sizeof refused->address - 1 ? zmq_msg_size(address)
                                                                      : sizeof refused->address - 1;

    refused->count++;
    snprintf(refused->key, sizeof refused->key, "%s", key);
    memcpy(refused->address, zmq_msg_data(address), size);
    refused->address[size] = 0;
}

void zap_answer(void *socket, const struct account *accounts, size_t count,
                struct zap_refused *refused)
{
    zmq_msg_t frames[FRAMES];
    int n;

    while ((n = receive(socket, frames)) > 0) {
        char key[41] = "";
        const char *user = NULL;
        const bool workers = n > DOMAIN && is(&frames[DOMAIN], ZAP_WORKERS);

        if (n == FRAMES && is(&frames[MECHANISM], "CURVE")
            && zmq_msg_size(&frames[KEY]) == KEY_BYTES)
            zmq_z85_encode(key, zmq_msg_data(&frames[KEY]), KEY_BYTES);
        for (size_t i = 0; key[0] != 0 && i < count; i++)
            if (strcmp(accounts[i].key, key) == 0
                && workers == (accounts[i].role == WIRE_ROLE_WORKER))
                user = accounts[i].key;
        if (n > REQUEST)
            answer(socket, &frames[ROUTING], &frames[VERSION], &frames[REQUEST], user);
        if (user == NULL && n > ADDRESS)
            note(refused, key, &frames[ADDRESS]);
        for (int i = 0; i < n; i++)
            zmq_msg_close(&frames[i]);
    }
}
