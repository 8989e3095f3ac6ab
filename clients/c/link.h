/* link.h - one connection to modald: messages out, messages in, lost and found again by itself
 *
 * Frames are those of proto/PROTOCOL.md, section 2.  No call blocks past the time it is given.  Not
 * for two threads at once.
 */
#ifndef CLIENT_LINK_H
#define CLIENT_LINK_H
#include <stdbool.h>
#include <stdint.h>
#include "base/error.h"
#include "base/json.h"

struct link;

/* A message that came: an answer (REPLY, ERROR) or an EVENT. */
struct link_message {
    enum { LINK_REPLY, LINK_ERROR, LINK_EVENT } type;
    cJSON *header;
    char *body;              /* frame 3, with a 0 behind it; NULL: none */
    size_t length;
};

/* Free what MESSAGE holds, and make it empty. */
void link_message_done(struct link_message *message);

/*
 * Begin to connect to ENDPOINT; NULL: $MODALD_URL, else ipc:///run/modald/modald.ipc, else the same
 * under $XDG_RUNTIME_DIR.  KEYFILE (NULL: $MODALD_KEYFILE, else none) holds CURVE keys, see
 * keyfile.h.  Connecting goes on in the background for the link's life; a daemon that is not there
 * is found out by the first question.  MODAL_BAD_INPUT: field "server" or "keyfile".
 */
enum modal_status link_open(const char *endpoint, const char *keyfile, struct link **out,
                            struct modal_error *err);

/* End it; NULL is fine. */
void link_close(struct link *link);

/* Where it goes; borrowed. */
const char *link_endpoint(const struct link *link);

/* Seconds of the monotonic clock, for the deadlines below. */
double link_now(void);

/* How a question is asked. */
struct link_ask {
    const char *verb;
    cJSON *header;           /* becomes the link's, also on failure; "id" is added */
    const void *body;        /* borrowed; NULL: none */
    size_t length;
    bool once;               /* not safe to repeat: a SUBMIT without a key */
    double patience;         /* s without an answer until it is asked again; 0: 5 */
};

/*
 * Ask and wait for the answer, until DEADLINE; asked again after a lost connection.  An ERROR of
 * the daemon is returned as its status and text, its `detail` into *DETAIL (may be NULL; the
 * caller's).  MODAL_NO_SERVER: nobody there for 2 s at the start, for 30 s later on, or at
 * DEADLINE; MODAL_DENIED: somebody is, but we are not let in (the socket's mode, a key that is
 * missing, refused, another daemon's or not wanted); MODAL_TIMEOUT: connected, but no answer by
 * DEADLINE.
 */
enum modal_status link_question(struct link *link, const struct link_ask *ask, double deadline,
                                struct link_message *out, cJSON **detail, struct modal_error *err);

/* For many questions in flight.  Send one, its id into *ID; MODAL_TIMEOUT: no room, or no
 * connection, by DEADLINE. */
enum modal_status link_send(struct link *link, const struct link_ask *ask, double deadline,
                            int64_t *id, struct modal_error *err);

/* The next message of any kind.  MODAL_TIMEOUT at DEADLINE; MODAL_NO_SERVER: the connection was
 * lost just now, and with it every answer that was due (said once a loss). */
enum modal_status link_receive(struct link *link, double deadline, struct link_message *out,
                               struct modal_error *err);

/* Sleep until a message may have come, FD (-1: none) can be read, or SECONDS are over: for a loop
 * that waits for others too. */
void link_sleep(struct link *link, int fd, double seconds);

/* An ERROR message as status, text and detail. */
enum modal_status link_error(const struct link_message *message, cJSON **detail,
                             struct modal_error *err);

/* Has nobody been there for so long that a question would give up? */
bool link_lost(const struct link *link);

/* The id of the question that MESSAGE answers; -1: none of ours. */
int64_t link_message_id(const struct link_message *message);

#endif
