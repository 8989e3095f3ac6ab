/* verbs.h - what clients and workers ask for, and what the step calls when something comes of it */
#ifndef BROKER_VERBS_H
#define BROKER_VERBS_H
#include "broker/core/state.h"

struct remote;

/* What a client asks: answered, now or after a commit or a task. */
struct request {
    const struct event *event;            /* as it came */
    struct wire_request wire;             /* what it says */
    struct user *user;                    /* who asks */
    struct job *job;                      /* committed; NULL where the verb is about no one job */
    struct reply reply;                   /* to whom it is answered */
};

/* ---- requests.c ---- */

/* Whatever E asks, by whom it may be asked. */
void request_handle(struct core *c, const struct event *e);

/* ---- submit.c ---- */

/* SUBMIT */
void submit_request(struct core *c, const struct request *q);
/* SUBMITS: each part a submission of its own. */
void submits_request(struct core *c, const struct request *q);

/* ---- uploads.c ---- */

/* UPLOAD */
void upload_request(struct core *c, const struct request *q);
/* What one upload or stream may have unacknowledged, bytes: an equal part of all, at least two
 * chunks, at most 16 MiB. */
int64_t core_window(const struct core *c);
/* Are SIZE bytes within USER's rate?  Else REPLY is answered. */
bool upload_allows(struct core *c, struct user *user, size_t size, const struct reply *reply);
/* BYTES of his rate, for what comes without having been sent. */
void upload_owes(struct user *user, uint64_t bytes);
/* A task on an upload has come back. */
void upload_task_done(struct core *c, struct task *task);
/* Its row is gone: who waits for that is told. */
void upload_gone(struct core *c, struct input *input);
/* AFTER_BEGIN, CHUNK or SEAL is committed. */
void upload_after(struct core *c, struct after *after);
/* One that the ledger has: its user may go on with it. */
void upload_load(struct input *input, const struct input_record *r);
/* What it was begun with. */
void upload_load_note(struct core *c, const struct note_record *r);
/* Open ones that nobody touches go after their time. */
void uploads_retain(struct core *c);
/* After loading: those that were to go, go. */
void uploads_go_on(struct core *c);
/* Signals that the worker of SLOT makes for USER; it ends by an AFTER_OUTPUT. */
struct input *output_begin(struct core *c, struct user *user, const struct wire_input *w, int slot);
/* The next bytes of it. */
void output_chunk(struct core *c, struct input *input, struct blob *chunk);
/* All of it has come. */
void output_seal(struct core *c, struct input *input);
/* Nobody makes it any more. */
void output_drop(struct core *c, struct input *input);
/* Bytes that have come of it. */
uint64_t output_accepted(const struct input *input);
/* Bytes that it has. */
uint64_t output_total(const struct input *input);

/* ---- workers.c ---- */

/* What the worker of E's slot says. */
void worker_message(struct core *c, const struct event *e);
/* Its process ended with STATUS, as wait(2) gives it. */
void worker_exit(struct core *c, int slot, int status, const char *stderr_text);
/* SLOT has a worker from now on, who may not be silent for longer than its lease. */
void worker_watch(struct core *c, int slot);
/* The worker of SLOT, which is elsewhere, is to go: its job goes back into the queue. */
void worker_dismiss(struct core *c, int slot);
/* TIMER_LEASE, TIMER_SPAWN or TIMER_END of SLOT is due. */
void worker_timer(struct core *c, enum timer what, int64_t slot);
/* Processes are started until there are as many as the settings want. */
void workers_fill(struct core *c);
/* Windows and jobs to idle workers. */
void workers_schedule(struct core *c);
/* AFTER_OUTPUT: the signals of its job are sealed, or failed. */
void worker_output(struct core *c, const struct after *after);
/* The input of a job that starts has been read or opened. */
void job_input_read(struct core *c, struct task *task);
/* The document of a job is stored, or failed to be. */
void job_result_put(struct core *c, struct task *task);

/* ---- ends.c ---- */

/* JOB's attempt, which the worker had that ended with STATUS (ELSEWHERE or NULL: ours), ended for
 * ENDING: it fails, is cancelled, is tried again or is dead. */
void attempt_ended(struct core *c, struct job *job, enum ending ending,
                   const struct remote *elsewhere, int status, const char *stderr_text);
/* The end of what a process said that nobody had told to end, as one line. */
void exit_log(struct core *c, int slot, int status, const char *stderr_text);

/* ---- remotes.c ---- */

/* What a worker elsewhere says, or who wants to be one. */
void remote_message(struct core *c, const struct event *e);
/* Those whose keys are no workers' any more go. */
void remotes_revoke(struct core *c);
/* The connection PEER has ended. */
void remote_gone(struct core *c, uint64_t peer);

/* ---- chunks.c ---- */

/* INPUT: the worker of SLOT, which is elsewhere, pulls a piece of its job's input.  What is wrong
 * with that; NULL: nothing, and a CHUNK will follow. */
const char *piece_request(struct core *c, int slot, const struct wire_message *m);
/* The task that it wanted has come back. */
void piece_read(struct core *c, struct task *task);

/* ---- events.c ---- */

/* No subscriptions, no events in memory. */
void events_init(struct core *c);
/* All of both. */
void events_done(struct core *c);
/* EVENTS */
void events_request(struct core *c, const struct request *q);
/* AFTER_EVENT is committed: it may be told. */
void events_committed(struct core *c, struct after *after);
/* JOB's progress, to who subscribes; it has no number. */
void events_progress(struct core *c, struct job *job);
/* Each subscriber gets what it has not seen, a bounded number a step. */
void events_pump(struct core *c);
/* Is there more to be told in the next step? */
bool events_wait(const struct core *c);
/* A page of older events has been read. */
void events_task_done(struct core *c, struct task *task);
/* PEER takes no more, takes more again, or is gone. */
void events_peer(struct core *c, uint64_t peer, enum event_type type);
/* End the subscriptions of keys that are admitted no more. */
void events_revoke(struct core *c);
/* Those past the number that is kept leave the ledger. */
void events_retain(struct core *c);

/* ---- stream_list.c ---- */

/* STREAMS */
void streams_request(struct core *c, const struct request *q);

/* ---- streams.c ---- */

/* STREAM */
void stream_request(struct core *c, const struct request *q);
/* TASK_STREAM_SEAL has come back. */
void stream_sealed(struct core *c, struct task *task);
/* T with AFTER was refused for want of disk. */
void stream_refused(struct core *c, struct after *after, struct transaction *t);
/* T with AFTER is committed. */
void stream_after(struct core *c, struct after *after, struct transaction *t);
/* TASK_SAMPLES_COMPARE has come back. */
void stream_compared(struct core *c, struct task *task);
/* A new one, open; WINDOW may be NULL. */
struct stream *stream_make(struct core *c, struct user *user, const char *name,
                           const struct wire_input *w, const cJSON *window, int64_t id);
/* NULL: there is none. */
struct stream *stream_by_id(const struct core *c, int64_t id);
/* Whether ID is an open stream, whose samples are in a file. */
bool stream_is_open(const struct core *c, int64_t id);
/* Whose it is. */
const struct user *stream_user(const struct stream *s);
/* Its name, borrowed. */
const char *stream_name(const struct stream *s);
/* Closed ones are forgotten after their time. */
void streams_retain(struct core *c);
/* All of them. */
void streams_done(struct core *c);

/* ---- segments.c: what a stream has of its samples ---- */

enum sameness { UNTOLD, SAME, OTHER, UNKNOWN };
/* Samples [first, first + count) as DATA has them beside those of the same indices, as far as
 * their checksums are in memory. */
enum sameness samples_compare(const struct stream *s, uint64_t first, uint64_t count,
                              const char *data);
/* Their checksums are kept. */
void samples_note(struct stream *s, uint64_t first, uint64_t count, const char *data);
/* Samples [from, to) are missing; their user is charged for them. */
void gaps_add(struct stream *s, uint64_t from, uint64_t to);
/* Into an answer or attributes, which must fit a header: the first of them, and how many there are
 * where that is not all. */
void gaps_write(cJSON *object, const struct stream *s);
/* The end of what came, those samples that are held included. */
uint64_t samples_reach(const struct stream *s);
/* Bytes of COUNT samples from FIRST on that the record has in their place, if they are the same. */
uint64_t known_before(const struct stream *s, uint64_t first, uint64_t count);
/* Bytes of the gap that samples from FIRST on leave. */
uint64_t gap_before(const struct stream *s, uint64_t first);
/* What all gaps of an epoch may take, however short it is. */
#define GAP_BYTES (UINT64_C(64) << 20)
/* Bytes that all gaps of S may take: where users have keys, who sent little may not make the daemon
 * write much. */
uint64_t gaps_most(const struct core *c, const struct stream *s);
/* None is. */
void gaps_drop(struct stream *s);
/* COUNT samples from FIRST on are here, behind all others; their user is charged. */
void segments_add(struct stream *s, uint64_t epoch, uint64_t first, uint64_t count);
/* What is in memory of segments and checksums goes; the gaps stay, for who asks again. */
void segments_drop(struct stream *s);
/* Back to what is committed. */
void segments_cut(struct stream *s);
/* What reads COUNT samples from FIRST on of the batch that S was sealed into; NULL: it has gone. */
struct task *batch_task(const struct core *c, struct stream *s, uint64_t first, uint64_t count);

/* ---- stream_notes.c ---- */

/* What is remembered of S, open, or sealed with its newest window not told yet. */
void stream_note(struct transaction *t, const struct stream *s);
/* Nothing any more. */
void stream_notes_end(struct transaction *t, const struct stream *s);

/* ---- windows.c ---- */

/* Can the window that TEXT describes be kept for W?  NULL is none. */
enum modal_status window_check(const cJSON *text, const struct wire_input *w,
                               struct modal_error *err);
/* S's window as TEXT describes it; none where that is NULL or, from an older daemon, cannot
 * be kept. */
void window_init(struct stream *s, const cJSON *text, const struct wire_input *w);
/* What it holds of memory. */
void window_done(struct window *w);
/* SEGMENT is committed: its samples are the latest. */
void window_keep(struct stream *s, const struct segment_record *segment);
/* An epoch begins, or samples were taken back: windows begin anew. */
void window_reset(struct core *c, struct stream *s);
/* Once its batch has a row, the verdict of its last window is the batch's too, and durable by T. */
void window_keep_verdict(struct core *c, const struct stream *s, struct transaction *t);
/* What a window may say, in words; the last is NULL. */
extern const char *const window_verdicts[];
/* The samples of S's last window are not to be had: nobody is told of it. */
void window_forget_last(struct core *c, struct stream *s);
/* Is the newest window that S's durable samples make not told yet? */
bool window_is_untold(const struct stream *s);
/* S has more durable samples, or its worker is free again: where a window is due, it waits for
 * a worker. */
void window_offer(struct core *c, struct stream *s);
/* A window that is due to the worker of SLOT, which is idle or has one; false: none is. */
bool window_start(struct core *c, int slot);
/* What this host's workers go on with after their windows, unless it is a job's turn. */
void windows_give_ahead(struct core *c);
/* Windows go first, unless they have had more than half: of the workers in slots FROM to END that
 * are busy, or, where these are as many, of the time since both waited. */
bool windows_first(const struct core *c, int from, int end);
/* M, DONE or FAILED, is the end of SLOT's window. */
void window_end(struct core *c, int slot, const struct wire_message *m);
/* Does M ask again for WORKER's window, as one that was dropped, though all of it was sent? */
bool window_is_whole(const struct slot *worker, const struct wire_message *m);
/* The worker of SLOT died under its window: once more on another, unless the window is to blame;
 * and those that it had ahead, each alone. */
void window_died(struct core *c, int slot);
/* The worker of SLOT gives its windows back: they are due again, and nothing is said against
 * them. */
void windows_back(struct core *c, int slot);
/* Has WORKER had its window longer than one may take? */
bool window_late(const struct core *c, const struct slot *worker);

/* ---- recall.c ---- */

/* A stream that the ledger has, open or sealed. */
void stream_load_note(struct core *c, const struct note_record *r);
void stream_load_sealed(struct core *c, const struct note_record *r);
/* A segment of an open one, in the order in which they came, once all notes are read. */
void stream_load_segment(struct core *c, const struct segment_record *r);
/* Once the stream is there: which window is due next, what the last one said, what was known of
 * tracks; these alone, as a daemon of before noted them, which comes first. */
void window_load_told(struct core *c, const struct note_record *r);
void window_load_tracks(struct core *c, const struct note_record *r);
/* Of a batch. */
void window_load_verdict(struct core *c, const struct note_record *r);
/* All is loaded: windows go on from the samples that are there. */
void windows_recall(struct core *c);
/* TASK_SAMPLES_READ or TASK_BATCH_READ has come back. */
void window_recalled(struct core *c, struct task *task);

/* ---- metrics.c ---- */

/* STATS of USER, or of ALL, into OBJECT. */
void stats_write(const struct core *c, const struct user *user, bool all, cJSON *object);
/* METRICS; of users USER alone, or with NULL all. */
struct blob *metrics_text(const struct core *c, const struct user *user);
#endif
