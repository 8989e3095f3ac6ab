/*
 * fuzz_frame.c - any bytes as frames: decoding never reads past them, and what it accepts is within
 * the limits
 *
 * The input is cut at each 0xff byte; the pieces are the frames.  A piece "MODALD1" comes first by
 * itself half the time.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "wire/frame.h"
#include "wire/request.h"

/* The parts of SUBMITS take all of the body, and no part more than an input may have. */
static void walk_parts(const struct wire_message *m, const struct wire_request *r)
{
    char *all = malloc(m->body_bytes + 1);
    const char *body = all;
    const cJSON *job;

    if (all == NULL)
        return;
    wire_gather(m, all, m->body_bytes);
    cJSON_ArrayForEach(job, r->submits.jobs) {
        struct wire_message part;
        struct wire_request one;
        struct modal_error err;
        wire_part(job, &body, &part);
        if (part.body_bytes > WIRE_INLINE_MOST)
            abort();
        wire_request_read(&part, &one, &err);
    }
    if (body != all + m->body_bytes)
        abort();
    free(all);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Copies of the pieces, each of exactly its size, so that the sanitizer sees one byte too many. */
static int cut(const uint8_t *data, size_t size, struct wire_frame frames[12])
{
    int count = 0;

    while (count < 12) {
        const uint8_t *end = size > 0 ? memchr(data, 0xff, size) : NULL;
        size_t length = end == NULL ? size : (size_t)(end - data);
        void *copy = malloc(length > 0 ? length : 1);

        if (copy == NULL)
            abort();
        if (length > 0)
            memcpy(copy, data, length);
        frames[count++] = (struct wire_frame) { copy, length };
        if (end == NULL)
            break;
        size -= length + 1;
        data = end + 1;
    }
    return count;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct wire_frame frames[13] = { { WIRE_VERSION, strlen(WIRE_VERSION) } };
    struct wire_message m;
    struct wire_request r;
    struct modal_error err;
    bool worker = size > 0 && (data[0] & 1);
    int count = 1 + cut(data + (size > 0), size - (size > 0), frames + 1);

    if (wire_open(frames, count, WIRE_VERSION, !worker, &m, &err) == MODAL_OK) {
        if (m.body_count > WIRE_FRAMES_MOST - 3 || strlen(m.verb) > WIRE_VERB_MOST)
            abort();
        if (!worker && wire_request_read(&m, &r, &err) == MODAL_OK) {
            if (r.verb == WIRE_SUBMIT && r.submit.input.bytes > WIRE_INLINE_MOST)
                abort();
            if (r.verb == WIRE_SUBMITS)
                walk_parts(&m, &r);
        }
    }
    wire_close(&m);
    for (int i = 1; i < count; i++)
        free((void *)frames[i].data);
    return 0;
}
