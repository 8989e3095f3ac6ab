/*
 * segments.c - what a stream has of its samples: segments, gaps, and checksums by which a repeat
 * is known
 *
 * Of the last SUMS_MOST samples of the present epoch and this life of the daemon a CRC-32C each is
 * in memory; of older ones nothing is known here, and they are compared with the file.
 */
#include "broker/core/inputs.h"
#include "broker/verbs/streams.h"
#include "broker/verbs/verbs.h"
#include "base/crc32c.h"
#include <stdlib.h>
#include <string.h>

enum {
    SUMS_MOST = 1 << 16,      /* checksums kept: 256 KiB a stream, 65 s of 1 kHz */
    /* samples that are missing, yet their places kept: 256 bytes of zeros */
    GAP_FEW = 64,
    GAPS_TOLD = 256,          /* a header holds them: 256 pairs of 15 digits are 8 kB */
};

/* Samples [first, first + count) as DATA has them beside those of the same indices, as far as
 * their checksums are in memory. */
enum sameness samples_compare(const struct stream *s, uint64_t first, uint64_t count,
                              const char *data)
{
    enum sameness found = SAME;

    for (uint64_t i = 0; i < count && first + i < s->next; i++) {
        uint64_t at = first + i;
        uint32_t known =
            at >= s->crc_first && at - s->crc_first < s->crc_count ? s->crcs[at - s->crc_first] : 0;
        if (at < s->begin
            || (known != 0 && known != crc32c(0, data + i * sample_bytes(s), sample_bytes(s))))
            return OTHER;
        if (known == 0)
            found = UNKNOWN;
    }
    return found;
}

/* Checksums of the oldest samples leave memory, which is bounded for streams of any length. */
static void forget_oldest(struct stream *s, uint64_t most)
{
    uint64_t gone = s->crc_count > most ? s->crc_count - most : 0;

    memmove(s->crcs, s->crcs + gone, (s->crc_count - gone) * sizeof *s->crcs);
    s->crc_first += gone;
    s->crc_count -= gone;
}

/* Behind a gap that is more than a few samples they begin anew: what is in memory is bounded by
 * what was sent. */
void samples_note(struct stream *s, uint64_t first, uint64_t count, const char *data)
{
    uint64_t need;

    if (s->crc_count == 0 || first > s->crc_first + s->crc_count + GAP_FEW) {
        s->crc_first = first;
        s->crc_count = 0;
    }
    if (s->crc_count > 2 * SUMS_MOST)
        forget_oldest(s, SUMS_MOST);
    need = first + count - s->crc_first;
    if (need > s->crc_room) {
        s->crc_room = 2 * need;
        s->crcs = regrab(s->crcs, s->crc_room * sizeof *s->crcs);
    }
    if (need > s->crc_count)
        memset(s->crcs + s->crc_count, 0, (need - s->crc_count) * sizeof *s->crcs);
    s->crc_count = need > s->crc_count ? need : s->crc_count;
    for (uint64_t i = 0; i < count; i++)
        s->crcs[first - s->crc_first + i] = crc32c(0, data + i * sample_bytes(s), sample_bytes(s));
}

/* In the batch it is NaN, and takes as much room as samples: its user is charged for it. */
void gaps_add(struct stream *s, uint64_t from, uint64_t to)
{
    uint64_t bytes = (to - from) * sample_bytes(s);

    s->gaps = regrab(s->gaps, (s->gap_count + 1) * sizeof *s->gaps);
    s->gaps[s->gap_count][0] = from;
    s->gaps[s->gap_count++][1] = to;
    s->missing += bytes;
    s->user->bytes += (int64_t)bytes;
}

void gaps_write(cJSON *object, const struct stream *s)
{
    cJSON *gaps = cJSON_AddArrayToObject(object, "gaps");

    for (size_t i = 0; i < s->gap_count && i < GAPS_TOLD; i++) {
        double pair[2] = { (double)s->gaps[i][0], (double)s->gaps[i][1] };
        cJSON_AddItemToArray(gaps, cJSON_CreateDoubleArray(pair, 2));
    }
    if (s->gap_count > GAPS_TOLD)
        cJSON_AddNumberToObject(object, "gap_count", (double)s->gap_count);
}

void gaps_drop(struct stream *s)
{
    s->user->bytes -= (int64_t)s->missing;
    s->missing = 0;
    s->gap_count = 0;
}

void segments_add(struct stream *s, uint64_t epoch, uint64_t first, uint64_t count)
{
    struct segment *last = s->segment_count > 0 ? &s->segments[s->segment_count - 1] : NULL;

    s->bytes += count * sample_bytes(s);
    s->user->bytes += (int64_t)(count * sample_bytes(s));
    if (last != NULL && last->epoch == epoch && last->first + last->count == first) {
        last->count += count;
        return;
    }
    if (s->segment_count == s->segment_room) {
        s->segment_room = s->segment_room ? 2 * s->segment_room : 16;
        s->segments = regrab(s->segments, s->segment_room * sizeof *s->segments);
    }
    s->segments[s->segment_count++] = (struct segment) { epoch, first, count };
}

/* The extent and the gaps of the committed segments of the present epoch. */
static void measure(struct stream *s)
{
    bool any = false;

    gaps_drop(s);
    s->begin = s->next = 0;
    for (size_t i = 0; i < s->segment_count; i++) {
        const struct segment *one = &s->segments[i];
        if (one->epoch != s->epoch)
            continue;
        if (!any)
            s->begin = s->next = one->first;
        if (one->first > s->next)
            gaps_add(s, s->next, one->first);
        s->next = one->first + one->count;
        any = true;
    }
}

void segments_cut(struct stream *s)
{
    uint64_t more = 0;

    for (; s->segment_count > 0; s->segment_count--) {
        struct segment *last = &s->segments[s->segment_count - 1];
        uint64_t kept = last->epoch > s->durable_epoch || last->first >= s->durable ? 0
                        : last->epoch < s->durable_epoch || s->durable - last->first > last->count
                            ? last->count
                            : s->durable - last->first;
        more += last->count - kept;
        last->count = kept;
        if (kept > 0)
            break;
    }
    s->bytes -= more * sample_bytes(s);
    s->user->bytes -= (int64_t)(more * sample_bytes(s));
    if (s->epoch != s->durable_epoch)
        s->crc_count = 0;
    s->epoch = s->durable_epoch;
    measure(s);
    s->durable = s->run_from = s->next;
    if (s->crc_first + s->crc_count > s->next)
        s->crc_count = s->next > s->crc_first ? s->next - s->crc_first : 0;
}

/* The end of what came, those samples that are held included. */
uint64_t samples_reach(const struct stream *s)
{
    return s->held != NULL && s->held_reach > s->next ? s->held_reach : s->next;
}

uint64_t known_before(const struct stream *s, uint64_t first, uint64_t count)
{
    uint64_t known = s->segment_count > 0 && first < s->next ? s->next - first : 0;

    return (known < count ? known : count) * sample_bytes(s);
}

/* Bytes of the gap that samples from FIRST on leave. */
uint64_t gap_before(const struct stream *s, uint64_t first)
{
    uint64_t end = samples_reach(s);

    return s->segment_count > 0 && first > end ? (first - end) * sample_bytes(s) : 0;
}

/* What all gaps of an epoch may take.  Where users have keys, who sent little may not make the
 * daemon write much; without keys there is one user, and the disk is his. */
uint64_t gaps_most(const struct core *c, const struct stream *s)
{
    uint64_t sent = (samples_reach(s) - s->begin) * sample_bytes(s) - s->missing;

    if (s->user->account->key[0] == 0)
        return (uint64_t)c->settings.input_bytes;
    return sent > GAP_BYTES ? sent : GAP_BYTES;
}

void segments_drop(struct stream *s)
{
    free(s->segments);
    free(s->crcs);
    s->segments = NULL;
    s->crcs = NULL;
    s->segment_room = 0;
    s->crc_count = s->crc_room = 0;
}

struct task *batch_task(const struct core *c, struct stream *s, uint64_t first, uint64_t count)
{
    const struct input *input = input_by_id(c, s->batch);
    const uint64_t size = sample_bytes(s);
    struct task *task =
        input != NULL ? input_piece(input, (first - s->begin) * size, count * size) : NULL;

    if (task != NULL) {
        task->type = TASK_BATCH_READ;
        task->owner = s;
        task->epoch = s->epoch;
    }
    return task;
}
