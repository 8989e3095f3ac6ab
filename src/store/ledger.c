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
#include "store/ledger_verbs.h"
#include "store/samples.h"
#include "store/spool.h"
#include "store/tape.h"

enum { BEHIND_DIR = 64 };    /* bytes of the longest name below the data folder, and more */

enum {
    LOG_PAGES_MOST = 4 * LEDGER_CHECKPOINT_PAGES,   /* 16 MB, which ledger_settle had not come to */
    VACUUM_PAGES = 512,      /* 2 MB moved at once, which is what a commit may have to wait for */
    UNUSED_LEAST = 64,       /* pages: fewer are not worth a commit, and are soon used again */
    UNUSED_PART  = 10,       /* nor is less than one in so many of the database */
#if MODALD_FAULTS
    SLICE_STREAMS = 1,       /* so that a few streams make several slices */
#else
    SLICE_STREAMS = SAMPLES_FILES,       /* synced at once, which a commit may have to wait for */
#endif
};

struct ledger {
    char dir[4096], store[33];
    int lock, socket;          /* flock on LOCK; the abstract socket named by the store id */
    sqlite3 *db;
    sqlite3_stmt *statements[LEDGER_VERB_COUNT][LEDGER_SQL_MOST];
    sqlite3_stmt *begin, *commit, *known, *open, *row_before;
    struct ledger_mark *mark;
    struct tape tape;
    struct tape_pieces pieces;           /* that go to their files; none: `changes` is NULL */
    size_t next_piece;                   /* those before it are there, and have rows */
    uint64_t pieces_end;                 /* they are all that the tape has before it */
    uint64_t asked_end;                  /* the tape's, when streams were last asked for */
    int log_pages;             /* of the write-ahead log after the last commit */
    bool cut;                  /* the log has not what it had: see ledger_mark_put */
    bool deleted;              /* rows, since free pages were counted */
    bool broken;
};

/* --- opening --- */

/* After each commit, which is synced. */
static int log_grew(void *context, sqlite3 *db, const char *name, int pages)
{
    struct ledger *ledger = context;

    (void)db;
    (void)name;
    ledger->log_pages = pages;
    ledger->cut |= !ledger_mark_put(ledger->mark, pages);
    return SQLITE_OK;
}

static enum modal_status prepare(struct ledger *ledger, struct modal_error *err)
{
    const struct { sqlite3_stmt **statement; const char *sql; } own[] = {
        { &ledger->begin, "BEGIN IMMEDIATE" },
        { &ledger->commit, "COMMIT" },
        { &ledger->known, "SELECT 1 FROM jobs WHERE id=?1" },
        { &ledger->open, "SELECT 1 FROM notes WHERE topic='stream' AND name=CAST(?1 AS TEXT)" },
        { &ledger->row_before, "SELECT offset + length FROM segments WHERE stream=?1 AND offset<=?2"
                               " ORDER BY offset DESC LIMIT 1" },
    };
    int code = SQLITE_OK;

    for (int v = 0; v < LEDGER_VERB_COUNT; v++) {
        const char *const *sql = ledger_verbs[v].sql;
        for (int i = 0; code == SQLITE_OK && i < LEDGER_SQL_MOST && sql[i] != NULL; i++)
            code = sqlite3_prepare_v3(ledger->db, sql[i], -1, SQLITE_PREPARE_PERSISTENT,
                                      &ledger->statements[v][i], NULL);
    }
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
        || (rc = folder_bind(dir, ledger->store, &ledger->socket, err)) != MODAL_OK)
        goto out;
    ledger->mark = ledger_mark_open(dir);
    if ((rc = prepare(ledger, err)) != MODAL_OK || (rc = open_tape(ledger, err)) != MODAL_OK)
        goto out;
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
        for (int i = 0; i < LEDGER_SQL_MOST; i++)
            sqlite3_finalize(ledger->statements[v][i]);
    sqlite3_finalize(ledger->begin);
    sqlite3_finalize(ledger->commit);
    sqlite3_finalize(ledger->known);
    sqlite3_finalize(ledger->open);
    sqlite3_finalize(ledger->row_before);
    tape_pieces_done(&ledger->pieces);
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

    for (int i = 0; i < LEDGER_SQL_MOST && ledger_verbs[change->verb].sql[i] != NULL; i++) {
        struct ledger_binder binder = { ledger->statements[change->verb][i], 1 };
        change->status = ledger_verbs[change->verb].bind(&binder, change, err);
        if (change->status == MODAL_OK)
            code = step(binder.statement);
        sqlite3_clear_bindings(binder.statement);
        if (change->status != MODAL_OK)
            return change->status == MODAL_NO_MEMORY ? MODAL_NO_MEMORY : MODAL_OK;
        if (code != SQLITE_OK)
            break;
    }
    if (code == SQLITE_OK && ledger_verbs[change->verb].must && sqlite3_changes(ledger->db) == 0)
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
    return ledger_verbs[change->verb].bind != NULL && !is_taped(change);
}

/* MODAL_CORRUPT: the log has not what it had. */
static enum modal_status check_log(struct ledger *ledger, struct modal_error *err)
{
    ledger->cut |= !ledger_mark_holds(ledger->mark);
    if (!ledger->cut)
        return MODAL_OK;
    ledger->broken = true;
    return modal_fail(err, MODAL_CORRUPT,
                      "%s/ledger.db-wal was made shorter, or written over, by another program "
                      "while the daemon ran: groups that were acknowledged are lost with it; "
                      "restore the folder from a backup", ledger->dir);
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
    return rc == MODAL_OK && ledger->cut ? check_log(ledger, err) : rc;
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
    /* what is not there would go to the database as pages of zeros */
    enum modal_status rc = check_log(ledger, err);
    int left = 0, code;

    *done = true;
    if (rc != MODAL_OK)
        return rc;
    code = sqlite3_wal_checkpoint_v2(ledger->db, NULL, how, NULL, &left);
    *done = code != SQLITE_BUSY;
    if (code == SQLITE_OK && how == SQLITE_CHECKPOINT_TRUNCATE)
        ledger_mark_emptied(ledger->mark);
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

/* The log is empty afterwards, if its mark can be ended before; *DONE as above. */
static enum modal_status empty_log(struct ledger *ledger, bool *done, struct modal_error *err)
{
    bool ended = false;
    enum modal_status rc = check_log(ledger, err);

    *done = true;
    if (rc == MODAL_OK)
        rc = ledger_mark_end(ledger->mark, &ended, err);
    ledger->broken |= rc != MODAL_OK;
    return rc != MODAL_OK ? rc
                          : checkpoint_as(ledger, ended ? SQLITE_CHECKPOINT_TRUNCATE
                                                        : SQLITE_CHECKPOINT_PASSIVE, done, err);
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

/* ---- from the tape ---- */

static void forget_pieces(struct ledger *ledger)
{
    tape_pieces_done(&ledger->pieces);
    ledger->pieces = (struct tape_pieces) { NULL, 0, NULL };
}

/* *OPEN: STREAM is, as its note is there. */
static enum modal_status find_stream(struct ledger *ledger, int64_t stream, bool *open,
                                     struct modal_error *err)
{
    int code;

    sqlite3_bind_int64(ledger->open, 1, stream);
    code = sqlite3_step(ledger->open);
    *open = code == SQLITE_ROW;
    sqlite3_reset(ledger->open);
    return code == SQLITE_ROW || code == SQLITE_DONE
               ? MODAL_OK : ledger_db_fail(ledger->db, code, "looking for a stream", err);
}

/* *END: of the row that has the first samples of PIECE; their own offset: there is none. */
static enum modal_status find_row(struct ledger *ledger, const struct segment_record *piece,
                                  uint64_t *end, struct modal_error *err)
{
    sqlite3_stmt *row = ledger->row_before;
    int code;

    sqlite3_bind_int64(row, 1, piece->stream);
    sqlite3_bind_int64(row, 2, (int64_t)piece->offset);
    code = sqlite3_step(row);
    *end = code == SQLITE_ROW ? (uint64_t)sqlite3_column_int64(row, 0) : 0;
    *end = *end > piece->offset ? *end : piece->offset;
    sqlite3_reset(row);
    return code == SQLITE_ROW || code == SQLITE_DONE
               ? MODAL_OK : ledger_db_fail(ledger->db, code, "looking for samples", err);
}

/* PIECE without the samples that have rows, as slices left them that ended half way, or as they
 * were wanted before; without any, where its stream is gone. */
static enum modal_status cut_piece(struct ledger *ledger, struct segment_record *piece,
                                   struct modal_error *err)
{
    uint64_t end = 0, cut, sample;
    bool open;
    enum modal_status rc = find_stream(ledger, piece->stream, &open, err);

    if (rc == MODAL_OK && !open)
        piece->length = 0;
    while (rc == MODAL_OK && piece->length > 0
           && (rc = find_row(ledger, piece, &end, err)) == MODAL_OK && end > piece->offset) {
        cut = end - piece->offset < piece->length ? end - piece->offset : piece->length;
        sample = piece->length / piece->count;
        piece->offset += cut;
        piece->first += cut / sample;
        piece->length -= cut;
        piece->count -= cut / sample;
        piece->data = (const char *)piece->data + cut;
        piece->crc = crc32c(0, piece->data, piece->length);
    }
    return rc;
}

/* What is on the tape and has no row, of STREAMS; COUNT 0: of all, to be settled by slices. */
static enum modal_status read_pieces(struct ledger *ledger, const int64_t *streams, size_t count,
                                     struct modal_error *err)
{
    struct tape_pieces *pieces = &ledger->pieces;
    enum modal_status rc;
    size_t kept = 0;

    forget_pieces(ledger);
    ledger->next_piece = 0;
    ledger->pieces_end = ledger->tape.end;
    rc = tape_read(&ledger->tape, streams, count, pieces, err);
    for (size_t i = 0; rc == MODAL_OK && i < pieces->count; i++) {
        pieces->changes[kept] = pieces->changes[i];
        rc = cut_piece(ledger, &pieces->changes[kept].segment, err);
        kept += pieces->changes[kept].segment.length > 0;
    }
    pieces->count = kept;
    return rc;
}

/* COUNT pieces to their files, and rows. */
static enum modal_status put_pieces(struct ledger *ledger, struct ledger_change *changes,
                                    size_t count, struct modal_error *err)
{
    struct samples_files files = { .dir = ledger->dir };
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; rc == MODAL_OK && i < count; i++)
        rc = samples_put(&files, &changes[i].segment, err);
    if (rc == MODAL_OK)
        rc = samples_sync(&files, err);
    samples_close(&files);
    return rc == MODAL_OK ? apply_all(ledger, changes, count, err) : rc;
}

/* The pieces of the next STREAMS streams; after the last the tape has only what came behind. */
static enum modal_status settle_slice(struct ledger *ledger, size_t streams,
                                      struct modal_error *err)
{
    const struct tape_pieces *pieces = &ledger->pieces;
    struct ledger_change *changes = pieces->changes + ledger->next_piece;
    const size_t left = pieces->count - ledger->next_piece;
    size_t count = 0;
    enum modal_status rc;

    for (; count < left && streams > 0; count++)
        streams -= count + 1 == left || changes[count + 1].segment.stream
                                            != changes[count].segment.stream;
    rc = put_pieces(ledger, changes, count, err);
    ledger->next_piece += count;
    if (rc == MODAL_OK && count < left)
        return MODAL_OK;
    forget_pieces(ledger);
    if (rc != MODAL_OK)
        return take_back(ledger, rc, ledger->tape.end);
    rc = tape_drop(&ledger->tape, ledger->dir, ledger->pieces_end, err);
    ledger->broken = !survivable(rc);
    return rc;
}

/* All that is on the tape to files and rows. */
static enum modal_status settle_tape(struct ledger *ledger, struct modal_error *err)
{
    enum modal_status rc;

    if (ledger->tape.end == ledger->tape.start)
        return MODAL_OK;
    rc = read_pieces(ledger, NULL, 0, err);
    if (rc == MODAL_OK)
        return settle_slice(ledger, SIZE_MAX, err);
    forget_pieces(ledger);
    return take_back(ledger, rc, ledger->tape.end);
}

/* What the tape has of STREAMS, COUNT of them, to files and rows.  Slices that are under way begin
 * anew. */
static enum modal_status settle_streams(struct ledger *ledger, const int64_t *streams, size_t count,
                                        struct modal_error *err)
{
    struct tape_pieces *pieces = &ledger->pieces;
    enum modal_status rc;

    if (ledger->tape.end == ledger->tape.start)
        return MODAL_OK;
    rc = read_pieces(ledger, streams, count, err);
    if (rc == MODAL_OK)
        rc = put_pieces(ledger, pieces->changes, pieces->count, err);
    forget_pieces(ledger);
    return rc == MODAL_OK ? rc : take_back(ledger, rc, ledger->tape.end);
}

/* A long tape to files and rows, a slice a call; all at once where more comes than slices take
 * away. */
static enum modal_status settle_some(struct ledger *ledger, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (ledger->tape.end > 2 * (uint64_t)TAPE_MOST)
        return settle_tape(ledger, err);
    if (ledger->pieces.changes == NULL && ledger->tape.end > TAPE_MOST)
        rc = read_pieces(ledger, NULL, 0, err);
    if (rc == MODAL_OK && ledger->pieces.changes != NULL)
        return settle_slice(ledger, SLICE_STREAMS, err);
    if (rc == MODAL_OK)
        return rc;
    forget_pieces(ledger);
    return take_back(ledger, rc, ledger->tape.end);
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

/* What CHANGES ask to be in files goes there.  Hundreds of other streams' files are not synced for
 * the sake of a few, while groups of those streams would wait for that.  Where nothing came since
 * streams were last asked for, as when a host closes one after the other, all goes at once: nobody
 * waits, and the tape is not read once a stream.  More than are open at once wait for all. */
static enum modal_status settle_wanted(struct ledger *ledger, const struct ledger_change *changes,
                                       size_t count, struct modal_error *err)
{
    const bool rests = ledger->tape.end == ledger->asked_end;
    int64_t streams[SAMPLES_FILES];
    size_t wanted = 0;

    for (size_t i = 0; i < count; i++)
        if (changes[i].verb == LEDGER_SAMPLES_SETTLE) {
            if (changes[i].id == 0 || wanted == SAMPLES_FILES || rests)
                return settle_tape(ledger, err);
            streams[wanted++] = changes[i].id;
        }
    if (wanted == 0)
        return MODAL_OK;
    ledger->asked_end = ledger->tape.end;
    return settle_streams(ledger, streams, wanted, err);
}

enum modal_status ledger_commit(struct ledger *ledger, struct ledger_change *changes, size_t count,
                                struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (ledger->broken)
        return refuse_broken(err);
    if (ledger->log_pages > LOG_PAGES_MOST)
        rc = checkpoint(ledger, err);
    if (rc == MODAL_OK)
        rc = settle_wanted(ledger, changes, count, err);
    if (rc != MODAL_OK)
        return rc;
    rc = put_group(ledger, changes, count, err);
    for (size_t i = 0; i < count; i++)
        ledger->deleted |= ledger_verbs[changes[i].verb].frees;
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
    rc = settle_some(ledger, err);
    if (more != NULL)
        *more = ledger->pieces.changes != NULL;
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
        *more |= ledger->deleted;
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
        rc = empty_log(ledger, &done, err);
    sqlite3_busy_timeout(ledger->db, LEDGER_BUSY_MS);
    sqlite3_db_release_memory(ledger->db);
    *more = !done;
    return rc == MODAL_STORAGE_FULL ? MODAL_OK : rc;
}
