/*
 * ledger.c - taking a data folder, applying groups of changes; see ledger.h
 *
 * A group is one transaction.  Within it a change that cannot be applied (a key taken, a move that
 * is none) is reported in its own status and has no effect; an error of the disk takes back the
 * whole group.  After a failed sync, or an error that leaves the state of the files unknown, the
 * ledger is broken: it refuses everything, so that nothing is acknowledged that a later sync only
 * seems to cover.
 */
#include "store/ledger.h"
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "store/file.h"
#include "store/folder.h"
#include "store/ledger_db.h"
#include "store/samples.h"
#include "store/spool.h"
#include "store/tape.h"

enum { BEHIND_DIR = 64 };    /* bytes of the longest name below the data folder, and more */

const char *const job_states[JOB_STATE_COUNT] = { "queued", "running",   "done",
                                                  "failed", "cancelled", "dead" };

/* A lost worker, or a drain, puts a running job back; `retry` puts a failed or dead one back; a job
 * found cached, expired in the queue or cancelled there is final without having run.  A move to the
 * same state updates the rest of the row. */
const bool ledger_moves[JOB_STATE_COUNT][JOB_STATE_COUNT] = {
    [JOB_QUEUED]  = { [JOB_QUEUED] = true, [JOB_RUNNING] = true, [JOB_DONE] = true,
                      [JOB_FAILED] = true, [JOB_CANCELLED] = true, [JOB_DEAD] = true },
    [JOB_RUNNING] = { [JOB_QUEUED] = true, [JOB_RUNNING] = true, [JOB_DONE] = true,
                      [JOB_FAILED] = true, [JOB_CANCELLED] = true, [JOB_DEAD] = true },
    [JOB_FAILED]  = { [JOB_QUEUED] = true },
    [JOB_DEAD]    = { [JOB_QUEUED] = true },
};

bool job_state_final(enum job_state state)
{
    return state != JOB_QUEUED && state != JOB_RUNNING;
}

/* --- statements --- */

struct binder { sqlite3_stmt *statement; int next; };

static void bind_int(struct binder *to, int64_t value)
{
    sqlite3_bind_int64(to->statement, to->next++, value);
}

static void bind_real(struct binder *to, double value)
{
    sqlite3_bind_double(to->statement, to->next++, value);
}

static void bind_text(struct binder *to, const char *text)
{
    if (text != NULL)
        sqlite3_bind_text(to->statement, to->next, text, -1, SQLITE_STATIC);
    to->next++;
}

static void bind_blob(struct binder *to, const void *data, size_t length)
{
    if (data != NULL)
        sqlite3_bind_blob64(to->statement, to->next, length > 0 ? data : "", length, SQLITE_STATIC);
    to->next++;
}

static enum modal_status bind_input(struct binder *to, const struct ledger_change *change,
                                    struct modal_error *err)
{
    const struct input_record *input = &change->input;
    const struct input_shape *shape = &input->shape;
    char *names = NULL;
    enum modal_status rc = ledger_names_text(shape, &names, err);

    if (rc != MODAL_OK)
        return rc;
    bind_int(to, input->id);
    bind_text(to, input->user);
    bind_int(to, input->state);
    bind_int(to, shape->type);
    bind_int(to, (int64_t)shape->samples);
    bind_int(to, (int64_t)shape->channels);
    bind_int(to, (int64_t)shape->length);
    bind_real(to, shape->dt);
    bind_real(to, shape->period);
    bind_text(to, shape->units);
    sqlite3_bind_text(to->statement, to->next++, names, -1, SQLITE_TRANSIENT);
    bind_text(to, shape->attributes);
    bind_blob(to, input->sha256, 32);
    bind_int(to, input->crc);
    bind_int(to, input->inline_data);
    bind_int(to, (int64_t)input->offset);
    bind_int(to, input->created_ns);
    bind_int(to, input->used_ns);
    bind_blob(to, input->inline_data ? input->data : NULL, input_bytes(shape));
    free(names);
    return MODAL_OK;
}

static enum modal_status bind_used(struct binder *to, const struct ledger_change *change,
                                   struct modal_error *err)
{
    (void)err;
    bind_int(to, change->input.id);
    bind_int(to, change->input.used_ns);
    return MODAL_OK;
}

static enum modal_status bind_id(struct binder *to, const struct ledger_change *change,
                                 struct modal_error *err)
{
    (void)err;
    bind_int(to, change->id);
    return MODAL_OK;
}

static enum modal_status bind_chunk(struct binder *to, const struct ledger_change *change,
                                    struct modal_error *err)
{
    (void)err;
    bind_int(to, change->input_id);
    bind_int(to, (int64_t)change->chunk.offset);
    bind_int(to, (int64_t)change->chunk.length);
    bind_int(to, change->chunk.crc);
    return MODAL_OK;
}

static enum modal_status bind_segment(struct binder *to, const struct ledger_change *change,
                                      struct modal_error *err)
{
    const struct segment_record *segment = &change->segment;

    (void)err;
    bind_int(to, segment->stream);
    bind_int(to, (int64_t)segment->offset);
    bind_int(to, (int64_t)segment->epoch);
    bind_int(to, (int64_t)segment->first);
    bind_int(to, (int64_t)segment->count);
    bind_int(to, (int64_t)segment->length);
    bind_int(to, segment->crc);
    return MODAL_OK;
}

/* What a move changes, in the order of the columns from `state` on. */
static void bind_progress(struct binder *to, const struct job_record *job)
{
    bind_int(to, job->state);
    bind_int(to, job->attempts);
    bind_int(to, job->crashes);
    bind_int(to, job->submitted_ns);
    bind_int(to, job->started_ns);
    bind_int(to, job->finished_ns);
    bind_int(to, job->cpu_ns);
    bind_text(to, job->error_code);
    bind_text(to, job->error_message);
    bind_text(to, job->error_field);
    bind_text(to, job->error_detail);
    bind_int(to, (int64_t)job->result_bytes);
    bind_int(to, job->output);
    bind_int(to, job->cached);
    bind_text(to, job->stderr_text);
}

static enum modal_status bind_job(struct binder *to, const struct ledger_change *change,
                                  struct modal_error *err)
{
    const struct job_record *job = &change->job;

    (void)err;
    bind_int(to, job->id);
    bind_text(to, job->user);
    bind_text(to, job->key);
    bind_text(to, job->kind);
    bind_text(to, job->options);
    bind_int(to, job->input);
    bind_blob(to, job->fingerprint, 32);
    bind_int(to, job->priority);
    bind_int(to, job->run_limit_ns);
    bind_int(to, job->deadline_ns);
    bind_int(to, job->not_before_ns);
    bind_text(to, job->tag);
    bind_progress(to, job);
    return MODAL_OK;
}

/* The states JOB may come from, as bits. */
static int64_t sources(enum job_state to)
{
    int64_t bits = 0;

    for (int from = 0; from < JOB_STATE_COUNT; from++)
        if (ledger_moves[from][to])
            bits |= (int64_t)1 << from;
    return bits;
}

static enum modal_status bind_move(struct binder *to, const struct ledger_change *change,
                                   struct modal_error *err)
{
    const struct job_record *job = &change->job;

    if (job->state < 0 || job->state >= JOB_STATE_COUNT)
        return modal_fail(err, MODAL_INTERNAL, "ledger: job %lld has no state %d",
                          (long long)job->id, (int)job->state);
    bind_int(to, job->id);
    bind_int(to, sources(job->state));
    bind_progress(to, job);
    return MODAL_OK;
}

static enum modal_status bind_limits(struct binder *to, const struct ledger_change *change,
                                     struct modal_error *err)
{
    const struct job_record *job = &change->job;

    (void)err;
    bind_int(to, job->id);
    bind_int(to, job->priority);
    bind_int(to, job->run_limit_ns);
    bind_int(to, job->deadline_ns);
    bind_int(to, job->not_before_ns);
    bind_text(to, job->tag);
    return MODAL_OK;
}

static enum modal_status bind_result(struct binder *to, const struct ledger_change *change,
                                     struct modal_error *err)
{
    const struct result_record *result = &change->result;

    (void)err;
    bind_int(to, result->job);
    bind_int(to, (int64_t)result->length);
    bind_int(to, result->crc);
    bind_blob(to, result->input, 32);
    bind_blob(to, result->settings, 32);
    bind_blob(to, result->text, result->length);
    return MODAL_OK;
}

static enum modal_status bind_tombstone(struct binder *to, const struct ledger_change *change,
                                        struct modal_error *err)
{
    const struct tombstone_record *tombstone = &change->tombstone;

    (void)err;
    bind_text(to, tombstone->user);
    bind_text(to, tombstone->key);
    bind_int(to, tombstone->job);
    bind_blob(to, tombstone->fingerprint, 32);
    bind_int(to, tombstone->expired_ns);
    return MODAL_OK;
}

static enum modal_status bind_event(struct binder *to, const struct ledger_change *change,
                                    struct modal_error *err)
{
    const struct event_record *event = &change->event;

    (void)err;
    bind_int(to, event->number);
    bind_int(to, event->ns);
    bind_int(to, event->job);
    bind_text(to, event->user);
    bind_text(to, event->topic);
    bind_text(to, event->text);
    return MODAL_OK;
}

static enum modal_status bind_note(struct binder *to, const struct ledger_change *change,
                                   struct modal_error *err)
{
    (void)err;
    bind_text(to, change->note.topic);
    bind_text(to, change->note.name);
    bind_text(to, change->note.text);
    return MODAL_OK;
}

enum {
    SQL_MOST     = 2,        /* statements of a verb */
    LOG_PAGES_MOST = 4 * LEDGER_CHECKPOINT_PAGES,   /* 16 MB, which ledger_settle had not come to */
    VACUUM_PAGES = 512,      /* 2 MB moved at once, which is what a commit may have to wait for */
    UNUSED_LEAST = 64,       /* pages: fewer are not worth a commit, and are soon used again */
    UNUSED_PART  = 10,       /* nor is less than one in so many of the database */
};

/* Each verb's statements; each is bound alike.  `must`: the last one must change a row; `frees`: it
 * makes free pages. */
static const struct {
    const char *sql[SQL_MOST];
    enum modal_status (*bind)(struct binder *, const struct ledger_change *, struct modal_error *);
    bool must, frees;
} verbs[LEDGER_VERB_COUNT] = {
    [LEDGER_INPUT_PUT] = {
        { "INSERT OR REPLACE INTO inputs VALUES(?1,?2,?3,?4,?5,?6,?7,?8,?9,?10,?11,?12,?13,?14,?15,"
          "?16,?17,?18,?19)" }, bind_input, true },
    [LEDGER_INPUT_USED] = { { "UPDATE inputs SET used=?2 WHERE id=?1" }, bind_used, true },
    [LEDGER_INPUT_DELETE] = {
        { "DELETE FROM chunks WHERE input=?1",
          "DELETE FROM inputs WHERE id=?1" }, bind_id, true, true },
    [LEDGER_CHUNK_PUT] = {
        { "INSERT OR REPLACE INTO chunks VALUES(?1,?2,?3,?4)" }, bind_chunk, true },
    [LEDGER_SEGMENT_PUT] = {
        { "INSERT INTO segments VALUES(?1,?2,?3,?4,?5,?6,?7)" }, bind_segment, true },
    [LEDGER_SEGMENT_ROW] = {
        { "INSERT OR IGNORE INTO segments SELECT ?1,?2,?3,?4,?5,?6,?7 WHERE EXISTS"
          " (SELECT 1 FROM notes WHERE topic='stream' AND name=CAST(?1 AS TEXT))" },
        bind_segment, false },
    [LEDGER_SAMPLES_SETTLE] = { { NULL }, NULL, false },
    [LEDGER_SEGMENTS_DELETE] = { { "DELETE FROM segments WHERE stream=?1" }, bind_id, false, true },
    [LEDGER_JOB_PUT] = {
        { "INSERT INTO jobs VALUES(?1,?2,?3,?4,?5,?6,?7,?8,?9,?10,?11,?12,?13,?14,?15,?16,?17,?18,"
          "?19,?20,?21,?22,?23,?24,?25,?26,?27)" }, bind_job, true },
    [LEDGER_JOB_MOVE] = {
        { "UPDATE jobs SET state=?3, attempts=?4, crashes=?5, submitted=?6, started=?7,"
          " finished=?8, cpu=?9, error_code=?10, error_message=?11, error_field=?12,"
          " error_detail=?13, result_bytes=?14, output=?15, cached=?16, stderr=?17"
          " WHERE id=?1 AND (1 << state) & ?2" }, bind_move, true },
    [LEDGER_JOB_LIMITS] = {
        { "UPDATE jobs SET priority=?2, run_limit=?3, deadline=?4, not_before=?5, tag=?6"
          " WHERE id=?1" }, bind_limits, true },
    [LEDGER_JOB_DELETE] = {
        { "DELETE FROM results WHERE job=?1",
          "DELETE FROM jobs WHERE id=?1" }, bind_id, true, true },
    [LEDGER_RESULT_PUT] = {
        { "INSERT OR REPLACE INTO results VALUES(?1,?2,?3,?4,?5,?6)" }, bind_result, true },
    [LEDGER_TOMBSTONE_PUT] = {
        { "INSERT OR REPLACE INTO tombstones VALUES(?1,?2,?3,?4,?5)" }, bind_tombstone, true },
    [LEDGER_TOMBSTONES_PRUNE] = {
        { "DELETE FROM tombstones WHERE expired<?1" }, bind_id, false, true },
    [LEDGER_EVENT_PUT] = { { "INSERT INTO events VALUES(?1,?2,?3,?4,?5,?6)" }, bind_event, true },
    [LEDGER_EVENTS_PRUNE] = { { "DELETE FROM events WHERE number<?1" }, bind_id, false, true },
    [LEDGER_NOTE_PUT] = {
        { "DELETE FROM notes WHERE topic=?1 AND name=?2",
          "INSERT INTO notes SELECT ?1,?2,?3 WHERE ?3 IS NOT NULL" }, bind_note, false },
};

struct ledger {
    char dir[4096], store[33];
    int lock, socket;          /* flock on LOCK; the abstract socket named by the store id */
    sqlite3 *db;
    sqlite3_stmt *statements[LEDGER_VERB_COUNT][SQL_MOST];
    sqlite3_stmt *begin, *commit, *known;
    struct ledger_mark *mark;
    struct tape tape;
    int group_pages;           /* as log_pages, 0 before a group and where it wrote nothing */
    int log_pages;             /* of the write-ahead log after the last commit */
    bool deleted;              /* rows, since free pages were counted */
    bool broken;
};

/* --- opening --- */

static int log_grew(void *context, sqlite3 *db, const char *name, int pages)
{
    (void)db;
    (void)name;
    ((struct ledger *)context)->log_pages = ((struct ledger *)context)->group_pages = pages;
    return SQLITE_OK;
}

static enum modal_status prepare(struct ledger *ledger, struct modal_error *err)
{
    const struct { sqlite3_stmt **statement; const char *sql; } own[] = {
        { &ledger->begin, "BEGIN IMMEDIATE" },
        { &ledger->commit, "COMMIT" },
        { &ledger->known, "SELECT 1 FROM jobs WHERE id=?1" },
    };
    int code = SQLITE_OK;

    for (int v = 0; v < LEDGER_VERB_COUNT; v++)
        for (int i = 0; code == SQLITE_OK && i < SQL_MOST && verbs[v].sql[i] != NULL; i++)
            code = sqlite3_prepare_v3(ledger->db, verbs[v].sql[i], -1, SQLITE_PREPARE_PERSISTENT,
                                      &ledger->statements[v][i], NULL);
    for (size_t i = 0; code == SQLITE_OK && i < sizeof own / sizeof *own; i++)
        code = sqlite3_prepare_v3(ledger->db, own[i].sql, -1, SQLITE_PREPARE_PERSISTENT,
                                  own[i].statement, NULL);
    if (code != SQLITE_OK)
        return ledger_db_fail(ledger->db, code, "preparing statements", err);
    sqlite3_wal_hook(ledger->db, log_grew, ledger);
    return MODAL_OK;
}

static enum modal_status open_tape(struct ledger *ledger, struct modal_error *err);

enum modal_status ledger_open(const char *dir, struct ledger **out, struct modal_error *err)
{
    struct ledger *ledger = calloc(1, sizeof *ledger);
    enum modal_status rc;

    if (ledger == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for a ledger");
    ledger->lock = ledger->socket = ledger->tape.fd = -1;
    ledger->deleted = true;
    if (strlen(dir) >= sizeof ledger->dir - BEHIND_DIR) {
        rc = modal_fail(err, MODAL_TOO_LARGE,
                        "the path of the data folder is longer than %zu bytes",
                        sizeof ledger->dir - 64);
        goto out;
    }
    strcpy(ledger->dir, dir);
    if ((rc = folder_make(dir, err)) != MODAL_OK
        || (rc = folder_lock(dir, &ledger->lock, err)) != MODAL_OK
        || (rc = ledger_db_open(dir, true, &ledger->db, err)) != MODAL_OK
        || (rc = ledger_db_store(ledger->db, ledger->store, err)) != MODAL_OK
        || (rc = folder_bind(dir, ledger->store, &ledger->socket, err)) != MODAL_OK
        || (rc = prepare(ledger, err)) != MODAL_OK
        || (rc = open_tape(ledger, err)) != MODAL_OK)
        goto out;
    ledger->mark = ledger_mark_open(dir);
    *out = ledger;
    ledger = NULL;
out:
    ledger_close(ledger);
    return rc;
}

void ledger_close(struct ledger *ledger)
{
    if (ledger == NULL)
        return;
    for (int v = 0; v < LEDGER_VERB_COUNT; v++)
        for (int i = 0; i < SQL_MOST; i++)
            sqlite3_finalize(ledger->statements[v][i]);
    sqlite3_finalize(ledger->begin);
    sqlite3_finalize(ledger->commit);
    sqlite3_finalize(ledger->known);
    sqlite3_close(ledger->db);
    ledger_mark_close(ledger->mark);
    tape_close(&ledger->tape);
    if (ledger->socket >= 0)
        close(ledger->socket);
    if (ledger->lock >= 0)
        close(ledger->lock);
    free(ledger);
}

const char *ledger_store_id(const struct ledger *ledger)
{
    return ledger->store;
}

/* --- groups --- */

static int step(sqlite3_stmt *statement)
{
    int code = sqlite3_step(statement);

    sqlite3_reset(statement);
    return code == SQLITE_DONE || code == SQLITE_ROW ? SQLITE_OK : code;
}

/* No row was changed: is there no such row, or was the change not allowed? */
static enum modal_status refused(struct ledger *ledger, const struct ledger_change *change)
{
    int code;

    if (change->verb != LEDGER_JOB_MOVE)
        return MODAL_NOT_FOUND;
    sqlite3_bind_int64(ledger->known, 1, change->job.id);
    code = sqlite3_step(ledger->known);
    sqlite3_reset(ledger->known);
    return code == SQLITE_ROW ? MODAL_CONFLICT : MODAL_NOT_FOUND;
}

/* Short samples: they are on the tape, and have no row yet. */
static bool is_taped(const struct ledger_change *change)
{
    return change->verb == LEDGER_SEGMENT_PUT && change->segment.length <= TAPE_SEGMENT_MOST;
}

/* Apply one change.  What is wrong with it alone goes into its status; what is wrong with the disk
 * is returned. */
static enum modal_status apply(struct ledger *ledger, struct ledger_change *change,
                               struct modal_error *err)
{
    enum modal_status rc;
    int code = SQLITE_OK;

    for (int i = 0; i < SQL_MOST && verbs[change->verb].sql[i] != NULL; i++) {
        struct binder binder = { ledger->statements[change->verb][i], 1 };
        change->status = verbs[change->verb].bind(&binder, change, err);
        if (change->status == MODAL_OK)
            code = step(binder.statement);
        sqlite3_clear_bindings(binder.statement);
        if (change->status != MODAL_OK)
            return change->status == MODAL_NO_MEMORY ? MODAL_NO_MEMORY : MODAL_OK;
        if (code != SQLITE_OK)
            break;
    }
    if (code == SQLITE_OK && verbs[change->verb].must && sqlite3_changes(ledger->db) == 0)
        change->status = refused(ledger, change);
    if (code == SQLITE_OK)
        return MODAL_OK;
    rc = ledger_db_fail(ledger->db, code, "a change", err);
    if (rc != MODAL_CONFLICT && rc != MODAL_TOO_LARGE)
        return rc;
    change->status = rc;
    return MODAL_OK;
}

static bool has_rows(const struct ledger_change *change)
{
    return verbs[change->verb].bind != NULL && !is_taped(change);
}

static enum modal_status apply_all(struct ledger *ledger, struct ledger_change *changes,
                                   size_t count, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    size_t rows = 0;
    int code;

    for (size_t i = 0; i < count; i++) {
        changes[i].status = MODAL_OK;
        rows += has_rows(&changes[i]);
    }
    if (rows == 0)
        return MODAL_OK;
    code = step(ledger->begin);
    if (code != SQLITE_OK)
        return ledger_db_fail(ledger->db, code, "beginning a group", err);
    for (size_t i = 0; rc == MODAL_OK && i < count; i++)
        if (has_rows(&changes[i]))
            rc = apply(ledger, &changes[i], err);
    if (rc == MODAL_OK && (code = step(ledger->commit)) != SQLITE_OK)
        rc = ledger_db_fail(ledger->db, code, "committing a group", err);
    return rc;
}

/* The samples of a group, on stable storage before any row that speaks of them. */
static enum modal_status put_samples(struct ledger *ledger, struct samples_files *files,
                                     const struct ledger_change *changes, size_t count,
                                     struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; rc == MODAL_OK && i < count; i++)
        if (is_taped(&changes[i]))
            rc = tape_add(&ledger->tape, &changes[i].segment, err);
        else if (changes[i].verb == LEDGER_SEGMENT_PUT)
            rc = samples_put(files, &changes[i].segment, err);
    if (rc == MODAL_OK)
        rc = tape_write(&ledger->tape, err);
    return rc == MODAL_OK ? samples_sync(files, err) : rc;
}

/* After these the files are as they were before, and the next group may pass. */
static bool survivable(enum modal_status rc)
{
    return rc == MODAL_OK || rc == MODAL_STORAGE_FULL || rc == MODAL_NO_MEMORY || rc == MODAL_BUSY;
}

/* HOW: SQLITE_CHECKPOINT_PASSIVE, or _TRUNCATE, which syncs the database before it empties the log.
 * *DONE: no reader was in the way. */
static enum modal_status checkpoint_as(struct ledger *ledger, int how, bool *done,
                                       struct modal_error *err)
{
    enum modal_status rc;
    int left = 0, code = sqlite3_wal_checkpoint_v2(ledger->db, NULL, how, NULL, &left);

    *done = code != SQLITE_BUSY;
    if (code == SQLITE_OK || code == SQLITE_BUSY) {
        ledger->log_pages = 0;
        return MODAL_OK;
    }
    rc = ledger_db_fail(ledger->db, code, "moving the log to the database", err);
    ledger->broken = !survivable(rc);
    return rc == MODAL_STORAGE_FULL ? MODAL_OK : rc;     /* the log stays; tried again later */
}

static enum modal_status checkpoint(struct ledger *ledger, struct modal_error *err)
{
    bool done;

    return checkpoint_as(ledger, SQLITE_CHECKPOINT_PASSIVE, &done, err);
}

static enum modal_status refuse_broken(struct modal_error *err)
{
    return modal_fail(err, MODAL_IO,
                      "ledger: an earlier write or sync failed; nothing more is taken until the "
                      "daemon is started again");
}

/* What has failed: the group is taken back. */
static enum modal_status take_back(struct ledger *ledger, enum modal_status rc, uint64_t tape_end)
{
    if (!sqlite3_get_autocommit(ledger->db))
        sqlite3_exec(ledger->db, "ROLLBACK", NULL, NULL, NULL);
    ledger->broken = !survivable(rc) || tape_revert(&ledger->tape, tape_end, NULL) != MODAL_OK;
    return rc;
}

/* CHANGES, which may have samples, without what follows. */
static enum modal_status put_group(struct ledger *ledger, struct ledger_change *changes,
                                   size_t count, struct modal_error *err)
{
    struct samples_files files = { .dir = ledger->dir };
    const uint64_t tape_end = ledger->tape.end;
    enum modal_status rc = put_samples(ledger, &files, changes, count, err);

    if (rc == MODAL_OK)
        rc = apply_all(ledger, changes, count, err);
    if (rc == MODAL_STORAGE_FULL)
        samples_revert(&files);
    samples_close(&files);
    return rc == MODAL_OK ? rc : take_back(ledger, rc, tape_end);
}

/* All that is on the tape to files and rows. */
static enum modal_status settle_tape(struct ledger *ledger, struct modal_error *err)
{
    struct samples_files files = { .dir = ledger->dir };
    struct tape_pieces pieces = { NULL, 0, NULL };
    enum modal_status rc;

    if (ledger->tape.end == ledger->tape.start)
        return MODAL_OK;
    rc = tape_read(&ledger->tape, &pieces, err);
    for (size_t i = 0; rc == MODAL_OK && i < pieces.count; i++)
        rc = samples_put(&files, &pieces.changes[i].segment, err);
    if (rc == MODAL_OK)
        rc = samples_sync(&files, err);
    samples_close(&files);
    if (rc == MODAL_OK)
        rc = apply_all(ledger, pieces.changes, pieces.count, err);
    tape_pieces_done(&pieces);
    if (rc != MODAL_OK)
        return take_back(ledger, rc, ledger->tape.end);
    rc = tape_clear(&ledger->tape, err);
    ledger->broken = rc != MODAL_OK;
    return rc;
}

static enum modal_status settle_found(struct ledger *ledger, struct modal_error *err)
{
    enum modal_status rc = tape_open(&ledger->tape, ledger->dir, err);

    return rc == MODAL_OK ? settle_tape(ledger, err) : rc;
}

/* What the last process left on the tape; on a full disk in the room of the reserve. */
static enum modal_status open_tape(struct ledger *ledger, struct modal_error *err)
{
    enum modal_status rc = settle_found(ledger, err);

    if (rc != MODAL_STORAGE_FULL || (rc = reserve_release(ledger->dir, err)) != MODAL_OK)
        return rc;
    tape_close(&ledger->tape);
    ledger->broken = false;
    return settle_found(ledger, err);
}

static bool wants_settled(const struct ledger_change *changes, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (changes[i].verb == LEDGER_SAMPLES_SETTLE)
            return true;
    return false;
}

enum modal_status ledger_commit(struct ledger *ledger, struct ledger_change *changes, size_t count,
                                struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (ledger->broken)
        return refuse_broken(err);
    if (ledger->log_pages > LOG_PAGES_MOST)
        rc = checkpoint(ledger, err);
    if (rc == MODAL_OK && wants_settled(changes, count))
        rc = settle_tape(ledger, err);
    if (rc != MODAL_OK)
        return rc;
    ledger->group_pages = 0;
    rc = put_group(ledger, changes, count, err);
    for (size_t i = 0; i < count; i++)
        ledger->deleted |= verbs[changes[i].verb].frees;
    if (rc == MODAL_OK && ledger->group_pages > 0)
        ledger_mark_put(ledger->mark, ledger->group_pages);
    return rc;
}

enum modal_status ledger_checkpoint(struct ledger *ledger, struct modal_error *err)
{
    return ledger->broken ? refuse_broken(err) : checkpoint(ledger, err);
}

enum modal_status ledger_load(struct ledger *ledger, const struct ledger_visitor *visitor,
                              struct modal_error *err)
{
    return ledger_db_load(ledger->db, visitor, err);
}

static enum modal_status count_pages(struct ledger *ledger, const char *pragma, int64_t *out,
                                     struct modal_error *err)
{
    sqlite3_stmt *row = NULL;
    int code = sqlite3_prepare_v2(ledger->db, pragma, -1, &row, NULL);

    if (code == SQLITE_OK)
        code = sqlite3_step(row);
    if (code == SQLITE_ROW)
        *out = sqlite3_column_int64(row, 0);
    sqlite3_finalize(row);
    return code == SQLITE_ROW ? MODAL_OK : ledger_db_fail(ledger->db, code, pragma, err);
}

enum modal_status ledger_vacuum(struct ledger *ledger, int most_pages, int64_t *left,
                                struct modal_error *err)
{
    char sql[64];
    enum modal_status rc;

    if (ledger->broken)
        return refuse_broken(err);
    snprintf(sql, sizeof sql, "PRAGMA incremental_vacuum(%d)", most_pages);
    rc = ledger_db_run(ledger->db, sql, err);
    if (rc == MODAL_OK)
        rc = checkpoint(ledger, err);
    if (rc == MODAL_OK)
        rc = count_pages(ledger, "PRAGMA freelist_count", left, err);
    if (!survivable(rc))
        ledger->broken = true;
    return rc;
}

enum modal_status ledger_settle(struct ledger *ledger, bool *more, struct modal_error *err)
{
    int64_t unused = 0, pages = 0;
    enum modal_status rc = MODAL_OK;

    if (more != NULL)
        *more = false;
    if (ledger->broken)
        return refuse_broken(err);
    if (ledger->tape.end > TAPE_MOST)
        rc = settle_tape(ledger, err);
    if (rc == MODAL_STORAGE_FULL)
        rc = MODAL_OK;                         /* they stay on the tape; tried again later */
    if (rc == MODAL_OK && ledger->log_pages > LEDGER_CHECKPOINT_PAGES)
        rc = checkpoint(ledger, err);
    if (rc != MODAL_OK || !ledger->deleted)
        return rc;
    rc = count_pages(ledger, "PRAGMA freelist_count", &unused, err);
    if (rc == MODAL_OK)
        rc = count_pages(ledger, "PRAGMA page_count", &pages, err);
    ledger->deleted = rc == MODAL_OK && unused > UNUSED_LEAST && unused > pages / UNUSED_PART;
    if (ledger->deleted)
        rc = ledger_vacuum(ledger, VACUUM_PAGES, &unused, err);
    if (rc != MODAL_OK)
        ledger->deleted = false;               /* not now */
    if (more != NULL)
        *more = ledger->deleted;
    return rc == MODAL_STORAGE_FULL ? MODAL_OK : rc;
}

enum modal_status ledger_idle(struct ledger *ledger, bool *more, struct modal_error *err)
{
    int64_t unused = 0, left = 0;
    bool done = true;
    enum modal_status rc;

    *more = false;
    if (ledger->broken)
        return refuse_broken(err);
    rc = settle_tape(ledger, err);
    if (rc == MODAL_OK)
        rc = count_pages(ledger, "PRAGMA freelist_count", &unused, err);
    if (rc == MODAL_OK && unused > 0)
        rc = ledger_vacuum(ledger, VACUUM_PAGES, &left, err);
    if (rc == MODAL_OK && (*more = left > 0 && left < unused))
        return rc;
    /* a reader is not waited for: somebody may ask something */
    sqlite3_busy_timeout(ledger->db, 0);
    if (rc == MODAL_OK)
        rc = checkpoint_as(ledger, SQLITE_CHECKPOINT_TRUNCATE, &done, err);
    sqlite3_busy_timeout(ledger->db, LEDGER_BUSY_MS);
    sqlite3_db_release_memory(ledger->db);
    *more = !done;
    return rc == MODAL_STORAGE_FULL ? MODAL_OK : rc;
}
