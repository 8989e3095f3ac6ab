/* inputs.c - sealed inputs: one record for each user and content, kept while a job names it */
#include "broker/core/inputs.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/sha256.h"

enum { CACHE_BYTES = 4 << 20 };    /* inline inputs in memory: 64 of the largest */
/* What the file of one sample takes on the disk, in blocks of 4096 bytes: HDF5's own structure. */
enum { FILE_LEAST = 44 << 10 };

/* The identity's view of a description; *NAMES is the caller's to free, NULL where there
 * are none. */
void input_shape_of(const struct wire_input *w, struct input_shape *shape, const char ***names)
{
    const cJSON *name;
    size_t count = 0;

    *names = NULL;
    *shape = (struct input_shape) {
        .type = w->content == WIRE_BATCH ? INPUT_BATCH : INPUT_SCENE, .samples = w->samples,
        .channels = w->channels, .length = w->content == WIRE_SCENE ? w->bytes : 0, .dt = w->dt,
        .period = w->period, .units = w->units };
    if (w->names == NULL)
        return;
    *names = grab(w->channels * sizeof **names);
    cJSON_ArrayForEach(name, w->names)
        (*names)[count++] = name->valuestring;
    shape->names = *names;
}

struct input *input_by_id(const struct core *c, int64_t id)
{
    return map_find_number(&c->inputs->all, (uint64_t)id);
}

/* Copies of the texts that SHAPE borrows, so that the input owns them. */
static void own_texts(struct input *input, const struct input_shape *shape)
{
    size_t size = shape->channels * sizeof(char *);
    const char **names;
    char *at;

    input->shape = *shape;
    input->shape.units = grab_text(shape->units);
    input->shape.attributes = input->attributes = grab_text(shape->attributes);
    if (shape->names == NULL)
        return;
    for (uint64_t i = 0; i < shape->channels; i++)
        size += strlen(shape->names[i]) + 1;
    input->shape.names = names = grab(size);
    at = (char *)(names + shape->channels);
    for (uint64_t i = 0; i < shape->channels; i++) {
        names[i] = strcpy(at, shape->names[i]);
        at += strlen(at) + 1;
    }
}

static struct input *input_make(struct core *c, struct user *user, const struct input_shape *shape,
                                int64_t id)
{
    struct input *input = region_grab(&c->region, sizeof *input);

    input->id = id;
    input->user = user;
    input->created_ns = input->used_ns = c->now.utc_ns;
    own_texts(input, shape);
    input->bytes = input_bytes(shape);
    user->bytes += (int64_t)input->bytes;
    if (!map_put(&c->inputs->all, map_hash_number((uint64_t)id), input))
        abort();
    return input;
}

uint64_t input_takes(uint64_t bytes)
{
    return bytes < FILE_LEAST ? FILE_LEAST : bytes;
}

static void put_in_file(struct input *input)
{
    input->beside = (uint32_t)(input_takes(input->bytes) - input->bytes);
    input->user->beside += input->beside;
}

void input_put_inline(struct input *input)
{
    input->inline_data = true;
    input->user->beside -= input->beside;
    input->beside = 0;
}

struct input *input_new(struct core *c, struct user *user, const struct wire_input *w, int64_t id)
{
    struct input_shape shape;
    const char **names;
    char *attributes = w->attributes == NULL ? NULL : json_print(w->attributes);
    struct input *input;

    input_shape_of(w, &shape, &names);
    shape.attributes = attributes;
    input = input_make(c, user, &shape, id);
    put_in_file(input);
    free(names);
    free(attributes);
    return input;
}

struct input *input_load(struct core *c, const struct input_record *r)
{
    struct input *input = input_make(c, user_get(c, r->user), &r->shape, r->id);

    input->state = r->state;
    memcpy(input->sha256, r->sha256, 32);
    input->crc = r->crc;
    input->offset = r->offset;
    input->inline_data = r->inline_data;
    if (!r->inline_data)
        put_in_file(input);
    input->committed = true;
    input->created_ns = r->created_ns;
    input->used_ns = r->used_ns;
    if (input->state == INPUT_SEALED)
        input_index(input);
    return input;
}

/* ---- what makes two inputs the same ---------------------------------------------------------- */

/*
 * An answer shows its input's attributes as provenance, and `tradeoff` reads the truth there, so
 * inputs that differ only in them are two: content = SHA-256(sha256, attributes by name), or
 * sha256 itself where there are none.
 */
void input_content(const uint8_t sha256[32], const cJSON *attributes, uint8_t content[32])
{
    char *text;
    uint8_t *both;
    size_t length;

    memcpy(content, sha256, 32);
    if (attributes == NULL || attributes->child == NULL)
        return;
    text = grab_canonical(attributes);
    length = strlen(text);
    both = grab(32 + length);
    memcpy(both, sha256, 32);
    memcpy(both + 32, text, length);
    sha256_of(both, 32 + length, content);
    free(both);
    free(text);
}

/* And, by the attributes that sealing a stream gives, whose samples it is. */
static void set_content(struct input *input)
{
    cJSON *attributes = input->attributes == NULL ? NULL : cJSON_Parse(input->attributes);
    const char *stream = cJSON_GetStringValue(
        cJSON_GetObjectItemCaseSensitive(attributes, "stream"));

    input_content(input->sha256, attributes, input->content);
    if (stream != NULL && cJSON_HasObjectItem(attributes, "first_sample")) {
        free(input->stream);
        input->stream = grab_text(stream);
    }
    cJSON_Delete(attributes);
}

static bool has_content(const void *value, const void *key)
{
    return memcmp(((const struct input *)value)->content, key, 32) == 0;
}

struct input *input_sealed(const struct user *user, const uint8_t content[32])
{
    return map_find(&user->inputs, map_hash(content, 32), has_content, content);
}

static bool has_identity(const void *value, const void *key)
{
    return memcmp(((const struct input *)value)->sha256, key, 32) == 0;
}

struct input *input_of_identity(const struct user *user, const uint8_t sha256[32])
{
    return map_find(&user->identities, map_hash(sha256, 32), has_identity, sha256);
}

/* In the table INPUT takes the place of OLD; either may be NULL. */
static void replace_youngest(struct map *table, const uint8_t sha256[32], const struct input *old,
                             struct input *input)
{
    if (old != NULL)
        map_remove(table, map_hash(sha256, 32), old);
    if (input != NULL && !map_put(table, map_hash(sha256, 32), input))
        abort();
}

/* Inputs of one identity are a list from the youngest on, which is in the table; seldom is another
 * one's place here. */
static void join_identity(struct input *input)
{
    struct input *next = input_of_identity(input->user, input->sha256), *before = NULL;

    while (next != NULL && next->id > input->id) {
        before = next;
        next = next->older;
    }
    input->older = next;
    input->younger = before;
    if (next != NULL)
        next->younger = input;
    if (before != NULL)
        before->older = input;
    else
        replace_youngest(&input->user->identities, input->sha256, next, input);
}

static void leave_identity(struct input *input)
{
    if (input->older != NULL)
        input->older->younger = input->younger;
    if (input->younger != NULL)
        input->younger->older = input->older;
    else
        replace_youngest(&input->user->identities, input->sha256, input, input->older);
}

void input_index(struct input *input)
{
    set_content(input);
    if (input_sealed(input->user, input->content) != NULL)
        return;
    input->indexed = true;
    if (!map_put(&input->user->inputs, map_hash(input->content, 32), input))
        abort();
    join_identity(input);
}

static void unindex(struct input *input)
{
    if (!input->indexed)
        return;
    input->indexed = false;
    map_remove(&input->user->inputs, map_hash(input->content, 32), input);
    leave_identity(input);
}

void input_record_fill(const struct input *input, struct transaction *t, struct input_record *out)
{
    *out = (struct input_record) {
        .id = input->id, .user = transaction_text(t, input->user->name), .shape = input->shape,
        .state = input->state, .crc = input->crc, .inline_data = input->inline_data,
        .offset = input->offset, .created_ns = input->created_ns, .used_ns = input->used_ns };
    memcpy(out->sha256, input->sha256, 32);
    if (input->inline_data && input->data != NULL) {
        out->data = input->data->data;
        transaction_keep(t, input->data, input->data->size);
    }
}

void input_describe(const struct input *input, cJSON *object)
{
    const struct input_shape *s = &input->shape;

    cJSON_AddStringToObject(object, "content", s->type == INPUT_BATCH ? "batch" : "scene");
    if (s->type == INPUT_SCENE) {
        cJSON_AddNumberToObject(object, "bytes", (double)input->bytes);
        return;
    }
    cJSON_AddNumberToObject(object, "samples", (double)s->samples);
    cJSON_AddNumberToObject(object, "channels", (double)s->channels);
    cJSON_AddNumberToObject(object, "dt", s->dt);
    if (s->period > 0)
        cJSON_AddNumberToObject(object, "period", s->period);
    if (s->names != NULL) {
        cJSON *names = cJSON_AddArrayToObject(object, "names");
        for (uint64_t i = 0; i < s->channels; i++)
            cJSON_AddItemToArray(names, cJSON_CreateString(s->names[i]));
    }
    if (s->units != NULL)
        cJSON_AddStringToObject(object, "units", s->units);
    if (s->attributes != NULL)
        cJSON_AddRawToObject(object, "attributes", s->attributes);
}

void input_cache(struct core *c, struct input *input, struct blob *data)
{
    if (input->data == data)
        return;
    if (input->data != NULL)
        c->inputs->cache_bytes -= (int64_t)input->data->size;
    blob_drop(input->data);
    input->data = NULL;
    if (data != NULL) {
        input->data = blob_share(data);
        c->inputs->cache_bytes += (int64_t)data->size;
    }
}

/* Once its row is committed, the data may leave memory. */
void input_trim(struct core *c, struct input *input)
{
    if (input->committed && c->inputs->cache_bytes > CACHE_BYTES)
        input_cache(c, input, NULL);
}

void input_use(struct core *c, struct input *input, int jobs)
{
    if (input == NULL)
        return;
    input->jobs += jobs;
    input->used_ns = c->now.utc_ns;
}

void input_forget(struct core *c, struct input *input)
{
    input_cache(c, input, NULL);
    unindex(input);
    map_remove(&c->inputs->all, map_hash_number((uint64_t)input->id), input);
    input->user->bytes -= (int64_t)input->bytes;
    input->user->beside -= input->beside;
    filling_free(input->filling);
    free((void *)(uintptr_t)input->shape.names);
    free((void *)(uintptr_t)input->shape.units);
    free(input->attributes);
    free(input->stream);
    region_drop(input);
}

void input_judge(struct core *c, int64_t id, const char *verdict, struct transaction *t)
{
    struct input *input = input_by_id(c, id);
    char name[24];

    if (input == NULL || input->going)
        return;
    input->verdict = verdict;
    if (t == NULL)
        return;
    snprintf(name, sizeof name, "%lld", (long long)id);
    transaction_add(t, LEDGER_NOTE_PUT)->note =
        (struct note_record) { "verdict", transaction_text(t, name), verdict };
}

/* Row, notes and file; the memory goes with the commit. */
void input_remove(struct core *c, struct input *input)
{
    struct transaction *t;
    struct ledger_change *change;
    char name[32];

    if (input->going)
        return;
    input->going = true;
    unindex(input);
    t = transaction_new();
    transaction_add(t, LEDGER_INPUT_DELETE)->id = input->id;
    snprintf(name, sizeof name, "%lld", (long long)input->id);
    change = transaction_add(t, LEDGER_NOTE_PUT);
    change->note = (struct note_record) { .topic = "upload", .name = transaction_text(t, name) };
    if (input->verdict != NULL)
        transaction_add(t, LEDGER_NOTE_PUT)->note =
            (struct note_record) { .topic = "verdict", .name = transaction_text(t, name) };
    transaction_after(t, AFTER_GONE)->input = input;
    core_commit(c, t);
}

/* ---- while it is open ------------------------------------------------------------------------ */

struct filling *filling_new(int64_t touched_ns)
{
    struct filling *f = grab(sizeof *f);

    f->slot = -1;
    f->touched_ns = touched_ns;
    return f;
}

void filling_free(struct filling *f)
{
    if (f == NULL)
        return;
    for (int i = 0; i < f->count; i++) {
        blob_drop(f->chunks[i]);
        after_free(f->writers[i]);
    }
    after_free(f->askers);
    after_free(f->seal);
    after_free(f->aborters);
    free(f->key);
    free(f);
}

void input_share(const struct input *input, struct task *task)
{
    const struct user *user = input->user;

    /* a job's has its room whatever clients do; and without keys all are one user, whom half of
     * the room would keep from what nobody else wants */
    task->whole = input->filling->slot >= 0
               || (user->account != NULL && user->account->key[0] == 0);
    for (int i = 0; i < user->open_count; i++) {
        const struct input *other = user->open[i];
        uint64_t left = other->bytes - other->filling->durable;
        if (other == input || other->filling->slot >= 0)
            continue;
        task->reserved += left;
        if (!other->committed && other->filling->upload == NULL)
            task->pending += left;
    }
}

void inputs_retain(struct core *c)
{
    int64_t before_ns = c->now.utc_ns - c->settings.input_age_ns;
    struct input *input;
    size_t at = 0;

    while ((input = map_next(&c->inputs->all, &at)) != NULL)
        if (input->state == INPUT_SEALED && input->jobs == 0 && input->used_ns < before_ns
            && input->committed)
            input_remove(c, input);
}

void inputs_drop_cached(struct core *c)
{
    struct input *input;
    size_t at = 0;

    while (c->inputs->cache_bytes > 0 && (input = map_next(&c->inputs->all, &at)) != NULL)
        if (input->committed)
            input_cache(c, input, NULL);
}

/* ---- for the worker of a job ----------------------------------------------------------------- */

void input_describe_run(const struct core *c, const struct input *input, bool elsewhere,
                        cJSON *object)
{
    char hex[65], path[4096];

    input_describe(input, object);
    sha256_hex(input->sha256, hex);
    cJSON_AddStringToObject(object, "sha256", hex);
    if (input->inline_data)
        return;
    cJSON_AddNumberToObject(object, "crc32c", (double)input->crc);
    if (elsewhere) {
        cJSON_AddBoolToObject(object, "pull", true);
        return;
    }
    spool_path(path, c->settings.dir, input->id);
    cJSON_AddStringToObject(object, "file", path);
    cJSON_AddNumberToObject(object, "offset", (double)input->offset);
}

struct blob *input_at_hand(const struct input *input)
{
    return input->inline_data ? input->data : NULL;
}

void input_begun(struct core *c, struct input *input)
{
    if (input->jobs <= 1)
        input_cache(c, input, NULL);               /* no other job waits for it */
    input_trim(c, input);
}

bool input_is_inline(const struct input *input)
{
    return input->inline_data;
}

struct task *input_fetch(const struct input *input)
{
    struct task *task = task_new(input->inline_data ? TASK_READ_INPUT : TASK_OPEN_INPUT, input->id);

    task->length = WIRE_INLINE_MOST;
    task->descriptor = -1;
    return task;
}

struct task *input_piece(const struct input *input, uint64_t offset, uint64_t length)
{
    struct task *task;

    if (input->inline_data || offset > input->bytes || length > input->bytes - offset)
        return NULL;
    task = task_new(TASK_READ_SPOOL, input->id);
    task->begin = input->offset;
    task->total = input->bytes;
    task->crc = input->crc;
    task->offset = offset;
    task->length = length;
    return task;
}

const uint8_t *input_sha256(const struct input *input)
{
    return input->sha256;
}

/* ---- the table ------------------------------------------------------------------------------- */

int64_t inputs_in_flight(const struct core *c)
{
    return c->inputs->in_flight;
}

int64_t input_number(struct core *c)
{
    return c->inputs->next_input++;
}

void input_number_past(struct core *c, int64_t id)
{
    if (id >= c->inputs->next_input)
        c->inputs->next_input = id + 1;
}

void inputs_init(struct core *c)
{
    c->inputs = grab(sizeof *c->inputs);
    c->inputs->next_input = 1;
}

void inputs_done(struct core *c)
{
    struct input *input;
    size_t at = 0;

    while ((input = map_next(&c->inputs->all, &at)) != NULL) {
        if (input->filling != NULL)
            upload_close(input->filling->upload);
        input_forget(c, input);
    }
    map_done(&c->inputs->all);
    after_free(c->inputs->outputs);
    free(c->inputs);
}
