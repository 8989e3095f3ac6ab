/* inputs.c - sealed inputs: one record for each user and identity, kept while a job names it */
#include "broker/state.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CACHE_BYTES = 16 << 20 };             /* inline inputs of waiting jobs kept in memory */

/* The identity's view of a description; *NAMES is the caller's to free, NULL where there are none. */
enum modal_status input_shape_of(const struct wire_input *w, struct input_shape *shape, const char ***names)
{
    const cJSON *name;
    size_t count = 0;

    *names = NULL;
    *shape = (struct input_shape) { .type = w->content == WIRE_BATCH ? INPUT_BATCH : INPUT_SCENE, .samples = w->samples,
        .channels = w->channels, .length = w->content == WIRE_SCENE ? w->bytes : 0, .dt = w->dt, .period = w->period, .units = w->units };
    if (w->names == NULL)
        return MODAL_OK;
    *names = grab(w->channels * sizeof **names);
    cJSON_ArrayForEach(name, w->names)
        (*names)[count++] = name->valuestring;
    shape->names = *names;
    return MODAL_OK;
}

static bool has_id(const void *value, const void *key)
{
    return ((const struct input *)value)->id == *(const int64_t *)key;
}

struct input *input_by_id(const struct core *c, int64_t id)
{
    return map_find(&c->inputs, map_hash_number((uint64_t)id), has_id, &id);
}

/* Copies of the texts that SHAPE borrows, so that the input owns them. */
static void own_texts(struct input *input, const struct input_shape *shape)
{
    size_t size = 0;
    char *at;

    input->shape = *shape;
    input->shape.units = input->units = grab_text(shape->units);
    input->shape.attributes = input->attributes = grab_text(shape->attributes);
    if (shape->names == NULL)
        return;
    for (uint64_t i = 0; i < shape->channels; i++)
        size += strlen(shape->names[i]) + 1;
    input->names = grab(shape->channels * sizeof *input->names);
    at = input->names_text = grab(size);
    for (uint64_t i = 0; i < shape->channels; i++) {
        input->names[i] = strcpy(at, shape->names[i]);
        at += strlen(at) + 1;
    }
    input->shape.names = input->names;
}

static struct input *input_make(struct core *c, struct user *user, const struct input_shape *shape, int64_t id)
{
    struct input *input = grab(sizeof *input);

    input->id = id;
    input->user = user;
    input->created_ns = input->used_ns = c->now.utc_ns;
    own_texts(input, shape);
    input->bytes = input_bytes(shape);
    user->bytes += (int64_t)input->bytes;
    if (!map_put(&c->inputs, map_hash_number((uint64_t)id), input))
        abort();
    return input;
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
    input->committed = true;
    input->created_ns = r->created_ns;
    input->used_ns = r->used_ns;
    if (input->state == INPUT_SEALED)
        input_index(input);
    return input;
}

static bool has_hash(const void *value, const void *key)
{
    return memcmp(((const struct input *)value)->sha256, key, 32) == 0;
}

struct input *input_sealed(const struct user *user, const uint8_t sha256[32])
{
    return map_find(&user->inputs, map_hash(sha256, 32), has_hash, sha256);
}

void input_index(struct input *input)
{
    if (input_sealed(input->user, input->sha256) != NULL)
        return;
    input->indexed = true;
    if (!map_put(&input->user->inputs, map_hash(input->sha256, 32), input))
        abort();
}

void input_record_fill(const struct input *input, struct transaction *t, struct input_record *out)
{
    *out = (struct input_record) { .id = input->id, .user = transaction_text(t, input->user->name), .shape = input->shape,
        .state = input->state, .crc = input->crc, .inline_data = input->inline_data, .offset = input->offset,
        .created_ns = input->created_ns, .used_ns = input->used_ns };
    memcpy(out->sha256, input->sha256, 32);
    if (input->inline_data && input->data != NULL) {
        out->data = input->data->data;
        transaction_keep(t, input->data);
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
        c->cache_bytes -= (int64_t)input->data->size;
    blob_drop(input->data);
    input->data = NULL;
    if (data != NULL) {
        input->data = blob_share(data);
        c->cache_bytes += (int64_t)data->size;
    }
}

/* Once its row is committed, the data may leave memory. */
void input_trim(struct core *c, struct input *input)
{
    if (input->committed && c->cache_bytes > CACHE_BYTES)
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
    if (input->indexed)
        map_remove(&input->user->inputs, map_hash(input->sha256, 32), input);
    map_remove(&c->inputs, map_hash_number((uint64_t)input->id), input);
    input->user->bytes -= (int64_t)input->bytes;
    filling_free(input->filling);
    free(input->names);
    free(input->names_text);
    free(input->units);
    free(input->attributes);
    free(input);
}

/* Row, note and file; the memory goes with the commit. */
void input_remove(struct core *c, struct input *input)
{
    struct transaction *t;
    struct ledger_change *change;
    char name[32];

    if (input->going)
        return;
    input->going = true;
    if (input->indexed)
        map_remove(&input->user->inputs, map_hash(input->sha256, 32), input);
    input->indexed = false;
    t = transaction_new();
    transaction_add(t, LEDGER_INPUT_DELETE)->id = input->id;
    snprintf(name, sizeof name, "%lld", (long long)input->id);
    change = transaction_add(t, LEDGER_NOTE_PUT);
    change->note = (struct note_record) { .topic = "upload", .name = transaction_text(t, name) };
    transaction_after(t, AFTER_GONE)->input = input;
    core_commit(c, t);
}

/* Sealed inputs that no job names go after their time; open ones that nobody touches too. */
void inputs_retain(struct core *c)
{
    size_t at = 0;
    struct input *input;

    while ((input = map_next(&c->inputs, &at)) != NULL) {
        bool stale = input->state == INPUT_SEALED
            ? input->jobs == 0 && input->used_ns + c->settings.input_age_ns < c->now.utc_ns
            : input->filling != NULL && input->filling->slot < 0 && !input->filling->busy && input->filling->in_flight == 0
              && input->filling->touched_ns + c->settings.upload_idle_ns < c->now.utc_ns;
        if (!stale || !input->committed || input->going)
            continue;
        if (input->state == INPUT_SEALED)
            input_remove(c, input);
        else
            upload_quiet(c, input), input->filling->aborting = true, upload_quiet(c, input);
    }
}
