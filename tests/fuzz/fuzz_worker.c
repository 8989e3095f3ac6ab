/*
 * fuzz_worker.c - what workers say over the lives of their jobs: the broker stays whole, and no
 * answer passes the limits
 *
 * A core with two workers of its own and two elsewhere, jobs of a user's and two streams with live
 * windows; the ledger, the spool and the time do what the input says.  The input is a list of acts,
 * each led by one byte:
 *
 *     0 .. 5    a message of that verb (READY, BEAT, PROGRESS, PART, DONE, FAILED); the next byte
 *               has the number of its body frames in its low three bits; their size is the byte
 *               after, in units of 1, 8, 4096 or 16384 by the next two bits.  The header follows up
 *               to a zero byte, of the current job and attempt unless bit 7 is set
 *     6         a message as it stands, its frames cut at each zero byte
 *     7         a task of the spool ends; 8: it fails
 *     9         a commit; 10: one that is refused for want of room
 *     11        another job; 12: it is cancelled
 *     13        the worker's process ends; 14: time passes: the next byte in tenths of seconds
 *     15        samples of the stream
 *     16 .. 20  a message of JOIN, INPUT, RELEASE, STDERR, LEAVE, as 0 .. 5 have them
 *     21        from here on it is the worker elsewhere that speaks, or again our own
 *     22        the connection of the worker elsewhere ends
 *     23        from here on it is the other of the two
 *     24 .. 31  what a worker would say, of its own present run, or by bit 5 of the other's: READY,
 *               BEAT, the next PART, DONE, FAILED, that a window was dropped, the next INPUT, JOIN
 *     56        samples of the other stream
 *
 * After each: what a slot holds says that it is there, and each window that runs is in one; nobody
 * has had a RUN without READY; no worker has more PARTs without GO, or INPUTs without CHUNK, than
 * it may; no window is sent more often than workers may die of it; no more of a processor is booked
 * than the cores have had time for under jobs.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/crc32c.h"
#include "broker/core/core.h"
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include "broker/core/slots.h"
#include "broker/core/state.h"
#include "broker/verbs/streams.h"
#include "wire/frame.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum {
    ACTS_MOST = 256,
    HEADER_MOST = 4096,
    OWN = 2, WORKERS = 4,                      /* our own, and those elsewhere behind them */
    STREAMS = 2,
    CORES = 2, THREADS = 2,
    /* of a window, since one was told: what is new of it, all of it, twice after deaths, and one
     * that dies beside another */
    RUNS_MOST = 5,
};

/* What a worker knows of its work. */
struct worker {
    bool alive, dying, ready;                  /* ready: READY was said since the latest RUN */
    char job[9];                               /* "live" of a window */
    int attempt;
    unsigned document, signals, pulled;        /* bytes that it has sent of these, has asked for */
    uint64_t peer;                             /* of one elsewhere: its connection's number */
};

static struct {
    struct core *core;
    struct moment now;
    struct transaction *waiting, **waiting_end;
    struct task *tasks, **tasks_end;
    struct worker workers[WORKERS];
    int speaker;
    char submitted[9], streams[STREAMS][9];
    int requests, pushed[STREAMS], opened;
    uint64_t next_peer;
    int64_t under_jobs_ns;                     /* that slots have had jobs, all together */
    struct { uint64_t epoch, told; int runs, given_back; } windows[STREAMS];
} w;

struct bytes { const uint8_t *at; size_t size; };

static int take(struct bytes *in)
{
    if (in->size == 0)
        return 0;
    in->size--;
    return *in->at++;
}

static void copy_member(const char *header, const char *name, char out[9])
{
    cJSON *read = cJSON_Parse(header);
    const cJSON *member = cJSON_GetObjectItemCaseSensitive(read, name);

    if (cJSON_IsString(member) && strlen(member->valuestring) == 8)
        strcpy(out, member->valuestring);
    cJSON_Delete(read);
}

/* What a client is sent is within what section 2 and 8 of the protocol let it expect,
 * whatever the worker said. */
static void look_at_answer(const struct action *a)
{
    if (strcmp(a->verb, "EVENT") != 0 && strlen(a->header) > WIRE_HEADER_MOST)
        abort();
    copy_member(a->header, "job", w.submitted);
    if (w.opened < STREAMS && strcmp(a->verb, "REPLY") == 0)
        copy_member(a->header, "stream", w.streams[w.opened]);
}

static struct worker *worker_of(const struct action *a)
{
    if (a->type == ACT_WORKER)
        return &w.workers[a->slot];
    for (int i = OWN; i < WORKERS; i++)
        if (w.workers[i].peer == a->peer)
            return &w.workers[i];
    abort();
}

/* The slot of W, -1: none. */
static int slot_of(const struct worker *worker)
{
    const int i = (int)(worker - w.workers);

    return i < OWN ? i : slot_of_peer(w.core, worker->peer);
}

static void need(bool true_now)
{
    if (!true_now)
        abort();
}

/* A window goes to workers until one has told something of it, or enough have died; who gives it
 * back says nothing against it. */
static void count_window(const cJSON *run)
{
    const cJSON *live = cJSON_GetObjectItemCaseSensitive(run, "live");
    const char *id = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(live, "stream"));
    int k = 0;

    for (const struct stream *s = w.core->streams; id != NULL && s != NULL; s = s->next_stream, k++)
        if (s->id == atoll(id))
            need(++w.windows[k].runs <= RUNS_MOST + w.windows[k].given_back);
}

/* The worker of a RUN has said READY since the last one, or it stands behind windows. */
static void look_at_run(const struct action *a)
{
    struct worker *worker;
    cJSON *read;

    if (strcmp(a->verb, "RUN") != 0)
        return;
    worker = worker_of(a);
    need(worker->alive && slot_of(worker) >= 0);
    need(worker->ready || w.core->slots->at[slot_of(worker)].ahead > 0);
    read = cJSON_Parse(a->header);
    count_window(read);
    *worker = (struct worker) { .alive = true, .dying = worker->dying, .peer = worker->peer };
    strncpy(worker->job, cJSON_GetObjectItemCaseSensitive(read, "job")->valuestring, 8);
    worker->attempt = (int)cJSON_GetObjectItemCaseSensitive(read, "attempt")->valuedouble;
    cJSON_Delete(read);
}

static void carry_out(const struct action *a)
{
    switch (a->type) {
    case ACT_COMMIT:
        a->transaction->next = NULL;
        *w.waiting_end = a->transaction;
        w.waiting_end = &a->transaction->next;
        return;
    case ACT_TASK:
        a->task->next = NULL;
        *w.tasks_end = a->task;
        w.tasks_end = &a->task->next;
        return;
    case ACT_SEND:   look_at_answer(a); break;
    case ACT_WORKER: case ACT_REMOTE: look_at_run(a); break;
    case ACT_SPAWN:  w.workers[a->slot] = (struct worker) { .alive = true }; break;
    case ACT_KILL:   w.workers[a->slot].dying = true; break;
    case ACT_LOG:
        if (strchr(a->header, '\n') != NULL || strlen(a->header) > 8192)
            abort();
        break;
    case ACT_HAND: case ACT_STOP: break;
    }
    free(a->header);
    blob_drop(a->body);
}

/* ---- what must hold -------------------------------------------------------------------------- */

/* The windows that SLOT has are those of streams that say so, each in one place. */
static int look_at_windows(const struct slot *s, int slot)
{
    int count = 0;

    for (const struct stream *one = s->live; one != NULL; one = one->window.behind, count++) {
        /* -1: its samples are to be sent anew, as what it had is another epoch's */
        need(one->window.running && !one->window.queued
             && (one->window.slot == slot || one->window.slot == -1));
        need(count <= s->ahead);
    }
    need(count == (s->live != NULL ? s->ahead + 1 : 0));
    return count;
}

static void look_at_slot(int slot, int *windows)
{
    const struct slot *s = &w.core->slots->at[slot];
    const bool works = s->state == SLOT_BUSY || s->state == SLOT_KILLED;

    need(works || (s->job == NULL && s->live == NULL));
    need(s->state != SLOT_BUSY || s->job != NULL || s->live != NULL);
    need(s->job == NULL || s->live == NULL);
    need(s->job == NULL || (s->job->slot == slot && s->job->attempts == s->attempt
                            && (s->job->state == JOB_RUNNING || s->state == SLOT_KILLED)));
    need(s->parts >= 0 && (s->parts <= WIRE_PARTS_MOST || s->state == SLOT_KILLED));
    need(s->document_size <= s->document_total && s->document_total <= WIRE_DOCUMENT_MOST);
    need(s->remote == NULL || (s->remote->pulls >= 0 && s->remote->pulls <= WIRE_PULLS_MOST));
    *windows += look_at_windows(s, slot);
}

static void look_at_streams(int windows)
{
    int running = 0, k = 0;

    for (const struct stream *s = w.core->streams; s != NULL; s = s->next_stream, k++) {
        running += s->window.running;
        need(s->window.died >= 0 && s->window.died < 3);
        if (s->window.told_epoch != w.windows[k].epoch || s->window.told != w.windows[k].told) {
            w.windows[k].epoch = s->window.told_epoch;
            w.windows[k].told = s->window.told;
            w.windows[k].runs = w.windows[k].given_back = 0;
        }
    }
    need(running == windows);
}

static void look_at_all(void)
{
    int windows = 0, idle = 0;
    int64_t booked = 0;

    for (int slot = slot_after(w.core, -1); slot >= 0; slot = slot_after(w.core, slot)) {
        look_at_slot(slot, &windows);
        idle += slot_is_remote(slot) && w.core->slots->at[slot].state == SLOT_IDLE;
    }
    need(idle == w.core->slots->remotes_idle);
    look_at_streams(windows);
    for (size_t i = 0; i < w.core->user_count; i++)
        booked += (int64_t)(w.core->user_list[i]->cpu_s * 1e9);
    need(booked <= THREADS * w.under_jobs_ns + 1000);
}

static void step(struct event e)
{
    const struct actions *list = core_step(w.core, &e, w.now);
    size_t count = list->count;
    struct action *own = malloc((count + 1) * sizeof *own);

    memcpy(own, list->items, count * sizeof *own);
    for (size_t i = 0; i < count; i++)
        carry_out(&own[i]);
    free(own);
    look_at_all();
}

static void pass(int64_t ns)
{
    for (int slot = slot_after(w.core, -1); slot >= 0; slot = slot_after(w.core, slot))
        if (w.core->slots->at[slot].job != NULL)
            w.under_jobs_ns += ns;
    w.now.mono_ns += ns;
    step((struct event) { .type = EVENT_TIME });
}

static void ask(const char *verb, const char *header, const void *body, size_t size)
{
    struct blob *blob = body != NULL ? blob_copy(body, size) : NULL;
    struct wire_frame frames[4] = { { WIRE_VERSION, 7 }, { verb, strlen(verb) },
                                    { header, strlen(header) },
                                    { blob != NULL ? blob->data : NULL, size } };   /* lasts */
    struct wire_message m;

    if (wire_open(frames, body != NULL ? 4 : 3, WIRE_VERSION, true, &m, NULL) != MODAL_OK)
        abort();
    step((struct event) { .type = EVENT_REQUEST, .peer = 1, .key = "", .message = &m,
                          .body = &blob });
    wire_close(&m);
    blob_drop(blob);
}

static void submit(void)
{
    const double data[2] = { 2.385, w.requests };
    char header[200];

    snprintf(header, sizeof header,
             "{\"id\":%d,\"kind\":\"identify\",\"max_attempts\":2,\"options\":{\"threads\":2},"
             "\"input\":{\"content\":\"batch\",\"samples\":2,\"channels\":1,\"dt\":1}}",
             ++w.requests);
    ask("SUBMIT", header, data, sizeof data);
    snprintf(header, sizeof header, "{\"id\":%d,\"job\":\"%s\",\"timeout_s\":5,\"result\":true}",
             ++w.requests, w.submitted);
    if (w.submitted[0] != 0)
        ask("WAIT", header, NULL, 0);
}

static void cancel(void)
{
    char header[80];

    snprintf(header, sizeof header, "{\"id\":%d,\"job\":\"%s\"}", ++w.requests, w.submitted);
    if (w.submitted[0] != 0)
        ask("CANCEL", header, NULL, 0);
}

static void push(int k)
{
    double samples[8];
    char header[200];

    for (int i = 0; i < 8; i++)
        samples[i] = w.pushed[k] + i;
    snprintf(header, sizeof header, "{\"id\":%d,\"op\":\"push\",\"stream\":\"%s\",\"epoch\":0,"
             "\"first\":%d,\"count\":8,\"crc32c\":%u}", ++w.requests,
             w.streams[k], w.pushed[k], crc32c(0, samples, sizeof samples));
    w.pushed[k] += 8;
    if (w.streams[k][0] != 0)
        ask("STREAM", header, samples, sizeof samples);
}

static void commit(enum modal_status status)
{
    struct transaction *t = w.waiting;

    if (t == NULL)
        return;
    w.waiting = t->next;
    if (w.waiting == NULL)
        w.waiting_end = &w.waiting;
    t->next = NULL;
    t->status = t->refusable != MUST_PASS || t->fence != NULL ? status : MODAL_OK;
    if (t->fence != NULL && (atomic_load(t->fence) || t->status != MODAL_OK)) {
        t->status = MODAL_STORAGE_FULL;
        atomic_store(t->fence, true);
    }
    step((struct event) { .type = EVENT_COMMITTED, .transaction = t });
}

static void end_task(enum modal_status status)
{
    static char handle;
    struct task *t = w.tasks;

    if (t == NULL)
        return;
    w.tasks = t->next;
    if (w.tasks == NULL)
        w.tasks_end = &w.tasks;
    t->next = NULL;
    t->status = status;
    if (status != MODAL_OK)
        modal_fail(&t->err, status, "as the input has it");
    else if (t->type == TASK_READ_INPUT || t->type == TASK_READ_RESULT
             || t->type == TASK_READ_STDERR)
        t->text = blob_copy("0123456789abcdef", 16);
    else if (t->type == TASK_BEGIN || t->type == TASK_RESUME)
        t->upload = (void *)&handle;
    else if (t->type == TASK_CLOSE || t->type == TASK_REMOVE_INPUT)
        t->upload = NULL;
    step((struct event) { .type = EVENT_TASK, .task = t });
}

/* ---- what the worker says -------------------------------------------------------------------- */

/* The present speaker; one that is not there says nothing. */
static struct worker *speaker(void)
{
    return &w.workers[w.speaker];
}

static void say(const struct wire_frame *frames, int count)
{
    struct blob *blobs[WIRE_FRAMES_MOST + 2] = { NULL };
    struct wire_message m;
    struct modal_error err;
    enum modal_status rc = wire_open(frames, count, WIRE_WORKER, false, &m, &err);

    for (int i = 3; i < count; i++)
        blobs[i - 3] = blob_copy(frames[i].data, frames[i].size);
    if (rc == MODAL_OK && strcmp(m.verb, "READY") == 0)
        speaker()->ready = true;
    for (int k = 0; rc == MODAL_OK && k < STREAMS; k++)
        w.windows[k].given_back += strcmp(m.verb, "RELEASE") == 0 || strcmp(m.verb, "LEAVE") == 0;
    step((struct event) { .type = w.speaker < OWN ? EVENT_WORKER : EVENT_REMOTE,
                          .slot = w.speaker < OWN ? w.speaker : 0,
                          .peer = speaker()->peer, .key = "work",
                          .message = rc == MODAL_OK ? &m : NULL, .fault = &err, .body = blobs });
    if (rc == MODAL_OK)
        wire_close(&m);
    for (int i = 3; i < count; i++)
        blob_drop(blobs[i - 3]);
}

static size_t until_zero(struct bytes *in, char *out, size_t room)
{
    size_t n = 0;
    int byte;

    while (in->size > 0 && (byte = take(in)) != 0)
        if (n + 1 < room)
            out[n++] = (char)byte;
    out[n] = 0;
    return n;
}

static void say_verb(const char *verb, struct bytes *in)
{
    static const size_t units[] = { 1, 8, 4096, 16384 };
    int how = take(in), bodies = how & 7;
    size_t each = bodies > 0 ? (size_t)take(in) * units[how >> 3 & 3] : 0;
    static char header[HEADER_MOST + 64], given[HEADER_MOST];
    char *body = calloc(each + 1, 1);
    struct wire_frame frames[3 + 7] = { { WIRE_WORKER, 7 }, { verb, strlen(verb) }, { header, 0 } };

    until_zero(in, given, sizeof given);
    if (how & 0x80)
        snprintf(header, sizeof header, "%s", given);
    else
        snprintf(header, sizeof header, "{\"job\":\"%s\",\"attempt\":%d%s%s", speaker()->job,
                 speaker()->attempt, given[0] == '}' ? "" : ",", given);
    frames[2].size = strlen(header);
    for (int i = 0; i < bodies; i++)
        frames[3 + i] = (struct wire_frame) { body, each };
    say(frames, 3 + bodies);
    free(body);
}

static void say_raw(struct bytes *in)
{
    static char text[6][HEADER_MOST];
    struct wire_frame frames[7] = { { WIRE_WORKER, 7 } };
    int count = 1;

    while (count < 7 && in->size > 0) {
        size_t n = until_zero(in, text[count - 1], HEADER_MOST);
        if (n == 0)
            break;
        frames[count] = (struct wire_frame) { text[count - 1], n };
        count++;
    }
    say(frames, count);
}

/* The header and body of VERB: of the present run of OF, who is the speaker or another. */
static void say_as(const char *verb, const struct worker *of, const char *members, size_t body)
{
    static const char document[64 + 1] =
        "{}                                                              ";
    static char header[512];
    const int slot = slot_of(of);
    const bool window = slot >= 0 && w.core->slots->at[slot].live != NULL;
    struct wire_frame frames[4] = { { WIRE_WORKER, 7 }, { verb, strlen(verb) }, { header, 0 },
                                    { document, body } };

    snprintf(header, sizeof header, "{\"job\":\"%s\",\"attempt\":%d%s}", of->job,
             window ? w.core->slots->at[slot].attempt : of->attempt, members);
    frames[2].size = strlen(header);
    say(frames, body > 0 ? 4 : 3);
}

/* Bytes of signals of 8 samples, or of a document of 40: as many as the next byte says, in
 * order. */
static void say_part(struct worker *of, struct bytes *in)
{
    char members[200];
    const int how = take(in);
    const bool batch = how & 1;
    unsigned *at = batch ? &of->signals : &of->document, total = batch ? 64 : 40,
             size = 8 * (unsigned)(1 + (how >> 1 & 7));

    snprintf(members, sizeof members, ",\"part\":\"%s\",\"offset\":%u,\"total\":%u%s",
             batch ? "batch" : "document", *at, total, batch ? ",\"batch\":{\"content\":\"batch\","
             "\"samples\":8,\"channels\":1,\"dt\":0.5}" : "");
    *at += size;
    say_as("PART", of, members, size);
}

static void say_input(struct worker *of)
{
    char members[80];

    snprintf(members, sizeof members, ",\"offset\":%u,\"length\":8", of->pulled % 16);
    of->pulled += 8;
    say_as("INPUT", of, members, 0);
}

/* As worker.c would: see the opening remark. */
static void say_properly(int what, struct worker *of, struct bytes *in)
{
    switch (what) {
    case 0: say_as("READY", of, ",\"pid\":7", 0); break;
    case 1: say_as("BEAT", of, "", 0); break;
    case 2: say_part(of, in); break;
    case 3: say_as("DONE", of, ",\"cpu_s\":1e6", of->document > 0 ? 0 : 2); break;
    case 4: say_as("FAILED", of, ",\"cpu_s\":1e6,\"error\":{\"code\":\"bad_input\"}", 0); break;
    case 5: say_as("FAILED", of, ",\"error\":{\"code\":\"internal\",\"field\":\"live\"}", 0); break;
    case 6: say_input(of); break;
    case 7: say_as("JOIN", of, ",\"version\":\"" MODALD_VERSION "\",\"name\":\"n\","
                   "\"node\":\"h\",\"memory_bytes\":1e9", 0); break;
    }
}

static void end_process(int status)
{
    const bool killed = speaker()->dying;

    speaker()->alive = false;
    step((struct event) { .type = EVENT_EXIT, .slot = w.speaker,
                          .status = killed ? 9 : status << 8, .stderr_text = "last words" });
}

static void end_connection(void)
{
    const int who = w.speaker < OWN ? OWN : w.speaker;
    const uint64_t gone = w.workers[who].peer;

    w.workers[who] = (struct worker) { .alive = true, .peer = w.next_peer++ };
    step((struct event) { .type = EVENT_REMOTE_GONE, .peer = gone });
}

static void act(struct bytes *in)
{
    static const char *const verbs[] = { "READY", "BEAT", "PROGRESS", "PART", "DONE", "FAILED" };
    static const char *const far_verbs[] = { "JOIN", "INPUT", "RELEASE", "STDERR", "LEAVE" };
    const int byte = take(in), what = byte & 31;

    if (byte == 56)
        push(1);
    else if (what < 6 && speaker()->alive)
        say_verb(verbs[what], in);
    else if (what >= 16 && what < 21 && speaker()->alive)
        say_verb(far_verbs[what - 16], in);
    else if (what == 21)
        w.speaker = (w.speaker + OWN) % WORKERS;
    else if (what == 22)
        end_connection();
    else if (what == 23)
        w.speaker ^= 1;
    else if (what >= 24 && speaker()->alive)
        say_properly(what - 24, &w.workers[byte & 32 ? w.speaker ^ 1 : w.speaker], in);
    else if (what == 6 && speaker()->alive)
        say_raw(in);
    else if (what == 7 || what == 8)
        end_task(what == 7 ? MODAL_OK : MODAL_IO);
    else if (what == 9 || what == 10)
        commit(what == 9 ? MODAL_OK : MODAL_STORAGE_FULL);
    else if (what == 11)
        submit();
    else if (what == 12)
        cancel();
    else if (what == 13 && w.speaker < OWN && speaker()->alive)
        end_process(take(in));
    else if (what == 14)
        pass(take(in) * (SECOND / 10));
    else if (what == 15)
        push(0);
}

/* ---- a life ---------------------------------------------------------------------------------- */

static void boot(void)
{
    static const struct account accounts[] = {
        { .key = "", .user = "one", .role = WIRE_ROLE_ADMIN, .weight = 1 },
        { .key = "work", .user = "pool", .role = WIRE_ROLE_WORKER, .weight = 1 } };
    static const struct settings settings = { .accounts = accounts, .account_count = 2,
        .workers = OWN, .cores = CORES, .queue_jobs = 20,
        .windows_elsewhere_ns = SECOND,
        .input_bytes = 1 << 22, .window_bytes = 1 << 20, .lease_ns = 5 * SECOND,
        .result_age_ns = 3600 * SECOND, .input_age_ns = 60 * SECOND,
        .tombstone_age_ns = 86400 * SECOND, .upload_idle_ns = 86400 * SECOND,
        .result_bytes = 1 << 30, .events_kept = 1024, .secret = 0x1234567 };
    const struct actions *list;

    memset(&w, 0, sizeof w);
    w.waiting_end = &w.waiting;
    w.tasks_end = &w.tasks;
    w.next_peer = 1;
    for (int i = OWN; i < WORKERS; i++)
        w.workers[i] = (struct worker) { .alive = true, .peer = w.next_peer++ };
    w.now = (struct moment) { 1000 * SECOND, INT64_C(1790000000) * SECOND };
    w.core = core_new(&settings, w.now);
    list = core_loaded(w.core, w.now);
    for (size_t i = 0; i < list->count; i++)
        carry_out(&list->items[i]);
    ask("EVENTS", "{\"id\":\"e\"}", NULL, 0);
    ask("STREAM", "{\"id\":\"s\",\"op\":\"open\",\"name\":\"s\",\"channels\":1,\"dt\":0.5,"
                  "\"window\":{\"samples\":8,\"hop\":8,\"options\":{}}}", NULL, 0);
    while (w.waiting != NULL)
        commit(MODAL_OK);
    w.opened = 1;
    ask("STREAM", "{\"id\":\"t\",\"op\":\"open\",\"name\":\"t\",\"channels\":1,\"dt\":0.5,"
                  "\"window\":{\"samples\":16,\"hop\":8,\"options\":{}}}", NULL, 0);
    while (w.waiting != NULL)
        commit(MODAL_OK);
    w.opened = STREAMS;
    submit();
    while (w.waiting != NULL)
        commit(MODAL_OK);
}

/* All that is under way ends, and the answers about it are looked at. */
static void settle(void)
{
    for (int i = 0; i < 1000 && (w.waiting != NULL || w.tasks != NULL); i++) {
        commit(MODAL_OK);
        end_task(MODAL_OK);
    }
    ask("LIST", "{\"id\":\"l\"}", NULL, 0);
    ask("WHOAMI", "{\"id\":\"w\"}", NULL, 0);
}

static void end(void)
{
    struct input *input;
    size_t at = 0;

    while (w.waiting != NULL) {
        struct transaction *t = w.waiting;
        w.waiting = t->next;
        transaction_free(t);
    }
    while (w.tasks != NULL) {
        struct task *t = w.tasks;
        w.tasks = t->next;
        task_free(t);
    }
    while ((input = map_next(&w.core->inputs->all, &at)) != NULL)
        if (input->filling != NULL)
            input->filling->upload = NULL;          /* handles of a spool that is none */
    core_free(w.core);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct bytes in = { data, size };

    boot();
    for (int i = 0; i < ACTS_MOST && in.size > 0; i++)
        act(&in);
    settle();
    end();
    return 0;
}
