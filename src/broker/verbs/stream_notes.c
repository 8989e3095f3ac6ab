/*
 * stream_notes.c - what is remembered of a stream over a restart
 *
 * An open one has a note of its own, `stream`, and where windows were told `window` (windows.c; a
 * daemon of before had a part of that in `tracks`).  Its batch takes their place; only where the
 * newest window is not told yet they stay, and `sealed` stands for `stream` until it is.
 */
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
