/* zmtp.c - see zmtp.h; crypto_box_open_afternm as libzmq calls it */
#include "wire/zmtp.h"
#include <assert.h>
#include <dlfcn.h>
#include <string.h>

/* Bytes of ZMTP 3.1 (RFC 37): the greeting, and where in it is what. */
enum {
    GREETING_SIZE = 64,  /* signature, version, mechanism, as-server, filler */
    MECHANISM = 12,      /* behind the version, two bytes */
    REVISION = 10,       /* the version's first byte */
    SIGNATURE_END = 9,   /* 0xff, eight bytes, 0x7f */
    REVISION_LEAST = 3,  /* before it there were no mechanisms */
};
/* A frame's flags. */
enum {
    MORE = 1,            /* of its message there are more */
    LONG = 2,            /* its length has eight bytes */
    COMMAND = 4,         /* it is none of a message */
};

/* How a PING begins: its name behind the name's length.  Two bytes of a time follow. */
static const unsigned char ping[] = { 4, 'P', 'I', 'N', 'G' };
enum { PING_LEAST = sizeof ping + 2, NO_PING = 255 };

void zmtp_begin(struct zmtp *z)
{
    *z = (struct zmtp) { .stage = ZMTP_GREETING };
}

/* A byte of the greeting. */
static void follow_greeting(struct zmtp *z, unsigned char byte)
{
    unsigned char at = z->have++;

    if (at == MECHANISM)
        z->curve = byte == 'C';
    if (z->have == GREETING_SIZE)
        z->stage = ZMTP_FLAGS;
    z->strange |= at == 0 ? byte != 0xff
                : at == SIGNATURE_END ? (byte & 1) == 0
                : at == REVISION && byte < REVISION_LEAST;
}

static void begin_frame(struct zmtp *z, unsigned char flags)
{
    z->more = (flags & MORE) != 0;
    z->command = (flags & COMMAND) != 0;
    z->pinged = z->command ? 0 : NO_PING;
    z->have = (flags & LONG) != 0 ? 8 : 1;
    z->left = 0;
    z->stage = ZMTP_LENGTH;
}

static void follow_length(struct zmtp *z, unsigned char byte)
{
    z->left = z->left << 8 | byte;
    if (--z->have > 0)
        return;
    z->stage = z->left > 0 ? ZMTP_BODY : ZMTP_FLAGS;
    if (z->left >= PING_LEAST)
        z->pinged = NO_PING;
}

static size_t follow_body(struct zmtp *z, const unsigned char *at, size_t size)
{
    if (size > z->left)
        size = (size_t)z->left;
    for (size_t i = 0; i < size && z->pinged < sizeof ping; i++)
        z->pinged = at[i] == ping[z->pinged] ? z->pinged + 1 : NO_PING;
    z->cut_ping |= z->pinged == sizeof ping;
    z->left -= size;
    if (z->left == 0)
        z->stage = ZMTP_FLAGS;
    return size;
}

size_t zmtp_next(struct zmtp *z, const unsigned char *at, size_t size)
{
    switch (z->stage) {
    case ZMTP_GREETING: follow_greeting(z, *at); return 1;
    case ZMTP_FLAGS:    begin_frame(z, *at); return 1;
    case ZMTP_LENGTH:   follow_length(z, *at); return 1;
    case ZMTP_BODY:     return follow_body(z, at, size);
    default:            return size;
    }
}

enum {
    BOX_ZEROS = 32,      /* crypto_box_ZEROBYTES, before each plain text */
    INNER_COMMAND = 2,   /* of the flags before a MESSAGE's */
};

typedef int box_open_afternm(unsigned char *plain, const unsigned char *box,
                             unsigned long long size, const unsigned char *nonce,
                             const unsigned char *key);
box_open_afternm crypto_box_open_afternm;

int crypto_box_open_afternm(unsigned char *plain, const unsigned char *box,
                            unsigned long long size, const unsigned char *nonce,
                            const unsigned char *key)
{
    static box_open_afternm *sodium;
    const unsigned char *flags = plain + BOX_ZEROS;

    if (sodium == NULL)
        *(void **)&sodium = dlsym(RTLD_NEXT, "crypto_box_open_afternm");
    assert(sodium != NULL);
    if (sodium(plain, box, size, nonce, key) != 0)
        return -1;
    if (size > BOX_ZEROS + sizeof ping && size < BOX_ZEROS + 1 + PING_LEAST
        && (*flags & INNER_COMMAND) != 0 && memcmp(flags + 1, ping, sizeof ping) == 0)
        return -1;                              /* as if it were forged */
    return 0;
}
