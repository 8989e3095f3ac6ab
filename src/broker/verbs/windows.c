/*
 * windows.c - live windows: the last samples of a stream to a worker, and what it found in them to
 * who watches
 *
 * A window is due when its last sample is on stable storage, every `hop` samples, and never over a
 * gap or an epoch.  Whose turn it is, window_turns.c says; what came due before is left out, and
 * counted.
 * A worker has its next windows before it has ended the one that it works on: from the end of one
 * to the beginning of the next there is no way to the daemon and back.  The newest window of a
 * closed stream has its turn like any: a run that is shorter than the wait for a worker has its
 * verdict too, over a restart as well, for its samples are in its batch then.
 * Windows go before jobs, being small, unless these have had less than half of the workers; being
 * no jobs, they do not count towards worker_jobs: with a worker go the windows that it has, and all
 * of them would be found from nothing.  To a worker elsewhere they go where the configuration lets
 * them and the way is short (slot_takes_windows).  One that kills its worker goes to another,
 * LIVE_DEATHS_MOST times; one that is given back goes to another as well, and that is no death.
 * A worker that dies may have done more than it had told: any of those that it had may have killed
 * it, and each is given to another alone, so that it is seen which one does.
 */
#include "broker/core/slots.h"
#include "broker/verbs/streams.h"
#include "broker/verbs/verbs.h"
#include "broker/verbs/window_turns.h"
#include "wire/frame.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WINDOW_LEAST = 8 };    /* as identify's IDENTIFY_SAMPLES_LEAST: it takes no shorter one */
/* A hop longer than any stream: one window, and no number of samples that a double does
 * not hold. */
#define HOP_MOST 1e15
/* Seconds, periods or samples as a number in a request: more than any clock or stream has. */
#define LENGTH_MOST 1e9
enum {
    LIVE_LIMIT_S = 60,        /* a window's run: who watches has long had the next hops by then */
    LIVE_DEATHS_MOST = 3,     /* as often as a job is tried where it does not say */
    /* of an event's text: its number, time and subscription come to it */
    EVENT_MOST = WIRE_HEADER_MOST / 4 * 3,
    /* bytes of what is known of tracks: all that are followed at once take less */
    TRACKS_MOST = 256 * 1024,
    EDGES_MOST = 512,         /* of one window: each track that is followed may begin and end */
    /* that a worker has ahead: the daemon has some 0.3 ms of work with each, and more do not come
     * back in the time of ahead_s */
    AHEAD_MOST = 64,
};
/* What a worker has ahead lasts while the loop is elsewhere: four sources of 5 ms each (loop.c)
 * between two looks at the workers. */
static const double ahead_s = 0.02;

/* A window as open describes it, in samples. */
struct description { uint64_t samples, hop; const cJSON *options; };

/* KEY of TEXT times UNIT, in samples, into *OUT where KEY is there. */
static enum modal_status read_length(const cJSON *text, const char *key, double unit, double least,
                                     double most, uint64_t *out, struct modal_error *err)
{
    double given = 0, n;
    char path[128];
    enum modal_status rc = json_get_number(text, "window", key, 0, LENGTH_MOST, &given, err);

    if (rc != MODAL_OK || cJSON_GetObjectItemCaseSensitive(text, key) == NULL)
        return rc;
    json_path(path, "window", key);
    n = floor(given * unit + 0.5);
    if (unit == 1 && given != n)
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%s is %g; accepted: a whole number of samples", path, given);
    if (!(n >= least))
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%s makes %g samples; accepted: at least %g", path, n, least);
    if (!(n <= most))
        return modal_fail_field(err, MODAL_TOO_LARGE, path,
                                "%s makes %g samples; accepted: at most %g", path, n, most);
    *out = (uint64_t)n;
    return MODAL_OK;
}

/* Which of samples and periods gives the length: *PERIODS. */
static enum modal_status read_unit(const cJSON *text, const struct wire_input *w, bool *periods,
                                   struct modal_error *err)
{
    *periods = cJSON_HasObjectItem(text, "periods");
    if (*periods == (bool)cJSON_HasObjectItem(text, "samples"))
        return modal_fail_field(err, MODAL_BAD_INPUT, "window.samples",
                                "window has %s; accepted: samples or periods",
                                *periods ? "samples and periods" : "no length");
    if (*periods && !(w->period > 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "window.periods",
                                "window.periods of a stream without period; accepted: "
                                "window.samples");
    return MODAL_OK;
}

/* TEXT for the channels, dt and period of W. */
static enum modal_status read_window(const cJSON *text, const struct wire_input *w,
                                     struct description *out, struct modal_error *err)
{
    static const char *const keys[] = { "samples", "periods", "hop", "options", "alarms", NULL };
    const double most = floor(WIRE_BODY_MOST / 8.0 / (double)w->channels);
    bool periods;
    double unit;
    enum modal_status rc = json_keys(text, "window", keys, err);

    if (rc == MODAL_OK)
        rc = read_unit(text, w, &periods, err);
    if (rc != MODAL_OK)
        return rc;
    unit = periods ? w->period / w->dt : 1;
    rc = read_length(text, periods ? "periods" : "samples", unit, WINDOW_LEAST, most,
                     &out->samples, err);
    out->hop = out->samples;
    if (rc == MODAL_OK)
        rc = read_length(text, "hop", unit, 1, HOP_MOST, &out->hop, err);
    out->options = cJSON_GetObjectItemCaseSensitive(text, "options");
    if (rc == MODAL_OK && out->options != NULL && !cJSON_IsObject(out->options))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "window.options",
                              "window.options must be an object; accepted: the options of "
                              "identify");
    return rc;
}

enum modal_status window_check(const cJSON *text, const struct wire_input *w,
                               struct modal_error *err)
{
    struct description d = { 0, 0, NULL };
    struct alarms *alarms = NULL;
    enum modal_status rc = text == NULL ? MODAL_OK : read_window(text, w, &d, err);

    if (rc == MODAL_OK && text != NULL)
        rc = alarms_new(cJSON_GetObjectItemCaseSensitive(text, "alarms"), d.samples, &alarms, err);
    alarms_free(alarms);
    return rc;
}

void window_init(struct stream *s, const cJSON *text, const struct wire_input *w)
{
    struct window *window = &s->window;
    struct description d;

    window->slot = -1;
    if (text == NULL || window_check(text, w, NULL) != MODAL_OK)
        return;
    read_window(text, w, &d, NULL);
    window->samples = d.samples;
    window->hop = d.hop;
    window->options = d.options != NULL ? grab_canonical(d.options) : grab_text("{}");
    alarms_new(cJSON_GetObjectItemCaseSensitive(text, "alarms"), d.samples, &window->alarms, NULL);
}

void window_done(struct window *w)
{
    free(w->options);
    free(w->recent);
    free(w->tracks);
    alarms_free(w->alarms);
}

/* How many of the COUNT samples from INDEX on lie one behind the other in the ring of W. */
static uint64_t in_one_piece(const struct window *w, uint64_t index, uint64_t count)
{
    const uint64_t left = w->samples - index % w->samples;

    return count < left ? count : left;
}

void window_keep(struct stream *s, const struct segment_record *segment)
{
    struct window *w = &s->window;
    const char *data = segment->data;
    const uint64_t size = sample_bytes(s), end = segment->first + segment->count;

    if (w->samples > 0 && w->recent == NULL)
        w->recent = grab(w->samples * size);
    for (uint64_t i = segment->first, n; w->samples > 0 && i < end; i += n, data += n * size) {
        n = in_one_piece(w, i, end - i);
        memcpy(w->recent + i % w->samples * size, data, n * size);
    }
}

void window_reset(struct core *c, struct stream *s)
{
    s->window.next = s->window.here = 0;
    s->window.waits_from = UINT64_MAX;
    turn_leave(c, s);
    alarms_reset(s->window.alarms);
}

const char *const window_verdicts[] = { "stable", "unstable", "undecided", NULL };

bool window_is_untold(const struct stream *s)
{
    const struct window *w = &s->window;
    const uint64_t least = s->run_from + w->samples;

    return w->samples > 0
        && (w->running || (s->durable_epoch == s->epoch && s->durable >= least
                           && s->durable >= w->next));
}

/* ---- to a worker ----------------------------------------------------------------------------- */

void window_forget_last(struct core *c, struct stream *s)
{
    struct transaction *t = transaction_new();

    s->window.next = s->durable + 1;
    stream_notes_end(t, s);
    core_commit(c, t);
}

/* S is sealed, and its newest window, which is not told yet, not in memory: out of the batch. */
static void read_last(struct core *c, struct stream *s)
{
    struct window *w = &s->window;
    struct task *task = window_is_untold(s) ? batch_task(c, s, s->durable - w->samples, w->samples)
                                            : NULL;

    if (task == NULL) {
        window_forget_last(c, s);
        return;
    }
    w->reading = true;
    core_task(c, task, user_turn(s->user, 0));
}

void window_offer(struct core *c, struct stream *s)
{
    struct window *w = &s->window;

    if (w->queued || w->running)
        return;
    if (window_is_due(s)) {
        w->waits_from = s->durable;
        turn_wait(c, s);
    } else if (s->closed && !w->reading && window_is_untold(s))
        read_last(c, s);
    else if (s->closed) {                          /* no more will come */
        turn_leave(c, s);
        free(w->recent);
        w->recent = NULL;
    }
}

/* The next window of W is due a hop after the one that is cut of samples up to DURABLE.  Streams
 * that begin together, as the runs of one job do, have their first windows due together, and the
 * last would wait nearly a hop for a worker, each time anew: whatever holds it up then, it is left
 * out.  So hops count from where the first one had its turn, and each stream's next are due when
 * that of the one before it is done. */
static void await_next(struct window *w, uint64_t durable)
{
    uint64_t waits_from = w->waits_from > w->next ? w->waits_from : w->next;
    uint64_t waited = w->first && waits_from < durable ? durable - waits_from : 0;

    w->next += ((durable - waited - w->next) / w->hop + 1) * w->hop + waited;
    w->first = false;
}

/* The window that is due, as raw samples from *FIRST on: those before KNOWN are where they are
 * needed, unless that leaves a hole. */
static struct blob *cut_window(struct core *c, struct stream *s, uint64_t known, uint64_t *first)
{
    struct window *w = &s->window;
    uint64_t size = sample_bytes(s), count, skipped;
    char *data;

    w->epoch = s->epoch;
    w->from = s->durable - w->samples;
    w->to = s->durable - 1;
    *first = known > w->from && known < s->durable ? known : w->from;
    count = s->durable - *first;
    data = grab(count * size);
    for (uint64_t i = 0, n; i < count; i += n) {
        n = in_one_piece(w, *first + i, count - i);
        memcpy(data + i * size, w->recent + (*first + i) % w->samples * size, n * size);
    }
    skipped = (s->durable - w->next) / w->hop;
    await_next(w, s->durable);
    w->lost += skipped;
    w->skipped += skipped;
    w->skipped_all += skipped;
    c->slots->windows_skipped += (int64_t)skipped;
    return blob_take(data, count * size);
}

/* S's window is what the worker of SLOT works on from now on. */
static void begin(struct core *c, int slot, struct stream *s)
{
    struct slot *worker = &c->slots->at[slot];

    worker->live = s;
    worker->attempt = s->window.attempt;
    worker->started_ns = worker->heard_ns = c->now.mono_ns;
    slot_set(c, slot, SLOT_BUSY);
}

/* S's window is sent to the worker of SLOT, behind those that it has. */
static void join(struct core *c, int slot, struct stream *s)
{
    struct slot *worker = &c->slots->at[slot];

    s->window.behind = NULL;
    if (worker->live == NULL)
        begin(c, slot, s);
    else {
        *worker->live_end = s;
        worker->ahead++;
        worker->ahead_s += s->window.expected_s;
    }
    worker->live_end = &s->window.behind;
}

/* The stream whose window the worker of SLOT has had: it goes on with the next that it has. */
static struct stream *leave(struct core *c, int slot)
{
    struct slot *worker = &c->slots->at[slot];
    struct stream *s = worker->live, *next = s->window.behind;

    s->window.running = false;
    worker->live = NULL;
    if (next == NULL)
        return s;
    worker->ahead--;
    worker->ahead_s = worker->ahead > 0 ? worker->ahead_s - next->window.expected_s : 0;
    begin(c, slot, next);
    return s;
}

/* The caller's to free. */
static char *run_header(const struct stream *s, int attempt, uint64_t first)
{
    const struct window *w = &s->window;
    struct json_text text = { 0 };
    char name[24];

    snprintf(name, sizeof name, "%lld", (long long)s->id);
    json_text_open(&text, NULL);
    json_text_string(&text, "job", "live");
    json_text_number(&text, "attempt", attempt);
    json_text_string(&text, "kind", "identify");
    json_text_key(&text, "options");
    json_text_raw(&text, w->options);
    json_text_number(&text, "run_limit_s", LIVE_LIMIT_S);
    json_text_open(&text, "live");
    json_text_string(&text, "stream", name);
    json_text_number(&text, "epoch", (double)w->epoch);
    json_text_number(&text, "to", (double)w->to);
    json_text_number(&text, "window", (double)w->samples);
    json_text_number(&text, "hop", (double)w->hop);
    if (first == w->from && w->tracks != NULL)     /* who had the window before has them */
        json_text_string(&text, "tracks", w->tracks);
    json_text_close(&text);
    json_text_key(&text, "input");
    json_text_bytes(&text, s->header, s->input_length);
    json_text_string(&text, "content", "batch");
    json_text_number(&text, "samples", (double)(w->to + 1 - first));
    json_text_close(&text);
    return text_end(&text);
}

bool windows_first(const struct core *c, int from, int end)
{
    int windows = 0, jobs = 0;

    for (int slot = from; slot < end; slot++) {
        windows += c->slots->at[slot].live != NULL;
        jobs += c->slots->at[slot].job != NULL;
    }
    return windows < jobs || (windows == jobs && c->slots->windows_ns <= c->slots->jobs_ns);
}

bool window_start(struct core *c, int slot)
{
    struct stream *s = turn_take(c, slot);
    struct window *w;
    struct blob *data;
    uint64_t first = 0;
    bool with;

    if (s == NULL)
        return false;
    w = &s->window;
    with = window_is_with(c, s, slot);
    data = cut_window(c, s, with ? w->to + 1 : 0, &first);
    w->anew = !with;
    if (!with)
        turn_move(c, s, slot);
    w->expected_s = with && w->cost_s > 0 ? w->cost_s : w->anew_s > 0 ? w->anew_s : ahead_s;
    w->running = true;
    w->attempt = ++c->slots->windows;
    worker_send_text(c, slot, "RUN", run_header(s, w->attempt, first), data);
    join(c, slot, s);
    return true;
}

/* Has the worker of SLOT windows, and may it have one more behind them? */
static bool fits_ahead(const struct core *c, int slot)
{
    const struct slot *worker = &c->slots->at[slot];

    return worker->live != NULL && !worker->live->window.alone && worker->remote == NULL
        && slot < c->settings.workers
        && worker->ahead < AHEAD_MOST && worker->ahead_s < ahead_s;
}

void windows_give_ahead(struct core *c)
{
    for (int slot = 0; slot < c->slots->count; slot++)
        while (c->slots->due_count > 0 && fits_ahead(c, slot)
               && (windows_first(c, 0, c->slots->count) || !user_any_waits(c, slot))
               && window_start(c, slot))
            ;
}

bool window_late(const struct core *c, const struct slot *worker)
{
    return worker->live != NULL && c->now.mono_ns - worker->started_ns > LIVE_LIMIT_S * SECOND;
}

/* ---- what it found --------------------------------------------------------------------------- */

/* An event EVENT of S's window, begun.  The present epoch may be another by the time a window is
 * told: the run was taken up again from a checkpoint meanwhile. */
static void open_event(struct json_text *text, const struct core *c, const struct stream *s,
                       const char *event)
{
    char ident[IDENT_TEXT];

    ident_text(ident, ~c->settings.secret, s->id);
    json_text_open(text, NULL);
    json_text_string(text, "event", event);
    json_text_string(text, "stream", s->name);
    json_text_string(text, "stream_id", ident);
    json_text_number(text, "epoch", (double)s->window.epoch);
    json_text_number(text, "from", (double)s->window.from);
    json_text_number(text, "to", (double)s->window.to);
    json_text_number(text, "dt", s->dt);
}

/* The next number goes to TEXT, which is taken over. */
static void put_event(struct core *c, const struct stream *s, struct transaction *t, char *text)
{
    struct after *after = transaction_after(t, AFTER_EVENT);
    struct ledger_change *change = transaction_add(t, LEDGER_EVENT_PUT);

    after->text = text;
    after->value = c->next_event;
    after->ns = c->now.utc_ns;
    after->stream = (struct stream *)s;
    change->event = (struct event_record) {
        .number = c->next_event++, .ns = c->now.utc_ns,
        .user = transaction_text(t, s->user->name), .topic = transaction_text(t, s->name),
        .text = transaction_text(t, after->text) };
}

/* EDGE as an event EVENT; of members that an event has anyway not EDGE's. */
static char *edge_text(const struct core *c, const struct stream *s, const char *event, cJSON *edge)
{
    struct json_text begun = { 0 };
    char *start, *text;
    cJSON *whole, *part;

    open_event(&begun, c, s, event);
    whole = cJSON_Parse(start = text_end(&begun));
    free(start);
    while ((part = edge->child) != NULL) {
        cJSON_DetachItemViaPointer(edge, part);
        if (cJSON_HasObjectItem(whole, part->string))
            cJSON_Delete(part);
        else
            cJSON_AddItemToObject(whole, part->string, part);
    }
    text = json_print(whole);
    cJSON_Delete(whole);
    if (text == NULL)
        abort();
    return text;
}

/* What a window raised, cleared or made of tracks: EDGES, each an event EVENT behind its modes.  A
 * worker that was taken over may say anything: it has no more events, and says no member twice. */
static void put_edges(struct core *c, struct stream *s, struct transaction *t, const char *event,
                      cJSON *edges)
{
    cJSON *edge;

    for (int i = 0; i < EDGES_MOST && (edge = cJSON_DetachItemFromArray(edges, 0)) != NULL; i++) {
        char *text = cJSON_IsObject(edge) ? edge_text(c, s, event, edge) : NULL;
        cJSON_Delete(edge);
        if (text != NULL && strlen(text) <= EVENT_MOST)
            put_event(c, s, t, text);
        else
            free(text);
    }
    cJSON_Delete(edges);
}

/* Nothing of S is to be remembered any more: it has its batch, and its last window is told. */
static bool is_over(const struct stream *s)
{
    return s->batch > 0 && !window_is_untold(s);
}

/* What is known of tracks, which goes into the note of what was told (note_told). */
static void keep_tracks(struct stream *s, const char *tracks)
{
    if (tracks == NULL || strlen(tracks) > TRACKS_MOST || is_over(s))
        return;
    free(s->window.tracks);
    s->window.tracks = grab_text(tracks);
}

/* How far the samples are ahead of a window of the present epoch, and what is missing of them. */
static void add_lag(struct json_text *text, const struct stream *s)
{
    uint64_t end = s->window.to + 1, samples = s->next > end ? s->next - end : 0, missing = 0;

    if (s->window.epoch != s->epoch)
        return;
    for (size_t i = 0; i < s->gap_count; i++)
        missing += s->gaps[i][1] - s->gaps[i][0];
    json_text_open(text, "lag");
    json_text_number(text, "samples", (double)samples);
    json_text_number(text, "bytes", (double)(samples * sample_bytes(s)));
    json_text_close(text);
    json_text_open(text, "gaps");
    json_text_number(text, "count", (double)s->gap_count);
    json_text_number(text, "samples", (double)missing);
    json_text_close(text);
}

/* The mode of least damping; NULL: none has one. */
static const cJSON *least_damped(const cJSON *modes)
{
    const cJSON *mode, *least = NULL;
    double lowest = HUGE_VAL;

    cJSON_ArrayForEach(mode, modes) {
        double ratio =
            cJSON_GetNumberValue(cJSON_GetObjectItemCaseSensitive(mode, "damping_ratio"));
        if (ratio < lowest)
            lowest = ratio, least = mode;
    }
    return least;
}

/* The verdict of DOCUMENT; NULL: it has none. */
static const char *verdict_of(const cJSON *document)
{
    const cJSON *stability = cJSON_GetObjectItemCaseSensitive(document, "stability");
    const cJSON *stable = cJSON_GetObjectItemCaseSensitive(stability, "stable");

    return stable == NULL ? NULL : window_verdicts[cJSON_IsTrue(stable) ? 0
                                                   : cJSON_IsFalse(stable) ? 1 : 2];
}

/* What a host reads between two of its steps, flat: the verdict, and the least damped mode of
 * DOCUMENT. */
static void add_verdict(struct json_text *text, const char *verdict, const cJSON *document)
{
    static const char *const keys[][2] = {
        { "frequency_hz", "frequency_hz_std" }, { "damping_ratio", "damping_ratio_std" },
    };
    const cJSON *mode = least_damped(cJSON_GetObjectItemCaseSensitive(document, "modes"));
    const cJSON *std = cJSON_GetObjectItemCaseSensitive(mode, "std");

    if (verdict != NULL)
        json_text_string(text, "verdict", verdict);
    for (int i = 0; i < 2; i++) {
        const cJSON *value = cJSON_GetObjectItemCaseSensitive(mode, keys[i][0]);
        const cJSON *error = cJSON_GetObjectItemCaseSensitive(std, keys[i][0]);
        if (cJSON_IsNumber(value))
            json_text_number(text, keys[i][0], value->valuedouble);
        if (cJSON_IsNumber(error))
            json_text_number(text, keys[i][1], error->valuedouble);
    }
}

void window_keep_verdict(struct core *c, const struct stream *s, struct transaction *t)
{
    if (s->window.verdict != NULL && s->window.told_epoch == s->epoch)
        input_judge(c, s->batch, s->window.verdict, t);
}

/* Which one is due next, what the last one said, in which round of turns it was and what is known
 * of tracks, for a daemon that starts again: one row, as each is a page of the log. */
static void note_told(const struct stream *s, struct transaction *t)
{
    const struct window *w = &s->window;
    struct json_text text = { 0 };
    char name[24], *printed;

    if (is_over(s))
        return;
    snprintf(name, sizeof name, "%lld", (long long)s->id);
    json_text_open(&text, NULL);
    json_text_number(&text, "epoch", (double)w->epoch);
    json_text_number(&text, "next", (double)w->next);
    json_text_number(&text, "told", (double)w->told);
    json_text_number(&text, "round", (double)w->round);
    json_text_string(&text, "verdict", w->verdict);
    if (w->tracks != NULL)
        json_text_string(&text, "tracks", w->tracks);
    printed = text_end(&text);
    transaction_add(t, LEDGER_NOTE_PUT)->note =
        (struct note_record) { "window", transaction_text(t, name), transaction_text(t, printed) };
    free(printed);
}

/* What a worker found: its DOCUMENT as it came, and as a tree; both NULL: it found nothing. */
struct found { const struct wire_frame *text; const cJSON *document; };

/* What of F is told as its worker wrote it; not WHOLE: without what may be long. */
static void add_parts(struct json_text *text, const struct found *f, bool whole)
{
    static const char *const names[] = { "modes", "stability", "diagnostics", "update",
                                         "left_out" };
    static const bool is_long[] = { true, false, true, false, true };
    const size_t count = sizeof names / sizeof *names;
    struct json_part parts[sizeof names / sizeof *names];

    if (f->document == NULL)
        return;
    json_find_texts(f->text->data, f->text->size, names, count, parts);
    for (size_t i = 0; i < count; i++)
        if (parts[i].text != NULL && (whole || !is_long[i])) {
            json_text_key(text, names[i]);
            json_text_bytes(text, parts[i].text, parts[i].length);
        }
}

/* What S's window gave, as an event: F, the ERROR, or both. */
static char *result_text(const struct core *c, const struct stream *s, const struct found *f,
                         const cJSON *error, bool whole)
{
    struct json_text text = { 0 };
    char *printed = error != NULL ? json_print(error) : NULL;

    open_event(&text, c, s, "modes");
    add_verdict(&text, s->window.verdict, f->document);
    add_parts(&text, f, whole);
    if (!whole)
        json_text_string(&text, "left_out", "modes");
    if (printed != NULL) {
        json_text_key(&text, "error");
        json_text_raw(&text, printed);
    }
    free(printed);
    add_lag(&text, s);
    json_text_number(&text, "skipped", (double)s->window.skipped);
    return text_end(&text);
}

/* What a window gave, as a numbered event: the modes and the verdict of TEXT, the ERROR, or
 * both; either may be NULL.  It must fit a header: else the verdict alone. */
static void tell_result(struct core *c, struct stream *s, const struct wire_frame *text,
                        const cJSON *error)
{
    struct transaction *t = transaction_new();
    struct json_pool *pool = NULL;
    cJSON *document = NULL, *edges;
    struct found found = { text, NULL };
    char *event;

    if (text != NULL)
        json_read_pooled(text->data, text->size, &document, &pool, NULL);
    found.document = document;
    edges = s->window.epoch == s->epoch
                ? alarms_judge(s->window.alarms, s->window.from, s->window.to, document) : NULL;
    s->window.verdict = verdict_of(document);
    s->window.told_epoch = s->window.epoch;
    s->window.told = s->window.to;
    event = result_text(c, s, &found, error, true);
    if (strlen(event) > EVENT_MOST) {
        free(event);
        event = result_text(c, s, &found, error, false);
    }
    s->window.skipped = 0;
    put_event(c, s, t, event);
    keep_tracks(s, cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(document, "tracks")));
    note_told(s, t);
    if (s->batch > 0)                              /* it ran while the stream was closed */
        window_keep_verdict(c, s, t);
    put_edges(c, s, t, "track",
              cJSON_Duplicate(cJSON_GetObjectItemCaseSensitive(document, "track_edges"), true));
    put_edges(c, s, t, "alarm", edges);
    if (is_over(s))
        stream_notes_end(t, s);
    json_pool_free(pool);
    core_commit(c, t);
}

/* ---- its end --------------------------------------------------------------------------------- */

/* The window is due again, unless an epoch has begun since, whose samples are others. */
static void try_again(struct core *c, struct stream *s)
{
    if (s->epoch == s->window.epoch)
        s->window.next = s->window.to + 1;
    window_offer(c, s);
}

/* All that the worker of SLOT had are due again; DIED: of any of them, each by itself. */
static void give_back(struct core *c, int slot, bool died)
{
    while (c->slots->at[slot].live != NULL) {
        struct stream *s = leave(c, slot);
        turn_leave(c, s);
        s->window.alone |= died;
        s->window.died += died;
        try_again(c, s);
    }
}

void windows_back(struct core *c, int slot)
{
    give_back(c, slot, false);
}

/* A window that killed each worker that had it: who watches is told so. */
static void give_up(struct core *c, struct stream *s)
{
    struct modal_error err;
    cJSON *error;

    modal_fail(&err, MODAL_WORKER_DIED, "the window is left out: %d workers died of it",
               s->window.died);
    error = wire_error_object(&err, NULL);
    tell_result(c, s, NULL, error);
    cJSON_Delete(error);
    s->window.died = 0;
    s->window.alone = false;
}

void window_died(struct core *c, int slot)
{
    struct stream *s = leave(c, slot);

    give_back(c, slot, true);                      /* it may have begun with any of these */
    turn_leave(c, s);
    s->window.alone = true;
    if (++s->window.died < LIVE_DEATHS_MOST)
        try_again(c, s);
    else
        give_up(c, s);
    window_offer(c, s);
}

/* Is M the word that a window was dropped? */
static bool is_dropped(const struct wire_message *m)
{
    const cJSON *told = cJSON_GetObjectItemCaseSensitive(m->header, "error");
    const char *field = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(told, "field"));

    return field != NULL && strcmp(field, "live") == 0;
}

bool window_is_whole(const struct slot *worker, const struct wire_message *m)
{
    return is_dropped(m) && worker->live->window.anew;
}

void window_end(struct core *c, int slot, const struct wire_message *m)
{
    struct slot *worker = &c->slots->at[slot];
    const int64_t began_ns = worker->started_ns;
    struct stream *s = leave(c, slot);
    const cJSON *told = cJSON_GetObjectItemCaseSensitive(m->header, "error");
    struct modal_error err;
    cJSON *error = NULL;
    double cpu_s = 0;

    json_get_number(m->header, "", "cpu_s", 0, LIVE_LIMIT_S, &cpu_s, NULL);
    slot_window_back(c, slot, cpu_s);
    if (worker->live == NULL)
        worker->state = SLOT_TAKEN;
    c->slots->windows_ns += c->now.mono_ns - began_ns;
    if (!is_dropped(m))
        turn_took(c, s, slot, cpu_s);
    s->window.died = 0;
    s->window.alone = false;
    if (told != NULL) {
        turn_leave(c, s);
        worker_error(told, &err);
        error = wire_error_object(&err, NULL);
    }
    if (is_dropped(m))
        try_again(c, s);               /* it dropped the window: once more, all of it */
    else
        tell_result(c, s, m->body_count > 0 ? &m->body[0] : NULL, error);
    window_offer(c, s);
    cJSON_Delete(error);
}
