/* test_sha256.c - the digest is that of FIPS 180, in pieces too, and its digits lead back to it */
#include "check.h"
#include "base/sha256.h"

/* The examples published with FIPS 180: "abc", and 56 bytes, where the length no longer fits the
 * first block. */
TEST(the_hash_is_sha_256)
{
    static const char *const cases[][2] = {
        { "abc", "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad" },
        { "abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq",
          "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1" },
        { "", "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855" }
    };

    for (int i = 0; i < 3; i++) {
        struct sha256 s;
        uint8_t digest[32];
        char hex[65];
        sha256_init(&s);
        for (const char *c = cases[i][0]; *c != '\0'; c++)
            sha256_add(&s, c, 1);
        sha256_end(&s, digest);
        sha256_hex(digest, hex);
        CHECK_STRING(hex, cases[i][1]);
    }
}

TEST(hex_goes_there_and_back_and_refuses_what_is_none)
{
    uint8_t digest[32], back[32];
    char hex[65];

    for (int i = 0; i < 32; i++)
        digest[i] = (uint8_t)(i * 37 + 5);
    sha256_hex(digest, hex);
    CHECK(sha256_from_hex(hex, back) && memcmp(digest, back, 32) == 0);
    hex[17] = 'g';
    CHECK(!sha256_from_hex(hex, back));
    CHECK(!sha256_from_hex("abc", back));
    CHECK(!sha256_from_hex(NULL, back));
}
