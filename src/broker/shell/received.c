/* received.c - see received.h */
#include "broker/shell/received.h"
#include "broker/kit/memory.h"
#include "broker/shell/intake.h"
#include "wire/request.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

struct message_blob { struct blob blob; zmq_msg_t message; };

static void release_message(struct blob *blob)
{
    struct message_blob *m = (struct message_blob *)blob;

    zmq_msg_close(&m->message);
    free(m);
}

/* A received frame as a blob that keeps the message, without a copy. */
static struct blob *blob_of(zmq_msg_t *message)
{
    struct message_blob *m = grab(sizeof *m);

    zmq_msg_init(&m->message);
    zmq_msg_move(&m->message, message);
    m->blob =
        (struct blob) { zmq_msg_data(&m->message), zmq_msg_size(&m->message), 1, release_message };
    return &m->blob;
}

/* Whose FRAME is, the first after ROUTING.  libzmq names no descriptor where the other end's
 * address was gone when it was accepted: who cannot be answered is not heard. */
static void note_sender(struct peers *peers, struct received *r, zmq_msg_t *routing,
                        zmq_msg_t *frame)
{
    const char *user = zmq_msg_gets(frame, "User-Id");
    int fd = zmq_msg_get(frame, ZMQ_SRCFD);

    if (user != NULL)
        snprintf(r->key, sizeof r->key, "%s", user);
    if (fd < 0)
        return;
    r->peer = peers_by_routing(peers, zmq_msg_data(routing), zmq_msg_size(routing), fd);
    r->number = r->peer == NULL ? 0 : r->peer->number;
    intake_taken(fd);
}

static bool receive_frame(struct peers *peers, zmq_msg_t *frame)
{
    zmq_msg_init(frame);
    if (zmq_msg_recv(frame, peers->socket, ZMQ_DONTWAIT) >= 0)
        return true;
    zmq_msg_close(frame);
    return false;
}

/* Frames over the limit are received and dropped one by one. */
bool received_take(struct peers *peers, struct received *r)
{
    zmq_msg_t routing, frame;
    bool more;

    memset(r, 0, sizeof *r);
    if (!receive_frame(peers, &routing))
        return false;
    more = zmq_msg_more(&routing);
    while (more && receive_frame(peers, &frame)) {
        if (r->count == 0)
            note_sender(peers, r, &routing, &frame);
        more = zmq_msg_more(&frame);
        if (r->count < FRAMES_TAKEN)
            r->frames[r->count] = blob_of(&frame);
        r->count++;
        zmq_msg_close(&frame);
    }
    zmq_msg_close(&routing);
    return true;
}

void received_release(struct received *r)
{
    for (int i = 0; i < r->count && i < FRAMES_TAKEN; i++)
        blob_drop(r->frames[i]);
}

static enum modal_status open_as(const struct received *r, const char *version, bool needs_id,
                                 struct wire_message *out, struct modal_error *err)
{
    struct wire_frame frames[FRAMES_TAKEN];

    for (int i = 0; i < r->count && i < FRAMES_TAKEN; i++)
        frames[i] = (struct wire_frame) { r->frames[i]->data, r->frames[i]->size };
    return wire_open(frames, r->count < FRAMES_TAKEN ? r->count : FRAMES_TAKEN, version, needs_id,
                     out, err);
}

enum modal_status received_open(const struct received *r, struct wire_message *out,
                                struct modal_error *err)
{
    return open_as(r, WIRE_VERSION, true, out, err);
}

static size_t header_size(const struct received *r)
{
    return r->count > 2 ? r->frames[2]->size : 0;
}

enum modal_status received_open_worker(const struct received *r, struct wire_message *out,
                                       struct modal_error *err)
{
    const size_t header = header_size(r);

    if (header > WIRE_SAID_MOST && r->peer != NULL
        && (r->peer->said_long += header) > WIRE_SAID_LONG_MOST) {
        memset(out, 0, sizeof *out);
        return modal_fail(err, MODAL_BAD_FRAME, "headers over %d bytes of %zu since the last RUN; "
                          "accepted: at most %d of them", WIRE_SAID_MOST, r->peer->said_long,
                          WIRE_SAID_LONG_MOST);
    }
    return open_as(r, WIRE_WORKER, false, out, err);
}

bool received_untold(const struct received *r)
{
    static const char verb[] = "PROGRESS";

    return header_size(r) > WIRE_SAID_MOST && r->frames[1]->size == sizeof verb - 1
           && memcmp(r->frames[1]->data, verb, sizeof verb - 1) == 0;
}

int received_verb(const struct received *r)
{
    char verb[WIRE_VERB_MOST + 1] = "";

    if (r->count < 2 || r->frames[1]->size > WIRE_VERB_MOST)
        return -1;
    memcpy(verb, r->frames[1]->data, r->frames[1]->size);
    return wire_verb_find(verb);
}
