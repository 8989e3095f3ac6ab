/*
 * store_scenario.c - a fixed life of a store, and the check of what is left of it after any fault
 *
 *     store_scenario write DIR     live; each acknowledgement is a line on descriptor 9, written
 *                                  when it would be sent
 *     store_scenario check         lines "DIR ACKS" on stdin: recover DIR and hold it against the
 *                                  acknowledgements in the file ACKS; one line of answer each: "ok"
 *                                  or "P1 ...", "P3 ...", "P5 ..."
 *
 * Acknowledgements:  J id state  the job is in this state  K id  ... is deleted, its key answers
 * expired
 *                     R id length   its result can be read  C id bytes the upload, or stream, has
 *                                   so many bytes
 *                     S id          the input is sealed  X id  the input is deleted, the stream
 *                                   ended
 *
 * What was acknowledged must be there; what was under way may be. The data are a function of their
 * place, so that they can be checked without being kept.
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "store/file.h"
#include "store/ledger.h"
#include "store/mapping.h"
#include "store/samples.h"
#include "store/spool.h"

enum {
    SAMPLES = 1500,
    CHANNELS = 2,
    BYTES = SAMPLES * CHANNELS * 8,
    CHUNK = 4000,
    IDS = 256,
    STREAM = 20,
    STREAM_END = 22,
    SEGMENT = 4800,
    LARGE = LEDGER_RESULT_INLINE_MOST + 100,
    PATH = 4200
};

static const char *dir;
static struct ledger *ledger;

/* --- writing --- */

static void ack(const char *what, int64_t id, int64_t value)
{
    char line[64];
    int length = snprintf(line, sizeof line, "%s %" PRId64 " %" PRId64 "\n", what, id, value);

    if (write(9, line, (size_t)length) != length)
        _exit(9);
}

/* What the daemon does: a full disk refuses this change only, anything else ends the process. */
static bool went(enum modal_status rc, const char *what, const struct modal_error *err)
{
    if (rc == MODAL_OK)
        return true;
    fprintf(stderr, "%s: %s\n", what, err->message);
    if (rc != MODAL_STORAGE_FULL)
        _exit(3);
    return false;
}

static bool commit(struct ledger_change *changes, size_t count)
{
    struct modal_error err;
    bool ok = went(ledger_commit(ledger, changes, count, &err), "commit", &err);

    for (size_t i = 0; ok && i < count; i++)
        ok = changes[i].status == MODAL_OK;
    return ok;
}

static unsigned char data_at(int64_t id, uint64_t at)
{
    return (unsigned char)((uint64_t)id * 131 + at * 2654435761u / 977 + (at >> 7));
}

static unsigned char *data_of(int64_t id, uint64_t length)
{
    unsigned char *data = malloc(length + 1);

    for (uint64_t i = 0; i < length; i++)
        data[i] = data_at(id, i);
    data[length] = 0;
    return data;
}

static struct input_shape shape_of(void)
{
    static const char *const names[CHANNELS] = { "root", "tip" };

    return (struct input_shape) { .type = INPUT_BATCH,
                                 .samples = SAMPLES,
                                 .channels = CHANNELS,
                                 .dt = 0.01,
                                 .units = "m",
                                 .names = names,
                                 .attributes = "{\"rig\":7}" };
}

static void put_job(int64_t id, bool with_input)
{
    struct ledger_change changes[2] = { { .verb = LEDGER_INPUT_PUT }, { .verb = LEDGER_JOB_PUT } };
    unsigned char *data = data_of(1000 + id, 800);
    char key[16];

    snprintf(key, sizeof key, "key%" PRId64, id);
    changes[0].input = (struct input_record) { .id = 1000 + id,
                                              .user = "ada",
                                              .shape = { .type = INPUT_SCENE, .length = 800 },
                                              .state = INPUT_SEALED,
                                              .crc = crc32c(0, data, 800),
                                              .data = data,
                                              .inline_data = true };
    changes[1].job = (struct job_record) { .id = id,
                                          .user = "ada",
                                          .key = key,
                                          .kind = "identify",
                                          .options = "{}",
                                          .input = with_input ? 1000 + id : 10,
                                          .state = JOB_QUEUED,
                                          .submitted_ns = id };
    if (commit(with_input ? changes : changes + 1, with_input ? 2 : 1))
        ack("J", id, JOB_QUEUED);
    free(data);
}

static void move_job(int64_t id, enum job_state state)
{
    struct ledger_change change = {
        .verb = LEDGER_JOB_MOVE,
        .job = { .id = id, .state = state, .attempts = 1, .submitted_ns = id }
    };

    if (commit(&change, 1))
        ack("J", id, state);
}

static void finish_job(int64_t id, uint64_t length)
{
    struct ledger_change changes[2] = { { .verb = LEDGER_RESULT_PUT },
                                        { .verb = LEDGER_JOB_MOVE } };
    unsigned char *text = data_of(2000 + id, length);
    struct modal_error err;

    if (went(ledger_result_put(dir, id, (char *)text, length, &changes[0].result, &err), "result",
             &err)) {
        changes[1].job = (struct job_record){
            .id = id, .state = JOB_DONE, .attempts = 1, .submitted_ns = id, .result_bytes = length
        };
        if (commit(changes, 2)) {
            ack("J", id, JOB_DONE);
            ack("R", id, (int64_t)length);
        }
    }
    free(text);
}

static void delete_job(int64_t id)
{
    struct ledger_change changes[2] = { { .verb = LEDGER_JOB_DELETE },
                                        { .verb = LEDGER_TOMBSTONE_PUT } };
    struct modal_error err;
    char key[16];

    snprintf(key, sizeof key, "key%" PRId64, id);
    changes[0].id = id;
    changes[1].tombstone =
        (struct tombstone_record) { .user = "ada", .key = key, .job = id, .expired_ns = id };
    if (!commit(changes, 2))
        return;
    ack("K", id, 0);
    went(ledger_result_remove(dir, id, &err), "remove", &err);
}

static struct ledger_change input_change(int64_t id, const struct upload *upload,
                                         enum input_state state)
{
    struct ledger_change change = { .verb = LEDGER_INPUT_PUT };

    change.input = (struct input_record) { .id = id,
                                          .user = "ada",
                                          .shape = shape_of(),
                                          .state = state,
                                          .offset = upload_offset(upload),
                                          .crc = upload_crc(upload) };
    return change;
}

/* Upload input ID up to byte END, two chunks a group, and seal it where that is all. */
static void upload(int64_t id, uint64_t end)
{
    struct input_shape shape = shape_of();
    unsigned char *data = data_of(id, BYTES);
    struct ledger_change changes[2] = { { 0 } };
    struct modal_error err;
    struct upload *up = NULL;
    bool ok = went(upload_begin(dir, id, &shape, &up, &err), "begin", &err)
              && went(upload_keep(up, &err), "keep", &err);

    if (ok) {
        changes[0] = input_change(id, up, INPUT_OPEN);
        ok = commit(changes, 1);
        if (ok)
            ack("C", id, 0);
    }
    while (ok && upload_received(up) < end) {
        size_t count = 0;
        for (; ok && count < 2 && upload_received(up) < end; count++) {
            uint64_t at = upload_received(up);
            size_t length = end - at < CHUNK ? (size_t)(end - at) : CHUNK;
            changes[count] = (struct ledger_change) { .verb = LEDGER_CHUNK_PUT };
            changes[count].input_id = id;
            struct upload_part part = { data + at, length, crc32c(0, data + at, length) };
            changes[count].chunk = (struct chunk_record) { at, length, part.crc };
            ok = went(upload_write(up, at, &part, 1, &err), "chunk", &err);
            if (ok)
                upload_hash(up, &part, 1);
        }
        ok = ok && went(upload_sync(up, &err), "sync", &err) && commit(changes, count);
        if (ok)
            ack("C", id, (int64_t)upload_received(up));
    }
    if (ok && end == BYTES) {
        uint8_t digest[32];
        ok = went(upload_seal(up, digest, &err), "seal", &err);
        changes[0] = input_change(id, up, INPUT_SEALED);
        memcpy(changes[0].input.sha256, digest, 32);
        if (ok && commit(changes, 1))
            ack("S", id, 0);
    }
    upload_close(up);
    free(data);
}

static void delete_input(int64_t id)
{
    struct ledger_change change = { .verb = LEDGER_INPUT_DELETE };
    struct modal_error err;

    change.id = id;
    if (!commit(&change, 1))
        return;
    ack("X", id, 0);
    went(spool_remove(dir, id, &err), "remove", &err);
}

/* Two more segments of stream ID in one group, where the last that was taken ends. */
static void push(int64_t id)
{
    static uint64_t ends[IDS];
    struct ledger_change changes[3] = { { .verb = LEDGER_SEGMENT_PUT },
                                        { .verb = LEDGER_SEGMENT_PUT },
                                        { .verb = LEDGER_NOTE_PUT } };
    char name[24];
    uint64_t length = ends[id];
    unsigned char *data = data_of(id, length + 2 * SEGMENT);

    for (int i = 0; i < 2; i++) {
        uint64_t at = length + (uint64_t)i * SEGMENT;
        changes[i].segment = (struct segment_record) { .stream = id,
                                                      .first = at / 8,
                                                      .count = SEGMENT / 8,
                                                      .offset = at,
                                                      .length = SEGMENT,
                                                      .crc = crc32c(0, data + at, SEGMENT),
                                                      .data = data + at };
    }
    snprintf(name, sizeof name, "%" PRId64, id);
    changes[2].note = (struct note_record) { "stream", name, "{}" };
    if (commit(changes, 3))
        ack("C", id, (int64_t)(ends[id] += 2 * SEGMENT));
    free(data);
}

/* As the daemon behind a group: a part of what its streams have on the tape goes to their files. */
static void settle(void)
{
    struct modal_error err;

    went(ledger_settle(ledger, NULL, &err), "settle", &err);
}

/* Its samples are in a batch: rows and file go. */
static void end_stream(int64_t id)
{
    struct ledger_change changes[3] = { { .verb = LEDGER_SAMPLES_SETTLE, .id = id },
                                        { .verb = LEDGER_SEGMENTS_DELETE, .id = id },
                                        { .verb = LEDGER_NOTE_PUT } };
    struct modal_error err;
    char name[24];

    snprintf(name, sizeof name, "%" PRId64, id);
    changes[2].note = (struct note_record) { .topic = "stream", .name = name };
    if (!commit(changes, 3))
        return;
    ack("X", id, 0);
    went(samples_remove(dir, id, &err), "remove", &err);
}

static void open_ledger(void)
{
    struct modal_error err;

    if (!went(ledger_open(dir, &ledger, &err), "open", &err))
        _exit(4);
}

static void vacuum(void)
{
    struct modal_error err;
    int64_t left;

    went(ledger_vacuum(ledger, 100, &left, &err), "vacuum", &err);
}

/* As the daemon when nothing is asked of it: the log is emptied. */
static void rest(void)
{
    struct modal_error err;
    bool more = true;

    while (more && went(ledger_idle(ledger, &more, &err), "rest", &err))
        ;
}

static int live(void)
{
    struct modal_error err;

    open_ledger();
    went(reserve_hold(dir, 65536, &err), "reserve", &err);
    for (int64_t id = 1; id <= 3; id++)
        put_job(id, true);
    upload(10, BYTES);
    put_job(4, false);
    move_job(1, JOB_RUNNING);
    finish_job(1, 700);
    vacuum();   /* the log goes to the database, and begins anew with the next group */
    move_job(2, JOB_RUNNING);
    finish_job(2, LARGE);
    move_job(3, JOB_RUNNING);
    move_job(3, JOB_FAILED);
    move_job(3, JOB_QUEUED);
    upload(11, 3 * CHUNK);
    delete_job(1);
    push(20);
    push(21);
    push(20);
    upload(12, BYTES);
    rest();
    delete_input(12);
    ledger_close(ledger);
    open_ledger();
    for (int64_t id = 5; id <= 9; id++)
        put_job(id, true);
    delete_job(2);
    push(20);
    push(22);
    push(23);
    settle();   /* 20's samples, and beside what comes meanwhile 22's */
    push(22);
    settle();
    push(20);
    settle();
    end_stream(21);
    move_job(4, JOB_CANCELLED);
    rest();
    move_job(5, JOB_RUNNING);
    move_job(5, JOB_DEAD);
    went(reserve_release(dir, &err), "reserve", &err);
    ledger_close(ledger);
    return 0;
}

/* --- checking --- */

struct claims {
    int state[IDS];          /* of a job; -1: none, -2: deleted */
    int64_t result[IDS];     /* its length; 0: none */
    int64_t bytes[IDS];      /* of an input; -1: none, -2: deleted */
    bool sealed[IDS];
};

struct found {
    const struct claims *claims;
    int jobs[IDS], states[IDS], tombstones[IDS], inputs[IDS];
    uint64_t pushed[IDS];
    char problem[700];
};

static void problem(struct found *found, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
static void problem(struct found *found, const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    if (found->problem[0] == 0)
        vsnprintf(found->problem, sizeof found->problem, format, arguments);
    va_end(arguments);
}

static void read_claims(const char *path, struct claims *claims)
{
    FILE *file = fopen(path, "r");
    char what[4];
    int64_t id, value;

    memset(claims, 0, sizeof *claims);
    for (int i = 0; i < IDS; i++)
        claims->state[i] = -1, claims->bytes[i] = -1;
    while (file != NULL && fscanf(file, "%3s %" SCNd64 " %" SCNd64, what, &id, &value) == 3)
        switch (id >= 0 && id < IDS ? what[0] : 0) {
        case 'J': claims->state[id] = (int)value; break;
        case 'K': claims->state[id] = -2; break;
        case 'R': claims->result[id] = value; break;
        case 'C': claims->bytes[id] = value; break;
        case 'S': claims->sealed[id] = true; break;
        case 'X': claims->bytes[id] = -2; break;
        }
    if (file != NULL)
        fclose(file);
}

/* Is TO reachable from FROM by moves of the table? */
static bool reachable(enum job_state from, enum job_state to)
{
    bool seen[JOB_STATE_COUNT] = { false };

    seen[from] = true;
    for (int round = 0; round < JOB_STATE_COUNT; round++)
        for (int a = 0; a < JOB_STATE_COUNT; a++)
            for (int b = 0; b < JOB_STATE_COUNT; b++)
                seen[b] |= seen[a] && ledger_moves[a][b];
    return seen[to];
}

static bool same_data(const unsigned char *data, int64_t id, uint64_t length)
{
    for (uint64_t i = 0; i < length; i++)
        if (data[i] != data_at(id, i))
            return false;
    return true;
}

static enum modal_status find_job(void *context, const struct job_record *job)
{
    struct found *found = context;
    struct ledger_reader *reader = NULL;
    struct modal_error err;
    char *text;
    size_t length;

    if (job->id < 1 || job->id >= IDS || strcmp(job->user, "ada") != 0) {
        problem(found, "P1 job %" PRId64 " was never submitted", job->id);
        return MODAL_OK;
    }
    found->jobs[job->id]++;
    found->states[job->id] = (int)job->state;
    if (job->state != JOB_DONE)
        return MODAL_OK;
    if (ledger_reader_open(dir, &reader, &err) != MODAL_OK ||
        ledger_read_result(reader, job->id, &text, &length, &err) != MODAL_OK)
        problem(found, "P5 result of %" PRId64 ": %s", job->id, err.message);
    else {
        if (length != job->result_bytes ||
            !same_data((unsigned char *)text, 2000 + job->id, length))
            problem(found, "P5 result of %" PRId64 " is not what was written", job->id);
        free(text);
    }
    ledger_reader_close(reader);
    return MODAL_OK;
}

static enum modal_status find_tombstone(void *context, const struct tombstone_record *tombstone)
{
    struct found *found = context;

    if (tombstone->job > 0 && tombstone->job < IDS)
        found->tombstones[tombstone->job]++;
    return MODAL_OK;
}

static void check_inline(struct found *found, const struct input_record *input)
{
    struct ledger_reader *reader = NULL;
    struct modal_error err;
    char *data;
    size_t length;

    if (ledger_reader_open(dir, &reader, &err) != MODAL_OK ||
        ledger_read_input(reader, input->id, &data, &length, &err) != MODAL_OK)
        problem(found, "P5 input %" PRId64 ": %s", input->id, err.message);
    else {
        if (length != 800 || !same_data((unsigned char *)data, input->id, length))
            problem(found, "P5 input %" PRId64 " is not what was sent", input->id);
        free(data);
    }
    ledger_reader_close(reader);
}

static void check_sealed(struct found *found, const struct input_record *input)
{
    struct mapping map = { 0 };
    struct modal_error err;
    uint8_t digest[32];
    char path[PATH];
    int fd;

    spool_path(path, dir, input->id);
    fd = open(path, O_RDONLY);
    if (fd < 0)
        problem(found, "P5 sealed input %" PRId64 " is missing", input->id);
    else if (spool_map_open(fd, path, input->offset, BYTES, input->crc, &map, &err) != MODAL_OK)
        problem(found, "P5 sealed input %" PRId64 ": %s", input->id, err.message);
    else if (!same_data(map.data, input->id, BYTES))
        problem(found, "P5 sealed input %" PRId64 " is not what was sent", input->id);
    else if (identity_of(&input->shape, map.data, BYTES, digest),
             memcmp(digest, input->sha256, 32) != 0)
        problem(found, "P5 sealed input %" PRId64 " has another identity", input->id);
    mapping_close(&map);
    if (fd >= 0)
        close(fd);
}

struct chunks { struct chunk_record list[64]; size_t count; };

static enum modal_status find_chunk(void *context, const struct chunk_record *chunk)
{
    struct chunks *chunks = context;

    if (chunks->count < 64)
        chunks->list[chunks->count++] = *chunk;
    return MODAL_OK;
}

/* Resume it and bring it to its end: the identity must come out. */
static void check_open(struct found *found, const struct input_record *input)
{
    struct ledger_reader *reader = NULL;
    struct chunks chunks = { .count = 0 };
    struct modal_error err;
    struct upload *up = NULL;
    unsigned char *data = data_of(input->id, BYTES);
    uint8_t digest[32], expected[32];

    if (ledger_reader_open(dir, &reader, &err) != MODAL_OK
        || ledger_read_chunks(reader, input->id, 0, UINT64_MAX, find_chunk, &chunks, &err)
               != MODAL_OK
        || upload_resume(dir, input->id, &input->shape, chunks.list, chunks.count, &up, &err)
               != MODAL_OK)
        problem(found, "P5 open upload %" PRId64 ": %s", input->id, err.message);
    else {
        uint64_t at = upload_received(up);
        if (at != input->received || (int64_t)at < found->claims->bytes[input->id])
            problem(found,
                    "P1 upload %" PRId64 " has %" PRIu64 " bytes, acknowledged were %" PRId64,
                    input->id, at, found->claims->bytes[input->id]);
        struct upload_part rest = { data + at, BYTES - at, crc32c(0, data + at, BYTES - at) };
        if (upload_write(up, at, &rest, 1, &err) != MODAL_OK ||
            (upload_hash(up, &rest, 1), upload_seal(up, digest, &err)) != MODAL_OK)
            problem(found, "P5 upload %" PRId64 " cannot be ended: %s", input->id, err.message);
        else if (identity_of(&input->shape, data, BYTES, expected),
                 memcmp(digest, expected, 32) != 0)
            problem(found, "P5 upload %" PRId64 " ends with another identity", input->id);
    }
    upload_close(up);
    ledger_reader_close(reader);
    free(data);
}

static enum modal_status find_input(void *context, const struct input_record *input)
{
    struct found *found = context;

    if (input->id > 0 && input->id < IDS)
        found->inputs[input->id]++;
    if (input->inline_data)
        check_inline(found, input);
    else if (input->state == INPUT_SEALED)
        check_sealed(found, input);
    else
        check_open(found, input);
    return MODAL_OK;
}

static enum modal_status find_segment(void *context, const struct segment_record *segment)
{
    struct found *found = context;
    unsigned char *data = data_of(segment->stream, segment->offset + segment->length),
                  *read = malloc(segment->length);
    struct modal_error err;
    char path[PATH];
    int fd = -1;

    samples_path(path, dir, segment->stream);
    if (segment->stream < 1 || segment->stream >= IDS ||
        segment->offset != found->pushed[segment->stream])
        problem(found, "P5 the segments of stream %" PRId64 " do not lie behind each other",
                segment->stream);
    else if (file_open(path, O_RDONLY, 0, &fd, &err) != MODAL_OK ||
             samples_get(fd, segment, read, &err) != MODAL_OK)
        problem(found, "P5 stream %" PRId64 ": %s", segment->stream, err.message);
    else if (memcmp(read, data + segment->offset, segment->length) != 0)
        problem(found, "P5 stream %" PRId64 " has other samples", segment->stream);
    else
        found->pushed[segment->stream] += segment->length;
    if (fd >= 0)
        close(fd);
    free(data);
    free(read);
    return MODAL_OK;
}

static void check_claims(struct found *found)
{
    const struct claims *claims = found->claims;

    for (int id = 0; id < IDS; id++) {
        int state = claims->state[id];
        if (found->jobs[id] > 1 || found->inputs[id] > 1)
            problem(found, "P2 %d is there twice", id);
        if (state == -2 && (found->jobs[id] != 0 || found->tombstones[id] != 1))
            problem(found, "P1 the deletion of job %d is lost", id);
        if (state >= 0 && found->jobs[id] == 0 && found->tombstones[id] == 0)
            problem(found, "P1 job %d is lost", id);
        if (state >= 0 && found->jobs[id] == 1 &&
            !reachable((enum job_state)state, (enum job_state)found->states[id]))
            problem(found, "P3 job %d was %s and is %s", id, job_states[state],
                    job_states[found->states[id]]);
        if (claims->bytes[id] == -2 && found->inputs[id] != 0)
            problem(found, "P1 the deletion of input %d is lost", id);
        if (claims->bytes[id] >= 0 && id != 12 && id < STREAM && found->inputs[id] == 0)
            problem(found, "P1 input %d is lost", id);
        if (id >= STREAM && id < STREAM_END && claims->bytes[id] >= 0 &&
            found->pushed[id] < (uint64_t)claims->bytes[id] &&
            !(id == 21 && found->pushed[id] == 0))
            problem(found, "P1 stream %d has %" PRIu64 " bytes, acknowledged were %" PRId64, id,
                    found->pushed[id], claims->bytes[id]);
        if (id >= STREAM && id < STREAM_END && claims->bytes[id] == -2 && found->pushed[id] > 0)
            problem(found, "P1 the end of stream %d is lost", id);
    }
}

static void check(const char *acks)
{
    struct claims claims;
    struct found found = { .claims = &claims };
    struct ledger_visitor visitor = { .context = &found,
                                      .input = find_input,
                                      .job = find_job,
                                      .tombstone = find_tombstone,
                                      .segment = find_segment };
    struct modal_error err;

    read_claims(acks, &claims);
    if (ledger_open(dir, &ledger, &err) != MODAL_OK) {
        problem(&found, "P1 cannot be opened: %s", err.message);
    } else {
        if (ledger_load(ledger, &visitor, &err) != MODAL_OK)
            problem(&found, "P1 cannot be loaded: %s", err.message);
        check_claims(&found);
        put_job(200, true);                   /* and the store goes on */
        ledger_close(ledger);
    }
    puts(found.problem[0] != 0 ? found.problem : "ok");
    fflush(stdout);
}

int main(int argc, char **argv)
{
    char line[2 * PATH], folder[PATH], acks[PATH];

    if (argc == 3 && strcmp(argv[1], "write") == 0) {
        dir = argv[2];
        return live();
    }
    if (argc != 2 || strcmp(argv[1], "check") != 0)
        return 2;
    dup2(open("/dev/null", O_WRONLY), 9);
    while (fgets(line, sizeof line, stdin) != NULL &&
           sscanf(line, "%4095s %4095s", folder, acks) == 2) {
        dir = folder;
        check(acks);
    }
    return 0;
}
