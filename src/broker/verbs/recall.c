/*
 * recall.c - the samples of a live window that are no more in memory, from disk
 *
 * After a restart an open stream's windows go on from its file.  One that was sealed before its
 * newest window was told has that window's samples in its batch.
 */
#include "broker/core/inputs.h"
#include "broker/verbs/streams.h"
#include "broker/verbs/verbs.h"
#include <stdlib.h>
#include <string.h>

/* S has samples from before the start: its windows go on from them. */
static void recall(struct core *c, struct stream *s)
{
    struct window *w = &s->window;
    uint64_t count = s->next - s->run_from < w->samples ? s->next - s->run_from : w->samples;
    struct task *task;

    w->here = s->next;
    if (count == 0)
        return;
    w->reading = true;
    task = task_new(TASK_SAMPLES_READ, 0);
    task->owner = s;
    task->stream = s->id;
    task->epoch = s->epoch;
    task->shape.channels = s->channels;
    task->begin = s->next - count;
    task->length = count;
    core_task(c, task, user_turn(s->user, 0));
}

/* The samples of S's last window are not to be had: nobody is told of it. */
static void give_up_last(struct core *c, struct stream *s)
{
    struct transaction *t = transaction_new();

    s->window.next = s->durable + 1;
    stream_notes_end(t, s);
    core_commit(c, t);
}

void window_read_last(struct core *c, struct stream *s)
{
    struct window *w = &s->window;
    const uint64_t size = sample_bytes(s), from = s->durable - w->samples;
    struct input *input = input_by_id(c, s->batch);
    struct task *task = NULL;

    if (input != NULL && window_is_untold(s))
        task = input_piece(input, (from - s->begin) * size, w->samples * size);
    if (task == NULL) {
        give_up_last(c, s);
        return;
    }
    w->reading = true;
    task->type = TASK_BATCH_READ;
    task->owner = s;
    task->epoch = s->epoch;
    core_task(c, task, user_turn(s->user, 0));
}

/* A stream that was sealed before the start is there for its last window, and for who asks again. */
static void recall_sealed(struct core *c, struct stream *s)
{
    const struct input *input = input_by_id(c, s->batch);

    s->closed_ns = c->now.mono_ns;
    if (input != NULL) {
        memcpy(s->sha256, input_sha256(input), sizeof s->sha256);
        s->has_batch = true;
    }
    window_read_last(c, s);
}

void windows_recall(struct core *c)
{
    for (struct stream *s = c->streams; s != NULL; s = s->next_stream)
        if (s->closed)
            recall_sealed(c, s);
        else if (s->window.samples > 0)
            recall(c, s);
}

/* Samples FIRST .. are S's, where they are still wanted. */
static void take_recalled(struct stream *s, uint64_t first, uint64_t end, const char *data)
{
    struct window *w = &s->window;
    const uint64_t size = sample_bytes(s);

    if (w->recent == NULL)
        w->recent = grab(w->samples * size);
    /* samples that came meanwhile are newer, and may have the places of these */
    for (uint64_t i = first; i < end; i++)
        if (i + w->samples >= s->durable)
            memcpy(w->recent + i % w->samples * size, data + (i - first) * size, size);
    w->here = first;
}

void window_recalled(struct core *c, struct task *task)
{
    struct stream *s = task->owner;
    struct window *w = &s->window;
    const bool last = task->type == TASK_BATCH_READ;
    const uint64_t first = last ? s->durable - w->samples : task->begin,
                   end = last ? s->durable : task->begin + task->length;

    w->reading = false;
    if (last && task->status == MODAL_OK)
        take_recalled(s, first, end, task->text->data);
    else if (last)
        give_up_last(c, s);
    else if (task->status == MODAL_OK && !s->closed && task->epoch == s->epoch && w->here == end)
        take_recalled(s, first, end, task->text->data);
    window_offer(c, s);
}
