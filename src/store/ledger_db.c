/*
 * ledger_db.c - opening the ledger's database, its schema, and reading all of it
 *
 * What SQLite is told: write-ahead log with full synchronisation (a commit is one fdatasync of the
 * log); checkpoints by us only (ledger_settle), because SQLite's own, at a commit or at the end,
 * swallow a failed fsync of the database; incremental vacuum, so that retention gives space back; 8
 * reserved bytes a page for the checksums of file_vfs.c.
 */
#include "store/ledger_db.h"
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include "base/json.h"
#include "store/file.h"
#include "store/samples.h"

/* Step i takes a database of user_version i to i + 1. */
static const char *const schema[LEDGER_SCHEMA] = {
    "CREATE TABLE about(name TEXT PRIMARY KEY, value TEXT) WITHOUT ROWID;"
    "INSERT INTO about VALUES('store', lower(hex(randomblob(16))));"
    "CREATE TABLE inputs(id INTEGER PRIMARY KEY, user TEXT, state INT, type INT, samples INT,"
    " channels INT, length INT,"
    "  dt REAL, period REAL, units TEXT, names TEXT, attributes TEXT, sha256 BLOB, crc INT,"
    " inline INT, offset INT,"
    "  created INT, used INT, data BLOB);"
    "CREATE TABLE chunks(input INT, offset INT, length INT, crc INT, PRIMARY KEY(input, offset))"
    " WITHOUT ROWID;"
    "CREATE TABLE jobs(id INTEGER PRIMARY KEY, user TEXT, key TEXT, kind TEXT, options TEXT,"
    " input INT, fingerprint BLOB,"
    "  priority INT, run_limit INT, deadline INT, not_before INT, tag TEXT, state INT,"
    " attempts INT, crashes INT,"
    "  submitted INT, started INT, finished INT, cpu INT, error_code TEXT, error_message TEXT,"
    " error_field TEXT,"
    "  error_detail TEXT, result_bytes INT, output INT, cached INT, stderr TEXT);"
    "CREATE UNIQUE INDEX jobs_key ON jobs(user, key) WHERE key IS NOT NULL;"
    "CREATE TABLE results(job INTEGER PRIMARY KEY, length INT, crc INT, input BLOB, settings BLOB,"
    " text BLOB);"
    "CREATE TABLE tombstones(user TEXT, key TEXT, job INT, fingerprint BLOB, expired INT,"
    " PRIMARY KEY(user, key)) WITHOUT ROWID;"
    "CREATE TABLE events(number INTEGER PRIMARY KEY, ns INT, job INT, user TEXT, topic TEXT,"
    " text TEXT);"
    "CREATE TABLE notes(topic TEXT, name TEXT, text TEXT, PRIMARY KEY(topic, name)) WITHOUT ROWID;",
    "CREATE TABLE segments(stream INT, offset INT, epoch INT, first INT, count INT, length INT,"
    " crc INT, PRIMARY KEY(stream, offset)) WITHOUT ROWID;",
    "",              /* samples may lie on the tape, where a program of schema 2 does not look */
    "",              /* the tape has a label, behind which a program of schema 3 sees no group */
};

enum modal_status ledger_db_fail(sqlite3 *db, int code, const char *what, struct modal_error *err)
{
    static const struct { int code; enum modal_status status; } table[] = {
        { SQLITE_IOERR_DATA,        MODAL_CORRUPT },
        { SQLITE_IOERR_SHORT_READ,  MODAL_CORRUPT },
        { SQLITE_IOERR_SHMSIZE,     MODAL_STORAGE_FULL },
        { SQLITE_IOERR_NOMEM,       MODAL_NO_MEMORY },
        { SQLITE_CORRUPT,           MODAL_CORRUPT },
        { SQLITE_NOTADB,            MODAL_CORRUPT },
        { SQLITE_FULL,              MODAL_STORAGE_FULL },
        { SQLITE_NOMEM,             MODAL_NO_MEMORY },
        { SQLITE_CONSTRAINT,        MODAL_CONFLICT },
        { SQLITE_TOOBIG,            MODAL_TOO_LARGE },
        { SQLITE_BUSY,              MODAL_BUSY },
        { SQLITE_IOERR,             MODAL_IO },
        { SQLITE_CANTOPEN,          MODAL_IO },
        { SQLITE_READONLY,          MODAL_IO },
        { SQLITE_PERM,              MODAL_IO },
    };
    int extended = db != NULL ? sqlite3_extended_errcode(db) : code;

    if ((extended & 0xff) != (code & 0xff))
        extended = code;
    for (size_t i = 0; i < sizeof table / sizeof *table; i++)
        if (table[i].code == extended || table[i].code == (extended & 0xff))
            return modal_fail(err, table[i].status, "ledger: %s: %s (%d)%s", what,
                              db != NULL ? sqlite3_errmsg(db) : sqlite3_errstr(code), extended,
                              extended == SQLITE_IOERR_DATA ? ": a page's checksum is wrong" : "");
    return modal_fail(err, MODAL_INTERNAL, "ledger: %s: %s (%d)", what,
                      db != NULL ? sqlite3_errmsg(db) : sqlite3_errstr(code), extended);
}

enum modal_status ledger_db_run(sqlite3 *db, const char *sql, struct modal_error *err)
{
    int code = sqlite3_exec(db, sql, NULL, NULL, NULL);

    return code == SQLITE_OK ? MODAL_OK : ledger_db_fail(db, code, sql, err);
}

static enum modal_status read_number(sqlite3 *db, const char *sql, int64_t *out,
                                     struct modal_error *err)
{
    sqlite3_stmt *statement = NULL;
    int code = sqlite3_prepare_v2(db, sql, -1, &statement, NULL);

    if (code == SQLITE_OK)
        code = sqlite3_step(statement);
    if (code == SQLITE_ROW)
        *out = sqlite3_column_int64(statement, 0);
    sqlite3_finalize(statement);
    return code == SQLITE_ROW || code == SQLITE_DONE ? MODAL_OK
                                                     : ledger_db_fail(db, code, sql, err);
}

enum modal_status ledger_db_store(sqlite3 *db, char store[33], struct modal_error *err)
{
    sqlite3_stmt *row = NULL;
    int code = sqlite3_prepare_v2(db, "SELECT value FROM about WHERE name='store'", -1,
                                  &row, NULL);
    const char *text = NULL;

    if (code == SQLITE_OK)
        code = sqlite3_step(row);
    if (code == SQLITE_ROW)
        text = (const char *)sqlite3_column_text(row, 0);
    if (text != NULL)
        snprintf(store, 33, "%s", text);
    sqlite3_finalize(row);
    if (code != SQLITE_ROW && code != SQLITE_DONE)
        return ledger_db_fail(db, code, "reading the store id", err);
    return strlen(store) == 32
               ? MODAL_OK
               : modal_fail(err, MODAL_CORRUPT, "ledger: the store id is missing");
}

/* --- from schema 1 to 2: a segment was an open input with its data in its row --- */

static enum modal_status number_of(const cJSON *attributes, const char *key, uint64_t *out,
                                   struct modal_error *err)
{
    double value = -1;
    enum modal_status rc = json_get_number(attributes, "", key, 0, 9007199254740992.0, &value, err);

    *out = (uint64_t)value;
    return rc == MODAL_OK && value < 0
               ? modal_fail(err, MODAL_CORRUPT, "ledger: a segment of a stream has no %s", key)
               : rc;
}

/* A row (attributes, samples, crc, data) as it was. */
static enum modal_status old_segment(sqlite3_stmt *row, const cJSON *attributes,
                                     struct segment_record *out, struct modal_error *err)
{
    uint64_t stream = 0;
    enum modal_status rc = number_of(attributes, "stream", &stream, err);

    *out = (struct segment_record) { .stream = (int64_t)stream,
                                     .count = (uint64_t)sqlite3_column_int64(row, 1),
                                     .crc = (uint32_t)sqlite3_column_int64(row, 2),
                                     .data = sqlite3_column_blob(row, 3),
                                     .length = (uint64_t)sqlite3_column_bytes(row, 3) };
    if (rc == MODAL_OK)
        rc = number_of(attributes, "epoch", &out->epoch, err);
    return rc == MODAL_OK ? number_of(attributes, "first", &out->first, err) : rc;
}

static enum modal_status insert_segment(sqlite3 *db, const struct segment_record *s,
                                        struct modal_error *err)
{
    char sql[256];

    snprintf(sql, sizeof sql, "INSERT INTO segments VALUES(%lld,%lld,%lld,%lld,%lld,%lld,%lld)",
             (long long)s->stream, (long long)s->offset, (long long)s->epoch, (long long)s->first,
             (long long)s->count, (long long)s->length, (long long)s->crc);
    return ledger_db_run(db, sql, err);
}

static enum modal_status move_segment(sqlite3 *db, sqlite3_stmt *row, struct samples_files *files,
                                      struct modal_error *err)
{
    const char *text = (const char *)sqlite3_column_text(row, 0);
    struct segment_record segment;
    cJSON *attributes = NULL;
    int64_t end = 0;
    char sql[128];
    enum modal_status rc = json_read(text != NULL ? text : "", text != NULL ? strlen(text) : 0,
                                     &attributes, err);

    if (rc == MODAL_OK)
        rc = old_segment(row, attributes, &segment, err);
    snprintf(sql, sizeof sql,
             "SELECT coalesce(max(offset + length), 0) FROM segments WHERE stream=%lld",
             rc == MODAL_OK ? (long long)segment.stream : 0LL);
    if (rc == MODAL_OK)
        rc = read_number(db, sql, &end, err);
    segment.offset = (uint64_t)end;
    if (rc == MODAL_OK)
        rc = samples_put(files, &segment, err);
    if (rc == MODAL_OK)
        rc = insert_segment(db, &segment, err);
    cJSON_Delete(attributes);
    return rc;
}

/* The samples of open streams go to their files, which are synced before the transaction ends. */
static enum modal_status move_segments(sqlite3 *db, const char *dir, struct modal_error *err)
{
    static const char old[] =
        "SELECT attributes, samples, crc, data FROM inputs WHERE state=0 AND inline=1 ORDER BY id";
    struct samples_files files = { .dir = dir };
    sqlite3_stmt *row = NULL;
    enum modal_status rc = MODAL_OK;
    int code = sqlite3_prepare_v2(db, old, -1, &row, NULL);

    if (code == SQLITE_OK)
        while (rc == MODAL_OK && (code = sqlite3_step(row)) == SQLITE_ROW)
            rc = move_segment(db, row, &files, err);
    sqlite3_finalize(row);
    if (rc == MODAL_OK && code != SQLITE_DONE)
        rc = ledger_db_fail(db, code, old, err);
    if (rc == MODAL_OK)
        rc = samples_sync(&files, err);
    samples_close(&files);
    return rc == MODAL_OK ? ledger_db_run(db, "DELETE FROM inputs WHERE state=0 AND inline=1", err)
                          : rc;
}

/* From user_version FROM to LEDGER_SCHEMA in one transaction. */
static enum modal_status upgrade(sqlite3 *db, const char *dir, int from, struct modal_error *err)
{
    char stamp[128];
    enum modal_status rc = ledger_db_run(db, "BEGIN IMMEDIATE", err);

    for (int i = from; rc == MODAL_OK && i < LEDGER_SCHEMA; i++)
        rc = ledger_db_run(db, schema[i], err);
    if (rc == MODAL_OK && from == 1)
        rc = move_segments(db, dir, err);
    snprintf(stamp, sizeof stamp, "PRAGMA application_id=%d; PRAGMA user_version=%d; COMMIT",
             LEDGER_APPLICATION, LEDGER_SCHEMA);
    if (rc == MODAL_OK)
        rc = ledger_db_run(db, stamp, err);
    if (rc != MODAL_OK)
        sqlite3_exec(db, "ROLLBACK", NULL, NULL, NULL);
    return rc;
}

static enum modal_status check_schema(sqlite3 *db, const char *dir, const char *path, bool write,
                                      struct modal_error *err)
{
    int64_t application = 0, version = 0, tables = 0;
    enum modal_status rc = read_number(db, "PRAGMA application_id", &application, err);

    if (rc == MODAL_OK)
        rc = read_number(db, "PRAGMA user_version", &version, err);
    if (rc == MODAL_OK)
        rc = read_number(db, "SELECT count(*) FROM sqlite_schema", &tables, err);
    if (rc != MODAL_OK)
        return rc;
    if (tables > 0 && application != LEDGER_APPLICATION)
        return modal_fail(err, MODAL_CORRUPT,
                          "%s is a database of another program (application id %lld)", path,
                          (long long)application);
    if (version > LEDGER_SCHEMA)
        return modal_fail(
            err, MODAL_BAD_VERSION,
            "%s has schema %lld, this version knows up to %d: use the later version that wrote it",
            path, (long long)version, LEDGER_SCHEMA);
    if (version == LEDGER_SCHEMA)
        return MODAL_OK;
    if (!write)
        return modal_fail(err, MODAL_BAD_VERSION,
                          "%s has schema %lld, the daemon upgrades it to %d when it starts", path,
                          (long long)version, LEDGER_SCHEMA);
    return upgrade(db, dir, (int)version, err);
}

static enum modal_status set_up(sqlite3 *db, bool write, struct modal_error *err)
{
    int64_t pages = 0;
    int reserved = 8;
    enum modal_status rc;

    sqlite3_extended_result_codes(db, 1);
    sqlite3_busy_timeout(db, LEDGER_BUSY_MS);
    sqlite3_db_config(db, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, NULL);
    sqlite3_file_control(db, "main", SQLITE_FCNTL_RESERVE_BYTES, &reserved);
    /* there is a reader a thread */
    rc = ledger_db_run(db, write ? "PRAGMA cache_size=-4000" : "PRAGMA cache_size=-256", err);
    if (rc == MODAL_OK)
        rc = ledger_db_run(
            db,
            "PRAGMA temp_store=MEMORY; PRAGMA cell_size_check=ON; PRAGMA trusted_schema=OFF;"
            "PRAGMA mmap_size=0; PRAGMA wal_autocheckpoint=0",
            err);
    if (rc == MODAL_OK && !write)
        rc = ledger_db_run(db, "PRAGMA query_only=ON", err);
    if (rc == MODAL_OK && write)
        rc = read_number(db, "PRAGMA page_count", &pages, err);
    if (rc == MODAL_OK && write && pages == 0)
        /* on an old one it would write each time */
        rc = ledger_db_run(db, "PRAGMA auto_vacuum=INCREMENTAL", err);
    if (rc == MODAL_OK && write)
        rc = ledger_db_run(
            db,
            "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA journal_size_limit=8388608",
            err);
    return rc;
}

/* SQLite cannot open a file, and does not say that no inode was left for it. */
static enum modal_status or_full(const char *dir, enum modal_status rc, struct modal_error *err)
{
    struct statvfs known;

    if (rc == MODAL_IO && statvfs(dir, &known) == 0
        && (known.f_bavail == 0 || (known.f_files > 0 && known.f_favail == 0)))
        return modal_fail(err, MODAL_STORAGE_FULL, "ledger: no space is left in %s", dir);
    return rc;
}

/* A file that SQLite opens, which waits for the other end of a FIFO.  One that an earlier version,
 * or SQLite by itself, made for others to read is closed to them; its owner alone may do that. */
static enum modal_status close_to_others(const char *path, struct modal_error *err)
{
    struct stat known;

    if (lstat(path, &known) != 0)
        return MODAL_OK;
    if (!S_ISREG(known.st_mode))
        return modal_fail(err, MODAL_IO, "%s is no file; accepted: a file or nothing", path);
    if ((known.st_mode & 0777 & ~(mode_t)LEDGER_MODE) == 0)
        return MODAL_OK;
    if (chmod(path, known.st_mode & LEDGER_MODE) == 0 || errno == EPERM)
        return MODAL_OK;
    return modal_fail(err, MODAL_IO, "chmod %s: %s", path, strerror(errno));
}

/* SQLite would make it for all to read; its log and index take the mode of the database. */
enum modal_status ledger_db_make(const char *path, struct modal_error *err)
{
    static const char *const beside[] = { "", "-wal", "-shm", "-journal" };
    char name[4200];
    int fd = -1;
    enum modal_status rc = file_open(path, O_RDWR | O_CREAT, LEDGER_MODE, &fd, err);

    if (fd >= 0)
        close(fd);
    for (size_t i = 0; rc == MODAL_OK && i < sizeof beside / sizeof *beside; i++) {
        snprintf(name, sizeof name, "%s%s", path, beside[i]);
        rc = close_to_others(name, err);
    }
    return rc;
}

enum modal_status ledger_db_open(const char *dir, bool write, sqlite3 **out,
                                 struct modal_error *err)
{
    char path[4096], wal[4100];
    sqlite3 *db = NULL;
    enum modal_status rc;
    int code;

    if (snprintf(path, sizeof path, "%s/ledger.db", dir) >= (int)sizeof path)
        return modal_fail(err, MODAL_TOO_LARGE,
                          "the path of the data folder is longer than %zu bytes", sizeof path - 16);
    snprintf(wal, sizeof wal, "%s-wal", path);
    rc = ledger_wal_check(wal, write, err);
    if (rc == MODAL_OK && write)
        rc = ledger_db_make(path, err);
    if (rc != MODAL_OK)
        return rc;
    code = sqlite3_open_v2(
        path, &db,
        SQLITE_OPEN_READWRITE
            | (write ? SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX : SQLITE_OPEN_FULLMUTEX),
        file_vfs());
    rc = code == SQLITE_OK ? set_up(db, write, err) : ledger_db_fail(db, code, path, err);
    if (rc == MODAL_OK)
        rc = check_schema(db, dir, path, write, err);
    if (rc == MODAL_OK && write)
        rc = file_sync_dir(dir, err);
    if (rc != MODAL_OK) {
        sqlite3_close(db);
        return or_full(dir, rc, err);
    }
    *out = db;
    return MODAL_OK;
}

/* --- channel names as one column --- */

enum modal_status ledger_names_text(const struct input_shape *shape, char **text,
                                    struct modal_error *err)
{
    cJSON *list;

    *text = NULL;
    if (shape->names == NULL)
        return MODAL_OK;
    list = cJSON_CreateArray();
    for (uint64_t s = 0; list != NULL && s < shape->channels; s++)
        cJSON_AddItemToArray(list, cJSON_CreateString(shape->names[s]));
    *text = json_print(list);
    cJSON_Delete(list);
    return *text != NULL ? MODAL_OK
                         : modal_fail(err, MODAL_NO_MEMORY,
                                      "ledger: no memory for the names of %llu channels",
                                      (unsigned long long)shape->channels);
}

static bool all_texts(const cJSON *list, uint64_t channels, size_t *bytes)
{
    const cJSON *item;
    uint64_t count = 0;

    *bytes = 0;
    cJSON_ArrayForEach(item, list) {
        if (!cJSON_IsString(item))
            return false;
        *bytes += strlen(item->valuestring) + 1;
        count++;
    }
    return cJSON_IsArray(list) && count == channels;
}

/* Names from the text of ledger_names_text(), as one block to free. */
static enum modal_status ledger_names_read(const char *text, uint64_t channels,
                                           const char *const **names, struct modal_error *err)
{
    cJSON *list = NULL;
    const cJSON *item;
    const char **block = NULL;
    size_t bytes, s = 0;
    char *p;
    enum modal_status rc;

    *names = NULL;
    if (text == NULL)
        return MODAL_OK;
    rc = json_read(text, strlen(text), &list, err);
    if (rc == MODAL_OK && !all_texts(list, channels, &bytes))
        rc = modal_fail(err, MODAL_CORRUPT, "ledger: an input of %llu channels has other names",
                        (unsigned long long)channels);
    if (rc == MODAL_OK && (block = malloc(channels * sizeof *block + bytes)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "ledger: no memory for the names of %llu channels",
                        (unsigned long long)channels);
    if (rc == MODAL_OK) {
        p = (char *)(block + channels);
        cJSON_ArrayForEach(item, list) {
            block[s++] = strcpy(p, item->valuestring);
            p += strlen(p) + 1;
        }
        *names = block;
    }
    cJSON_Delete(list);
    return rc;
}

/* --- loading --- */

static const char *text_of(sqlite3_stmt *row, int column)
{
    return (const char *)sqlite3_column_text(row, column);
}

static void digest_of(sqlite3_stmt *row, int column, uint8_t out[32])
{
    const void *blob = sqlite3_column_blob(row, column);

    memset(out, 0, 32);
    if (blob != NULL && sqlite3_column_bytes(row, column) == 32)
        memcpy(out, blob, 32);
}

/* One row of a table to the visitor. */
typedef enum modal_status visit(sqlite3_stmt *row, const struct ledger_visitor *,
                                struct modal_error *);

static enum modal_status visit_input(sqlite3_stmt *row, const struct ledger_visitor *visitor,
                                     struct modal_error *err)
{
    struct input_record input = {
        .id = sqlite3_column_int64(row, 0),
        .user = text_of(row, 1),
        .state = (enum input_state)sqlite3_column_int(row, 2),
        .shape = { .type = (enum input_type)sqlite3_column_int(row, 3),
                   .samples = (uint64_t)sqlite3_column_int64(row, 4),
                   .channels = (uint64_t)sqlite3_column_int64(row, 5),
                   .length = (uint64_t)sqlite3_column_int64(row, 6),
                   .dt = sqlite3_column_double(row, 7),
                   .period = sqlite3_column_double(row, 8),
                   .units = text_of(row, 9),
                   .attributes = text_of(row, 11) },
        .crc = (uint32_t)sqlite3_column_int64(row, 13),
        .inline_data = sqlite3_column_int(row, 14),
        .offset = (uint64_t)sqlite3_column_int64(row, 15),
        .created_ns = sqlite3_column_int64(row, 16),
        .used_ns = sqlite3_column_int64(row, 17),
        .received = (uint64_t)sqlite3_column_int64(row, 18),
    };
    enum modal_status rc = ledger_names_read(text_of(row, 10), input.shape.channels,
                                             &input.shape.names, err);

    if (rc == MODAL_OK) {
        digest_of(row, 12, input.sha256);
        rc = visitor->input(visitor->context, &input);
    }
    free((void *)(uintptr_t)input.shape.names);
    return rc;
}

static enum modal_status visit_job(sqlite3_stmt *row, const struct ledger_visitor *visitor,
                                   struct modal_error *err)
{
    struct job_record job = {
        .id = sqlite3_column_int64(row, 0),
        .user = text_of(row, 1),
        .key = text_of(row, 2),
        .kind = text_of(row, 3),
        .options = text_of(row, 4),
        .input = sqlite3_column_int64(row, 5),
        .priority = sqlite3_column_int(row, 7),
        .run_limit_ns = sqlite3_column_int64(row, 8),
        .deadline_ns = sqlite3_column_int64(row, 9),
        .not_before_ns = sqlite3_column_int64(row, 10),
        .tag = text_of(row, 11),
        .state = (enum job_state)sqlite3_column_int(row, 12),
        .attempts = sqlite3_column_int(row, 13),
        .crashes = sqlite3_column_int(row, 14),
        .submitted_ns = sqlite3_column_int64(row, 15),
        .started_ns = sqlite3_column_int64(row, 16),
        .finished_ns = sqlite3_column_int64(row, 17),
        .cpu_ns = sqlite3_column_int64(row, 18),
        .error_code = text_of(row, 19),
        .error_message = text_of(row, 20),
        .error_field = text_of(row, 21),
        .error_detail = text_of(row, 22),
        .result_bytes = (uint64_t)sqlite3_column_int64(row, 23),
        .output = sqlite3_column_int64(row, 24),
        .cached = sqlite3_column_int(row, 25),
    };

    if (job.state < 0 || job.state >= JOB_STATE_COUNT || job.user == NULL || job.kind == NULL)
        return modal_fail(err, MODAL_CORRUPT,
                          "ledger: job %lld has no user, no kind, or the unknown state %d",
                          (long long)job.id, (int)job.state);
    digest_of(row, 6, job.fingerprint);
    return visitor->job(visitor->context, &job);
}

static enum modal_status visit_result(sqlite3_stmt *row, const struct ledger_visitor *visitor,
                                      struct modal_error *err)
{
    struct result_record result = { .job = sqlite3_column_int64(row, 0),
                                    .length = (uint64_t)sqlite3_column_int64(row, 1),
                                    .crc = (uint32_t)sqlite3_column_int64(row, 2) };

    (void)err;
    digest_of(row, 3, result.input);
    digest_of(row, 4, result.settings);
    return visitor->result(visitor->context, &result);
}

static enum modal_status visit_tombstone(sqlite3_stmt *row, const struct ledger_visitor *visitor,
                                         struct modal_error *err)
{
    struct tombstone_record tombstone = { .user = text_of(row, 0),
                                          .key = text_of(row, 1),
                                          .job = sqlite3_column_int64(row, 2),
                                          .expired_ns = sqlite3_column_int64(row, 4) };

    (void)err;
    digest_of(row, 3, tombstone.fingerprint);
    return visitor->tombstone(visitor->context, &tombstone);
}

static enum modal_status visit_note(sqlite3_stmt *row, const struct ledger_visitor *visitor,
                                    struct modal_error *err)
{
    struct note_record note = { text_of(row, 0), text_of(row, 1), text_of(row, 2) };

    (void)err;
    return visitor->note(visitor->context, &note);
}

static enum modal_status visit_event(sqlite3_stmt *row, const struct ledger_visitor *visitor,
                                     struct modal_error *err)
{
    struct event_record event = { sqlite3_column_int64(row, 0),
                                  sqlite3_column_int64(row, 1),
                                  sqlite3_column_int64(row, 2),
                                  text_of(row, 3),
                                  text_of(row, 4),
                                  text_of(row, 5) };

    (void)err;
    return visitor->event(visitor->context, &event);
}

struct segment_record ledger_segment_of(sqlite3_stmt *row)
{
    return (struct segment_record) { .stream = sqlite3_column_int64(row, 0),
                                     .epoch = (uint64_t)sqlite3_column_int64(row, 1),
                                     .first = (uint64_t)sqlite3_column_int64(row, 2),
                                     .count = (uint64_t)sqlite3_column_int64(row, 3),
                                     .offset = (uint64_t)sqlite3_column_int64(row, 4),
                                     .length = (uint64_t)sqlite3_column_int64(row, 5),
                                     .crc = (uint32_t)sqlite3_column_int64(row, 6) };
}

static enum modal_status visit_segment(sqlite3_stmt *row, const struct ledger_visitor *visitor,
                                       struct modal_error *err)
{
    struct segment_record segment = ledger_segment_of(row);

    (void)err;
    return visitor->segment(visitor->context, &segment);
}

static enum modal_status load_table(sqlite3 *db, const char *sql, visit *each,
                                    const struct ledger_visitor *visitor, struct modal_error *err)
{
    sqlite3_stmt *row = NULL;
    enum modal_status rc = MODAL_OK;
    int code = sqlite3_prepare_v2(db, sql, -1, &row, NULL);

    if (code == SQLITE_OK)
        while (rc == MODAL_OK && (code = sqlite3_step(row)) == SQLITE_ROW)
            rc = each(row, visitor, err);
    if (rc == MODAL_OK && code != SQLITE_DONE)
        rc = ledger_db_fail(db, code, "loading", err);
    sqlite3_finalize(row);
    return rc;
}

enum modal_status ledger_db_load(sqlite3 *db, const struct ledger_visitor *visitor,
                                 struct modal_error *err)
{
    const struct { bool wanted; const char *sql; visit *each; } tables[] = {
        { visitor->input != NULL,
          "SELECT id, user, state, type, samples, channels, length, dt, period, units, names,"
          " attributes, sha256, crc, inline, offset, created, used, CASE state WHEN 0 THEN"
          " (SELECT sum(length) FROM chunks WHERE input = inputs.id) END FROM inputs ORDER BY id",
          visit_input },
        { visitor->job != NULL,
          "SELECT id, user, key, kind, options, input, fingerprint, priority, run_limit, deadline,"
          " not_before, tag, state, attempts, crashes, submitted, started, finished, cpu,"
          " error_code, error_message, error_field, error_detail, result_bytes, output, cached"
          " FROM jobs ORDER BY id",
          visit_job },
        { visitor->result != NULL,
          "SELECT job, length, crc, input, settings FROM results ORDER BY job", visit_result },
        { visitor->tombstone != NULL,
          "SELECT user, key, job, fingerprint, expired FROM tombstones", visit_tombstone },
        { visitor->note != NULL, "SELECT topic, name, text FROM notes ORDER BY topic, name",
          visit_note },
        { visitor->event != NULL,
          "SELECT number, ns, job, user, topic, text FROM events ORDER BY number", visit_event },
        { visitor->segment != NULL,
          "SELECT " LEDGER_SEGMENT_COLUMNS " FROM segments ORDER BY stream, offset",
          visit_segment },
    };
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; rc == MODAL_OK && i < sizeof tables / sizeof *tables; i++)
        if (tables[i].wanted)
            rc = load_table(db, tables[i].sql, tables[i].each, visitor, err);
    return rc;
}
