/* identity.h - what an input is: the SHA-256 of a canonical header and its data
 *
 * Two inputs are the same exactly when these bytes are.  All numbers little-endian, text without
 * its zero, `text` being a u32 length and the bytes:
 *
 *     batch   "modald/batch/1" 0x00, u64 samples, u64 channels, f64 dt, f64 period (0: none),
 *             text units ("" : none), text name of each channel ("ch0", "ch1", ... where the sender
 *             gave none), then the samples as f64, row by row
 *     scene   "modald/scene/1" 0x00, u64 length, then the JSON as sent, with the arrays behind it
 */
#ifndef STORE_IDENTITY_H
#define STORE_IDENTITY_H
#include <stddef.h>
#include <stdint.h>

struct sha256;

enum input_type { INPUT_BATCH, INPUT_SCENE };

/* What an input is besides its data.  All is borrowed. */
struct input_shape {
    enum input_type type;
    uint64_t samples, channels;  /* of a batch */
    uint64_t length;             /* of a scene, bytes: text and arrays */
    double dt, period;           /* s; period 0: none */
    const char *units;           /* NULL or "": none */
    const char *const *names;    /* `channels` names, or NULL */
    /* a JSON object, kept as provenance, no part of the identity; or NULL */
    const char *attributes;
};

/* Bytes of data: 8 samples channels, or length.  0 where it overflows. */
uint64_t input_bytes(const struct input_shape *shape);

/* Begin HASH with SHAPE's header; the data are the caller's to add, and the digest is the
 * identity. */
void identity_begin(struct sha256 *hash, const struct input_shape *shape);

/* All at once. */
void identity_of(const struct input_shape *shape, const void *data, size_t length,
                 uint8_t sha256[32]);
#endif
