/* dump.c - see dump.h */
#include "store/dump.h"
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include "base/json.h"
#include "base/sha256.h"
#include "store/ledger_db.h"

struct dump {
    void (*line)(void *context, const char *json);
    void *context;
};

static cJSON *row_new(const char *row)
{
    cJSON *object = cJSON_CreateObject();

    cJSON_AddStringToObject(object, "row", row);
    return object;
}

/* 64-bit numbers as text, since doubles lose their last digits. */
static void add_int(cJSON *object, const char *name, int64_t value)
{
    char text[24];

    snprintf(text, sizeof text, "%" PRId64, value);
    cJSON_AddStringToObject(object, name, text);
}

static void add_text(cJSON *object, const char *name, const char *text)
{
    if (text != NULL)
        cJSON_AddStringToObject(object, name, text);
}

static void add_digest(cJSON *object, const char *name, const uint8_t digest[32])
{
    char hex[65];

    sha256_hex(digest, hex);
    cJSON_AddStringToObject(object, name, hex);
}

static enum modal_status put_row(struct dump *dump, cJSON *object)
{
    char *text = json_print(object);

    cJSON_Delete(object);
    if (text == NULL)
        return MODAL_NO_MEMORY;
    dump->line(dump->context, text);
    free(text);
    return MODAL_OK;
}

static enum modal_status dump_input(void *context, const struct input_record *input)
{
    const struct input_shape *shape = &input->shape;
    cJSON *row = row_new("input");

    add_int(row, "id", input->id);
    add_text(row, "user", input->user);
    add_text(row, "state", input->state == INPUT_SEALED ? "sealed" : "open");
    add_text(row, "content", shape->type == INPUT_BATCH ? "batch" : "scene");
    add_int(row, "bytes", (int64_t)input_bytes(shape));
    if (shape->type == INPUT_BATCH) {
        add_int(row, "samples", (int64_t)shape->samples);
        add_int(row, "channels", (int64_t)shape->channels);
        json_set_number(row, "dt", shape->dt);
        json_set_number(row, "period", shape->period);
    }
    add_text(row, "units", shape->units);
    add_text(row, "attributes", shape->attributes);
    if (input->state == INPUT_SEALED)
        add_digest(row, "sha256", input->sha256);
    else
        add_int(row, "received", (int64_t)input->received);
    cJSON_AddNumberToObject(row, "crc32c", input->crc);
    cJSON_AddBoolToObject(row, "inline", input->inline_data);
    add_int(row, "offset", (int64_t)input->offset);
    add_int(row, "created_ns", input->created_ns);
    add_int(row, "used_ns", input->used_ns);
    return put_row(context, row);
}

static enum modal_status dump_job(void *context, const struct job_record *job)
{
    cJSON *row = row_new("job");

    add_int(row, "id", job->id);
    add_text(row, "user", job->user);
    add_text(row, "key", job->key);
    add_text(row, "kind", job->kind);
    add_text(row, "options", job->options);
    add_int(row, "input", job->input);
    add_digest(row, "fingerprint", job->fingerprint);
    add_text(row, "state", job_states[job->state]);
    cJSON_AddNumberToObject(row, "priority", job->priority);
    cJSON_AddNumberToObject(row, "attempts", job->attempts);
    cJSON_AddNumberToObject(row, "crashes", job->crashes);
    add_int(row, "run_limit_ns", job->run_limit_ns);
    add_int(row, "deadline_ns", job->deadline_ns);
    add_int(row, "not_before_ns", job->not_before_ns);
    add_int(row, "submitted_ns", job->submitted_ns);
    add_int(row, "started_ns", job->started_ns);
    add_int(row, "finished_ns", job->finished_ns);
    add_int(row, "cpu_ns", job->cpu_ns);
    add_text(row, "error_code", job->error_code);
    add_text(row, "error_message", job->error_message);
    add_text(row, "error_field", job->error_field);
    add_text(row, "error_detail", job->error_detail);
    add_text(row, "tag", job->tag);
    add_int(row, "result_bytes", (int64_t)job->result_bytes);
    add_int(row, "output", job->output);
    cJSON_AddBoolToObject(row, "cached", job->cached);
    return put_row(context, row);
}

static enum modal_status dump_result(void *context, const struct result_record *result)
{
    cJSON *row = row_new("result");

    add_int(row, "job", result->job);
    add_int(row, "bytes", (int64_t)result->length);
    cJSON_AddNumberToObject(row, "crc32c", result->crc);
    add_digest(row, "input", result->input);
    add_digest(row, "settings", result->settings);
    return put_row(context, row);
}

static enum modal_status dump_tombstone(void *context, const struct tombstone_record *tombstone)
{
    cJSON *row = row_new("tombstone");

    add_text(row, "user", tombstone->user);
    add_text(row, "key", tombstone->key);
    add_int(row, "job", tombstone->job);
    add_digest(row, "fingerprint", tombstone->fingerprint);
    add_int(row, "expired_ns", tombstone->expired_ns);
    return put_row(context, row);
}

static enum modal_status dump_note(void *context, const struct note_record *note)
{
    cJSON *row = row_new("note");

    add_text(row, "topic", note->topic);
    add_text(row, "name", note->name);
    add_text(row, "text", note->text);
    return put_row(context, row);
}

static enum modal_status dump_segment(void *context, const struct segment_record *segment)
{
    cJSON *row = row_new("segment");

    add_int(row, "stream", segment->stream);
    add_int(row, "epoch", (int64_t)segment->epoch);
    add_int(row, "first", (int64_t)segment->first);
    add_int(row, "count", (int64_t)segment->count);
    add_int(row, "offset", (int64_t)segment->offset);
    add_int(row, "bytes", (int64_t)segment->length);
    cJSON_AddNumberToObject(row, "crc32c", segment->crc);
    return put_row(context, row);
}

static enum modal_status dump_event(void *context, const struct event_record *event)
{
    cJSON *row = row_new("event");

    add_int(row, "number", event->number);
    add_int(row, "ns", event->ns);
    add_int(row, "job", event->job);
    add_text(row, "user", event->user);
    add_text(row, "topic", event->topic);
    add_text(row, "text", event->text);
    return put_row(context, row);
}

enum modal_status dump_folder(const char *dir, void (*line)(void *context, const char *json),
                              void *context, struct modal_error *err)
{
    struct dump dump = { line, context };
    struct ledger_visitor visitor = { &dump,          dump_input, dump_job,   dump_result,
                                      dump_tombstone, dump_note,  dump_event, dump_segment };
    struct ledger_reader *reader = NULL;
    enum modal_status rc = ledger_reader_open(dir, &reader, err);

    if (rc != MODAL_OK)
        return rc;
    rc = ledger_reader_load(reader, &visitor, err);
    ledger_reader_close(reader);
    return rc == MODAL_NO_MEMORY ? modal_fail(err, rc, "no memory to write out %s", dir) : rc;
}
