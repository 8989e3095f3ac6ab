/*
 * stream_list.c - STREAMS: the open streams, and the batches that closed ones were sealed into
 *
 * Streams and inputs have their numbers of one sequence: both are listed by it, the newest first,
 * and a number is the cursor.
 */
#include <stdlib.h>
#include <string.h>
#include "base/sha256.h"
#include "broker/core/inputs.h"
#include "broker/verbs/streams.h"
#include "broker/verbs/verbs.h"

/* One of the two. */
struct listed { int64_t id; const struct stream *open; const struct input *sealed; };

struct list { struct listed *all; size_t count, room; };

static void add(struct list *list, struct listed one)
{
    if (list->count == list->room) {
        list->room = list->room ? 2 * list->room : 64;
        list->all = regrab(list->all, list->room * sizeof *list->all);
    }
    list->all[list->count++] = one;
}

static bool is_named(const char *have, const char *name)
{
    return name == NULL || strcmp(have, name) == 0;
}

/* Those of USER (NULL: of everybody) that are called NAME (NULL: all), from before BEFORE. */
static void add_open(const struct core *c, const struct user *user, const char *name,
                     int64_t before, struct list *list)
{
    for (const struct stream *s = c->streams; s != NULL; s = s->next_stream)
        if (!s->closed && s->id < before && (user == NULL || s->user == user)
            && is_named(s->name, name))
            add(list, (struct listed) { s->id, s, NULL });
}

static void add_sealed(const struct user *user, const char *name, int64_t before,
                       struct list *list)
{
    const struct input *input;
    size_t at = 0;

    while ((input = map_next(&user->inputs, &at)) != NULL)
        if (input->stream != NULL && input->id < before && !input->going
            && is_named(input->stream, name))
            add(list, (struct listed) { input->id, NULL, input });
}

static int newer_first(const void *a, const void *b)
{
    const struct listed *x = a, *y = b;

    return (x->id < y->id) - (x->id > y->id);
}

static double seconds(int64_t ns)
{
    return (double)ns / (double)SECOND;
}

static void write_open(const struct core *c, struct json_text *page, const struct stream *s)
{
    const struct window *w = &s->window;
    char ident[IDENT_TEXT];

    ident_text(ident, ~c->settings.secret, s->id);
    json_text_string(page, "name", s->name);
    json_text_string(page, "user", s->user->name);
    json_text_string(page, "state", s->closing ? "closing" : "open");
    json_text_string(page, "stream", ident);
    json_text_number(page, "channels", (double)s->channels);
    json_text_number(page, "dt", s->dt);
    json_text_number(page, "epoch", (double)s->durable_epoch);
    json_text_number(page, "samples", (double)(s->durable - s->begin));
    json_text_number(page, "age_s", seconds(c->now.utc_ns - s->touched_ns));
    if (w->samples == 0)
        return;
    json_text_string(page, "verdict", w->verdict);
    if (w->verdict != NULL && w->told_epoch == s->durable_epoch)
        json_text_number(page, "lag", (double)(s->durable - w->told - 1));
    json_text_number(page, "skipped", (double)w->skipped_all);
}

static void write_sealed(const struct core *c, struct json_text *page, const struct input *input)
{
    int64_t left_ns = input->used_ns + c->settings.input_age_ns - c->now.utc_ns;
    char hex[65], ident[IDENT_TEXT];

    sha256_hex(input->sha256, hex);
    ident_text(ident, ~c->settings.secret, input->id);
    json_text_string(page, "name", input->stream);
    json_text_string(page, "user", input->user->name);
    json_text_string(page, "state", "sealed");
    json_text_string(page, "upload", ident);
    json_text_string(page, "sha256", hex);
    json_text_number(page, "channels", (double)input->shape.channels);
    json_text_number(page, "dt", input->shape.dt);
    json_text_number(page, "samples", (double)input->shape.samples);
    json_text_number(page, "age_s", seconds(c->now.utc_ns - input->created_ns));
    if (input->verdict != NULL)
        json_text_string(page, "verdict", input->verdict);
    if (input->jobs == 0)
        json_text_number(page, "kept_s", seconds(left_ns > 0 ? left_ns : 0));
}

/* The first LIMIT of LIST. */
static char *print_page(const struct core *c, const struct list *list, size_t limit)
{
    struct json_text page = { 0 };
    size_t count = list->count < limit ? list->count : limit;
    char ident[IDENT_TEXT];

    json_text_open(&page, NULL);
    json_text_key(&page, "streams");
    json_text_raw(&page, "[");
    for (size_t i = 0; i < count; i++) {
        json_text_open(&page, NULL);
        if (list->all[i].open != NULL)
            write_open(c, &page, list->all[i].open);
        else
            write_sealed(c, &page, list->all[i].sealed);
        json_text_close(&page);
    }
    json_text_raw(&page, "]");
    if (count < list->count)
        ident_text(ident, ~c->settings.secret, list->all[count - 1].id);
    json_text_string(&page, "next", count < list->count ? ident : NULL);
    return text_end(&page);
}

void streams_request(struct core *c, const struct request *q)
{
    const struct wire_streams *l = &q->wire.streams;
    const bool everybody = l->user == NULL && l->name == NULL
                           && q->user->account->role == WIRE_ROLE_ADMIN;
    const struct user *user = user_listed(c, &q->reply, q->user, l->user);
    int64_t before = l->after == NULL ? INT64_MAX : ident_number(~c->settings.secret, l->after);
    struct list list = { 0 };
    cJSON *header;
    char *text;

    if (user == NULL)
        return;
    if (before < 0) {
        answer_fail(c, &q->reply, MODAL_BAD_INPUT, "after", NULL,
                    "after is no cursor of STREAMS; accepted: `next` of an earlier page");
        return;
    }
    add_open(c, everybody ? NULL : user, l->name, before, &list);
    for (size_t i = 0; i < c->user_count; i++)
        if (everybody || c->user_list[i] == user)
            add_sealed(c->user_list[i], l->name, before, &list);
    if (list.count > 0)
        qsort(list.all, list.count, sizeof *list.all, newer_first);
    text = print_page(c, &list, (size_t)l->limit);
    header = answer_new(&q->reply);
    cJSON_AddNumberToObject(header, "count", list.count < (size_t)l->limit ? (double)list.count
                                                                           : l->limit);
    answer_send(c, &q->reply, header, blob_take(text, strlen(text)));
    free(list.all);
}
