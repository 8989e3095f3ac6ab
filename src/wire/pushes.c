/* pushes.c - see pushes.h */
#include "wire/pushes.h"
#include <math.h>
#include <string.h>
#include "base/json.h"
#include "wire/frame.h"
#include "wire/protocol.h"

/* A part's members, by their places. */
enum { STREAM, EPOCH, FIRST, BYTES, CRC, MEMBERS };

/* Of a number, by its place; a part has a byte at least. */
static const struct { double least, most; } ranges[MEMBERS] = {
    [EPOCH] = { 0, WIRE_INTEGER_MOST }, [FIRST] = { 0, WIRE_INTEGER_MOST },
    [BYTES] = { 1, WIRE_CHUNK_MOST }, [CRC] = { 0, UINT32_MAX },
};

static bool is_good(const cJSON *part)
{
    const cJSON *at = cJSON_IsArray(part) ? part->child : NULL;
    const char *stream = cJSON_GetStringValue(at);
    int place = 0;

    if (stream == NULL || stream[0] == 0 || strlen(stream) > WIRE_ID_MOST)
        return false;
    for (at = at->next, place = EPOCH; at != NULL && place < MEMBERS; at = at->next, place++) {
        const double x = cJSON_IsNumber(at) ? at->valuedouble : -1;
        if (x < ranges[place].least || x > ranges[place].most || x != floor(x))
            return false;
    }
    return at == NULL && place == MEMBERS;
}

struct wire_push wire_push_read(const cJSON *part)
{
    const cJSON *at = part->child;
    struct wire_push push = { .stream = at->valuestring };

    push.epoch = (uint64_t)(at = at->next)->valuedouble;
    push.first = (uint64_t)(at = at->next)->valuedouble;
    push.bytes = (size_t)(at = at->next)->valuedouble;
    push.crc32c = (uint32_t)at->next->valuedouble;
    return push;
}

enum modal_status wire_pushes_check(const struct wire_message *m, const cJSON **parts,
                                    struct modal_error *err)
{
    const cJSON *list = json_member(m->header, "parts"), *part;
    size_t bytes = 0;
    int count = 0;

    cJSON_ArrayForEach(part, list) {
        if (!is_good(part) || count == WIRE_PUSHES_MOST)
            break;
        bytes += wire_push_read(part).bytes;
        count++;
    }
    if (!cJSON_IsArray(list) || part != NULL || count == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "parts",
                                "parts must be 1 to %d lists [stream, epoch, first, bytes, "
                                "crc32c]; the one at %d is none", WIRE_PUSHES_MOST, count);
    if (m->body_count != 1 || m->body_bytes != bytes)
        return modal_fail_field(err, MODAL_BAD_INPUT, "body",
                                "the body has %zu bytes in %d frames; accepted: the %zu of the "
                                "parts, in one", m->body_bytes, m->body_count, bytes);
    if (bytes > WIRE_CHUNK_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "body",
                                "pushes of %zu bytes; accepted: at most %d", bytes,
                                WIRE_CHUNK_MOST);
    *parts = list;
    return MODAL_OK;
}
