/* state.h - what the core holds; for the files of the core only */
#ifndef BROKER_STATE_H
#define BROKER_STATE_H
#include "broker/core/alarms.h"
#include "broker/core/core.h"
#include "broker/kit/heap.h"
#include "broker/kit/histogram.h"
#include "broker/kit/ident.h"
#include "broker/kit/map.h"
#include "broker/kit/memory.h"

#define SECOND INT64_C(1000000000)

enum { HOUSEKEEPING_S = 10 };   /* between two looks at what is past its age: ages are minutes and more */

/* Who is to be answered, and what with. */
struct reply {
    uint64_t peer;                        /* 0: nobody */
    struct answers *all; int place;       /* of a part of SUBMITS: where its answer waits for the others */
    char id[WIRE_ID_MOST * 6 + 3];
    enum wire_verb verb;
};

/* What follows a commit or a task. */
enum after_type {
    AFTER_SHOW,          /* job: its decided state becomes visible */
    AFTER_SUBMIT, AFTER_REPEAT,   /* reply: the doc, duplicate false or true */
    AFTER_DOC,           /* reply: the doc */
    AFTER_DELETE,        /* job goes; reply, if any */
    AFTER_BEGIN, AFTER_CHUNK, AFTER_SEAL, AFTER_GONE,   /* input; value: a chunk's offset and length */
    AFTER_DRAIN,
    AFTER_READ,          /* of a task: reply with bytes */
    AFTER_OUTPUT,        /* input, its worker's slot (value): sealed, or failed with err */
    AFTER_EVENT,         /* the event becomes visible to subscribers */
    AFTER_STREAM,        /* stream operations; value: which */
};

struct after {
    struct after *next;
    enum after_type type;
    struct job *job;
    struct input *input;
    struct stream *stream;
    struct reply reply;
    enum job_state from, to;
    int attempts;
    int64_t value, length;
    int64_t ns;                           /* of an event: UTC, as its row has it */
    char *text;
    struct modal_error *err;              /* NULL: none */
};

struct input {
    int64_t id;
    struct user *user;
    struct input_shape shape;             /* its texts are the input's own; names lie behind their list */
    char *attributes;                     /* of `shape` */
    uint64_t bytes;
    enum input_state state;
    uint8_t sha256[32];
    uint8_t content[32];                  /* what its answers show: sha256 and the attributes; see input_content */
    uint32_t crc;
    uint64_t offset;
    bool inline_data, committed, indexed, going;
    int64_t created_ns, used_ns;
    int jobs;                             /* that name it */
    struct blob *data;                    /* of an inline one, while the cache keeps it */
    struct filling *filling;              /* while it is open */
    struct input *older, *younger;        /* of the same sha256 and other attributes */
};

/* An upload in progress: by a client, or by a worker that makes signals. */
struct filling {
    struct upload *upload;                /* the spool's; NULL until begun or resumed */
    char *key;
    bool has_declared;
    uint8_t declared[32], wanted[32];
    bool busy;                            /* a task is under way */
    uint64_t accepted, durable;           /* bytes taken in; bytes committed */
    uint64_t in_flight;                   /* bytes taken in and not yet committed */
    struct blob *chunks[64]; int count;   /* waiting for a task */
    uint32_t crcs[64];                    /* of `chunks` */
    struct after *askers;                 /* who began again, told once it is quiet */
    struct after *seal;                   /* who asked to seal */
    struct after *aborters;               /* who are told when it is gone */
    bool wrong; uint8_t found[32];        /* it goes for its bytes have this SHA-256 */
    struct after *writers[64];            /* who to tell of `chunks`, one each; NULL for a worker's */
    bool sealing, aborting, broken;
    int64_t touched_ns;
    int slot;                             /* of the worker that makes it; -1 */
};

/* Samples that wait until those before them are compared with the file. */
struct push {
    struct push *next;
    struct reply reply;
    uint64_t first, count;
    uint32_t crc;
    struct blob *body;
    enum sameness { UNTOLD, SAME, OTHER, UNKNOWN } same;      /* as those of their indices that are there */
};

/* Samples without a gap between them. */
struct segment { uint64_t epoch, first, count; };

/* The live window of a stream, and where it is; see windows.c. */
struct window {
    uint64_t samples, hop;                /* 0: the stream has none */
    uint64_t next;                        /* the index at which one is due */
    char *options;
    char *recent;                         /* the last `samples` of the stream, by index % samples */
    struct alarms *alarms;                /* NULL: none */
    bool running;                         /* a worker has it, or had it before it is told dead */
    uint64_t epoch, from, to;             /* of the one that runs, or ran last */
    int slot; uint64_t process;           /* the worker that has its samples up to `to`; -1: none */
    int died;                             /* workers under the present one */
};

/* Samples of unknown number; see streams.c. */
struct stream {
    struct stream *next_stream;
    int64_t id;
    struct user *user;
    char *name, *header;                  /* header: what open said, as JSON */
    uint64_t channels;
    double dt, period;
    uint64_t epoch, begin, next;          /* of the present epoch: its first sample, the next to come */
    uint64_t durable_epoch, durable;      /* the next sample to be committed, and the epoch that is committed so far */
    uint64_t run_from;                    /* first sample after the last gap */
    struct segment *segments; size_t segment_count, segment_room;       /* of all epochs, as they came */
    uint64_t bytes;                       /* of all segments: the end of its file */
    uint64_t (*gaps)[2]; size_t gap_count;
    /* bytes of its gaps, which its user is charged like samples */
    uint64_t missing;
    uint32_t *crcs; uint64_t crc_first, crc_count, crc_room;      /* of each sample from `crc_first` on; 0: not known */
    struct push *held, **held_end;        /* in their order; a task compares the first */
    uint64_t held_reach;                  /* the end of the farthest of them */
    bool comparing;
    int64_t in_flight;                    /* bytes */
    struct transaction *last;
    struct after *askers;                 /* who closed it */
    struct input *sealed;                 /* until it is closed */
    uint8_t sha256[32];                   /* of its batch, once it is closed; where it has one */
    bool closing, closed, broken, has_batch;
    atomic_bool fence;                    /* samples were refused for want of disk, and others are under way behind them */
    bool resumes;                         /* the refused ones are to come again before any other */
    bool slowed;                          /* and were refused for a limit, not for want of disk */
    int64_t closed_ns, commits_awaited;
    struct window window;
};

/* Bytes of one sample of all its channels. */
static inline uint64_t sample_bytes(const struct stream *s)
{
    return 8 * s->channels;
}

/* Whether all that came is committed. */
static inline bool is_durable(const struct stream *s)
{
    return s->durable_epoch == s->epoch && s->durable == s->next;
}

struct failure { enum modal_status status; char *message, *field, *detail; };

enum ending { ENDING_NONE, ENDING_CANCEL, ENDING_RUN_LIMIT, ENDING_DEADLINE, ENDING_LEASE, ENDING_FINISH };

struct job {
    int64_t id;
    struct user *user;
    char *key, *options;                  /* options: NULL once it has ended */
    const char *kind;                     /* of the table of kinds */
    struct input *input, *output;
    uint8_t fingerprint[32], settings[32];
    int priority, max_attempts;
    int64_t run_limit_ns, deadline_ns, not_before_ns;
    enum job_state state, shown;          /* decided; committed */
    int attempts, shown_attempts, crashes;
    int64_t submitted_ns, started_ns, finished_ns, cpu_ns;
    struct failure *failure;
    uint64_t result_bytes;
    struct blob *document;                /* while the cache keeps it */
    int64_t source;                       /* cached: the job whose result it shows; 0: its own */
    int shares;                           /* jobs that show this one's result */
    bool hidden;                          /* deleted, kept for those */
    bool cached, committed, ready, deleting, indexed;
    struct transaction *last;             /* the latest that is not committed */
    struct after *asks;                   /* to be answered by the next transaction */
    enum ending ending;
    int slot;                             /* of the worker that has it; -1 */
    char *progress, *stderr_text;
    struct wait *waits;
};

struct wait {
    struct wait *next, **link;            /* of the job's */
    struct wait *beside, **beside_link;   /* of the connection's */
    uint64_t number;
    struct job *job;
    struct reply reply;
    bool result;
    struct user *user;
    char key[KEY_TEXT];
};

struct asker { uint64_t peer; struct wait *waits; };   /* a connection that waits for jobs */

struct tombstone { struct user *user; char *key; uint8_t fingerprint[32]; int64_t expired_ns; bool committed; struct tombstone *next; };

struct user {
    char name[NAME_MOST];
    struct account *account;              /* NULL: none any more */
    struct map keys, tombstones;          /* by key */
    struct map inputs, identities;        /* sealed inputs by content; the youngest of each identity by sha256 */
    struct job **jobs; size_t job_count, job_room;      /* ascending ids; NULL where one has gone */
    struct input **open; int open_count;  /* uploads */
    struct heap ready;
    int64_t queued, running, bytes;
    double deficit, cost_s;               /* deficit round robin; mean seconds of a job */
    bool competes;                        /* at the latest choice he had a job that might start */
    double cpu_s; int64_t cpu_day;        /* used in that UTC day */
    double upload_level; int64_t upload_ns;     /* token bucket */
    int waits, subscriptions;
};

enum slot_state { SLOT_EMPTY, SLOT_STARTING, SLOT_IDLE, SLOT_TAKEN, SLOT_BUSY, SLOT_KILLED };

struct slot {
    enum slot_state state;
    bool watched;                         /* a TIMER_LEASE is set */
    struct job *job;
    int attempt;
    int64_t heard_ns, started_ns;         /* mono */
    int64_t jobs;                         /* begun by this process */
    int quick_deaths;                     /* in a row, without a job: starting again is put off */
    char *document; size_t document_size, document_total;
    int parts;                            /* PARTs that wait for their GO */
    bool late_told;                       /* something late was logged since the latest start */
    struct input *output;                 /* signals on their way */
    bool finishing;                       /* DONE has come; the output is being sealed */
    bool ready;                           /* READY has come meanwhile */
    double cpu_s, expected_s;             /* expected_s: what its user's share was charged at the start */
    struct stream *live;                  /* whose window it has instead of a job */
    uint64_t process;                     /* counts the slot's processes */
};

struct subscription {
    struct subscription *next;
    uint64_t number, peer;
    struct user *user;
    char key[KEY_TEXT];                   /* by which it was asked for */
    struct reply reply;
    int64_t next_event;                   /* the number it has not seen */
    int64_t job;                          /* 0: all */
    char *stream;
    unsigned kinds;                       /* bits of wire_events; 0: all */
    bool reading;                         /* a TASK_READ_EVENTS is under way */
    bool gone;
};

enum timer { TIMER_ROOM, TIMER_WAIT, TIMER_DEADLINE, TIMER_START, TIMER_RUN_LIMIT, TIMER_LEASE,
    TIMER_SPAWN, TIMER_HOUSEKEEPING, TIMER_RETAIN };

enum { SLOTS_MOST = 256, RING = 1024 };

/* The answers to the parts of one SUBMITS: sent, as a list, when all are there. */
struct answers {
    struct answers *next, **link;         /* of all that wait, in the core */
    struct reply reply;
    int count, missing;
    char *parts[];
};

struct core {
    struct settings settings;
    struct account *accounts; size_t account_count;
    struct map jobs, inputs, users, results, waits, askers;
    size_t waits_past;                    /* timers of waits that have ended */
    struct tombstone *stones, **stones_end;   /* of all users, in the order in which they were put up */
    struct user **user_list; size_t user_count;
    struct heap timers;
    struct slot slots[SLOTS_MOST];
    int slot_count;
    int64_t next_job, next_input, next_event, last_event;
    int64_t state_counts[JOB_STATE_COUNT];
    int64_t result_total, result_leaving; /* bytes of results, and of those among them whose deletion is on its way to the disk */
    bool retaining;                       /* the next step of retention has its timer */
    int64_t *ended; size_t ended_first, ended_count, ended_room;   /* ids in the order of ending, for retention */
    uint64_t next_wait, next_subscription;
    struct subscription *subscriptions;
    struct answers *answers;
    struct after *outputs;                /* AFTER_OUTPUT, to be followed in this step */
    struct stream *streams;
    int open_streams;
    int live_attempts;
    uint64_t *full; size_t full_count, full_room;
    struct event_row ring[RING];          /* committed events, by number % RING */
    int64_t cache_bytes;                  /* inline inputs kept */
    struct job *document_ring[64]; int document_at;   /* jobs whose documents are kept */
    int64_t in_flight;                    /* bytes of chunks, all uploads */
    int64_t uncommitted, tasks;
    bool draining, terminating, stopped, storage_full;
    /* nothing is tried until then; no job starts, for want of disk for its result */
    int64_t storage_full_until, hold_until;
    uint64_t room_wanted;                 /* bytes free that end storage_full */
    bool room_found;                      /* something was stored since the latest refusal */
    int64_t rejects[MODAL_STATUS_COUNT], replies, deaths, commits, committed_changes, attempts, leases_lost, bytes_in, bytes_out;
    struct histogram submit_seconds, commit_seconds, commit_transactions, write_seconds;
    double replay_s;
    int64_t started_ns;
    int64_t pruned;                       /* last_event at the latest pruning */
    int64_t connections, connections_refused, connections_ended, hangups_kept;
    int64_t credit_stalls, ledger_bytes;
    int64_t next_denial_ns;               /* when a denial of a key that is on no list is told again */
    struct { char *text; uint8_t settings[32]; } asked;   /* the latest kind and options, and their hash */
    struct region *region;
    struct arena *kinds;                  /* names of kinds this build no longer knows */
    size_t turn;                          /* whose turn it is among users */
    struct moment now;
    struct actions out;
};

/* transaction.c */
struct transaction *transaction_new(void);
struct ledger_change *transaction_add(struct transaction *t, enum ledger_verb verb);
const char *transaction_text(struct transaction *t, const char *text);
/* as rows of its chunks */
void transaction_add_sums(struct transaction *t, int64_t input, const struct sums *sums);
void transaction_keep(struct transaction *t, struct blob *blob);
struct after *transaction_after(struct transaction *t, enum after_type type);
void transaction_join(struct transaction *t, struct after *after);
void core_commit(struct core *c, struct transaction *t);
struct task *task_new(enum task_type type, int64_t id);
void core_task(struct core *c, struct task *task);
struct after *after_new(enum after_type type, const struct reply *reply);
void after_free(struct after *after);
void after_append(struct after **list, struct after *after);

/* answer.c */
struct reply reply_to(const struct event *e, const struct wire_request *r);
cJSON *answer_new(const struct reply *reply);
void answer_send(struct core *c, const struct reply *reply, cJSON *header, struct blob *body);      /* takes both */
void answer_error(struct core *c, const struct reply *reply, const struct modal_error *err, cJSON *detail);
void answer_fail(struct core *c, const struct reply *reply, enum modal_status status, const char *field, cJSON *detail,
                 const char *format, ...) __attribute__((format(printf, 6, 7)));
struct answers *answers_new(struct core *c, const struct reply *reply, int count);
void answers_free(struct answers *answers);
cJSON *answer_number(const char *key, double value);       /* an object of one member, for details */
void answer_doc(struct core *c, const struct reply *reply, const struct job *job, int duplicate, struct blob *body);   /* -1: no such member */
void doc_write(const struct core *c, struct json_text *text, const struct job *job, bool position);
char *text_end(struct json_text *text);                 /* closed; the caller frees */
void core_act(struct core *c, struct action action);
void core_log(struct core *c, const char *format, ...) __attribute__((format(printf, 2, 3)));
void core_timer(struct core *c, int64_t when_ns, enum timer what, int64_t order, int64_t extra);
void job_ident(const struct core *c, const struct job *job, char out[9]);
void input_ident(const struct core *c, const struct input *input, char out[9]);

bool answer_expired(struct core *c, const struct reply *reply, const struct tombstone *stone);   /* false: STONE is NULL */

/* room.c */
void room_want(struct core *c, uint64_t bytes);
void room_ask(struct core *c);
void room_told(struct core *c, const struct task *task);
void room_judge(struct core *c, const struct task *task);
uint64_t task_bytes(const struct task *task);
bool room_is_full(const struct core *c);

/* index.c */
struct job *job_by_id(const struct core *c, int64_t id);

/* jobs.c: the moves */
void job_watch(struct core *c, struct job *job);
struct job *job_find(const struct core *c, struct user *user, const struct wire_job *ref);   /* committed, of this user; NULL */
struct job *job_new(struct core *c, struct user *user, int64_t id);
void job_forget(struct core *c, struct job *job);
void job_move(struct core *c, struct job *job, enum job_state to, struct transaction *t);     /* commits T, or one of its own */
void job_fail(struct core *c, struct job *job, enum job_state to, const struct modal_error *err, cJSON *detail);
void job_shown(struct core *c, const struct after *after);
void job_enqueue(struct core *c, struct job *job);
void job_remove(struct core *c, struct job *job, const struct reply *reply);
void job_index(struct core *c, struct job *job);
void job_index_result(struct core *c, struct job *job);
void job_note_end(struct core *c, struct job *job);
void job_log_edge(struct core *c, const struct job *job, const char *from, enum job_state to);
void job_unindex(struct core *c, struct job *job);
struct job *job_cached(struct core *c, struct user *user, const uint8_t content[32], const uint8_t settings[32]);
void job_event(struct core *c, struct job *job, struct transaction *t, const struct failure *failure, enum job_state to);
void job_expired(struct core *c, int64_t id, enum timer what, int64_t extra);
void jobs_retain(struct core *c);
struct failure *failure_new(const struct modal_error *err, cJSON *detail);
void failure_free(struct failure *failure);

/* users.c */
struct user *user_get(struct core *c, const char *name);
struct user *user_of_key(struct core *c, const char *key);          /* NULL: no such account */
bool user_admits(const struct core *c, const struct user *user, const char *key);   /* is KEY still this user's, and a client's? */
void users_configure(struct core *c);
void user_add_job(struct user *user, struct job *job);
void user_drop_job(struct user *user, const struct job *job);
size_t user_seek(const struct user *user, int64_t id);              /* index of the first job with a larger id */
struct tombstone *user_tombstone(const struct user *user, const char *key);
void user_bury(struct core *c, struct user *user, const char *key, const uint8_t fingerprint[32], int64_t expired_ns);
void tombstones_sort(struct core *c);                               /* as loaded, by their age */
void tombstones_retain(struct core *c);                             /* those past their age are gone, here and in the ledger */
struct user *user_next(struct core *c);                             /* whose job starts next; NULL: nobody's */
void user_ran(struct core *c, struct user *user, double expected_s, double seconds, double cpu_s);
void user_note(struct user *user, struct transaction *t);
void user_load_note(struct core *c, const struct note_record *r);
bool user_quota(struct core *c, struct user *user, const struct reply *reply, int64_t more_jobs, int64_t more_bytes);   /* true: answered */

/* inputs.c */
struct input *input_new(struct core *c, struct user *user, const struct wire_input *w, int64_t id);
struct input *input_load(struct core *c, const struct input_record *r);
struct input *input_sealed(const struct user *user, const uint8_t content[32]);      /* NULL: none */
struct input *input_of_identity(const struct user *user, const uint8_t sha256[32]);  /* the youngest; NULL: none */
void input_content(const uint8_t sha256[32], const cJSON *attributes, uint8_t content[32]);
void input_index(struct input *input);
void input_record_fill(const struct input *input, struct transaction *t, struct input_record *out);
void input_describe(const struct input *input, cJSON *object);
void input_use(struct core *c, struct input *input, int jobs);      /* +1, -1 */
void input_remove(struct core *c, struct input *input);
void input_forget(struct core *c, struct input *input);
struct filling *filling_new(int64_t touched_ns);
void filling_free(struct filling *f);
void input_cache(struct core *c, struct input *input, struct blob *data);
void input_trim(struct core *c, struct input *input);
struct input *input_by_id(const struct core *c, int64_t id);
void inputs_retain(struct core *c);
enum modal_status input_shape_of(const struct wire_input *w, struct input_shape *shape, const char ***names);

/* uploads.c */
/* What one upload or stream may have unacknowledged: an equal part of all, at least two chunks, at most 16 MiB. */
int64_t core_window(const struct core *c);
void upload_request(struct core *c, const struct event *e, const struct wire_request *r, struct user *user);
bool upload_allows(struct core *c, struct user *user, size_t size, const struct reply *reply);   /* within his rate? else answered */
/* of his rate, for what comes without having been sent */
void upload_owes(struct user *user, uint64_t bytes);
void upload_task_done(struct core *c, struct task *task);
/* its row is gone: who waits for that is told */
void upload_gone(struct core *c, struct input *input);
void upload_after(struct core *c, struct after *after);
void upload_quiet(struct core *c, struct input *input);
struct input *output_begin(struct core *c, struct user *user, const struct wire_input *w, int slot);
void output_chunk(struct core *c, struct input *input, struct blob *chunk);
void output_seal(struct core *c, struct input *input);
void uploads_retain(struct core *c);

/* submit.c */
void submit_request(struct core *c, const struct event *e, const struct wire_request *r, struct user *user);
void submits_request(struct core *c, const struct event *e, const struct wire_request *r, struct user *user);

/* slots.c */
void worker_send(struct core *c, int slot, const char *verb, cJSON *header, struct blob *body);
void worker_go(struct core *c, int slot);
void worker_kill(struct core *c, int slot);
void worker_error(const cJSON *error, struct modal_error *out);

/* waits.c */
void read_for(struct core *c, const struct reply *reply, struct job *job, enum task_type type, int64_t id, uint64_t offset,
              uint64_t length, const char *part);
void answer_wait(struct core *c, struct wait *w);
void wait_begin(struct core *c, const struct wait *now, double timeout_s);
void wait_answer(struct core *c, struct job *job);
void wait_timeout(struct core *c, uint64_t number);
void waits_gone(struct core *c, uint64_t peer);       /* end those of a connection that has ended */
void waits_revoke(struct core *c);         /* answer those of keys that are admitted no more */
void read_task_done(struct core *c, struct task *task);

/* segments.c */
enum sameness samples_compare(const struct stream *s, uint64_t first, uint64_t count, const char *data);
void samples_note(struct stream *s, uint64_t first, uint64_t count, const char *data);
void gaps_add(struct stream *s, uint64_t from, uint64_t to);
void gaps_drop(struct stream *s);
void segments_add(struct stream *s, uint64_t epoch, uint64_t first, uint64_t count);
void segments_cut(struct stream *s);

/* workers.c */
void worker_message(struct core *c, const struct event *e);
void worker_exit(struct core *c, int slot, int status, const char *stderr_text);
void worker_timer(struct core *c, enum timer what, int64_t slot);
void workers_fill(struct core *c);                                  /* spawn what is missing */
void workers_schedule(struct core *c);
void worker_output(struct core *c, const struct after *after);
void job_input_read(struct core *c, struct task *task);
void job_result_put(struct core *c, struct task *task);
void documents_drop(struct core *c);                                /* of results, from memory */

/* events.c */
void events_request(struct core *c, const struct event *e, const struct wire_request *r, struct user *user);
void events_committed(struct core *c, struct after *after);
void events_progress(struct core *c, struct job *job);
void events_pump(struct core *c);
void events_task_done(struct core *c, struct task *task);
void events_peer(struct core *c, uint64_t peer, enum event_type type);
void events_revoke(struct core *c);       /* end the subscriptions of keys that are admitted no more */

/* streams.c */
void stream_request(struct core *c, const struct event *e, const struct wire_request *r, struct user *user);
void stream_sealed(struct core *c, struct task *task);
void stream_refused(struct core *c, struct after *after, struct transaction *t);
void stream_after(struct core *c, struct after *after, struct transaction *t);
void stream_load_note(struct core *c, const struct note_record *r);
void stream_compared(struct core *c, struct task *task);
void stream_load_segment(struct core *c, const struct segment_record *r);
/* Whether ID is an open stream, whose samples are in a file. */
bool stream_is_open(const struct core *c, int64_t id);
void stream_free(struct stream *s);
void streams_retain(struct core *c);

/* windows.c */
enum modal_status window_check(const cJSON *text, const struct wire_input *w, struct modal_error *err);
void window_init(struct stream *s, const cJSON *text, const struct wire_input *w);
void window_done(struct window *w);
void window_keep(struct stream *s, uint64_t first, uint64_t count, const char *data);
void window_reset(struct stream *s);
void window_start(struct core *c, int slot);
void window_end(struct core *c, int slot, const struct wire_message *m);
void window_died(struct core *c, int slot);
bool window_late(const struct core *c, const struct slot *s);

/* requests.c */
void request_handle(struct core *c, const struct event *e);

/* metrics.c */
void stats_write(const struct core *c, const struct user *user, bool all, cJSON *object);
struct blob *metrics_text(const struct core *c, const struct user *user);   /* the users' series of USER alone; NULL: of all */
#endif
