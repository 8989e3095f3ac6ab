/*
 * stream_notes.c - what is remembered of a stream over a restart
 *
 * An open one has a note of its own, `stream`, and where windows were told `window` and `tracks`
 * (windows.c).  Its batch takes their place; only where the newest window is not told yet they
 * stay, and `sealed` stands for `stream` until it is.
 */
#include "broker/core/inputs.h"
#include "broker/verbs/streams.h"
#include "broker/verbs/verbs.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void put(struct transaction *t, const char *topic, const struct stream *s, const char *text)
{
    char name[32];

    snprintf(name, sizeof name, "%lld", (long long)s->id);
    transaction_add(t, LEDGER_NOTE_PUT)->note =
        (struct note_record) { topic, transaction_text(t, name),
                               text != NULL ? transaction_text(t, text) : NULL };
}

void stream_note(struct transaction *t, const struct stream *s)
{
    cJSON *text = cJSON_CreateObject();
    char *printed;

    cJSON_AddStringToObject(text, "user", s->user->name);
    cJSON_AddStringToObject(text, "name", s->name);
    cJSON_AddRawToObject(text, "open", s->header);
    cJSON_AddNumberToObject(text, "epoch", (double)s->epoch);
    cJSON_AddNumberToObject(text, "begin", (double)s->begin);
    if (s->batch > 0) {
        cJSON_AddNumberToObject(text, "batch", (double)s->batch);
        cJSON_AddNumberToObject(text, "end", (double)s->next);
        cJSON_AddNumberToObject(text, "run_from", (double)s->run_from);
        gaps_write(text, s);
    }
    printed = json_print(text);
    cJSON_Delete(text);
    put(t, s->batch > 0 ? "sealed" : "stream", s, printed);
    if (s->batch > 0)
        put(t, "stream", s, NULL);
    free(printed);
}

void stream_notes_end(struct transaction *t, const struct stream *s)
{
    static const char *const topics[] = { "sealed", "stream", "tracks", "window" };

    for (size_t i = 0; i < sizeof topics / sizeof *topics; i++)
        put(t, topics[i], s, NULL);
}

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
