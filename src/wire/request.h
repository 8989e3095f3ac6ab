/* request.h - the requests of proto/PROTOCOL.md, section 4, as structs: each member checked, each
 * default filled in */
#ifndef WIRE_REQUEST_H
#define WIRE_REQUEST_H
#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stdint.h>
#include "base/error.h"

struct wire_message;

enum wire_verb {
    WIRE_HELLO, WIRE_UPLOAD, WIRE_SUBMIT, WIRE_SUBMITS, WIRE_STATUS, WIRE_WAIT, WIRE_RESULT,
    WIRE_CANCEL, WIRE_RETRY, WIRE_DELETE, WIRE_LIST, WIRE_EVENTS, WIRE_STATS, WIRE_METRICS,
    WIRE_WHOAMI, WIRE_DRAIN, WIRE_UNDRAIN, WIRE_STREAM, WIRE_STREAMS, WIRE_VERB_COUNT
};

/* Roles, each able to do what the ones before it can; a worker speaks on another endpoint. */
enum wire_role {
    WIRE_ROLE_NONE,
    WIRE_ROLE_READ,
    WIRE_ROLE_SUBMIT,
    WIRE_ROLE_ADMIN,
    WIRE_ROLE_WORKER
};

enum wire_content { WIRE_BATCH, WIRE_SCENE };
enum wire_part { WIRE_DOCUMENT, WIRE_SIGNALS, WIRE_INPUT, WIRE_STDERR };

/* The words, in the order of the enums; NULL ends each. */
/* what an EVENT may be: "state", "progress", ...; ended by NULL */
extern const char *const wire_events[];
extern const char *const wire_parts[];      /* document, batch, input, stderr */
extern const char *const wire_roles[];      /* none, read, submit, admin, worker */

/* What an input is.  Texts and lists stay the header's. */
struct wire_input {
    enum wire_content content;
    uint64_t samples, channels;   /* of a batch */
    double dt, period;            /* s; period 0: none */
    const cJSON *names;           /* array of `channels` strings, or NULL */
    const char *units;            /* or NULL */
    const cJSON *attributes;      /* object, or NULL */
    uint64_t bytes;               /* of a batch 8 * samples * channels; else text and arrays */
    uint64_t arrays;              /* of these, as the caller says; 0 of a batch */
};

struct wire_job { const char *key; const char *id; };   /* one is NULL */

struct wire_request {
    enum wire_verb verb;
    const char *id;               /* as JSON text */
    /* STATUS, WAIT, RESULT, CANCEL, RETRY, DELETE; EVENTS: may be empty */
    struct wire_job job;
    union {
        struct {
            bool speaks_ours;     /* "versions" holds ours, or is absent */
            const char *client;
        } hello;
        struct {
            enum { WIRE_BEGIN, WIRE_CHUNK, WIRE_SEAL, WIRE_ABORT } op;
            const char *upload, *key, *sha256;    /* NULL: absent */
            struct wire_input input;              /* begin */
            uint64_t offset;                      /* chunk */
            uint32_t crc32c;
        } upload;
        struct {
            const char *kind, *key;
            const cJSON *options;                 /* object, or NULL */
            const char *upload, *sha256;          /* where the input is; both NULL: in the body, */
            struct wire_input input;              /* described here */
            int priority, max_attempts;
            double run_limit_s, deadline_s;       /* 0: none */
            double not_before;                    /* UTC s; 0: at once */
            bool fresh;
        } submit;
        struct { const cJSON *jobs; } submits;    /* array; see wire_part */
        struct { double timeout_s; bool result; } wait;
        struct {
            enum wire_part part;
            uint64_t offset, length;
            const char *upload;       /* of an input, in place of a job; NULL: a job's */
        } result;
        struct wire_list {
            int state;                /* -1: all */
            const char *kind, *after;
            const char *key;          /* of keys that begin so; NULL: all */
            const char *user;         /* an admin's: whose; NULL: the caller's */
            double since;             /* UTC, s: submitted no earlier */
            bool newest;              /* first */
            int limit;
        } list;
        struct {
            enum { WIRE_SUBSCRIBE, WIRE_UNSUBSCRIBE } op;
            bool replay;
            uint64_t from;
            const char *stream, *subscription;
            unsigned kinds;           /* bits of wire_events; 0: all */
        } events;
        struct {
            enum { WIRE_OPEN, WIRE_PUSH, WIRE_PUSHES, WIRE_CLOSE } op;
            const char *name, *stream;
            struct wire_input input;              /* open: samples 0 */
            const cJSON *window;                  /* object, or NULL */
            uint64_t epoch, first, count;
            uint32_t crc32c;
            const cJSON *parts;                   /* array of pushes; see wire_push_read */
            bool broken;
        } stream;
        struct wire_streams {
            const char *name;         /* that one of the caller, or of `user`; NULL: all */
            const char *user;         /* NULL: the caller; an admin: everybody */
            const char *after;
            int limit;
        } streams;
    };
};

/*
 * Check MESSAGE and fill *OUT, which borrows from it.  Fails with MODAL_UNKNOWN_VERB,
 * MODAL_BAD_INPUT (naming the field) or MODAL_TOO_LARGE; the body's length is checked here too, its
 * content (CRC, hash) by the daemon.
 */
enum modal_status wire_request_read(const struct wire_message *message, struct wire_request *out,
                                    struct modal_error *err);

/*
 * Submission JOB of SUBMITS as a SUBMIT of its own, to be read by wire_request_read: *PART borrows
 * JOB and the bytes of its input at *BODY, which is moved behind them.  BODY begins as all of the
 * message's body in one piece.
 */
void wire_part(const cJSON *job, const char **body, struct wire_message *part);

/* A verb's name on the wire; the verb of a name, -1 where there is none; the least role that may
 * ask it. */
const char *wire_verb_name(enum wire_verb verb);
int wire_verb_find(const char *name);
enum wire_role wire_verb_role(enum wire_verb verb);

/* The description of an input as members of OBJECT, the reverse of reading it; what is absent is
 * left out. */
void wire_input_write(cJSON *object, const struct wire_input *input);
/* Read a description; BASE is the path of OBJECT for messages.  NAMES lists further keys the caller
 * reads itself. */
enum modal_status wire_input_read(const cJSON *object, const char *base, enum wire_content content,
                                  struct wire_input *out, struct modal_error *err);

#endif
