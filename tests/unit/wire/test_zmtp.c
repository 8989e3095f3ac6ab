/* Bytes as they come, in whatever pieces; and what CURVE hides from who follows them, looked at as
 * it is opened: boxes made by libsodium itself.  With libzmq around it: tests/fault. */
#include <dlfcn.h>
#include <stdbool.h>
#include <string.h>
#include <zmq.h>
#include "check.h"
#include "wire/zmtp.h"

enum { ZEROS = 32, ROOM = 128, COMMAND = 2 };

typedef int box_fn(unsigned char *out, const unsigned char *in, unsigned long long size,
                   const unsigned char *nonce, const unsigned char *key);
box_fn crypto_box_open_afternm;

static const unsigned char nonce[24] = "a nonce", key[32] = "what both have in common";

/* Is a MESSAGE of FLAGS and the SIZE bytes of TEXT opened? */
static bool is_opened(unsigned char flags, const char *text, size_t size)
{
    unsigned char plain[ROOM] = { 0 }, box[ROOM], seen[ROOM];
    box_fn *close_box = NULL;

    *(void **)&close_box = dlsym(RTLD_DEFAULT, "crypto_box_afternm");
    CHECK(close_box != NULL && ZEROS + 1 + size <= ROOM);
    plain[ZEROS] = flags;
    memcpy(plain + ZEROS + 1, text, size);
    CHECK(close_box(box, plain, ZEROS + 1 + size, nonce, key) == 0);
    if (crypto_box_open_afternm(seen, box, ZEROS + 1 + size, nonce, key) != 0)
        return false;
    return memcmp(seen + ZEROS, plain + ZEROS, 1 + size) == 0;
}

TEST(a_ping_that_is_cut_short_is_not_opened_and_all_else_is)
{
    CHECK(zmq_has("curve") == 1);                /* which brings libsodium */
    CHECK(!is_opened(COMMAND, "\4PING", 5));
    CHECK(!is_opened(COMMAND, "\4PING\0", 6));
    CHECK(is_opened(COMMAND, "\4PING\0\12", 7));
    CHECK(is_opened(COMMAND, "\4PING\0\12echo", 11));
    CHECK(is_opened(COMMAND, "\4PONG", 5));
    CHECK(is_opened(COMMAND, "\4PIN", 4));
    CHECK(is_opened(0, "\4PING", 5));
    CHECK(is_opened(0, "", 0));
}

TEST(what_was_altered_on_its_way_is_not_opened)
{
    unsigned char plain[ROOM] = { 0 }, seen[ROOM];

    CHECK(crypto_box_open_afternm(seen, plain, ZEROS + 7, nonce, key) != 0);
}

static const char greeting[64] = "\xff\0\0\0\0\0\0\0\0\x7f\3\1NULL";

/* SIZE bytes of TEXT in pieces of PIECE at most; how many frames ended. */
static int follow(struct zmtp *z, const char *text, size_t size, size_t piece)
{
    int ended = 0;

    for (size_t at = 0, used; at < size; at += used) {
        int stage = z->stage;
        used = zmtp_next(z, (const unsigned char *)text + at,
                         size - at < piece ? size - at : piece);
        CHECK(used > 0 && used <= size - at);
        ended += stage >= ZMTP_LENGTH && z->stage == ZMTP_FLAGS;
    }
    return ended;
}

TEST(a_ping_that_is_cut_short_is_told_wherever_its_bytes_are_parted_and_nothing_else_is)
{
    static const struct { const char *text; size_t size; bool cut; } frames[] = {
        { "\4\5\4PING", 7, true }, { "\4\6\4PING\0", 8, true }, { "\5\5\4PING", 7, true },
        { "\6\0\0\0\0\0\0\0\5\4PING", 14, true },
        { "\4\7\4PING\0\12", 9, false }, { "\4\5\4PONG", 7, false }, { "\4\4\4PIN", 6, false },
        { "\0\5\4PING", 7, false }, { "\4\6\5\4PING", 8, false }, { "\4\0", 2, false },
    };

    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        for (size_t piece = 1; piece < 20; piece++) {
            struct zmtp z;
            zmtp_begin(&z);
            CHECK(follow(&z, greeting, sizeof greeting, piece) == 0 && z.stage == ZMTP_FLAGS);
            CHECK(follow(&z, "\4\1x\0\3abc", 8, piece) == 2 && !z.cut_ping);
            CHECK(follow(&z, frames[i].text, frames[i].size, piece) == 1);
            CHECK(z.cut_ping == frames[i].cut && !z.strange);
        }
}

TEST(a_greeting_of_before_version_3_is_strange_and_one_of_CURVE_is_known)
{
    char other[sizeof greeting];
    struct zmtp z;

    memcpy(other, greeting, sizeof other);
    memcpy(other + 12, "CURVE", 5);
    zmtp_begin(&z);
    follow(&z, other, sizeof other, 5);
    CHECK(z.curve && !z.strange);
    other[10] = 2;
    zmtp_begin(&z);
    follow(&z, other, sizeof other, 64);
    CHECK(z.strange);
    zmtp_begin(&z);
    follow(&z, "HTTP/1.1", 8, 8);
    CHECK(z.strange);
}
