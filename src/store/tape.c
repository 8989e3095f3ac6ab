/*
 * tape.c - see tape.h
 *
 *     tape:   group group ...          numbers ascending by one, from any
 *     group:  head segment ...         head.length bytes of segments, head.crc that of them
 *     segment: mark, then its data
 *
 * Numbers in the machine's order: a folder stays on its machine, or goes by a backup to one alike,
 * as the ledger's marks do.  A crash leaves a part of the last group at most, which nobody was told
 * of: reading ends there.  What does not end there, but has a later group behind it, is damage.
 */
#include "store/tape.h"
#include <fcntl.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "store/file.h"
#include "store/samples.h"

#define MAGIC "MODALTP1"

struct head {
    char magic[8];
    uint64_t number, length;
    uint32_t crc, head_crc;      /* of the segments; of all before it */
};

struct mark {
    int64_t stream;
    uint64_t epoch, first, count, offset, length;
    uint32_t crc, unused;
};

void tape_path(char path[4200], const char *dir)
{
    snprintf(path, 4200, "%s/tape", dir);
}

/* ---- writing --------------------------------------------------------------------------------- */

static enum modal_status add_bytes(struct tape *tape, const void *data, size_t length,
                                   struct modal_error *err)
{
    if (tape->length + length > tape->room) {
        size_t room = 2 * (tape->length + length);
        char *group = realloc(tape->group, room);
        if (group == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "no memory for a group of samples");
        tape->group = group;
        tape->room = room;
    }
    memcpy(tape->group + tape->length, data, length);
    tape->length += length;
    return MODAL_OK;
}

enum modal_status tape_add(struct tape *tape, const struct segment_record *segment,
                           struct modal_error *err)
{
    const struct mark mark = { segment->stream, segment->epoch, segment->first, segment->count,
                               segment->offset, segment->length, segment->crc, 0 };
    enum modal_status rc = MODAL_OK;

    if (tape->length == 0)
        rc = add_bytes(tape, &(struct head) { .number = 0 }, sizeof(struct head), err);
    if (rc == MODAL_OK)
        rc = add_bytes(tape, &mark, sizeof mark, err);
    return rc == MODAL_OK ? add_bytes(tape, segment->data, segment->length, err) : rc;
}

enum modal_status tape_write(struct tape *tape, struct modal_error *err)
{
    struct head head = { .magic = MAGIC, .number = tape->number };
    enum modal_status rc;

    if (tape->length == 0)
        return MODAL_OK;
    head.length = tape->length - sizeof head;
    head.crc = crc32c(0, tape->group + sizeof head, head.length);
    head.head_crc = crc32c(0, &head, offsetof(struct head, head_crc));
    memcpy(tape->group, &head, sizeof head);
    rc = file_write(tape->fd, tape->group, tape->length, tape->end, err);
    if (rc == MODAL_OK)
        rc = file_sync(tape->fd, err);
    if (rc == MODAL_OK) {
        tape->end += tape->length;
        tape->number++;
        tape->length = 0;
    }
    return rc;
}

enum modal_status tape_revert(struct tape *tape, uint64_t end, struct modal_error *err)
{
    tape->length = 0;
    tape->end = end;
    return file_truncate(tape->fd, end, err);
}

enum modal_status tape_clear(struct tape *tape, struct modal_error *err)
{
    enum modal_status rc = tape_revert(tape, 0, err);

    return rc == MODAL_OK ? file_sync(tape->fd, err) : rc;
}

/* ---- reading --------------------------------------------------------------------------------- */

/* The head at AT of the LENGTH bytes of TAPE into *HEAD, where one is. */
static bool find_head(const char *bytes, size_t length, size_t at, struct head *head)
{
    if (length - at < sizeof *head)
        return false;
    memcpy(head, bytes + at, sizeof *head);
    return memcmp(head->magic, MAGIC, sizeof head->magic) == 0
           && head->head_crc == crc32c(0, head, offsetof(struct head, head_crc));
}

/* Whether a whole group lies at AT; *HEAD is its head. */
static bool is_whole(const char *bytes, size_t length, size_t at, struct head *head)
{
    return find_head(bytes, length, at, head) && head->length <= length - at - sizeof *head
           && head->crc == crc32c(0, bytes + at + sizeof *head, head->length);
}

/* Whether a group of a number above NUMBER begins somewhere from AT on. */
static bool goes_on(const char *bytes, size_t length, size_t at, uint64_t number)
{
    const char *found;
    struct head head;

    while (at < length && (found = memmem(bytes + at, length - at, MAGIC, 8)) != NULL) {
        at = (size_t)(found - bytes);
        if (is_whole(bytes, length, at, &head) && head.number > number)
            return true;
        at++;
    }
    return false;
}

/* *END: bytes of the whole groups that BYTES begin with; *NUMBER: of the group after them. */
static enum modal_status find_end(const char *path, const char *bytes, size_t length, uint64_t *end,
                                  uint64_t *number, struct modal_error *err)
{
    size_t at = 0;
    struct head head = { .number = 0 };
    uint64_t next = 0;

    while (is_whole(bytes, length, at, &head) && (at == 0 || head.number == next)) {
        next = head.number + 1;
        at += sizeof head + head.length;
    }
    if (goes_on(bytes, length, at, next))
        return modal_fail(err, MODAL_CORRUPT,
                          "%s: the samples at offset %zu are damaged, and others follow; restore "
                          "the folder from a backup, or move this file away: the samples of open "
                          "streams that are in it are then missing", path, at);
    *end = at;
    *number = next;
    return MODAL_OK;
}

static enum modal_status read_bytes(int fd, uint64_t length, char **bytes, struct modal_error *err)
{
    size_t got = 0;
    enum modal_status rc;

    *bytes = malloc(length + 1);
    if (*bytes == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for %llu bytes of samples",
                          (unsigned long long)length);
    rc = file_read(fd, *bytes, length, 0, &got, err);
    return rc != MODAL_OK || got == length
               ? rc : modal_fail(err, MODAL_CORRUPT, "the tape of samples has become shorter");
}

/* The whole groups of the open file FD: END bytes, and the NUMBER of the next. */
static enum modal_status measure(int fd, const char *path, uint64_t *end, uint64_t *number,
                                 struct modal_error *err)
{
    struct stat known;
    char *bytes = NULL;
    enum modal_status rc;

    if (fstat(fd, &known) != 0)
        return modal_fail(err, MODAL_IO, "%s: its size cannot be found", path);
    rc = read_bytes(fd, (uint64_t)known.st_size, &bytes, err);
    if (rc == MODAL_OK)
        rc = find_end(path, bytes, (size_t)known.st_size, end, number, err);
    free(bytes);
    return rc;
}

enum modal_status tape_open(struct tape *tape, const char *dir, struct modal_error *err)
{
    char path[4200];
    enum modal_status rc;

    *tape = (struct tape) { .fd = -1 };
    tape_path(path, dir);
    rc = file_open(path, O_RDWR | O_CREAT, 0640, &tape->fd, err);
    if (rc == MODAL_OK)
        rc = file_sync_dir(dir, err);
    return rc == MODAL_OK ? measure(tape->fd, path, &tape->end, &tape->number, err) : rc;
}

enum modal_status tape_check(const char *dir, uint64_t *bytes, struct modal_error *err)
{
    char path[4200];
    uint64_t number;
    int fd = -1;
    enum modal_status rc;

    *bytes = 0;
    tape_path(path, dir);
    rc = file_open(path, O_RDONLY, 0, &fd, err);
    if (rc == MODAL_NOT_FOUND)
        return MODAL_OK;
    if (rc == MODAL_OK)
        rc = measure(fd, path, bytes, &number, err);
    if (fd >= 0)
        close(fd);
    return rc;
}

void tape_close(struct tape *tape)
{
    if (tape->fd >= 0)
        close(tape->fd);
    free(tape->group);
    *tape = (struct tape) { .fd = -1 };
}

/* ---- joining --------------------------------------------------------------------------------- */

static int by_place(const void *a, const void *b)
{
    const struct segment_record *x = a, *y = b;

    if (x->stream != y->stream)
        return x->stream < y->stream ? -1 : 1;
    return x->offset < y->offset ? -1 : x->offset > y->offset;
}

/* Does NEXT go on with LAST, and do both fit one segment? */
static bool follows(const struct segment_record *last, const struct segment_record *next)
{
    return last->stream == next->stream && last->epoch == next->epoch
           && last->first + last->count == next->first
           && last->offset + last->length == next->offset
           && last->length + next->length <= SAMPLES_SEGMENT_MOST;
}

/* The segments of the END bytes of BYTES, as they lie; NULL: no memory. */
static struct segment_record *list_segments(const char *bytes, uint64_t end, size_t *count)
{
    struct segment_record *list = malloc(end / sizeof(struct mark) * sizeof *list + 1);

    *count = 0;
    for (uint64_t at = 0, until = 0; list != NULL && at < end;) {
        struct mark mark;
        if (at == until) {
            struct head head;
            memcpy(&head, bytes + at, sizeof head);
            at += sizeof head;
            until = at + head.length;
            continue;
        }
        memcpy(&mark, bytes + at, sizeof mark);
        at += sizeof mark;
        list[(*count)++] = (struct segment_record) {
            mark.stream, mark.epoch, mark.first, mark.count, mark.offset, mark.length, mark.crc,
            bytes + at };
        at += mark.length;
    }
    return list;
}

/* COUNT sorted segments of LIST, joined, into OUT, whose `bytes` have room for all. */
static void join(const struct segment_record *list, size_t count, struct tape_pieces *out)
{
    char *at = out->bytes;

    for (size_t i = 0; i < count; i++) {
        struct segment_record *last = out->count > 0 ? &out->changes[out->count - 1].segment : NULL;
        if (last != NULL && follows(last, &list[i])) {
            last->crc = crc32c_join(last->crc, list[i].crc, list[i].length);
            last->count += list[i].count;
            last->length += list[i].length;
        } else {
            out->changes[out->count++] = (struct ledger_change) { .verb = LEDGER_SEGMENT_ROW,
                                                                  .segment = list[i] };
            out->changes[out->count - 1].segment.data = at;
        }
        memcpy(at, list[i].data, list[i].length);
        at += list[i].length;
    }
}

enum modal_status tape_read(const struct tape *tape, struct tape_pieces *out,
                            struct modal_error *err)
{
    struct segment_record *list = NULL;
    char *bytes = NULL;
    size_t count = 0;
    enum modal_status rc = read_bytes(tape->fd, tape->end, &bytes, err);

    *out = (struct tape_pieces) { NULL, 0, NULL };
    if (rc == MODAL_OK) {
        list = list_segments(bytes, tape->end, &count);
        out->bytes = malloc(tape->end + 1);
        out->changes = calloc(count + 1, sizeof *out->changes);
        if (list == NULL || out->bytes == NULL || out->changes == NULL)
            rc = modal_fail(err, MODAL_NO_MEMORY, "no memory for %llu bytes of samples",
                            (unsigned long long)tape->end);
    }
    if (rc == MODAL_OK) {
        qsort(list, count, sizeof *list, by_place);
        join(list, count, out);
    }
    free(list);
    free(bytes);
    return rc;
}

void tape_pieces_done(struct tape_pieces *pieces)
{
    free(pieces->changes);
    free(pieces->bytes);
}
