/* feed.c - see feed.h */
#include "feed.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "ctl/field.h"
#include "wire/protocol.h"

struct entry {
    int64_t number;                  /* -1: of no event, or of one without */
    double time;
    size_t length;
    char stream[FEED_WORD_MOST + 1], job[FEED_WORD_MOST + 1], kind[FEED_WORD_MOST + 1];
    char text[];
};

struct feed {
    struct entry *entry[FEED_EVENTS];         /* by sequence % FEED_EVENTS */
    uint64_t first, end;                      /* sequences kept: first <= i < end */
    size_t bytes;
    int64_t number, forgotten;                /* of the last event; of the last no more kept */
};

struct feed *feed_new(void)
{
    struct feed *feed = calloc(1, sizeof *feed);

    if (feed != NULL)
        feed->number = feed->forgotten = -1;
    return feed;
}

static void forget_first(struct feed *feed)
{
    struct entry **e = &feed->entry[feed->first++ % FEED_EVENTS];

    if ((*e)->number >= 0)
        feed->forgotten = (*e)->number;
    feed->bytes -= sizeof **e + (*e)->length;
    free(*e);
    *e = NULL;
}

void feed_clear(struct feed *feed, int64_t from)
{
    while (feed->first < feed->end)
        forget_first(feed);
    feed->number = feed->forgotten = from - 1;
}

void feed_free(struct feed *feed)
{
    if (feed == NULL)
        return;
    feed_clear(feed, 0);
    free(feed);
}

/* Room for LENGTH bytes of text at the end; NULL: no memory, and the event is nobody's. */
static struct entry *append(struct feed *feed, const char *text, size_t length)
{
    struct entry *e = calloc(1, sizeof *e + length + 1);

    if (e == NULL)
        return NULL;
    memcpy(e->text, text, length);
    e->length = length;
    e->number = -1;
    feed->bytes += sizeof *e + length;
    while (feed->first < feed->end
           && (feed->end - feed->first == FEED_EVENTS || feed->bytes > FEED_BYTES))
        forget_first(feed);
    feed->entry[feed->end++ % FEED_EVENTS] = e;
    return e;
}

void feed_add(struct feed *feed, const cJSON *event)
{
    /* what is no number of the protocol's is none */
    double told = field_number(event, "number", -1), number = told <= WIRE_INTEGER_MOST ? told : -1;
    char *json = json_print(event), *text = NULL;
    struct entry *e = NULL;
    int length = json == NULL  ? -1
                 : number >= 0 ? asprintf(&text, "id: %.0f\ndata: %s\n\n", number, json)
                               : asprintf(&text, "data: %s\n\n", json);

    if (length >= 0)
        e = append(feed, text, (size_t)length);
    if (e != NULL) {
        e->time = field_number(event, "time", 0);
        snprintf(e->stream, sizeof e->stream, "%s", field_word(event, "stream", ""));
        snprintf(e->job, sizeof e->job, "%s", field_word(event, "job", ""));
        snprintf(e->kind, sizeof e->kind, "%s", field_word(event, "event", ""));
        e->number = number >= 0 ? (int64_t)number : -1;
    }
    if (number >= 0)
        feed->number = (int64_t)number;
    free(json);
    if (length >= 0)
        free(text);
}

void feed_say(struct feed *feed, const char *text)
{
    append(feed, text, strlen(text));
}

int64_t feed_number(const struct feed *feed)
{
    return feed->number;
}

int64_t feed_first(const struct feed *feed)
{
    return feed->forgotten + 1;
}

int feed_count(const struct feed *feed, const char *kind, double since)
{
    int count = 0;

    for (uint64_t i = feed->end; i > feed->first; i--) {
        const struct entry *e = feed->entry[(i - 1) % FEED_EVENTS];
        if (e->number >= 0 && e->time < since)
            break;
        count += e->number >= 0 && (kind == NULL || strcmp(kind, e->kind) == 0);
    }
    return count;
}

bool feed_seek(const struct feed *feed, struct feed_place *place, int64_t from)
{
    place->at = feed->end;
    place->offset = 0;
    if (from < 0)
        return true;
    for (uint64_t i = feed->end; i > feed->first; i--) {
        const struct entry *e = feed->entry[(i - 1) % FEED_EVENTS];
        if (e->number >= 0 && e->number < from)
            break;
        if (e->number >= from)
            place->at = i - 1;
    }
    return from > feed->forgotten && from <= feed->number + 1;
}

/* Is KIND one of the list KINDS? */
static bool is_among(const char *kind, const char *kinds)
{
    size_t length = strlen(kind);

    for (const char *at = kinds; at != NULL && *at != 0; at = strchr(at, ',') ? strchr(at, ',') + 1
                                                                              : NULL)
        if (strncmp(at, kind, length) == 0 && (at[length] == ',' || at[length] == 0))
            return true;
    return kinds[0] == 0;
}

/* What is no event concerns everybody. */
static bool is_wanted(const struct entry *e, const struct feed_place *place)
{
    return e->kind[0] == 0
        || (is_among(e->kind, place->kinds)
            && (place->stream[0] == 0 || strcmp(place->stream, e->stream) == 0)
            && (place->job[0] == 0 || strcmp(place->job, e->job) == 0));
}

ssize_t feed_read(const struct feed *feed, struct feed_place *place, char *buffer, size_t room)
{
    size_t used = 0;

    if (place->at < feed->first)
        return -1;
    while (place->at < feed->end && used < room) {
        const struct entry *e = feed->entry[place->at % FEED_EVENTS];
        size_t rest = is_wanted(e, place) ? e->length - place->offset : 0,
               now = rest < room - used ? rest : room - used;
        memcpy(buffer + used, e->text + place->offset, now);
        used += now;
        place->offset += now;
        if (now == rest) {
            place->at++;
            place->offset = 0;
        }
    }
    return (ssize_t)used;
}
