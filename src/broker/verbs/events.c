/*
 * events.c - numbered edges to subscribers, from memory where they are recent and from the ledger
 * where they are not
 *
 * A subscriber has the number of the next event it has not seen.  The last RING committed events
 * are in memory; further back the ledger is read, a page at a time.  A peer that takes no more
 * messages is passed over until it does.
 */
#include "broker/core/jobs.h"
#include "broker/verbs/events.h"
#include "broker/verbs/verbs.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    PAGE = 256,               /* events read, or told to one subscriber, at once */
    PRUNED_AT_LEAST = 1024,   /* events go in such groups: pruning costs a transaction */
};

static bool is_full(const struct core *c, uint64_t peer)
{
    for (size_t i = 0; i < c->events->full_count; i++)
        if (c->events->full[i] == peer)
            return true;
    return false;
}

static void send_event(struct core *c, const struct subscription *s, const struct event_row *row)
{
    cJSON *header = cJSON_CreateObject();
    char number[24], *text;

    snprintf(number, sizeof number, "%llu", (unsigned long long)s->number);
    cJSON_AddStringToObject(header, "subscription", number);
    if (row->number > 0)
        cJSON_AddNumberToObject(header, "number", (double)row->number);
    cJSON_AddNumberToObject(header, "time", (double)(row->ns / 1000000) / 1000);
    text = json_print(header);
    cJSON_Delete(header);
    if (text == NULL || strlen(row->text) < sizeof "{}")
        abort();
    text[strlen(text) - 1] = ',';                  /* the event's own members follow */
    core_act(c, (struct action) {
        .type = ACT_SEND, .peer = s->peer, .verb = "EVENT",
        .header = grab_format("%s%s", text, row->text + 1) });
    free(text);
}

/* Each text begins with what it is. */
static bool is_of_kinds(const char *text, unsigned kinds)
{
    static const char start[] = "{\"event\":\"";
    const char *event = text + sizeof start - 1;

    for (int n = 0; kinds != 0 && wire_events[n] != NULL; n++) {
        size_t length = strlen(wire_events[n]);
        if ((kinds & 1u << n) && strncmp(event, wire_events[n], length) == 0
            && event[length] == '"')
            return true;
    }
    return kinds == 0;
}

static bool wants(const struct subscription *s, const struct event_row *row)
{
    return is_of_kinds(row->text, s->kinds)
        && (row->user == NULL || strcmp(row->user, s->user->name) == 0)
        && (s->job == 0 || s->job == row->job)
        && (s->stream == NULL || (row->topic != NULL && strcmp(row->topic, s->stream) == 0));
}

static void read_page(struct core *c, struct subscription *s)
{
    struct task *task = task_new(TASK_READ_EVENTS, 0);

    task->offset = (uint64_t)(s->next_event - 1);
    task->length = PAGE;
    task->after = after_new(AFTER_EVENT, NULL);
    task->after->value = (int64_t)s->number;
    snprintf(task->user, sizeof task->user, "%s", s->user->name);
    s->reading = true;
    core_task(c, task, user_turn(s->user, s->peer));
}

/* The oldest event that is in memory, by number. */
static int64_t ring_first(const struct core *c, int64_t last)
{
    int64_t first = last + 1;

    while (first > 1 && first > last + 1 - RING
           && c->events->ring[(first - 1) % RING].number == first - 1)
        first--;
    return first;
}

static int64_t ring_last(const struct core *c)
{
    return c->last_event;                        /* committed */
}

/* *FIRST: ring_first, looked for once for all who have something to be told; 0: not yet. */
static void pump(struct core *c, struct subscription *s, int64_t *first)
{
    int64_t last = ring_last(c);

    if (s->reading || s->gone || s->next_event > last || is_full(c, s->peer))
        return;
    if (*first == 0)
        *first = ring_first(c, last);
    if (s->next_event < *first) {
        read_page(c, s);
        return;
    }
    for (int budget = 0; s->next_event <= last && budget < PAGE; budget++) {
        const struct event_row *row = &c->events->ring[s->next_event++ % RING];
        if (wants(s, row))
            send_event(c, s, row);
    }
    c->events->stirred |= s->next_event <= last;
}

void events_pump(struct core *c)
{
    struct subscription **link = &c->events->subscriptions;
    int64_t first = 0;

    if (!c->events->stirred)           /* most steps are samples, of which nobody is told */
        return;
    c->events->stirred = false;
    while (*link != NULL) {
        struct subscription *s = *link;
        if (s->gone && !s->reading) {
            *link = s->next;
            s->user->subscriptions--;
            free(s->stream);
            free(s);
            continue;
        }
        pump(c, s, &first);
        link = &s->next;
    }
}

void events_committed(struct core *c, struct after *after)
{
    struct event_row *row = &c->events->ring[after->value % RING];

    free(row->user);
    free(row->topic);
    free(row->text);
    *row = (struct event_row) { .number = after->value, .ns = after->ns, .text = after->text };
    after->text = NULL;
    if (after->job != NULL) {
        row->job = after->job->id;
        row->user = grab_text(after->job->user->name);
    }
    if (after->stream != NULL) {
        row->user = grab_text(stream_user(after->stream)->name);
        row->topic = grab_text(stream_name(after->stream));
    }
    c->last_event = after->value;
    c->events->stirred = true;
}

void events_progress(struct core *c, struct job *job)
{
    char ident[9];
    struct event_row row = { .ns = c->now.utc_ns, .job = job->id, .user = job->user->name };

    if (c->events->subscriptions == NULL)
        return;
    job_ident(c, job, ident);
    row.text = grab_format("{\"event\":\"progress\",\"job\":\"%s\",\"progress\":%s}", ident,
                           job->progress);
    for (struct subscription *s = c->events->subscriptions; s != NULL; s = s->next)
        if (!s->gone && !is_full(c, s->peer) && wants(s, &row))
            send_event(c, s, &row);
    free(row.text);
}

void events_task_done(struct core *c, struct task *task)
{
    struct subscription *s = c->events->subscriptions;

    while (s != NULL && s->number != (uint64_t)task->after->value)
        s = s->next;
    if (s == NULL)
        return;
    s->reading = false;
    c->events->stirred = true;
    if (s->gone || task->status != MODAL_OK)
        return;
    if (task->event_count > 0 && (int64_t)task->offset + 1 < task->events[0].number
        && (int64_t)task->total > (int64_t)task->offset + 1) {
        struct event_row lost = {
            .ns = c->now.utc_ns, .text = (char *)"{\"event\":\"lost\"}",
            .number = (int64_t)task->total };
        send_event(c, s, &lost);                   /* the first that is kept */
    }
    for (int i = 0; i < task->event_count; i++)
        if (wants(s, &task->events[i]))
            send_event(c, s, &task->events[i]);
    if (task->event_count == PAGE)
        s->next_event = task->events[PAGE - 1].number + 1;
    /* the rest, up to what is in memory, is others' */
    else {
        int64_t first = ring_first(c, ring_last(c));
        int64_t seen =
            task->event_count > 0 ? task->events[task->event_count - 1].number + 1 : s->next_event;
        s->next_event = seen > first ? seen : first;
    }
}

void events_revoke(struct core *c)
{
    struct modal_error err;

    modal_fail(&err, MODAL_DENIED, "this key is not, or no longer, admitted");
    for (struct subscription *s = c->events->subscriptions; s != NULL; s = s->next)
        if (!s->gone && !user_admits(c, s->user, s->key)) {
            answer_error(c, &s->reply, &err, NULL);
            s->gone = c->events->stirred = true;
        }
}

static void unsubscribe(struct core *c, const struct request *q)
{
    const char *number = q->wire.events.subscription;
    uint64_t wanted = strtoull(number, NULL, 10);
    cJSON *header;

    for (struct subscription *s = c->events->subscriptions; s != NULL; s = s->next)
        if (s->number == wanted && s->user == q->user && !s->gone) {
            s->gone = c->events->stirred = true;
            header = answer_new(&q->reply);
            cJSON_AddStringToObject(header, "subscription", number);
            answer_send(c, &q->reply, header, NULL);
            return;
        }
    answer_fail(c, &q->reply, MODAL_NOT_FOUND, "subscription", NULL,
                "no such subscription of yours");
}

void events_request(struct core *c, const struct request *q)
{
    struct subscription *s;
    struct job *job = NULL;
    cJSON *header;
    char number[24];

    if (q->wire.events.op == WIRE_UNSUBSCRIBE) {
        unsubscribe(c, q);
        return;
    }
    if (q->user->subscriptions >= WIRE_SUBSCRIPTIONS_MOST) {
        answer_fail(c, &q->reply, MODAL_BUSY, "", answer_number("retry_after_s", 1),
                    "%d subscriptions are open, at most %d", q->user->subscriptions,
                    WIRE_SUBSCRIPTIONS_MOST);
        return;
    }
    if (q->wire.job.id != NULL || q->wire.job.key != NULL) {
        job = job_find(c, q->user, &q->wire.job);
        if (job == NULL || !job->committed) {
            answer_fail(c, &q->reply, MODAL_NOT_FOUND, "job", NULL, "no such job of yours");
            return;
        }
    }
    s = grab(sizeof *s);
    *s = (struct subscription) {
        .next = c->events->subscriptions, .number = ++c->events->next_subscription,
        .peer = q->event->peer, .user = q->user, .reply = q->reply,
        .job = job == NULL ? 0 : job->id, .stream = grab_text(q->wire.events.stream),
        .kinds = q->wire.events.kinds };
    snprintf(s->key, sizeof s->key, "%s", q->event->key);
    s->next_event = !q->wire.events.replay ? ring_last(c) + 1
                  : q->wire.events.from > 0 ? (int64_t)q->wire.events.from : 1;
    q->user->subscriptions++;
    c->events->subscriptions = s;
    c->events->stirred = true;
    header = answer_new(&q->reply);
    snprintf(number, sizeof number, "%llu", (unsigned long long)s->number);
    cJSON_AddStringToObject(header, "subscription", number);
    cJSON_AddNumberToObject(header, "next", (double)s->next_event);
    answer_send(c, &q->reply, header, NULL);
}

void events_peer(struct core *c, uint64_t peer, enum event_type type)
{
    c->events->stirred = true;
    for (size_t i = 0; i < c->events->full_count; i++)
        if (c->events->full[i] == peer)
            c->events->full[i--] = c->events->full[--c->events->full_count];
    if (type == EVENT_PEER_FULL) {
        if (c->events->full_count == c->events->full_room) {
            c->events->full_room = c->events->full_room ? 2 * c->events->full_room : 8;
            c->events->full =
                regrab(c->events->full, c->events->full_room * sizeof *c->events->full);
        }
        c->events->full[c->events->full_count++] = peer;
    }
    for (struct subscription *s = c->events->subscriptions; type == EVENT_PEER_GONE && s != NULL;
         s = s->next)
        s->gone |= s->peer == peer;
}

void events_retain(struct core *c)
{
    struct transaction *t;

    if (c->last_event <= c->settings.events_kept
        || c->last_event / PRUNED_AT_LEAST == c->events->pruned / PRUNED_AT_LEAST)
        return;
    c->events->pruned = c->last_event;
    t = transaction_new();
    transaction_add(t, LEDGER_EVENTS_PRUNE)->id = c->last_event - c->settings.events_kept;
    core_commit(c, t);
}

void events_init(struct core *c)
{
    c->events = grab(sizeof *c->events);
    c->next_event = 1;
}

void events_done(struct core *c)
{
    struct events *events = c->events;
    struct subscription *s;

    for (int i = 0; i < RING; i++) {
        free(events->ring[i].user);
        free(events->ring[i].topic);
        free(events->ring[i].text);
    }
    while ((s = events->subscriptions) != NULL) {
        events->subscriptions = s->next;
        free(s->stream);
        free(s);
    }
    free(events->full);
    free(events);
}
