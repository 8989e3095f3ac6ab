/* identity.c - the canonical header and the hash; see identity.h.  The host is little-endian, as the wire is. */
#include "store/identity.h"
#include <openssl/evp.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are hashed as they lie");

struct identity {
    EVP_MD_CTX *hash;
};

uint64_t input_bytes(const struct input_shape *shape)
{
    uint64_t bytes;

    if (shape->type == INPUT_SCENE)
        return shape->length;
    if (__builtin_mul_overflow(shape->samples, shape->channels, &bytes) || __builtin_mul_overflow(bytes, 8, &bytes))
        return 0;
    return bytes;
}

/* Small pieces of a header on their way to the hash: libcrypto takes a hundred bytes as fast as one. */
struct header { EVP_MD_CTX *hash; size_t used; unsigned char bytes[512]; };

static int flush(struct header *h)
{
    size_t used = h->used;

    h->used = 0;
    return EVP_DigestUpdate(h->hash, h->bytes, used);
}

static int add(struct header *h, const void *data, size_t length)
{
    if (h->used + length > sizeof h->bytes && !flush(h))
        return 0;
    if (length > sizeof h->bytes)
        return EVP_DigestUpdate(h->hash, data, length);
    memcpy(h->bytes + h->used, data, length);
    h->used += length;
    return 1;
}

static int add_text(struct header *h, const char *text)
{
    uint32_t length = (uint32_t)strlen(text);

    return add(h, &length, sizeof length) && add(h, text, length);
}

static int add_batch(struct header *h, const struct input_shape *shape)
{
    double dt = shape->dt + 0.0, period = shape->period + 0.0;     /* -0 becomes 0 */
    int ok = add(h, "modald/batch/1", 15) && add(h, &shape->samples, 8) && add(h, &shape->channels, 8) && add(h, &dt, 8) && add(h, &period, 8)
          && add_text(h, shape->units != NULL ? shape->units : "");

    for (uint64_t s = 0; ok && s < shape->channels; s++) {
        char number[32] = "ch0";
        if (s > 0)
            snprintf(number, sizeof number, "ch%llu", (unsigned long long)s);
        ok = add_text(h, shape->names != NULL ? shape->names[s] : number);
    }
    return ok;
}

static int add_header(EVP_MD_CTX *hash, const struct input_shape *shape)
{
    struct header h;
    int ok;

    h.hash = hash;
    h.used = 0;
    ok = shape->type == INPUT_BATCH ? add_batch(&h, shape) : add(&h, "modald/scene/1", 15) && add(&h, &shape->length, 8);

    return ok && flush(&h);
}

/* Fetched once: libcrypto looks EVP_sha256() up at each use. */
static EVP_MD *sha256_method;
static pthread_once_t sha256_once = PTHREAD_ONCE_INIT;

static void sha256_fetch(void)
{
    sha256_method = EVP_MD_fetch(NULL, "SHA256", NULL);
}

static const EVP_MD *sha256_of(void)
{
    pthread_once(&sha256_once, sha256_fetch);
    return sha256_method != NULL ? sha256_method : EVP_sha256();
}

struct identity *identity_new(const struct input_shape *shape)
{
    struct identity *identity = calloc(1, sizeof *identity);

    if (identity == NULL)
        return NULL;
    identity->hash = EVP_MD_CTX_new();
    if (identity->hash == NULL || !EVP_DigestInit_ex(identity->hash, sha256_of(), NULL) || !add_header(identity->hash, shape)) {
        identity_free(identity);
        return NULL;
    }
    return identity;
}

enum modal_status identity_add(struct identity *identity, const void *data, size_t length, struct modal_error *err)
{
    return EVP_DigestUpdate(identity->hash, data, length) ? MODAL_OK : modal_fail(err, MODAL_INTERNAL, "identity: libcrypto refused %zu bytes", length);
}

enum modal_status identity_end(struct identity *identity, uint8_t sha256[32], struct modal_error *err)
{
    unsigned length;

    return EVP_DigestFinal_ex(identity->hash, sha256, &length) ? MODAL_OK : modal_fail(err, MODAL_INTERNAL, "identity: libcrypto gave no digest");
}

void identity_free(struct identity *identity)
{
    if (identity != NULL)
        EVP_MD_CTX_free(identity->hash);
    free(identity);
}

enum modal_status identity_of(const struct input_shape *shape, const void *data, size_t length, uint8_t sha256[32],
                              struct modal_error *err)
{
    struct identity *identity = identity_new(shape);
    enum modal_status rc;

    if (identity == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identity: no memory for a hash");
    rc = identity_add(identity, data, length, err);
    if (rc == MODAL_OK)
        rc = identity_end(identity, sha256, err);
    identity_free(identity);
    return rc;
}

enum modal_status identity_sha256(const void *data, size_t length, uint8_t sha256[32], struct modal_error *err)
{
    return EVP_Digest(data, length, sha256, NULL, sha256_of(), NULL) ? MODAL_OK
         : modal_fail(err, MODAL_INTERNAL, "identity: libcrypto gave no digest");
}

void identity_hex(const uint8_t sha256[32], char text[65])
{
    static const char digit[] = "0123456789abcdef";

    for (int i = 0; i < 32; i++) {
        text[2 * i] = digit[sha256[i] >> 4];
        text[2 * i + 1] = digit[sha256[i] & 15];
    }
    text[64] = 0;
}

static int nibble(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

int identity_from_hex(const char *text, uint8_t sha256[32])
{
    uint8_t out[32];

    if (text == NULL || strlen(text) != 64)
        return 0;
    for (int i = 0; i < 32; i++) {
        int high = nibble(text[2 * i]), low = nibble(text[2 * i + 1]);
        if (high < 0 || low < 0)
            return 0;
        out[i] = (uint8_t)(high << 4 | low);
    }
    memcpy(sha256, out, 32);
    return 1;
}
