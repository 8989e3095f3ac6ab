/* ledger.h - the durable record of inputs, jobs, results and events: one SQLite database in the
 * data folder
 *
 * The data folder DIR holds
 *
 *     LOCK            flock'ed while a daemon has the folder; its text is the daemon's pid
 *     ledger.db, -wal, -shm, -mark    the ledger, and how far its log was synced; application id
 *                                     "mdld", user_version its schema
 *     spool/ID.h5     a sealed input whose data is not in its row; spool/ID.part one being uploaded
 *     spool/ID.samples  the samples of open stream ID, as long as it is open; see samples.h
 *     tape              samples of open streams that are not there yet; see tape.h
 *     results/ID.json a result larger than LEDGER_RESULT_INLINE_MOST
 *     RESERVE         blocks kept for the time when the disk is full
 *
 * One thread owns a ledger and applies groups of changes, each group one transaction and one fsync;
 * what a group changes may be acknowledged once ledger_commit has returned MODAL_OK.  Other threads
 * read through a ledger_reader each.
 *
 * All times are int64 ns of UTC since 1970, 0 for "none".  All text is UTF-8 and borrowed by the
 * call that is given it.
 */
#ifndef STORE_LEDGER_H
#define STORE_LEDGER_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"
#include "store/identity.h"

enum {
    LEDGER_SCHEMA = 4,                        /* the schema this code writes */
    LEDGER_CHUNK_MOST = 1024 * 1024,          /* bytes of a chunk_record */
    LEDGER_RESULT_INLINE_MOST = 256 * 1024,   /* a result's text up to this lives in its row */
    LEDGER_RESULT_MOST = 256 * 1024 * 1024,   /* four times the longest document of the wire */
};

/* A job's states.  The moves between them are one table, ledger_moves; done and cancelled never
 * change. */
enum job_state {
    JOB_QUEUED,
    JOB_RUNNING,
    JOB_DONE,
    JOB_FAILED,
    JOB_CANCELLED,
    JOB_DEAD,
    JOB_STATE_COUNT
};
/* "queued", "running", ... */
extern const char *const job_states[JOB_STATE_COUNT];
extern const bool ledger_moves[JOB_STATE_COUNT][JOB_STATE_COUNT];             /* [from][to] */
/* done, failed, cancelled, dead */
bool job_state_final(enum job_state state);

enum input_state { INPUT_OPEN, INPUT_SEALED };

struct input_record {
    int64_t id;                   /* >= 1, the owner's choice, ascending; names the spool file */
    const char *user;
    struct input_shape shape;
    enum input_state state;
    uint8_t sha256[32];           /* of a sealed one */
    uint32_t crc;                 /* CRC-32C of all its data */
    /* the data of an inline one; at load NULL (read it through a ledger_reader) */
    const void *data;
    bool inline_data;             /* the data is in the row; otherwise in spool/ID.h5 */
    uint64_t offset;              /* of the data in the spool file */
    int64_t created_ns, used_ns;
    /* at load only, of an open one: bytes 0 .. received - 1 are durable */
    uint64_t received;
};

/* Samples FIRST .. FIRST + COUNT - 1 of an epoch of an open stream: LENGTH bytes at OFFSET of its
 * file, behind all segments before. */
struct segment_record {
    int64_t stream;
    uint64_t epoch, first, count, offset, length;
    uint32_t crc;                 /* CRC-32C of its bytes */
    const void *data;             /* at a put; at load NULL */
};

struct chunk_record { uint64_t offset, length; uint32_t crc; };

struct job_record {
    int64_t id;                   /* >= 1, ascending in order of acceptance */
    const char *user, *key;       /* unique together; key NULL: the job has none */
    const char *kind, *options;   /* options: a JSON object's text */
    int64_t input;                /* input_record.id; 0: none */
    uint8_t fingerprint[32];      /* of (kind, options, input): equal for a true repeat of a key */
    int priority;
    int64_t run_limit_ns;         /* of one attempt; a duration */
    int64_t deadline_ns, not_before_ns;
    const char *tag;              /* free for the broker (sharing, arrays); or NULL */

    enum job_state state;         /* from here on what LEDGER_JOB_MOVE changes */
    int attempts;                 /* attempts started */
    int crashes;                  /* attempts that ended with the worker's death */
    int64_t submitted_ns, started_ns, finished_ns;
    int64_t cpu_ns;               /* CPU time of all attempts */
    /* or NULL; detail a JSON object's text */
    const char *error_code, *error_message, *error_field, *error_detail;
    /* what the worker said last; at load NULL (read it through a ledger_reader) */
    const char *stderr_text;
    uint64_t result_bytes;        /* 0: no result */
    int64_t output;               /* the input_record that holds a result's batch; 0: none */
    bool cached;                  /* its result was another job's */
};

/* A result's text: in its row, or, too large for it, in results/JOB.json (see
 * ledger_result_put). */
struct result_record {
    int64_t job;
    const char *text;             /* NULL: in its file */
    uint64_t length;
    uint32_t crc;                 /* CRC-32C of the text */
    /* what it answers: the input's identity, the SHA-256 of kind and options */
    uint8_t input[32], settings[32];
};

/* A key whose job is gone: it answers `expired`. */
struct tombstone_record {
    const char *user, *key;
    int64_t job;
    uint8_t fingerprint[32];
    int64_t expired_ns;
};

/* A numbered event, replayable: an edge of a job or a track, a live mode, an alarm. */
struct event_record {
    int64_t number;               /* > 0, ascending over the ledger */
    int64_t ns, job;              /* job 0: none */
    const char *user, *topic;     /* topic: "job", "stream", ... */
    const char *text;             /* a JSON object's text */
};

/* Anything small the daemon must remember by name (a stream, a user's CPU-seconds of a day,
 * drain). */
struct note_record { const char *topic, *name, *text; };

enum ledger_verb {
    LEDGER_INPUT_PUT,        /* insert or replace .input (with its data where inline_data) */
    LEDGER_INPUT_USED,       /* .input.id, .input.used_ns */
    LEDGER_INPUT_DELETE,     /* .id, with its chunks; the caller removes the spool file after the
                              * commit */
    /* .id is the input, .chunk, in place of one that begins there; synced before by the spool */
    LEDGER_CHUNK_PUT,
    LEDGER_SEGMENT_PUT,      /* .segment; its data is on stable storage with the group: on the
                              * tape (tape.h), from where it goes to its file and row, or there */
    LEDGER_SEGMENT_ROW,      /* .segment, which was on the tape; none where its stream is gone */
    LEDGER_SAMPLES_SETTLE,   /* what the tape has of stream .id, or of all where that is 0, goes to
                              * files and rows, ahead of the group */
    LEDGER_SEGMENTS_DELETE,  /* .id is the stream, settled before, whose note goes too; the caller
                              * removes its file after the commit */
    LEDGER_JOB_PUT,          /* insert .job whole; MODAL_CONFLICT: its id, or its user and key,
                              * are taken */
    LEDGER_JOB_MOVE,         /* .job: state and all below it, by id; MODAL_CONFLICT: not a move
                              * of ledger_moves, MODAL_NOT_FOUND */
    LEDGER_JOB_LIMITS,       /* .job: priority, run_limit_ns, deadline_ns, not_before_ns, tag, by
                              * id */
    LEDGER_JOB_DELETE,       /* .id, with its result row; the caller removes results/ID.json
                              * after the commit */
    LEDGER_RESULT_PUT,       /* .result; before or in the same group as the move to done */
    LEDGER_TOMBSTONE_PUT,    /* .tombstone */
    LEDGER_TOMBSTONES_PRUNE, /* .id: UTC ns; those expired before it go */
    LEDGER_TOMBSTONE_DROP,   /* .tombstone, by user and key */
    LEDGER_EVENT_PUT,        /* .event */
    LEDGER_EVENTS_PRUNE,     /* .id: numbers below it go */
    LEDGER_NOTE_PUT,         /* .note; text NULL deletes it */
    LEDGER_VERB_COUNT
};

struct ledger_change {
    enum ledger_verb verb;
    /* out: MODAL_OK applied; else it had no effect, and the rest of the group stands */
    enum modal_status status;
    union {
        int64_t id;
        struct input_record input;
        struct { int64_t input_id; struct chunk_record chunk; };
        struct segment_record segment;
        struct job_record job;
        struct result_record result;
        struct tombstone_record tombstone;
        struct event_record event;
        struct note_record note;
    };
};

/* Called for each row by ledger_load, in the order of the members, each by ascending id (notes by
 * topic and name); what it gets is borrowed until it returns.  NULL: not wanted.  A status other
 * than MODAL_OK ends the loading and is returned. */
struct ledger_visitor {
    void *context;
    enum modal_status (*input)(void *context, const struct input_record *);
    enum modal_status (*job)(void *context, const struct job_record *);
    enum modal_status (*result)(void *context, const struct result_record *);        /* text NULL */
    enum modal_status (*tombstone)(void *context, const struct tombstone_record *);
    enum modal_status (*note)(void *context, const struct note_record *);
    enum modal_status (*event)(void *context, const struct event_record *);
    /* by stream, then by offset */
    enum modal_status (*segment)(void *context, const struct segment_record *);
};

struct ledger;

/*
 * Take the data folder DIR (made if absent, mode 0750) for this process and open its ledger.  Fails
 * with
 *   MODAL_BUSY         another daemon has the folder, or runs on a copy of it on this host (same
 *                      store id)
 *   MODAL_BAD_VERSION  a later schema wrote it; an earlier one is upgraded in one transaction
 *   MODAL_CORRUPT      it is not a ledger, or damaged; the text says what fsck would say
 *   MODAL_IO, MODAL_STORAGE_FULL
 */
enum modal_status ledger_open(const char *dir, struct ledger **out, struct modal_error *err);
void ledger_close(struct ledger *ledger);
/* The random id of this store, 32 hex digits; borrowed. */
const char *ledger_store_id(const struct ledger *ledger);

/*
 * Apply CHANGES in order in one transaction.  MODAL_OK: all with status MODAL_OK are on stable
 * storage.  MODAL_STORAGE_FULL: nothing was applied, the ledger lives on (deletes may yet pass: see
 * reserve in spool.h). MODAL_IO, MODAL_CORRUPT: nothing may be acknowledged and the ledger takes
 * nothing more; end the process.
 */
enum modal_status ledger_commit(struct ledger *ledger, struct ledger_change *changes, size_t count,
                                struct modal_error *err);

/* To be called after the acknowledgements of a commit are on their way: moves a long log to the
 * database (ledger_commit does so itself once it is four times as long), and the samples of a long
 * tape to their files, some streams' a call, gives back some of the pages of deleted rows where
 * these are more than a tenth.  *MORE (may be NULL): there is more of that to do in a next call, at
 * leisure.  Fails as ledger_commit does. */
enum modal_status ledger_settle(struct ledger *ledger, bool *more, struct modal_error *err);

/* For the time when nothing is asked of it: empties the tape, gives back pages of deleted rows,
 * some a call, then moves the log to the database and gives its space, and the memory of the pages
 * read, back. *MORE: there is more to do (or a reader was in the way) in a next call.  Fails as
 * ledger_commit does. */
enum modal_status ledger_idle(struct ledger *ledger, bool *more, struct modal_error *err);

/* Move the whole log to the database now, so that its space is used again.  A full disk is no
 * error: the log stays. */
enum modal_status ledger_checkpoint(struct ledger *ledger, struct modal_error *err);

/* All rows to VISITOR, at the start, before the first commit. */
enum modal_status ledger_load(struct ledger *ledger, const struct ledger_visitor *visitor,
                              struct modal_error *err);

/* Give the pages of deleted rows back to the file system, at most MOST_PAGES in this call; *LEFT
 * are still free. */
enum modal_status ledger_vacuum(struct ledger *ledger, int most_pages, int64_t *left,
                                struct modal_error *err);

/* Reading beside the owner, from any one other thread; sees committed rows only. */
struct ledger_reader;
enum modal_status ledger_reader_open(const char *dir, struct ledger_reader **out,
                                     struct modal_error *err);
void ledger_reader_close(struct ledger_reader *reader);
/* The text of a result (from its row or its file, its CRC checked: MODAL_CORRUPT), of a job's
 * stderr, the data of an inline input.  The caller frees *DATA, which is followed by a zero byte.
 * MODAL_NOT_FOUND where there is none. */
enum modal_status ledger_read_result(struct ledger_reader *reader, int64_t job, char **data,
                                     size_t *length, struct modal_error *err);
enum modal_status ledger_read_stderr(struct ledger_reader *reader, int64_t job, char **data,
                                     size_t *length, struct modal_error *err);
enum modal_status ledger_read_input(struct ledger_reader *reader, int64_t input, char **data,
                                    size_t *length, struct modal_error *err);
/* Events with number > AFTER, of USER (NULL: all), at most MOST. */
enum modal_status ledger_read_events(struct ledger_reader *reader, int64_t after, const char *user,
                                     int most,
                                     enum modal_status (*event)(void *context,
                                                                const struct event_record *),
                                     void *context, struct modal_error *err);
/* The chunks of an input that have bytes in [FROM, TO), by ascending offset. */
enum modal_status ledger_read_chunks(struct ledger_reader *reader, int64_t input, uint64_t from,
                                     uint64_t to,
                                     enum modal_status (*chunk)(void *context,
                                                                const struct chunk_record *),
                                     void *context, struct modal_error *err);
/* The segments of a stream from OFFSET of its file on, by ascending offset. */
enum modal_status ledger_read_segments(struct ledger_reader *reader, int64_t stream,
                                       uint64_t offset,
                                       enum modal_status (*segment)(void *context,
                                                                    const struct segment_record *),
                                       void *context, struct modal_error *err);
/* All rows, as ledger_load. */
enum modal_status ledger_reader_load(struct ledger_reader *reader,
                                     const struct ledger_visitor *visitor, struct modal_error *err);

/*
 * Make RECORD of a result's TEXT, by a spool thread, before its change is committed: small text
 * stays in the record (borrowed), large text is written durably to DIR/results/JOB.json.  `input`
 * and `settings` are the caller's to fill.
 */
enum modal_status ledger_result_put(const char *dir, int64_t job, const char *text, size_t length,
                                    struct result_record *record, struct modal_error *err);
/* Remove results/JOB.json, where there is one. */
enum modal_status ledger_result_remove(const char *dir, int64_t job, struct modal_error *err);

#endif
