/* identity.c - the canonical header and the hash; see identity.h.  The host is little-endian, as
 * the wire is. */
#include "store/identity.h"
#include <stdio.h>
#include <string.h>
#include "base/sha256.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are hashed as they lie");

uint64_t input_bytes(const struct input_shape *shape)
{
    uint64_t bytes;

    if (shape->type == INPUT_SCENE)
        return shape->length;
    if (__builtin_mul_overflow(shape->samples, shape->channels, &bytes)
        || __builtin_mul_overflow(bytes, 8, &bytes))
        return 0;
    return bytes;
}

static void add_text(struct sha256 *hash, const char *text)
{
    uint32_t length = (uint32_t)strlen(text);

    sha256_add(hash, &length, sizeof length);
    sha256_add(hash, text, length);
}

static void add_batch(struct sha256 *hash, const struct input_shape *shape)
{
    double dt = shape->dt + 0.0, period = shape->period + 0.0;     /* -0 becomes 0 */

    sha256_add(hash, "modald/batch/1", 15);
    sha256_add(hash, &shape->samples, 8);
    sha256_add(hash, &shape->channels, 8);
    sha256_add(hash, &dt, 8);
    sha256_add(hash, &period, 8);
    add_text(hash, shape->units != NULL ? shape->units : "");
    for (uint64_t s = 0; s < shape->channels; s++) {
        char number[32];
        snprintf(number, sizeof number, "ch%llu", (unsigned long long)s);
        add_text(hash, shape->names != NULL ? shape->names[s] : number);
    }
}

void identity_begin(struct sha256 *hash, const struct input_shape *shape)
{
    sha256_init(hash);
    if (shape->type == INPUT_BATCH) {
        add_batch(hash, shape);
        return;
    }
    sha256_add(hash, "modald/scene/1", 15);
    sha256_add(hash, &shape->length, 8);
}

void identity_of(const struct input_shape *shape, const void *data, size_t length,
                 uint8_t sha256[32])
{
    struct sha256 hash;

    identity_begin(&hash, shape);
    sha256_add(&hash, data, length);
    sha256_end(&hash, sha256);
}
