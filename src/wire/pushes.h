/* pushes.h - samples of many streams in one message: STREAM of op "pushes" */
#ifndef WIRE_PUSHES_H
#define WIRE_PUSHES_H
#include <cjson/cJSON.h>
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"

struct wire_message;

/* One of them; its samples lie in the body behind those of the parts before it. */
struct wire_push {
    const char *stream;          /* borrowed of the message */
    uint64_t epoch, first;
    size_t bytes;
    uint32_t crc32c;
};

/* Are the parts of MESSAGE lists [stream, epoch, first, bytes, crc32c] that make up its body?  Then
 * they are *PARTS, borrowed.  Fails with MODAL_BAD_INPUT or MODAL_TOO_LARGE. */
enum modal_status wire_pushes_check(const struct wire_message *message, const cJSON **parts,
                                    struct modal_error *err);

/* PART of a list that was found right. */
struct wire_push wire_push_read(const cJSON *part);

#endif
