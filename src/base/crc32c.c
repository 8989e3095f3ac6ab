/*
 * crc32c.c - CRC-32C by the processor's instruction, or by eight tables
 *
 * The check is the remainder of the message, bits reflected, by the polynomial 0x1edc6f41
 * (reflected 0x82f63b78), started from and ended with all ones [RFC 3720, 12.1].  SSE4.2's crc32
 * does one step of eight bytes in three cycles.  Elsewhere table[j][b] holds the remainder of byte
 * b followed by j zero bytes, so that the remainders of eight bytes are looked up independently and
 * added.  The remainder being linear, a row of the table is made of those of its eight single bits,
 * by the compiler: there is nothing to fill in at run time.
 *
 * For the same reason the check of A followed by n bytes B is crc(A) x^(8n) + crc(B): the all ones
 * at start and end cancel.  Reflected, bit 31 is the coefficient of x^0.
 */
#include "base/crc32c.h"
#include <string.h>

/* The 256 sums of the remainders of a byte's bits, bit 0 first, from r on. */
#define SUMS_2(r, b0) (r), (r) ^ (b0)
#define SUMS_4(r, b0, b1) SUMS_2(r, b0), SUMS_2((r) ^ (b1), b0)
#define SUMS_8(r, b0, b1, b2) SUMS_4(r, b0, b1), SUMS_4((r) ^ (b2), b0, b1)
#define SUMS_16(r, b0, b1, b2, b3) SUMS_8(r, b0, b1, b2), SUMS_8((r) ^ (b3), b0, b1, b2)
#define SUMS_64(r, b0, b1, b2, b3, b4, b5) \
    SUMS_16(r, b0, b1, b2, b3), SUMS_16((r) ^ (b4), b0, b1, b2, b3), \
    SUMS_16((r) ^ (b5), b0, b1, b2, b3), SUMS_16((r) ^ (b4) ^ (b5), b0, b1, b2, b3)
#define ROW(b0, b1, b2, b3, b4, b5, b6, b7) { \
    SUMS_64(0u, b0, b1, b2, b3, b4, b5), SUMS_64(b6, b0, b1, b2, b3, b4, b5), \
    SUMS_64(b7, b0, b1, b2, b3, b4, b5), SUMS_64((b6) ^ (b7), b0, b1, b2, b3, b4, b5) }

static const uint32_t table[8][256] = {
    ROW(0xf26b8303u, 0xe13b70f7u, 0xc79a971fu, 0x8ad958cfu,
        0x105ec76fu, 0x20bd8edeu, 0x417b1dbcu, 0x82f63b78u),
    ROW(0x13a29877u, 0x274530eeu, 0x4e8a61dcu, 0x9d14c3b8u,
        0x3fc5f181u, 0x7f8be302u, 0xff17c604u, 0xfbc3faf9u),
    ROW(0xa541927eu, 0x4f6f520du, 0x9edea41au, 0x38513ec5u,
        0x70a27d8au, 0xe144fb14u, 0xc76580d9u, 0x8b277743u),
    ROW(0xdd45aab8u, 0xbf672381u, 0x7b2231f3u, 0xf64463e6u,
        0xe964b13du, 0xd725148bu, 0xaba65fe7u, 0x52a0c93fu),
    ROW(0x38116facu, 0x7022df58u, 0xe045beb0u, 0xc5670b91u,
        0x8f2261d3u, 0x1ba8b557u, 0x37516aaeu, 0x6ea2d55cu),
    ROW(0xef306b19u, 0xdb8ca0c3u, 0xb2f53777u, 0x6006181fu,
        0xc00c303eu, 0x85f4168du, 0x0e045bebu, 0x1c08b7d6u),
    ROW(0x68032cc8u, 0xd0065990u, 0xa5e0c5d1u, 0x4e2dfd53u,
        0x9c5bfaa6u, 0x3d5b83bdu, 0x7ab7077au, 0xf56e0ef4u),
    ROW(0x493c7d27u, 0x9278fa4eu, 0x211d826du, 0x423b04dau,
        0x847609b4u, 0x0d006599u, 0x1a00cb32u, 0x34019664u),
};

uint32_t crc32c_table(uint32_t crc, const void *data, size_t length)
{
    const unsigned char *p = data;

    crc = ~crc;
    for (; length >= 8; length -= 8, p += 8) {
        uint32_t low = crc ^ ((uint32_t)p[0] | (uint32_t)p[1] << 8
                              | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24);
        crc = table[7][low & 255] ^ table[6][low >> 8 & 255] ^ table[5][low >> 16 & 255]
              ^ table[4][low >> 24] ^ table[3][p[4]] ^ table[2][p[5]] ^ table[1][p[6]]
              ^ table[0][p[7]];
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
    /* x^8, x^16, x^32, ... */
    for (uint32_t power = 0x00800000u; length != 0; length >>= 1, power = product(power, power))
        if (length & 1)
            first = product(power, first);
    return first ^ second;
}

#if defined(__x86_64__)
#include <nmmintrin.h>

/* Bytes: a page, over which the two products that join the lanes are paid for many times. */
enum { LANE = 4096 };
/* x^(8 LANE): what crc32c_join multiplies by; a test joins lanes */
#define LANE_POWER 0x35d73a62u

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

__attribute__((target("sse4.2"))) static uint32_t crc32c_sse42(uint32_t crc, const void *data,
                                                               size_t length)
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
    return __builtin_cpu_supports("sse4.2") ? crc32c_sse42(crc, data, length)
                                            : crc32c_table(crc, data, length);
}
#else
uint32_t crc32c(uint32_t crc, const void *data, size_t length)
{
    return crc32c_table(crc, data, length);
}
#endif
