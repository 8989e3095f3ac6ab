/* messages.c - see messages.h */
#include "messages.h"
#include "frames.h"
#include "text.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

static void append_id(modald_stream *s, char *text, size_t size, int64_t *id)
{
    *id = ++s->link->questions * LINK_STREAMS + s->slot;
    snprintf(text, size, "{\"id\":%lld", (long long)*id);
}

/* The body of a message: the first LENGTH bytes of DATA, lent. */
static bool send_body(modald_stream *s, double *data, size_t length)
{
    zmq_msg_t message;
    bool sent;

    atomic_fetch_add_explicit(&loan_of(data)->holders, 1, memory_order_relaxed);
    atomic_fetch_add_explicit(&s->loans->holders, 1, memory_order_relaxed);
    if (zmq_msg_init_data(&message, data, length, give_back, s->loans) != 0) {
        give_back(data, s->loans);
        return false;
    }
    sent = zmq_msg_send(&message, s->link->socket, ZMQ_DONTWAIT) >= 0;
    if (!sent)
        zmq_msg_close(&message);                        /* which gives it back */
    return sent;
}

static bool send_message(modald_stream *s, const char *verb, const char *header, double *body,
                         size_t length)
{
    void *to = s->link->socket;

    if (!s->link->ready || s->link->asked >= ASKED_MOST
        || zmq_send(to, version, strlen(version), ZMQ_SNDMORE | ZMQ_DONTWAIT) < 0)
        return false;
    s->asked++;
    s->link->asked++;
    return zmq_send(to, verb, strlen(verb), ZMQ_SNDMORE | ZMQ_DONTWAIT) >= 0
        && zmq_send(to, header, strlen(header), ZMQ_DONTWAIT | (body ? ZMQ_SNDMORE : 0)) >= 0
        && (body == NULL || send_body(s, body, length));
}

static void send_open(modald_stream *s)
{
    char *text = s->link->asked + 2 <= ASKED_MOST ? calloc(1, HEADER_MOST) : NULL;

    if (text == NULL)
        return;
    append_id(s, text, HEADER_MOST, &s->open_id);
    open_header(s, text, HEADER_MOST);
    s->opening = send_message(s, "STREAM", text, NULL, 0);
    s->asked_at = now();
    free(text);
    if (!s->opening)
        return;
    char events[1024] = "";
    append_id(s, events, sizeof events, &s->events_id);
    append(events, sizeof events, ",\"stream\":");
    append_string(events, sizeof events, s->name);
    append(events, sizeof events, "}");
    send_message(s, "EVENTS", events, NULL, 0);
}

/* ---- frames of many streams in one message --------------------------------------------------- */

/* The frames of T, which will not be answered, are not sent. */
static void take_back(struct link *l, const struct together *t)
{
    for (int part = 0; part < t->count; part++) {
        modald_stream *s = l->streams[t->slots[part]];
        for (int i = 0; s != NULL && i < s->frames; i++) {
            struct frame *f = frame_at(s, i);
            if (f->id == t->id && f->part == part) {
                f->id = 0;
                s->flying -= bytes_of(s, f->count);
            }
        }
    }
}

static bool send_letter(struct link *l)
{
    struct letter *letter = l->letter;
    void *to = l->socket;

    letter->header[letter->written++] = ']';
    letter->header[letter->written++] = '}';
    return l->ready && l->asked < ASKED_MOST
        && zmq_send(to, version, strlen(version), ZMQ_SNDMORE | ZMQ_DONTWAIT) >= 0
        && zmq_send(to, "STREAM", strlen("STREAM"), ZMQ_SNDMORE | ZMQ_DONTWAIT) >= 0
        && zmq_send(to, letter->header, letter->written, ZMQ_SNDMORE | ZMQ_DONTWAIT) >= 0
        && zmq_send(to, letter->body, letter->length, ZMQ_DONTWAIT) >= 0;
}

static bool send_together(struct link *l)
{
    struct together *t = l->making;
    bool sent;

    if (t == NULL)
        return true;
    l->making = NULL;
    sent = send_letter(l);
    if (sent) {
        l->asked++;
        t->sent_at = now();
        t->next = l->sent;
        l->sent = t;
    } else {
        take_back(l, t);
        free(t);
    }
    return sent;
}

static bool begin_together(struct link *l)
{
    struct together *t;

    if (l->making != NULL)
        return true;
    if (!l->ready || l->asked >= ASKED_MOST)
        return false;
    if (l->letter == NULL)
        l->letter = malloc(sizeof *l->letter);
    t = l->letter != NULL ? malloc(sizeof *t) : NULL;
    if (t == NULL)
        return false;
    t->id = ++l->questions * LINK_STREAMS;
    t->count = 0;
    l->letter->length = 0;
    l->letter->written = (size_t)snprintf(l->letter->header, HEADER_MOST,
                                          "{\"id\":%lld,\"op\":\"pushes\",\"parts\":[",
                                          (long long)t->id);
    l->making = t;
    return true;
}

/* Is there no room for a frame of LENGTH bytes more? */
static bool is_full(const struct link *l, size_t length)
{
    return l->making != NULL
        && (l->making->count >= l->parts_most || l->letter->length + length > FRAME_BYTES
            || l->letter->written + PART_MOST > HEADER_MOST);
}

static bool put_in(modald_stream *s, struct frame *f)
{
    struct link *l = s->link;
    size_t length = bytes_of(s, f->count);
    struct letter *letter;

    if ((is_full(l, length) && !send_together(l)) || !begin_together(l))
        return false;
    letter = l->letter;
    letter->written += (size_t)snprintf(
        letter->header + letter->written, HEADER_MOST - letter->written,
        "%s[\"%s\",%llu,%llu,%zu,%lu]", l->making->count > 0 ? "," : "", s->stream,
        (unsigned long long)s->epoch, (unsigned long long)f->first, length, (unsigned long)f->crc);
    memcpy(letter->body + letter->length, f->data, length);
    letter->length += length;
    f->id = l->making->id;
    f->part = l->making->count;
    l->making->slots[l->making->count++] = (short)s->slot;
    s->flying += length;
    s->asked_at = now();
    return true;
}

/* Nothing that was sent together will be answered. */
static void forget_together(struct link *l)
{
    struct together *t;

    free(l->making);
    l->making = NULL;
    while ((t = l->sent) != NULL) {
        l->sent = t->next;
        free(t);
        l->asked--;
    }
}

static bool is_overdue(const struct link *l)
{
    const struct together *t = l->sent;

    while (t != NULL && now() <= t->sent_at + answer_patience)
        t = t->next;
    return t != NULL;
}

/* The message ID, out of those that have no answer; NULL: it is none of them. */
static struct together *answered(struct link *l, uint64_t id)
{
    struct together **at = &l->sent, *t;

    while (*at != NULL && (*at)->id != (int64_t)id)
        at = &(*at)->next;
    t = *at;
    if (t != NULL) {
        *at = t->next;
        l->asked--;
    }
    return t;
}

/* ---- frames ---------------------------------------------------------------------------------- */

/* May it go with others?  There the stream's name is written as it is. */
static bool may_join(const modald_stream *s, const struct frame *f)
{
    static const char signs[] = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";

    return s->flows && s->link->parts_most > 0 && s->link->slots > 1
        && bytes_of(s, f->count) < FRAME_ENOUGH && s->stream[strspn(s->stream, signs)] == 0;
}

/* A message of its own; those of before go before it. */
static bool send_frame(modald_stream *s, struct frame *f)
{
    size_t length = bytes_of(s, f->count);
    char text[512];
    int64_t id;

    append_id(s, text, sizeof text, &id);
    append(text, sizeof text, ",\"op\":\"push\",\"stream\":");
    append_string(text, sizeof text, s->stream);
    append(text, sizeof text, ",\"epoch\":%llu,\"first\":%llu,\"count\":%llu,\"crc32c\":%lu}",
           (unsigned long long)s->epoch, (unsigned long long)f->first, (unsigned long long)f->count,
           (unsigned long)f->crc);
    if (!send_together(s->link) || !send_message(s, "STREAM", text, f->data, length))
        return false;
    f->id = id;
    f->part = 0;
    s->link->fast |= length >= FRAME_ENOUGH;
    s->flying += length;
    s->asked_at = now();
    return true;
}

static void send_close(modald_stream *s)
{
    char text[512];

    append_id(s, text, sizeof text, &s->close_id);
    append(text, sizeof text, ",\"op\":\"close\",\"stream\":");
    append_string(text, sizeof text, s->stream);
    append(text, sizeof text, "%s}", atomic_load(&s->stop) == 2 ? ",\"broken\":true" : "");
    s->closing = send_message(s, "STREAM", text, NULL, 0);
    s->asked_at = now();
}

static bool send_frames(modald_stream *s)
{
    bool sent = false;

    for (int i = 0; i < s->frames; i++) {
        struct frame *f = frame_at(s, i);
        size_t length = bytes_of(s, f->count);
        if (f->id != 0)
            continue;
        if ((s->flying > 0 && s->flying + length > s->credit)
            || !(may_join(s, f) ? put_in(s, f) : send_frame(s, f)))
            return sent;
        sent = true;
    }
    return sent;
}

static void begin_anew(modald_stream *s)
{
    s->link->asked -= s->asked;
    s->asked = 0;
    s->opened = s->opening = s->closing = s->flows = false;
    s->first_id = (s->link->questions + 1) * LINK_STREAMS;
    s->flying = 0;
    s->events_id = 0;
    for (int i = 0; i < s->frames; i++)
        frame_at(s, i)->id = 0;
    atomic_store(&s->verdict, MODALD_UNKNOWN);
}

/* The epoch that the daemon is in; what was said of another is no word on this one. */
static void set_epoch(modald_stream *s, uint64_t epoch)
{
    if (epoch != s->epoch) {
        atomic_store(&s->verdict, MODALD_UNKNOWN);
        atomic_store(&s->estimate_past, atomic_load(&s->estimate_version));
    }
    s->epoch = epoch;
}

/* What is read of a message: its members by name. */
enum member_of_message {
    ID, CREDIT, PARTS, STREAM, EPOCH, ERROR, STREAM_ID, TO, VERDICT, FREQUENCY, FREQUENCY_STD,
    DAMPING, DAMPING_STD, STABILITY, MODES, MEMBERS
};
static const char *const member_names[MEMBERS] = {
    [ID] = "id", [CREDIT] = "credit", [PARTS] = "parts", [STREAM] = "stream",
    [EPOCH] = "epoch", [ERROR] = "error",
    [STREAM_ID] = "stream_id", [TO] = "to", [VERDICT] = "verdict",
    [FREQUENCY] = "frequency_hz", [FREQUENCY_STD] = "frequency_hz_std",
    [DAMPING] = "damping_ratio", [DAMPING_STD] = "damping_ratio_std",
    [STABILITY] = "stability", [MODES] = "modes",
};

/* The PART of message ID that is S's is taken. */
static void acknowledge(modald_stream *s, int64_t id, int part, const char *const *members)
{
    uint64_t epoch = count_at(members[EPOCH], s->epoch);

    for (int i = 0; i < s->frames; i++) {
        struct frame *f = frame_at(s, i);
        size_t length = bytes_of(s, f->count);
        if (f->id != id || id == 0 || f->part != part)
            continue;
        f->acknowledged = s->flows = true;
        s->link->fast |= length >= FRAME_ENOUGH;
        s->link->moved_at = now();
        s->link->vain_until = 0;
        s->flying -= s->flying >= length ? length : s->flying;
        /* and we did not go back */
        if (epoch != s->epoch && f->first > 0 && f->first == s->went_on)
            warn_once(s, "another run pushes to a stream of this name; "
                         "each begins the record anew");
        s->went_on = f->first + f->count;
        set_epoch(s, epoch);
    }
    retire(s);
}

/* Where in `named` a stream is whose name is the text up to its end, or to a quote. */
static modald_stream **place_of(struct link *l, const char *name)
{
    uint32_t hash = 2166136261u;                   /* FNV-1a */

    for (; *name != 0 && *name != '"'; name++)
        hash = (hash ^ (unsigned char)*name) * 16777619u;
    return &l->named[hash % NAMED];
}

static void set_name(modald_stream *s, const char *name)
{
    modald_stream **at = place_of(s->link, s->stream);

    while (*at != NULL && *at != s)
        at = &(*at)->same;
    if (*at == s)
        *at = s->same;
    snprintf(s->stream, sizeof s->stream, "%s", name);
    if (*name == 0)
        return;
    at = place_of(s->link, name);
    s->same = *at;
    *at = s;
}

static void on_reply(modald_stream *s, const char *const *members)
{
    char name[sizeof s->stream];
    int64_t id = (int64_t)count_at(members[ID], 0);

    s->credit = (size_t)count_at(members[CREDIT], s->credit);
    if (id == s->open_id && s->opening && read_string(members[STREAM], name, sizeof name)) {
        set_name(s, name);
        set_epoch(s, count_at(members[EPOCH], 0));
        s->opened = true;
        s->opening = false;
        s->link->pause = pause_least;
        s->link->parts_most = (int)fmin(number_at(members[PARTS], 0), TOGETHER_MOST);
    } else if (id == s->close_id && s->closing) {
        s->closed = true;
    }
    acknowledge(s, id, 0, members);
}

/* s before a busy daemon is asked again, whatever it says. */
static const double quiet_least = 0.05, quiet_most = 0.5;

/* Errors that pass (busy, quota, storage_full, draining) are tried again, and so is a stream that
 * somebody else closed; others end the sending, not the host. */
static void on_error(modald_stream *s, const char *const *members)
{
    static const char *const passing[] = {
        "busy", "quota", "storage_full", "draining", "not_found"
    };
    const char *error = members[ERROR], *code = member(error, "code");
    int64_t id = (int64_t)count_at(members[ID], 0);
    char text[256], message[200];
    bool passes;

    if (id != 0 && (id == s->events_id || id < s->first_id))
        return;                                     /* no live results; or it counts no more */
    passes = s->opened && is_text(code, "conflict");
    for (size_t i = 0; i < sizeof passing / sizeof passing[0]; i++)
        passes |= is_text(code, passing[i]);
    if (passes) {
        double after = number_at(member(member(error, "detail"), "retry_after_s"), quiet_most);
        s->quiet_until = now() + fmin(fmax(after, quiet_least), quiet_most);
        begin_anew(s);                             /* open again: what was taken is known then */
        return;
    }
    if (!read_string(member(error, "message"), message, sizeof message))
        snprintf(message, sizeof message, "%.150s", error ? error : "it gave no reason");
    snprintf(text, sizeof text, "the daemon refused it (%s); the run goes on without it", message);
    warn_once(s, text);
    s->refused = true;
}

/* Does a live result rest on samples of this run?  Another of the same name, or this one before it
 * was taken up again, may be told late. */
static bool is_ours(const modald_stream *s, const char *const *members)
{
    const char *of = members[STREAM_ID];
    char name[sizeof s->name];

    if (of != NULL ? !is_text(of, s->stream)
                   : members[STREAM] != NULL
                     && (!read_string(members[STREAM], name, sizeof name)
                         || strcmp(name, s->name) != 0))
        return false;
    return count_at(members[EPOCH], s->epoch) == s->epoch;
}

/* The four numbers of a mode, and no sample yet; a damping of HUGE_VAL: it is none. */
static struct modald_estimate estimate_of(const char *frequency, const char *frequency_std,
                                          const char *damping, const char *damping_std)
{
    return (struct modald_estimate) {
        .frequency_hz = number_at(frequency, 0),
        .frequency_std = number_at(frequency_std, -1),
        .damping_ratio = number_at(damping, HUGE_VAL),
        .damping_std = number_at(damping_std, -1),
    };
}

/* A daemon of before flat members tells what it found in `stability` and `modes` alone. */
static int nested_verdict(const char *const *members, struct modald_estimate *best)
{
    const char *stable = member(members[STABILITY], "stable"),
               *mode = first_element(members[MODES]);

    for (; mode != NULL; mode = next_element(mode)) {
        const char *std = member(mode, "std");
        struct modald_estimate e = estimate_of(
            member(mode, "frequency_hz"), member(std, "frequency_hz"),
            member(mode, "damping_ratio"), member(std, "damping_ratio"));
        if (e.damping_ratio < best->damping_ratio)
            *best = e;
    }
    return stable == NULL ? MODALD_UNKNOWN : strncmp(stable, "true", 4) == 0 ? MODALD_STABLE
         : strncmp(stable, "false", 5) == 0 ? MODALD_UNSTABLE : MODALD_UNDECIDED;
}

static int flat_verdict(const char *word)
{
    static const struct { const char *word; int verdict; } words[] = {
        { "stable", MODALD_STABLE }, { "unstable", MODALD_UNSTABLE },
        { "undecided", MODALD_UNDECIDED },
    };

    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++)
        if (is_text(word, words[i].word))
            return words[i].verdict;
    return MODALD_UNKNOWN;
}

/* The verdict of a live result, and its least damped mode where it has one. */
static void on_event(modald_stream *s, const char *const *members)
{
    struct modald_estimate best;
    int verdict;

    if (!is_ours(s, members))
        return;
    best = estimate_of(members[FREQUENCY], members[FREQUENCY_STD], members[DAMPING],
                       members[DAMPING_STD]);
    verdict = members[VERDICT] != NULL ? flat_verdict(members[VERDICT])
                                       : nested_verdict(members, &best);
    if (verdict == MODALD_UNKNOWN)
        return;
    best.sample = number_at(members[TO], -1);
    if (best.damping_ratio < HUGE_VAL) {
        atomic_fetch_add_explicit(&s->estimate_version, 1, memory_order_acq_rel);
        s->estimate = best;
        atomic_fetch_add_explicit(&s->estimate_version, 1, memory_order_release);
    }
    atomic_store(&s->verdict, verdict);
}

/* A question of S has its answer. */
static void note_answer(modald_stream *s, uint64_t id)
{
    if (s->asked > 0 && (int64_t)id >= s->first_id) {
        s->asked--;
        s->link->asked--;
    }
}

/* T has its answer: the one part of each of its streams, or an error for all. */
static void on_together(struct link *l, const struct together *t, const char *const *header,
                        const char *body)
{
    const char *at = first_element(member(body, "parts")), *members[MEMBERS];
    const bool refused = header[ERROR] != NULL;

    for (int part = 0; part < t->count && (refused || at != NULL); part++) {
        modald_stream *s = l->streams[t->slots[part]];
        bool good = refused || read_object(at, member_names, MEMBERS, members) != NULL;
        members[ID] = header[ID];
        if (s != NULL && good && t->id >= s->first_id) {
            if (refused || members[ERROR] != NULL)
                on_error(s, refused ? header : members);
            else
                acknowledge(s, t->id, part, members);
        }
        at = refused ? NULL : next_element(at);
    }
}

/* The streams that may be meant by what answers no question: those that an event names, or, where
 * a daemon of before gives none, all. */
static void on_all(struct link *l, void (*on)(modald_stream *, const char *const *),
                   const char *const *members)
{
    const char *name = on == on_event ? members[STREAM_ID] : NULL;

    if (name != NULL && *name == '"')
        for (modald_stream *s = *place_of(l, name + 1), *next; s != NULL; s = next) {
            next = s->same;
            on(s, members);
        }
    else
        for (int slot = 0; slot < l->slots; slot++)
            if (l->streams[slot] != NULL)
                on(l->streams[slot], members);
}

/* A message of KIND, its header as text that is ours to read; one that is no whole object, or says
 * what we read twice, is passed over.  It is for the stream that asked; an event is for those whose
 * samples it tells of, and what answers no question for all. */
static void on_message(struct link *l, const char *kind, const char *header, const char *body)
{
    static const struct {
        const char *kind;
        void (*on)(modald_stream *, const char *const *);
    } kinds[] = {
        { "REPLY", on_reply }, { "ERROR", on_error }, { "EVENT", on_event },
    };
    const char *members[MEMBERS];
    const char *end = read_object(skip_space(header), member_names, MEMBERS, members);
    uint64_t id = count_at(members[ID], 0);
    modald_stream *asked = id > 0 ? l->streams[id % LINK_STREAMS] : NULL;
    struct together *t = id > 0 ? answered(l, id) : NULL;

    if (t != NULL) {
        on_together(l, t, members, body);
        free(t);
        return;
    }
    if (asked != NULL)
        note_answer(asked, id);
    if (end == NULL || *skip_space(end) != 0)
        return;
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
        if (strcmp(kind, kinds[i].kind) == 0 && id == 0)
            on_all(l, kinds[i].on, members);
        else if (strcmp(kind, kinds[i].kind) == 0 && asked != NULL)
            kinds[i].on(asked, members);
}

/* One message: what it cost; 0: there is none. */
static size_t receive(struct link *l)
{
    char kind[8] = "", *header = NULL, *body = NULL;
    size_t cost = 0;
    bool more = true;
    zmq_msg_t part;

    zmq_msg_init(&part);
    for (int i = 0; more && cost <= BACKLOG_MOST; i++) {
        if (zmq_msg_recv(&part, l->socket, ZMQ_DONTWAIT) < 0)
            break;
        size_t size = zmq_msg_size(&part);
        more = zmq_msg_more(&part);
        cost += MESSAGE_COST + size;
        if (i == 1 && size < sizeof kind)
            memcpy(kind, zmq_msg_data(&part), size);
        if (i == 2)
            header = strndup(zmq_msg_data(&part), size);
        if (i == 3)
            body = strndup(zmq_msg_data(&part), size);
    }
    zmq_msg_close(&part);
    if (header != NULL)
        on_message(l, kind, header, body);
    free(header);
    free(body);
    return cost;
}
