/*
 * streams.c - samples of unknown number: pushed by index, kept as segments, sealed into a batch
 *
 * What is pushed goes behind all before it into the stream's file (store/samples.h), by the same
 * group commit as everything else.  A sample is known by epoch and index.  The same index with the
 * same bytes is a repeat and ignored, with other bytes it begins an epoch.  Samples of which no
 * checksum is in memory (segments.c) are compared with the file, while the push and those behind
 * it wait.
 */
#include "base/crc32c.h"
#include "base/sha256.h"
#include "broker/core/inputs.h"
#include "broker/verbs/streams.h"
#include "broker/verbs/verbs.h"
#include "wire/frame.h"
#include "wire/protocol.h"
#include "wire/pushes.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    STREAMS_MOST = 4096,      /* open ones of a user, told in PROTOCOL.md, section 8 */
    CHANNELS_MOST = 8192,     /* so that a push of 256 KiB has four samples */
    FORGOTTEN_S = 600,        /* whoever closes again after a lost answer does so sooner */
};

struct stream *stream_by_id(const struct core *c, int64_t id)
{
    return map_find_number(&c->stream_ids, (uint64_t)id);
}

static struct stream *stream_open_named(const struct core *c, const struct user *user,
                                        const char *name)
{
    for (struct stream *s = c->streams; s != NULL; s = s->next_stream)
        if (s->user == user && !s->closed && strcmp(s->name, name) == 0)
            return s;
    return NULL;
}

static void answer_state(struct core *c, const struct reply *reply, const struct stream *s)
{
    char ident[9], hex[65];
    cJSON *header;

    if (reply->all != NULL) {
        answer_part(c, reply,
                    grab_format("{\"epoch\":%llu,\"next\":%llu}",
                                (unsigned long long)s->durable_epoch,
                                (unsigned long long)s->durable));
        return;
    }
    header = answer_new(reply);
    ident_text(ident, ~c->settings.secret, s->id);
    cJSON_AddStringToObject(header, "stream", ident);
    cJSON_AddStringToObject(header, "name", s->name);
    cJSON_AddNumberToObject(header, "epoch", (double)s->durable_epoch);
    cJSON_AddNumberToObject(header, "next", (double)s->durable);
    cJSON_AddNumberToObject(header, "credit", (double)core_window(c) / 2);
    cJSON_AddNumberToObject(header, "parts", WIRE_PUSHES_MOST);
    if (s->closed) {
        cJSON_AddNumberToObject(header, "samples", (double)(s->next - s->begin));
        gaps_write(header, s);
        if (s->has_batch) {
            sha256_hex(s->sha256, hex);
            cJSON_AddStringToObject(header, "sha256", hex);
        }
    }
    answer_send(c, reply, header, NULL);
}

struct stream *stream_make(struct core *c, struct user *user, const char *name,
                           const struct wire_input *w, const cJSON *window, int64_t id)
{
    struct stream *s = grab(sizeof *s);
    cJSON *header = cJSON_CreateObject();

    s->id = id;
    s->user = user;
    s->name = grab_text(name);
    s->touched_ns = c->now.utc_ns;
    s->channels = w->channels;
    s->dt = w->dt;
    s->period = w->period;
    wire_input_write(header, w);
    cJSON_DeleteItemFromObject(header, "samples");
    cJSON_DeleteItemFromObject(header, "content");
    s->header = json_print(header);
    s->input_length = strlen(s->header) - 1;
    if (window != NULL) {
        free(s->header);
        cJSON_AddItemToObject(header, "window", cJSON_Duplicate(window, true));
        s->header = json_print(header);
    }
    cJSON_Delete(header);
    window_init(s, window, w);
    s->next_stream = c->streams;
    c->streams = s;
    if (!map_put(&c->stream_ids, map_hash_number((uint64_t)id), s))
        abort();
    c->inputs->open_streams++;
    return s;
}

static void answer_full(struct core *c, const struct reply *reply)
{
    answer_fail(c, reply, MODAL_STORAGE_FULL, "", answer_number("retry_after_s", 1),
                "the samples could not be stored: the disk is full");
}

static void end_if_quiet(struct core *c, struct stream *s);

/* Closed ones whose last samples wait for a worker are as dear as open ones. */
static int open_streams_of(const struct core *c, const struct user *user)
{
    int open = 0;

    for (const struct stream *s = c->streams; s != NULL; s = s->next_stream)
        open += s->user == user && (!s->closed || s->window.recent != NULL || s->window.reading);
    return open;
}

/* May who asks open what he describes?  Else he is answered. */
static bool may_open(struct core *c, const struct request *q)
{
    const struct reply *reply = &q->reply;
    const struct wire_input *input = &q->wire.stream.input;
    struct modal_error err;
    int open = open_streams_of(c, q->user);

    if (open >= STREAMS_MOST)
        answer_fail(c, reply, MODAL_TOO_LARGE, "name", NULL,
                    "%d streams of yours are open; accepted: at most %d", open, STREAMS_MOST);
    else if (input->channels > CHANNELS_MOST)
        answer_fail(c, reply, MODAL_TOO_LARGE, "channels", NULL,
                    "a stream of %llu channels; accepted: at most %d",
                    (unsigned long long)input->channels, CHANNELS_MOST);
    else if (c->draining || c->terminating)
        answer_fail(c, reply, MODAL_DRAINING, "", answer_number("retry_after_s", 5),
                    "the daemon takes no new work");
    else if (room_is_full(c))
        answer_full(c, reply);
    else if (window_check(q->wire.stream.window, input, &err) != MODAL_OK)
        answer_error(c, reply, &err, NULL);
    else
        return true;
    return false;
}

/* A new one, whose note is on its way. */
static struct stream *open_new(struct core *c, const struct request *q)
{
    struct stream *s = stream_make(c, q->user, q->wire.stream.name, &q->wire.stream.input,
                            q->wire.stream.window, input_number(c));

    s->last = transaction_new();
    stream_note(s->last, s);
    core_commit(c, s->last);
    return s;
}

static void on_open(struct core *c, const struct request *q)
{
    struct stream *s = stream_open_named(c, q->user, q->wire.stream.name);
    struct after *after;

    if (s != NULL && (s->channels != q->wire.stream.input.channels
                      || s->dt != q->wire.stream.input.dt)) {
        answer_fail(c, &q->reply, MODAL_CONFLICT, "name", NULL,
                    "the stream is open with %llu channels and dt %.17g",
                    (unsigned long long)s->channels, s->dt);
        return;
    }
    if (s == NULL && !may_open(c, q))
        return;
    if (s == NULL)
        s = open_new(c, q);
    if (s->last == NULL) {
        s->resumes = false;                        /* its owner sees `next` */
        answer_state(c, &q->reply, s);
        return;
    }
    after = after_new(AFTER_STREAM, &q->reply);
    after->stream = s;
    transaction_join(s->last, after);
}

/* ---- pushing --------------------------------------------------------------------------------- */

/* Whether samples from FIRST on leave a gap that makes the batch longer than an input may be. */
static bool gap_too_long(const struct core *c, const struct stream *s, uint64_t first,
                         uint64_t count)
{
    return s->segment_count > 0 && first > s->next
        && (double)(first + count - s->begin) * (double)sample_bytes(s)
                  > (double)c->settings.input_bytes;
}

/* Its row; DATA is in the push's body, which the transaction keeps. */
static void put_segment(struct stream *s, struct transaction *t, uint64_t first, uint64_t count,
                        const char *data, uint32_t crc)
{
    transaction_add(t, LEDGER_SEGMENT_PUT)->segment =
        (struct segment_record) {
            .stream = s->id, .epoch = s->epoch, .first = first, .count = count,
            .offset = s->bytes, .length = count * sample_bytes(s), .crc = crc, .data = data };
    segments_add(s, s->epoch, first, count);
}

static void append(struct stream *s, uint64_t first, uint64_t count, const char *data, uint32_t crc,
                   struct transaction *t)
{
    if (s->next == 0 && s->segment_count == 0)
        s->begin = s->next = s->durable = s->run_from = first;
    if (first > s->next) {
        gaps_add(s, s->next, first);
        s->run_from = first;
    }
    samples_note(s, first, count, data);
    put_segment(s, t, first, count, data, crc);
    s->next = first + count;
}

static void new_epoch(struct core *c, struct stream *s, uint64_t first, struct transaction *t)
{
    s->epoch++;
    s->begin = s->next = s->run_from = first;
    s->crc_count = 0;
    gaps_drop(s);
    window_reset(c, s);
    stream_note(t, s);
}

/* What comes behind a push that was refused leaves no hole: it is refused too, until those samples
 * come again. */
static void refuse_behind(struct core *c, struct stream *s, bool full, const struct reply *reply)
{
    s->slowed = s->resumes && s->slowed && !full;
    s->resumes = true;
    if (!s->slowed)
        answer_full(c, reply);
    else
        answer_fail(c, reply, MODAL_BUSY, "", answer_number("retry_after_s", 0.1),
                    "samples before these were refused; accepted: those from %llu on first",
                    (unsigned long long)s->next);
}

/* Within the credit and the user's limits?  Else it is answered, and what is behind it waits.  A
 * gap is paid for like the samples that it stands for, but never waits for a rate that would let
 * as many bytes pass only later.  Samples that come again as those behind them were refused are
 * paid for once: twice, a rate that they fill might never let the others pass. */
static bool may_push(struct core *c, struct stream *s, const struct push *p, size_t size)
{
    const uint64_t gap = gap_before(s, p->first);
    const struct reply *reply = &p->reply;
    bool good = false;

    if (s->in_flight > core_window(c)) {
        c->counts.credit_stalls++;
        answer_fail(c, reply, MODAL_BUSY, "", answer_number("retry_after_s", 0.1),
                    "more unacknowledged samples than the credit allows");
    } else
        good = !user_quota(c, s->user, reply, 0, (int64_t)(size + gap))
            && upload_allows(c, s->user, size - known_before(s, p->first, p->count), reply);
    if (good)
        upload_owes(s->user, gap);
    s->resumes = s->slowed = !good;
    return good;
}

/* Do samples that the record shows as missing come after all?  They have no place in it
 * any more. */
static bool comes_late(struct core *c, const struct stream *s, const struct push *p)
{
    for (size_t i = 0; p->same == SAME && p->first < s->next && i < s->gap_count; i++)
        if (s->gaps[i][0] < p->first + p->count && s->gaps[i][1] > p->first) {
            answer_fail(
                c, &p->reply, MODAL_CONFLICT, "first", answer_number("expected", (double)s->next),
                "samples %llu to %llu are a gap of the record already; accepted: from %llu on",
                (unsigned long long)s->gaps[i][0], (unsigned long long)(s->gaps[i][1] - 1),
                (unsigned long long)s->next);
            return true;
        }
    return false;
}

/* Into the file and the ledger: what is new of P, or, where it begins an epoch, all. */
static void accept(struct core *c, struct stream *s, const struct push *p)
{
    const char *data = p->data;
    uint64_t size = sample_bytes(s), known;
    struct transaction *t = transaction_new();
    struct after *after = after_new(AFTER_STREAM, &p->reply);

    transaction_keep(t, p->body, p->count * size);
    t->refusable = FIRST_REFUSED;
    t->fence = &s->fence;
    if (p->same == OTHER) {                            /* they are new after all */
        upload_owes(s->user, known_before(s, p->first, p->count));
        new_epoch(c, s, p->first, t);
    }
    known = p->first < s->next && s->segment_count > 0 ? s->next - p->first : 0;
    if (known == 0)
        append(s, p->first, p->count, data, p->crc, t);
    else if (known < p->count)
        append(s, s->next, p->count - known, data + known * size,
               crc32c(0, data + known * size, (p->count - known) * size), t);
    after->stream = s;
    after->value = (int64_t)s->next;
    after->length = (int64_t)(p->count * size);
    after->attempts = (int)s->epoch;
    transaction_join(t, after);
    s->in_flight += after->length;
    s->last = t;
    core_commit(c, t);
}

/* Of a message with others its own samples are kept alone: what is held is within the credit. */
static void hold(struct stream *s, const struct push *p)
{
    struct push *held = grab(sizeof *held);

    *held = *p;
    held->body = p->reply.all == NULL ? blob_share(p->body)
                                      : blob_copy(p->data, p->count * sample_bytes(s));
    if (held->body == NULL)
        abort();
    held->data = held->body->data;
    if (s->held == NULL) {
        s->held_end = &s->held;
        s->held_reach = 0;
    }
    if (p->first + p->count > s->held_reach)
        s->held_reach = p->first + p->count;
    *s->held_end = held;
    s->held_end = &held->next;
    s->in_flight += (int64_t)(p->count * sample_bytes(s));
}

static void let_go(struct stream *s)
{
    struct push *p = s->held;

    s->held = p->next;
    s->in_flight -= (int64_t)(p->count * sample_bytes(s));
    blob_drop(p->body);
    free(p);
}

/* What of the epoch is on disk beside the first that is held; all of it is committed. */
static void compare(struct core *c, struct stream *s)
{
    struct task *task = task_new(TASK_SAMPLES_COMPARE, 0);

    task->shape.channels = s->channels;
    task->owner = s;
    task->stream = s->id;
    task->epoch = s->epoch;
    task->begin = s->held->first;
    task->length = s->held->count;
    task->chunks[task->count++] = blob_share(s->held->body);
    s->comparing = true;
    core_task_settled(c, task, user_turn(s->user, s->held->reply.peer));
}

/* Those held that can go on, in their order, up to one that must be compared. */
static void go_on(struct core *c, struct stream *s)
{
    while (s->held != NULL && !s->comparing) {
        struct push *p = s->held;
        if (p->same == UNTOLD)
            p->same = samples_compare(s, p->first, p->count, p->data);
        if (p->same == UNKNOWN) {
            if (is_durable(s))
                compare(c, s);
            return;
        }
        if (room_is_full(c) || atomic_load(&s->fence) || (s->resumes && p->first > s->next))
            refuse_behind(c, s, room_is_full(c) || atomic_load(&s->fence), &p->reply);
        else {
            s->resumes = s->slowed = false;
            if (!comes_late(c, s, p))
                accept(c, s, p);
        }
        let_go(s);
    }
}

void stream_compared(struct core *c, struct task *task)
{
    struct stream *s = task->owner;

    s->comparing = false;
    s->held->same = task->differs ? OTHER : SAME;
    if (task->status != MODAL_OK) {
        answer_error(c, &s->held->reply, &task->err, NULL);
        let_go(s);
        s->resumes = true;                         /* what is behind it leaves no hole */
    }
    go_on(c, s);
    end_if_quiet(c, s);
}

/* A push whose message is in order: taken, held behind another, or held until it is compared. */
static void accept_or_hold(struct core *c, struct stream *s, struct push *p)
{
    if (s->held == NULL)
        p->same = samples_compare(s, p->first, p->count, p->data);
    if (p->same == SAME || p->same == OTHER) {
        if (!comes_late(c, s, p))
            accept(c, s, p);
        return;
    }
    hold(s, p);
    go_on(c, s);
}

/* true: answered; what is behind it would leave a longer gap, and is refused alike. */
static bool gaps_too_large(struct core *c, const struct stream *s, const struct push *p)
{
    uint64_t gap = gap_before(s, p->first), most = gaps_most(c, s);

    if (gap == 0 || s->missing + gap <= most)
        return false;
    answer_fail(c, &p->reply, MODAL_TOO_LARGE, "first",
                answer_number("expected", (double)samples_reach(s)),
                "samples %llu to %llu would be missing, with earlier gaps %llu bytes; accepted: "
                "%llu bytes of gaps (%llu, or as many as the samples that are here)",
                (unsigned long long)samples_reach(s), (unsigned long long)(p->first - 1),
                (unsigned long long)(s->missing + gap), (unsigned long long)most,
                (unsigned long long)GAP_BYTES);
    return true;
}

/* P, of EPOCH, whose samples are BYTES long. */
static void push(struct core *c, struct stream *s, struct push *p, uint64_t epoch, size_t bytes)
{
    uint64_t size = p->count * sample_bytes(s);
    const struct reply *reply = &p->reply;

    if (bytes != size)
        answer_fail(c, reply, MODAL_BAD_INPUT, "body", NULL,
                    "a body of %zu bytes; accepted: %llu samples of %llu channels, 8 bytes each",
                    bytes, (unsigned long long)p->count, (unsigned long long)s->channels);
    else if (crc32c(0, p->data, size) != p->crc)
        answer_fail(c, reply, MODAL_BAD_INPUT, "crc32c", NULL,
                    "crc32c is %u; accepted: %u, that of the samples as they came", p->crc,
                    crc32c(0, p->data, size));
    else if (gap_too_long(c, s, p->first, p->count))
        answer_fail(c, reply, MODAL_TOO_LARGE, "first", NULL,
                    "a gap from sample %llu to %llu makes a batch over input_bytes; accepted: at "
                    "most %lld bytes",
                    (unsigned long long)s->next, (unsigned long long)p->first,
                    (long long)c->settings.input_bytes);
    /* an earlier one was on its way when the present began */
    else if (epoch > s->epoch)
        answer_fail(c, reply, MODAL_CONFLICT, "epoch", answer_number("expected", (double)s->epoch),
                    "the stream is in epoch %llu", (unsigned long long)s->epoch);
    else if (s->closed || s->closing)
        answer_fail(c, reply, MODAL_CONFLICT, "stream", NULL, "the stream is closed");
    else if (room_is_full(c) || atomic_load(&s->fence) || (s->resumes && p->first > s->next))
        refuse_behind(c, s, room_is_full(c) || atomic_load(&s->fence), reply);
    else if (!gaps_too_large(c, s, p) && may_push(c, s, p, size))
        accept_or_hold(c, s, p);
}

static void on_push(struct core *c, const struct request *q, struct stream *s)
{
    struct push one = {
        .reply = q->reply, .first = q->wire.stream.first, .count = q->wire.stream.count,
        .crc = q->wire.stream.crc32c, .body = q->event->body[0],
        .data = q->event->message->body[0].data };

    push(c, s, &one, q->wire.stream.epoch, q->event->message->body_bytes);
}

/* The stream of Q's user that has IDENT; NULL, and told to REPLY: none has. */
static struct stream *stream_asked(struct core *c, const struct request *q, const char *ident,
                                   const struct reply *reply)
{
    struct stream *s = stream_by_id(c, ident_number(~c->settings.secret, ident));

    if (s != NULL && s->user == q->user)
        return s;
    answer_fail(c, reply, MODAL_NOT_FOUND, "stream", NULL, "no such stream of yours");
    return NULL;
}

/* Each part is a push of its own, with its own transaction and answer; only the message is
 * shared. */
static void on_pushes(struct core *c, const struct request *q)
{
    const cJSON *parts = q->wire.stream.parts, *at;
    struct push one = {
        .reply = { .peer = q->reply.peer, .verb = WIRE_STREAM }, .body = q->event->body[0],
        .data = q->event->message->body[0].data };

    one.reply.all = answers_new(c, &q->reply, cJSON_GetArraySize(parts));
    cJSON_ArrayForEach(at, parts) {
        const struct wire_push part = wire_push_read(at);
        struct stream *s = stream_asked(c, q, part.stream, &one.reply);

        one.first = part.first;
        one.crc = part.crc32c;
        one.same = UNTOLD;
        if (s != NULL) {
            one.count = part.bytes / sample_bytes(s);
            push(c, s, &one, part.epoch, part.bytes);
        }
        one.data += part.bytes;
        one.reply.place++;
    }
}

/* ---- closing: the present epoch becomes a batch ---------------------------------------------- */

static void seal(struct core *c, struct stream *s)
{
    cJSON *open = cJSON_Parse(s->header),
          *attributes = cJSON_GetObjectItemCaseSensitive(open, "attributes");
    struct task *task = grab(sizeof *task);
    struct wire_input w;

    if (attributes == NULL)
        attributes = cJSON_AddObjectToObject(open, "attributes");
    cJSON_AddStringToObject(attributes, "stream", s->name);
    cJSON_AddNumberToObject(attributes, "first_sample", (double)s->begin);
    cJSON_AddBoolToObject(attributes, "broken_off", s->broken);
    gaps_write(attributes, s);
    cJSON_DeleteItemFromObject(open, "window");
    cJSON_AddNumberToObject(open, "samples", (double)(s->next - s->begin));
    wire_input_read(open, "", WIRE_BATCH, &w, NULL);
    s->sealed = input_new(c, s->user, &w, input_number(c));
    cJSON_Delete(open);
    task->type = TASK_STREAM_SEAL;
    task->id = s->sealed->id;
    task->shape = s->sealed->shape;
    task->owner = s;
    task->stream = s->id;
    task->epoch = s->epoch;
    task->begin = s->begin;
    task->missing = s->missing;
    core_task_settled(c, task, user_turn(s->user, s->askers == NULL ? 0 : s->askers->reply.peer));
}

/* What was asked to be closed is sealed once all that came before is committed. */
static void end_if_quiet(struct core *c, struct stream *s)
{
    if (s->closing && !s->closed && s->sealed == NULL && s->held == NULL && is_durable(s)
        && s->next > s->begin && s->last == NULL)
        seal(c, s);
}

/* Of all epochs: those before the present one are in no batch. */
static void end_segments(struct stream *s, struct transaction *t)
{
    if (s->segment_count > 0)
        transaction_add(t, LEDGER_SEGMENTS_DELETE)->id = s->id;
    s->user->bytes -= (int64_t)(s->bytes + s->missing);
    s->missing = 0;
    s->segment_count = 0;
}

void stream_sealed(struct core *c, struct task *task)
{
    struct stream *s = task->owner;
    struct transaction *t;

    if (task->status != MODAL_OK) {
        for (struct after *after = s->askers; after != NULL; after = after->next)
            answer_error(c, &after->reply, &task->err, answer_number("retry_after_s", 5));
        after_free(s->askers);
        s->askers = NULL;
        s->closing = false;
        input_forget(c, s->sealed);
        s->sealed = NULL;
        return;
    }
    s->sealed->state = INPUT_SEALED;
    memcpy(s->sealed->sha256, task->sha256, 32);
    s->sealed->crc = task->crc;
    s->sealed->offset = task->offset;
    t = transaction_new();
    input_record_fill(s->sealed, t, &transaction_add(t, LEDGER_INPUT_PUT)->input);
    transaction_add_sums(t, s->sealed->id, &task->sums);
    s->batch = s->sealed->id;
    end_segments(s, t);
    if (window_is_untold(s))
        stream_note(t, s);
    else
        stream_notes_end(t, s);
    window_keep_verdict(c, s, t);
    for (struct after *after = s->askers; after != NULL; after = after->next)
        after->stream = s, after->value = -1;
    transaction_join(t, s->askers);
    s->askers = NULL;
    core_commit(c, t);
}

static void on_close(struct core *c, const struct request *q, struct stream *s)
{
    if (s->closed) {
        answer_state(c, &q->reply, s);
        return;
    }
    if (atomic_load(&s->fence) || s->resumes) {    /* it would end without what was refused */
        refuse_behind(c, s, atomic_load(&s->fence), &q->reply);
        return;
    }
    after_append(&s->askers, after_new(AFTER_STREAM, &q->reply));
    s->broken |= q->wire.stream.broken;
    if (s->closing)
        return;
    s->closing = true;
    /* nothing ever came: there is no batch of no samples */
    if (s->next == s->begin) {
        struct transaction *t = transaction_new();
        end_segments(s, t);
        stream_notes_end(t, s);
        s->askers->stream = s;
        s->askers->value = -1;
        transaction_join(t, s->askers);
        s->askers = NULL;
        core_commit(c, t);
    } else
        end_if_quiet(c, s);
}

void stream_request(struct core *c, const struct request *q)
{
    struct stream *s;

    if (q->wire.stream.op == WIRE_OPEN)
        on_open(c, q);
    else if (q->wire.stream.op == WIRE_PUSHES)
        on_pushes(c, q);
    else if ((s = stream_asked(c, q, q->wire.stream.stream, &q->reply)) == NULL)
        return;
    else if (q->wire.stream.op == WIRE_PUSH)
        on_push(c, q, s);
    else
        on_close(c, q, s);
}

/* ---- a full disk ----------------------------------------------------------------------------- */

/* Back to what is committed.  Of the last window in memory a part may be overwritten, so windows
 * begin anew. */
static void roll_back(struct core *c, struct stream *s)
{
    segments_cut(s);
    window_reset(c, s);
    for (struct after *after = s->askers; after != NULL; after = after->next)
        answer_full(c, &after->reply);
    after_free(s->askers);
    s->askers = NULL;
    s->closing = s->slowed = false;
    s->resumes = true;
    atomic_store(&s->fence, false);                /* nothing of it is under way */
}

void stream_refused(struct core *c, struct after *after, struct transaction *t)
{
    struct stream *s = after->stream;

    s->in_flight -= after->length;
    answer_full(c, &after->reply);
    if (s->last != t || after->next != NULL)
        return;
    s->last = NULL;
    roll_back(c, s);
    go_on(c, s);
}

/* ---- after a commit, and at the start -------------------------------------------------------- */

/* Its batch is sealed: what is left is the answer to who closes it again. */
static void closed(struct core *c, struct stream *s)
{
    if (s->bytes > 0)
        core_task(c, task_new(TASK_REMOVE_SAMPLES, s->id), TURN_NOBODY);
    s->closed = true;
    c->inputs->open_streams--;
    s->closed_ns = c->now.mono_ns;
    if (s->sealed != NULL) {
        s->sealed->committed = true;
        input_index(s->sealed);
        memcpy(s->sha256, s->sealed->sha256, 32);
        s->has_batch = true;
        s->sealed = NULL;                          /* it has a life of its own */
    }
    segments_drop(s);
    window_offer(c, s);
}

void stream_after(struct core *c, struct after *after, struct transaction *t)
{
    struct stream *s = after->stream;

    if (s->last == t)
        s->last = NULL;
    if (after->value == -1)
        closed(c, s);
    else if (after->length > 0) {
        s->in_flight -= after->length;
        s->touched_ns = c->now.utc_ns;
        s->durable_epoch = (uint64_t)after->attempts;
        s->durable = (uint64_t)after->value;
        for (size_t i = 0; i < t->count; i++)
            if (t->changes[i].verb == LEDGER_SEGMENT_PUT)
                window_keep(s, &t->changes[i].segment);
        window_offer(c, s);
    }
    answer_state(c, &after->reply, s);
    go_on(c, s);
    end_if_quiet(c, s);
}

bool stream_is_open(const struct core *c, int64_t id)
{
    const struct stream *s = stream_by_id(c, id);

    return s != NULL && !s->closed;
}

static void stream_free(struct stream *s)
{
    while (s->held != NULL)
        let_go(s);
    after_free(s->askers);
    free(s->name);
    free(s->header);
    segments_drop(s);
    free(s->gaps);
    window_done(&s->window);
    free(s);
}

/* Closed streams are remembered for ten minutes, for who asks again; then until what was asked of
 * the ledger is done, as its last window may be there. */
void streams_retain(struct core *c)
{
    struct stream **link = &c->streams;

    while (*link != NULL) {
        struct stream *s = *link;
        bool over =
            s->closed && !s->window.running && !s->window.queued && !s->window.reading
            && s->closed_ns + FORGOTTEN_S * SECOND <= c->now.mono_ns;
        if (over && s->commits_awaited == 0)
            s->commits_awaited = c->counts.commits + c->uncommitted;
        if (!over || c->counts.commits < s->commits_awaited) {
            link = &s->next_stream;
            continue;
        }
        *link = s->next_stream;
        map_remove(&c->stream_ids, map_hash_number((uint64_t)s->id), s);
        stream_free(s);
    }
}

void streams_done(struct core *c)
{
    struct stream *s;

    while ((s = c->streams) != NULL) {
        c->streams = s->next_stream;
        stream_free(s);
    }
    map_done(&c->stream_ids);
}

const struct user *stream_user(const struct stream *s)
{
    return s->user;
}

const char *stream_name(const struct stream *s)
{
    return s->name;
}
