/* What CURVE hides from who follows the bytes is looked at as it is opened: boxes made by libsodium
 * itself.  The rest of intake.c is tested by tests/fault/test_connections.py. */
#include <dlfcn.h>
#include <stdbool.h>
#include <string.h>
#include <zmq.h>
#include "check.h"

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
