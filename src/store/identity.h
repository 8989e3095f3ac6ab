/* identity.h - what an input is: the SHA-256 of a canonical header and its data
 *
 * Two inputs are the same exactly when these bytes are.  All numbers little-endian, text without its zero, `text` being
 * a u32 length and the bytes:
 *
 *     batch   "modald/batch/1" 0x00, u64 samples, u64 channels, f64 dt, f64 period (0: none), text units ("" : none),
 *             text name of each channel ("ch0", "ch1", ... where the sender gave none), then the samples as f64, row by row
 *     scene   "modald/scene/1" 0x00, u64 length, then the JSON as sent
 */
#ifndef STORE_IDENTITY_H
#define STORE_IDENTITY_H
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"

enum input_type { INPUT_BATCH, INPUT_SCENE };

/* What an input is besides its data.  All is borrowed. */
struct input_shape {
    enum input_type type;
    uint64_t samples, channels;  /* of a batch */
    uint64_t length;             /* of a scene, bytes */
    double dt, period;           /* s; period 0: none */
    const char *units;           /* NULL or "": none */
    const char *const *names;    /* `channels` names, or NULL */
    const char *attributes;      /* a JSON object, kept as provenance, no part of the identity; or NULL */
};

/* Bytes of data: 8 samples channels, or length.  0 where it overflows. */
uint64_t input_bytes(const struct input_shape *shape);

struct identity;                 /* a hash under way */
/* Start with SHAPE's header; NULL when memory runs out. */
struct identity *identity_new(const struct input_shape *shape);
enum modal_status identity_add(struct identity *identity, const void *data, size_t length, struct modal_error *err);
/* The digest of what was added; IDENTITY may not be added to after. */
enum modal_status identity_end(struct identity *identity, uint8_t sha256[32], struct modal_error *err);
void identity_free(struct identity *identity);

/* All at once. */
enum modal_status identity_of(const struct input_shape *shape, const void *data, size_t length, uint8_t sha256[32],
                              struct modal_error *err);
/* Plain SHA-256 of LENGTH bytes. */
enum modal_status identity_sha256(const void *data, size_t length, uint8_t sha256[32], struct modal_error *err);
/* 64 hex digits and a zero byte; back again, false where TEXT is not 64 hex digits. */
void identity_hex(const uint8_t sha256[32], char text[65]);
int identity_from_hex(const char *text, uint8_t sha256[32]);
#endif
