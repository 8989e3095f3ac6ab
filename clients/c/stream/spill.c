/* spill.c - see spill.h */
#include "spill.h"
#include "text.h"
#include "base/crc32c.h"
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

static bool write_all(int fd, const void *data, size_t length, uint64_t at)
{
    const char *p = data;

    while (length > 0) {
        ssize_t n = pwrite(fd, p, length, (off_t)at);
        if (n <= 0 && errno != EINTR)
            return false;
        p += n > 0 ? n : 0;
        at += n > 0 ? (uint64_t)n : 0;
        length -= n > 0 ? (size_t)n : 0;
    }
    return true;
}

enum { SPILL_NAMES = 10000 };    /* of one process: past it nobody replays them */

/* A file that was not there: FOLDER/modald-NAME-PID.spill, or PID-2, -3, ...  What is there may
 * hold samples that were never sent: of an earlier stream of that name, or of another life of that
 * PID, which in a container is the same every time. */
static void spill_create(modald_stream *s)
{
    char clean[64] = "", number[16] = "";

    for (size_t i = 0; s->name[i] != 0 && i < sizeof clean - 1; i++)
        clean[i] = strchr("/ .", s->name[i]) ? '_' : s->name[i];
    for (int n = 2; n < SPILL_NAMES; n++) {
        snprintf(s->spill_path, sizeof s->spill_path, "%s/modald-%s-%d%s.spill", s->spill_folder,
                 clean, (int)getpid(), number);
        s->spill_fd = open(s->spill_path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
        if (s->spill_fd >= 0)
            flock(s->spill_fd, LOCK_EX | LOCK_NB);      /* a replay leaves it alone meanwhile */
        if (s->spill_fd >= 0 || errno != EEXIST)
            return;
        snprintf(number, sizeof number, "-%d", n);
    }
}

/* Its head is the open message. */
static bool spill_open(modald_stream *s)
{
    char *head;
    uint32_t length;
    bool good;

    if (s->spill_fd >= 0 || s->spill_most == 0)
        return s->spill_fd >= 0;
    spill_create(s);
    head = calloc(1, HEADER_MOST);
    if (s->spill_fd < 0 || head == NULL) {
        free(head);
        return false;
    }
    open_header(s, head, HEADER_MOST);
    length = (uint32_t)strlen(head);
    s->spill_start = s->spill_end = s->spill_read = s->spill_acknowledged = sizeof spill_magic
                                                                          + sizeof length + length;
    good = write_all(s->spill_fd, spill_magic, sizeof spill_magic, 0)
        && write_all(s->spill_fd, &length, sizeof length, sizeof spill_magic)
        && write_all(s->spill_fd, head, length, sizeof spill_magic + sizeof length);
    free(head);
    if (!good) {
        close(s->spill_fd);
        unlink(s->spill_path);
        s->spill_fd = -1;
    }
    return good;
}

/* Append F; false: the disk or the limit is full. */
static bool spill_write(modald_stream *s, struct frame *f)
{
    size_t length = bytes_of(s, f->count);
    struct spill_head head = { f->first, f->count, f->crc, 0 };

    if (!spill_open(s) || s->spill_end + sizeof head + length > s->spill_most
        || !write_all(s->spill_fd, f->data, length, s->spill_end + sizeof head)
        || !write_all(s->spill_fd, &head, sizeof head, s->spill_end)) {
        char text[600];
        snprintf(text, sizeof text, "%s %s; samples past the ring are counted as a gap",
                 s->spill_fd < 0 ? "no spill file can be made in" : "there is no more room for",
                 s->spill_fd < 0 ? s->spill_folder : s->spill_path);
        if (!s->spill_failed && s->spill_most > 0)
            warn_once(s, text);
        s->spill_failed = true;
        return false;
    }
    s->spill_end += sizeof head + length;
    f->file_end = s->spill_end;
    atomic_fetch_add_explicit(&s->spilled, f->count, memory_order_relaxed);
    return true;
}

/* Whether the record of HEAD may be what it says: it lies in the file, and in its order. */
static bool is_record(const modald_stream *s, const struct spill_head *head)
{
    return head->count > 0 && head->count <= s->frame_samples
        && s->spill_read + sizeof *head + bytes_of(s, head->count)
               <= s->spill_end;
}

/* A record whose samples are not what was written is passed over: the record on the daemon's side
 * shows the gap. */
static void spill_skip(modald_stream *s, const struct spill_head *head)
{
    s->spill_read += sizeof *head + bytes_of(s, head->count);
    s->damaged += head->count;
    atomic_fetch_add_explicit(&s->dropped, head->count, memory_order_relaxed);
    if (s->frames > 0)
        frame_at(s, s->frames - 1)->file_end = s->spill_read;
    else
        s->spill_acknowledged = s->spill_read;
}

/* The next frame of the file into F; false: no more.  What a killed host was writing is torn, and
 * the file ends before it. */
static bool spill_next(modald_stream *s, struct frame *f)
{
    struct spill_head head;
    size_t length;

    for (;;) {
        if (s->spill_read >= s->spill_end)
            return false;
        if (pread(s->spill_fd, &head, sizeof head, (off_t)s->spill_read) != (ssize_t)sizeof head
            || !is_record(s, &head)) {
            s->torn += s->spill_end - s->spill_read;
            s->spill_end = s->spill_read;
            return false;
        }
        length = bytes_of(s, head.count);
        if (pread(s->spill_fd, f->data, length, (off_t)(s->spill_read + sizeof head))
                == (ssize_t)length
            && crc32c(0, f->data, length) == head.crc)
            break;
        spill_skip(s, &head);
    }
    s->spill_read += sizeof head + length;
    f->first = head.first;
    f->count = head.count;
    f->crc = head.crc;
    f->ring_end = 0;
    f->file_end = s->spill_read;
    f->id = 0;
    f->acknowledged = false;
    return true;
}

static bool spilling(const modald_stream *s)
{
    return s->spill_fd >= 0 && s->spill_acknowledged < s->spill_end;
}

/* Everything in the file is acknowledged: begin it anew. */
static void spill_drained(modald_stream *s)
{
    if (s->spill_fd < 0 || spilling(s) || s->spill_end == s->spill_start || s->spill_most == 0)
        return;                                         /* a replay leaves its file as it was */
    if (ftruncate(s->spill_fd, (off_t)s->spill_start) == 0)
        s->spill_end = s->spill_read = s->spill_acknowledged = s->spill_start;
    s->spill_failed = false;
}
