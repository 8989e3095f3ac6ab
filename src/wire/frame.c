/* frame.c - see frame.h; the order of the checks is that of proto/PROTOCOL.md, section 2 */
#include "wire/frame.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum modal_status read_verb(const struct wire_frame *frame, struct wire_message *out,
                                   struct modal_error *err)
{
    const char *text = frame->data;

    if (frame->size < 1 || frame->size > WIRE_VERB_MOST)
        return modal_fail(err, MODAL_BAD_FRAME, "verb of %zu bytes; accepted: 1 to %d", frame->size,
                          WIRE_VERB_MOST);
    for (size_t i = 0; i < frame->size; i++)
        if (text[i] < 'A' || text[i] > 'Z')
            return modal_fail(err, MODAL_BAD_FRAME, "byte %zu of the verb is not A to Z", i);
    memcpy(out->verb, text, frame->size);
    out->verb[frame->size] = 0;
    return MODAL_OK;
}

/* The "id" member as JSON text: a string of 1 to 64 bytes, or an integer of at most 2^53 in
 * size. */
static enum modal_status read_id(const cJSON *header, struct wire_message *out,
                                 struct modal_error *err)
{
    const cJSON *id = json_member(header, "id");
    char *text;

    if (cJSON_IsNumber(id) && id->valuedouble >= -WIRE_INTEGER_MOST
        && id->valuedouble <= WIRE_INTEGER_MOST
        /* the range first: past it the cast is undefined */
        && id->valuedouble == (double)(long long)id->valuedouble) {
        snprintf(out->id, sizeof out->id, "%lld", (long long)id->valuedouble);
        return MODAL_OK;
    }
    if (!cJSON_IsString(id) || id->valuestring[0] == 0 || strlen(id->valuestring) > WIRE_ID_MOST)
        return modal_fail_field(err, MODAL_BAD_FRAME, "id",
                                "every request needs \"id\": a string of 1 to %d bytes or "
                                "an integer of at most 2^53",
                                WIRE_ID_MOST);
    text = json_print(id);
    if (text == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "out of memory");
    snprintf(out->id, sizeof out->id, "%s", text);
    free(text);
    return MODAL_OK;
}

static enum modal_status read_header(const struct wire_frame *frame, bool needs_id,
                                     struct wire_message *out, struct modal_error *err)
{
    int most = needs_id ? WIRE_HEADER_MOST : WIRE_WORKER_HEADER_MOST;
    struct modal_error why;
    cJSON *header = NULL;
    enum modal_status rc;

    if (frame->size > (size_t)most)
        return modal_fail(err, MODAL_BAD_FRAME, "header of %zu bytes; accepted: at most %d",
                          frame->size, most);
    rc = json_read_pooled(frame->data, frame->size, &header, &out->pool, &why);
    if (rc == MODAL_NO_MEMORY)
        return modal_fail(err, rc, "%s", why.message);
    if (rc != MODAL_OK)
        return modal_fail_field(err, MODAL_BAD_FRAME, why.field, "header: %s", why.message);
    out->header = header;
    if (!cJSON_IsObject(out->header))
        return modal_fail(err, MODAL_BAD_FRAME, "the header is not a JSON object");
    return needs_id ? read_id(out->header, out, err) : MODAL_OK;
}

static enum modal_status read_body(const struct wire_frame *frames, int count,
                                   struct wire_message *out, struct modal_error *err)
{
    for (int i = 0; i < count; i++) {
        if (frames[i].size > WIRE_BODY_MOST)
            return modal_fail(err, MODAL_BAD_FRAME, "body frame of %zu bytes; accepted: at most %d",
                              frames[i].size, WIRE_BODY_MOST);
        out->body[i] = frames[i];
        out->body_bytes += frames[i].size;
    }
    out->body_count = count;
    return MODAL_OK;
}

enum modal_status wire_open(const struct wire_frame *frames, int count, const char *version,
                            bool needs_id, struct wire_message *out, struct modal_error *err)
{
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    strcpy(out->id, "null");
    if (count < 1 || frames[0].size != strlen(version)
        || memcmp(frames[0].data, version, frames[0].size) != 0)
        return modal_fail(err, MODAL_BAD_VERSION, "frame 0 is not %s", version);
    if (count < WIRE_FRAMES_LEAST || count > WIRE_FRAMES_MOST)
        return modal_fail(err, MODAL_BAD_FRAME, "message of %d frames; accepted: %d to %d", count,
                          WIRE_FRAMES_LEAST, WIRE_FRAMES_MOST);
    rc = read_verb(&frames[1], out, err);
    if (rc == MODAL_OK)
        rc = read_header(&frames[2], needs_id, out, err);
    if (rc == MODAL_OK)
        rc = read_body(frames + 3, count - 3, out, err);
    if (rc != MODAL_OK)
        wire_close(out);
    return rc;
}

void wire_close(struct wire_message *message)
{
    json_pool_free(message->pool);
    message->pool = NULL;
    message->header = NULL;
}

size_t wire_gather(const struct wire_message *message, void *out, size_t size)
{
    size_t done = 0;

    for (int i = 0; i < message->body_count && done < size; i++) {
        size_t part = message->body[i].size < size - done ? message->body[i].size : size - done;
        if (part > 0)
            memcpy((char *)out + done, message->body[i].data, part);
        done += part;
    }
    return done;
}

cJSON *wire_error_object(const struct modal_error *err, cJSON *detail)
{
    cJSON *object = cJSON_CreateObject();

    cJSON_AddStringToObject(object, "code", modal_status_code(err->status));
    cJSON_AddStringToObject(object, "message", err->message);
    if (err->field[0] != 0)
        cJSON_AddStringToObject(object, "field", err->field);
    if (detail != NULL && !cJSON_AddItemToObject(object, "detail", detail))
        cJSON_Delete(detail);
    return object;
}

char *wire_error_header(const char *id, const char *verb, const struct modal_error *err,
                        cJSON *detail)
{
    cJSON *header = cJSON_CreateObject();
    char *text;

    cJSON_AddRawToObject(header, "id", id);
    cJSON_AddStringToObject(header, "verb", verb);
    cJSON_AddItemToObject(header, "error", wire_error_object(err, detail));
    text = json_print(header);
    cJSON_Delete(header);
    return text;
}

char *wire_error_part(const struct modal_error *err, cJSON *detail)
{
    cJSON *part = cJSON_CreateObject();
    char *text;

    cJSON_AddItemToObject(part, "error", wire_error_object(err, detail));
    text = json_print(part);
    cJSON_Delete(part);
    return text;
}

void wire_error_read(const cJSON *object, struct modal_error *err)
{
    const cJSON *code = cJSON_GetObjectItemCaseSensitive(object, "code");
    const cJSON *message = cJSON_GetObjectItemCaseSensitive(object, "message");
    const cJSON *field = cJSON_GetObjectItemCaseSensitive(object, "field");

    modal_fail_field(err, modal_status_from_code(cJSON_IsString(code) ? code->valuestring : NULL),
                     cJSON_IsString(field) ? field->valuestring : "", "%s",
                     cJSON_IsString(message) ? message->valuestring : "an error without a message");
}
