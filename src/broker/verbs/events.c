/*
 * events.c - numbered edges to subscribers, from memory where they are recent and from the ledger
 * where they are not
 *
 * A subscriber has the number of the next event it has not seen.  The last RING committed events
 * are in memory; further back the ledger is read, a page at a time of each connection.  A peer that
 * takes no more messages is passed over until it does.
 *
 * One may have thousands of subscriptions, to each of which an event goes, and a replay is of as
 * many as are kept.  So a step tells a bounded number, and connections have turns.  A host has a
 * subscription of each of its streams: one of a stream is looked at when that has an event, and
 * goes from this to the stream's next, however many others have them meanwhile.
 */
#include "broker/core/jobs.h"
#include "broker/verbs/events.h"
#include "broker/verbs/verbs.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    PAGE = 256,               /* events read at once */
    TELL = 16,                /* what telling an event takes, as many times as looking at it */
    WORK_STEP = 256 * TELL,   /* of a step: 1 ms */
    WORK_TURN = 64 * TELL,    /* what one connection has of it before the next */
    PRUNED_AT_LEAST = 1024,   /* events go in such groups: pruning costs a transaction */
};

static struct listener *listener_of(const struct core *c, uint64_t peer)
{
    struct listener *l = c->events->listeners;

    while (l != NULL && l->peer != peer)
        l = l->next;
    return l;
}

static struct listener *listener_get(struct core *c, uint64_t peer)
{
    struct listener *l = listener_of(c, peer);

    if (l != NULL)
        return l;
    l = grab(sizeof *l);
    l->peer = peer;
    l->next = c->events->listeners;
    c->events->listeners = l;
    return l;
}

/* It goes where it is neither told anything nor full. */
static void listener_leave(struct core *c, struct listener *l)
{
    struct listener **link = &c->events->listeners;

    if (l->subscriptions != NULL || l->full || l->reading)
        return;
    while (*link != l)
        link = &(*link)->next;
    *link = l->next;
    if (c->events->at == l)
        c->events->at = l->next;
    free(l);
}

/* ---- of a stream ----------------------------------------------------------------------------- */

static bool has_stream(const void *value, const void *key)
{
    return strcmp(((const struct topic *)value)->stream, key) == 0;
}

static struct topic *topic_of(const struct core *c, const char *stream)
{
    return map_find(&c->events->topics, map_hash_text(stream), has_stream, stream);
}

/* S is of STREAM from now on. */
static void topic_join(struct core *c, struct subscription *s, const char *stream)
{
    struct topic *topic = topic_of(c, stream);

    if (topic == NULL) {
        topic = grab(sizeof *topic);
        topic->stream = grab_text(stream);
        if (!map_put(&c->events->topics, map_hash_text(stream), topic))
            abort();
    }
    s->topic = topic;
    s->same = topic->subscriptions;
    topic->subscriptions = s;
}

static void topic_leave(struct core *c, struct subscription *s)
{
    struct topic *topic = s->topic;
    struct subscription **link = &topic->subscriptions;

    while (*link != s)
        link = &(*link)->same;
    *link = s->same;
    if (topic->subscriptions != NULL)
        return;
    map_remove(&c->events->topics, map_hash_text(topic->stream), topic);
    free(topic->stream);
    free(topic);
}

/* S, of a stream, may have something to be told. */
static void make_ready(struct subscription *s)
{
    struct listener *l = s->listener;

    s->waits = true;
    s->ready = NULL;
    *(l->ready == NULL ? &l->ready : l->ready_end) = s;
    l->ready_end = &s->ready;
}

/* The one at *LINK of the ready ones of L is told all. */
static void leave_ready(struct listener *l, struct subscription **link)
{
    struct subscription *s = *link;

    *link = s->ready;
    if (l->ready_end == &s->ready)
        l->ready_end = link;
    s->waits = false;
}

/* ROW is committed: who waits for nothing has seen all before it. */
static void topic_stir(struct core *c, const struct event_row *row)
{
    struct topic *topic = row->topic == NULL ? NULL : topic_of(c, row->topic);
    struct events *events = c->events;

    if (topic == NULL)
        return;
    if (topic->last > 0 && events->ring[topic->last % RING].number == topic->last)
        events->after[topic->last % RING] = row->number;
    topic->last = row->number;
    for (struct subscription *s = topic->subscriptions; s != NULL; s = s->same)
        if (!s->waits) {
            s->next_event = row->number;
            make_ready(s);
        }
}

/* The number that S looks at after ROW: of its stream the next, where that is known. */
static int64_t number_after(const struct core *c, const struct subscription *s,
                            const struct event_row *row, int64_t last)
{
    const int64_t next = c->events->after[row->number % RING];

    if (s->topic == NULL || row->topic == NULL || strcmp(row->topic, s->topic->stream) != 0)
        return row->number + 1;
    return row->number == s->topic->last ? last + 1 : next > 0 ? next : row->number + 1;
}

/* ---- subscriptions --------------------------------------------------------------------------- */

/* Out of those of no stream, or of its stream and the ready ones. */
static void unlist(struct core *c, struct subscription *s)
{
    struct listener *l = s->listener;
    struct subscription **link = s->topic == NULL ? &l->general : &l->ready;

    if (s->topic == NULL) {
        while (*link != s)
            link = &(*link)->general;
        *link = s->general;
        if (l->at == s)
            l->at = s->general;
        return;
    }
    while (s->waits && *link != s)
        link = &(*link)->ready;
    if (s->waits)
        leave_ready(l, link);
    topic_leave(c, s);
}

static void drop(struct core *c, struct subscription *s)
{
    struct subscription **link = &s->listener->subscriptions;

    unlist(c, s);
    while (*link != s)
        link = &(*link)->next;
    *link = s->next;
    s->user->subscriptions--;
    free(s);
}

/* All of L's. */
static void drop_all(struct core *c, struct listener *l)
{
    while (l->ready != NULL)
        leave_ready(l, &l->ready);
    while (l->subscriptions != NULL)
        drop(c, l->subscriptions);
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
        .type = ACT_SEND, .peer = s->listener->peer, .verb = "EVENT",
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
        && (s->topic == NULL || (row->topic != NULL && strcmp(row->topic, s->topic->stream) == 0));
}

static void read_page(struct core *c, struct subscription *s)
{
    struct task *task = task_new(TASK_READ_EVENTS, 0);

    task->offset = (uint64_t)(s->next_event - 1);
    task->length = PAGE;
    task->after = after_new(AFTER_EVENT, &s->reply);
    task->after->value = (int64_t)s->number;
    snprintf(task->user, sizeof task->user, "%s", s->user->name);
    s->listener->reading = true;
    core_task(c, task, user_turn(s->user, s->listener->peer));
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

/* What S has not been told, as far as it is in memory and WORK goes; true: there is more. */
static bool tell(struct core *c, struct subscription *s, int64_t last, int *work)
{
    while (s->next_event <= last && *work > 0) {
        const struct event_row *row = &c->events->ring[s->next_event % RING];
        *work -= 1;
        if (wants(s, row)) {
            send_event(c, s, row);
            *work -= TELL;
        }
        s->next_event = number_after(c, s, row, last);
    }
    return s->next_event <= last;
}

/* What S has to be told, or a page of it read; *FIRST: ring_first, looked for once for all who have
 * something to be told, 0: not yet.  true: it has been told all. */
static bool tell_all(struct core *c, struct subscription *s, int64_t *first, int *work)
{
    const int64_t last = ring_last(c);

    if (s->next_event > last)
        return true;
    if (*first == 0)
        *first = ring_first(c, last);
    if (s->next_event >= *first)
        return !tell(c, s, last, work);
    if (!s->listener->reading)
        read_page(c, s);
    return false;
}

/* L's of no stream, in turn; true: they want another. */
static bool pump_general(struct core *c, struct listener *l, int64_t *first, int *work)
{
    struct subscription *begin = l->at != NULL ? l->at : l->general, *s = begin;

    do {
        if (s == NULL)
            return false;
        if (*work <= 0) {
            l->at = s;
            return true;
        }
        tell_all(c, s, first, work);
        s = s->general != NULL ? s->general : l->general;
    } while (s != begin);
    l->at = s;
    return *work <= 0;
}

/* L's of a stream that are ready, the first of them first; true: they want another turn. */
static bool pump_ready(struct core *c, struct listener *l, int64_t *first, int *work)
{
    struct subscription **link = &l->ready;

    while (*link != NULL && *work > 0)
        if (tell_all(c, *link, first, work))
            leave_ready(l, link);
        else
            link = &(*link)->ready;
    return *work <= 0;
}

/* L's turn, in which either kind comes first in turn; true: it wants another. */
static bool pump(struct core *c, struct listener *l, int64_t *first, int *work)
{
    bool more = false;

    l->ready_first = !l->ready_first;
    if (l->ready_first)
        more |= pump_ready(c, l, first, work);
    more |= pump_general(c, l, first, work);
    if (!l->ready_first)
        more |= pump_ready(c, l, first, work);
    return more;
}

void events_pump(struct core *c)
{
    struct events *events = c->events;
    struct listener *begin = events->at != NULL ? events->at : events->listeners, *l = begin;
    int64_t first = 0;
    int work = WORK_STEP;

    if (!events->stirred)              /* most steps are samples, of which nobody is told */
        return;
    events->stirred = false;
    if (l == NULL)
        return;
    do {
        int turn = work < WORK_TURN ? work : WORK_TURN, left = turn;
        if (l->subscriptions != NULL && !l->full)
            events->stirred |= pump(c, l, &first, &left);
        work -= turn - left;
        l = l->next != NULL ? l->next : events->listeners;
    } while (l != begin && work > 0);
    events->stirred |= l != begin;
    events->at = l;
}

bool events_wait(const struct core *c)
{
    return c->events->stirred;
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
    c->events->after[after->value % RING] = 0;
    c->last_event = after->value;
    topic_stir(c, row);
    c->events->stirred = true;
}

void events_progress(struct core *c, struct job *job)
{
    char ident[9];
    struct event_row row = { .ns = c->now.utc_ns, .job = job->id, .user = job->user->name };

    if (c->events->listeners == NULL)
        return;
    job_ident(c, job, ident);
    row.text = grab_format("{\"event\":\"progress\",\"job\":\"%s\",\"progress\":%s}", ident,
                           job->progress);
    for (struct listener *l = c->events->listeners; l != NULL; l = l->next)
        for (struct subscription *s = l->full ? NULL : l->subscriptions; s != NULL; s = s->next)
            if (wants(s, &row))
                send_event(c, s, &row);
    free(row.text);
}

void events_task_done(struct core *c, struct task *task)
{
    struct listener *l = listener_of(c, task->after->reply.peer);
    struct subscription *s = l == NULL ? NULL : l->subscriptions;

    if (l == NULL)
        return;
    l->reading = false;
    c->events->stirred = true;
    while (s != NULL && s->number != (uint64_t)task->after->value)
        s = s->next;
    if (s == NULL)
        listener_leave(c, l);
    /* who takes no more meanwhile is read it again */
    if (s == NULL || l->full || task->status != MODAL_OK)
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
    for (struct listener *l = c->events->listeners, *next; l != NULL; l = next) {
        next = l->next;
        for (struct subscription *s = l->subscriptions, *behind; s != NULL; s = behind) {
            behind = s->next;
            if (!user_admits(c, s->user, s->key)) {
                answer_error(c, &s->reply, &err, NULL);
                drop(c, s);
            }
        }
        listener_leave(c, l);
    }
}

/* USER's of this number; NULL: none. */
static struct subscription *find(const struct core *c, const struct user *user, uint64_t number)
{
    for (struct listener *l = c->events->listeners; l != NULL; l = l->next)
        for (struct subscription *s = l->subscriptions; s != NULL; s = s->next)
            if (s->number == number && s->user == user)
                return s;
    return NULL;
}

static void unsubscribe(struct core *c, const struct request *q)
{
    const char *number = q->wire.events.subscription;
    struct subscription *s = find(c, q->user, strtoull(number, NULL, 10));
    cJSON *header;

    if (s != NULL) {
        struct listener *l = s->listener;
        drop(c, s);
        listener_leave(c, l);
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
    struct listener *l;
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
    l = listener_get(c, q->event->peer);
    s = grab(sizeof *s);
    *s = (struct subscription) {
        .next = l->subscriptions, .number = ++c->events->next_subscription, .listener = l,
        .user = q->user, .reply = q->reply,
        .job = job == NULL ? 0 : job->id, .kinds = q->wire.events.kinds };
    snprintf(s->key, sizeof s->key, "%s", q->event->key);
    s->next_event = !q->wire.events.replay ? ring_last(c) + 1
                  : q->wire.events.from > 0 ? (int64_t)q->wire.events.from : 1;
    q->user->subscriptions++;
    l->subscriptions = s;
    if (q->wire.events.stream != NULL) {
        topic_join(c, s, q->wire.events.stream);
        if (s->next_event <= ring_last(c))
            make_ready(s);
    } else {
        s->general = l->general;
        l->general = s;
    }
    c->events->stirred = true;
    header = answer_new(&q->reply);
    snprintf(number, sizeof number, "%llu", (unsigned long long)s->number);
    cJSON_AddStringToObject(header, "subscription", number);
    cJSON_AddNumberToObject(header, "next", (double)s->next_event);
    answer_send(c, &q->reply, header, NULL);
}

void events_peer(struct core *c, uint64_t peer, enum event_type type)
{
    struct listener *l = type == EVENT_PEER_FULL ? listener_get(c, peer) : listener_of(c, peer);

    c->events->stirred = true;
    if (l == NULL)
        return;
    l->full = type == EVENT_PEER_FULL;
    if (type == EVENT_PEER_GONE)
        drop_all(c, l);
    listener_leave(c, l);
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
    struct listener *l;

    for (int i = 0; i < RING; i++) {
        free(events->ring[i].user);
        free(events->ring[i].topic);
        free(events->ring[i].text);
    }
    while ((l = events->listeners) != NULL) {
        drop_all(c, l);
        events->listeners = l->next;
        free(l);
    }
    map_done(&events->topics);
    free(events);
}
