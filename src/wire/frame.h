/* frame.h - a message of proto/PROTOCOL.md, section 2: frames in, verb and header out, every limit
 * checked */
#ifndef WIRE_FRAME_H
#define WIRE_FRAME_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"
#include "base/json.h"
#include "wire/protocol.h"

struct wire_frame {
    const void *data;
    size_t size;
};

/* A received message.  The body points into the frames given to wire_open, which must outlive
 * it. */
struct wire_message {
    char verb[WIRE_VERB_MOST + 1];
    const cJSON *header;                             /* in `pool`: to be looked at only */
    struct json_pool *pool;                          /* owned: wire_close frees it */
    /* as JSON text; "null" where it could not be read */
    char id[WIRE_ID_MOST * 6 + 3];
    struct wire_frame body[WIRE_FRAMES_MOST];
    int body_count;
    size_t body_bytes;                               /* of all body frames */
};

/*
 * Read COUNT frames in the order of section 2: version (frame 0 must be VERSION), frame count,
 * verb, header, body. NEEDS_ID: the header must hold an "id" (requests of clients and answers to
 * them, not workers' messages). Fails with MODAL_BAD_VERSION or MODAL_BAD_FRAME; then *OUT holds
 * what was read before the fault (verb "", id "null" where neither), enough to answer, and no
 * header.
 */
enum modal_status wire_open(const struct wire_frame *frames, int count, const char *version,
                            bool needs_id, struct wire_message *out, struct modal_error *err);
void wire_close(struct wire_message *message);

/* The body frames, one after the other, into OUT of SIZE bytes; the number copied. */
size_t wire_gather(const struct wire_message *message, void *out, size_t size);

/* The header of an ERROR: {"id":ID,"verb":VERB,"error":{...}}; DETAIL is taken over, may be NULL.
 * The caller frees the text with free(); NULL when memory runs out. */
char *wire_error_header(const char *id, const char *verb, const struct modal_error *err,
                        cJSON *detail);

/* The same without id and verb, {"error":{...}}, for a list of answers. */
char *wire_error_part(const struct modal_error *err, cJSON *detail);

/* The object {"code","message","field"?,"detail"?} of an error, as in queue documents and ERROR. */
cJSON *wire_error_object(const struct modal_error *err, cJSON *detail);

/* And back: fill ERR from such an object; anything else is MODAL_INTERNAL. */
void wire_error_read(const cJSON *object, struct modal_error *err);

#endif
