/* sha256.h - SHA-256 of FIPS 180-4, for hashes inside the numerics (the store uses libcrypto) */
#ifndef MODAL_SHA256_H
#define MODAL_SHA256_H
#include <stddef.h>
#include <stdint.h>

struct sha256 {
    uint32_t h[8];
    uint64_t length;          /* bytes so far */
    unsigned char block[64];
};

void sha256_start(struct sha256 *s);
void sha256_add(struct sha256 *s, const void *bytes, size_t count);
void sha256_hex(struct sha256 *s, char out[65]);   /* ends it: 64 hexadecimal digits and a zero byte */

#endif
