/* inputs.h - what is kept of inputs, sealed or on their way; for the files that own or move them */
#ifndef BROKER_INPUTS_H
#define BROKER_INPUTS_H
#include "broker/core/state.h"

/* From so many bytes on the link decides where a job runs.  What is known to have come of such an
 * input is what was asked for before the pieces under way: half of this at least. */
enum { LARGE_INPUT = 2 * WIRE_PULLS_MOST * WIRE_BODY_MOST };

struct input {
    int64_t id;
    struct user *user;
    /* its texts are the input's own; names lie behind their list */
    struct input_shape shape;
    char *attributes;                     /* of `shape` */
    char *stream;                         /* whose samples it is, once sealed; NULL: no stream's */
    const char *verdict;                  /* of that stream's last window; NULL: not known */
    uint64_t bytes;
    uint32_t beside;                      /* what its file takes, where it has fewer bytes */
    enum input_state state;
    uint8_t sha256[32];
    /* what its answers show: sha256 and the attributes; see input_content */
    uint8_t content[32];
    uint32_t crc;
    uint64_t offset;
    bool inline_data, committed, indexed, going;
    int64_t created_ns, used_ns;
    int jobs;                             /* that name it */
    struct blob *data;                    /* of an inline one, while the cache keeps it */
    struct filling *filling;              /* while it is open */
    struct input *older, *younger;        /* of the same sha256 and other attributes */
};

static inline bool input_is_large(const struct input *input)
{
    return input->bytes >= LARGE_INPUT;
}

/* An upload in progress: by a client, or by a worker that makes signals. */
struct filling {
    struct upload *upload;                /* the spool's; NULL until begun or resumed */
    char *key;
    bool has_declared;
    uint8_t declared[32], wanted[32];
    bool busy;                            /* a task is under way */
    uint64_t accepted, durable;           /* bytes taken in; bytes committed */
    uint64_t in_flight;                   /* bytes taken in and not yet committed */
    struct chunk_record row;              /* the latest of its chunks; length 0: none yet */
    struct blob *chunks[64]; int count;   /* waiting for a task */
    uint32_t crcs[64];                    /* of `chunks` */
    struct after *askers;                 /* who began again, told once it is quiet */
    struct after *seal;                   /* who asked to seal */
    struct after *aborters;               /* who are told when it is gone */
    bool wrong; uint8_t found[32];        /* it goes for its bytes have this SHA-256 */
    /* who to tell of `chunks`, one each; NULL for a worker's */
    struct after *writers[64];
    bool sealing, aborting, broken;
    int64_t touched_ns;
    uint64_t peer;                        /* the latest that said something of it; 0: none did */
    int slot;                             /* of the worker that makes it; -1 */
};

struct inputs {
    struct map all;                       /* by id */
    int64_t next_input;                   /* streams have their numbers of these too */
    int64_t cache_bytes;                  /* inline ones in memory */
    int64_t in_flight;                    /* bytes of chunks, all uploads */
    int open_streams;                     /* that share the window of memory with the uploads */
    struct after *outputs;                /* AFTER_OUTPUT, to be followed in this step */
};
#endif
