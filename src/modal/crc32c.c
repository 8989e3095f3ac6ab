/*
 * crc32c.c - CRC-32C by the processor's instruction, or by eight tables
 *
 * The check is the remainder of the message, bits reflected, by the polynomial 0x1edc6f41 (reflected 0x82f63b78), started
 * from and ended with all ones [RFC 3720, 12.1].  SSE4.2's crc32 does one step of eight bytes in three cycles.  Elsewhere
 * table[j][b] holds the remainder of byte b followed by j zero bytes, so that the remainders of eight bytes are looked up
 * independently and added.
 *
 * The remainder being linear, the check of A followed by n bytes B is crc(A) x^(8n) + crc(B): the all ones at start and end
 * cancel.  Reflected, bit 31 is the coefficient of x^0.
 */
#include "modal/crc32c.h"
#include <pthread.h>
#include <string.h>

static uint32_t table[8][256];

static void table_fill(void)
{
    for (uint32_t b = 0; b < 256; b++) {
        uint32_t r = b;
        for (int bit = 0; bit < 8; bit++)
            r = r >> 1 ^ (r & 1 ? 0x82f63b78u : 0);
        table[0][b] = r;
    }
    for (int j = 1; j < 8; j++)
        for (uint32_t b = 0; b < 256; b++)
            table[j][b] = table[j - 1][b] >> 8 ^ table[0][table[j - 1][b] & 255];
}

uint32_t crc32c_table(uint32_t crc, const void *data, size_t length)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    const unsigned char *p = data;

    pthread_once(&once, table_fill);
    crc = ~crc;
    for (; length >= 8; length -= 8, p += 8) {
        uint32_t low = crc ^ ((uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24);
        crc = table[7][low & 255] ^ table[6][low >> 8 & 255] ^ table[5][low >> 16 & 255] ^ table[4][low >> 24] ^
              table[3][p[4]] ^ table[2][p[5]] ^ table[1][p[6]] ^ table[0][p[7]];
    }
    for (; length > 0; length--)
        crc = crc >> 8 ^ table[0][(crc ^ *p++) & 255];
    return ~crc;
}

/* a b modulo the polynomial */
static uint32_t product(uint32_t a, uint32_t b)
{
    uint32_t sum = 0;

    for (; a != 0; a <<= 1) {
        sum ^= a & 0x80000000u ? b : 0;
        b = b >> 1 ^ (b & 1 ? 0x82f63b78u : 0);
    }
    return sum;
}

uint32_t crc32c_join(uint32_t first, uint32_t second, uint64_t length)
{
    for (uint32_t power = 0x00800000u; length != 0; length >>= 1, power = product(power, power))     /* x^8, x^16, x^32, ... */
        if (length & 1)
            first = product(power, first);
    return first ^ second;
}

#if defined(__x86_64__)
#include <nmmintrin.h>

enum { LANE = 4096 };                          /* bytes */
#define LANE_POWER 0x35d73a62u                 /* x^(8 LANE): what crc32c_join multiplies by; a test joins lanes */

/* Three lanes at a time: a step takes three cycles, and three may be under way. */
__attribute__((target("sse4.2"))) static uint64_t lanes(uint64_t r, const unsigned char *p)
{
    uint64_t second = 0, third = 0, words[3];

    for (int i = 0; i < LANE; i += 8, p += 8) {
        memcpy(words, p, 8);
        memcpy(words + 1, p + LANE, 8);
        memcpy(words + 2, p + 2 * LANE, 8);
        r = _mm_crc32_u64(r, words[0]);
        second = _mm_crc32_u64(second, words[1]);
        third = _mm_crc32_u64(third, words[2]);
    }
    return product(LANE_POWER, product(LANE_POWER, (uint32_t)r) ^ (uint32_t)second) ^ third;
}

__attribute__((target("sse4.2"))) static uint32_t crc32c_sse42(uint32_t crc, const void *data, size_t length)
{
    const unsigned char *p = data;
    uint64_t r = (uint32_t)~crc;

    for (; length >= 3 * LANE; length -= 3 * LANE, p += 3 * LANE)
        r = lanes(r, p);
    for (; length >= 8; length -= 8, p += 8) {
        uint64_t word;
        memcpy(&word, p, 8);
        r = _mm_crc32_u64(r, word);
    }
    for (; length > 0; length--)
        r = _mm_crc32_u8((uint32_t)r, *p++);
    return ~(uint32_t)r;
}

uint32_t crc32c(uint32_t crc, const void *data, size_t length)
{
    return __builtin_cpu_supports("sse4.2") ? crc32c_sse42(crc, data, length) : crc32c_table(crc, data, length);
}
#else
uint32_t crc32c(uint32_t crc, const void *data, size_t length)
{
    return crc32c_table(crc, data, length);
}
#endif
