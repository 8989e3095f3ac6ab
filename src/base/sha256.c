/*
 * sha256.c - see sha256.h
 *
 * Of libcrypto's two interfaces the older: it cannot fail, needs no memory, no state of the
 * process, no configuration file read at its first use (0.9 ms), and small pieces cost it less.
 * OpenSSL 3 calls it deprecated for lack of a way to choose among providers; there is nothing to
 * choose here.
 */
#define OPENSSL_SUPPRESS_DEPRECATED
#include "base/sha256.h"
#include <ctype.h>
#include <string.h>

void sha256_init(struct sha256 *s)
{
    SHA256_Init(&s->state);
}

void sha256_add(struct sha256 *s, const void *bytes, size_t count)
{
    SHA256_Update(&s->state, bytes, count);
}

void sha256_end(struct sha256 *s, uint8_t digest[32])
{
    SHA256_Final(digest, &s->state);
}

void sha256_of(const void *bytes, size_t count, uint8_t digest[32])
{
    struct sha256 s;

    sha256_init(&s);
    sha256_add(&s, bytes, count);
    sha256_end(&s, digest);
}

void sha256_hex(const uint8_t digest[32], char text[65])
{
    static const char digit[] = "0123456789abcdef";

    for (int i = 0; i < 32; i++) {
        text[2 * i] = digit[digest[i] >> 4];
        text[2 * i + 1] = digit[digest[i] & 15];
    }
    text[64] = 0;
}

static int nibble(char c)
{
    static const char digits[] = "0123456789abcdef";
    const char *at = c != '\0' ? strchr(digits, tolower((unsigned char)c)) : NULL;

    return at != NULL ? (int)(at - digits) : -1;
}

bool sha256_from_hex(const char *text, uint8_t digest[32])
{
    uint8_t out[32];

    if (text == NULL || strlen(text) != 64)
        return false;
    for (int i = 0; i < 32; i++) {
        int high = nibble(text[2 * i]), low = nibble(text[2 * i + 1]);
        if (high < 0 || low < 0)
            return false;
        out[i] = (uint8_t)(high << 4 | low);
    }
    memcpy(digest, out, 32);
    return true;
}
