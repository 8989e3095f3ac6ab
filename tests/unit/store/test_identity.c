/* test_identity.c - the identity of an input; expected digests were computed by Python's struct and
 * hashlib from identity.h */
#include "base/sha256.h"
#include "check.h"
#include "store/identity.h"

static const double x[6] = { 2.385, -1.5, 1e-300, 7.25, 0.1, 3.0 };

static void check_digest(const struct input_shape *shape, const void *data, size_t length,
                         const char *expected)
{
    uint8_t digest[32];
    char hex[65];

    identity_of(shape, data, length, digest);
    sha256_hex(digest, hex);
    CHECK_STRING(hex, expected);
}

TEST(a_batch_has_the_digest_that_the_header_describes)
{
    static const char *const names[2] = { "root", "tip" };
    struct input_shape shape = { .type = INPUT_BATCH,
                                 .samples = 3,
                                 .channels = 2,
                                 .dt = 0.0125,
                                 .period = 0.5,
                                 .units = "m/s",
                                 .names = names };

    check_digest(&shape, x, sizeof x,
                 "fa143a199a7a91a6bd611909a05a76c9cd607543c4f2a7a13b25b6bc2f3226d1");
}

TEST(absent_names_and_units_hash_as_their_defaults)
{
    static const char *const names[2] = { "ch0", "ch1" };
    struct input_shape plain = { .type = INPUT_BATCH, .samples = 3, .channels = 2, .dt = 0.0125 };
    struct input_shape named = plain;

    named.names = names;
    named.units = "";
    named.attributes = "{\"rig\":7}";
    check_digest(&plain, x, sizeof x,
                 "eefe017cf9e89adf342c3b8e88ad0355bc68e61feca40ba9c5bb6c37e12fbd1e");
    check_digest(&named, x, sizeof x,
                 "eefe017cf9e89adf342c3b8e88ad0355bc68e61feca40ba9c5bb6c37e12fbd1e");
}

TEST(a_scene_has_the_digest_that_the_header_describes)
{
    struct input_shape shape = { .type = INPUT_SCENE, .length = 13 };

    check_digest(&shape, "{\"omega\":1.5}", 13,
                 "16f560f53d147fabbd7d3d61c7b7edadc5449a7a465924c622612502fbec1493");
}

TEST(a_hash_in_pieces_is_the_hash_of_the_whole)
{
    struct input_shape shape = { .type = INPUT_SCENE, .length = 13 };
    struct sha256 hash;
    uint8_t digest[32];
    char hex[65];

    identity_begin(&hash, &shape);
    sha256_add(&hash, "{\"omega", 7);
    sha256_add(&hash, "\":1.5}", 6);
    sha256_end(&hash, digest);
    sha256_hex(digest, hex);
    CHECK_STRING(hex, "16f560f53d147fabbd7d3d61c7b7edadc5449a7a465924c622612502fbec1493");
}

TEST(a_shape_that_overflows_has_no_bytes)
{
    struct input_shape shape = { .type = INPUT_BATCH,
                                 .samples = (uint64_t)1 << 33,
                                 .channels = (uint64_t)1 << 33 };

    CHECK(input_bytes(&shape) == 0);
    shape.channels = 3;
    CHECK(input_bytes(&shape) == (uint64_t)24 << 33);
}
