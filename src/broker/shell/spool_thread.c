/*
 * spool_thread.c - tasks on files: chunks, seals, results, and reading beside the ledger's thread
 *
 * Chunks are hashed by another thread while one writes and syncs them: a thread that has chunks
 * offers their hashing, any idle thread takes it, and where none did the first does it itself
 * while the disk is busy.
 *
 * Users have their tasks done in turn, and their seals too: whoever puts up many waits for them
 * himself (fair_queue.h).
 *
 * Streams are sealed by a thread of their own, in slices, each of all that wait in turn: a seal
 * writes as much as a stream may be long, and neither another's chunk nor another's short stream
 * waits for the end of that.  Several short ones are one slice, whose names are synced once.  A
 * seal that is cut off begins anew, so nothing of it but its end need be durable.
 */
#include "base/crc32c.h"
#include "broker/shell/queue.h"
#include "broker/kit/fair_queue.h"
#include "store/file.h"
#include "store/samples.h"
#include "wire/protocol.h"
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

enum {
    THREADS_MOST = 16,            /* more than a disk has requests at once */
    SLICE_BYTES = 8 << 20,        /* of seals, written and synced before others' turn */
    ROUND_SEALS = 16,             /* of 128 files that a daemon keeps for itself */
};

/* Chunks to be hashed, on the stack of the thread that writes them. */
struct hashing {
    struct hashing *next;
    struct upload *upload;
    const struct upload_part *parts;
    size_t count;
    enum { OFFERED, TAKEN, HASHED } state;
};

struct spool_threads {
    pthread_t threads[THREADS_MOST];
    int count;
    pthread_mutex_t mutex;
    pthread_cond_t more, hashed;
    struct hashing *offers;
    struct fair_queue tasks, seals;
    pthread_t sealer;
    pthread_cond_t sealable;
    bool stop;
    const char *dir;
    struct done_queue *done;
};

/* ---- one task -------------------------------------------------------------------------------- */

struct rows { struct chunk_record *items; size_t count, room; };

static enum modal_status add_row(void *context, const struct chunk_record *row)
{
    struct rows *rows = context;

    if (rows->count == rows->room) {
        size_t room = rows->room ? 2 * rows->room : 256;
        struct chunk_record *items = realloc(rows->items, room * sizeof *items);
        if (items == NULL)
            return MODAL_NO_MEMORY;
        rows->items = items;
        rows->room = room;
    }
    rows->items[rows->count++] = *row;
    return MODAL_OK;
}

/* Bytes free into TOTAL, but for what the ledger was given of the reserve's last part: that is for
 * what must pass alone, and whoever took it would make every cancel wait for room. */
static enum modal_status find_room(const char *dir, struct task *task)
{
    struct statvfs known;
    uint64_t free_bytes, given;

    if (statvfs(dir, &known) != 0)
        return modal_fail(&task->err, MODAL_IO, "%s: %s", dir, strerror(errno));
    free_bytes = (uint64_t)known.f_bavail * known.f_frsize;
    given = reserve_lacks(dir, RESERVE_LAST);
    task->total = free_bytes > given ? free_bytes - given : 0;
    return MODAL_OK;
}

/* Is there room for BYTES?  Else MODAL_STORAGE_FULL. */
static enum modal_status need_room(const char *dir, struct task *task, uint64_t bytes)
{
    enum modal_status rc = find_room(dir, task);

    if (rc == MODAL_OK && task->total < bytes)
        rc = modal_fail(&task->err, MODAL_STORAGE_FULL, "no room for %llu bytes",
                        (unsigned long long)bytes);
    return rc;
}

/* An upload has its room from its beginning, filled or not.  What one user's have and have not
 * filled is half at most of all that is not filled: n who take what they can leave 1/2^n of it to
 * the next, and one alone cannot keep everybody else out.  What is filled counts by its bytes. */
static enum modal_status need_share(struct task *task)
{
    uint64_t half = (task->total + task->reserved - task->pending) / 2;
    uint64_t bytes = input_bytes(&task->shape);

    uint64_t most = half > task->reserved ? half - task->reserved : 0;

    task->over_share = !task->whole && bytes > most;
    if (!task->over_share)
        return MODAL_OK;
    return modal_fail(&task->err, MODAL_STORAGE_FULL,
                      "an upload of %llu bytes; accepted: at most %llu for now, as those of one "
                      "user that are not filled have half of the disk's room",
                      (unsigned long long)bytes, (unsigned long long)most);
}

static enum modal_status begin_upload(const char *dir, struct task *task)
{
    enum modal_status rc = need_room(dir, task, input_bytes(&task->shape));

    if (rc == MODAL_OK)
        rc = need_share(task);
    if (rc == MODAL_OK)
        rc = upload_begin(dir, task->id, &task->shape, &task->upload, &task->err);
    if (rc == MODAL_OK) {
        task->offset = upload_offset(task->upload);
        rc = upload_keep(task->upload, &task->err);
    }
    return rc;
}

static enum modal_status resume(const char *dir, struct ledger_reader *reader, struct task *task)
{
    struct rows rows = { NULL, 0, 0 };
    enum modal_status rc;

    upload_close(task->upload);                    /* one whose last write failed */
    task->upload = NULL;
    rc = ledger_read_chunks(reader, task->id, 0, UINT64_MAX, add_row, &rows, &task->err);
    if (rc == MODAL_OK)
        rc = upload_resume(dir, task->id, &task->shape, rows.items, rows.count, &task->upload,
                           &task->err);
    free(rows.items);
    return rc;
}

static void offer(struct spool_threads *s, struct hashing *h)
{
    pthread_mutex_lock(&s->mutex);
    h->next = s->offers;
    s->offers = h;
    pthread_cond_signal(&s->more);
    pthread_mutex_unlock(&s->mutex);
}

/* Under the mutex: H, or with NULL any offer, is the caller's to hash; NULL: somebody has it, or
 * there is none. */
static struct hashing *find_offer(struct spool_threads *s, const struct hashing *h)
{
    struct hashing **link = &s->offers, *found;

    while (*link != NULL && h != NULL && *link != h)
        link = &(*link)->next;
    found = *link;
    if (found != NULL) {
        *link = found->next;
        found->state = TAKEN;
    }
    return found;
}

static void hash(struct spool_threads *s, struct hashing *h)
{
    upload_hash(h->upload, h->parts, h->count);
    pthread_mutex_lock(&s->mutex);
    h->state = HASHED;
    pthread_cond_broadcast(&s->hashed);
    pthread_mutex_unlock(&s->mutex);
}

/* Hash it where nobody has begun. */
static void hash_own(struct spool_threads *s, struct hashing *h)
{
    bool mine;

    pthread_mutex_lock(&s->mutex);
    mine = find_offer(s, h) != NULL;
    pthread_mutex_unlock(&s->mutex);
    if (mine)
        hash(s, h);
}

static void hash_wait(struct spool_threads *s, struct hashing *h)
{
    pthread_mutex_lock(&s->mutex);
    while (h->state != HASHED)
        pthread_cond_wait(&s->hashed, &s->mutex);
    pthread_mutex_unlock(&s->mutex);
}

static enum modal_status write_chunks(struct spool_threads *s, struct task *task)
{
    struct upload_part parts[sizeof task->chunks / sizeof *task->chunks];
    struct hashing own = { .upload = task->upload, .parts = parts, .count = (size_t)task->count };
    enum modal_status rc;

    for (int i = 0; i < task->count; i++)
        parts[i] =
            (struct upload_part) { task->chunks[i]->data, task->chunks[i]->size, task->crcs[i] };
    offer(s, &own);
    rc = upload_write(task->upload, task->offset, parts, (size_t)task->count, &task->err);
    hash_own(s, &own);
    if (rc == MODAL_OK)
        rc = upload_sync(task->upload, &task->err);
    hash_wait(s, &own);
    return rc;
}

/* By END, which may leave the folder to be synced. */
static enum modal_status seal(struct task *task,
                              enum modal_status (*end)(struct upload *, uint8_t sha256[32],
                                                       struct modal_error *))
{
    enum modal_status rc = end(task->upload, task->sha256, &task->err);

    if (rc == MODAL_OK) {
        task->crc = upload_crc(task->upload);
        task->offset = upload_offset(task->upload);
    }
    return rc;
}

/* A stream's segments, one after the other; LEFT: bytes that this slice of a seal may yet write. */
struct reading { struct task *task; int fd; uint64_t left; bool more; char *block; };

static enum modal_status append(struct reading *s, const void *data, size_t length, uint32_t crc)
{
    struct task *task = s->task;
    struct upload_part part = { data, length, crc };
    enum modal_status rc = upload_write(task->upload, task->written, &part, 1, &task->err);

    if (rc == MODAL_OK)
        upload_hash(task->upload, &part, 1);
    if (rc == MODAL_OK)
        rc = sums_add(&task->sums, length, crc, &task->err);
    task->written += length;
    s->left -= length < s->left ? length : s->left;
    return rc;
}

/* Samples that never came are NaN, which no job takes for data: BYTES of them, as far as the
 * slice goes. */
static enum modal_status append_gap(struct reading *s, uint64_t bytes)
{
    double nan[4096];
    uint32_t crc;
    enum modal_status rc = MODAL_OK;

    if (bytes == 0)
        return MODAL_OK;
    for (size_t i = 0; i < sizeof nan / sizeof *nan; i++)
        nan[i] = NAN;
    crc = crc32c(0, nan, sizeof nan);
    while (rc == MODAL_OK && bytes > 0 && s->left > 0) {
        size_t part = bytes < sizeof nan ? (size_t)bytes : sizeof nan;
        rc = append(s, nan, part, part == sizeof nan ? crc : crc32c(0, nan, part));
        bytes -= part;
    }
    return rc;
}

/* One segment, if it is of the epoch, behind those before and what is missing between;
 * MODAL_BUSY: the slice is over. */
static enum modal_status add_segment(void *context, const struct segment_record *segment)
{
    struct reading *s = context;
    struct task *task = s->task;
    uint64_t place = (segment->first - task->begin) * 8 * task->shape.channels;
    bool ours = segment->epoch == task->epoch;
    enum modal_status rc = MODAL_OK;

    if (ours && (segment->length != segment->count * 8 * task->shape.channels
                 || segment->length > WIRE_CHUNK_MOST
                 || place < task->written))
        return modal_fail(&task->err, MODAL_CORRUPT,
                          "a segment of stream %lld has %llu bytes for %llu samples from %llu on",
                          (long long)task->stream, (unsigned long long)segment->length,
                          (unsigned long long)segment->count,
                          (unsigned long long)segment->first);
    if (ours)
        rc = append_gap(s, place - task->written);
    s->more = rc == MODAL_OK && s->left == 0;
    if (s->more)
        return MODAL_BUSY;
    if (rc == MODAL_OK && ours)
        rc = samples_get(s->fd, segment, s->block, &task->err);
    if (rc == MODAL_OK && ours)
        rc = append(s, s->block, segment->length, segment->crc);
    task->next_segment = segment->offset + segment->length;
    return rc;
}

/* The segments of R's stream from its file's offset FROM on to VISIT, with the file open. */
static enum modal_status read_segments(const char *dir, struct ledger_reader *reader,
                                       struct reading *r, uint64_t from,
                                       enum modal_status (*visit)(void *context,
                                                                  const struct segment_record *))
{
    struct task *task = r->task;
    char path[4200];
    enum modal_status rc;

    r->fd = -1;
    r->block = malloc(WIRE_CHUNK_MOST);
    rc = r->block != NULL ? MODAL_OK : modal_fail(&task->err, MODAL_NO_MEMORY, "out of memory");
    samples_path(path, dir, task->stream);
    if (rc == MODAL_OK)
        rc = file_open(path, O_RDONLY, 0, &r->fd, &task->err);
    if (rc == MODAL_OK)
        rc = ledger_read_segments(reader, task->stream, from, visit, r, &task->err);
    if (r->fd >= 0)
        close(r->fd);
    free(r->block);
    return rc;
}

/* What was sent is on this disk already; what gaps take besides must leave room for the ledger,
 * as the reserve does. */
static enum modal_status begin_seal(const char *dir, struct task *task)
{
    uint64_t bytes = input_bytes(&task->shape), least = RESERVE_BYTES / 4;
    uint64_t beside = task->missing < least ? task->missing : least;
    enum modal_status rc = need_room(dir, task, bytes + beside);

    if (rc != MODAL_OK)
        return rc;
    return upload_begin(dir, task->id, &task->shape, &task->upload, &task->err);
}

/* Some more of a stream's batch, *LEFT bytes at most, of which it takes its own; *MORE: there is
 * more to do. */
static enum modal_status write_slice(const char *dir, struct ledger_reader *reader,
                                     struct task *task, uint64_t *left, bool *more)
{
    struct reading r = { .task = task, .left = *left };
    enum modal_status rc = task->upload != NULL ? MODAL_OK : begin_seal(dir, task);

    if (rc == MODAL_OK)
        rc = read_segments(dir, reader, &r, task->next_segment, add_segment);
    *left = r.left;
    *more = r.more;
    return r.more ? MODAL_OK : rc;
}

/* What was written is synced; where that is all, it is sealed but for its name in the folder. */
static void end_slice(const char *dir, struct task *task, bool *more)
{
    if (*more && task->status == MODAL_OK)
        task->status = upload_sync(task->upload, &task->err);
    *more &= task->status == MODAL_OK;
    if (*more)
        return;
    if (task->status == MODAL_OK)
        task->status = seal(task, upload_name);    /* which syncs it, too */
    upload_close(task->upload);
    task->upload = NULL;
    if (task->status != MODAL_OK && task->status != MODAL_IO)
        spool_remove(dir, task->id, NULL);
}

/* What SEGMENT has of the samples that are wanted is in r->block from *DATA on: *BYTES, which may
 * be none, the first *AT bytes after the first that is wanted. */
static enum modal_status get_wanted(struct reading *r, const struct segment_record *segment,
                                    uint64_t *at, uint64_t *bytes, const char **data)
{
    struct task *task = r->task;
    uint64_t size = 8 * task->shape.channels, end = task->begin + task->length,
             from = segment->first > task->begin ? segment->first : task->begin,
             to = segment->first + segment->count < end ? segment->first + segment->count : end;

    *data = r->block;
    *at = (from - task->begin) * size;
    *bytes = 0;
    if (segment->epoch != task->epoch || from >= to)
        return MODAL_OK;
    *bytes = (to - from) * size;
    *data += (from - segment->first) * size;
    if (segment->length != segment->count * size || segment->length > WIRE_CHUNK_MOST)
        return modal_fail(&task->err, MODAL_CORRUPT,
                          "a segment of stream %lld has %llu bytes for %llu samples",
                          (long long)task->stream, (unsigned long long)segment->length,
                          (unsigned long long)segment->count);
    return samples_get(r->fd, segment, r->block, &task->err);
}

static enum modal_status compare_segment(void *context, const struct segment_record *segment)
{
    struct reading *r = context;
    struct task *task = r->task;
    uint64_t at, bytes;
    const char *data;
    enum modal_status rc = get_wanted(r, segment, &at, &bytes, &data);

    if (rc == MODAL_OK && !task->differs)
        task->differs = memcmp(data, (const char *)task->chunks[0]->data + at, bytes) != 0;
    return rc;
}

static enum modal_status copy_segment(void *context, const struct segment_record *segment)
{
    struct reading *r = context;
    uint64_t at, bytes;
    const char *data;
    enum modal_status rc = get_wanted(r, segment, &at, &bytes, &data);

    if (rc == MODAL_OK)
        memcpy((char *)r->task->text->data + at, data, bytes);
    return rc;
}

static enum modal_status read_samples(const char *dir, struct ledger_reader *reader,
                                      struct task *task)
{
    struct reading r = { .task = task };
    const size_t bytes = task->length * 8 * task->shape.channels;

    task->text = blob_take(calloc(1, bytes), bytes);
    if (task->text == NULL)
        return modal_fail(&task->err, MODAL_NO_MEMORY, "out of memory");
    return read_segments(dir, reader, &r, 0, copy_segment);
}

static enum modal_status compare_samples(const char *dir, struct ledger_reader *reader,
                                         struct task *task)
{
    struct reading r = { .task = task };

    return read_segments(dir, reader, &r, 0, compare_segment);
}

static enum modal_status put_result(const char *dir, struct task *task)
{
    const struct blob *text = task->text;
    enum modal_status rc = need_room(dir, task, text->size);

    if (rc != MODAL_OK)
        return rc;
    return ledger_result_put(dir, task->id, text->data, text->size, &task->record, &task->err);
}

/* The part [offset, offset + length) of DATA, which is freed. */
static enum modal_status cut(struct task *task, char *data, size_t length)
{
    size_t from = task->offset < length ? (size_t)task->offset : length;
    size_t size = length - from < task->length ? length - from : (size_t)task->length;

    task->total = length;
    if (from == 0 && size == length)
        task->text = blob_take(data, length);
    else {
        task->text = blob_copy(data + from, size);
        free(data);
    }
    return task->text == NULL ? modal_fail(&task->err, MODAL_NO_MEMORY, "out of memory") : MODAL_OK;
}

static enum modal_status read_row(struct ledger_reader *reader, struct task *task)
{
    char *data = NULL;
    size_t length = 0;
    enum modal_status rc = task->type == TASK_READ_RESULT
                               ? ledger_read_result(reader, task->id, &data, &length, &task->err)
                           : task->type == TASK_READ_STDERR
                               ? ledger_read_stderr(reader, task->id, &data, &length, &task->err)
                               : ledger_read_input(reader, task->id, &data, &length, &task->err);

    return rc == MODAL_OK ? cut(task, data, length) : rc;
}

/* A part of a sealed input, held against its checksums. */
static enum modal_status read_spool(const char *dir, struct ledger_reader *reader,
                                    struct task *task)
{
    const struct sealed_input input = { task->id, task->begin, task->total, task->crc };
    char *data = NULL;
    size_t got = 0;
    enum modal_status rc = sums_read(dir, reader, &input, task->offset, task->length, &data, &got,
                                     &task->sums, &task->err);

    if (rc != MODAL_OK)
        return rc;
    task->text = blob_take(data, got);
    return task->text == NULL ? modal_fail(&task->err, MODAL_NO_MEMORY, "out of memory") : MODAL_OK;
}

static enum modal_status open_input(const char *dir, struct task *task)
{
    char path[4096];
    enum modal_status rc;

    spool_path(path, dir, task->id);
    rc = file_open(path, O_RDONLY, 0, &task->descriptor, &task->err);
    return rc == MODAL_NOT_FOUND
               ? modal_fail(&task->err, MODAL_CORRUPT, "%s is missing", path) : rc;
}

static enum modal_status add_event(void *context, const struct event_record *r)
{
    struct task *task = context;
    struct event_row *rows = realloc(task->events, (size_t)(task->event_count + 1) * sizeof *rows);

    if (rows == NULL)
        return MODAL_NO_MEMORY;
    task->events = rows;
    rows[task->event_count++] = (struct event_row) {
        .number = r->number, .ns = r->ns, .job = r->job, .user = r->user ? strdup(r->user) : NULL,
        .topic = r->topic ? strdup(r->topic) : NULL, .text = strdup(r->text) };
    return rows[task->event_count - 1].text == NULL ? MODAL_NO_MEMORY : MODAL_OK;
}

static enum modal_status do_task(struct spool_threads *s, struct ledger_reader *reader,
                                 struct task *task)
{
    const char *dir = s->dir;

    switch (task->type) {
    case TASK_BEGIN:         return begin_upload(dir, task);
    case TASK_RESUME:        return resume(dir, reader, task);
    case TASK_WRITE:         return write_chunks(s, task);
    case TASK_SEAL:          return seal(task, upload_seal);
    case TASK_STREAM_SEAL:   break;                /* by the sealer, in slices */
    case TASK_CLOSE:         upload_close(task->upload); task->upload = NULL; return MODAL_OK;
    case TASK_REMOVE_INPUT:  return spool_remove(dir, task->id, &task->err);
    case TASK_SAMPLES_COMPARE: return compare_samples(dir, reader, task);
    case TASK_SAMPLES_READ:  return read_samples(dir, reader, task);
    case TASK_REMOVE_SAMPLES: return samples_remove(dir, task->id, &task->err);
    case TASK_RESULT_PUT:    return put_result(dir, task);
    case TASK_REMOVE_RESULT: return ledger_result_remove(dir, task->id, &task->err);
    case TASK_READ_RESULT:
    case TASK_READ_STDERR:
    case TASK_READ_INPUT:
        return read_row(reader, task);
    case TASK_BATCH_READ:
    case TASK_READ_SPOOL:    return read_spool(dir, reader, task);
    case TASK_ROOM:          return find_room(dir, task);
    case TASK_OPEN_INPUT:    return open_input(dir, task);
    case TASK_READ_EVENTS:
        return ledger_read_events(reader, (int64_t)task->offset, task->user, (int)task->length,
                                  add_event, task, &task->err);
    }
    return modal_fail(&task->err, MODAL_INTERNAL, "unknown task");
}

/* Whether a failure of this task means that stable storage cannot be trusted any more. */
static bool is_fatal(const struct task *task)
{
    bool writes = task->type == TASK_BEGIN || task->type == TASK_WRITE || task->type == TASK_SEAL
                  || task->type == TASK_STREAM_SEAL || task->type == TASK_RESULT_PUT;

    return writes && task->status == MODAL_IO;
}

/* ---- the threads ----------------------------------------------------------------------------- */

/* The next task; *OFFERED instead, where somebody's chunks want hashing; neither: stop. */
static struct task *next_task(struct spool_threads *s, struct hashing **offered)
{
    struct task *task;

    pthread_mutex_lock(&s->mutex);
    while (s->tasks.first == NULL && s->offers == NULL && !s->stop)
        pthread_cond_wait(&s->more, &s->mutex);
    *offered = find_offer(s, NULL);
    task = *offered != NULL ? NULL : (struct task *)fair_queue_take(&s->tasks, NULL, NULL);
    pthread_mutex_unlock(&s->mutex);
    return task;
}

/* The task is the loop's again. */
static void give_back(struct spool_threads *s, struct task *task, const struct timespec *begun)
{
    struct timespec ended;

    clock_gettime(CLOCK_MONOTONIC, &ended);
    if (task->status == MODAL_STORAGE_FULL)
        find_room(s->dir, task);
    task->took_ns += (ended.tv_sec - begun->tv_sec) * INT64_C(1000000000)
                   + ended.tv_nsec - begun->tv_nsec;
    if (is_fatal(task))
        done_fatal(s->done, &task->err);
    done_task(s->done, task);
}

static void *run(void *context)
{
    struct spool_threads *s = context;
    struct ledger_reader *reader = NULL;
    struct modal_error err;
    struct hashing *offered;
    struct timespec begun;
    struct task *task;

    if (ledger_reader_open(s->dir, &reader, &err) != MODAL_OK) {
        done_fatal(s->done, &err);
        return NULL;
    }
    while ((task = next_task(s, &offered)) != NULL || offered != NULL) {
        if (offered != NULL) {
            hash(s, offered);
            continue;
        }
        clock_gettime(CLOCK_MONOTONIC, &begun);
        task->status = do_task(s, reader, task);
        give_back(s, task, &begun);
    }
    ledger_reader_close(reader);
    return NULL;
}

/* The seal whose turn it is; NULL: stop, and what is not sealed is sealed after the next start, or
 * there is none, where it is not to be AWAITED. */
static struct task *next_seal(struct spool_threads *s, bool awaited)
{
    struct task *task;

    pthread_mutex_lock(&s->mutex);
    while (s->seals.first == NULL && !s->stop && awaited)
        pthread_cond_wait(&s->sealable, &s->mutex);
    task = s->stop ? NULL : (struct task *)fair_queue_take(&s->seals, NULL, NULL);
    pthread_mutex_unlock(&s->mutex);
    return task;
}

/* Seals of one round: what they write is a slice together. */
struct round {
    struct task *task[ROUND_SEALS];
    bool more[ROUND_SEALS];
    int count;
    struct timespec begun;
};

/* All is written before the first is waited for, as the disk has begun with it. */
static void write_round(struct spool_threads *s, struct ledger_reader *reader, struct round *round)
{
    uint64_t left = SLICE_BYTES;
    struct task *task;

    for (round->count = 0; round->count < ROUND_SEALS && left > 0; round->count++) {
        if ((task = next_seal(s, round->count == 0)) == NULL)
            break;
        if (round->count == 0)
            clock_gettime(CLOCK_MONOTONIC, &round->begun);
        round->task[round->count] = task;
        task->status = write_slice(s->dir, reader, task, &left, &round->more[round->count]);
    }
    for (int i = 0; i < round->count; i++)
        end_slice(s->dir, round->task[i], &round->more[i]);
}

/* The names of those that are sealed, on stable storage. */
static void sync_names(struct spool_threads *s, struct round *round)
{
    struct modal_error err;
    enum modal_status rc = MODAL_OK;
    bool any = false;

    for (int i = 0; i < round->count; i++)
        any |= !round->more[i] && round->task[i]->status == MODAL_OK;
    if (any)
        rc = spool_sync(s->dir, &err);
    for (int i = 0; rc != MODAL_OK && i < round->count; i++) {
        round->task[i]->status = rc;
        round->task[i]->err = err;
    }
}

/* Those that are sealed are the loop's again, the others wait for their next turn. */
static void end_round(struct spool_threads *s, struct round *round)
{
    for (int i = 0; i < round->count; i++) {
        struct task *task = round->task[i];
        if (!round->more[i]) {
            give_back(s, task, &round->begun);
            continue;
        }
        pthread_mutex_lock(&s->mutex);
        fair_queue_put(&s->seals, &task->fair);
        pthread_mutex_unlock(&s->mutex);
    }
}

static void *run_seals(void *context)
{
    struct spool_threads *s = context;
    struct ledger_reader *reader = NULL;
    struct modal_error err;
    struct round round;

    if (ledger_reader_open(s->dir, &reader, &err) != MODAL_OK) {
        done_fatal(s->done, &err);
        return NULL;
    }
    while (write_round(s, reader, &round), round.count > 0) {
        sync_names(s, &round);
        end_round(s, &round);
    }
    ledger_reader_close(reader);
    return NULL;
}

struct spool_threads *spool_threads_start(const char *dir, int count, struct done_queue *done)
{
    struct spool_threads *s = calloc(1, sizeof *s);

    if (s == NULL)
        return NULL;
    pthread_mutex_init(&s->mutex, NULL);
    pthread_cond_init(&s->more, NULL);
    pthread_cond_init(&s->hashed, NULL);
    pthread_cond_init(&s->sealable, NULL);
    s->dir = dir;
    s->done = done;
    if (pthread_create(&s->sealer, NULL, run_seals, s) != 0) {
        free(s);
        return NULL;
    }
    for (int i = 0; i < count && i < THREADS_MOST; i++)
        if (pthread_create(&s->threads[s->count], NULL, run, s) == 0)
            s->count++;
    if (s->count == 0) {
        spool_threads_stop(s);
        return NULL;
    }
    return s;
}

void spool_threads_put(struct spool_threads *s, struct task *task)
{
    pthread_mutex_lock(&s->mutex);
    if (task->type == TASK_STREAM_SEAL) {
        fair_queue_put(&s->seals, &task->fair);
        pthread_cond_signal(&s->sealable);
    } else {
        fair_queue_put(&s->tasks, &task->fair);
        pthread_cond_signal(&s->more);
    }
    pthread_mutex_unlock(&s->mutex);
}

void spool_threads_stop(struct spool_threads *s)
{
    struct task *task;

    if (s == NULL)
        return;
    pthread_mutex_lock(&s->mutex);
    s->stop = true;
    pthread_cond_broadcast(&s->more);
    pthread_cond_broadcast(&s->sealable);
    pthread_mutex_unlock(&s->mutex);
    for (int i = 0; i < s->count; i++)
        pthread_join(s->threads[i], NULL);
    pthread_join(s->sealer, NULL);
    /* their files are orphans, which the next start removes */
    while ((task = (struct task *)fair_queue_take(&s->seals, NULL, NULL)) != NULL) {
        upload_close(task->upload);
        task_free(task);
    }
    pthread_cond_destroy(&s->more);
    pthread_cond_destroy(&s->hashed);
    pthread_cond_destroy(&s->sealable);
    pthread_mutex_destroy(&s->mutex);
    free(s);
}
