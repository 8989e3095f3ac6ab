/* ledger_reader.c - reading beside the ledger's owner, and results that are files; see ledger.h */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/crc32c.h"
#include "store/file.h"
#include "store/ledger_db.h"

struct ledger_reader {
    char dir[4096];
    sqlite3 *db;
};

enum modal_status ledger_reader_open(const char *dir, struct ledger_reader **out,
                                     struct modal_error *err)
{
    struct ledger_reader *reader = calloc(1, sizeof *reader);
    enum modal_status rc;

    if (reader == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory to read a ledger");
    snprintf(reader->dir, sizeof reader->dir, "%s", dir);
    rc = ledger_db_open(dir, false, &reader->db, err);
    if (rc != MODAL_OK) {
        free(reader);
        return rc;
    }
    *out = reader;
    return MODAL_OK;
}

void ledger_reader_close(struct ledger_reader *reader)
{
    if (reader != NULL)
        sqlite3_close(reader->db);
    free(reader);
}

/* Prepare SQL with its one number. */
static enum modal_status ask(struct ledger_reader *reader, const char *sql, int64_t id,
                             sqlite3_stmt **out, struct modal_error *err)
{
    int code = sqlite3_prepare_v2(reader->db, sql, -1, out, NULL);

    if (code != SQLITE_OK)
        return ledger_db_fail(reader->db, code, sql, err);
    sqlite3_bind_int64(*out, 1, id);
    return MODAL_OK;
}

static enum modal_status copy_column(sqlite3_stmt *row, int column, char **data, size_t *length,
                                     struct modal_error *err)
{
    size_t size = (size_t)sqlite3_column_bytes(row, column);
    const void *bytes = sqlite3_column_blob(row, column);
    char *copy = malloc(size + 1);

    if (copy == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "ledger: no memory for %zu bytes", size);
    if (size > 0)
        memcpy(copy, bytes, size);
    copy[size] = 0;
    *data = copy;
    *length = size;
    return MODAL_OK;
}

/* The first column of SQL's one row, for ID; WHAT names it where it is absent. */
static enum modal_status read_column(struct ledger_reader *reader, const char *sql, int64_t id,
                                     const char *what, char **data, size_t *length,
                                     struct modal_error *err)
{
    sqlite3_stmt *row = NULL;
    enum modal_status rc = ask(reader, sql, id, &row, err);
    int code = rc == MODAL_OK ? sqlite3_step(row) : SQLITE_OK;

    if (rc == MODAL_OK && code != SQLITE_ROW && code != SQLITE_DONE)
        rc = ledger_db_fail(reader->db, code, sql, err);
    else if (rc == MODAL_OK && (code == SQLITE_DONE || sqlite3_column_type(row, 0) == SQLITE_NULL))
        rc = modal_fail(err, MODAL_NOT_FOUND, "ledger: %s %lld is not there", what, (long long)id);
    else if (rc == MODAL_OK)
        rc = copy_column(row, 0, data, length, err);
    sqlite3_finalize(row);
    return rc;
}

static void result_path(char path[4200], const char *dir, int64_t job)
{
    snprintf(path, 4200, "%s/results/%lld.json", dir, (long long)job);
}

/* A result's row: its length and CRC, and its text where it has it. */
static enum modal_status read_result_row(struct ledger_reader *reader, int64_t job,
                                         uint64_t *expected, uint32_t *crc, char **data,
                                         size_t *length, struct modal_error *err)
{
    sqlite3_stmt *row = NULL;
    enum modal_status rc = ask(reader, "SELECT length, crc, text FROM results WHERE job=?1", job,
                               &row, err);
    int code = rc == MODAL_OK ? sqlite3_step(row) : SQLITE_OK;

    *data = NULL;
    if (rc == MODAL_OK && code == SQLITE_DONE)
        rc = modal_fail(err, MODAL_NOT_FOUND, "ledger: job %lld has no result", (long long)job);
    else if (rc == MODAL_OK && code != SQLITE_ROW)
        rc = ledger_db_fail(reader->db, code, "reading a result", err);
    else if (rc == MODAL_OK) {
        *expected = (uint64_t)sqlite3_column_int64(row, 0);
        *crc = (uint32_t)sqlite3_column_int64(row, 1);
        if (sqlite3_column_type(row, 2) != SQLITE_NULL)
            rc = copy_column(row, 2, data, length, err);
    }
    sqlite3_finalize(row);
    return rc;
}

enum modal_status ledger_read_result(struct ledger_reader *reader, int64_t job, char **data,
                                     size_t *length, struct modal_error *err)
{
    char path[4200], *text = NULL;
    uint64_t expected = 0;
    uint32_t crc = 0;
    size_t got = 0;
    enum modal_status rc = read_result_row(reader, job, &expected, &crc, &text, &got, err);

    if (rc == MODAL_OK && text == NULL) {
        result_path(path, reader->dir, job);
        rc = file_get(path, LEDGER_RESULT_MOST, &text, &got, err);
        if (rc == MODAL_NOT_FOUND)
            rc = modal_fail(err, MODAL_CORRUPT, "%s, the result of job %lld, is missing", path,
                            (long long)job);
    }
    if (rc == MODAL_OK && (got != expected || crc32c(0, text, got) != crc))
        rc = modal_fail(err, MODAL_CORRUPT,
                        "the result of job %lld is damaged: %zu bytes of %llu, or a wrong checksum",
                        (long long)job, got, (unsigned long long)expected);
    if (rc != MODAL_OK) {
        free(text);
        return rc;
    }
    *data = text;
    *length = got;
    return MODAL_OK;
}

enum modal_status ledger_read_stderr(struct ledger_reader *reader, int64_t job, char **data,
                                     size_t *length, struct modal_error *err)
{
    enum modal_status rc = read_column(reader, "SELECT stderr FROM jobs WHERE id=?1", job,
                                       "the stderr of job", data, length, err);

    if (rc == MODAL_NOT_FOUND)
        return modal_fail(err, rc, "no worker died of this job: it has no stderr");
    return rc;
}

enum modal_status ledger_read_input(struct ledger_reader *reader, int64_t input, char **data,
                                    size_t *length, struct modal_error *err)
{
    sqlite3_stmt *row = NULL;
    uint32_t crc = 0;
    enum modal_status rc = read_column(reader, "SELECT data FROM inputs WHERE id=?1", input,
                                       "the data of input", data, length, err);

    if (rc != MODAL_OK)
        return rc;
    rc = ask(reader, "SELECT crc FROM inputs WHERE id=?1", input, &row, err);
    if (rc == MODAL_OK && sqlite3_step(row) == SQLITE_ROW)
        crc = (uint32_t)sqlite3_column_int64(row, 0);
    sqlite3_finalize(row);
    if (rc == MODAL_OK && crc32c(0, *data, *length) != crc)
        rc = modal_fail(err, MODAL_CORRUPT,
                        "the data of input %lld is damaged: its checksum is wrong",
                        (long long)input);
    if (rc != MODAL_OK) {
        free(*data);
        *data = NULL;
    }
    return rc;
}

enum modal_status ledger_read_events(struct ledger_reader *reader, int64_t after, const char *user,
                                     int most,
                                     enum modal_status (*event)(void *context,
                                                                const struct event_record *),
                                     void *context, struct modal_error *err)
{
    sqlite3_stmt *row = NULL;
    enum modal_status rc = ask(reader,
                               "SELECT number, ns, job, user, topic, text FROM events WHERE "
                               "number>?1 AND (?2 IS NULL OR user=?2)"
                               " ORDER BY number LIMIT ?3",
                               after, &row, err);
    int code = SQLITE_DONE;

    if (rc == MODAL_OK) {
        sqlite3_bind_text(row, 2, user, -1, SQLITE_STATIC);
        sqlite3_bind_int(row, 3, most);
    }
    while (rc == MODAL_OK && (code = sqlite3_step(row)) == SQLITE_ROW) {
        struct event_record record = {
            .number = sqlite3_column_int64(row, 0),
            .ns = sqlite3_column_int64(row, 1),
            .job = sqlite3_column_int64(row, 2),
            .user = (const char *)sqlite3_column_text(row, 3),
            .topic = (const char *)sqlite3_column_text(row, 4),
            .text = (const char *)sqlite3_column_text(row, 5),
        };
        rc = event(context, &record);
    }
    if (rc == MODAL_OK && code != SQLITE_DONE)
        rc = ledger_db_fail(reader->db, code, "reading events", err);
    sqlite3_finalize(row);
    return rc;
}

enum modal_status ledger_read_chunks(struct ledger_reader *reader, int64_t input, uint64_t from,
                                     uint64_t to,
                                     enum modal_status (*chunk)(void *context,
                                                                const struct chunk_record *),
                                     void *context, struct modal_error *err)
{
    sqlite3_stmt *row = NULL;
    int64_t first = (int64_t)from, end = to < INT64_MAX ? (int64_t)to : INT64_MAX;
    enum modal_status rc = ask(reader,
                 "SELECT offset, length, crc FROM chunks WHERE input=?1 AND offset>?2 AND offset<?3"
                                       " AND offset+length>?4 ORDER BY offset", input, &row, err);
    int code = SQLITE_DONE;

    if (rc == MODAL_OK) {
        sqlite3_bind_int64(row, 2, first - LEDGER_CHUNK_MOST);
        sqlite3_bind_int64(row, 3, end);
        sqlite3_bind_int64(row, 4, first);
    }
    while (rc == MODAL_OK && (code = sqlite3_step(row)) == SQLITE_ROW) {
        struct chunk_record record = { (uint64_t)sqlite3_column_int64(row, 0),
                                       (uint64_t)sqlite3_column_int64(row, 1),
                                       (uint32_t)sqlite3_column_int64(row, 2) };
        rc = chunk(context, &record);
    }
    if (rc == MODAL_OK && code != SQLITE_DONE)
        rc = ledger_db_fail(reader->db, code, "reading chunks", err);
    sqlite3_finalize(row);
    return rc;
}

enum modal_status ledger_read_segments(struct ledger_reader *reader, int64_t stream,
                                       uint64_t offset,
                                       enum modal_status (*segment)(void *context,
                                                                    const struct segment_record *),
                                       void *context, struct modal_error *err)
{
    sqlite3_stmt *row = NULL;
    enum modal_status rc = ask(reader,
                    "SELECT " LEDGER_SEGMENT_COLUMNS " FROM segments WHERE stream=?1 AND offset>=?2"
                                       " ORDER BY offset", stream, &row, err);
    int code = SQLITE_DONE;

    if (rc == MODAL_OK)
        sqlite3_bind_int64(row, 2, (int64_t)offset);
    while (rc == MODAL_OK && (code = sqlite3_step(row)) == SQLITE_ROW) {
        struct segment_record record = ledger_segment_of(row);
        rc = segment(context, &record);
    }
    if (rc == MODAL_OK && code != SQLITE_DONE)
        rc = ledger_db_fail(reader->db, code, "reading segments", err);
    sqlite3_finalize(row);
    return rc;
}

enum modal_status ledger_reader_load(struct ledger_reader *reader,
                                     const struct ledger_visitor *visitor, struct modal_error *err)
{
    return ledger_db_load(reader->db, visitor, err);
}

enum modal_status ledger_result_put(const char *dir, int64_t job, const char *text, size_t length,
                                    struct result_record *record, struct modal_error *err)
{
    char path[4200];

    if (length > LEDGER_RESULT_MOST)
        return modal_fail(err, MODAL_TOO_LARGE, "a result of %zu bytes; at most %d are kept",
                          length, (int)LEDGER_RESULT_MOST);
    if (length > LEDGER_RESULT_INLINE_MOST) {
        enum modal_status rc;
        result_path(path, dir, job);
        rc = file_put(path, text, length, 0640, err);
        if (rc != MODAL_OK)
            return rc;
    }
    record->job = job;
    record->text = length > LEDGER_RESULT_INLINE_MOST ? NULL : text;
    record->length = length;
    record->crc = crc32c(0, text, length);
    return MODAL_OK;
}

enum modal_status ledger_result_remove(const char *dir, int64_t job, struct modal_error *err)
{
    char path[4200];

    result_path(path, dir, job);
    return file_unlink(path, err);
}
