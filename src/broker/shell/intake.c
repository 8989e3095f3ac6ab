/*
 * intake.c - see intake.h: recv as libzmq's I/O thread calls it, crypto_box_open and
 * crypto_box_open_afternm
 *
 * A ROUTER knows a connection by its routing id, which the other end may choose (the property
 * Identity of ZMTP's handshake).  Who chose that of another was then not heard, got what was still
 * meant for one that had gone, or, by ids beginning with a zero byte, met one that libzmq made up
 * itself, which it asserts is impossible (4.3.4, add_out_pipe).  Here the property's name is
 * altered as it comes, "Identity" to "identity", which no mechanism looks at: libzmq then numbers
 * the connection, and no number comes twice.  In NULL's READY it is altered in the bytes received;
 * CURVE's INITIATE is plain only where libzmq has opened its box.  Peers older than ZMTP 3 send it
 * otherwise, and are closed.
 *
 * libzmq hands over whole messages alone, and has no limit for the frames that it keeps until then.
 * So frames are followed: a connection that holds more than messages can (section 8 of PROTOCOL.md)
 * is ended, by an end of file.  In NULL a frame says whether it is its message's last.  CURVE hides
 * that, so that there the count begins anew when the loop takes a message: up to INTAKE_WAITING of
 * them may wait beside the one that comes.  What never reaches the loop are heartbeats:
 * FORGIVEN is what one a second may take.
 *
 * A PING that ends before its time does is answered by libzmq with 16 bytes of its own memory
 * behind it, addresses among them (4.3.4, process_heartbeat_message: the length of what is to be
 * echoed wraps around).  Its connection is ended as well.
 */
#include "broker/shell/intake.h"
#include "broker/shell/accept.h"
#include "wire/protocol.h"
#include <assert.h>
#include <dlfcn.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

/* Bytes of ZMTP 3.1 (RFC 37): the greeting, and where in it is what. */
enum {
    GREETING_SIZE = 64,  /* signature, version, mechanism, as-server, filler */
    MECHANISM = 12,      /* behind the version, two bytes */
    REVISION = 10,       /* the version's first byte */
    SIGNATURE_END = 9,   /* 0xff, eight bytes, 0x7f */
    READY_NAME = 6,      /* "READY" behind its length */
    REVISION_LEAST = 3,  /* before it there were no mechanisms */
};
enum { FRAME_COST = 64 };                       /* of zmq_msg_t, which the smallest frame takes */
enum { FORGIVEN = 256 };                        /* bytes a second */
enum {
    /* what is answered, if by an error */
    MESSAGE_MOST = WIRE_FRAMES_MOST * (WIRE_BODY_MOST + FRAME_COST),
    VALID_MOST = (WIRE_FRAMES_MOST - 3) * WIRE_BODY_MOST + 2 * WIRE_HEADER_MOST,
    WAITING_MOST = INTAKE_WAITING * VALID_MOST + MESSAGE_MOST,
};

/* How a PING begins: its name behind the name's length.  Two bytes of a time follow (RFC 37). */
static const unsigned char ping[] = { 4, 'P', 'I', 'N', 'G' };
enum { PING_LEAST = sizeof ping + 2, NO_PING = 255 };

/* Properties of a handshake: a byte of length, the name, four bytes of length, the value. */
struct properties {
    enum { COMMAND, NAME_LENGTH, NAME, VALUE_LENGTH, VALUE } stage;
    uint32_t left, value;
    unsigned char length;
};

struct intake {
    enum { UNKNOWN, GREETING, FLAGS, LENGTH, BODY, ENDED } stage;
    bool curve, first, more;                    /* first: the handshake's first frame */
    /* of `ping` so far, in a frame that is too short for one; NO_PING: it is none such */
    unsigned char pinged;
    unsigned char have;           /* bytes of the greeting; of the length, those that are missing */
    uint64_t left;                              /* of the frame */
    struct properties properties;
    int64_t seconds;                            /* when heartbeats were last forgiven */
    int64_t held;                               /* bytes of frames, and what frames take */
    atomic_bool taken;          /* by the loop, since the last look; all else is the I/O thread's */
};

static struct intake intakes[CONNECTIONS_TRACKED];
static atomic_long ended;

static int64_t seconds_now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC_COARSE, &t);
    return t.tv_sec;
}

void intake_begin(int fd)
{
    struct intake *in = &intakes[fd];

    memset(in, 0, sizeof *in);
    in->seconds = seconds_now();
    in->properties.left = READY_NAME;
    in->stage = GREETING;
}

void intake_taken(int fd)
{
    if (fd >= 0 && fd < CONNECTIONS_TRACKED)
        atomic_store_explicit(&intakes[fd].taken, true, memory_order_relaxed);
}

long intake_ended(void)
{
    return atomic_load_explicit(&ended, memory_order_relaxed);
}

static void begin_value(struct properties *p)
{
    p->stage = VALUE_LENGTH;
    p->left = 4;
    p->value = 0;
}

/* The next SIZE bytes of P; a name that would be "Identity" becomes another. */
static void hide_identity(struct properties *p, unsigned char *at, size_t size)
{
    for (; size > 0; at++, size--)
        switch (p->stage) {
        case NAME_LENGTH:
            p->length = *at;
            p->left = *at;
            p->stage = NAME;
            if (*at == 0)
                begin_value(p);
            break;
        case NAME:
            if (p->left == p->length && p->length == 8 && *at == 'I')
                *at = 'i';
            if (--p->left == 0)
                begin_value(p);
            break;
        case VALUE_LENGTH:
            p->value = p->value << 8 | *at;
            if (--p->left == 0) {
                p->left = p->value;
                p->stage = p->value > 0 ? VALUE : NAME_LENGTH;
            }
            break;
        default:                                /* COMMAND, VALUE: passed over */
            if (--p->left == 0)
                p->stage = NAME_LENGTH;
        }
}

/* A byte of the greeting; false: of a protocol that is not spoken here. */
static bool greeted(struct intake *in, unsigned char byte)
{
    unsigned char at = in->have++;

    if (at == MECHANISM)
        in->curve = byte == 'C';
    if (in->have == GREETING_SIZE) {
        in->stage = FLAGS;
        in->first = true;
    }
    return at == 0 ? byte == 0xff
         : at == SIGNATURE_END ? (byte & 1) != 0
         : at == REVISION ? byte >= REVISION_LEAST : true;
}

static void end_frame(struct intake *in)
{
    in->first = false;
    in->stage = FLAGS;
    if (!in->curve && !in->more)
        in->held = 0;
}

static void begin_frame(struct intake *in, unsigned char flags)
{
    in->more = (flags & 1) != 0;
    in->pinged = (flags & 4) != 0 ? 0 : NO_PING;
    in->have = (flags & 2) != 0 ? 8 : 1;
    in->left = 0;
    in->stage = LENGTH;
    in->held += FRAME_COST;
}

/* SIZE bytes more of a command that is too short for a PING; false: it is one all the same. */
static bool is_no_ping(struct intake *in, const unsigned char *at, size_t size)
{
    for (; size > 0 && in->pinged < sizeof ping; at++, size--)
        in->pinged = *at == ping[in->pinged] ? in->pinged + 1 : NO_PING;
    return in->pinged != sizeof ping;
}

/* What there is of a frame's body; the bytes used. */
static size_t follow_body(struct intake *in, unsigned char *at, size_t size)
{
    if (size > in->left)
        size = in->left;
    if (in->first && !in->curve)
        hide_identity(&in->properties, at, size);
    in->held += (int64_t)size;
    in->left -= size;
    if (in->left == 0)
        end_frame(in);
    return size;
}

/* A flow of SIZE bytes; false: it must end. */
static bool follow(struct intake *in, unsigned char *at, size_t size)
{
    size_t used;

    for (; size > 0; at += used, size -= used) {
        used = 1;
        if (in->stage == BODY) {
            if (!is_no_ping(in, at, size < in->left ? size : in->left))
                return false;
            used = follow_body(in, at, size);
        } else if (in->stage == FLAGS)
            begin_frame(in, *at);
        else if (in->stage == GREETING) {
            if (!greeted(in, *at))
                return false;
        } else {
            in->left = in->left << 8 | *at;
            if (--in->have == 0) {
                in->stage = BODY;
                if (in->left >= PING_LEAST)
                    in->pinged = NO_PING;
            }
            if (in->have == 0 && in->left == 0)
                end_frame(in);
        }
    }
    return true;
}

static bool within_bounds(struct intake *in)
{
    int64_t now;

    if (!in->curve)
        return in->held <= MESSAGE_MOST;
    if (atomic_load_explicit(&in->taken, memory_order_relaxed)) {
        atomic_store_explicit(&in->taken, false, memory_order_relaxed);
        in->held = 0;
    }
    if (in->held <= WAITING_MOST)
        return true;
    now = seconds_now();
    in->held -= (now - in->seconds) * FORGIVEN;
    in->seconds = now;
    return in->held <= WAITING_MOST;
}

ssize_t recv(int fd, void *buffer, size_t size, int flags)
{
    ssize_t got = syscall(SYS_recvfrom, fd, buffer, size, flags, NULL, NULL);
    struct intake *in = &intakes[fd >= 0 && fd < CONNECTIONS_TRACKED ? fd : 0];

    if (got <= 0 || fd < 0 || fd >= CONNECTIONS_TRACKED || in->stage == UNKNOWN)
        return got;
    if (in->stage != ENDED && follow(in, buffer, (size_t)got) && within_bounds(in))
        return got;
    if (in->stage != ENDED)
        atomic_fetch_add_explicit(&ended, 1, memory_order_relaxed);
    in->stage = ENDED;
    return 0;
}

/* INITIATE's box alone is so long; in it are a key, a voucher, and the properties (ZMTP-CURVE,
 * RFC 26). */
enum {
    BOX_ZEROS = 32,      /* crypto_box_ZEROBYTES, before each plain text */
    VOUCHED = 128,       /* the key, 32, and the voucher, 16 of its nonce and 80 */
};

typedef int box_open(unsigned char *plain, const unsigned char *box, unsigned long long size,
                     const unsigned char *nonce, const unsigned char *public_key,
                     const unsigned char *secret_key);
box_open crypto_box_open;

int crypto_box_open(unsigned char *plain, const unsigned char *box, unsigned long long size,
                    const unsigned char *nonce, const unsigned char *public_key,
                    const unsigned char *secret_key)
{
    static box_open *sodium;
    struct properties properties = { .stage = NAME_LENGTH };
    int rc;

    if (sodium == NULL)
        *(void **)&sodium = dlsym(RTLD_NEXT, "crypto_box_open");
    assert(sodium != NULL);
    rc = sodium(plain, box, size, nonce, public_key, secret_key);
    if (rc == 0 && size > BOX_ZEROS + VOUCHED)
        hide_identity(&properties, plain + BOX_ZEROS + VOUCHED, size - BOX_ZEROS - VOUCHED);
    return rc;
}

enum { INNER_COMMAND = 2 };                     /* of the flags before a MESSAGE's plain text */

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
