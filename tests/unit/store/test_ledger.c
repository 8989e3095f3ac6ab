/* test_ledger.c - the ledger: groups, moves, conflicts, reading back, locks, damage */
/* Tests as well: file_vfs.c folder.c ledger_reader.c ledger_verbs.c ledger_wal.c samples.c
 * tape.c */
#include "check.h"
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "store/file.h"
#include "store/ledger.h"
#include "store/samples.h"
#include "store/tape.h"

static char dir[64];

static void shell(const char *format)
{
    char command[256];

    snprintf(command, sizeof command, format, dir, dir);
    CHECK(system(command) == 0);
}

static struct ledger *start(void)
{
    struct ledger *ledger = NULL;

    snprintf(dir, sizeof dir, "/tmp/modald-test-XXXXXX");
    CHECK(mkdtemp(dir) != NULL);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    return ledger;
}

static struct ledger *again(struct ledger *ledger)
{
    ledger_close(ledger);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    return ledger;
}

static void stop(struct ledger *ledger)
{
    ledger_close(ledger);
    shell("rm -r %s");
}

static struct ledger_change job_put(int64_t id, const char *key)
{
    struct ledger_change change = { .verb = LEDGER_JOB_PUT };

    change.job = (struct job_record){
        .id = id,
        .user = "ada",
        .key = key,
        .kind = "identify",
        .options = "{\"rank.fixed\":6}",
        .input = 7,
        .fingerprint = { 1, 2, 3 },
        .priority = 123,
        .run_limit_ns = 45,
        .deadline_ns = 67,
        .not_before_ns = 89,
        .tag = "t",
        .state = JOB_QUEUED,
        .submitted_ns = 1234567890123456789,
    };
    return change;
}

static struct ledger_change job_move(int64_t id, enum job_state state)
{
    struct ledger_change change = { .verb = LEDGER_JOB_MOVE };

    change.job = (struct job_record){
        .id = id,
        .state = state,
        .attempts = 2,
        .crashes = 1,
        .submitted_ns = 1234567890123456789,
        .started_ns = 11,
        .finished_ns = 12,
        .cpu_ns = 13,
        .error_code = "worker_died",
        .error_message = "m",
        .error_field = "f",
        .error_detail = "{}",
        .stderr_text = "last words",
        .result_bytes = 5,
        .output = 9,
        .cached = true,
    };
    return change;
}

static enum modal_status one(struct ledger *ledger, struct ledger_change change)
{
    CHECK(ledger_commit(ledger, &change, 1, NULL) == MODAL_OK);
    return change.status;
}

/* What a load gives, counted, the last of each kept. */
struct seen {
    int inputs, jobs, results, tombstones, notes, events, segments;
    int notes_as[3];                     /* of streams, by their first letter */
    struct segment_record segment[8];
    struct input_record input;
    struct job_record job;
    struct result_record result;
    int64_t last_event;
    int states[JOB_STATE_COUNT];
};

static enum modal_status see_input(void *context, const struct input_record *input)
{
    struct seen *seen = context;
    seen->inputs++;
    seen->input = *input;
    return MODAL_OK;
}

static enum modal_status see_job(void *context, const struct job_record *job)
{
    struct seen *seen = context;
    seen->jobs++;
    seen->job = *job;
    seen->states[job->state]++;
    return MODAL_OK;
}

static enum modal_status see_result(void *context, const struct result_record *result)
{
    struct seen *seen = context;
    seen->results++;
    seen->result = *result;
    return MODAL_OK;
}

static enum modal_status see_tombstone(void *context, const struct tombstone_record *tombstone)
{
    struct seen *seen = context;
    seen->tombstones++;
    CHECK_STRING(tombstone->key, "old");
    return MODAL_OK;
}

static enum modal_status see_note(void *context, const struct note_record *note)
{
    struct seen *seen = context;
    seen->notes++;
    if (strcmp(note->topic, "stream") != 0)
        CHECK_STRING(note->text, "second");
    else if (note->text[0] >= 'a' && note->text[0] <= 'c')
        seen->notes_as[note->text[0] - 'a']++;
    return MODAL_OK;
}

static enum modal_status see_event(void *context, const struct event_record *event)
{
    struct seen *seen = context;
    seen->events++;
    CHECK(event->number > seen->last_event);
    seen->last_event = event->number;
    return MODAL_OK;
}

static enum modal_status see_segment(void *context, const struct segment_record *segment)
{
    struct seen *seen = context;
    if (seen->segments < 8)
        seen->segment[seen->segments] = *segment;
    seen->segments++;
    return MODAL_OK;
}

static struct seen load(struct ledger *ledger)
{
    struct seen seen = { 0 };
    struct ledger_visitor visitor = { &seen,         see_input, see_job,   see_result,
                                      see_tombstone, see_note,  see_event, see_segment };

    CHECK(ledger_load(ledger, &visitor, NULL) == MODAL_OK);
    return seen;
}

TEST(a_job_comes_back_as_it_was_put)
{
    struct ledger *ledger = start();
    struct seen seen;

    CHECK(one(ledger, job_put(3, "k")) == MODAL_OK);
    ledger = again(ledger);
    seen = load(ledger);
    CHECK(seen.jobs == 1 && seen.job.id == 3 && seen.job.input == 7 && seen.job.priority == 123);
    CHECK(seen.job.run_limit_ns == 45 && seen.job.deadline_ns == 67 &&
          seen.job.not_before_ns == 89);
    CHECK(seen.job.submitted_ns == 1234567890123456789 && seen.job.fingerprint[2] == 3 &&
          seen.job.state == JOB_QUEUED);
    stop(ledger);
}

TEST(a_move_changes_the_progress_and_nothing_else)
{
    struct ledger *ledger = start();
    struct ledger_reader *reader;
    struct seen seen;
    char *text;
    size_t length;

    one(ledger, job_put(3, "k"));
    CHECK(one(ledger, job_move(3, JOB_RUNNING)) == MODAL_OK);
    CHECK(one(ledger, job_move(3, JOB_DONE)) == MODAL_OK);
    seen = load(ledger);
    CHECK(seen.job.state == JOB_DONE && seen.job.attempts == 2 && seen.job.crashes == 1 &&
          seen.job.cpu_ns == 13 && seen.job.output == 9);
    CHECK(seen.job.priority == 123 && seen.job.cached);
    CHECK(ledger_reader_open(dir, &reader, NULL) == MODAL_OK);
    CHECK(ledger_read_stderr(reader, 3, &text, &length, NULL) == MODAL_OK);
    CHECK_STRING(text, "last words");
    free(text);
    CHECK(ledger_read_stderr(reader, 4, &text, &length, NULL) == MODAL_NOT_FOUND);
    ledger_reader_close(reader);
    stop(ledger);
}

/* P3: every edge of the table is taken, every other refused, and a refusal changes nothing. */
TEST(exactly_the_moves_of_the_table_are_taken)
{
    struct ledger *ledger = start();

    for (int from = 0; from < JOB_STATE_COUNT; from++)
        for (int to = 0; to < JOB_STATE_COUNT; to++) {
            int64_t id = 1 + from * JOB_STATE_COUNT + to;
            struct ledger_change put = job_put(id, NULL);
            put.job.state = (enum job_state)from;
            CHECK(one(ledger, put) == MODAL_OK);
            CHECK(one(ledger, job_move(id, (enum job_state)to)) ==
                  (ledger_moves[from][to] ? MODAL_OK : MODAL_CONFLICT));
            CHECK(load(ledger).job.state == (enum job_state)(ledger_moves[from][to] ? to : from));
        }
    for (int to = 0; to < JOB_STATE_COUNT; to++)
        CHECK(!ledger_moves[JOB_DONE][to] && !ledger_moves[JOB_CANCELLED][to]);
    CHECK(one(ledger, job_move(999, JOB_DONE)) == MODAL_NOT_FOUND);
    stop(ledger);
}

TEST(a_change_that_cannot_be_leaves_the_rest_of_its_group)
{
    struct ledger *ledger = start();
    struct ledger_change group[5] = { job_put(1, "a"), job_put(2, "a"), job_put(1, "b"),
                                      job_move(77, JOB_DONE), job_put(3, NULL) };

    CHECK(ledger_commit(ledger, group, 5, NULL) == MODAL_OK);
    CHECK(group[0].status == MODAL_OK && group[1].status == MODAL_CONFLICT &&
          group[2].status == MODAL_CONFLICT);
    CHECK(group[3].status == MODAL_NOT_FOUND && group[4].status == MODAL_OK);
    CHECK(load(ledger).jobs == 2);
    CHECK(one(ledger, job_put(4, NULL)) == MODAL_OK);      /* no key never conflicts */
    group[0] = job_put(5, "a");
    group[0].job.user = "bo";                              /* keys are a user's own */
    CHECK(one(ledger, group[0]) == MODAL_OK);
    stop(ledger);
}

TEST(inputs_chunks_results_tombstones_notes_and_events_come_back)
{
    static const char *const names[2] = { "root", "t\"ip" };
    const double x[4] = { 2.385, -1, 7, 0 };
    struct ledger *ledger = start();
    struct ledger_reader *reader;
    struct ledger_change group[12] = { 0 };
    struct seen seen;
    char *data;
    size_t length, n = 0;

    group[n].verb = LEDGER_INPUT_PUT;
    group[n++].input = (struct input_record) { .id = 7,
                                              .user = "ada",
                                              .shape = { .type = INPUT_BATCH,
                                                         .samples = 2,
                                                         .channels = 2,
                                                         .dt = 0.1 + 0.2,
                                                         .period = 3,
                                                         .units = "m",
                                                         .names = names,
                                                         .attributes = "{\"a\":1}" },
                                              .state = INPUT_SEALED,
                                              .sha256 = { 9, 8 },
                                              .crc = crc32c(0, x, sizeof x),
                                              .data = x,
                                              .inline_data = true,
                                              .created_ns = 5,
                                              .used_ns = 6 };
    group[n].verb = LEDGER_INPUT_PUT;
    group[n++].input = (struct input_record) { .id = 8,
                                              .user = "ada",
                                              .shape = { .type = INPUT_SCENE, .length = 300 },
                                              .state = INPUT_OPEN,
                                              .offset = 4096 };
    for (int i = 0; i < 2; i++) {
        group[n].verb = LEDGER_CHUNK_PUT;
        group[n].input_id = 8;
        group[n++].chunk =
            (struct chunk_record) { (uint64_t)i * 100, 100, 0xfffffff0u + (uint32_t)i };
    }
    group[n].verb = LEDGER_RESULT_PUT;
    CHECK(ledger_result_put(dir, 3, "{\"kind\":1}", 10, &group[n].result, NULL) == MODAL_OK);
    group[n++].result.settings[31] = 4;
    group[n].verb = LEDGER_TOMBSTONE_PUT;
    group[n++].tombstone =
        (struct tombstone_record) { .user = "ada", .key = "old", .job = 2, .expired_ns = 50 };
    for (int i = 0; i < 2; i++) {
        group[n].verb = LEDGER_NOTE_PUT;
        group[n++].note = (struct note_record) { "day", "ada", i == 0 ? "first" : "second" };
    }
    for (int i = 0; i < 3; i++) {
        group[n].verb = LEDGER_EVENT_PUT;
        group[n++].event =
            (struct event_record) { 10 + i, 99, 3, i == 1 ? "bo" : "ada", "job", "{}" };
    }
    CHECK(ledger_commit(ledger, group, n, NULL) == MODAL_OK);
    for (size_t i = 0; i < n; i++)
        CHECK(group[i].status == MODAL_OK);

    ledger = again(ledger);
    seen = load(ledger);
    CHECK(seen.inputs == 2 && seen.results == 1 && seen.tombstones == 1 && seen.notes == 1 &&
          seen.events == 3);
    CHECK(seen.input.id == 8 && seen.input.received == 200 && seen.input.offset == 4096 &&
          seen.input.state == INPUT_OPEN);
    CHECK(seen.result.length == 10 && seen.result.settings[31] == 4);

    CHECK(ledger_reader_open(dir, &reader, NULL) == MODAL_OK);
    CHECK(ledger_read_input(reader, 7, &data, &length, NULL) == MODAL_OK);
    CHECK(length == sizeof x && memcmp(data, x, sizeof x) == 0);
    free(data);
    CHECK(ledger_read_input(reader, 8, &data, &length, NULL) == MODAL_NOT_FOUND);
    CHECK(ledger_read_result(reader, 3, &data, &length, NULL) == MODAL_OK);
    CHECK_STRING(data, "{\"kind\":1}");
    free(data);
    seen = (struct seen) { 0 };
    CHECK(ledger_read_events(reader, 10, "ada", 100, see_event, &seen, NULL) == MODAL_OK);
    CHECK(seen.events == 1 && seen.last_event == 12);
    seen = (struct seen) { 0 };
    CHECK(ledger_read_events(reader, 0, NULL, 2, see_event, &seen, NULL) == MODAL_OK);
    CHECK(seen.events == 2 && seen.last_event == 11);
    ledger_reader_close(reader);
    stop(ledger);
}

static struct ledger_change segment_put(int64_t stream, uint64_t offset, const void *data,
                                        uint64_t length)
{
    return (struct ledger_change) { .verb = LEDGER_SEGMENT_PUT,
                                   .segment = { .stream = stream,
                                                .epoch = 1,
                                                .first = offset / 8,
                                                .count = length / 8,
                                                .offset = offset,
                                                .length = length,
                                                .crc = crc32c(0, data, length),
                                                .data = data } };
}

static struct ledger_change stream_note(const char *stream)
{
    return (struct ledger_change) { .verb = LEDGER_NOTE_PUT, .note = { "stream", stream, "{}" } };
}

/* The samples of ONE, from the file of its stream. */
static enum modal_status samples_of(const struct segment_record *one, void *data)
{
    char path[4200];
    enum modal_status rc;
    int fd;

    samples_path(path, dir, one->stream);
    CHECK(file_open(path, O_RDONLY, 0, &fd, NULL) == MODAL_OK);
    rc = samples_get(fd, one, data, NULL);
    close(fd);
    return rc;
}

TEST(segments_of_streams_come_back_in_the_order_they_were_put_with_their_samples)
{
    const double x[6] = { 2.385, -1, 7, 0, 1e-300, 5 };
    struct ledger *ledger = start();
    struct ledger_change group[6] = { stream_note("4"), stream_note("5"),
                                      segment_put(5, 0, x, 16),
                                      segment_put(4, 0, x + 1, 24),
                                      segment_put(5, 24, x + 2, 32),
                                      { .verb = LEDGER_SEGMENTS_DELETE, .id = 4 } };
    double read[4];
    struct seen seen;

    CHECK(ledger_commit(ledger, group, 5, NULL) == MODAL_OK && group[4].status == MODAL_OK);
    ledger = again(ledger);
    seen = load(ledger);
    CHECK(seen.segments == 3 && seen.segment[0].stream == 4 && seen.segment[1].offset == 0 &&
          seen.segment[2].offset == 24 && seen.segment[2].first == 3);
    CHECK(samples_of(&seen.segment[0], read) == MODAL_OK && memcmp(read, x + 1, 24) == 0);
    CHECK(samples_of(&seen.segment[2], read) == MODAL_OK && memcmp(read, x + 2, 32) == 0);
    CHECK(ledger_commit(ledger, group + 5, 1, NULL) == MODAL_OK && group[5].status == MODAL_OK);
    seen = load(ledger);
    CHECK(seen.segments == 2 && seen.segment[0].stream == 5);
    stop(ledger);
}

/* Bytes of the tape. */
static size_t tape_size(void)
{
    char path[4200];
    struct stat known;

    tape_path(path, dir);
    return stat(path, &known) == 0 ? (size_t)known.st_size : 0;
}

/* Calls that write, as the kernel counts them. */
static long writes_of_this_process(void)
{
    FILE *file = fopen("/proc/self/io", "r");
    long count = -1;
    char line[64];

    while (file != NULL && fgets(line, sizeof line, file) != NULL)
        sscanf(line, "syscw: %ld", &count);
    CHECK(file != NULL && fclose(file) == 0 && count >= 0);
    return count;
}

/* 40 notes of streams, and a group of 25 pushes of each. */
static void make_pushes(struct ledger_change *changes, char names[40][12])
{
    static const double x[3] = { 2.385, -1, 7 };

    for (int s = 0; s < 40; s++) {
        snprintf(names[s], 12, "%d", s + 1);
        changes[s] = stream_note(names[s]);
    }
    for (int i = 0; i < 1000; i++)
        changes[40 + i] = segment_put(1 + i % 40, 24 * (uint64_t)(i / 40), x, 24);
}

/* On the code of before, a write a push, a sync a stream and a transaction a group. */
TEST(a_thousand_pushes_of_forty_streams_in_one_group_are_one_write_and_later_a_row_a_stream)
{
    struct ledger *ledger = start();
    static struct ledger_change changes[1040];
    struct ledger_change settle = { .verb = LEDGER_SAMPLES_SETTLE };
    char names[40][12];
    const size_t empty = tape_size();
    struct seen seen;
    long writes;
    bool faults;

    make_pushes(changes, names);
    CHECK(ledger_commit(ledger, changes, 40, NULL) == MODAL_OK);
    faults = file_fault("unlink:1000:EIO");    /* then syncs are counted, where they can be */
    writes = writes_of_this_process();
    CHECK(ledger_commit(ledger, changes + 40, 1000, NULL) == MODAL_OK);
    CHECK(writes_of_this_process() == writes + 1);
    CHECK(!faults || file_fault_count(FILE_FSYNC) + file_fault_count(FILE_FDATASYNC) == 1);
    file_fault(NULL);
    CHECK(ledger_commit(ledger, &settle, 1, NULL) == MODAL_OK && tape_size() == empty);
    seen = load(ledger);
    CHECK(seen.segments == 40);
    CHECK(seen.segment[2].stream == 3 && seen.segment[2].count == 75);
    stop(ledger);
}

/* In each group of rows none is beside another on its page of 4096 bytes; the second is more than
 * is held at once, the third more than SQLite keeps in memory, which reads its own frames again.
 * One write is the mark's, the first of all the log's header.  Before, each page was two. */
TEST(a_group_is_one_write_of_the_log_for_each_sixteen_pages_and_is_there_afterwards)
{
    static const struct { int rows; long writes; } cases[] = { { 12, 3 }, { 40, 5 },
                                                               { 1500, LONG_MAX } };
    static struct ledger_change changes[1500];
    static char text[3000], names[1500][12];
    struct ledger *ledger = start();
    struct seen seen;

    memset(text, 'x', sizeof text - 1);
    for (int k = 0; k < 3; k++) {
        const long before = writes_of_this_process();
        text[0] = (char)('a' + k);
        for (int i = 0; i < cases[k].rows; i++) {
            snprintf(names[i], sizeof names[i], "%d", i);
            changes[i] = (struct ledger_change) { .verb = LEDGER_NOTE_PUT,
                                                  .note = { "stream", names[i], text } };
        }
        CHECK(ledger_commit(ledger, changes, (size_t)cases[k].rows, NULL) == MODAL_OK);
        CHECK(writes_of_this_process() - before <= cases[k].writes);
    }
    ledger = again(ledger);
    seen = load(ledger);
    CHECK(seen.notes == 1500 && seen.notes_as[0] == 0 && seen.notes_as[1] == 0);
    CHECK(seen.notes_as[2] == 1500);
    stop(ledger);
}

/* Rows of ROWS streams, one each, without one for stream 3; nor is there a file of it. */
static void check_without_third(struct ledger *ledger, int rows)
{
    struct seen seen = load(ledger);
    char path[4200];

    CHECK(seen.segments == rows);
    for (int i = 0; i < rows && i < (int)(sizeof seen.segment / sizeof *seen.segment); i++)
        CHECK(seen.segment[i].stream != 3);
    samples_path(path, dir, 3);
    CHECK(access(path, F_OK) != 0);
}

/* On the code of before all forty files were written and synced, while all other groups waited. */
TEST(the_samples_of_one_stream_of_forty_go_to_its_file_alone_and_never_again_once_it_is_gone)
{
    static struct ledger_change changes[1040];
    struct ledger_change settle = { .verb = LEDGER_SAMPLES_SETTLE, .id = 3 }, all = settle,
                         gone[2] = { { .verb = LEDGER_SEGMENTS_DELETE, .id = 3 },
                                     { .verb = LEDGER_NOTE_PUT,
                                       .note = { .topic = "stream", .name = "3" } } };
    char names[40][12];

    all.id = 0;
    for (int asked = 0; asked < 2; asked++) {          /* for the others; else at the start */
        struct ledger *ledger = start();
        struct seen seen;
        bool faults;
        make_pushes(changes, names);
        CHECK(ledger_commit(ledger, changes, 1040, NULL) == MODAL_OK);
        faults = file_fault("unlink:1000:EIO");        /* then syncs are counted */
        CHECK(ledger_commit(ledger, &settle, 1, NULL) == MODAL_OK);
        /* its file, the folder that it is new in, its row */
        CHECK(!faults || file_fault_count(FILE_FSYNC) + file_fault_count(FILE_FDATASYNC) == 3);
        file_fault(NULL);
        seen = load(ledger);
        CHECK(seen.segments == 1 && seen.segment[0].stream == 3 && seen.segment[0].count == 75);
        CHECK(ledger_commit(ledger, gone, 2, NULL) == MODAL_OK && gone[0].status == MODAL_OK);
        CHECK(samples_remove(dir, 3, NULL) == MODAL_OK);
        if (asked)
            CHECK(ledger_commit(ledger, &all, 1, NULL) == MODAL_OK);
        else
            ledger = again(ledger);
        check_without_third(ledger, 39);
        stop(ledger);
    }
}

/* Else the tape would be read once for each stream that a host closes. */
TEST(a_second_stream_that_is_asked_for_brings_all_to_their_files_where_nothing_came_meanwhile)
{
    static struct ledger_change changes[1040];
    const double x[3] = { 2.385, -1, 7 };
    struct ledger_change settle = { .verb = LEDGER_SAMPLES_SETTLE, .id = 3 },
                         more = segment_put(9, 600, x, 24);
    struct ledger *ledger = start();
    const size_t empty = tape_size();
    char names[40][12];

    make_pushes(changes, names);
    CHECK(ledger_commit(ledger, changes, 1040, NULL) == MODAL_OK);
    CHECK(ledger_commit(ledger, &settle, 1, NULL) == MODAL_OK);
    CHECK(ledger_commit(ledger, &more, 1, NULL) == MODAL_OK);
    settle.id = 4;
    CHECK(ledger_commit(ledger, &settle, 1, NULL) == MODAL_OK);
    CHECK(load(ledger).segments == 2 && tape_size() > empty);
    settle.id = 5;
    CHECK(ledger_commit(ledger, &settle, 1, NULL) == MODAL_OK);
    CHECK(load(ledger).segments == 40 && tape_size() == empty);
    settle.id = 6;                                 /* nothing is left to do */
    CHECK(ledger_commit(ledger, &settle, 1, NULL) == MODAL_OK);
    CHECK(load(ledger).segments == 40);
    stop(ledger);
}

/* A tape is long after two groups at least (TAPE_MOST), and not more than twice as long after one
 * more. */
#if MODALD_FAULTS
enum { LONG_STREAMS = 40, LONG_SEGMENT = 192 };
#else
enum { LONG_STREAMS = 40, LONG_SEGMENT = 24576 };
#endif

/* A group of a segment of each of LONG_STREAMS: number I of it. */
static void put_long_group(struct ledger *ledger, int i)
{
    static struct ledger_change changes[LONG_STREAMS];
    static double x[LONG_SEGMENT / 8];

    for (int k = 0; k < LONG_SEGMENT / 8; k++)
        x[k] = 1000 * i + k;
    for (int s = 0; s < LONG_STREAMS; s++)
        changes[s] = segment_put(1 + s, (uint64_t)i * LONG_SEGMENT, x, LONG_SEGMENT);
    CHECK(ledger_commit(ledger, changes, LONG_STREAMS, NULL) == MODAL_OK);
}

/* How far each stream's rows reach, without a hole and with the samples that were put. */
struct reach { uint64_t end[LONG_STREAMS + 1]; int streams; };

static enum modal_status see_reach(void *context, const struct segment_record *segment)
{
    struct reach *reach = context;
    char *data = malloc(segment->length);
    double first;

    CHECK(segment->offset == reach->end[segment->stream]);
    CHECK(samples_of(segment, data) == MODAL_OK);
    memcpy(&first, data, sizeof first);
    CHECK(first == 1000.0 * (double)(segment->offset / LONG_SEGMENT));
    reach->streams += segment->offset == 0;
    reach->end[segment->stream] += segment->length;
    free(data);
    return MODAL_OK;
}

static struct reach reach_of(struct ledger *ledger)
{
    struct reach reach = { .streams = 0 };
    struct ledger_visitor visitor = { .context = &reach, .segment = see_reach };

    CHECK(ledger_load(ledger, &visitor, NULL) == MODAL_OK);
    return reach;
}

/* Groups until the tape is long, then one more between two slices; the number of groups. */
static int make_long_tape(struct ledger *ledger)
{
    static struct ledger_change notes[LONG_STREAMS];
    static char names[LONG_STREAMS][12];
    int groups = 0;

    for (int s = 0; s < LONG_STREAMS; s++) {
        snprintf(names[s], sizeof names[s], "%d", s + 1);
        notes[s] = stream_note(names[s]);
    }
    CHECK(ledger_commit(ledger, notes, LONG_STREAMS, NULL) == MODAL_OK);
    while (tape_size() <= TAPE_MOST)
        put_long_group(ledger, groups++);
    return groups;
}

/* What settles 400 streams at once keeps all that is committed meanwhile waiting. */
TEST(a_long_tape_goes_to_its_files_some_streams_a_call_and_keeps_what_comes_meanwhile)
{
    struct ledger *ledger = start();
    const size_t empty = tape_size();
    int groups = make_long_tape(ledger);
    struct reach reach;
    bool more = false;

    CHECK(ledger_settle(ledger, &more, NULL) == MODAL_OK && more);
    reach = reach_of(ledger);
    CHECK(reach.streams > 0 && reach.streams < LONG_STREAMS);
    put_long_group(ledger, groups++);
    while (more)
        CHECK(ledger_settle(ledger, &more, NULL) == MODAL_OK);
    CHECK(reach_of(ledger).streams == LONG_STREAMS);
    CHECK(tape_size() > empty && tape_size() < empty + 2 * LONG_STREAMS * LONG_SEGMENT);
    put_long_group(ledger, groups++);
    ledger = again(ledger);
    reach = reach_of(ledger);
    for (int s = 1; s <= LONG_STREAMS; s++)
        CHECK(reach.end[s] == (uint64_t)groups * LONG_SEGMENT);
    stop(ledger);
}

/* As a crash leaves it: some streams have rows of what is on the tape, which goes on behind. */
TEST(a_tape_that_is_half_settled_and_longer_since_is_settled_without_a_hole)
{
    struct ledger_change settle = { .verb = LEDGER_SAMPLES_SETTLE };

    for (int asked = 0; asked < 2; asked++) {          /* at the start, or asked for */
        struct ledger *ledger = start();
        int groups = make_long_tape(ledger);
        struct reach reach;
        CHECK(ledger_settle(ledger, NULL, NULL) == MODAL_OK);
        put_long_group(ledger, groups++);
        if (asked)
            CHECK(ledger_commit(ledger, &settle, 1, NULL) == MODAL_OK);
        else
            ledger = again(ledger);
        reach = reach_of(ledger);
        for (int s = 1; s <= LONG_STREAMS; s++)
            CHECK(reach.end[s] == (uint64_t)groups * LONG_SEGMENT);
        stop(ledger);
    }
}

/* A crash cuts the tape anywhere in its last group; what was before is there. */
TEST(a_tape_cut_anywhere_in_its_last_group_has_all_groups_before)
{
    const double x[4] = { 2.385, -1, 7, 11 };
    struct ledger *ledger = start();
    struct ledger_change note = stream_note("5"), put = segment_put(5, 0, x, 16),
                         last = segment_put(5, 16, x + 2, 16);
    size_t first, whole;
    double read[2];
    struct seen seen;
    char path[4200];

    tape_path(path, dir);
    CHECK(ledger_commit(ledger, &note, 1, NULL) == MODAL_OK);
    CHECK(ledger_commit(ledger, &put, 1, NULL) == MODAL_OK);
    first = tape_size();
    CHECK(ledger_commit(ledger, &last, 1, NULL) == MODAL_OK);
    whole = tape_size();
    shell("cp -r %s %s.whole");
    CHECK(whole > first);
    for (size_t size = first; size < whole; size++) {
        ledger_close(ledger);
        shell("rm -r %s");
        shell("cp -r %s.whole %s");
        CHECK(truncate(path, (off_t)size) == 0);
        CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
        seen = load(ledger);
        CHECK(seen.segments == 1 && seen.segment[0].length == 16);
        CHECK(samples_of(&seen.segment[0], read) == MODAL_OK && memcmp(read, x, 16) == 0);
    }
    stop(ledger);
    shell("rm -r %s.whole");
}

TEST(each_flipped_bit_of_the_tape_before_its_last_group_is_reported)
{
    const double x[4] = { 2.385, -1, 7, 11 };
    struct ledger *ledger = start();
    struct ledger_change note = stream_note("5"), put = segment_put(5, 0, x, 16),
                         last = segment_put(5, 16, x + 2, 16);
    struct tape tape;
    char path[4200];
    uint64_t bytes;
    size_t first;
    int fd;

    tape_path(path, dir);
    CHECK(ledger_commit(ledger, &note, 1, NULL) == MODAL_OK);
    CHECK(ledger_commit(ledger, &put, 1, NULL) == MODAL_OK);
    first = tape_size();
    CHECK(ledger_commit(ledger, &last, 1, NULL) == MODAL_OK);
    CHECK(file_open(path, O_RDWR, 0, &fd, NULL) == MODAL_OK);
    for (size_t bit = 0; bit < 8 * first; bit++) {
        unsigned char was, is;
        size_t got;
        CHECK(file_read(fd, &was, 1, bit / 8, &got, NULL) == MODAL_OK);
        is = was ^ (unsigned char)(1u << bit % 8);
        CHECK(file_write(fd, &is, 1, bit / 8, NULL) == MODAL_OK);
        CHECK(tape_check(dir, &bytes, NULL) == MODAL_CORRUPT);
        CHECK(tape_open(&tape, dir, NULL) == MODAL_CORRUPT);
        tape_close(&tape);
        CHECK(file_write(fd, &was, 1, bit / 8, NULL) == MODAL_OK);
    }
    CHECK(tape_check(dir, &bytes, NULL) == MODAL_OK && bytes == tape_size());
    close(fd);
    stop(ledger);
}

/* As of a group whose rows find the disk full.  On the code of before its number was given to none,
 * and the next start after a crash found a group missing. */
TEST(a_tape_is_whole_after_a_group_that_was_taken_back)
{
    static const double x[4] = { 2.385, -1, 7, 11 };
    const struct ledger_change put[2] = { segment_put(5, 0, x, 16), segment_put(5, 16, x + 2, 16) };
    struct ledger *ledger = start();
    struct tape_pieces pieces;
    struct tape tape;
    uint64_t first;

    ledger_close(ledger);
    CHECK(tape_open(&tape, dir, NULL) == MODAL_OK);
    CHECK(tape_add(&tape, &put[0].segment, NULL) == MODAL_OK);
    CHECK(tape_write(&tape, NULL) == MODAL_OK);
    first = tape.end;
    for (int i = 0; i < 2; i++) {
        CHECK(tape_revert(&tape, first, NULL) == MODAL_OK);
        CHECK(tape_add(&tape, &put[1].segment, NULL) == MODAL_OK);
        CHECK(tape_write(&tape, NULL) == MODAL_OK);
    }
    tape_close(&tape);
    CHECK(tape_open(&tape, dir, NULL) == MODAL_OK);
    CHECK(tape_read(&tape, NULL, 0, &pieces, NULL) == MODAL_OK && pieces.count == 1);
    CHECK(pieces.changes[0].segment.length == 32 && memcmp(pieces.bytes, x, 32) == 0);
    tape_pieces_done(&pieces);
    tape_close(&tape);
    shell("rm -r %s");
}

/* What commit 5cae650, of schema 3, wrote of 2.385, -1 and 7, 11: two groups and no label. */
static const unsigned char unlabelled[] = {
    0x4d, 0x4f, 0x44, 0x41, 0x4c, 0x54, 0x50, 0x31, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x48, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0xcb, 0x7c, 0xd3, 0x3a, 0xad, 0x45, 0x68, 0x65,
    0x05, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x10, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x0b, 0xfa, 0xe1, 0x58, 0x00, 0x00, 0x00, 0x00, 0x14, 0xae, 0x47, 0xe1, 0x7a, 0x14, 0x03, 0x40,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0xf0, 0xbf, 0x4d, 0x4f, 0x44, 0x41, 0x4c, 0x54, 0x50, 0x31,
    0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x48, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x34, 0x69, 0xef, 0xe9, 0x04, 0xb3, 0x46, 0x62, 0x05, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x02, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x10, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x10, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x7e, 0x44, 0x8f, 0x2c, 0x00, 0x00, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x1c, 0x40, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x26, 0x40,
};

TEST(a_tape_of_before_there_were_labels_is_read_and_a_damaged_one_reported)
{
    const double x[4] = { 2.385, -1, 7, 11 };
    struct ledger *ledger = start();
    struct ledger_change note = stream_note("5");
    struct seen seen;
    double read[4];
    char path[4200];
    uint64_t bytes;
    int fd;

    tape_path(path, dir);
    CHECK(ledger_commit(ledger, &note, 1, NULL) == MODAL_OK);
    ledger_close(ledger);
    CHECK(file_put(path, unlabelled, sizeof unlabelled, 0640, NULL) == MODAL_OK);
    CHECK(file_open(path, O_RDWR, 0, &fd, NULL) == MODAL_OK);
    CHECK(file_write(fd, "", 1, 103, NULL) == MODAL_OK);
    CHECK(tape_check(dir, &bytes, NULL) == MODAL_CORRUPT);
    CHECK(file_write(fd, unlabelled + 103, 1, 103, NULL) == MODAL_OK);
    close(fd);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    seen = load(ledger);
    CHECK(seen.segments == 1 && seen.segment[0].length == 32);
    CHECK(samples_of(&seen.segment[0], read) == MODAL_OK && memcmp(read, x, 32) == 0);
    stop(ledger);
}

/* Anybody chooses samples: these have two whole groups in them, and a crash took the head of the
 * group in which they came. */
TEST(samples_that_look_like_a_later_group_are_no_damage_before_it)
{
    struct ledger *ledger = start();
    const size_t before = tape_size();
    struct ledger_change note = stream_note("5"),
                         push = segment_put(5, 0, unlabelled, sizeof unlabelled);
    char path[4200];
    uint64_t bytes;
    int fd;

    tape_path(path, dir);
    CHECK(ledger_commit(ledger, &note, 1, NULL) == MODAL_OK);
    CHECK(ledger_commit(ledger, &push, 1, NULL) == MODAL_OK);
    CHECK(file_open(path, O_RDWR, 0, &fd, NULL) == MODAL_OK);
    CHECK(file_write(fd, "\0\0\0\0\0\0\0", 8, before + 16, NULL) == MODAL_OK);
    close(fd);
    CHECK(tape_check(dir, &bytes, NULL) == MODAL_OK && bytes == before);
    stop(again(ledger));
}

TEST(samples_no_row_speaks_of_are_written_over_and_damaged_ones_are_told)
{
    const double x[4] = { 1, 2, 3, 4 };
    struct ledger *ledger = start();
    /* by a crash before its row */
    struct ledger_change group[3] = { stream_note("5"), segment_put(5, 0, x, 16),
                                      { .verb = LEDGER_SAMPLES_SETTLE } },
                         cut_off = segment_put(5, 0, x + 2, 16);
    struct samples_files left = { .dir = dir };
    struct seen seen;
    double read[2];
    char path[4200];
    int fd;

    CHECK(samples_put(&left, &cut_off.segment, NULL) == MODAL_OK);
    samples_close(&left);
    CHECK(ledger_commit(ledger, group, 2, NULL) == MODAL_OK);
    CHECK(ledger_commit(ledger, group + 2, 1, NULL) == MODAL_OK);
    seen = load(ledger);
    CHECK(seen.segments == 1 && samples_of(&seen.segment[0], read) == MODAL_OK &&
          memcmp(read, x, 16) == 0);
    samples_path(path, dir, 5);
    CHECK(file_open(path, O_RDWR, 0, &fd, NULL) == MODAL_OK &&
          file_write(fd, "x", 1, 9, NULL) == MODAL_OK);
    close(fd);
    CHECK(samples_of(&seen.segment[0], read) == MODAL_CORRUPT);
    CHECK(samples_remove(dir, 5, NULL) == MODAL_OK && samples_remove(dir, 5, NULL) == MODAL_OK);
    stop(ledger);
}

TEST(the_space_of_samples_that_were_refused_is_given_back)
{
    static const char zeros[100000];
    struct ledger *ledger = start();
    struct samples_files files = { .dir = dir };
    struct ledger_change put[3] = { stream_note("5"), segment_put(5, 0, zeros, 16),
                                    { .verb = LEDGER_SAMPLES_SETTLE } },
                         more = segment_put(5, 16, zeros, sizeof zeros);
    struct stat known;
    char path[4200];

    CHECK(ledger_commit(ledger, put, 2, NULL) == MODAL_OK);
    CHECK(ledger_commit(ledger, put + 2, 1, NULL) == MODAL_OK);
    CHECK(samples_put(&files, &more.segment, NULL) == MODAL_OK);
    samples_path(path, dir, 5);
    CHECK(stat(path, &known) == 0 && known.st_size == 16 + sizeof zeros);
    samples_revert(&files);
    samples_close(&files);
    CHECK(stat(path, &known) == 0 && known.st_size == 16);
    stop(ledger);
}

/* A folder as schema 1 left it: each segment of an open stream an open input with its data in the
 * row, and an upload that has none. */
static void put_back_to_schema_1(const double *x)
{
    char path[128], sql[1024];
    sqlite3 *db;

    snprintf(path, sizeof path, "%s/ledger.db", dir);
    CHECK(sqlite3_open_v2(path, &db, SQLITE_OPEN_READWRITE, file_vfs()) == SQLITE_OK);
    CHECK(sqlite3_exec(
              db,
              "DROP TABLE segments; PRAGMA user_version=1;"
              "INSERT INTO inputs "
              "VALUES(3,'ada',0,0,9,2,0,0.1,0,NULL,NULL,NULL,zeroblob(32),0,0,4096,1,1,NULL)",
              NULL, NULL, NULL) == SQLITE_OK);
    for (int i = 0; i < 2; i++) {
        sqlite3_stmt *row;
        snprintf(sql, sizeof sql,
                 "INSERT INTO inputs VALUES(%d,'ada',0,0,1,2,0,0.1,0,NULL,NULL,'{\"stream\":5,"
                 "\"epoch\":1,\"first\":%d}',zeroblob(32),%u,1,0,1,1,?1)",
                 10 + i, 7 + i, crc32c(0, x + 2 * i, 16));
        CHECK(sqlite3_prepare_v2(db, sql, -1, &row, NULL) == SQLITE_OK &&
              sqlite3_bind_blob(row, 1, x + 2 * i, 16, SQLITE_STATIC) == SQLITE_OK);
        CHECK(sqlite3_step(row) == SQLITE_DONE);
        sqlite3_finalize(row);
    }
    sqlite3_close(db);
}

TEST(an_open_stream_of_schema_1_has_its_samples_in_its_file_after_the_upgrade)
{
    const double x[4] = { 2.385, -1, 7, 0 };
    struct ledger *ledger = start();
    struct seen seen;
    double read[2];

    ledger_close(ledger);
    put_back_to_schema_1(x);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    for (int life = 0; life < 2; life++) {
        seen = load(ledger);
        CHECK(seen.inputs == 1 && seen.input.id == 3 && seen.segments == 2);
        for (int i = 0; i < 2; i++) {
            CHECK(seen.segment[i].stream == 5 && seen.segment[i].epoch == 1 &&
                  seen.segment[i].first == (uint64_t)(7 + i) && seen.segment[i].count == 1);
            CHECK(seen.segment[i].offset == (uint64_t)(16 * i) &&
                  samples_of(&seen.segment[i], read) == MODAL_OK &&
                  memcmp(read, x + 2 * i, 16) == 0);
        }
        ledger = again(ledger);
    }
    stop(ledger);
}

static enum modal_status keep_input(void *context, const struct input_record *input)
{
    CHECK_STRING(input->shape.names[1], "t\"ip");
    CHECK_STRING(input->shape.units, "m");
    CHECK(input->shape.dt == 0.1 + 0.2 && input->sha256[1] == 8 && input->inline_data);
    (*(int *)context)++;
    return MODAL_OK;
}

TEST(an_inputs_names_and_units_come_back)
{
    static const char *const names[2] = { "root", "t\"ip" };
    struct ledger *ledger = start();
    struct ledger_change change = { .verb = LEDGER_INPUT_PUT };
    int count = 0;
    struct ledger_visitor visitor = { .context = &count, .input = keep_input };

    change.input = (struct input_record) { .id = 1,
                                          .user = "ada",
                                          .shape = { .type = INPUT_BATCH,
                                                     .samples = 1,
                                                     .channels = 2,
                                                     .dt = 0.1 + 0.2,
                                                     .units = "m",
                                                     .names = names },
                                          .sha256 = { 9, 8 },
                                          .data = "sixteen bytes ..",
                                          .inline_data = true };
    CHECK(one(ledger, change) == MODAL_OK);
    CHECK(ledger_load(ledger, &visitor, NULL) == MODAL_OK && count == 1);
    stop(ledger);
}

TEST(deletes_and_prunes_remove_what_they_name)
{
    struct ledger *ledger = start();
    struct ledger_change group[8] = { job_put(3, "k") };
    struct seen seen;

    group[1].verb = LEDGER_RESULT_PUT;
    ledger_result_put(dir, 3, "{}", 2, &group[1].result, NULL);
    group[2].verb = LEDGER_TOMBSTONE_PUT;
    group[2].tombstone = (struct tombstone_record){ .user = "ada", .key = "old", .expired_ns = 50 };
    group[3].verb = LEDGER_EVENT_PUT;
    group[3].event = (struct event_record) { 10, 99, 3, "ada", "job", "{}" };
    group[4].verb = LEDGER_JOB_DELETE;
    group[4].id = 3;
    group[5].verb = LEDGER_TOMBSTONES_PRUNE;
    group[5].id = 51;
    group[6].verb = LEDGER_EVENTS_PRUNE;
    group[6].id = 11;
    group[7].verb = LEDGER_INPUT_DELETE;
    group[7].id = 123;
    CHECK(ledger_commit(ledger, group, 8, NULL) == MODAL_OK);
    CHECK(group[4].status == MODAL_OK && group[7].status == MODAL_NOT_FOUND);
    seen = load(ledger);
    CHECK(seen.jobs == 0 && seen.results == 0 && seen.tombstones == 0 && seen.events == 0);
    CHECK(one(ledger, job_put(3, "k")) == MODAL_OK);
    for (int i = 0; i < 3; i++)
        CHECK(one(ledger, (struct ledger_change) { .verb = LEDGER_TOMBSTONE_PUT, .tombstone =
                  { .user = i < 2 ? "ada" : "bob", .key = i == 1 ? "new" : "old" } })
              == MODAL_OK);
    CHECK(one(ledger, (struct ledger_change) { .verb = LEDGER_TOMBSTONE_DROP,
              .tombstone = { .user = "ada", .key = "new" } }) == MODAL_OK);
    CHECK(load(ledger).tombstones == 2);
    stop(ledger);
}

TEST(a_large_result_is_a_file_and_its_damage_is_reported)
{
    size_t length = LEDGER_RESULT_INLINE_MOST + 1, got;
    char *text = malloc(length), *back, path[128];
    struct ledger *ledger = start();
    struct ledger_change change = { .verb = LEDGER_RESULT_PUT };
    struct ledger_reader *reader;
    int fd;

    memset(text, 'x', length);
    CHECK(ledger_result_put(dir, 5, text, length, &change.result, NULL) == MODAL_OK);
    CHECK(change.result.text == NULL);
    CHECK(one(ledger, change) == MODAL_OK);
    CHECK(ledger_reader_open(dir, &reader, NULL) == MODAL_OK);
    CHECK(ledger_read_result(reader, 5, &back, &got, NULL) == MODAL_OK);
    CHECK(got == length && memcmp(text, back, length) == 0);
    free(back);
    snprintf(path, sizeof path, "%s/results/5.json", dir);
    fd = open(path, O_WRONLY);
    CHECK(pwrite(fd, "y", 1, 777) == 1);
    close(fd);
    CHECK(ledger_read_result(reader, 5, &back, &got, NULL) == MODAL_CORRUPT);
    CHECK(ledger_result_remove(dir, 5, NULL) == MODAL_OK);
    CHECK(ledger_read_result(reader, 5, &back, &got, NULL) == MODAL_CORRUPT);
    CHECK(ledger_result_remove(dir, 5, NULL) == MODAL_OK);
    ledger_reader_close(reader);
    free(text);
    stop(ledger);
}

/* F21 */
TEST(a_second_daemon_is_refused_on_the_folder_and_on_its_copy)
{
    struct ledger *ledger = start(), *second = NULL;
    struct modal_error err;
    char copy[80];

    CHECK(ledger_open(dir, &second, &err) == MODAL_BUSY);
    CHECK(strstr(err.message, "in use by the daemon with pid") != NULL);
    shell("cp -r %s %s.copy");
    snprintf(copy, sizeof copy, "%s.copy", dir);
    CHECK(ledger_open(copy, &second, &err) == MODAL_BUSY);
    CHECK(strstr(err.message, ledger_store_id(ledger)) != NULL);
    CHECK(second == NULL);
    ledger_close(ledger);
    /* alone, a copy is as good as the original */
    CHECK(ledger_open(copy, &second, NULL) == MODAL_OK);
    ledger_close(second);
    shell("rm -r %s %s.copy");
}

/* A process that a killed daemon was starting has its locks until its exec. */
TEST(a_folder_whose_lock_is_let_go_of_while_one_starts_is_opened)
{
    struct ledger *ledger = start();
    char path[128], held;
    int told[2], lock;
    pid_t pid;

    ledger_close(ledger);
    snprintf(path, sizeof path, "%s/LOCK", dir);
    CHECK(pipe(told) == 0);
    pid = fork();
    if (pid == 0) {
        lock = open(path, O_RDWR);
        held = lock >= 0 && flock(lock, LOCK_EX | LOCK_NB) == 0;
        usleep(write(told[1], &held, 1) == 1 ? 200000 : 0);
        _exit(0);
    }
    CHECK(read(told[0], &held, 1) == 1 && held);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    CHECK(waitpid(pid, NULL, 0) == pid);
    close(told[0]);
    close(told[1]);
    stop(ledger);
}

/* F20: what a later version wrote is refused, and left as it was. */
TEST(a_later_schema_and_a_foreign_database_are_refused)
{
    struct ledger *ledger = start(), *second = NULL;
    struct modal_error err;
    char path[128];
    sqlite3 *db;

    ledger_close(ledger);
    snprintf(path, sizeof path, "%s/ledger.db", dir);
    CHECK(sqlite3_open_v2(path, &db, SQLITE_OPEN_READWRITE, file_vfs()) == SQLITE_OK);
    CHECK(sqlite3_exec(db, "PRAGMA user_version=99", NULL, NULL, NULL) == SQLITE_OK);
    sqlite3_close(db);
    CHECK(ledger_open(dir, &second, &err) == MODAL_BAD_VERSION);
    CHECK(strstr(err.message, "99") != NULL);
    CHECK(sqlite3_open_v2(path, &db, SQLITE_OPEN_READWRITE, file_vfs()) == SQLITE_OK);
    CHECK(sqlite3_exec(db, "PRAGMA user_version=1; PRAGMA application_id=5", NULL, NULL, NULL) ==
          SQLITE_OK);
    sqlite3_close(db);
    CHECK(ledger_open(dir, &second, &err) == MODAL_CORRUPT);
    shell("rm -r %s");
}

static int says_ok(void *context, int columns, char **values, char **titles)
{
    (void)context;
    (void)titles;
    return columns == 1 && strcmp(values[0], "ok") == 0 ? 0 : 1;
}

/* Each page of the database carries a checksum: every flipped byte is found by reading all,
 * wherever it lies. */
TEST(a_flipped_bit_anywhere_in_the_database_is_reported)
{
    struct ledger *ledger = start(), *damaged = NULL;
    struct ledger_change group[20];
    char path[128];
    struct stat known;
    int fd, found = 0, tried = 0;
    unsigned char byte;
    int64_t left;

    for (int i = 0; i < 20; i++)
        group[i] = job_put(i + 1, NULL);
    CHECK(ledger_commit(ledger, group, 20, NULL) == MODAL_OK);
    CHECK(ledger_vacuum(ledger, 1, &left, NULL) == MODAL_OK);     /* the log goes to the database */
    ledger_close(ledger);
    shell("rm %s/ledger.db-wal");                                 /* else pages are read from it */
    snprintf(path, sizeof path, "%s/ledger.db", dir);
    CHECK(stat(path, &known) == 0);
    fd = open(path, O_RDWR);
    for (off_t at = 0; at < known.st_size; at += 211, tried++) {
        sqlite3 *db = NULL;
        bool good;
        CHECK(pread(fd, &byte, 1, at) == 1);
        byte ^= (unsigned char)(1 << at % 8);
        CHECK(pwrite(fd, &byte, 1, at) == 1);
        CHECK(sqlite3_open_v2(path, &db, SQLITE_OPEN_READWRITE, file_vfs()) == SQLITE_OK);
        good = sqlite3_exec(db, "PRAGMA integrity_check", says_ok, NULL, NULL) == SQLITE_OK;
        sqlite3_close(db);
        found += !good;
        byte ^= (unsigned char)(1 << at % 8);
        CHECK(pwrite(fd, &byte, 1, at) == 1);
    }
    CHECK(found == tried && tried > 100);
    byte = 0x7f;
    CHECK(pwrite(fd, &byte, 1, 4096 * 2 + 100) == 1);
    close(fd);
    if (ledger_open(dir, &damaged, NULL) == MODAL_OK) {     /* a page that opening does not need */
        struct ledger_visitor visitor = { .context = NULL };
        CHECK(ledger_load(damaged, &visitor, NULL) == MODAL_OK);
    }
    stop(damaged);
}

TEST(space_of_deleted_rows_is_given_back)
{
    struct ledger *ledger = start();
    char *big = malloc(60000), path[128];
    struct stat full, after;
    int64_t left = -1;

    memset(big, 'z', 60000);
    for (int i = 1; i <= 100; i++) {
        struct ledger_change change = { .verb = LEDGER_RESULT_PUT };
        ledger_result_put(dir, i, big, 60000, &change.result, NULL);
        one(ledger, change);
        CHECK(ledger_settle(ledger, NULL, NULL) == MODAL_OK);
    }
    CHECK(ledger_vacuum(ledger, 0, &left, NULL) == MODAL_OK);
    snprintf(path, sizeof path, "%s/ledger.db", dir);
    CHECK(stat(path, &full) == 0 && full.st_size > 6000000);
    for (int i = 1; i <= 100; i++) {
        struct ledger_change change = { .verb = LEDGER_JOB_DELETE };
        change.id = i;
        one(ledger, change);
    }
    do
        CHECK(ledger_vacuum(ledger, 500, &left, NULL) == MODAL_OK);
    while (left > 0);
    CHECK(stat(path, &after) == 0 && after.st_size < 200000);
    free(big);
    stop(ledger);
}

/* Restart in bounded time: the work of loading 100,000 jobs is well within the 5 s of the
 * contract. */
TEST(a_hundred_thousand_jobs_are_loaded_by_under_five_seconds_of_processor)
{
    enum { JOBS = 100000, GROUP = 1000 };
    struct ledger *ledger = start();
    struct ledger_change *group = calloc(GROUP, sizeof *group);
    char keys[GROUP][16];
    struct timespec from, to;
    struct seen seen;

    for (int i = 0; i < JOBS; i += GROUP) {
        for (int j = 0; j < GROUP; j++) {
            snprintf(keys[j], sizeof keys[j], "key-%d", i + j);
            group[j] = job_put(i + j + 1, keys[j]);
        }
        CHECK(ledger_commit(ledger, group, GROUP, NULL) == MODAL_OK);
        CHECK(ledger_settle(ledger, NULL, NULL) == MODAL_OK);
    }
    ledger_close(ledger);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &from);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    seen = load(ledger);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &to);
    CHECK(seen.jobs == JOBS && seen.states[JOB_QUEUED] == JOBS);
    CHECK((double)(to.tv_sec - from.tv_sec) + 1e-9 * (double)(to.tv_nsec - from.tv_nsec) < 5.0);
    free(group);
    stop(ledger);
}

static void unmark(void)
{
    char path[128];

    snprintf(path, sizeof path, "%s/ledger.db-mark", dir);
    CHECK(unlink(path) == 0);
}

/* One flipped bit in each frame of the log in turn is reported: of the last group, after which no
 * other tells that it was synced, by the mark; without the mark, which a crash may have kept from
 * the disk, of all groups but the last. */
TEST(damage_to_any_group_of_the_log_is_reported)
{
    struct ledger *ledger = start(), *opened = NULL;
    char path[128], copy[320];
    struct stat known;
    int fd, reported = 0, frames, before_last;
    long last;

    for (int i = 1; i <= 8; i++)
        CHECK(one(ledger, job_put(i, NULL)) == MODAL_OK);
    snprintf(path, sizeof path, "%s/ledger.db-wal", dir);
    CHECK(stat(path, &known) == 0);
    last = (long)known.st_size;
    CHECK(one(ledger, job_put(9, NULL)) == MODAL_OK);
    ledger_close(ledger);
    CHECK(stat(path, &known) == 0);
    frames = (int)((known.st_size - 32) / 4120);
    before_last = (int)((last - 32) / 4120);
    snprintf(copy, sizeof copy, "cp %s %s.whole", path, path);
    CHECK(system(copy) == 0);
    for (int i = -1; i < frames + before_last; i++) {
        int frame = i < frames ? i : i - frames;
        if (i == frames)
            unmark();
        off_t at = frame < 0 ? 20 : 32 + 4120 * (off_t)frame + (frame % 2 == 0 ? 1000 : 18);
        unsigned char byte;
        fd = open(path, O_RDWR);
        CHECK(fd >= 0 && pread(fd, &byte, 1, at) == 1);
        byte ^= 2;
        CHECK(pwrite(fd, &byte, 1, at) == 1);
        close(fd);
        reported += ledger_open(dir, &opened, NULL) == MODAL_CORRUPT;
        CHECK(opened == NULL);
        snprintf(copy, sizeof copy, "cp %s.whole %s", path, path);
        CHECK(system(copy) == 0);
    }
    CHECK(before_last >= 8 && frames > before_last && reported == frames + 1 + before_last);
    /* torn: the last group was never acknowledged, nor marked */
    CHECK(truncate(path, known.st_size - 100) == 0);
    CHECK(ledger_open(dir, &opened, NULL) == MODAL_OK);
    CHECK(load(opened).jobs == 8);
    stop(opened);
}

/* SQLite drops the log of a database without a page. */
TEST(a_database_that_was_emptied_or_is_gone_is_reported_while_its_log_has_groups)
{
    struct ledger *ledger = start(), *opened = NULL;
    struct modal_error err;
    char path[128];

    CHECK(one(ledger, job_put(1, NULL)) == MODAL_OK);
    ledger_close(ledger);
    shell("cp %s/ledger.db %s/whole");
    snprintf(path, sizeof path, "%s/ledger.db", dir);
    CHECK(truncate(path, 0) == 0);
    CHECK(ledger_open(dir, &opened, &err) == MODAL_CORRUPT && opened == NULL);
    CHECK(strstr(err.message, "ledger.db is empty") != NULL);
    CHECK(unlink(path) == 0);
    CHECK(ledger_open(dir, &opened, NULL) == MODAL_CORRUPT && opened == NULL);
    shell("mv %s/whole %s/ledger.db");
    CHECK(ledger_open(dir, &opened, NULL) == MODAL_OK);
    CHECK(load(opened).jobs == 1);
    stop(opened);
}

static void reads(int jobs)
{
    struct ledger *ledger = NULL;

    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    CHECK(load(ledger).jobs == jobs);
    ledger_close(ledger);
}

/* What the log had before it was moved to the database, as at leisure, nobody misses. */
TEST(a_log_that_was_emptied_or_is_gone_is_reported_unless_the_database_has_what_it_had)
{
    struct ledger *ledger = start(), *opened = NULL;
    struct modal_error err;
    char path[128];
    bool more;

    snprintf(path, sizeof path, "%s/ledger.db-wal", dir);
    CHECK(one(ledger, job_put(1, NULL)) == MODAL_OK);
    CHECK(ledger_idle(ledger, &more, NULL) == MODAL_OK && !more);
    ledger_close(ledger);
    reads(1);
    CHECK(unlink(path) == 0);
    reads(1);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    CHECK(one(ledger, job_put(2, NULL)) == MODAL_OK);
    ledger_close(ledger);
    shell("cp %s/ledger.db-wal %s/whole");
    CHECK(truncate(path, 0) == 0);
    CHECK(ledger_open(dir, &opened, &err) == MODAL_CORRUPT && opened == NULL);
    CHECK(strstr(err.message, "ledger.db-wal is empty or gone") != NULL);
    CHECK(truncate(path, 3 * 4120) == 0);                      /* zeros */
    CHECK(ledger_open(dir, &opened, NULL) == MODAL_CORRUPT && opened == NULL);
    CHECK(unlink(path) == 0);
    CHECK(ledger_open(dir, &opened, NULL) == MODAL_CORRUPT && opened == NULL);
    shell("cp %s/whole %s/ledger.db-wal");
    reads(2);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    CHECK(ledger_checkpoint(ledger, NULL) == MODAL_OK);
    ledger_close(ledger);
    CHECK(truncate(path, 0) == 0);
    reads(2);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    CHECK(one(ledger, job_put(3, NULL)) == MODAL_OK);
    ledger_close(ledger);
    CHECK(truncate(path, 0) == 0);
    CHECK(ledger_open(dir, &opened, NULL) == MODAL_CORRUPT && opened == NULL);
    unmark();                                                  /* as the message says */
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    CHECK(load(ledger).jobs == 2);
    stop(ledger);
}

/* Four jobs in four groups; *FRAMES: of the log. */
static struct ledger *start_log(char path[128], int *frames)
{
    struct ledger *ledger = start();
    struct stat known;

    for (int i = 1; i <= 4; i++)
        CHECK(one(ledger, job_put(i, NULL)) == MODAL_OK);
    snprintf(path, 128, "%s/ledger.db-wal", dir);
    CHECK(stat(path, &known) == 0);
    *frames = (int)((known.st_size - 32) / 4120);
    return ledger;
}

/* The log has its first FRAMES frames, all of them where these are below 1, and BYTES more or less.
 * One group more is not acknowledged, and nothing is moved to the database; the next start says so
 * too. */
static void cut_log(int frames, int bytes, bool commits)
{
    struct ledger *ledger, *opened = NULL;
    struct ledger_change change = job_put(5, NULL);
    struct modal_error err;
    char path[128];
    bool more;
    int all;

    ledger = start_log(path, &all);
    CHECK(truncate(path, frames < 0 ? 0 : 32 + 4120 * (frames < 1 ? all : frames) + bytes) == 0);
    if (commits)
        CHECK(ledger_commit(ledger, &change, 1, &err) == MODAL_CORRUPT);
    else
        CHECK(ledger_idle(ledger, &more, &err) == MODAL_CORRUPT);
    CHECK(strstr(err.message, "ledger.db-wal was made shorter") != NULL);
    CHECK(ledger_checkpoint(ledger, NULL) == MODAL_IO);
    ledger_close(ledger);
    CHECK(ledger_open(dir, &opened, NULL) == MODAL_CORRUPT && opened == NULL);
    shell("rm -r %s");
}

TEST(a_log_cut_under_the_daemon_is_told_before_anything_more_is_acknowledged)
{
    static const struct { int frames, bytes; } cuts[] = {
        { -1, 0 }, { 1, -4104 }, { 1, -4120 }, { 1, 0 }, { 0, -4120 }, { 0, -4100 }, { 0, -2000 },
    };

    for (size_t i = 0; i < sizeof cuts / sizeof *cuts; i++)
        for (int commits = 0; commits < 2; commits++)
            cut_log(cuts[i].frames, cuts[i].bytes, commits);
}

/* sqlite3 moves a log to the database and empties it, whoever else has it open. */
TEST(a_log_that_another_program_moved_to_the_database_is_not_missed)
{
    struct ledger *ledger = start();
    char path[128];
    sqlite3 *other;
    bool more;

    snprintf(path, sizeof path, "%s/ledger.db", dir);
    for (int i = 1; i <= 6; i++) {
        CHECK(one(ledger, job_put(i, NULL)) == MODAL_OK);
        CHECK(sqlite3_open_v2(path, &other, SQLITE_OPEN_READWRITE, NULL) == SQLITE_OK);
        CHECK(sqlite3_wal_checkpoint_v2(other, NULL, i % 2 ? SQLITE_CHECKPOINT_TRUNCATE
                                                           : SQLITE_CHECKPOINT_PASSIVE, NULL, NULL)
              == SQLITE_OK);
        CHECK(sqlite3_close(other) == SQLITE_OK);
        if (i % 3 == 0)
            CHECK(ledger_idle(ledger, &more, NULL) == MODAL_OK && !more);
    }
    ledger_close(ledger);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    CHECK(load(ledger).jobs == 6);
    stop(ledger);
}

/* What a power cut leaves when the log begins anew: the first bytes of the new header, whose
 * sequence number is one more, before all of the old life, which the database has.  It is cut off,
 * and from then on the mark tells nothing of the log: what the database has by and by is not what
 * the mark's last frame had. */
TEST(a_log_that_a_torn_beginning_leaves_empty_is_not_missed_afterwards)
{
    struct ledger *ledger = start();
    unsigned char header[32], mark[32];
    char path[128], of_mark[128];
    FILE *file;

    snprintf(path, sizeof path, "%s/ledger.db-wal", dir);
    snprintf(of_mark, sizeof of_mark, "%s/ledger.db-mark", dir);
    CHECK(one(ledger, job_put(1, NULL)) == MODAL_OK);
    CHECK(ledger_checkpoint(ledger, NULL) == MODAL_OK);
    ledger_close(ledger);
    file = fopen(path, "r+");
    CHECK(file != NULL && fread(header, 1, sizeof header, file) == sizeof header);
    header[15]++;
    rewind(file);
    CHECK(fwrite(header, 1, sizeof header, file) == sizeof header);
    CHECK(fclose(file) == 0);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    file = fopen(of_mark, "r");
    CHECK(file != NULL && fread(mark, 1, sizeof mark, file) == sizeof mark);
    fclose(file);
    for (int i = 4; i < 28; i++)
        CHECK(mark[i] == 0);
    stop(ledger);
}
