/* check.c - everything of a data folder held against its checksums; see check.h */
#include "store/check.h"
#include <fcntl.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/json.h"
#include "base/crc32c.h"
#include "store/file.h"
#include "store/ledger_db.h"
#include "store/samples.h"
#include "store/tape.h"
#include "store/spool.h"

enum {
    /* a body of the wire (WIRE_BODY_MOST), so that every segment of a stream fits */
    BLOCK = 1 << 20,
    PATH  = 4200,          /* PATH_MAX and the name of a file of ours */
};

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
    /* the file of the last of them that has segments; -1: none is open */
    int samples;
    unsigned char *block;
};

static void add_problem(struct check *check, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
static void add_problem(struct check *check, const char *format, ...)
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
            add_problem(check, "input %" PRId64 ": %s", check->input->id, err.message);
            return false;
        }
        if (got == 0) {
            add_problem(check,
                        "input %" PRId64 ": its file ends at offset %" PRIu64 ", %" PRIu64
                        " bytes early",
                        check->input->id, offset + done, length - done);
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
        add_problem(check,
                    "input %" PRId64 ": the chunk at %" PRIu64 " (offset %" PRIu64
                    " of its file, %" PRIu64 " bytes) has the checksum %08x, not %08x",
                    check->input->id, chunk->offset, at, chunk->length, crc, chunk->crc);
    return MODAL_OK;
}

static void check_file(struct check *check, const struct input_record *input)
{
    char path[PATH];
    struct modal_error err;
    int64_t before = check->report->problems;
    uint32_t crc;

    snprintf(path, sizeof path, "%s/spool/%" PRId64 ".%s", check->dir, input->id,
             input->state == INPUT_SEALED ? "h5" : "part");
    check->input = input;
    if (file_open(path, O_RDONLY, 0, &check->fd, &err) != MODAL_OK) {
        /* renamed, its row not yet written */
        snprintf(path, sizeof path, "%s/spool/%" PRId64 ".h5", check->dir, input->id);
        if (input->state == INPUT_SEALED
            || file_open(path, O_RDONLY, 0, &check->fd, NULL) != MODAL_OK) {
            add_problem(check, "input %" PRId64 ": %s", input->id, err.message);
            return;
        }
    }
    check->place = input->offset;
    if (check->place == 0 && spool_offset(path, &input->shape, &check->place, &err) != MODAL_OK)
        /* of an upload that earlier versions began */
        add_problem(check, "input %" PRId64 ": %s", input->id, err.message);
    else if (ledger_read_chunks(check->reader, input->id, 0, UINT64_MAX, check_chunk, check,
                                &err) != MODAL_OK)
        add_problem(check, "input %" PRId64 ": its chunks: %s", input->id, err.message);
    if (input->state == INPUT_SEALED && check->report->problems == before
        && sum(check, input->offset, input_bytes(&input->shape), &crc) && crc != input->crc)
        add_problem(check,
                    "input %" PRId64 ": %s: the checksum of its data (offset %" PRIu64 ", %" PRIu64
                    " bytes) is %08x, not %08x",
                    input->id, path, input->offset, input_bytes(&input->shape), crc, input->crc);
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
        add_problem(check, "input %" PRId64 ": %s", input->id, err.message);
    } else {
        check->report->bytes += (int64_t)length;
        free(data);
    }
    return MODAL_OK;
}

/* The job whose result this one shows: itself, or, where it was answered from the results there
 * were, the one its tag names. */
static int64_t result_of(const struct job_record *job)
{
    cJSON *tag = NULL;
    const char *source = NULL;
    int64_t id = job->id;

    if (job->cached && job->tag != NULL
        && json_read(job->tag, strlen(job->tag), &tag, NULL) == MODAL_OK
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
        add_problem(check, "job %" PRId64 " is %s, its input %" PRId64 " is not there", job->id,
                    job_states[job->state], job->input);
    if (job->result_bytes == 0)
        return MODAL_OK;
    if (ledger_read_result(check->reader, result_of(job), &data, &length, &err) != MODAL_OK) {
        add_problem(check, "job %" PRId64 ": %s", job->id, err.message);
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
    return strcmp(note->topic, "stream") == 0 ? add_stream(context, strtoll(note->name, NULL, 10))
                                              : MODAL_OK;
}

/* They come stream by stream. */
static enum modal_status check_segment(void *context, const struct segment_record *segment)
{
    struct check *check = context;
    struct modal_error err;
    char path[PATH];

    check->report->chunks++;
    if (!known_stream(check, segment->stream)) {
        add_problem(check, "stream %" PRId64 " has samples but is not there", segment->stream);
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
        add_problem(check,
                    "stream %" PRId64 ": the samples at offset %" PRIu64 " are %" PRIu64
                    " bytes; at most %d were taken",
                    segment->stream, segment->offset, segment->length, BLOCK);
    else if ((check->samples < 0 && file_open(path, O_RDONLY, 0, &check->samples, &err) != MODAL_OK)
             || samples_get(check->samples, segment, check->block, &err) != MODAL_OK)
        add_problem(check, "%s", err.message);
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

static void check_found(void *context, enum spool_file what, int64_t id, uint64_t bytes,
                        const char *path)
{
    struct check *check = context;

    (void)bytes;
    (void)path;
    if (what == SPOOL_OTHER || (what == SPOOL_SAMPLES && !known_stream(check, id))
        || ((what == SPOOL_PART || what == SPOOL_SEALED) && !known_input(check, id)))
        check->report->orphans++;
}

/* SQLite's own look at the structure; each row of its answer is a problem, but for "ok". */
static int integrity_row(void *context, int columns, char **values, char **titles)
{
    (void)titles;
    if (columns > 0 && values[0] != NULL && strcmp(values[0], "ok") != 0)
        add_problem(context, "ledger.db: %s", values[0]);
    return 0;
}

static void check_structure(struct check *check)
{
    sqlite3 *db = NULL;
    struct modal_error err;

    if (ledger_db_open(check->dir, false, &db, &err) != MODAL_OK) {
        add_problem(check, "%s", err.message);
        return;
    }
    if (sqlite3_exec(db, "PRAGMA integrity_check(100)", integrity_row, check, NULL) != SQLITE_OK) {
        ledger_db_fail(db, sqlite3_errcode(db), "integrity_check", &err);
        add_problem(check, "%s", err.message);
    }
    sqlite3_close(db);
}

/* Each page by itself, for the offset of what is wrong: SQLite says which table, not where. */
static enum modal_status check_pages(struct check *check, struct modal_error *err)
{
    enum { PAGE = 4096 };   /* as ledger.c makes them */
    char path[PATH];
    size_t got = 0;
    int fd;
    enum modal_status rc;

    snprintf(path, sizeof path, "%s/ledger.db", check->dir);
    rc = file_open(path, O_RDONLY, 0, &fd, err);
    if (rc != MODAL_OK)
        return rc;
    for (int64_t at = 0;
         (rc = file_read(fd, check->block, PAGE, (uint64_t)at, &got, err)) == MODAL_OK && got > 0;
         at += PAGE) {
        check->report->bytes += (int64_t)got;
        if (got < PAGE)
            add_problem(check, "ledger.db: the page at offset %" PRId64 " has only %zu bytes", at,
                        got);
        else if (!file_vfs_page_good(check->block, at))
            add_problem(check, "ledger.db: the page at offset %" PRId64 " has a wrong checksum",
                        at);
    }
    close(fd);
    return rc;
}

/* Of a daemon that runs the last group may be on its way. */
static void check_tape(struct check *check)
{
    struct modal_error err;
    uint64_t bytes;

    if (tape_check(check->dir, &bytes, &err) != MODAL_OK)
        add_problem(check, "%s", err.message);
    check->report->bytes += (int64_t)bytes;
}

enum modal_status check_folder(const char *dir, void (*problem)(void *context, const char *line),
                               void *context, struct check_report *out, struct modal_error *err)
{
    struct check check = { .dir = dir,
                           .problem = problem,
                           .context = context,
                           .report = out,
                           .block = malloc(BLOCK),
                           .samples = -1 };
    struct ledger_visitor visitor = { .context = &check,
                                      .input = check_input,
                                      .job = check_job,
                                      .tombstone = check_tombstone,
                                      .note = check_note,
                                      .segment = check_segment };
    struct modal_error why;
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    rc = check.block != NULL ? check_pages(&check, err)
                             : modal_fail(err, MODAL_NO_MEMORY, "no memory to check %s", dir);
    if (rc != MODAL_OK)
        goto out;
    rc = ledger_reader_open(dir, &check.reader, &why);
    if (rc == MODAL_BAD_VERSION) {
        modal_fail(err, rc, "%s", why.message);
        goto out;
    }
    if (rc != MODAL_OK) {
        add_problem(&check, "%s", why.message);
        rc = MODAL_OK;
        goto out;
    }
    check_structure(&check);
    if (ledger_reader_load(check.reader, &visitor, &why) != MODAL_OK)
        add_problem(&check, "%s", why.message);
    check_tape(&check);
    if (spool_list(dir, check_found, &check, &why) != MODAL_OK)
        add_problem(&check, "%s", why.message);
out:
    ledger_reader_close(check.reader);
    if (check.samples >= 0)
        close(check.samples);
    free(check.streams);
    free(check.inputs);
    free(check.block);
    return rc;
}
