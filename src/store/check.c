/*
 * check.c - fsck, dump and backup; see check.h
 *
 * A backup's ledger is a snapshot; the files of its rows must be in the copy too.  Sealed files never change, appear before their row
 * and go after it.  So files are linked before the snapshot, which catches those about to go, and after it, which catches those
 * that came; should one both come and go in between, the snapshot is taken again.
 */
#include "store/check.h"
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/json.h"
#include "base/crc32c.h"
#include "store/file.h"
#include "store/ledger_db.h"
#include "store/samples.h"
#include "store/spool.h"

enum { BLOCK = 1 << 20, PATH = 4200, TRIES = 5 };

/* --- fsck --- */

struct check {
    const char *dir;
    void (*problem)(void *context, const char *line);
    void *context;
    struct check_report *report;
    struct ledger_reader *reader;
    int64_t *inputs;               /* ids seen, ascending */
    size_t input_count, input_room;
    const struct input_record *input;
    uint64_t place;                /* of its data in its file */
    int fd;                        /* of the input whose chunks are read */
    int64_t *streams;              /* open ones */
    size_t stream_count;
    int64_t of;
    int samples;                   /* the file of the last of them that has segments; -1: none is open */
    unsigned char *block;
};

static void say(struct check *check, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void say(struct check *check, const char *format, ...)
{
    char line[5000];
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    check->report->problems++;
    if (check->problem != NULL)
        check->problem(check->context, line);
}

static bool known_input(const struct check *check, int64_t id)
{
    size_t low = 0, high = check->input_count;

    while (low < high) {
        size_t middle = (low + high) / 2;
        if (check->inputs[middle] < id)
            low = middle + 1;
        else
            high = middle;
    }
    return low < check->input_count && check->inputs[low] == id;
}

/* CRC-32C of LENGTH bytes at OFFSET of the input's file; false with a problem told. */
static bool sum(struct check *check, uint64_t offset, uint64_t length, uint32_t *crc)
{
    struct modal_error err;

    *crc = 0;
    for (uint64_t done = 0; done < length;) {
        size_t want = length - done < BLOCK ? (size_t)(length - done) : BLOCK, got = 0;
        if (file_read(check->fd, check->block, want, offset + done, &got, &err) != MODAL_OK) {
            say(check, "input %" PRId64 ": %s", check->input->id, err.message);
            return false;
        }
        if (got == 0) {
            say(check, "input %" PRId64 ": its file ends at offset %" PRIu64 ", %" PRIu64 " bytes early", check->input->id, offset + done, length - done);
            return false;
        }
        *crc = crc32c(*crc, check->block, got);
        check->report->bytes += (int64_t)got;
        done += got;
    }
    return true;
}

static enum modal_status check_chunk(void *context, const struct chunk_record *chunk)
{
    struct check *check = context;
    uint64_t at = check->place + chunk->offset;
    uint32_t crc;

    check->report->chunks++;
    if (sum(check, at, chunk->length, &crc) && crc != chunk->crc)
        say(check, "input %" PRId64 ": the chunk at %" PRIu64 " (offset %" PRIu64 " of its file, %" PRIu64 " bytes) has the checksum %08x, not %08x",
            check->input->id, chunk->offset, at, chunk->length, crc, chunk->crc);
    return MODAL_OK;
}

static void check_file(struct check *check, const struct input_record *input)
{
    char path[PATH];
    struct modal_error err;
    int64_t before = check->report->problems;
    uint32_t crc;

    snprintf(path, sizeof path, "%s/spool/%" PRId64 ".%s", check->dir, input->id, input->state == INPUT_SEALED ? "h5" : "part");
    check->input = input;
    if (file_open(path, O_RDONLY, 0, &check->fd, &err) != MODAL_OK) {
        snprintf(path, sizeof path, "%s/spool/%" PRId64 ".h5", check->dir, input->id);     /* renamed, its row not yet written */
        if (input->state == INPUT_SEALED || file_open(path, O_RDONLY, 0, &check->fd, NULL) != MODAL_OK) {
            say(check, "input %" PRId64 ": %s", input->id, err.message);
            return;
        }
    }
    check->place = input->offset;
    if (check->place == 0 && spool_offset(path, &input->shape, &check->place, &err) != MODAL_OK)
        /* of an upload that earlier versions began */
        say(check, "input %" PRId64 ": %s", input->id, err.message);
    else if (ledger_read_chunks(check->reader, input->id, 0, UINT64_MAX, check_chunk, check,
                                &err) != MODAL_OK)
        say(check, "input %" PRId64 ": its chunks: %s", input->id, err.message);
    if (input->state == INPUT_SEALED && check->report->problems == before && sum(check, input->offset, input_bytes(&input->shape), &crc) && crc != input->crc)
        say(check, "input %" PRId64 ": %s: the checksum of its data (offset %" PRIu64 ", %" PRIu64 " bytes) is %08x, not %08x", input->id, path,
            input->offset, input_bytes(&input->shape), crc, input->crc);
    close(check->fd);
}

static enum modal_status check_input(void *context, const struct input_record *input)
{
    struct check *check = context;
    struct modal_error err;
    char *data;
    size_t length;

    if (check->input_count == check->input_room) {
        size_t room = check->input_room > 0 ? 2 * check->input_room : 1024;
        int64_t *more = realloc(check->inputs, room * sizeof *more);
        if (more == NULL)
            return MODAL_NO_MEMORY;
        check->inputs = more;
        check->input_room = room;
    }
    check->inputs[check->input_count++] = input->id;
    check->report->inputs++;
    if (!input->inline_data) {
        check_file(check, input);
    } else if (ledger_read_input(check->reader, input->id, &data, &length, &err) != MODAL_OK) {
        say(check, "input %" PRId64 ": %s", input->id, err.message);
    } else {
        check->report->bytes += (int64_t)length;
        free(data);
    }
    return MODAL_OK;
}

/* The job whose result this one shows: itself, or, where it was answered from the results there were, the one its tag names. */
static int64_t result_of(const struct job_record *job)
{
    cJSON *tag = NULL;
    const char *source = NULL;
    int64_t id = job->id;

    if (job->cached && job->tag != NULL && json_read(job->tag, strlen(job->tag), &tag, NULL) == MODAL_OK
        && json_get_string(tag, "", "source", &source, NULL) == MODAL_OK && source != NULL)
        id = strtoll(source, NULL, 10);
    cJSON_Delete(tag);
    return id;
}

static enum modal_status check_job(void *context, const struct job_record *job)
{
    struct check *check = context;
    struct modal_error err;
    char *data;
    size_t length;

    check->report->jobs++;
    if (job->input != 0 && !job_state_final(job->state) && !known_input(check, job->input))
        say(check, "job %" PRId64 " is %s, its input %" PRId64 " is not there", job->id, job_states[job->state], job->input);
    if (job->result_bytes == 0)
        return MODAL_OK;
    if (ledger_read_result(check->reader, result_of(job), &data, &length, &err) != MODAL_OK) {
        say(check, "job %" PRId64 ": %s", job->id, err.message);
        return MODAL_OK;
    }
    check->report->results++;
    check->report->bytes += (int64_t)length;
    free(data);
    return MODAL_OK;
}

static bool known_stream(const struct check *check, int64_t id)
{
    for (size_t i = 0; i < check->stream_count; i++)
        if (check->streams[i] == id)
            return true;
    return false;
}

static enum modal_status add_stream(struct check *check, int64_t id)
{
    int64_t *more = realloc(check->streams, (check->stream_count + 1) * sizeof *more);

    if (more == NULL)
        return MODAL_NO_MEMORY;
    check->streams = more;
    check->streams[check->stream_count++] = id;
    return MODAL_OK;
}

static enum modal_status check_note(void *context, const struct note_record *note)
{
    return strcmp(note->topic, "stream") == 0 ? add_stream(context, strtoll(note->name, NULL, 10)) : MODAL_OK;
}

/* They come stream by stream. */
static enum modal_status check_segment(void *context, const struct segment_record *segment)
{
    struct check *check = context;
    struct modal_error err;
    char path[PATH];

    check->report->chunks++;
    if (!known_stream(check, segment->stream)) {
        say(check, "stream %" PRId64 " has samples but is not there", segment->stream);
        if (add_stream(check, segment->stream) != MODAL_OK)
            return MODAL_NO_MEMORY;
    }
    if (check->samples >= 0 && check->of != segment->stream) {
        close(check->samples);
        check->samples = -1;
    }
    samples_path(path, check->dir, segment->stream);
    check->of = segment->stream;
    if (segment->length > BLOCK)
        say(check, "stream %" PRId64 ": the samples at offset %" PRIu64 " are %" PRIu64 " bytes; at most %d were taken", segment->stream, segment->offset, segment->length, BLOCK);
    else if ((check->samples < 0 && file_open(path, O_RDONLY, 0, &check->samples, &err) != MODAL_OK)
             || samples_get(check->samples, segment, check->block, &err) != MODAL_OK)
        say(check, "%s", err.message);
    else
        check->report->bytes += (int64_t)segment->length;
    return MODAL_OK;
}

static enum modal_status check_tombstone(void *context, const struct tombstone_record *tombstone)
{
    (void)tombstone;
    ((struct check *)context)->report->tombstones++;
    return MODAL_OK;
}

static void check_found(void *context, enum spool_file what, int64_t id, uint64_t bytes, const char *path)
{
    struct check *check = context;

    (void)bytes;
    (void)path;
    if (what == SPOOL_OTHER || (what == SPOOL_SAMPLES && !known_stream(check, id)) || ((what == SPOOL_PART || what == SPOOL_SEALED) && !known_input(check, id)))
        check->report->orphans++;
}

/* SQLite's own look at the structure; each row of its answer is a problem, but for "ok". */
static int integrity_row(void *context, int columns, char **values, char **titles)
{
    (void)titles;
    if (columns > 0 && values[0] != NULL && strcmp(values[0], "ok") != 0)
        say(context, "ledger.db: %s", values[0]);
    return 0;
}

static void check_structure(struct check *check)
{
    sqlite3 *db = NULL;
    struct modal_error err;

    if (ledger_db_open(check->dir, false, &db, &err) != MODAL_OK) {
        say(check, "%s", err.message);
        return;
    }
    if (sqlite3_exec(db, "PRAGMA integrity_check(100)", integrity_row, check, NULL) != SQLITE_OK) {
        ledger_db_fail(db, sqlite3_errcode(db), "integrity_check", &err);
        say(check, "%s", err.message);
    }
    sqlite3_close(db);
}

/* Each page by itself, for the offset of what is wrong: SQLite says which table, not where. */
static enum modal_status check_pages(struct check *check, struct modal_error *err)
{
    enum { PAGE = 4096 };
    char path[PATH];
    size_t got = 0;
    int fd;
    enum modal_status rc;

    snprintf(path, sizeof path, "%s/ledger.db", check->dir);
    rc = file_open(path, O_RDONLY, 0, &fd, err);
    if (rc != MODAL_OK)
        return rc;
    for (int64_t at = 0; (rc = file_read(fd, check->block, PAGE, (uint64_t)at, &got, err)) == MODAL_OK && got > 0; at += PAGE) {
        check->report->bytes += (int64_t)got;
        if (got < PAGE)
            say(check, "ledger.db: the page at offset %" PRId64 " has only %zu bytes", at, got);
        else if (!file_vfs_page_good(check->block, at))
            say(check, "ledger.db: the page at offset %" PRId64 " has a wrong checksum", at);
    }
    close(fd);
    return rc;
}

enum modal_status check_folder(const char *dir, void (*problem)(void *context, const char *line), void *context,
                               struct check_report *out, struct modal_error *err)
{
    struct check check = { .dir = dir, .problem = problem, .context = context, .report = out, .block = malloc(BLOCK), .samples = -1 };
    struct ledger_visitor visitor = { .context = &check, .input = check_input, .job = check_job, .tombstone = check_tombstone, .note = check_note,
                                      .segment = check_segment };
    struct modal_error why;
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    rc = check.block != NULL ? check_pages(&check, err) : modal_fail(err, MODAL_NO_MEMORY, "no memory to check %s", dir);
    if (rc != MODAL_OK)
        goto out;
    rc = ledger_reader_open(dir, &check.reader, &why);
    if (rc == MODAL_BAD_VERSION) {
        modal_fail(err, rc, "%s", why.message);
        goto out;
    }
    if (rc != MODAL_OK) {
        say(&check, "%s", why.message);
        rc = MODAL_OK;
        goto out;
    }
    check_structure(&check);
    if (ledger_reader_load(check.reader, &visitor, &why) != MODAL_OK)
        say(&check, "%s", why.message);
    if (spool_list(dir, check_found, &check, &why) != MODAL_OK)
        say(&check, "%s", why.message);
out:
    ledger_reader_close(check.reader);
    if (check.samples >= 0)
        close(check.samples);
    free(check.streams);
    free(check.inputs);
    free(check.block);
    return rc;
}

/* --- dump --- */

struct dump {
    void (*line)(void *context, const char *json);
    void *context;
};

static cJSON *row_new(const char *row)
{
    cJSON *object = cJSON_CreateObject();

    cJSON_AddStringToObject(object, "row", row);
    return object;
}

/* 64-bit numbers as text, since doubles lose their last digits. */
static void add_int(cJSON *object, const char *name, int64_t value)
{
    char text[24];

    snprintf(text, sizeof text, "%" PRId64, value);
    cJSON_AddStringToObject(object, name, text);
}

static void add_text(cJSON *object, const char *name, const char *text)
{
    if (text != NULL)
        cJSON_AddStringToObject(object, name, text);
}

static void add_digest(cJSON *object, const char *name, const uint8_t digest[32])
{
    char hex[65];

    identity_hex(digest, hex);
    cJSON_AddStringToObject(object, name, hex);
}

static enum modal_status give(struct dump *dump, cJSON *object)
{
    char *text = json_print(object);

    cJSON_Delete(object);
    if (text == NULL)
        return MODAL_NO_MEMORY;
    dump->line(dump->context, text);
    free(text);
    return MODAL_OK;
}

static enum modal_status dump_input(void *context, const struct input_record *input)
{
    const struct input_shape *shape = &input->shape;
    cJSON *row = row_new("input");

    add_int(row, "id", input->id);
    add_text(row, "user", input->user);
    add_text(row, "state", input->state == INPUT_SEALED ? "sealed" : "open");
    add_text(row, "content", shape->type == INPUT_BATCH ? "batch" : "scene");
    add_int(row, "bytes", (int64_t)input_bytes(shape));
    if (shape->type == INPUT_BATCH) {
        add_int(row, "samples", (int64_t)shape->samples);
        add_int(row, "channels", (int64_t)shape->channels);
        json_set_number(row, "dt", shape->dt);
        json_set_number(row, "period", shape->period);
    }
    add_text(row, "units", shape->units);
    add_text(row, "attributes", shape->attributes);
    if (input->state == INPUT_SEALED)
        add_digest(row, "sha256", input->sha256);
    else
        add_int(row, "received", (int64_t)input->received);
    cJSON_AddNumberToObject(row, "crc32c", input->crc);
    cJSON_AddBoolToObject(row, "inline", input->inline_data);
    add_int(row, "offset", (int64_t)input->offset);
    add_int(row, "created_ns", input->created_ns);
    add_int(row, "used_ns", input->used_ns);
    return give(context, row);
}

static enum modal_status dump_job(void *context, const struct job_record *job)
{
    cJSON *row = row_new("job");

    add_int(row, "id", job->id);
    add_text(row, "user", job->user);
    add_text(row, "key", job->key);
    add_text(row, "kind", job->kind);
    add_text(row, "options", job->options);
    add_int(row, "input", job->input);
    add_digest(row, "fingerprint", job->fingerprint);
    add_text(row, "state", job_states[job->state]);
    cJSON_AddNumberToObject(row, "priority", job->priority);
    cJSON_AddNumberToObject(row, "attempts", job->attempts);
    cJSON_AddNumberToObject(row, "crashes", job->crashes);
    add_int(row, "run_limit_ns", job->run_limit_ns);
    add_int(row, "deadline_ns", job->deadline_ns);
    add_int(row, "not_before_ns", job->not_before_ns);
    add_int(row, "submitted_ns", job->submitted_ns);
    add_int(row, "started_ns", job->started_ns);
    add_int(row, "finished_ns", job->finished_ns);
    add_int(row, "cpu_ns", job->cpu_ns);
    add_text(row, "error_code", job->error_code);
    add_text(row, "error_message", job->error_message);
    add_text(row, "error_field", job->error_field);
    add_text(row, "error_detail", job->error_detail);
    add_text(row, "tag", job->tag);
    add_int(row, "result_bytes", (int64_t)job->result_bytes);
    add_int(row, "output", job->output);
    cJSON_AddBoolToObject(row, "cached", job->cached);
    return give(context, row);
}

static enum modal_status dump_result(void *context, const struct result_record *result)
{
    cJSON *row = row_new("result");

    add_int(row, "job", result->job);
    add_int(row, "bytes", (int64_t)result->length);
    cJSON_AddNumberToObject(row, "crc32c", result->crc);
    add_digest(row, "input", result->input);
    add_digest(row, "settings", result->settings);
    return give(context, row);
}

static enum modal_status dump_tombstone(void *context, const struct tombstone_record *tombstone)
{
    cJSON *row = row_new("tombstone");

    add_text(row, "user", tombstone->user);
    add_text(row, "key", tombstone->key);
    add_int(row, "job", tombstone->job);
    add_digest(row, "fingerprint", tombstone->fingerprint);
    add_int(row, "expired_ns", tombstone->expired_ns);
    return give(context, row);
}

static enum modal_status dump_note(void *context, const struct note_record *note)
{
    cJSON *row = row_new("note");

    add_text(row, "topic", note->topic);
    add_text(row, "name", note->name);
    add_text(row, "text", note->text);
    return give(context, row);
}

static enum modal_status dump_segment(void *context, const struct segment_record *segment)
{
    cJSON *row = row_new("segment");

    add_int(row, "stream", segment->stream);
    add_int(row, "epoch", (int64_t)segment->epoch);
    add_int(row, "first", (int64_t)segment->first);
    add_int(row, "count", (int64_t)segment->count);
    add_int(row, "offset", (int64_t)segment->offset);
    add_int(row, "bytes", (int64_t)segment->length);
    cJSON_AddNumberToObject(row, "crc32c", segment->crc);
    return give(context, row);
}

static enum modal_status dump_event(void *context, const struct event_record *event)
{
    cJSON *row = row_new("event");

    add_int(row, "number", event->number);
    add_int(row, "ns", event->ns);
    add_int(row, "job", event->job);
    add_text(row, "user", event->user);
    add_text(row, "topic", event->topic);
    add_text(row, "text", event->text);
    return give(context, row);
}

enum modal_status check_dump(const char *dir, void (*line)(void *context, const char *json), void *context, struct modal_error *err)
{
    struct dump dump = { line, context };
    struct ledger_visitor visitor = { &dump, dump_input, dump_job, dump_result, dump_tombstone, dump_note, dump_event, dump_segment };
    struct ledger_reader *reader = NULL;
    enum modal_status rc = ledger_reader_open(dir, &reader, err);

    if (rc != MODAL_OK)
        return rc;
    rc = ledger_reader_load(reader, &visitor, err);
    ledger_reader_close(reader);
    return rc == MODAL_NO_MEMORY ? modal_fail(err, rc, "no memory to write out %s", dir) : rc;
}

/* --- backup --- */

struct backup {
    const char *dir, *to;
    enum modal_status rc;
    struct modal_error *err;
    bool missing;                /* a row's file is not in the copy */
};

static enum modal_status copy_file(const char *from, const char *to, struct modal_error *err)
{
    unsigned char *block = malloc(BLOCK);
    int in = -1, out = -1;
    uint64_t at = 0;
    size_t got = 0;
    enum modal_status rc = block != NULL ? file_open(from, O_RDONLY, 0, &in, err) : modal_fail(err, MODAL_NO_MEMORY, "no memory to copy %s", from);

    if (rc == MODAL_OK)
        rc = file_open(to, O_WRONLY | O_CREAT | O_TRUNC, 0640, &out, err);
    for (; rc == MODAL_OK && (rc = file_read(in, block, BLOCK, at, &got, err)) == MODAL_OK && got > 0; at += got)
        rc = file_write(out, block, got, at, err);
    if (rc == MODAL_OK)
        rc = file_sync(out, err);
    if (out >= 0)
        close(out);
    if (in >= 0)
        close(in);
    free(block);
    return rc;
}

/* A file that went while we looked is no failure: its row went before. */
static void copy_found(void *context, enum spool_file what, int64_t id, uint64_t bytes, const char *path)
{
    struct backup *backup = context;
    char to[PATH];

    (void)id;
    (void)bytes;
    if (what == SPOOL_OTHER || backup->rc != MODAL_OK)
        return;
    snprintf(to, sizeof to, "%s%s", backup->to, path + strlen(backup->dir));
    if (what != SPOOL_PART && what != SPOOL_SAMPLES && (link(path, to) == 0 || errno == EEXIST || errno == ENOENT))
        return;
    backup->rc = copy_file(path, to, backup->err);
    if (backup->rc == MODAL_NOT_FOUND)
        backup->rc = MODAL_OK;
}

static enum modal_status copy_files(struct backup *backup)
{
    enum modal_status rc;

    backup->rc = MODAL_OK;
    rc = spool_list(backup->dir, copy_found, backup, backup->err);
    return rc == MODAL_OK ? backup->rc : rc;
}

/* An empty database with room for checksums from its first page on, then all pages. */
static enum modal_status copy_ledger(struct backup *backup)
{
    char path[PATH];
    int reserved = 8, code;
    sqlite3 *from = NULL, *to = NULL;
    sqlite3_backup *copy = NULL;
    enum modal_status rc = ledger_db_open(backup->dir, false, &from, backup->err);

    snprintf(path, sizeof path, "%s/ledger.db", backup->to);
    if (rc == MODAL_OK)
        rc = file_unlink(path, backup->err);
    if (rc == MODAL_OK)
        rc = ledger_db_make(path, backup->err);
    if (rc != MODAL_OK)
        goto out;
    code = sqlite3_open_v2(path, &to, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, file_vfs());
    if (code != SQLITE_OK) {
        rc = ledger_db_fail(to, code, path, backup->err);
        goto out;
    }
    sqlite3_file_control(to, "main", SQLITE_FCNTL_RESERVE_BYTES, &reserved);
    rc = ledger_db_run(to, "PRAGMA auto_vacuum=INCREMENTAL; CREATE TABLE room(for_checksums)", backup->err);
    if (rc != MODAL_OK)
        goto out;
    copy = sqlite3_backup_init(to, "main", from, "main");
    code = copy != NULL ? sqlite3_backup_step(copy, -1) : sqlite3_errcode(to);
    if (code != SQLITE_DONE)
        rc = ledger_db_fail(to, code, "backup", backup->err);
    if (copy != NULL && sqlite3_backup_finish(copy) != SQLITE_OK && rc == MODAL_OK)
        rc = ledger_db_fail(to, sqlite3_errcode(to), "backup", backup->err);
out:
    sqlite3_close(to);
    sqlite3_close(from);
    return rc;
}

static enum modal_status look_for_file(void *context, const struct input_record *input)
{
    struct backup *backup = context;
    char path[PATH];

    snprintf(path, sizeof path, "%s/spool/%" PRId64 ".%s", backup->to, input->id, input->state == INPUT_SEALED ? "h5" : "part");
    if (!input->inline_data && access(path, F_OK) != 0) {
        snprintf(path, sizeof path, "%s/spool/%" PRId64 ".h5", backup->to, input->id);
        backup->missing |= access(path, F_OK) != 0;
    }
    return MODAL_OK;
}

/* A stream's file grows: the copy has at least what it had when the ledger's was made, unless the stream ended between. */
static enum modal_status look_for_samples(void *context, const struct segment_record *segment)
{
    struct backup *backup = context;
    struct stat known;
    char path[PATH];

    samples_path(path, backup->to, segment->stream);
    backup->missing |= stat(path, &known) != 0 || (uint64_t)known.st_size < segment->offset + segment->length;
    return MODAL_OK;
}

static enum modal_status find_missing(struct backup *backup)
{
    struct ledger_visitor visitor = { .context = backup, .input = look_for_file, .segment = look_for_samples };
    struct ledger_reader *reader = NULL;
    enum modal_status rc = ledger_reader_open(backup->to, &reader, backup->err);

    backup->missing = false;
    if (rc == MODAL_OK)
        rc = ledger_reader_load(reader, &visitor, backup->err);
    ledger_reader_close(reader);
    return rc;
}

static enum modal_status make_copy(struct backup *backup)
{
    enum modal_status rc = MODAL_OK;

    backup->missing = true;
    for (int i = 0; rc == MODAL_OK && backup->missing; i++) {
        if (i == TRIES)
            return modal_fail(backup->err, MODAL_BUSY, "files of %s come and go faster than they can be copied: try again", backup->dir);
        rc = copy_files(backup);
        if (rc == MODAL_OK)
            rc = copy_ledger(backup);
        if (rc == MODAL_OK)
            rc = copy_files(backup);
        if (rc == MODAL_OK)
            rc = find_missing(backup);
    }
    return rc;
}

/* Take away the folder FOLDER and its files; what is not a backup's stays, and then the folder does. */
static void empty_folder(const char *folder)
{
    struct dirent *entry;
    DIR *list = opendir(folder);

    while (list != NULL && (entry = readdir(list)) != NULL)
        if (entry->d_name[0] != '.')
            unlinkat(dirfd(list), entry->d_name, 0);
    if (list != NULL)
        closedir(list);
    rmdir(folder);
}

static void remove_unfinished(const char *folder)
{
    static const char *const folders[] = { "/spool", "/results", "" };
    char path[PATH + 16];

    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s%s", folder, folders[i]);
        empty_folder(path);
    }
}

/* FOLDER, empty and ours alone as long as *LOCK is open: what an earlier backup left there when it was ended goes. */
static enum modal_status make_unfinished(const char *folder, int *lock, struct modal_error *err)
{
    static const char *const folders[] = { "/spool", "/results" };
    char path[PATH + 16];
    enum modal_status rc;

    for (int tries = 0; tries < 2; tries++) {
        rc = file_make_dir(folder, 0750, err);
        if (rc == MODAL_OK)
            rc = file_open(folder, O_RDONLY | O_DIRECTORY, 0, lock, err);
        if (rc != MODAL_OK)
            return rc;
        if (flock(*lock, LOCK_EX | LOCK_NB) != 0) {
            close(*lock);
            *lock = -1;
            return modal_fail_field(err, MODAL_BUSY, "to", "another backup makes %s", folder);
        }
        snprintf(path, sizeof path, "%s/spool", folder);
        if (tries > 0 || access(path, F_OK) != 0)
            break;
        remove_unfinished(folder);
        close(*lock);
        *lock = -1;
    }
    for (int i = 0; rc == MODAL_OK && i < 2; i++) {
        snprintf(path, sizeof path, "%s%s", folder, folders[i]);
        rc = file_make_dir(path, 0750, err);
    }
    return rc;
}

/* On the disk, and only then under its name. */
static enum modal_status finish(const char *unfinished, const char *to, struct modal_error *err)
{
    static const char *const folders[] = { "/spool", "/results", "" };
    char path[PATH + 16], *slash;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < 3; i++) {
        snprintf(path, sizeof path, "%s%s", unfinished, folders[i]);
        rc = file_sync_dir(path, err);
    }
    if (rc == MODAL_OK)
        rc = file_rename(unfinished, to, err);
    snprintf(path, sizeof path, "%s", to);
    slash = strrchr(path, '/');
    if (slash != NULL)
        slash[slash == path] = 0;
    return rc == MODAL_OK ? file_sync_dir(slash != NULL ? path : ".", err) : rc;
}

enum modal_status check_backup(const char *dir, const char *to, struct modal_error *err)
{
    char name[PATH - 64], unfinished[PATH];
    struct backup backup = { .dir = dir, .to = unfinished, .err = err };
    enum modal_status rc;
    int lock = -1;

    if (snprintf(name, sizeof name, "%s", to) >= (int)sizeof name)
        return modal_fail_field(err, MODAL_BAD_INPUT, "to", "a path of %zu bytes; accepted: at most %zu", strlen(to), sizeof name - 1);
    for (size_t n = strlen(name); n > 1 && name[n - 1] == '/'; n--)
        name[n - 1] = 0;
    snprintf(unfinished, sizeof unfinished, "%s.unfinished", name);
    if (access(name, F_OK) == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "to", "%s is there already; a backup makes its folder", name);
    rc = make_unfinished(unfinished, &lock, err);
    if (rc == MODAL_OK)
        rc = make_copy(&backup);
    if (rc == MODAL_OK)
        rc = finish(unfinished, name, err);
    if (rc != MODAL_OK && lock >= 0)
        remove_unfinished(unfinished);
    if (lock >= 0)
        close(lock);
    return rc;
}
