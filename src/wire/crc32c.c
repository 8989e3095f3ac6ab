/*
 * crc32c.c - CRC-32C of a chunk
 *
 * The polynomial is 0x1EDC6F41 (Castagnoli, RFC 3720 B.4), bits reflected: 0x82F63B78.  The portable way takes eight
 * bytes a step through eight tables (Sarwate's table, sliced); x86 with SSE 4.2 has the instruction.
 */
#include "wire/frame.h"
#include <pthread.h>
#include <string.h>

static uint32_t table[8][256];
static pthread_once_t table_once = PTHREAD_ONCE_INIT;

static void make_table(void)
{
    for (uint32_t n = 0; n < 256; n++) {
        uint32_t crc = n;
        for (int bit = 0; bit < 8; bit++)
            crc = crc & 1 ? crc >> 1 ^ 0x82F63B78u : crc >> 1;
        table[0][n] = crc;
    }
    for (int slice = 1; slice < 8; slice++)
        for (int n = 0; n < 256; n++)
            table[slice][n] = table[slice - 1][n] >> 8 ^ table[0][table[slice - 1][n] & 255];
}

static uint32_t portable(uint32_t crc, const unsigned char *p, size_t size)
{
    pthread_once(&table_once, make_table);
    for (; size >= 8; p += 8, size -= 8) {
        uint32_t low = crc ^ (p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24);
        crc = table[7][low & 255] ^ table[6][low >> 8 & 255] ^ table[5][low >> 16 & 255] ^ table[4][low >> 24]
            ^ table[3][p[4]] ^ table[2][p[5]] ^ table[1][p[6]] ^ table[0][p[7]];
    }
    while (size-- > 0)
        crc = crc >> 8 ^ table[0][(crc ^ *p++) & 255];
    return crc;
}

#if defined(__x86_64__)
__attribute__((target("sse4.2"))) static uint32_t instruction(uint32_t crc, const unsigned char *p, size_t size)
{
    uint64_t wide = crc;

    for (; size >= 8; p += 8, size -= 8) {
        uint64_t word;
        memcpy(&word, p, 8);
        wide = __builtin_ia32_crc32di(wide, word);
    }
    crc = (uint32_t)wide;
    while (size-- > 0)
        crc = __builtin_ia32_crc32qi(crc, *p++);
    return crc;
}
#endif

uint32_t wire_crc32c(const void *data, size_t size)
{
#if defined(__x86_64__)
    if (__builtin_cpu_supports("sse4.2"))
        return ~instruction(~0u, data, size);
#endif
    return ~portable(~0u, data, size);
}
