/* sha256.h - SHA-256 of FIPS 180-4, by libcrypto */
#ifndef BASE_SHA256_H
#define BASE_SHA256_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <openssl/sha.h>

/* A hash under way: storage of the caller's, nothing to free. */
struct sha256 { SHA256_CTX state; };

/* Begin, add bytes in pieces of any size, and end with the digest, after which only a new beginning
 * is allowed. */
void sha256_init(struct sha256 *s);
void sha256_add(struct sha256 *s, const void *bytes, size_t count);
void sha256_end(struct sha256 *s, uint8_t digest[32]);

/* The digest of COUNT bytes, all at once. */
void sha256_of(const void *bytes, size_t count, uint8_t digest[32]);

/* A digest as 64 hexadecimal digits and a zero byte. */
void sha256_hex(const uint8_t digest[32], char text[65]);

/* Back again; false, and the digest as it was, where TEXT is NULL or not 64 hexadecimal digits. */
bool sha256_from_hex(const char *text, uint8_t digest[32]);
#endif
