/* test_spool_thread.c - the spool's threads: in which order they give tasks back while streams with
 * long gaps are sealed */
/* Tests as well: queue.c sums.c fair_queue.c */
#include "check.h"
#include <dirent.h>
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include "broker/shell/queue.h"
#include "base/crc32c.h"
#include "store/file.h"
#include "store/samples.h"

enum { STREAMS = 4, GAP = 4 << 20 /* samples, 32 MiB */, SHORT = STREAMS };

static char dir[64];
static struct done_queue done;
static struct spool_threads *threads;
static struct ledger *ledger;

/* STREAMS streams of a sample, a gap and a sample, and a short one without a gap,
 * in a ledger of their own. */
static void start(void)
{
    static const double x[2] = { 2.5, -3.75 };
    static char names[STREAMS + 1][12];
    struct ledger_change changes[3 * (STREAMS + 1)],
                         settle = { .verb = LEDGER_SAMPLES_SETTLE };
    int n = 0;

    snprintf(dir, sizeof dir, "/tmp/modald-test-XXXXXX");
    CHECK(mkdtemp(dir) != NULL && ledger_open(dir, &ledger, NULL) == MODAL_OK);
    for (int s = 0; s <= STREAMS; s++) {
        snprintf(names[s], sizeof names[s], "%d", s + 1);
        changes[n++] = (struct ledger_change) { .verb = LEDGER_NOTE_PUT,
                                                .note = { "stream", names[s], "{}" } };
        for (int i = 0; i < 2; i++)
            changes[n++] = (struct ledger_change) { .verb = LEDGER_SEGMENT_PUT, .segment = {
                .stream = s + 1,
                .first = i == 0 ? 0 : s == SHORT ? 1 : GAP + 1, .count = 1,
                .offset = 8 * (uint64_t)i, .length = 8,
                .crc = crc32c(0, &x[i], 8), .data = &x[i] } };
    }
    CHECK(ledger_commit(ledger, changes, (size_t)n, NULL) == MODAL_OK);
    CHECK(ledger_commit(ledger, &settle, 1, NULL) == MODAL_OK);
    CHECK(done_open(&done));
    threads = spool_threads_start(dir, 1, &done);
    CHECK(threads != NULL);
}

static void stop(void)
{
    char command[96];

    spool_threads_stop(threads);
    done_close(&done);
    ledger_close(ledger);
    snprintf(command, sizeof command, "rm -r %s", dir);
    CHECK(system(command) == 0);
}

static void put_seal(int stream, uint64_t turn)
{
    struct task *task = calloc(1, sizeof *task);

    task->type = TASK_STREAM_SEAL;
    task->fair.turn = turn;
    task->id = 100 + stream;
    task->stream = stream + 1;
    task->missing = stream == SHORT ? 0 : 8 * (uint64_t)GAP;
    task->shape = (struct input_shape) { .type = INPUT_BATCH,
                                         .samples = stream == SHORT ? 2 : GAP + 2, .channels = 1,
                                         .dt = 0.5 };
    spool_threads_put(threads, task);
}

static void put_begin(int64_t id)
{
    struct task *task = calloc(1, sizeof *task);

    task->type = TASK_BEGIN;
    task->id = id;
    task->shape = (struct input_shape) { .type = INPUT_BATCH, .samples = 100, .channels = 1,
                                         .dt = 0.5 };
    spool_threads_put(threads, task);
}

/* The ids of the next COUNT tasks that come back, all of them done. */
static void take(int count, int64_t *ids)
{
    struct transaction *transactions;
    struct task *tasks = NULL, *task;
    bool pinged, stuck, fatal;

    for (int n = 0; n < count;) {
        struct pollfd wake = { .fd = done.wake, .events = POLLIN };
        CHECK(poll(&wake, 1, 60000) == 1);
        done_take(&done, &transactions, &tasks, &pinged, &stuck, &fatal);
        CHECK(!fatal);
        while ((task = tasks) != NULL) {
            tasks = task->next;
            CHECK(task->status == MODAL_OK && n < count);
            ids[n++] = task->id;
            if (task->type == TASK_STREAM_SEAL) {
                uint64_t end = 0;
                for (size_t i = 0; i < task->sums.count; i++) {
                    CHECK(task->sums.items[i].offset == end
                          && task->sums.items[i].length <= LEDGER_CHUNK_MOST);
                    end += task->sums.items[i].length;
                }
                CHECK(end == 8 * task->shape.samples);
            } else
                upload_close(task->upload);
            task_free(task);
        }
    }
}

/* One thread for all other tasks: on the code of before it sealed one stream after the other, and
 * then began the uploads. */
TEST(uploads_begin_and_a_short_stream_is_sealed_while_long_gaps_of_others_are_written)
{
    int64_t ids[STREAMS + 3];

    start();
    for (int s = 0; s < STREAMS; s++)
        put_seal(s, 1);
    put_begin(7);
    put_begin(8);
    put_seal(SHORT, 2);
    take(STREAMS + 3, ids);
    for (int i = 0; i < 3; i++)
        CHECK(ids[i] == 7 || ids[i] == 8 || ids[i] == 100 + SHORT);
    stop();
}

/* Its samples, and the folder with its name: who waits for a close waits for these.  On the code of
 * before its file was synced empty and once more when it was named, and the folder too, although
 * nobody goes on with a seal. */
TEST(a_short_stream_is_sealed_with_one_sync_of_its_file_and_one_of_the_folder)
{
    int64_t id;
    bool faults;

    start();
    faults = file_fault("unlink:1000:EIO");        /* then syncs are counted, where they can be */
    put_seal(SHORT, 2);
    take(1, &id);
    CHECK(id == 100 + SHORT);
    CHECK(!faults || (file_fault_count(FILE_FDATASYNC) == 1 && file_fault_count(FILE_FSYNC) == 1));
    file_fault(NULL);
    stop();
}

TEST(an_end_waits_for_one_slice_and_not_for_the_seals)
{
    char path[128];
    struct stat known;
    int64_t first;

    start();
    for (int s = 0; s < STREAMS; s++)
        put_seal(s, 1);
    put_seal(SHORT, 2);
    take(1, &first);       /* by then each of the others has had its first slice, of four or more */
    CHECK(first == 100 + SHORT);
    spool_threads_stop(threads);
    for (int s = 0; s < STREAMS; s++) {
        snprintf(path, sizeof path, "%s/spool/%d.h5", dir, 100 + s);
        CHECK(stat(path, &known) != 0);            /* not sealed: its .part is an orphan, which the
                                                      next start removes */
    }
    threads = NULL;
    stop();
}

TEST(a_seal_with_gaps_leaves_room_on_the_disk_for_the_ledger)
{
    struct task *tasks = NULL, *task = calloc(1, sizeof *task);
    struct transaction *transactions;
    bool pinged, stuck, fatal;

    start();
    task->type = TASK_STREAM_SEAL;
    task->id = 100;
    task->stream = 1;
    task->missing = UINT64_C(1) << 60;             /* more than any disk has */
    task->shape = (struct input_shape) { .type = INPUT_BATCH, .samples = (UINT64_C(1) << 57) + 2,
                                         .channels = 1, .dt = 0.5 };
    spool_threads_put(threads, task);
    while (tasks == NULL) {
        struct pollfd wake = { .fd = done.wake, .events = POLLIN };
        CHECK(poll(&wake, 1, 60000) == 1);
        done_take(&done, &transactions, &tasks, &pinged, &stuck, &fatal);
    }
    CHECK(tasks->status == MODAL_STORAGE_FULL && tasks->total > 0 && tasks->upload == NULL);
    task_free(tasks);
    stop();
}

static void put_question(int64_t id, uint64_t turn)
{
    struct task *task = calloc(1, sizeof *task);

    task->type = TASK_ROOM;
    task->id = id;
    task->fair.turn = turn;
    spool_threads_put(threads, task);
}

static int gate[2], reached[2];

/* A signal's: whoever gets it waits until the gate is opened. */
static void wait_at_gate(int number)
{
    char c = 0;

    (void)number;
    while (write(reached[1], &c, 1) < 0 && errno == EINTR)
        ;
    while (read(gate[0], &c, 1) < 0 && errno == EINTR)
        ;
}

/* The threads of this process into TID, TIDS_MOST at most: their number. */
enum { TIDS_MOST = 256 };
static int threads_now(int tid[TIDS_MOST])
{
    DIR *folder = opendir("/proc/self/task");
    struct dirent *entry;
    int count = 0;

    CHECK(folder != NULL);
    while ((entry = readdir(folder)) != NULL && count < TIDS_MOST)
        if (entry->d_name[0] != '.')
            tid[count++] = atoi(entry->d_name);
    closedir(folder);
    return count;
}

/* start(), and its threads stand at the gate: how many. */
static int start_at_gate(void)
{
    struct sigaction action = { .sa_handler = wait_at_gate };
    int before[TIDS_MOST], now[TIDS_MOST], had = threads_now(before), has, stopped = 0;
    char c;

    CHECK(pipe(gate) == 0 && pipe(reached) == 0 && sigaction(SIGUSR2, &action, NULL) == 0);
    start();
    has = threads_now(now);
    for (int i = 0; i < has; i++) {
        bool known = false;
        for (int k = 0; k < had; k++)
            known |= before[k] == now[i];
        if (!known) {
            CHECK(syscall(SYS_tgkill, getpid(), now[i], SIGUSR2) == 0);
            CHECK(read(reached[0], &c, 1) == 1);
            stopped++;
        }
    }
    CHECK(stopped > 0);
    return stopped;
}

/* Threads stand still until all have put up theirs: then it is known in which order the one that
 * is not the seals' takes them. */
TEST(the_first_task_of_a_user_waits_for_one_of_each_other_user_however_many_those_have)
{
    enum { MANY = 500, OTHER = 9000 };
    int64_t ids[2 * MANY + 1];
    int place = 0, threads_stopped = start_at_gate();

    for (int i = 0; i < MANY; i++) {
        put_question(100 + i, 1);
        put_question(100 + MANY + i, 2);
    }
    put_question(OTHER, 3);
    for (int i = 0; i < threads_stopped; i++)
        CHECK(write(gate[1], "", 1) == 1);
    take(2 * MANY + 1, ids);
    while (ids[place] != OTHER)
        place++;
    CHECK(place <= 2);            /* behind one of 1 and one of 2 at most */
    for (int last = -1, i = 0; i < 2 * MANY + 1; i++)
        if (ids[i] >= 100 && ids[i] < 100 + MANY) {
            CHECK(ids[i] > last);                  /* of one user in their order */
            last = (int)ids[i];
        }
    stop();
}
