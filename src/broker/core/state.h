/* state.h - what every file of the core may see, and what it may call; the owners' parts are in
 * their headers */
#ifndef BROKER_STATE_H
#define BROKER_STATE_H
#include "broker/core/alarms.h"
#include "broker/core/core.h"
#include "broker/core/spell.h"
#include "broker/kit/heap.h"
#include "broker/kit/histogram.h"
#include "broker/kit/ident.h"
#include "broker/kit/map.h"
#include "broker/kit/memory.h"
#include "broker/kit/shares.h"
#include "wire/protocol.h"

#define SECOND INT64_C(1000000000)
#define DAY (86400 * SECOND)             /* of UTC, as limits of CPU-seconds count them */

struct failure;
struct filling;
struct input;
struct job;
struct slot;
struct stream;
struct user;
struct wait;
struct window;

/* between two looks at what is past its age: ages are minutes and more */
enum { HOUSEKEEPING_S = 10 };

/* Who is to be answered, and what with. */
struct reply {
    uint64_t peer;                        /* 0: nobody */
    /* of a part of SUBMITS or of pushes: where its answer waits for the others */
    struct answers *all; int place;
    char id[WIRE_ID_MOST * 6 + 3];
    enum wire_verb verb;
};

/* What follows a commit or a task. */
enum after_type {
    AFTER_SHOW,          /* job: its decided state becomes visible */
    AFTER_SUBMIT, AFTER_REPEAT,   /* reply: the doc, duplicate false or true */
    AFTER_DOC,           /* reply: the doc */
    AFTER_DELETE,        /* job goes; reply, if any */
    /* input; value: a chunk's offset and length */
    AFTER_BEGIN, AFTER_CHUNK, AFTER_SEAL, AFTER_GONE,
    AFTER_DRAIN,
    AFTER_READ,          /* of a task: reply with bytes */
    AFTER_PIECE,         /* of a task: bytes to a worker elsewhere (length: its slot) */
    AFTER_OUTPUT,        /* input, its worker's slot (value): sealed, or failed with err */
    AFTER_EVENT,         /* the event becomes visible to subscribers */
    AFTER_STREAM,        /* stream operations; value: which */
    AFTER_TASK,          /* task: it is for the threads now; refused, it is over */
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
    struct task *task;                    /* its own until then */
};

/* What is left of a job that went: its key, which nobody may use for another. */
struct tombstone {
    struct tombstone *next;
    char *key;
    uint8_t fingerprint[32];
    int64_t expired_ns;
    bool committed;
};

struct user {
    char name[NAME_MOST];
    uint64_t number;                      /* downwards from the largest; connections' go upwards */
    struct account *account;              /* NULL: none any more */
    struct map keys, tombstones;          /* by key */
    struct tombstone *stones, **stones_end;     /* the oldest first */
    /* sealed inputs by content; the youngest of each identity by sha256 */
    struct map inputs, identities;
    /* ascending ids; NULL where one has gone, as jobs_gone have */
    struct job **jobs; size_t job_count, job_room, jobs_gone;
    struct input **open; int open_count;  /* uploads */
    struct heap ready;
    int64_t queued, queued_large, running, bytes;       /* large: input_is_large */
    int64_t states[JOB_STATE_COUNT];      /* of his jobs, as decided, that are not hidden */
    int64_t beside;                       /* bytes that files take which have fewer in them */
    int64_t ended;                        /* jobs, but those on their way out */
    double deficit, cost_s;               /* deficit round robin; mean seconds of a job */
    double work_s_byte;                   /* mean seconds a byte of large inputs; 0: had none */
    bool competes;                        /* at the latest choice he had a job that might start */
    double cpu_s; int64_t cpu_day;        /* used in that UTC day */
    double upload_level; int64_t upload_ns;     /* token bucket */
    int waits, subscriptions;
    int reads;                            /* tasks that bring him bytes */
};

/* Why a worker is to end under its job. */
enum ending { ENDING_NONE, ENDING_CANCEL, ENDING_RUN_LIMIT, ENDING_DEADLINE, ENDING_LEASE,
    ENDING_FINISH };

enum timer { TIMER_ROOM, TIMER_WAIT, TIMER_DEADLINE, TIMER_START, TIMER_RUN_LIMIT, TIMER_LEASE,
    TIMER_SPAWN, TIMER_END, TIMER_HOUSEKEEPING, TIMER_RETAIN };

enum {
    /* of worker processes: more than any machine this runs on has cores */
    SLOTS_MOST = 256,
    /* of workers elsewhere, behind those: 4 MiB of pieces a worker under way are 4 GiB then */
    REMOTES_MOST = 1024,
};

/* The answers to the parts of one message: sent, as a list, when all are there. */
struct answers {
    struct answers *next, **link;         /* of all that wait, in the core */
    struct reply reply;
    int count, missing;
    char *parts[];
};

/* Counted since the start, for STATS and METRICS. */
struct counts {
    int64_t rejects[MODAL_STATUS_COUNT], replies, bytes_in, bytes_out;
    int64_t commits, committed_changes, ledger_bytes;
    int64_t attempts, deaths, leases_lost, credit_stalls;
    int64_t connections, connections_refused, connections_ended, hangups_kept;
    struct histogram submit_seconds, commit_seconds, commit_transactions, write_seconds;
    int64_t started_ns;
    double replay_s;
};

/* Is the disk full?  See room.c. */
struct disk {
    bool full;                            /* something was refused for want of it */
    bool found;                           /* something was stored since the latest refusal */
    uint64_t wanted;                      /* bytes free that end `full` */
    /* nothing is tried until then; no job starts, having no room for its result */
    int64_t full_until, hold_until;
};

/*
 * What everybody may see, and who owns the rest: a file sees of that what it includes, jobs.h,
 * inputs.h, slots.h, streams.h or events.h.
 */
struct core {
    struct settings settings;
    struct moment now;
    struct actions out;
    struct heap timers;
    bool draining, terminating, stopped;
    int64_t uncommitted, tasks;
    struct transaction *oldest, *newest;  /* of those */
    struct shares behind;                 /* their costs */
    uint64_t asking;                      /* whose request is handled; 0: nobody's */
    bool waited;                          /* it had waited at the door */
    struct spell spell;                   /* of those who have */
    int64_t next_event, last_event;       /* numbers; the last is committed */
    struct account *accounts; size_t account_count;
    struct map users; struct user **user_list; size_t user_count;
    size_t turn;                          /* whose turn it is among users */
    /* of all users, in the order in which they were put up */
    struct answers *answers;
    struct region *region;                /* of jobs and inputs */
    struct disk disk;
    struct counts counts;
    struct jobs *jobs;
    struct inputs *inputs;
    struct slots *slots;
    struct events *events;
    struct stream *streams;
    struct map stream_ids;
    /* when a denial of a key that is on no list is told again */
    int64_t next_denial_ns;
};

/* ---- actions.c: what the core asks for ---- */

/* ACTION is carried out when the step is over, in this order. */
void core_act(struct core *c, struct action action);
/* One line of logfmt, without its time. */
void core_log(struct core *c, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* WHAT is due at WHEN_NS of the monotonic clock, for ORDER (a job, slot or wait); EXTRA as WHAT
 * has it. */
void core_timer(struct core *c, int64_t when_ns, enum timer what, int64_t order, int64_t extra);

/* ---- transaction.c: changes that are committed together, tasks, and what follows ---- */

/* An empty one, the caller's until core_commit. */
struct transaction *transaction_new(void);
/* One change more, zeroed, to be filled in at once: the next one moves it. */
struct ledger_change *transaction_add(struct transaction *t, enum ledger_verb verb);
/* A copy of TEXT that lives as long as T; NULL stays NULL. */
const char *transaction_text(struct transaction *t, const char *text);
/* SUMS of INPUT as rows of its chunks. */
void transaction_add_sums(struct transaction *t, int64_t input, const struct sums *sums);
/* CHUNK of INPUT, of T's only one, as a row; ROW: that of the chunk before, length 0: there is
 * none, and then this one's. */
void transaction_add_chunk(struct transaction *t, int64_t input, struct chunk_record *row,
                           const struct chunk_record *chunk);
/* BLOB, into SIZE bytes of which changes point, stays as long as T. */
void transaction_keep(struct transaction *t, struct blob *blob, size_t size);
/* What follows T's commit, in this order; T's. */
struct after *transaction_after(struct transaction *t, enum after_type type);
/* The list AFTER, T's from here on; NULL is none. */
void transaction_join(struct transaction *t, struct after *after);
/* T is the ledger's; it comes back as EVENT_COMMITTED. */
void core_commit(struct core *c, struct transaction *t);
/* T has come back: it is not under way any more. */
void core_committed(struct core *c, struct transaction *t);
/* A task of the spool threads, the caller's until core_task. */
struct task *task_new(enum task_type type, int64_t id);
/* TASK, whose TURN is that of who asked, is the threads'; it comes back as EVENT_TASK. */
void core_task(struct core *c, struct task *task, uint64_t turn);
/* The same once all samples are in their files and have their rows: for tasks that read them. */
void core_task_settled(struct core *c, struct task *task, uint64_t turn);
/* One of TYPE; REPLY, which is copied, may be NULL.  The caller's until it is joined. */
struct after *after_new(enum after_type type, const struct reply *reply);
/* The whole list; accepts NULL. */
void after_free(struct after *after);
/* AFTER at the end of *LIST. */
void after_append(struct after **list, struct after *after);

/* ---- answer.c: replies, errors, documents of the queue ---- */

/* To whom E's request R is answered. */
struct reply reply_to(const struct event *e, const struct wire_request *r);
/* A header with what all answers have, the caller's. */
cJSON *answer_new(const struct reply *reply);
/* HEADER and BODY (or NULL), both taken, to whom REPLY says. */
void answer_send(struct core *c, const struct reply *reply, cJSON *header, struct blob *body);
/* ERR as an ERROR; DETAIL (or NULL) is taken. */
void answer_error(struct core *c, const struct reply *reply, const struct modal_error *err,
                  cJSON *detail);
/* The same with a text of its own; FIELD "" is none. */
void answer_fail(struct core *c, const struct reply *reply, enum modal_status status,
                 const char *field, cJSON *detail, const char *format, ...)
    __attribute__((format(printf, 6, 7)));
/* Where COUNT answers wait for each other; it goes with the last of them. */
struct answers *answers_new(struct core *c, const struct reply *reply, int count);
/* TEXT, an object, answers the PART of a message; it is taken. */
void answer_part(struct core *c, const struct reply *part, char *text);
/* At the end, with what it has. */
void answers_free(struct answers *answers);
/* An object of one member, for details; the caller's. */
cJSON *answer_number(const char *key, double value);
/* JOB's doc with BODY (or NULL, taken); DUPLICATE -1: without such a member. */
void answer_doc(struct core *c, const struct reply *reply, const struct job *job, int duplicate,
                struct blob *body);
/* The job of a key is gone or going: answered; false: STONE is NULL. */
bool answer_expired(struct core *c, const struct reply *reply, const struct tombstone *stone);
/* The members of JOB's doc; POSITION: its place in the queue too, which takes a walk. */
void doc_write(const struct core *c, struct json_text *text, const struct job *job, bool position);
/* TEXT, closed; the caller frees. */
char *text_end(struct json_text *text);
/* JOB's identifier on the wire. */
void job_ident(const struct core *c, const struct job *job, char out[IDENT_TEXT]);
/* INPUT's identifier on the wire. */
void input_ident(const struct core *c, const struct input *input, char out[IDENT_TEXT]);

/* ---- room.c: whether the disk is full ---- */

/* Something was refused for want of BYTES of disk: the log tells the edge, the metrics
 * the state. */
void room_want(struct core *c, uint64_t bytes);
/* How much is free?  TASK_ROOM answers. */
void room_ask(struct core *c);
/* TASK_ROOM has come back. */
void room_told(struct core *c, const struct task *task);
/* What TASK's end says of the disk. */
void room_judge(struct core *c, const struct task *task);
/* What TASK writes in all; 0: what it writes has its room already. */
uint64_t task_bytes(const struct task *task);
/* Was something refused within the last second, so that nothing is tried? */
bool room_is_full(const struct core *c);

/* ---- index.c ---- */

/* The job of this number; NULL: none. */
struct job *job_by_id(const struct core *c, int64_t id);

/* ---- jobs.c: the moves ---- */

/* The table, empty. */
void jobs_init(struct core *c);
/* All jobs and what hangs from them. */
void jobs_done(struct core *c);
/* The job of USER that REF names, also one that is not committed; NULL: none. */
struct job *job_find(const struct core *c, struct user *user, const struct wire_job *ref);
/* One of USER, in no table yet. */
struct job *job_new(struct core *c, struct user *user, int64_t id);
/* JOB, which is complete, into the tables. */
void job_index(struct core *c, struct job *job);
/* Out of all tables and memory, with what it held of inputs. */
void job_forget(struct core *c, struct job *job);
/* MORE jobs as JOB, 1 or -1, are its user's in its state, and of its kind; of one that is hidden
 * none. */
void job_count(struct core *c, const struct job *job, int more);
/* MORE jobs as JOB, 1 or -1, are queued of its user's. */
void job_count_queued(const struct job *job, int more);
/* The edge to TO, which the table of moves must have; commits T, or with NULL one of its own. */
void job_move(struct core *c, struct job *job, enum job_state to, struct transaction *t);
/* The same with a failure; DETAIL (or NULL) is taken. */
void job_fail(struct core *c, struct job *job, enum job_state to, const struct modal_error *err,
              cJSON *detail);
/* AFTER's edge is committed: it may be seen. */
void job_shown(struct core *c, const struct after *after);
/* Ready to start, now or at its time. */
void job_enqueue(struct core *c, struct job *job);
/* A committed job: its deadline is watched, and it is enqueued where it is queued. */
void job_watch(struct core *c, struct job *job);
/* Delete it; REPLY (or NULL) is answered when that is committed. */
void job_remove(struct core *c, struct job *job, const struct reply *reply);
/* Its result may answer again, unless another's does. */
void job_index_result(struct core *c, struct job *job);
/* The job of USER whose result answers CONTENT and SETTINGS; NULL: none. */
struct job *job_cached(struct core *c, struct user *user, const uint8_t content[32],
                       const uint8_t settings[32]);
/* It ended now, for the order of retention. */
void job_note_end(struct core *c, struct job *job);
/* The line of an edge that is committed. */
void job_log_edge(struct core *c, const struct job *job, const char *from, enum job_state to,
                  uint64_t peer);
/* The numbered event of the edge to TO, with T. */
void job_event(struct core *c, struct job *job, struct transaction *t,
               const struct failure *failure, enum job_state to);
/* Timer WHAT of job ID is due; EXTRA: the attempt it was set for. */
void job_expired(struct core *c, int64_t id, enum timer what, int64_t extra);
/* The oldest ended jobs go, a bounded number a step. */
void jobs_retain(struct core *c);
/* DOCUMENT, if it is small, stays at hand for who waits for JOB. */
void document_keep(struct core *c, struct job *job, struct blob *document);
/* All documents leave memory. */
void documents_drop(struct core *c);
/* Accepts NULL. */
void failure_free(struct failure *failure);

/* ---- users.c: accounts, limits, shares ---- */

/* The user of this name, who is made where there is none. */
struct user *user_get(struct core *c, const char *name);
/* Whose key this is; NULL: no such account. */
struct user *user_of_key(struct core *c, const char *key);
/* May an account of ROLE ask anything here?  Workers have a socket of their own. */
bool role_is_client(enum wire_role role);
/* Is KEY still this user's, and a client's? */
bool user_admits(const struct core *c, const struct user *user, const char *key);
/* Is KEY a worker's? */
bool key_is_worker(const struct core *c, const char *key);
/* The accounts of new settings. */
void users_configure(struct core *c);
/* All users and tombstones. */
void users_done(struct core *c);
/* JOB, which has the largest id, is USER's. */
void user_add_job(struct user *user, struct job *job);
/* It is not any more. */
void user_drop_job(struct user *user, const struct job *job);
/* Index of the first job with a larger id. */
size_t user_seek(const struct user *user, int64_t id);
/* Whose jobs or streams ASKER asks for by NAME (NULL: his own); NULL, and told to REPLY: he may
 * not, or there is no such user. */
const struct user *user_listed(struct core *c, const struct reply *reply,
                               const struct user *asker, const char *name);
/* What is left of the job of KEY; NULL: nothing. */
struct tombstone *user_tombstone(const struct user *user, const char *key);
/* The job of KEY went at EXPIRED_NS of UTC. */
void user_bury(struct user *user, const char *key, const uint8_t fingerprint[32],
               int64_t expired_ns);
/* As loaded, into the order of their age. */
void tombstones_sort(struct core *c);
/* USER's oldest go with T where there are more than are kept. */
void tombstones_trim(struct core *c, struct user *user, struct transaction *t);
/* Those past their age go, here and in the ledger. */
void tombstones_retain(struct core *c);
/* Has anybody a job that may start on the worker of SLOT? */
bool user_any_waits(struct core *c, int slot);
/* Which job starts next on the worker of SLOT, out of the queue; NULL: none. */
struct job *user_next(struct core *c, int slot);
/* An attempt ended, charged with EXPECTED_S at its start, after SECONDS and CPU_S. */
void user_ran(struct core *c, struct user *user, double expected_s, double seconds, double cpu_s);
/* A job took S_BYTE seconds of work a byte of its large input; 0: it had none. */
void user_worked(struct user *user, double s_byte);
/* Whose turn a task of USER's is, that PEER asked for (0: none did): a user's, and where there are
 * no keys, so that all are one user, a connection's. */
uint64_t user_turn(const struct user *user, uint64_t peer);
/* What USER took of the processor today, with T: a restart goes on counting. */
void user_note(struct user *user, struct transaction *t);
/* The same, read back. */
void user_load_note(struct core *c, const struct note_record *r);
/* Would this be over a limit of USER?  true: REPLY is answered. */
bool user_quota(struct core *c, struct user *user, const struct reply *reply, int64_t more_jobs,
                int64_t more_bytes);

/* ---- inputs.c: sealed inputs ---- */

/* The table, empty. */
void inputs_init(struct core *c);
/* All inputs, open ones with their files closed. */
void inputs_done(struct core *c);
/* Bytes of chunks that are not committed yet, of all uploads. */
int64_t inputs_in_flight(const struct core *c);
/* The number that the next input or stream has. */
int64_t input_number(struct core *c);
/* Numbers up to ID have been given. */
void input_number_past(struct core *c, int64_t id);
/* What an input of BYTES counts as toward its user's limit, where it has a file of its own. */
uint64_t input_takes(uint64_t bytes);
/* One of USER as W describes it, in the table; in a file of its own, unless... */
struct input *input_new(struct core *c, struct user *user, const struct wire_input *w, int64_t id);
/* ... it is told here to lie in its row. */
void input_put_inline(struct input *input);
/* One that the ledger has. */
struct input *input_load(struct core *c, const struct input_record *r);
/* The input of this number; NULL: none. */
struct input *input_by_id(const struct core *c, int64_t id);
/* USER's sealed one of this content; NULL: none. */
struct input *input_sealed(const struct user *user, const uint8_t content[32]);
/* USER's youngest sealed one of this SHA-256; NULL: none. */
struct input *input_of_identity(const struct user *user, const uint8_t sha256[32]);
/* What makes two inputs the same: SHA256 and the attributes, which may be NULL. */
void input_content(const uint8_t sha256[32], const cJSON *attributes, uint8_t content[32]);
/* It is sealed and can be found by content and by SHA-256. */
void input_index(struct input *input);
/* Its row; texts and inline data live as long as T. */
void input_record_fill(const struct input *input, struct transaction *t, struct input_record *out);
/* What it is, into an answer. */
void input_describe(const struct input *input, cJSON *object);
/* The same for a worker, with where it lies; for one elsewhere with what it pulls. */
void input_describe_run(const struct core *c, const struct input *input, bool elsewhere,
                        cJSON *object);
/* JOBS more (or fewer, or 0) name it, now; NULL is none. */
void input_use(struct core *c, struct input *input, int jobs);
/* Row, note and file go; what is in memory goes with the commit. */
void input_remove(struct core *c, struct input *input);
/* VERDICT, which outlives it, is that of the stream that input ID was sealed of; durable by T
 * (NULL: it is already). */
void input_judge(struct core *c, int64_t id, const char *verdict, struct transaction *t);
/* Out of table and memory. */
void input_forget(struct core *c, struct input *input);
/* DATA (or NULL) is what memory has of it. */
void input_cache(struct core *c, struct input *input, struct blob *data);
/* Its data may leave memory where there is much of that and its row is committed. */
void input_trim(struct core *c, struct input *input);
/* Its data in memory; NULL: it must be fetched, or opened by the worker. */
struct blob *input_at_hand(const struct input *input);
/* A job has begun with its data at hand: whom else are they for? */
void input_begun(struct core *c, struct input *input);
/* Does it come with its job, neither as a file nor in pieces? */
bool input_is_inline(const struct input *input);
/* A task that brings its data, or opens its file; the caller's. */
struct task *input_fetch(const struct input *input);
/* A task that reads LENGTH of its bytes from OFFSET on, each part against its checksum; the
 * caller's.  NULL: they come with the job, or are not so many. */
struct task *input_piece(const struct input *input, uint64_t offset, uint64_t length);
/* Its SHA-256, borrowed. */
const uint8_t *input_sha256(const struct input *input);
/* All that is committed leaves memory. */
void inputs_drop_cached(struct core *c);
/* Sealed ones that no job names go after their time. */
void inputs_retain(struct core *c);
/* The identity's view of W, whose texts it borrows; the caller frees *NAMES, NULL where there
 * are none. */
void input_shape_of(const struct wire_input *w, struct input_shape *shape, const char ***names);
/* What is on its way of an open input. */
struct filling *filling_new(int64_t touched_ns);
/* With what waits in it; accepts NULL. */
void filling_free(struct filling *f);
/* What TASK, which begins INPUT, must know of its user's other uploads. */
void input_share(const struct input *input, struct task *task);

/* ---- slots.c: worker processes from outside ---- */

/* The pool, without a process. */
void slots_init(struct core *c);
/* With what half a document it has. */
void slots_done(struct core *c);
/* VERB to the worker of SLOT; HEADER and BODY (or NULL) are taken. */
void worker_send(struct core *c, int slot, const char *verb, cJSON *header, struct blob *body);
/* The same, its header as TEXT, which is taken. */
void worker_send_text(struct core *c, int slot, const char *verb, char *text, struct blob *body);
/* A PART of it has its place: it may send one more. */
void worker_go(struct core *c, int slot);
/* Its process group ends now, or it is told to and not heard any more; SLOT -1 is none. */
void worker_kill(struct core *c, int slot);
/* The slot after SLOT, after -1 the first: this host's, then those elsewhere; -1: no more. */
int slot_after(const struct core *c, int slot);
/* Is its worker elsewhere? */
bool slot_is_remote(int slot);
/* May its worker have JOB: has it the memory for the input, and the time? */
bool slot_fits(const struct core *c, int slot, const struct job *job);
/* Do USER's jobs with large inputs go elsewhere, by what is known of the link and of them? */
bool slots_link_pays(const struct core *c, const struct user *user);
/* May its worker have live windows: is it here, or the way to it short enough? */
bool slot_takes_windows(const struct core *c, int slot);
/* Has the worker of SLOT said its last word on its job? */
bool worker_is_finishing(const struct core *c, int slot);
/* Workers that have a job or a window. */
int workers_busy(const struct core *c);
/* Workers of other hosts that have joined. */
int workers_elsewhere(const struct core *c);
/* Their names, as JSON; NULL: there are none. */
struct blob *workers_names(const struct core *c);
/* Has no worker a job? */
bool workers_idle(const struct core *c);
/* A worker's ERROR, with a code of this protocol whatever it sent. */
void worker_error(const cJSON *error, struct modal_error *out);

/* ---- waits.c: who waits for the end of a job, or for bytes that are read ---- */

/* May USER have one more such task for REPLY?  false: REPLY is answered. */
bool read_allows(struct core *c, const struct user *user, const struct reply *reply);
/* PART of JOB, or where that is NULL of the input ID, [offset, offset + length) of what TYPE reads
 * of ID, to REPLY. */
struct task *read_for(struct core *c, const struct reply *reply, const struct job *job,
                      enum task_type type, int64_t id, const char *part);
/* The doc of W's job, with its document where that was asked for and is small enough. */
void wait_tell(struct core *c, const struct wait *w);
/* A copy of NOW waits, TIMEOUT_S at most. */
void wait_begin(struct core *c, const struct wait *now, double timeout_s);
/* Who waits for JOB is answered. */
void wait_answer(struct core *c, struct job *job);
/* The time of wait NUMBER is over. */
void wait_timeout(struct core *c, uint64_t number);
/* End those of a connection that has ended. */
void waits_gone(struct core *c, uint64_t peer);
/* Answer those of keys that are admitted no more. */
void waits_revoke(struct core *c);
/* What read_for asked for has been read. */
void read_task_done(struct core *c, struct task *task);
/* The checksums that TASK has of an input's parts, which the ledger had not: the next who reads
 * of them need not read all. */
void sums_keep(struct core *c, const struct task *task);
#endif
