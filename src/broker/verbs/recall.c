/*
 * recall.c - streams and their live windows as a daemon that starts again finds them
 *
 * An open stream's windows go on from its file.  One that was sealed before its newest window was
 * told has that window's samples in its batch (windows.c).
 */
#include "broker/core/inputs.h"
#include "broker/verbs/streams.h"
#include "broker/verbs/verbs.h"
#include "broker/verbs/window_turns.h"
#include <stdlib.h>
#include <string.h>

/* ---- what the ledger has ---- */

/* The stream of note R, as it was opened; TEXT: all of the note, for the caller to delete.  NULL:
 * it cannot be kept. */
static struct stream *load(struct core *c, const struct note_record *r, cJSON **text)
{
    cJSON *open;
    const char *user = "", *name = "";
    double epoch = 0, begin = 0;
    struct wire_input w;
    struct stream *s;

    if (json_read(r->text, strlen(r->text), text, NULL) != MODAL_OK)
        return NULL;
    open = cJSON_GetObjectItemCaseSensitive(*text, "open");
    json_get_string(*text, "", "user", &user, NULL);
    json_get_string(*text, "", "name", &name, NULL);
    json_get_number(*text, "", "epoch", 0, WIRE_INTEGER_MOST, &epoch, NULL);
    json_get_number(*text, "", "begin", 0, WIRE_INTEGER_MOST, &begin, NULL);
    cJSON_AddNumberToObject(open, "samples", 1);
    /* without samples it has no row that would keep it */
    input_number_past(c, strtoll(r->name, NULL, 10));
    if (wire_input_read(open, "", WIRE_BATCH, &w, NULL) != MODAL_OK)
        return NULL;
    s = stream_make(c, user_get(c, user), name, &w,
                    cJSON_GetObjectItemCaseSensitive(open, "window"), strtoll(r->name, NULL, 10));
    s->epoch = s->durable_epoch = (uint64_t)epoch;
    s->begin = s->next = s->durable = s->run_from = (uint64_t)begin;
    return s;
}

void stream_load_note(struct core *c, const struct note_record *r)
{
    cJSON *text = NULL;

    load(c, r, &text);
    cJSON_Delete(text);
}

void stream_load_sealed(struct core *c, const struct note_record *r)
{
    cJSON *text = NULL, *gap;
    struct stream *s = load(c, r, &text);
    double batch = 0, end = 0, run_from = 0;

    if (s != NULL) {
        json_get_number(text, "", "batch", 0, WIRE_INTEGER_MOST, &batch, NULL);
        json_get_number(text, "", "end", 0, WIRE_INTEGER_MOST, &end, NULL);
        json_get_number(text, "", "run_from", 0, WIRE_INTEGER_MOST, &run_from, NULL);
        s->batch = (int64_t)batch;
        s->next = s->durable = (uint64_t)end, s->run_from = (uint64_t)run_from;
        cJSON_ArrayForEach(gap, cJSON_GetObjectItemCaseSensitive(text, "gaps"))
            gaps_add(s, (uint64_t)cJSON_GetNumberValue(cJSON_GetArrayItem(gap, 0)),
                     (uint64_t)cJSON_GetNumberValue(cJSON_GetArrayItem(gap, 1)));
        s->user->bytes -= (int64_t)s->missing;     /* its batch is charged for them */
        s->missing = 0;
        s->closing = s->closed = true;
        c->inputs->open_streams--;
    }
    cJSON_Delete(text);
}

/* Segments, in the order in which they came, find their streams once all notes are read. */
void stream_load_segment(struct core *c, const struct segment_record *r)
{
    struct stream *s = stream_by_id(c, r->stream);

    if (s == NULL || s->closed)
        return;
    /* an epoch whose samples were on disk before its note was */
    if (r->epoch > s->epoch) {
        s->epoch = s->durable_epoch = r->epoch;
        gaps_drop(s);
    }
    if (r->epoch == s->epoch) {
        bool any = s->segment_count > 0 && s->segments[s->segment_count - 1].epoch == s->epoch;
        if (!any)
            s->begin = s->next = s->run_from = r->first;
        if (r->first > s->next) {
            gaps_add(s, s->next, r->first);
            s->run_from = r->first;
        }
        s->next = s->durable = r->first + r->count;
    }
    segments_add(s, r->epoch, r->first, r->count);
}

/* The one of `window_verdicts` that TEXT is; NULL: none. */
static const char *verdict_of(const char *text)
{
    for (int i = 0; window_verdicts[i] != NULL; i++)
        if (text != NULL && strcmp(window_verdicts[i], text) == 0)
            return window_verdicts[i];
    return NULL;
}

static void take_tracks(struct stream *s, const char *tracks)
{
    free(s->window.tracks);
    s->window.tracks = grab_text(tracks);
}

void window_load_told(struct core *c, const struct note_record *r)
{
    struct stream *s = stream_by_id(c, strtoll(r->name, NULL, 10));
    cJSON *text = NULL;
    const char *verdict = NULL, *tracks = NULL;
    double epoch = -1, next = 0, told = 0, round = 0;

    if (json_read(r->text, strlen(r->text), &text, NULL) != MODAL_OK)
        return;
    json_get_number(text, "", "epoch", 0, WIRE_INTEGER_MOST, &epoch, NULL);
    json_get_number(text, "", "next", 0, WIRE_INTEGER_MOST, &next, NULL);
    json_get_number(text, "", "told", 0, WIRE_INTEGER_MOST, &told, NULL);
    json_get_number(text, "", "round", 0, WIRE_INTEGER_MOST, &round, NULL);
    verdict = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(text, "verdict"));
    tracks = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(text, "tracks"));
    if (s != NULL && (double)s->epoch == epoch) {
        s->window.next = (uint64_t)next;
        s->window.verdict = verdict_of(verdict);
        s->window.told_epoch = s->epoch;
        s->window.told = (uint64_t)told;
    }
    if (s != NULL)
        turn_recall(c, s, (int64_t)round);
    if (s != NULL && tracks != NULL)
        take_tracks(s, tracks);
    cJSON_Delete(text);
}

void window_load_verdict(struct core *c, const struct note_record *r)
{
    input_judge(c, strtoll(r->name, NULL, 10), verdict_of(r->text), NULL);
}

void window_load_tracks(struct core *c, const struct note_record *r)
{
    struct stream *s = stream_by_id(c, strtoll(r->name, NULL, 10));

    if (s != NULL)
        take_tracks(s, r->text);
}

/* ---- the samples ---- */

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

/* A stream that was sealed before the start is there for its last window, and for who asks
 * again. */
static void recall_sealed(struct core *c, struct stream *s)
{
    const struct input *input = input_by_id(c, s->batch);

    s->closed_ns = c->now.mono_ns;
    if (input != NULL) {
        memcpy(s->sha256, input_sha256(input), sizeof s->sha256);
        s->has_batch = true;
    }
    window_offer(c, s);
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
        window_forget_last(c, s);
    else if (task->status == MODAL_OK && !s->closed && task->epoch == s->epoch && w->here == end)
        take_recalled(s, first, end, task->text->data);
    window_offer(c, s);
}
