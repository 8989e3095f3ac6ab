/*
 * tape.c - see tape.h
 *
 *     tape:   label group group ...    numbers ascending by one, from any
 *     group:  head segment ...         head.length bytes of segments, head.crc that of them
 *     segment: mark, then its data
 *
 * Numbers in the machine's order: a folder stays on its machine, or goes by a backup to one alike,
 * as the ledger's marks do.  A crash leaves a part of the last group at most, which nobody was told
 * of: reading ends there.  What does not end there, but has a later group behind it, is damage.
 *
 * Heads begin with a secret that the label tells: no sample, which anybody may choose, can pretend
 * to be a group.  Schema 3 had no label; its heads begin with UNLABELLED.
 */
#include "store/tape.h"
#include <fcntl.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "store/file.h"
#include "store/samples.h"

#define LABEL "MODALTP2"
#define UNLABELLED "MODALTP1"

struct label {
    char magic[8], secret[TAPE_SECRET];
    uint32_t crc, unused;        /* of all before it */
};

struct head {
    char secret[TAPE_SECRET];
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
    struct head head = { .number = tape->number };
    enum modal_status rc;

    if (tape->length == 0)
        return MODAL_OK;
    memcpy(head.secret, tape->secret, TAPE_SECRET);
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
    if (tape->end > end)                          /* the group was written: its number is free */
        tape->number--;
    tape->length = 0;
    tape->end = end;
    return file_truncate(tape->fd, end, err);
}

static enum modal_status write_label(struct tape *tape, struct modal_error *err)
{
    struct label label = { .magic = LABEL };

    if (getrandom(tape->secret, TAPE_SECRET, 0) != TAPE_SECRET)
        return modal_fail(err, MODAL_IO, "no random bytes for the tape of samples");
    memcpy(label.secret, tape->secret, TAPE_SECRET);
    label.crc = crc32c(0, &label, offsetof(struct label, crc));
    tape->start = tape->end = sizeof label;
    return file_write(tape->fd, &label, sizeof label, 0, err);
}

/* Nothing is on it any more; it has a label. */
static enum modal_status tape_clear(struct tape *tape, struct modal_error *err)
{
    enum modal_status rc = file_truncate(tape->fd, tape->start, err);

    tape->length = 0;
    tape->end = tape->start;
    if (rc == MODAL_OK && tape->start == 0)
        rc = write_label(tape, err);
    return rc == MODAL_OK ? file_sync(tape->fd, err) : rc;
}

/* ---- reading --------------------------------------------------------------------------------- */

/* The LENGTH bytes of a tape, whose heads begin with `secret` from `start` on. */
struct text {
    const char *bytes, *secret;
    size_t length, start;
};

/* The head at AT into *HEAD, where one is. */
static bool find_head(const struct text *text, size_t at, struct head *head)
{
    if (text->length - at < sizeof *head)
        return false;
    memcpy(head, text->bytes + at, sizeof *head);
    return memcmp(head->secret, text->secret, TAPE_SECRET) == 0
           && head->head_crc == crc32c(0, head, offsetof(struct head, head_crc));
}

/* Whether a whole group lies at AT; *HEAD is its head. */
static bool is_whole(const struct text *text, size_t at, struct head *head)
{
    return find_head(text, at, head) && head->length <= text->length - at - sizeof *head
           && head->crc == crc32c(0, text->bytes + at + sizeof *head, head->length);
}

/* Whether a group of a number above NUMBER begins somewhere from AT on. */
static bool goes_on(const struct text *text, size_t at, uint64_t number)
{
    const char *found;
    struct head head;

    while (at < text->length
           && (found = memmem(text->bytes + at, text->length - at, text->secret, TAPE_SECRET))
                  != NULL) {
        at = (size_t)(found - text->bytes);
        if (is_whole(text, at, &head) && head.number > number)
            return true;
        at++;
    }
    return false;
}

static enum modal_status damaged(const char *path, size_t at, struct modal_error *err)
{
    return modal_fail(err, MODAL_CORRUPT,
                      "%s: the samples at offset %zu are damaged, and others follow; restore the "
                      "folder from a backup, or move this file away: the samples of open streams "
                      "that are in it are then missing", path, at);
}

/* TAPE's `start` and `secret` by its LENGTH bytes; no start: it is to begin anew, as a crash
 * left no more than a part of the label. */
static enum modal_status read_label(struct tape *tape, const char *path, const char *bytes,
                                    size_t length, struct modal_error *err)
{
    struct label label;

    tape->start = tape->end = 0;
    memcpy(tape->secret, UNLABELLED, TAPE_SECRET);
    if (length < sizeof label || memcmp(bytes, UNLABELLED, TAPE_SECRET) == 0)
        return MODAL_OK;
    memcpy(&label, bytes, sizeof label);
    if (memcmp(label.magic, LABEL, sizeof label.magic) == 0 && label.unused == 0
        && label.crc == crc32c(0, &label, offsetof(struct label, crc))) {
        memcpy(tape->secret, label.secret, TAPE_SECRET);
        tape->start = sizeof label;
        return MODAL_OK;
    }
    return length > sizeof label ? damaged(path, 0, err) : MODAL_OK;
}

/* TAPE's whole groups: bytes to their end, and the number of the group after them. */
static enum modal_status find_end(struct tape *tape, const char *path, const char *bytes,
                                  size_t length, struct modal_error *err)
{
    const struct text text = { bytes, tape->secret, length, tape->start };
    size_t at = tape->start;
    struct head head = { .number = 0 };
    uint64_t next = 0;

    while (is_whole(&text, at, &head) && (at == text.start || head.number == next)) {
        next = head.number + 1;
        at += sizeof head + head.length;
    }
    tape->end = at;
    tape->number = next;
    return goes_on(&text, at, next) ? damaged(path, at, err) : MODAL_OK;
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

/* What lies on TAPE, which is open. */
static enum modal_status measure(struct tape *tape, const char *path, struct modal_error *err)
{
    struct stat known;
    char *bytes = NULL;
    enum modal_status rc;

    if (fstat(tape->fd, &known) != 0)
        return modal_fail(err, MODAL_IO, "%s: its size cannot be found", path);
    rc = read_bytes(tape->fd, (uint64_t)known.st_size, &bytes, err);
    if (rc == MODAL_OK)
        rc = read_label(tape, path, bytes, (size_t)known.st_size, err);
    if (rc == MODAL_OK)
        rc = find_end(tape, path, bytes, (size_t)known.st_size, err);
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
    if (rc == MODAL_OK)
        rc = measure(tape, path, err);
    return rc == MODAL_OK && tape->end == 0 ? tape_clear(tape, err) : rc;
}

enum modal_status tape_check(const char *dir, uint64_t *bytes, struct modal_error *err)
{
    struct tape tape = { .fd = -1 };
    char path[4200];
    enum modal_status rc;

    tape_path(path, dir);
    rc = file_open(path, O_RDONLY, 0, &tape.fd, err);
    if (rc == MODAL_OK)
        rc = measure(&tape, path, err);
    *bytes = tape.end;
    tape_close(&tape);
    return rc == MODAL_NOT_FOUND ? MODAL_OK : rc;
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

/* Segments as they lie on a tape; `length` is that of their samples. */
struct listing { struct segment_record *items; size_t count, room; uint64_t length; };

static bool list_add(struct listing *list, const struct mark *mark, const char *data)
{
    if (list->count == list->room) {
        size_t room = list->room > 0 ? 2 * list->room : 64;
        struct segment_record *items = realloc(list->items, room * sizeof *items);
        if (items == NULL)
            return false;
        list->items = items;
        list->room = room;
    }
    list->items[list->count++] = (struct segment_record) {
        mark->stream, mark->epoch, mark->first, mark->count, mark->offset, mark->length,
        mark->crc, data };
    list->length += mark->length;
    return true;
}

/* Streams to be read; none: all. */
struct wanted { const int64_t *streams; size_t count; };

static bool is_wanted(const struct wanted *wanted, int64_t stream)
{
    for (size_t i = 0; i < wanted->count; i++)
        if (wanted->streams[i] == stream)
            return true;
    return wanted->count == 0;
}

/* The segments that are WANTED of BYTES, all of TAPE. */
static enum modal_status list_segments(const struct tape *tape, const char *bytes,
                                       const struct wanted *wanted, struct listing *list,
                                       struct modal_error *err)
{
    const struct text text = { bytes, tape->secret, tape->end, tape->start };
    struct head head;
    struct mark mark;

    for (uint64_t at = tape->start; at < tape->end;) {
        if (!is_whole(&text, at, &head))
            return damaged("tape", at, err);
        at += sizeof head;
        for (const uint64_t until = at + head.length; at < until; at += mark.length) {
            memcpy(&mark, bytes + at, sizeof mark);
            at += sizeof mark;
            if (is_wanted(wanted, mark.stream) && !list_add(list, &mark, bytes + at))
                return modal_fail(err, MODAL_NO_MEMORY, "no memory for the samples of the tape");
        }
    }
    return MODAL_OK;
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

enum modal_status tape_read(const struct tape *tape, const int64_t *streams, size_t count,
                            struct tape_pieces *out, struct modal_error *err)
{
    const struct wanted wanted = { streams, count };
    struct listing list = { NULL, 0, 0, 0 };
    char *bytes = NULL;
    enum modal_status rc = read_bytes(tape->fd, tape->end, &bytes, err);

    *out = (struct tape_pieces) { NULL, 0, NULL };
    if (rc == MODAL_OK)
        rc = list_segments(tape, bytes, &wanted, &list, err);
    if (rc == MODAL_OK) {
        out->bytes = malloc(list.length + 1);
        out->changes = calloc(list.count + 1, sizeof *out->changes);
        if (out->bytes == NULL || out->changes == NULL)
            rc = modal_fail(err, MODAL_NO_MEMORY, "no memory for %llu bytes of samples",
                            (unsigned long long)list.length);
    }
    if (rc == MODAL_OK && list.count > 0) {
        qsort(list.items, list.count, sizeof *list.items, by_place);
        join(list.items, list.count, out);
    }
    free(list.items);
    free(bytes);
    return rc;
}

void tape_pieces_done(struct tape_pieces *pieces)
{
    free(pieces->changes);
    free(pieces->bytes);
}

/* ---- dropping -------------------------------------------------------------------------------- */

enum modal_status tape_drop(struct tape *tape, const char *dir, uint64_t end,
                            struct modal_error *err)
{
    const uint64_t rest = tape->end - end;
    char path[4200], *bytes = NULL;
    enum modal_status rc;

    if (rest == 0)
        return tape_clear(tape, err);
    tape_path(path, dir);
    rc = read_bytes(tape->fd, tape->end, &bytes, err);
    if (rc == MODAL_OK) {                        /* behind the label, or nothing */
        memmove(bytes + tape->start, bytes + end, rest);
        rc = file_put(path, bytes, tape->start + rest, 0640, err);
    }
    free(bytes);
    if (rc != MODAL_OK)
        return rc;
    close(tape->fd);
    tape->fd = -1;
    tape->end = tape->start + rest;
    return file_open(path, O_RDWR, 0, &tape->fd, err);
}
