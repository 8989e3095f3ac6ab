/* core.h - the broker as a state machine: step(state, event, now) -> actions
 *
 * It knows no socket, clock or disk.  Around it stand a loop with sockets, a ledger thread, spool
 * threads and worker processes
 * (loop.c); in the tests, a simulator.  What the core decides about a job it decides at once and
 * in one order; what it says about a job is only what the ledger has committed.  Running out of
 * memory ends the process: a restart loses nothing.
 */
#ifndef BROKER_CORE_H
#define BROKER_CORE_H
#include <stdatomic.h>
#include "broker/kit/blob.h"
#include "broker/kit/fair_queue.h"
#include "store/ledger.h"
#include "store/spool.h"
#include "store/sums.h"
#include "wire/request.h"

struct moment {
    int64_t mono_ns;              /* for leases and limits */
    int64_t utc_ns;               /* for display, and what outlives a restart */
};

/* Of disk, kept for results and edges, and for edges and deletes, when it is full. */
enum {
    RESERVE_BYTES = 16 << 20,     /* as large as the log may become, told in PROTOCOL.md, P8 */
    RESERVE_LAST = 4 << 20,       /* rows of some 8,000 cancels */
};

/* ---- what it is told: settings --------------------------------------------------------------- */

enum {
    NAME_MOST = 64,               /* of a user, with its end */
    KEY_TEXT = 41,                /* Z85 of 32 bytes, and its end */
};

/* The limits of a user; 0 is "no limit". */
struct allowance {
    int64_t queued, running;      /* jobs */
    int64_t bytes;                /* inputs and results stored */
    double cpu_s_day;             /* CPU-seconds of jobs a UTC day */
    double upload_bytes_s;
};

struct account {
    char key[KEY_TEXT];           /* public key, Z85; "" : who comes without keys */
    char user[NAME_MOST];
    enum wire_role role;
    double weight;                /* share of the workers, > 0 */
    struct allowance most;
};

struct settings {
    char dir[4096];               /* the data folder, for the paths workers are given */
    char start_id[17], store_id[33];
    char node[NAME_MOST];             /* this host's name */
    const struct account *accounts;   /* copied */
    size_t account_count;
    int workers;
    int cores;                    /* of the machine, that jobs may use */
    /* after so many a worker's process is replaced by a fresh one; 0: never */
    int64_t worker_jobs;
    int64_t worker_memory;        /* bytes that it may have of its own; 0: no limit */
    int64_t queue_jobs;           /* queued jobs at most */
    int64_t input_bytes;          /* an input at most */
    int64_t window_bytes;         /* of chunks in memory, all uploads together */
    int64_t lease_ns, result_age_ns, input_age_ns, tombstone_age_ns, upload_idle_ns;
    int64_t result_bytes;         /* results kept at most; the oldest go first */
    int64_t events_kept;
    int64_t jobs_kept;            /* ended jobs of a user, and keys of such as are gone */
    int64_t run_limit_ns;         /* of a job that names none; 0: none */
    /* the longest way to a worker elsewhere and back that live windows go; 0: they go nowhere */
    int64_t windows_elsewhere_ns;
    uint64_t secret;              /* mixes identifiers */
};

/* ---- what it asks for ------------------------------------------------------------------------ */

/* Changes to commit together, in order; `after` is the core's.  All text is owned by
 * the transaction. */
struct transaction {
    struct ledger_change *changes;
    size_t count, room;
    struct arena *arena;
    struct after *after, **after_end;
    struct blob *keep[4];         /* bodies the changes point into */
    /* on a full disk FIRST come back with MODAL_STORAGE_FULL at once, LAST when the reserve is
     * used up too; all others wait until they pass */
    enum { MUST_PASS, LAST_REFUSED, FIRST_REFUSED } refusable;
    /* set when one with it is refused: those behind it are refused too; NULL: none */
    atomic_bool *fence;
    enum modal_status status;     /* out */
    int64_t took_ns;              /* out, of the first of a group: its commit took so long ... */
    int64_t group;                /* ... and it was so large; of the others 0 */
    int64_t ledger_bytes;         /* the ledger and its log then, on disk */
    int64_t cost;                 /* as the core counts what is under way */
    uint64_t turn;                /* whose request it came of; 0: nobody's */
    bool heavy;                   /* of one who has much before the ledger; spell.h */
    struct transaction *next;     /* for the queues of whoever has it */
    struct transaction *before, *after_it;   /* the core's, of what is not committed */
};

enum task_type {
    TASK_BEGIN, TASK_RESUME, TASK_WRITE, TASK_SEAL, TASK_CLOSE,   /* on an upload, one at a time */
    TASK_REMOVE_INPUT,
    /* the samples of an epoch into one batch: begin, write, sync, seal */
    TASK_STREAM_SEAL,
    TASK_SAMPLES_COMPARE,                 /* samples of an epoch with those of a chunk */
    TASK_SAMPLES_READ,                    /* samples of an epoch, that lie without a gap */
    TASK_BATCH_READ,                      /* of the batch that they were sealed into */
    TASK_REMOVE_SAMPLES,
    TASK_ROOM,                            /* how much of the disk is free */
    TASK_RESULT_PUT, TASK_REMOVE_RESULT, TASK_READ_RESULT, TASK_READ_STDERR, TASK_READ_INPUT,
    TASK_READ_SPOOL, TASK_READ_EVENTS,
    TASK_OPEN_INPUT,                      /* of a job that starts, for its worker */
};

/* Of those who share the spool's threads nobody: files that go, questions of the daemon's own. */
#define TURN_NOBODY UINT64_C(0)

struct task {
    struct fair_item fair;                /* whose it is: each has one done in turn; user_turn */
    enum task_type type;
    int64_t id;                           /* input, job or stream */
    /* BEGIN, RESUME: borrowed from the input, which outlives the task */
    struct input_shape shape;
    struct upload *upload;                /* in and out of the spool functions */
    /* WRITE: in order, from `offset` on; SAMPLES_COMPARE: one */
    struct blob *chunks[64]; int count;
    /* READ_SPOOL, READ_*: the part wanted; READ_EVENTS: after, most; BEGIN, SEAL: out */
    uint64_t offset, length;
    char user[NAME_MOST];                 /* READ_EVENTS: whose */
    /* BEGIN: bytes that other uploads of the user's have room for and have not filled; of these
     * such as are only asked for */
    uint64_t reserved, pending;
    bool whole;                           /* BEGIN: it may have all that is free */
    bool over_share;                      /* BEGIN: out: or half with those; err says so */
    struct blob *text;                    /* RESULT_PUT: in; READ_*, SAMPLES_READ: out */
    /* out: the whole size; of ROOM, and of all that MODAL_STORAGE_FULL ended: bytes free */
    uint64_t total;
    uint32_t crcs[64];                    /* WRITE: of each chunk */
    uint8_t sha256[32];                   /* SEAL: out */
    uint32_t crc;                         /* SEAL, STREAM_SEAL: out; READ_SPOOL: in */
    struct result_record record;          /* RESULT_PUT: out */
    /* READ_EVENTS: out; freed with the task */
    struct event_row {
        int64_t number, ns, job;
        char *user, *topic, *text;
    } *events;
    int event_count;
    int64_t stream; uint64_t epoch;       /* STREAM_SEAL, SAMPLES_COMPARE, _READ: in */
    uint64_t missing;                     /* STREAM_SEAL: bytes of its gaps, in */
    /* STREAM_SEAL, between two slices: bytes of the batch, offset of what comes next */
    uint64_t written, next_segment;
    /* of the batch's, the chunk's first sample its index; READ_SPOOL: of the data its place in
     * the file (total: its bytes, crc: its checksum) */
    uint64_t begin;
    /* STREAM_SEAL, READ_SPOOL: out, of its parts; none where the ledger has them */
    struct sums sums;
    /* SAMPLES_COMPARE: out: samples that are there are not those of the chunk */
    bool differs;
    int descriptor;                       /* OPEN_INPUT: out */
    enum modal_status status;             /* out */
    int64_t took_ns;                      /* out */
    struct modal_error err;
    void *owner;                          /* the core's */
    struct after *after;
    struct task *next;
};

enum action_type {
    ACT_SEND,       /* peer, verb, header, body (blob or NULL) */
    ACT_COMMIT,     /* transaction; comes back as EVENT_COMMITTED */
    ACT_TASK,       /* task; comes back as EVENT_TASK */
    ACT_WORKER,     /* slot, verb, header, body: send to the worker */
    ACT_REMOTE,     /* peer, verb, header, body: send to a worker elsewhere */
    ACT_HAND,       /* slot, descriptor, header (JOB ATTEMPT): to the worker, ahead of its RUN;
                       slot -1: to be closed */
    ACT_SPAWN,      /* slot: start a process; EVENT_EXIT will follow some day */
    ACT_KILL,       /* slot: end its process group now */
    ACT_LOG,        /* header: a logfmt line without its time; peer: to tell the address of, or 0 */
    ACT_STOP,       /* end the daemon; slot is the exit status */
};

struct action {
    enum action_type type;
    int slot;
    int descriptor;               /* the taker's */
    uint64_t peer;
    const char *verb;             /* static text */
    char *header;                 /* from malloc, the taker's */
    struct blob *body;            /* the taker's */
    union { struct transaction *transaction; struct task *task; };
};

struct actions { struct action *items; size_t count, room; };

/* ---- what happens to it ---------------------------------------------------------------------- */

enum event_type {
    EVENT_REQUEST,      /* peer, key, message or fault, body */
    EVENT_PEER_FULL, EVENT_PEER_READY, EVENT_PEER_GONE,    /* peer */
    EVENT_COMMITTED,    /* transaction, and those behind it: as they were given, in that order */
    EVENT_STUCK,        /* transactions that must pass wait for room on the disk */
    EVENT_TASK,         /* task */
    EVENT_WORKER,       /* slot, message and body, or fault */
    EVENT_REMOTE,       /* peer, key, message and body, or fault: of a worker elsewhere */
    EVENT_REMOTE_GONE,  /* peer: its connection has ended */
    EVENT_EXIT,         /* slot, status as wait(2) gives it, stderr_text */
    EVENT_TIME,         /* nothing but that time passed */
    /* nothing was asked or committed for a while: what the ledger has too may leave memory */
    EVENT_REST,
    EVENT_SETTINGS,     /* settings */
    EVENT_TERMINATE,    /* finish what runs, then stop */
};

struct event {
    enum event_type type;
    uint64_t peer;
    const char *key;                        /* account key of the sender */
    const struct wire_message *message;     /* NULL: malformed */
    const char *verb, *id;                  /* of a malformed one, as far as read */
    const struct modal_error *fault;
    struct blob **body;                     /* as message->body; the core shares what it keeps */
    uint64_t turn;                          /* of a request that changes something; 0: nobody's */
    bool waited;                            /* it waited at the ledger's door */
    int slot, status;
    const char *stderr_text;
    struct transaction *transaction;
    struct task *task;
    const struct settings *settings;
};

/* The state before any row is loaded; SETTINGS are copied.  core_free frees it. */
struct core *core_new(const struct settings *settings, struct moment now);
/* All that it holds; actions are carried out, or lost, before.  It must not be NULL. */
void core_free(struct core *core);

/* Take over the rows of a ledger before the first step, by ledger_load with this visitor;
 * then core_loaded. */
void core_visitor(struct core *core, struct ledger_visitor *out);
/* Whether the rows have a use for this file of the data folder; asked between loading
 * and core_loaded. */
bool core_has_file(const struct core *core, enum spool_file what, int64_t id);
/* All rows are loaded: what follows from them, as core_step has it. */
struct actions *core_loaded(struct core *core, struct moment now);

/* The actions are the core's until the next call; what they point to is the caller's. */
struct actions *core_step(struct core *core, const struct event *event, struct moment now);

/* May TURN ask for more of what changes something?  Not while the ledger has his part of what may
 * be before it: then what he wants waits. */
bool core_admits(const struct core *core, uint64_t turn);
/* Does TURN wait meanwhile, having had much before the ledger where others ask for little? */
bool core_bars(const struct core *core, uint64_t turn);
/* May those who wait for that ask now?  Not before when, monotonic; 0: now, INT64_MAX: not before
 * something is committed. */
int64_t core_lets_in(const struct core *core);
/* Whose the request of PEER's is, who has KEY: user_turn; 0: nobody's. */
uint64_t core_turn(struct core *core, const char *key, uint64_t peer);

/* How many connections of clients there are, were refused, were ended for what they sent, and hung
 * up while their input was stopped: for the metrics. */
void core_connections(struct core *core, int64_t open, int64_t refused, int64_t ended,
                      int64_t hangups_kept);

/* When EVENT_TIME is wanted at the latest, monotonic; INT64_MAX: never. */
int64_t core_next_ns(const struct core *core);

/* With all its texts and what was to follow; accepts NULL. */
void transaction_free(struct transaction *transaction);
/* With all it brought; its upload stays.  Accepts NULL. */
void task_free(struct task *task);
#endif
