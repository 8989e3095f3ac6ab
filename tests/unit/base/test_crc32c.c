/* test_crc32c.c - the published values of CRC-32C, both ways of computing it */
#include "check.h"
#include <stdlib.h>
#include "base/crc32c.h"

/* RFC 3720, B.4: 32 bytes each. */
static void fill(unsigned char data[32], int kind)
{
    for (int i = 0; i < 32; i++)
        data[i] = (unsigned char)(kind == 0 ? 0 : kind == 1 ? 0xff : kind == 2 ? i : 31 - i);
}

TEST(the_values_of_rfc_3720_come_out)
{
    static const uint32_t expected[4] = { 0x8a9136aa, 0x62a8ab43, 0x46dd794e, 0x113fdb5c };
    unsigned char data[32];

    for (int kind = 0; kind < 4; kind++) {
        fill(data, kind);
        CHECK(crc32c(0, data, 32) == expected[kind]);
        CHECK(crc32c_table(0, data, 32) == expected[kind]);
    }
    CHECK(crc32c(0, "123456789", 9) == 0xe3069283);
    CHECK(crc32c(0, "", 0) == 0);
}

/* Every start, length and cut of 64 pseudo-random bytes. */
TEST(pieces_give_what_the_whole_gives_and_both_ways_agree)
{
    unsigned char data[64];

    srand(2385);
    for (int i = 0; i < 64; i++)
        data[i] = (unsigned char)rand();
    for (int start = 0; start < 9; start++)
        for (int length = 0; start + length <= 64; length++) {
            uint32_t whole = crc32c(0, data + start, (size_t)length);
            CHECK(crc32c_table(0, data + start, (size_t)length) == whole);
            for (int cut = 0; cut <= length; cut += 3) {
                uint32_t first = crc32c(0, data + start, (size_t)cut),
                         second = crc32c(0, data + start + cut, (size_t)(length - cut));
                CHECK(crc32c_join(first, second, (uint64_t)(length - cut)) == whole);
                CHECK(crc32c(crc32c(0, data + start, (size_t)cut), data + start + cut,
                             (size_t)(length - cut)) == whole);
            }
        }
}

/* Lengths around the three lanes that the instruction takes at a time. */
TEST(long_data_give_both_ways_the_same)
{
    static const size_t lengths[] = { 12287, 12288, 12289, 24576, 65536, 262144 };
    unsigned char *data = malloc(262144 + 3);

    srand(177);
    for (int i = 0; i < 262144 + 3; i++)
        data[i] = (unsigned char)rand();
    for (size_t i = 0; i < sizeof lengths / sizeof *lengths; i++)
        for (int start = 0; start < 4; start += 3)
            CHECK(crc32c(7, data + start, lengths[i]) == crc32c_table(7, data + start, lengths[i]));
    free(data);
}
