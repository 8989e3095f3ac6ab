/* readers.c - see readers.h */
#include "readers.h"
#include "link.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    OPENING_MOST = 160,          /* bytes of the first lines: two numbers and what is about them */
    DIGITS_MOST = 15,            /* of a number below 2^53 */
};

static const char beat[] = ":\n\n";          /* a comment */

struct reader {
    struct reader *next;
    struct readers *of;
    struct MHD_Connection *connection;
    const struct feed *feed;
    struct feed_place place;
    bool suspended, beat;
    size_t said;                         /* bytes of the opening that he has */
    char opening[OPENING_MOST];
};

static ssize_t give(void *context, uint64_t position, char *buffer, size_t room)
{
    struct reader *r = context;
    size_t rest = strlen(r->opening) - r->said;
    ssize_t n;

    (void)position;
    if (rest > 0) {
        rest = rest < room ? rest : room;
        memcpy(buffer, r->opening + r->said, rest);
        r->said += rest;
        return (ssize_t)rest;
    }
    n = feed_read(r->feed, &r->place, buffer, room);
    if (n < 0) {
        r->of->dropped++;
        return MHD_CONTENT_READER_END_OF_STREAM;
    }
    if (n == 0 && r->beat && room >= strlen(beat)) {
        n = (ssize_t)strlen(beat);
        memcpy(buffer, beat, strlen(beat));
    }
    r->beat = false;
    if (n == 0) {
        r->suspended = true;
        MHD_suspend_connection(r->connection);
    }
    return n;
}

static void leave(void *context)
{
    struct reader *r = context;

    for (struct reader **link = &r->of->first; *link != NULL; link = &(*link)->next)
        if (*link == r) {
            *link = r->next;
            break;
        }
    r->of->count--;
    free(r);
}

/* The number to begin with; -1: with what comes. */
static int64_t first_wanted(const struct visit *visit)
{
    char from[URL_NAME_MOST + 1];
    const char *last = visit_header(visit, "Last-Event-ID"), *text = last != NULL ? last : from;
    size_t digits;

    visit_argument(visit, "from", from);
    digits = strspn(text, "0123456789");
    if (digits == 0 || digits > DIGITS_MOST || text[digits] != 0)
        return -1;
    return atoll(text) + (last != NULL);
}

static struct reader *reader_new(struct readers *readers, const struct feed *feed,
                                 const struct visit *visit)
{
    struct reader *r = calloc(1, sizeof *r);

    if (r == NULL)
        return NULL;
    r->of = readers;
    r->connection = visit->connection;
    r->feed = feed;
    visit_argument(visit, "stream", r->place.stream);
    visit_argument(visit, "job", r->place.job);
    visit_argument(visit, "kinds", r->place.kinds);
    snprintf(r->opening, sizeof r->opening, "retry: 1000\n\n");
    if (!feed_seek(feed, &r->place, first_wanted(visit)))
        snprintf(r->opening, sizeof r->opening,
                 "retry: 1000\n\nid: %lld\ndata: {\"event\":\"lost\",\"number\":%lld}\n\n",
                 (long long)feed_first(feed) - 1, (long long)feed_first(feed));
    r->next = readers->first;
    readers->first = r;
    readers->count++;
    return r;
}

enum MHD_Result readers_add(struct readers *readers, struct feed *feed, struct visit *visit)
{
    enum { BLOCK = 16384 };              /* bytes asked for at a time */
    struct reader *r = readers->count < READERS_MOST ? reader_new(readers, feed, visit) : NULL;
    struct MHD_Response *response;
    enum MHD_Result rc;

    if (r == NULL) {
        visit_fail(visit, MHD_HTTP_SERVICE_UNAVAILABLE, "Too many readers",
                   "As many as this page serves read its events already.");
        return visit_send(visit);
    }
    response = MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, BLOCK, give, r, leave);
    if (response == NULL) {
        leave(r);
        return MHD_NO;
    }
    visit_guard(response);
    MHD_add_response_header(response, "Content-Type", "text/event-stream");
    MHD_add_response_header(response, "X-Accel-Buffering", "no");
    rc = MHD_queue_response(visit->connection, MHD_HTTP_OK, response);
    MHD_destroy_response(response);
    return rc;
}

void readers_wake(struct readers *readers)
{
    for (struct reader *r = readers->first; r != NULL; r = r->next)
        if (r->suspended) {
            r->suspended = false;
            MHD_resume_connection(r->connection);
        }
}

void readers_step(struct readers *readers)
{
    double now = link_now();

    if (now < readers->beat_at)
        return;
    readers->beat_at = now + READERS_BEAT_S;
    for (struct reader *r = readers->first; r != NULL; r = r->next)
        r->beat = true;
    readers_wake(readers);
}
