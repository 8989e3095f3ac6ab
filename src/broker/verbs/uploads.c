/*
 * uploads.c - inputs that come in chunks: from clients (UPLOAD), and from workers that make signals
 *
 * One task at a time works on an upload.  Chunks that come meanwhile are gathered, written by the
 * next task with one sync, and committed together; then each is acknowledged.  So a slow disk
 * makes the groups larger, not the queue.
 */
#include "base/crc32c.h"
#include "base/sha256.h"
#include "broker/core/inputs.h"
#include "broker/verbs/verbs.h"
#include "wire/frame.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { GROUP = 64 };          /* chunks a task: CREDIT_MOST of them */
/* Bytes that one upload may have unacknowledged at most. */
enum { CREDIT_MOST = GROUP * WIRE_CHUNK_MOST };

/* Its task, which is the threads' already: filled in at once. */
static struct task *run(struct core *c, struct input *input, enum task_type type)
{
    struct task *task = task_new(type, input->id);

    task->shape = input->shape;
    task->upload = input->filling->upload;
    task->owner = input;
    task->offset = input->filling->durable;
    input->filling->busy = true;
    core_task(c, task, user_turn(input->user, input->filling->peer));
    return task;
}

int64_t core_window(const struct core *c)
{
    int64_t open = c->inputs->open_streams, part;

    for (size_t i = 0; i < c->user_count; i++)
        open += c->user_list[i]->open_count;
    part = c->settings.window_bytes / (open > 0 ? open : 1);
    if (part < 2 * WIRE_CHUNK_MOST)
        part = 2 * WIRE_CHUNK_MOST;
    return part < CREDIT_MOST ? part : CREDIT_MOST;
}

static void answer_state(struct core *c, const struct reply *reply, const struct input *input,
                         const char *state)
{
    cJSON *header = answer_new(reply);
    char ident[9], hex[65];

    input_ident(c, input, ident);
    cJSON_AddStringToObject(header, "upload", ident);
    cJSON_AddStringToObject(header, "state", state);
    cJSON_AddNumberToObject(header, "bytes", (double)input->bytes);
    cJSON_AddNumberToObject(header, "present",
                            (double)(input->state == INPUT_SEALED ? input->bytes
                                                                  : input->filling->durable));
    cJSON_AddNumberToObject(header, "credit", (double)core_window(c));
    if (input->state == INPUT_SEALED) {
        sha256_hex(input->sha256, hex);
        cJSON_AddStringToObject(header, "sha256", hex);
    }
    answer_send(c, reply, header, NULL);
}

/* ---- a task's turn --------------------------------------------------------------------------- */

static void write_group(struct core *c, struct input *input)
{
    struct filling *f = input->filling;
    struct task *task = run(c, input, TASK_WRITE);

    task->offset = f->accepted;
    for (int i = 0; i < f->count; i++) {
        task->offset -= f->chunks[i]->size;
        task->chunks[i] = f->chunks[i];
        task->crcs[i] = f->crcs[i];
        after_append(&task->after,
                     f->writers[i] != NULL ? f->writers[i] : after_new(AFTER_CHUNK, NULL));
        f->writers[i] = NULL;
    }
    task->count = f->count;
    f->count = 0;
}

/* Bytes of the chunks that wait for a task. */
static uint64_t waiting(const struct filling *f)
{
    uint64_t bytes = 0;

    for (int i = 0; i < f->count; i++)
        bytes += f->chunks[i]->size;
    return bytes;
}

static void drop_open(struct user *user, const struct input *input)
{
    for (int i = 0; i < user->open_count; i++)
        if (user->open[i] == input) {
            user->open[i] = user->open[--user->open_count];
            return;
        }
}

/* Its row goes, and once that is committed its file, as nobody may be told `gone` of what a crash
 * would bring back. */
static void leave(struct core *c, struct input *input)
{
    drop_open(input->user, input);
    if (input->filling->upload != NULL)
        run(c, input, TASK_CLOSE);
    input->filling->upload = NULL;
    input->filling->busy = true;                   /* nothing more starts */
    input_remove(c, input);
}

/* Whatever the upload has to do next, once nothing is under way. */
static void upload_quiet(struct core *c, struct input *input)
{
    struct filling *f = input->filling;

    if (f == NULL || f->busy || !input->committed || input->state == INPUT_SEALED)
        return;
    if (f->aborting) {
        leave(c, input);
        return;
    }
    if ((f->upload == NULL || f->broken) && (f->count > 0 || f->seal != NULL || f->sealing)) {
        if (f->durable + waiting(f) == f->accepted)      /* it is taken up from what is committed */
            run(c, input, TASK_RESUME);
        return;
    }
    if (f->count > 0) {
        write_group(c, input);
        return;
    }
    if (f->in_flight > 0)
        return;
    while (f->askers != NULL) {
        struct after *after = f->askers;
        f->askers = after->next;
        after->next = NULL;
        answer_state(c, &after->reply, input, "open");
        after_free(after);
    }
    if (f->sealing && f->durable == input->bytes)
        run(c, input, TASK_SEAL);
}

static void fail_writers(struct core *c, struct after *after, const struct modal_error *err)
{
    bool passes = err->status == MODAL_STORAGE_FULL || err->status == MODAL_BUSY;

    for (; after != NULL; after = after->next)
        answer_error(c, &after->reply, err, passes ? answer_number("retry_after_s", 5) : NULL);
}

/* Who asked to seal asks again when the bytes are here. */
static void give_up_seal(struct core *c, struct filling *f, const struct modal_error *err)
{
    fail_writers(c, f->seal, err);
    after_free(f->seal);
    f->seal = NULL;
    f->sealing = false;
}

/* The upload ends at TO again: what lies before it is committed, or about to be.  Whose chunks wait
 * for a task are told ERR. */
static void shrink(struct core *c, struct input *input, uint64_t to, const struct modal_error *err)
{
    struct filling *f = input->filling;

    c->inputs->in_flight -= (int64_t)(f->accepted - to);
    f->in_flight -= f->accepted - to;
    f->accepted = to;
    for (int i = 0; i < f->count; i++) {
        blob_drop(f->chunks[i]);
        fail_writers(c, f->writers[i], err);
        after_free(f->writers[i]);
        f->writers[i] = NULL;
    }
    f->count = 0;
}

/* What a worker makes is sealed, or with ERR has failed and goes: its job is told behind this. */
static void end_output(struct core *c, struct input *input, const struct modal_error *err)
{
    struct filling *f = input->filling;
    struct after *after;

    if (f->slot < 0)
        return;
    after = after_new(AFTER_OUTPUT, NULL);
    after->input = input;
    after->value = f->slot;
    if (err != NULL) {
        after->err = grab(sizeof *after->err);
        *after->err = *err;
        f->slot = -1;
        f->aborting = true;
    }
    after_append(&c->inputs->outputs, after);
}

static void written(struct core *c, struct input *input, struct task *task)
{
    struct transaction *t;
    struct after *after = task->after;
    uint64_t offset = task->offset;

    if (task->status != MODAL_OK) {
        fail_writers(c, task->after, &task->err);
        shrink(c, input, task->offset, &task->err);
        give_up_seal(c, input->filling, &task->err);
        input->filling->broken = true;             /* who knows what is in the file past that */
        end_output(c, input, &task->err);
        return;
    }
    t = transaction_new();
    for (int i = 0; i < task->count; i++) {
        transaction_add_chunk(t, input->id, &input->filling->row, &(struct chunk_record) {
            offset, task->chunks[i]->size, task->crcs[i] });
        after->input = input;
        after->value = (int64_t)offset;
        after->length = (int64_t)task->chunks[i]->size;
        offset += task->chunks[i]->size;
        after = after->next;
    }
    transaction_join(t, task->after);
    task->after = NULL;
    core_commit(c, t);
}

static void sealed(struct core *c, struct input *input, struct task *task)
{
    struct filling *f = input->filling;
    struct transaction *t;

    if (f->aborting)
        return;
    if (task->status == MODAL_OK && f->slot < 0 && memcmp(task->sha256, f->wanted, 32) != 0) {
        f->aborting = f->wrong = true;             /* told when it is gone */
        memcpy(f->found, task->sha256, 32);
        return;
    }
    if (task->status != MODAL_OK) {
        give_up_seal(c, f, &task->err);
        end_output(c, input, &task->err);
        return;
    }
    f->sealing = false;                            /* done: upload_quiet must not seal it again */
    input->state = INPUT_SEALED;
    memcpy(input->sha256, task->sha256, 32);
    input->crc = task->crc;
    input->offset = task->offset;
    input->used_ns = c->now.utc_ns;
    t = transaction_new();
    input_record_fill(input, t, &transaction_add(t, LEDGER_INPUT_PUT)->input);
    if (f->seal == NULL)
        f->seal = after_new(AFTER_SEAL, NULL);
    f->seal->input = input;
    for (struct after *after = f->seal; after != NULL; after = after->next)
        after->input = input;
    transaction_join(t, f->seal);
    f->seal = NULL;
    core_commit(c, t);
}

static void add_open(struct user *user, struct input *input)
{
    user->open = regrab(user->open, (size_t)(user->open_count + 1) * sizeof *user->open);
    user->open[user->open_count++] = input;
}

static void begun(struct core *c, struct input *input, struct task *task)
{
    struct filling *f = input->filling;
    struct transaction *t;
    char name[32], *note, hex[65] = "";
    cJSON *text;

    if (task->status != MODAL_OK) {
        fail_writers(c, f->askers, &task->err);
        drop_open(input->user, input);
        end_output(c, input, &task->err);
        input_forget(c, input);
        return;
    }
    input->offset = task->offset;
    t = transaction_new();
    input_record_fill(input, t, &transaction_add(t, LEDGER_INPUT_PUT)->input);
    snprintf(name, sizeof name, "%lld", (long long)input->id);
    text = cJSON_CreateObject();
    if (f->slot >= 0)
        cJSON_AddTrueToObject(text, "output");
    if (f->key != NULL)
        cJSON_AddStringToObject(text, "key", f->key);
    if (f->has_declared) {
        sha256_hex(f->declared, hex);
        cJSON_AddStringToObject(text, "sha256", hex);
    }
    note = json_print(text);
    cJSON_Delete(text);
    transaction_add(t, LEDGER_NOTE_PUT)->note =
        (struct note_record) { "upload", transaction_text(t, name), transaction_text(t, note) };
    free(note);
    transaction_after(t, AFTER_BEGIN)->input = input;
    core_commit(c, t);
}

static void resumed(struct core *c, struct input *input, struct task *task)
{
    struct filling *f = input->filling;

    f->broken = false;
    if (task->status == MODAL_OK)
        return;
    shrink(c, input, f->durable, &task->err);
    give_up_seal(c, f, &task->err);
    /* damaged: it must be sent again */
    f->aborting = task->status != MODAL_BUSY && task->status != MODAL_NO_MEMORY;
}

void upload_task_done(struct core *c, struct task *task)
{
    struct input *input = task->owner;
    struct filling *f;

    if (task->type == TASK_CLOSE)
        return;                                    /* the input may be gone by now */
    f = input->filling;
    f->busy = false;
    f->upload = task->upload;
    switch (task->type) {
    case TASK_BEGIN:  begun(c, input, task); return;
    case TASK_RESUME: resumed(c, input, task); break;
    case TASK_WRITE:  written(c, input, task); break;
    default:          sealed(c, input, task); break;
    }
    upload_quiet(c, input);
}

static void answer_chunk(struct core *c, const struct after *after)
{
    cJSON *header;
    char ident[9];

    if (after->reply.peer == 0)
        return;
    header = answer_new(&after->reply);
    input_ident(c, after->input, ident);
    cJSON_AddStringToObject(header, "upload", ident);
    cJSON_AddNumberToObject(header, "offset", (double)after->value);
    cJSON_AddNumberToObject(header, "present", (double)(after->value + after->length));
    cJSON_AddNumberToObject(header, "credit", (double)core_window(c));
    answer_send(c, &after->reply, header, NULL);
}

void upload_after(struct core *c, struct after *after)
{
    struct input *input = after->input;
    struct filling *f = input->filling;

    switch (after->type) {
    case AFTER_BEGIN:
        input->committed = true;
        break;
    case AFTER_CHUNK:
        f->durable = (uint64_t)(after->value + after->length);
        f->in_flight -= (uint64_t)after->length;
        c->inputs->in_flight -= after->length;
        if (f->slot >= 0)
            worker_go(c, f->slot);
        answer_chunk(c, after);
        break;
    case AFTER_SEAL:
        if (f != NULL) {
            for (struct after *late = f->seal; late != NULL; late = late->next)
                answer_state(c, &late->reply, input, "sealed");
            drop_open(input->user, input);
            run(c, input, TASK_CLOSE);
            input_index(input);
            end_output(c, input, NULL);
            input->filling = NULL;
            filling_free(f);
        }
        if (after->reply.peer != 0)
            answer_state(c, &after->reply, input, "sealed");
        return;
    default:
        return;
    }
    upload_quiet(c, input);
}

static void answer_gone(struct core *c, const struct input *input, const struct reply *reply)
{
    cJSON *header = answer_new(reply);
    char ident[9];

    input_ident(c, input, ident);
    cJSON_AddStringToObject(header, "upload", ident);
    cJSON_AddStringToObject(header, "state", "gone");
    answer_send(c, reply, header, NULL);
}

static void answer_wrong(struct core *c, const struct filling *f, const struct reply *reply)
{
    cJSON *detail = cJSON_CreateObject();
    char hex[65];

    sha256_hex(f->found, hex);
    cJSON_AddStringToObject(detail, "found", hex);
    answer_fail(c, reply, MODAL_BAD_INPUT, "sha256", detail,
                "the bytes have another SHA-256; begin again");
}

void upload_gone(struct core *c, struct input *input)
{
    const struct filling *f = input->filling;
    const struct after *after;

    for (after = f->aborters; after != NULL; after = after->next)
        answer_gone(c, input, &after->reply);
    for (after = f->seal; after != NULL; after = after->next)
        if (f->wrong)
            answer_wrong(c, f, &after->reply);
        else
            answer_fail(c, &after->reply, MODAL_NOT_FOUND, "upload", NULL,
                        "the upload was aborted");
    for (after = f->askers; after != NULL; after = after->next)
        answer_fail(c, &after->reply, MODAL_BUSY, "", answer_number("retry_after_s", 0.1),
                    "the upload was aborted; begin again");
}

/* ---- requests -------------------------------------------------------------------------------- */

static bool same_attributes(const struct input *input, const cJSON *attributes)
{
    cJSON *known = input->attributes == NULL ? NULL : cJSON_Parse(input->attributes);
    char *a = grab_canonical(known), *b = grab_canonical(attributes);
    bool same = strcmp(a, b) == 0;

    cJSON_Delete(known);
    free(a);
    free(b);
    return same;
}

static bool same_shape(const struct input *input, const struct wire_input *w)
{
    struct input_shape shape;
    const char **names;
    bool same;

    input_shape_of(w, &shape, &names);
    same = shape.type == input->shape.type && w->bytes == input->bytes
           && shape.samples == input->shape.samples && shape.channels == input->shape.channels
           && shape.dt == input->shape.dt && shape.period == input->shape.period
           && (shape.names == NULL) == (input->shape.names == NULL)
           && strcmp(shape.units ? shape.units : "", input->shape.units ? input->shape.units : "")
                  == 0;
    for (uint64_t i = 0; same && names != NULL && i < shape.channels; i++)
        same = strcmp(names[i], input->shape.names[i]) == 0;
    free(names);
    return same && same_attributes(input, w->attributes);
}

static struct input *find_open(const struct request *q, const uint8_t declared[32])
{
    for (int i = 0; i < q->user->open_count; i++) {
        struct input *input = q->user->open[i];
        struct filling *f = input->filling;
        if (f->slot >= 0 || f->aborting)
            continue;
        if (q->wire.upload.key != NULL
                ? f->key != NULL && strcmp(f->key, q->wire.upload.key) == 0
                : q->wire.upload.sha256 != NULL && f->key == NULL && f->has_declared
                      && memcmp(f->declared, declared, 32) == 0
                      && same_attributes(input, q->wire.upload.input.attributes))
            return input;
    }
    return NULL;
}

static bool may_begin(struct core *c, const struct request *q)
{
    const struct reply *reply = &q->reply;
    uint64_t bytes = q->wire.upload.input.bytes;

    if (c->draining || c->terminating)
        answer_fail(c, reply, MODAL_DRAINING, "", answer_number("retry_after_s", 5),
                    "the daemon takes no new work");
    else if ((double)bytes > (double)c->settings.input_bytes)
        answer_fail(c, reply, MODAL_TOO_LARGE,
                    q->wire.upload.input.content == WIRE_SCENE ? "bytes" : "samples", NULL,
                    "an input of %llu bytes; accepted: at most %lld",
                    (unsigned long long)bytes, (long long)c->settings.input_bytes);
    else if (q->user->open_count >= WIRE_UPLOADS_MOST)
        answer_fail(c, reply, MODAL_BUSY, "", answer_number("retry_after_s", 5),
                    "%d uploads are open, at most %d", q->user->open_count, WIRE_UPLOADS_MOST);
    else
        return !user_quota(c, q->user, reply, 0, (int64_t)input_takes(bytes));
    return false;
}

static void begin(struct core *c, const struct request *q)
{
    uint8_t declared[32] = { 0 }, content[32];
    struct input *input = NULL;

    if (q->wire.upload.sha256 != NULL && sha256_from_hex(q->wire.upload.sha256, declared)) {
        input_content(declared, q->wire.upload.input.attributes, content);
        input = input_sealed(q->user, content);
    }
    if (input != NULL && input->committed && !input->going) {
        input_use(c, input, 0);
        answer_state(c, &q->reply, input, "sealed");
        return;
    }
    input = find_open(q, declared);
    if (input != NULL && !same_shape(input, &q->wire.upload.input)) {
        answer_fail(c, &q->reply, MODAL_CONFLICT, "key", NULL,
                    "the key names an upload of another description");
        return;
    }
    if (input == NULL) {
        if (!may_begin(c, q))
            return;
        input = input_new(c, q->user, &q->wire.upload.input, input_number(c));
        input->filling = filling_new(c->now.utc_ns);
        input->filling->key = grab_text(q->wire.upload.key);
        input->filling->has_declared = q->wire.upload.sha256 != NULL;
        memcpy(input->filling->declared, declared, 32);
        input->filling->peer = q->reply.peer;
        add_open(q->user, input);
        input_share(input, run(c, input, TASK_BEGIN));
    }
    input->filling->touched_ns = c->now.utc_ns;
    after_append(&input->filling->askers, after_new(AFTER_BEGIN, &q->reply));
    upload_quiet(c, input);
}

bool upload_allows(struct core *c, struct user *user, size_t size, const struct reply *reply)
{
    double rate = user->account->most.upload_bytes_s;
    double burst = rate > 4 * WIRE_CHUNK_MOST ? rate : 4 * WIRE_CHUNK_MOST;
    cJSON *detail;

    if (rate <= 0)
        return true;
    user->upload_level -= rate * (double)(c->now.mono_ns - user->upload_ns) / 1e9;
    user->upload_ns = c->now.mono_ns;
    if (user->upload_level < 0)
        user->upload_level = 0;
    if (user->upload_level + (double)size <= burst) {
        user->upload_level += (double)size;
        return true;
    }
    detail = answer_number("retry_after_s", (user->upload_level + (double)size - burst) / rate);
    cJSON_AddStringToObject(detail, "limit", "upload_bytes_s");
    cJSON_AddNumberToObject(detail, "most", rate);
    answer_fail(c, reply, MODAL_QUOTA, "", detail, "over your limit: %.0f bytes uploaded a second",
                rate);
    return false;
}

void upload_owes(struct user *user, uint64_t bytes)
{
    if (user->account->most.upload_bytes_s > 0)
        user->upload_level += (double)bytes;
}

static void chunk(struct core *c, const struct request *q, struct input *input)
{
    struct filling *f = input->filling;
    const struct wire_frame *body = &q->event->message->body[0];
    uint64_t end = q->wire.upload.offset + body->size;

    if (input->state == INPUT_SEALED || f->sealing)
        answer_fail(c, &q->reply, MODAL_CONFLICT, "upload", NULL, "the upload is sealed");
    else if (q->wire.upload.offset != f->accepted)
        answer_fail(c, &q->reply, MODAL_BAD_INPUT, "offset",
                    answer_number("expected", (double)f->accepted),
                    "a chunk at %llu; accepted: %llu, where the one before ends",
                    (unsigned long long)q->wire.upload.offset, (unsigned long long)f->accepted);
    else if (end > input->bytes)
        answer_fail(c, &q->reply, MODAL_BAD_INPUT, "offset", NULL,
                    "the chunk ends at %llu, past the input's %llu bytes", (unsigned long long)end,
                    (unsigned long long)input->bytes);
    else if (f->count == GROUP
             || (f->in_flight > 0 && (int64_t)(f->in_flight + body->size) > CREDIT_MOST)) {
        c->counts.credit_stalls++;
        answer_fail(c, &q->reply, MODAL_BUSY, "", answer_number("retry_after_s", 0.1),
                    "more unacknowledged chunks than the credit allows");
    } else if (crc32c(0, body->data, body->size) != q->wire.upload.crc32c)
        answer_fail(c, &q->reply, MODAL_BAD_INPUT, "crc32c", NULL,
                    "crc32c is %u; accepted: %u, that of the chunk as it came",
                    q->wire.upload.crc32c, crc32c(0, body->data, body->size));
    else if (upload_allows(c, input->user, body->size, &q->reply)) {
        f->writers[f->count] = after_new(AFTER_CHUNK, &q->reply);
        f->crcs[f->count] = q->wire.upload.crc32c;
        f->chunks[f->count++] = blob_share(q->event->body[0]);
        f->accepted = end;
        f->in_flight += body->size;
        c->inputs->in_flight += (int64_t)body->size;
        f->touched_ns = c->now.utc_ns;
        upload_quiet(c, input);
    }
}

static void seal(struct core *c, const struct request *q, struct input *input)
{
    struct filling *f = input->filling;
    uint8_t wanted[32];

    sha256_from_hex(q->wire.upload.sha256, wanted);
    if (input->state == INPUT_SEALED) {
        if (memcmp(wanted, input->sha256, 32) == 0 && f == NULL)
            answer_state(c, &q->reply, input, "sealed");
        else if (memcmp(wanted, input->sha256, 32) == 0)
            after_append(&f->seal, after_new(AFTER_SEAL, &q->reply));     /* not committed yet */
        else
            answer_fail(c, &q->reply, MODAL_BAD_INPUT, "sha256", NULL,
                        "the upload is sealed with another SHA-256");
        return;
    }
    if (f == NULL || f->accepted < input->bytes) {
        answer_fail(c, &q->reply, MODAL_BAD_INPUT, "present",
                    answer_number("expected", (double)input->bytes), "%llu of %llu bytes are here",
                    (unsigned long long)(f == NULL ? 0 : f->accepted),
                    (unsigned long long)input->bytes);
        return;
    }
    memcpy(f->wanted, wanted, 32);
    f->sealing = true;
    after_append(&f->seal, after_new(AFTER_SEAL, &q->reply));
    upload_quiet(c, input);
}

static void drop_upload(struct core *c, const struct request *q, struct input *input)
{
    struct modal_error err;

    if (input->filling == NULL) {
        answer_fail(c, &q->reply, MODAL_CONFLICT, "upload", NULL,
                    "the upload is sealed; it goes when no job names it");
        return;
    }
    modal_fail_field(&err, MODAL_NOT_FOUND, "upload", "the upload was aborted");
    shrink(c, input, input->filling->accepted - waiting(input->filling), &err);
    input->filling->aborting = true;
    after_append(&input->filling->aborters, after_new(AFTER_GONE, &q->reply));
    upload_quiet(c, input);
}

void upload_request(struct core *c, const struct request *q)
{
    struct input *input;

    if (q->wire.upload.op == WIRE_BEGIN) {
        begin(c, q);
        return;
    }
    input = input_by_id(c, ident_number(~c->settings.secret, q->wire.upload.upload));
    if (input == NULL || input->user != q->user || input->going || !input->committed
        || (input->filling != NULL && (input->filling->aborting || input->filling->slot >= 0))) {
        answer_fail(c, &q->reply, MODAL_NOT_FOUND, "upload", NULL, "no such upload of yours");
        return;
    }
    if (input->filling != NULL)
        input->filling->peer = q->reply.peer;
    if (q->wire.upload.op == WIRE_CHUNK)
        chunk(c, q, input);
    else if (q->wire.upload.op == WIRE_SEAL)
        seal(c, q, input);
    else
        drop_upload(c, q, input);
}

/* ---- signals that a worker makes ------------------------------------------------------------- */

struct input *output_begin(struct core *c, struct user *user, const struct wire_input *w, int slot)
{
    struct input *input = input_new(c, user, w, input_number(c));

    input->filling = filling_new(c->now.utc_ns);
    input->filling->slot = slot;
    add_open(user, input);
    input_share(input, run(c, input, TASK_BEGIN));
    return input;
}

void output_chunk(struct core *c, struct input *input, struct blob *chunk_data)
{
    struct filling *f = input->filling;

    f->writers[f->count] = NULL;
    f->crcs[f->count] = crc32c(0, chunk_data->data, chunk_data->size);
    f->chunks[f->count++] = blob_share(chunk_data);
    f->accepted += chunk_data->size;
    f->in_flight += chunk_data->size;
    c->inputs->in_flight += (int64_t)chunk_data->size;
    upload_quiet(c, input);
}

void output_seal(struct core *c, struct input *input)
{
    input->filling->sealing = true;
    upload_quiet(c, input);
}

/* Is nothing of it under way, and has nobody touched it for long? */
static bool is_idle(const struct core *c, const struct input *input)
{
    const struct filling *f = input->filling;

    return f != NULL && f->slot < 0 && !f->busy && f->in_flight == 0
        && f->touched_ns + c->settings.upload_idle_ns < c->now.utc_ns;
}

void uploads_retain(struct core *c)
{
    size_t at = 0;
    struct input *input;

    while ((input = map_next(&c->inputs->all, &at)) != NULL) {
        if (input->state != INPUT_OPEN || !input->committed || input->going || !is_idle(c, input))
            continue;
        upload_quiet(c, input);                    /* who began it again is told what is here */
        input->filling->aborting = true;
        upload_quiet(c, input);
    }
}

void upload_load_note(struct core *c, const struct note_record *r)
{
    struct input *input = input_by_id(c, strtoll(r->name, NULL, 10));
    cJSON *object = NULL;
    const char *key = NULL, *hash = NULL;

    if (input == NULL || input->filling == NULL
        || json_read(r->text, strlen(r->text), &object, NULL) != MODAL_OK)
        return;
    input->filling->aborting = cJSON_HasObjectItem(object, "output");     /* its worker is gone */
    json_get_string(object, "", "key", &key, NULL);
    json_get_string(object, "", "sha256", &hash, NULL);
    input->filling->key = grab_text(key);
    input->filling->has_declared =
        hash != NULL && sha256_from_hex(hash, input->filling->declared);
    cJSON_Delete(object);
}

void upload_load(struct input *input, const struct input_record *r)
{
    input->filling = filling_new(r->used_ns > r->created_ns ? r->used_ns : r->created_ns);
    input->filling->accepted = input->filling->durable = r->received;
    add_open(input->user, input);
}

void uploads_go_on(struct core *c)
{
    struct input *input;
    size_t at = 0;

    while ((input = map_next(&c->inputs->all, &at)) != NULL)
        if (input->filling != NULL && input->filling->aborting)
            upload_quiet(c, input);
}

void output_drop(struct core *c, struct input *input)
{
    if (input->filling == NULL)
        return;
    input->filling->slot = -1;
    input->filling->aborting = true;
    upload_quiet(c, input);
}

uint64_t output_accepted(const struct input *input)
{
    return input->filling->accepted;
}

uint64_t output_total(const struct input *input)
{
    return input->bytes;
}
