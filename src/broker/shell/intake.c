/*
 * intake.c - see intake.h: recv as libzmq's I/O thread calls it, and crypto_box_open
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
 * Nor has libzmq a limit for commands, which its one I/O thread does itself: a full pipe stops
 * requests, nothing stops a flood of PINGs, each of which costs an answer, and everybody else waits
 * meanwhile.  So a connection has COMMANDS_MOST at once and as many again each second: heartbeats
 * of a client that was held up for a while, or sends hundreds.  In CURVE a command is a frame that
 * belongs to no message: of frames those are taken off that the messages had which the loop took,
 * and FRAMES_WAITING may be on their way there.
 *
 * Connections are many, and what each may hold is much: of all together HELD_MOST.  Past it those
 * end that hold more than their share of it as they go on, so that who sends little is heard.
 *
 * A PING that is cut short ends its connection as well (zmtp.h).
 */
#include "broker/shell/intake.h"
#include "broker/shell/accept.h"
#include "broker/shell/hold.h"
#include "wire/protocol.h"
#include "wire/zmtp.h"
#include <assert.h>
#include <dlfcn.h>
#include <errno.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

enum { NONE = -1 };                             /* no descriptor */
enum { READY_NAME = 6 };                        /* "READY" behind its length */
enum { FRAME_COST = 64 };                       /* of zmq_msg_t, which the smallest frame takes */
enum { FORGIVEN = 256 };                        /* bytes a second */
enum {
    /* what is answered, if by an error */
    MESSAGE_MOST = WIRE_FRAMES_MOST * (WIRE_BODY_MOST + FRAME_COST),
    VALID_MOST = (WIRE_FRAMES_MOST - 3) * WIRE_BODY_MOST + 2 * WIRE_HEADER_MOST,
    WAITING_MOST = INTAKE_WAITING * VALID_MOST + MESSAGE_MOST,
};

#define HELD_MOST (32LL * MESSAGE_MOST)          /* of all connections: of the longest so many */

enum { BATCH = 8192 };         /* bytes that libzmq reads at once (config.hpp, in_batch_size) */
enum { BOXED_LEAST = 2 + 8 + 8 + 17 };  /* CURVE: flags, length, MESSAGE, number, a byte's box */
enum { FRAMES_WAITING = (INTAKE_WAITING + 1) * WIRE_FRAMES_MOST + BATCH / BOXED_LEAST };
enum { COMMANDS_MOST = 256 };           /* at once, and a second; PROTOCOL.md, section 8 */

/* Properties of a handshake: a byte of length, the name, four bytes of length, the value. */
struct properties {
    enum { COMMAND, NAME_LENGTH, NAME, VALUE_LENGTH, VALUE } stage;
    uint32_t left, value;
    unsigned char length;
};

struct intake {
    struct zmtp zmtp;
    bool ended, first;                          /* first: the handshake's first frame */
    /* not through the handshake yet: in the list of those, in the order in which they came */
    bool silent;
    int older, younger;
    int64_t begun_ms;
    struct properties properties;
    int64_t seconds;                            /* when heartbeats were last forgiven */
    int64_t held;                               /* bytes of frames, and what frames take */
    int64_t commands;                           /* lately; in CURVE of all frames */
    atomic_int taken;           /* messages, by the loop; all else is the I/O thread's */
};

static struct intake intakes[CONNECTIONS_TRACKED];
static atomic_long ended;
/* The I/O thread's: all `held`, when that was last counted, and of how many. */
static int64_t held_in_all, counted, connections;

static int oldest = NONE, youngest = NONE;       /* of those that are silent; the I/O thread's */

static int64_t milliseconds_now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC_COARSE, &t);
    return t.tv_sec * INT64_C(1000) + t.tv_nsec / 1000000;
}

static int64_t seconds_now(void)
{
    return milliseconds_now() / 1000;
}

static void begin_silence(int fd)
{
    struct intake *in = &intakes[fd];

    in->silent = true;
    in->begun_ms = milliseconds_now();
    in->older = youngest;
    in->younger = NONE;
    *(youngest == NONE ? &oldest : &intakes[youngest].younger) = fd;
    youngest = fd;
}

static void end_silence(struct intake *in)
{
    if (!in->silent)
        return;
    in->silent = false;
    *(in->older == NONE ? &oldest : &intakes[in->older].younger) = in->younger;
    *(in->younger == NONE ? &youngest : &intakes[in->younger].older) = in->older;
}

bool intake_silent(int *fd, int64_t *ms)
{
    if (oldest == NONE)
        return false;
    *fd = oldest;
    *ms = milliseconds_now() - intakes[oldest].begun_ms;
    return true;
}

void intake_begin(int fd, bool listed)
{
    struct intake *in = &intakes[fd];

    connections++;
    memset(in, 0, sizeof *in);
    if (listed)
        begin_silence(fd);
    in->seconds = seconds_now();
    in->properties.left = READY_NAME;
    in->first = true;
    zmtp_begin(&in->zmtp);
}

void intake_end(int fd)
{
    connections--;
    end_silence(&intakes[fd]);
    held_in_all -= intakes[fd].held;
    intakes[fd].held = 0;
}

void intake_taken(int fd)
{
    if (fd >= 0 && fd < CONNECTIONS_TRACKED)
        atomic_fetch_add_explicit(&intakes[fd].taken, 1, memory_order_relaxed);
}

void intake_hang_up(int fd)
{
    atomic_fetch_add_explicit(&ended, 1, memory_order_relaxed);
    shutdown(fd, SHUT_RDWR);
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

static void begin_frame(struct intake *in)
{
    in->held += FRAME_COST;
    in->commands += in->zmtp.curve || in->zmtp.command;
}

/* NULL's READY is the only frame of a handshake that comes, CURVE's INITIATE is behind HELLO. */
static void end_frame(struct intake *in)
{
    if (!in->first || !in->zmtp.curve)
        end_silence(in);
    in->first = false;
    if (!in->zmtp.curve && !in->zmtp.more)
        in->held = 0;
}

/* A flow of SIZE bytes; false: it must end. */
static bool follow(struct intake *in, unsigned char *at, size_t size)
{
    struct zmtp *z = &in->zmtp;

    while (size > 0 && !z->strange && !z->cut_ping) {
        int stage = z->stage;
        size_t used = zmtp_next(z, at, size);
        if (stage == ZMTP_FLAGS)
            begin_frame(in);
        if (stage == ZMTP_BODY && in->first && !z->curve)
            hide_identity(&in->properties, at, used);
        if (stage == ZMTP_BODY)
            in->held += (int64_t)used;
        if (stage >= ZMTP_LENGTH && z->stage == ZMTP_FLAGS)
            end_frame(in);
        at += used;
        size -= used;
    }
    return !z->strange && !z->cut_ping;
}

/* COUNT less by what is forgiven. */
static int64_t less(int64_t count, int64_t forgiven)
{
    return count > forgiven ? count - forgiven : 0;
}

static bool within_bounds(struct intake *in)
{
    int64_t now, held_most = in->zmtp.curve ? WAITING_MOST : MESSAGE_MOST,
            commands_most = in->zmtp.curve ? COMMANDS_MOST + FRAMES_WAITING : COMMANDS_MOST;
    int taken = in->zmtp.curve ? atomic_exchange_explicit(&in->taken, 0, memory_order_relaxed) : 0;

    if (taken > 0) {
        in->held = 0;
        in->commands = less(in->commands, (int64_t)taken * WIRE_FRAMES_MOST);
    }
    if (in->held <= held_most && in->commands <= commands_most)
        return true;
    now = seconds_now();
    if (in->zmtp.curve)
        in->held = less(in->held, (now - in->seconds) * FORGIVEN);
    in->commands = less(in->commands, (now - in->seconds) * COMMANDS_MOST);
    in->seconds = now;
    return in->held <= held_most && in->commands <= commands_most;
}

/* What was taken since a connection said something is held no more. */
static void count_held(void)
{
    held_in_all = 0;
    for (int fd = 0; fd < CONNECTIONS_TRACKED; fd++) {
        struct intake *in = &intakes[fd];
        if (atomic_load_explicit(&in->taken, memory_order_relaxed) > 0)
            in->held = 0;
        held_in_all += in->held;
    }
}

/* IN holds more than its share, and all together more than there is. */
static bool is_greedy(const struct intake *in)
{
    if (held_in_all > HELD_MOST && counted != seconds_now()) {
        counted = seconds_now();
        count_held();
    }
    return held_in_all > HELD_MOST && in->held > HELD_MOST / connections;
}

/* SIZE bytes that IN is told; false: it must end. */
static bool take_in(struct intake *in, unsigned char *at, size_t size)
{
    int64_t held = in->held;
    bool good = follow(in, at, size) && within_bounds(in);

    held_in_all += in->held - held;
    return good && !is_greedy(in);
}

ssize_t recv(int fd, void *buffer, size_t size, int flags)
{
    struct intake *in = &intakes[fd >= 0 && fd < CONNECTIONS_TRACKED ? fd : 0];
    ssize_t got;

    if (hold_is(fd)) {
        errno = EAGAIN;
        return -1;
    }
    got = syscall(SYS_recvfrom, fd, buffer, size, flags, NULL, NULL);
    if (got <= 0 || fd < 0 || fd >= CONNECTIONS_TRACKED || in->zmtp.stage == ZMTP_NOTHING)
        return got;
    if (!in->ended && take_in(in, buffer, (size_t)got))
        return got;
    if (!in->ended)
        atomic_fetch_add_explicit(&ended, 1, memory_order_relaxed);
    in->ended = true;
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
