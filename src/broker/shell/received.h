/* received.h - messages as they come from a socket */
#ifndef BROKER_RECEIVED_H
#define BROKER_RECEIVED_H
#include "broker/core/core.h"
#include "broker/shell/peers.h"
#include "wire/frame.h"

enum { FRAMES_TAKEN = WIRE_FRAMES_MOST + 1 };  /* one more tells that there are too many */

struct received {
    /* without the routing id; the last is never filled */
    struct blob *frames[FRAMES_TAKEN + 1];
    int count;                                 /* of all frames, also those that were dropped */
    struct peer *peer;                         /* while it is there */
    uint64_t number;                           /* its */
    char key[KEY_TEXT];
};

/* The next message of PEERS' socket; false: none. */
bool received_take(struct peers *peers, struct received *r);
/* Its frames go. */
void received_release(struct received *r);
/* R as a client's message, which borrows from it; as wire_open. */
enum modal_status received_open(const struct received *r, struct wire_message *out,
                                struct modal_error *err);
/* The same of a worker's.  Read takes as long as its header has members, whoever believes it:
 * headers that are longer than any but what signals there are and an error are read no more after
 * a RUN than a job has use for. */
enum modal_status received_open_worker(const struct received *r, struct wire_message *out,
                                       struct modal_error *err);
/* Is R a worker's PROGRESS so long that nobody is told of it?  It is dropped unread: workers of
 * before said so every second, and are none to be killed. */
bool received_untold(const struct received *r);
/* The verb that R names, as wire_verb_find has it, -1 for none. */
int received_verb(const struct received *r);
#endif
