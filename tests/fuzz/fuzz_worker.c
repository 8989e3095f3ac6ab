/*
 * fuzz_worker.c - what a worker says over the lives of its jobs: the broker stays whole, and no
 * answer passes the limits
 *
 * A core with one worker of its own and one elsewhere, jobs of two users' and a stream; the
 * ledger, the spool and the time do what the input says. The input is a list of acts, each led by
 * one byte:
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
 *     15        samples of a stream
 *     16 .. 20  a message of JOIN, INPUT, RELEASE, STDERR, LEAVE, as 0 .. 5 have them
 *     21        from here on it is the worker elsewhere that speaks, or again our own
 *     22        the connection of the worker elsewhere ends
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/crc32c.h"
#include "broker/core/core.h"
#include "broker/core/inputs.h"
#include "broker/core/state.h"
#include "wire/frame.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum { ACTS_MOST = 64, HEADER_MOST = 4096 };

static struct {
    struct core *core;
    struct moment now;
    struct transaction *waiting, **waiting_end;
    struct task *tasks, **tasks_end;
    char job[2][9], submitted[9], stream[9];   /* jobs: of our own worker, of the one elsewhere */
    int attempt[2], requests, pushed;
    bool alive, dying, elsewhere;              /* elsewhere: who speaks */
    uint64_t peer;                             /* its connection's number */
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
    copy_member(a->header, "stream", w.stream);
}

static void look_at_run(const struct action *a)
{
    const bool far = a->type == ACT_REMOTE;
    cJSON *read;

    if (strcmp(a->verb, "RUN") != 0)
        return;
    if (a->type == ACT_WORKER ? !w.alive : a->peer != w.peer)
        abort();
    read = cJSON_Parse(a->header);
    memset(w.job[far], 0, sizeof w.job[far]);
    strncpy(w.job[far], cJSON_GetObjectItemCaseSensitive(read, "job")->valuestring, 8);
    w.attempt[far] = (int)cJSON_GetObjectItemCaseSensitive(read, "attempt")->valuedouble;
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
    case ACT_SPAWN:  w.alive = true; w.dying = false; break;
    case ACT_KILL:   w.dying = true; break;
    case ACT_LOG:
        if (strchr(a->header, '\n') != NULL || strlen(a->header) > 8192)
            abort();
        break;
    case ACT_HAND: case ACT_STOP: break;
    }
    free(a->header);
    blob_drop(a->body);
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
}

static void ask(const char *verb, const char *header, const void *body, size_t size)
{
    struct blob *blob = body != NULL ? blob_copy(body, size) : NULL;
    struct wire_frame frames[4] = { { WIRE_VERSION, 7 }, { verb, strlen(verb) },
                                    { header, strlen(header) }, { body, size } };
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

static void push(void)
{
    double samples[8];
    char header[200];

    for (int i = 0; i < 8; i++)
        samples[i] = w.pushed + i;
    snprintf(header, sizeof header, "{\"id\":%d,\"op\":\"push\",\"stream\":\"%s\",\"epoch\":0,"
             "\"first\":%d,\"count\":8,\"crc32c\":%u}", ++w.requests,
             w.stream, w.pushed, crc32c(0, samples, sizeof samples));
    w.pushed += 8;
    if (w.stream[0] != 0)
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

static void say(const struct wire_frame *frames, int count)
{
    struct blob *blobs[WIRE_FRAMES_MOST + 2] = { NULL };
    struct wire_message m;
    struct modal_error err;
    enum modal_status rc = wire_open(frames, count, WIRE_WORKER, false, &m, &err);

    for (int i = 3; i < count; i++)
        blobs[i - 3] = blob_copy(frames[i].data, frames[i].size);
    step((struct event) { .type = w.elsewhere ? EVENT_REMOTE : EVENT_WORKER, .slot = 0,
                          .peer = w.peer, .key = "work",
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
        snprintf(header, sizeof header, "{\"job\":\"%s\",\"attempt\":%d%s%s", w.job[w.elsewhere],
                 w.attempt[w.elsewhere], given[0] == '}' ? "" : ",", given);
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

static void act(struct bytes *in)
{
    static const char *const verbs[] = { "READY", "BEAT", "PROGRESS", "PART", "DONE", "FAILED" };
    static const char *const far_verbs[] = { "JOIN", "INPUT", "RELEASE", "STDERR", "LEAVE" };
    int what = take(in) & 31;

    if (what < 6 && (w.alive || w.elsewhere))
        say_verb(verbs[what], in);
    else if (what >= 16 && what < 21 && (w.alive || w.elsewhere))
        say_verb(far_verbs[what - 16], in);
    else if (what == 21)
        w.elsewhere = !w.elsewhere;
    else if (what == 22)
        step((struct event) { .type = EVENT_REMOTE_GONE, .peer = w.peer++ });
    else if (what == 6 && (w.alive || w.elsewhere))
        say_raw(in);
    else if (what == 7 || what == 8)
        end_task(what == 7 ? MODAL_OK : MODAL_IO);
    else if (what == 9 || what == 10)
        commit(what == 9 ? MODAL_OK : MODAL_STORAGE_FULL);
    else if (what == 11)
        submit();
    else if (what == 12)
        cancel();
    else if (what == 13 && w.alive) {
        w.alive = false;
        step((struct event) { .type = EVENT_EXIT, .slot = 0, .status = w.dying ? 9 : take(in) << 8,
                              .stderr_text = "last words" });
    } else if (what == 14) {
        w.now.mono_ns += take(in) * (SECOND / 10);
        step((struct event) { .type = EVENT_TIME });
    } else if (what == 15)
        push();
}

/* ---- a life ---------------------------------------------------------------------------------- */

static void boot(void)
{
    static const struct account accounts[] = {
        { .key = "", .user = "one", .role = WIRE_ROLE_ADMIN, .weight = 1 },
        { .key = "work", .user = "pool", .role = WIRE_ROLE_WORKER, .weight = 1 } };
    static const struct settings settings = { .accounts = accounts, .account_count = 2,
        .workers = 1, .cores = 2, .queue_jobs = 20,
        .input_bytes = 1 << 22, .window_bytes = 1 << 20, .lease_ns = 5 * SECOND,
        .result_age_ns = 3600 * SECOND, .input_age_ns = 60 * SECOND,
        .tombstone_age_ns = 86400 * SECOND, .upload_idle_ns = 86400 * SECOND,
        .result_bytes = 1 << 30, .events_kept = 1024, .secret = 0x1234567 };
    const struct actions *list;

    memset(&w, 0, sizeof w);
    w.waiting_end = &w.waiting;
    w.tasks_end = &w.tasks;
    w.peer = 1;
    w.now = (struct moment) { 1000 * SECOND, INT64_C(1790000000) * SECOND };
    w.core = core_new(&settings, w.now);
    list = core_loaded(w.core, w.now);
    for (size_t i = 0; i < list->count; i++)
        carry_out(&list->items[i]);
    ask("EVENTS", "{\"id\":\"e\"}", NULL, 0);
    ask("STREAM", "{\"id\":\"s\",\"op\":\"open\",\"name\":\"s\",\"channels\":1,\"dt\":0.5,"
                  "\"window\":{\"samples\":8,\"hop\":8,\"options\":{}}}", NULL, 0);
    submit();
    while (w.waiting != NULL)
        commit(MODAL_OK);
}

/* All that is under way ends, and the answers about it are looked at:
 * no cores have given more than time times two. */
static void settle(void)
{
    int64_t booked = 0;

    for (int i = 0; i < 1000 && (w.waiting != NULL || w.tasks != NULL); i++) {
        commit(MODAL_OK);
        end_task(MODAL_OK);
    }
    ask("LIST", "{\"id\":\"l\"}", NULL, 0);
    ask("WHOAMI", "{\"id\":\"w\"}", NULL, 0);
    for (size_t i = 0; i < w.core->user_count; i++)
        booked += (int64_t)(w.core->user_list[i]->cpu_s * 1e9);
    if (booked > 2 * (w.now.mono_ns - 1000 * SECOND) + 1000)
        abort();
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
