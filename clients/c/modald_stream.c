/* modald_stream.c - see modald_stream.h; needs libzmq and a C11 compiler, nothing else
 *
 *   host's thread                     the sender's thread
 *   push -> ring slots -> take -> frames of equal steps -> window -> daemon
 *                                          |                  ^
 *                                          +-> spill file ----+      when the daemon does not keep up
 *
 * Ring: one writer, one reader; `head` and `tail` count slots since the start.  A slot is its sample's index, its time, and
 * its channels.  The tail moves only when the slot's samples are acknowledged or in the spill file, so that a ring in a file
 * holds, after a kill, whatever the daemon has not.
 *
 * Window: at most WINDOW frames built and not acknowledged.  A frame is sent once a connection, in order, within the
 * daemon's credit; a lost connection makes all of them unsent.  Repeats are harmless: a sample is known by its index.
 *
 * Spilling begins when the ring is half full: the window's frames go to the file first, then everything that is taken, and
 * the window is filled from the file until it is empty again.  So the order is kept.
 *
 * push_at: the samples at k dt between times t_1 <= k dt <= t_2 are those of the cubic through (t_0, t_1, t_2, t_3):
 *     y(t) = sum_j y_j prod_{m != j} (t - t_m) / (t_j - t_m).                                              (1)
 * Its error is estimated by the difference to the quadratic through (t_0, t_1, t_2), which is larger than that of (1) where
 * steps are small against the motion.
 *
 * What a push costs beyond its copy is memory that is not at hand: the first touch of a page, the walk through the tables of
 * pages, and the lines themselves.  So every page is touched at open, in huge ones where there are any, and each push asks
 * for the lines of the slot AHEAD bytes on.  (8 channels: one push in 51 comes to a new page, so the 99th percentile shows
 * each of the three.)
 *
 * The host's process is the host's.  The sender's thread has a table of descriptors of its own, all of libzmq's and the spill
 * file's in it: the host may close every number it finds, run out of them, and count on the next.  It is given no signals, reads no
 * environment and no locale, and a closed stream's handle stays what it is, so that a push after it does nothing.
 *
 * No server ends the host.  libzmq 4.3.4 has two assertions that a peer can reach from outside:
 *   !_io_error   input had stopped (the pipe to us was full, or is being closed), the peer hung up,
 *                and then something is to be written: a heartbeat of our own, or the PONG to a PING
 *                that still lay in the buffer when input went on.
 *   !_more       the pipe was taken away between two frames of a message.
 * So input never stops (ZMQ_RCVHWM 0), and no heartbeat is ours: the kernel's keepalive, and a
 * question that stays unanswered, find a connection that is dead.  The pipe is never taken away (no
 * ZMQ_IMMEDIATE): a connection that is lost ends its socket instead, and the next has one of its
 * own.  What bounds the memory is here, too: a server that says more than we take is hung up on.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE          /* where the host's build does not say it */
#endif
#include "modald_stream.h"
#include <errno.h>
#include <fcntl.h>
#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>

enum {
    CHANNELS_MOST = 65536,
    FRAME_BYTES = 131072,            /* of a push; at least one sample */
    WINDOW = 64,                     /* frames in flight; their memory is touched as far as it is used */
    HEADER_MOST = 65536,
    RING_HEAD = 4096,                /* of a ring in a file */
    HISTORY = 4,                     /* points of (1) */
    LINE = 64, PAGE = 4096, HUGE_PAGE = 2097152,
    AHEAD = 2048, AHEAD_MOST = 1024, /* bytes: how far before its slot a push reads on, and how much of a large one */
    DESCRIPTORS = 32,                /* that libzmq may need: it ends the process where it gets none */
    NARROW_MOST = 64,                /* channels copied one by one */
    CLOSED_KEPT = 256,               /* handles */
    HEARD_MOST = 1048576,            /* bytes of a frame that comes: proto/PROTOCOL.md, section 2 */
    BACKLOG_MOST = 4194304,          /* bytes in a turn; kernel and daemon keep less: 64 messages */
    MESSAGE_COST = 64,               /* of a frame in libzmq's pipe, beside its bytes */
    SENDER_STACK = 262144,
};
static const char version[] = "MODALD1";
/* Seconds between links; doubled until one is good. */
static const double pause_least = 0.05, pause_most = 1;
static const double answer_patience = 10;                /* s: then the link is as good as lost */
static const char spill_magic[8] = "MDSPILL1", ring_magic[8] = "MDRING01";

/* ------------------------------------------------------------------ CRC-32C */

static uint32_t crc_table[8][256];
static pthread_once_t crc_once = PTHREAD_ONCE_INIT;

static void crc_fill(void)
{
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t c = i;
        for (int bit = 0; bit < 8; bit++)
            c = c & 1 ? c >> 1 ^ 0x82f63b78u : c >> 1;
        crc_table[0][i] = c;
    }
    for (uint32_t i = 0; i < 256; i++)
        for (int k = 1; k < 8; k++)
            crc_table[k][i] = crc_table[k - 1][i] >> 8 ^ crc_table[0][crc_table[k - 1][i] & 255];
}

/* Eight bytes a turn (slicing by 8). */
static uint32_t crc_by_table(uint32_t c, const unsigned char *p, size_t length)
{
    pthread_once(&crc_once, crc_fill);
    for (; length >= 8; length -= 8, p += 8) {
        uint32_t a, b;
        memcpy(&a, p, 4);
        memcpy(&b, p + 4, 4);
        a ^= c;
        c = crc_table[7][a & 255] ^ crc_table[6][a >> 8 & 255] ^ crc_table[5][a >> 16 & 255] ^ crc_table[4][a >> 24]
          ^ crc_table[3][b & 255] ^ crc_table[2][b >> 8 & 255] ^ crc_table[1][b >> 16 & 255] ^ crc_table[0][b >> 24];
    }
    while (length-- > 0)
        c = c >> 8 ^ crc_table[0][(c ^ *p++) & 255];
    return c;
}

#if defined(__x86_64__)
enum { LANE = 4096 };                        /* bytes */
#define LANE_POWER 0x35d73a62u               /* x^(8 LANE) modulo the polynomial, bits reflected */

/* a b modulo the polynomial */
static uint32_t crc_product(uint32_t a, uint32_t b)
{
    uint32_t sum = 0;

    for (; a != 0; a <<= 1) {
        sum ^= a & 0x80000000u ? b : 0;
        b = b & 1 ? b >> 1 ^ 0x82f63b78u : b >> 1;
    }
    return sum;
}

/* The processor's own instruction takes three cycles for eight bytes, and three may be under way: three lanes, put together by (r x^n + next) x^n + third. */
__attribute__((target("sse4.2"))) static uint32_t crc_by_instruction(uint32_t c, const unsigned char *p, size_t length)
{
    uint64_t sum = c, next, third, words[3];

    for (; length >= 3 * LANE; length -= 3 * LANE, p += 2 * LANE) {
        next = third = 0;
        for (int i = 0; i < LANE; i += 8, p += 8) {
            memcpy(words, p, 8);
            memcpy(words + 1, p + LANE, 8);
            memcpy(words + 2, p + 2 * LANE, 8);
            sum = __builtin_ia32_crc32di(sum, words[0]);
            next = __builtin_ia32_crc32di(next, words[1]);
            third = __builtin_ia32_crc32di(third, words[2]);
        }
        sum = crc_product(LANE_POWER, crc_product(LANE_POWER, (uint32_t)sum) ^ (uint32_t)next) ^ third;
    }
    for (; length >= 8; length -= 8, p += 8) {
        memcpy(words, p, 8);
        sum = __builtin_ia32_crc32di(sum, words[0]);
    }
    for (c = (uint32_t)sum; length > 0; length--)
        c = __builtin_ia32_crc32qi(c, *p++);
    return c;
}
#endif

static uint32_t crc32c(const void *data, size_t length)
{
#if defined(__x86_64__)
    if (__builtin_cpu_supports("sse4.2"))
        return ~crc_by_instruction(~0u, data, length);
#endif
    return ~crc_by_table(~0u, data, length);
}

/* ------------------------------------------------------------------ types */

/* A ring's head page: in memory, or the first page of its file. */
struct ring_page {
    char magic[8];
    uint64_t channels, slots;
    double dt;
    char name[256];
    _Alignas(64) _Atomic uint64_t head;      /* written by the host only */
    _Alignas(64) _Atomic uint64_t tail;      /* written by the sender only */
};

struct frame {
    uint64_t first, count;
    double *data;                            /* of a loan: FRAME_BYTES, or one sample */
    uint32_t crc;                            /* CRC-32C of the samples, once it is built */
    uint64_t ring_end;                       /* the tail once it is acknowledged; 0: it came from the spill file */
    uint64_t file_end;                       /* the spill's offset once it is acknowledged */
    int64_t id;                              /* of the message; 0: not sent */
    bool acknowledged;
};

/* Samples of a frame: libzmq is lent them instead of taking a copy, and gives them back from a thread of its own. */
struct loan { atomic_uint holders; _Alignas(64) double data[]; };       /* holders: the frame, and messages */

struct spill_head { uint64_t first, count; uint32_t crc, zero; };

struct point { double t; double *y; };

enum { KEYS = 3, KEY_SIGNS = 40 };

struct modald_stream {
    /* written at open only: both threads have this line */
    _Alignas(LINE) struct ring_page *page;
    double *ring;
    uint64_t slots;
    size_t stride;                           /* doubles of a slot: index, time, channels */
    unsigned forks;                          /* of the process, when it was opened; CLOSED */
    int channels;
    double dt;

    /* the host's: nobody else reads it */
    _Alignas(LINE) uint64_t head;
    uint64_t tail_seen, index, cursor;       /* cursor: head modulo slots */

    /* both */
    _Alignas(LINE) _Atomic uint64_t dropped;
    _Atomic int verdict, stop;               /* stop: 1 close, 2 broken off */
    _Atomic bool finished, refused;
    _Atomic uint64_t acknowledged;
    _Atomic uint64_t spilled;
    _Atomic unsigned estimate_version;       /* odd while it is written */
    _Atomic unsigned estimate_past;          /* the version that is of an epoch before; 0: none was */
    struct modald_estimate estimate;
    double resampling_error;
    char name[256], *names, *units, *options, *alarms, *url, *keyfile, *run;      /* run: attributes of the run, JSON */
    char spill_folder[400];
    double period, close_wait;
    long window_samples, window_hop;
    size_t ring_bytes;
    int ring_fd;                             /* of a ring in a file: holds its lock; else -1 */
    bool own_descriptors;
    pthread_t thread;
    sem_t begun;                             /* the sender has a table of its own */

    /* the sender's */
    void *context, *socket, *monitor;        /* socket NULL: between two links */
    char keys[KEYS][KEY_SIGNS + 1];          /* "": none */
    unsigned links;                          /* begun so far */
    bool ready, lost, opened, opening, closing, closed;
    double begin_at, pause;                  /* when the next link begins; after which pause */
    double quiet_until;                      /* nothing is asked before: the daemon said so */
    int64_t next_id, first_id;               /* first_id: what was asked before counts no more */
    int64_t open_id, close_id;
    double asked_at;
    char stream[128];
    uint64_t epoch, went_on;                 /* went_on: the index behind the last sample acknowledged */
    size_t credit, flying;
    struct frame window[WINDOW], build;
    int first_frame, frames;                 /* the window is a ring of its own */
    uint64_t taken;                          /* slots put into frames */
    double build_since;
    size_t frame_samples;
    struct point history[HISTORY];
    int points;
    uint64_t next_grid;
    double *rms, *sample;                    /* channels each: mean square so far; one resampled sample */
    uint64_t rms_count;
    int spill_fd;
    uint64_t spill_end, spill_read, spill_acknowledged, spill_most, spill_start;
    uint64_t damaged, torn;                  /* samples of records passed over; bytes of what was being written */
    char spill_path[512];
    bool spill_failed, told, seal;           /* seal: the stream is to be closed at the end */
    char *open_text;                         /* of a replay: the members of `open` as they were */
    int64_t events_id;
};

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void rest(double seconds)
{
    struct timespec t = { (time_t)seconds, (long)(1e9 * (seconds - floor(seconds))) };

    nanosleep(&t, NULL);
}

/* A child of the host has a copy of each stream, but no thread to send, and of a ring in a file the very same: there its streams do nothing.  Nor does
 * one that is closed. */
enum { CLOSED = 0x7fffffff };
static atomic_uint forks;
static pthread_once_t fork_once = PTHREAD_ONCE_INIT;

static void count_fork(void)
{
    atomic_fetch_add_explicit(&forks, 1, memory_order_relaxed);
}

static void watch_forks(void)
{
    pthread_atfork(NULL, NULL, count_fork);
}

static inline bool is_dead(const modald_stream *s)
{
    return s->forks != atomic_load_explicit(&forks, memory_order_relaxed);
}

/* One line on stderr: no lock of stdio's is taken, and where nobody reads it the signal is not the host's. */
static void tell(const char *name, const char *what)
{
    char text[1024];
    sigset_t pipe, before, pending;
    int n = snprintf(text, sizeof text, "modald: %s%s%s%.700s\n", name ? "stream " : "", name ? name : "", name ? ": " : "", what);

    for (int i = 0; i < n - 1; i++)                     /* a server's words, too */
        text[i] = (unsigned char)text[i] < 0x20 || text[i] == 0x7f ? '?' : text[i];
    sigemptyset(&pipe);
    sigaddset(&pipe, SIGPIPE);
    sigpending(&pending);
    pthread_sigmask(SIG_BLOCK, &pipe, &before);
    if (write(2, text, (size_t)n) < 0 && errno == EPIPE && !sigismember(&pending, SIGPIPE))
        sigtimedwait(&pipe, NULL, &(struct timespec) { 0, 0 });
    pthread_sigmask(SIG_SETMASK, &before, NULL);
}

/* The same, once a stream. */
static void say(modald_stream *s, const char *what)
{
    if (!s->told)
        tell(s->name, what);
    s->told = true;
}

/* ------------------------------------------------------------------ samples lent to libzmq */

static double *loan_new(size_t bytes)
{
    struct loan *loan = aligned_alloc(64, (sizeof *loan + bytes + 63) / 64 * 64);

    if (loan == NULL)
        return NULL;
    atomic_init(&loan->holders, 1);
    return loan->data;
}

static struct loan *loan_of(double *data)
{
    return (struct loan *)((char *)data - offsetof(struct loan, data));
}

static void loan_drop(double *data)
{
    if (data != NULL && atomic_fetch_sub_explicit(&loan_of(data)->holders, 1, memory_order_acq_rel) == 1)
        free(loan_of(data));
}

static void give_back(void *data, void *hint)
{
    (void)hint;
    loan_drop(data);
}

/* Room of BYTES that may be written: *DATA, or in its place other room while a message of an old connection still has that.  False: no memory. */
static bool loan_own(double **data, size_t bytes)
{
    double *other;

    if (atomic_load_explicit(&loan_of(*data)->holders, memory_order_acquire) == 1)
        return true;
    other = loan_new(bytes);
    if (other == NULL)
        return false;
    loan_drop(*data);
    *data = other;
    return true;
}

/* ------------------------------------------------------------------ the host's calls */

/* Room for one slot, or NULL: full, the sample is counted as a gap; or not ours. */
static inline double *room(modald_stream *s)
{
    if (is_dead(s))
        return NULL;
    if (s->head - s->tail_seen >= s->slots) {
        s->tail_seen = atomic_load_explicit(&s->page->tail, memory_order_acquire);
        if (s->head - s->tail_seen >= s->slots) {
            atomic_fetch_add_explicit(&s->dropped, 1, memory_order_relaxed);
            s->index++;
            return NULL;
        }
    }
    return s->ring + s->cursor * s->stride;
}

static inline void publish(modald_stream *s, double *at, double t)
{
    uint64_t index = s->index++;

    memcpy(at, &index, sizeof index);
    at[1] = t;
    s->cursor = s->cursor + 1 < s->slots ? s->cursor + 1 : 0;
    atomic_store_explicit(&s->page->head, ++s->head, memory_order_release);
    size_t length = s->stride * sizeof *at < AHEAD_MOST ? s->stride * sizeof *at : AHEAD_MOST;
    for (size_t i = 0; i < length; i += LINE)           /* beyond the ring's end it is harmless */
        __builtin_prefetch((const char *)at + AHEAD + i, 1);
}

/* Few values one by one: each comes straight from the host's own store, made a moment ago.  A wider load over several of those has to wait until they are in
 * the cache, and whatever the host computed them from before that: 100 ns of a step of 1 us.  (Volatile, so that no compiler makes a memcpy of it.) */
static inline void copy(double *to, const double *y, int channels)
{
    if (channels > NARROW_MOST) {
        memcpy(to, y, (size_t)channels * sizeof *y);
        return;
    }
    for (int i = 0; i < channels; i++)
        *(volatile double *)(to + i) = y[i];
}

void modald_push(modald_stream *s, const double *y)
{
    double *at;

    if (s == NULL || (at = room(s)) == NULL)
        return;
    copy(at + 2, y, s->channels);
    publish(s, at, NAN);
}

void modald_push_block(modald_stream *s, const double *y, size_t count)
{
    for (; s != NULL && count > 0; count--, y += s->channels)
        modald_push(s, y);
}

void modald_push_float(modald_stream *s, const float *y)
{
    double *at;

    if (s == NULL || (at = room(s)) == NULL)
        return;
    for (int i = 0; i < s->channels; i++)
        *(volatile double *)(at + 2 + i) = y[i];
    publish(s, at, NAN);
}

void modald_push_at(modald_stream *s, double t, const double *y)
{
    double *at;

    if (s == NULL || !isfinite(t) || (at = room(s)) == NULL)
        return;
    copy(at + 2, y, s->channels);
    publish(s, at, t);
}

void modald_seek(modald_stream *s, double index)
{
    if (s != NULL && !is_dead(s) && index >= 0 && index < 9007199254740992.0)
        s->index = (uint64_t)index;
}

int modald_verdict(const modald_stream *s)
{
    return s == NULL || is_dead(s) ? MODALD_UNKNOWN : atomic_load_explicit(&s->verdict, memory_order_relaxed);
}

int modald_get_estimate(const modald_stream *s, struct modald_estimate *out)
{
    for (int tries = 0; s != NULL && !is_dead(s) && tries < 1000; tries++) {
        unsigned before = atomic_load_explicit(&s->estimate_version, memory_order_acquire);
        if (before == atomic_load_explicit(&s->estimate_past, memory_order_relaxed))
            return 0;
        *out = s->estimate;
        atomic_thread_fence(memory_order_acquire);
        if (before % 2 == 0 && atomic_load_explicit(&s->estimate_version, memory_order_relaxed) == before)
            return 1;
    }
    return 0;
}

void modald_get_report(const modald_stream *s, struct modald_report *out)
{
    memset(out, 0, sizeof *out);
    if (s == NULL || is_dead(s))
        return;
    out->pushed = (double)s->head;
    out->dropped = (double)atomic_load(&s->dropped);
    out->acknowledged = (double)atomic_load(&s->acknowledged);
    out->waiting = (double)(s->head - atomic_load(&s->page->tail));
    out->spilled = (double)atomic_load(&s->spilled);
    out->resampling_error = s->resampling_error;
    out->refused = atomic_load(&s->refused);
}

/* ------------------------------------------------------------------ text */

/* Append, never past SIZE; too long a text ends short and is refused by the daemon. */
static void add(char *text, size_t size, const char *format, ...) __attribute__((format(printf, 3, 4)));
static void add(char *text, size_t size, const char *format, ...)
{
    size_t used = strlen(text);
    va_list args;

    va_start(args, format);
    if (used < size)
        vsnprintf(text + used, size - used, format, args);
    va_end(args);
}

static void add_string(char *text, size_t size, const char *string)
{
    add(text, size, "\"");
    for (const unsigned char *p = (const unsigned char *)string; *p != 0; p++)
        if (*p == '"' || *p == '\\')
            add(text, size, "\\%c", *p);
        else if (*p < 0x20)
            add(text, size, "\\u%04x", *p);
        else
            add(text, size, "%c", *p);
    add(text, size, "\"");
}

/* JSON is read where it lies, up to its 0.  A P below is where a value begins; NULL: there is none,
 * and none is in it. */

static const char *skip_space(const char *p)
{
    return p + strspn(p, " \t\r\n");
}

/* Behind the string at P; NULL: it does not end. */
static const char *skip_string(const char *p)
{
    for (p++; *p != '"'; p++)
        if (*p == 0 || (*p == '\\' && *++p == 0))
            return NULL;
    return p + 1;
}

/* Behind the value at P; NULL: it does not end.  Brackets are counted: none are too many. */
static const char *skip_value(const char *p)
{
    static const char marks[] = "\"{}[],: \t\r\n";
    size_t depth = 0, length;

    do {
        length = strcspn(p, marks);
        if (length == 0 && (*p == 0 || (depth == 0 && strchr("}],: \t\r\n", *p) != NULL)))
            return NULL;
        depth += *p == '{' || *p == '[';
        depth -= *p == '}' || *p == ']';
        p = *p == '"' ? skip_string(p) : p + (length > 0 ? length : 1);
    } while (p != NULL && depth > 0);
    return p;
}

/* The value of KEY, which is written as it is, in the object at P. */
static const char *member(const char *p, const char *key)
{
    size_t length = strlen(key);

    if (p == NULL || *p != '{')
        return NULL;
    for (p = skip_space(p + 1); *p == '"'; p = skip_space(p + 1)) {
        const char *name = p + 1, *end = skip_string(p);
        if (end == NULL || *(p = skip_space(end)) != ':')
            return NULL;
        p = skip_space(p + 1);
        if ((size_t)(end - 1 - name) == length && memcmp(name, key, length) == 0)
            return p;
        p = skip_value(p);
        if (p == NULL || *(p = skip_space(p)) != ',')
            return NULL;
    }
    return NULL;
}

static const char *first_element(const char *p)
{
    p = p != NULL && *p == '[' ? skip_space(p + 1) : NULL;
    return p != NULL && *p != ']' ? p : NULL;
}

/* The element behind the one at P. */
static const char *next_element(const char *p)
{
    p = skip_value(p);
    p = p != NULL ? skip_space(p) : NULL;
    return p != NULL && *p == ',' ? skip_space(p + 1) : NULL;
}

/* The number at P; OTHERWISE where there is none that a double holds. */
static double number_at(const char *p, double otherwise)
{
    size_t length = p != NULL ? strcspn(p, ",]} \t\r\n") : 0;
    double value;
    char *end;

    if (length == 0 || strspn(p, "0123456789+-.eE") < length
        || (*p != '-' && (*p < '0' || *p > '9')))
        return otherwise;                               /* strtod also knows nan, infinity, 0x1p4 */
    value = strtod(p, &end);
    return end == p + length && isfinite(value) ? value : otherwise;
}

/* The same for a count of things. */
static uint64_t count_at(const char *p, uint64_t otherwise)
{
    double value = number_at(p, -1);
    bool good = value >= 0 && value <= 9007199254740992.0 && value == floor(value);

    return good ? (uint64_t)value : otherwise;
}

/* Is it the string TEXT, which JSON writes as it is? */
static bool is_text(const char *p, const char *text)
{
    size_t length = strlen(text);

    return p != NULL && *p == '"' && strncmp(p + 1, text, length) == 0 && p[1 + length] == '"';
}

/* What add_string made of a string of fewer than SIZE bytes, into OUT; false, and OUT is "": it is
 * no such string. */
static bool read_string(const char *p, char *out, size_t size)
{
    size_t used = 0;
    unsigned code;

    out[0] = 0;
    if (p == NULL || *p != '"')
        return false;
    for (p++; *p != '"' && *p != 0 && used + 1 < size; p++)
        if (*p != '\\')
            out[used++] = *p;
        else if (p[1] == '"' || p[1] == '\\')
            out[used++] = *++p;
        else if (strspn(p + 1, "u0123456789abcdefABCDEF") >= 5
                 && sscanf(p + 1, "u00%2x", &code) == 1 && code > 0 && code < 0x20)
            out[used++] = (char)code, p += 5;
        else
            break;
    out[*p == '"' ? used : 0] = 0;
    return *p == '"';
}

/* ------------------------------------------------------------------ spill file */

static bool write_all(int fd, const void *data, size_t length, uint64_t at)
{
    const char *p = data;

    while (length > 0) {
        ssize_t n = pwrite(fd, p, length, (off_t)at);
        if (n <= 0 && errno != EINTR)
            return false;
        p += n > 0 ? n : 0;
        at += n > 0 ? (uint64_t)n : 0;
        length -= n > 0 ? (size_t)n : 0;
    }
    return true;
}

static void open_header(modald_stream *s, char *text, size_t size);

enum { SPILL_NAMES = 10000 };

/* A file that was not there: FOLDER/modald-NAME-PID.spill, or PID-2, -3, ...  What is there may hold samples that were never sent: of an earlier stream of
 * that name, or of another life of that PID, which in a container is the same every time. */
static void spill_create(modald_stream *s)
{
    char clean[64] = "", number[16] = "";

    for (size_t i = 0; s->name[i] != 0 && i < sizeof clean - 1; i++)
        clean[i] = strchr("/ .", s->name[i]) ? '_' : s->name[i];
    for (int n = 2; n < SPILL_NAMES; n++) {
        snprintf(s->spill_path, sizeof s->spill_path, "%s/modald-%s-%d%s.spill", s->spill_folder, clean, (int)getpid(), number);
        s->spill_fd = open(s->spill_path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
        if (s->spill_fd >= 0)
            flock(s->spill_fd, LOCK_EX | LOCK_NB);      /* a replay leaves it alone until it is ours no more */
        if (s->spill_fd >= 0 || errno != EEXIST)
            return;
        snprintf(number, sizeof number, "-%d", n);
    }
}

/* Its head is the open message. */
static bool spill_open(modald_stream *s)
{
    char *head;
    uint32_t length;
    bool good;

    if (s->spill_fd >= 0 || s->spill_most == 0)
        return s->spill_fd >= 0;
    spill_create(s);
    head = calloc(1, HEADER_MOST);
    if (s->spill_fd < 0 || head == NULL) {
        free(head);
        return false;
    }
    open_header(s, head, HEADER_MOST);
    length = (uint32_t)strlen(head);
    s->spill_start = s->spill_end = s->spill_read = s->spill_acknowledged = sizeof spill_magic + sizeof length + length;
    good = write_all(s->spill_fd, spill_magic, sizeof spill_magic, 0) && write_all(s->spill_fd, &length, sizeof length, sizeof spill_magic)
        && write_all(s->spill_fd, head, length, sizeof spill_magic + sizeof length);
    free(head);
    if (!good) {
        close(s->spill_fd);
        unlink(s->spill_path);
        s->spill_fd = -1;
    }
    return good;
}

/* Append F; false: the disk or the limit is full. */
static bool spill_write(modald_stream *s, struct frame *f)
{
    size_t length = f->count * (size_t)s->channels * sizeof(double);
    struct spill_head head = { f->first, f->count, f->crc, 0 };

    if (!spill_open(s) || s->spill_end + sizeof head + length > s->spill_most
        || !write_all(s->spill_fd, f->data, length, s->spill_end + sizeof head) || !write_all(s->spill_fd, &head, sizeof head, s->spill_end)) {
        char text[600];
        snprintf(text, sizeof text, "%s %s; samples past the ring are counted as a gap", s->spill_fd < 0 ? "no spill file can be made in" : "there is no more room for",
                 s->spill_fd < 0 ? s->spill_folder : s->spill_path);
        if (!s->spill_failed && s->spill_most > 0)
            say(s, text);
        s->spill_failed = true;
        return false;
    }
    s->spill_end += sizeof head + length;
    f->file_end = s->spill_end;
    atomic_fetch_add_explicit(&s->spilled, f->count, memory_order_relaxed);
    return true;
}

static size_t frame_bytes(const modald_stream *s)
{
    return s->frame_samples * (size_t)s->channels * sizeof(double);
}

static struct frame *frame_at(modald_stream *s, int i)
{
    return &s->window[(s->first_frame + i) % WINDOW];
}

/* Whether the record of HEAD may be what it says: it lies in the file, and in its order. */
static bool is_record(const modald_stream *s, const struct spill_head *head)
{
    return head->count > 0 && head->count <= s->frame_samples && s->spill_read + sizeof *head + head->count * (size_t)s->channels * sizeof(double) <= s->spill_end;
}

/* A record whose samples are not what was written is passed over: the record on the daemon's side shows the gap. */
static void spill_skip(modald_stream *s, const struct spill_head *head)
{
    s->spill_read += sizeof *head + head->count * (size_t)s->channels * sizeof(double);
    s->damaged += head->count;
    atomic_fetch_add_explicit(&s->dropped, head->count, memory_order_relaxed);
    if (s->frames > 0)
        frame_at(s, s->frames - 1)->file_end = s->spill_read;
    else
        s->spill_acknowledged = s->spill_read;
}

/* The next frame of the file into F; false: no more.  What a killed host was writing is torn, and the file ends before it. */
static bool spill_next(modald_stream *s, struct frame *f)
{
    struct spill_head head;
    size_t length;

    if (!loan_own(&f->data, frame_bytes(s)))
        return false;
    for (;;) {
        if (s->spill_read >= s->spill_end)
            return false;
        if (pread(s->spill_fd, &head, sizeof head, (off_t)s->spill_read) != (ssize_t)sizeof head || !is_record(s, &head)) {
            s->torn += s->spill_end - s->spill_read;
            s->spill_end = s->spill_read;
            return false;
        }
        length = head.count * (size_t)s->channels * sizeof(double);
        if (pread(s->spill_fd, f->data, length, (off_t)(s->spill_read + sizeof head)) == (ssize_t)length && crc32c(f->data, length) == head.crc)
            break;
        spill_skip(s, &head);
    }
    s->spill_read += sizeof head + length;
    f->first = head.first;
    f->count = head.count;
    f->crc = head.crc;
    f->ring_end = 0;
    f->file_end = s->spill_read;
    f->id = 0;
    f->acknowledged = false;
    return true;
}

static bool spilling(const modald_stream *s)
{
    return s->spill_fd >= 0 && s->spill_acknowledged < s->spill_end;
}

/* Everything in the file is acknowledged: begin it anew. */
static void spill_drained(modald_stream *s)
{
    if (s->spill_fd < 0 || spilling(s) || s->spill_end == s->spill_start || s->spill_most == 0)
        return;                                         /* a replay leaves its file as it was */
    if (ftruncate(s->spill_fd, (off_t)s->spill_start) == 0)
        s->spill_end = s->spill_read = s->spill_acknowledged = s->spill_start;
    s->spill_failed = false;
}

/* ------------------------------------------------------------------ from slots to frames */

static void release(modald_stream *s, uint64_t tail)
{
    if (tail > atomic_load_explicit(&s->page->tail, memory_order_relaxed))
        atomic_store_explicit(&s->page->tail, tail, memory_order_release);
}

/* The frame being built into the window, or, while spilling, into the file; false: no room for it now. */
static bool finish_build(modald_stream *s)
{
    if (s->build.count == 0)
        return true;
    if (!spilling(s) && s->frames == WINDOW)
        return false;
    s->build.crc = crc32c(s->build.data, s->build.count * (size_t)s->channels * sizeof(double));
    s->build.ring_end = s->taken;
    s->build.id = 0;
    s->build.acknowledged = false;
    if (spilling(s)) {
        if (!spill_write(s, &s->build))
            return false;
        release(s, s->taken);
    } else {
        struct frame *f = frame_at(s, s->frames++);
        double *data = f->data;
        *f = s->build;
        s->build.data = data;
    }
    s->build.count = 0;
    return true;
}

/* One sample of equal steps into the frame being built; false: no room, nothing was changed. */
static bool add_sample(modald_stream *s, uint64_t index, const double *y)
{
    bool fits = s->build.count > 0 && index == s->build.first + s->build.count && s->build.count < s->frame_samples;

    if (!fits) {
        if (!finish_build(s) || !loan_own(&s->build.data, frame_bytes(s)))
            return false;
        s->build.first = index;
        s->build_since = now();
    }
    memcpy(s->build.data + s->build.count++ * (size_t)s->channels, y, (size_t)s->channels * sizeof *y);
    return true;
}

/* (1) at T through the first N of the history. */
static double interpolate(const modald_stream *s, int n, int channel, double t)
{
    double sum = 0;

    for (int j = 0; j < n; j++) {
        double w = 1;
        for (int m = 0; m < n; m++)
            if (m != j)
                w *= (t - s->history[m].t) / (s->history[j].t - s->history[m].t);
        sum += w * s->history[j].y[channel];
    }
    return sum;
}

static void resample_at(modald_stream *s, double t)
{
    for (int c = 0; c < s->channels; c++) {
        double y = interpolate(s, s->points, c, t), coarse = interpolate(s, s->points > 2 ? s->points - 1 : s->points, c, t);
        s->sample[c] = y;
        s->rms[c] += (y * y - s->rms[c]) / (double)(s->rms_count + 1);
        double error = fabs(y - coarse) / sqrt(s->rms[c] > 0 ? s->rms[c] : 1);
        if (s->rms_count > 8 && error > s->resampling_error)
            s->resampling_error = error;
    }
    s->rms_count++;
}

/* The grid's samples up to UNTIL from the history; false: no room, asked again later. */
static bool resample(modald_stream *s, double until)
{
    double slack = 1e-9 * s->dt;

    while ((double)s->next_grid * s->dt <= until + slack) {
        resample_at(s, (double)s->next_grid * s->dt);
        if (!add_sample(s, s->next_grid, s->sample))
            return false;
        s->next_grid++;
    }
    return true;
}

static void remember(modald_stream *s, double t, const double *y)
{
    if (s->points == HISTORY) {
        struct point oldest = s->history[0];
        memmove(s->history, s->history + 1, (HISTORY - 1) * sizeof *s->history);
        s->history[HISTORY - 1] = oldest;
        s->points--;
    }
    s->history[s->points].t = t;
    memcpy(s->history[s->points++].y, y, (size_t)s->channels * sizeof *y);
}

/* A sample at time T of its own.  The grid is filled up to the last but one point, so that (1) has a point beyond. */
static bool add_uneven(modald_stream *s, double t, const double *y)
{
    if (s->points > 0 && t <= s->history[s->points - 1].t) {       /* a repeat, or back in time: begin anew */
        if (s->points > 1 && !resample(s, s->history[s->points - 1].t))
            return false;
        s->points = 0;
    }
    if (s->points == 0)
        s->next_grid = (uint64_t)fmax(0, ceil(t / s->dt - 1e-9));
    if (s->points == HISTORY && !resample(s, s->history[HISTORY - 2].t))
        return false;
    remember(s, t, y);
    return true;
}

/* Slots into frames while there is room. */
static void take(modald_stream *s)
{
    uint64_t head = atomic_load_explicit(&s->page->head, memory_order_acquire);

    while (s->taken < head) {
        const double *at = s->ring + s->taken % s->slots * s->stride;
        uint64_t index;
        memcpy(&index, at, sizeof index);
        if (!(isnan(at[1]) ? add_sample(s, index, at + 2) : add_uneven(s, at[1], at + 2)))
            return;
        s->taken++;
    }
}

/* The ring is half full: the daemon does not keep up, and from now on everything goes through the file. */
static void spill_if_needed(modald_stream *s, bool all)
{
    uint64_t waiting = atomic_load_explicit(&s->page->head, memory_order_acquire) - atomic_load_explicit(&s->page->tail, memory_order_relaxed);

    if (spilling(s) || s->spill_most == 0 || s->frames == 0 || s->spill_failed || (!all && waiting < s->slots / 2))
        return;
    for (int i = 0; i < s->frames; i++) {
        struct frame *f = frame_at(s, i);
        if (!spill_write(s, f))
            return;
        release(s, f->ring_end);
        f->ring_end = 0;
    }
    s->spill_read = s->spill_end;
}

static void fill_window(modald_stream *s)
{
    while (s->frames < WINDOW && s->spill_fd >= 0 && spill_next(s, frame_at(s, s->frames)))
        s->frames++;
}

/* ------------------------------------------------------------------ messages */

static void add_attribute(char *text, size_t size, const char *key, const char *value, bool *first)
{
    if (value == NULL || *value == 0)
        return;
    add(text, size, "%s\"%s\":", *first ? "" : ",", key);
    add_string(text, size, value);
    *first = false;
}

/* Which run a stream comes from. */
static char *describe_run(void)
{
    static const char *const environment[][2] = {
        { "slurm_job", "SLURM_JOB_ID" }, { "slurm_array_task", "SLURM_ARRAY_TASK_ID" }, { "slurm_node", "SLURMD_NODENAME" },
        { "slurm_restarts", "SLURM_RESTART_COUNT" },
    };
    enum { SIZE = 2048 };
    char host[128] = "", *text = calloc(1, SIZE);
    bool first = true;

    if (text == NULL)
        return NULL;
    gethostname(host, sizeof host - 1);
    add(text, SIZE, "{");
    add_attribute(text, SIZE, "host", host, &first);
    for (size_t i = 0; i < sizeof environment / sizeof environment[0]; i++) {
        const char *value = getenv(environment[i][1]);
        add_attribute(text, SIZE, environment[i][0], value && strlen(value) < 128 ? value : NULL, &first);
    }
    add(text, SIZE, "}");
    return text;
}

static void make_id(modald_stream *s, char *text, size_t size, int64_t *id)
{
    *id = ++s->next_id;
    snprintf(text, size, "{\"id\":%lld", (long long)*id);
}

/* The members of `open` behind the id: what the stream is, and which run it comes from. */
static void open_header(modald_stream *s, char *text, size_t size)
{
    if (s->open_text != NULL) {
        add(text, size, "%s", s->open_text);
        return;
    }
    add(text, size, ",\"op\":\"open\",\"name\":");
    add_string(text, size, s->name);
    add(text, size, ",\"channels\":%d,\"dt\":%.17g", s->channels, s->dt);
    if (s->period > 0)
        add(text, size, ",\"period\":%.17g", s->period);
    if (s->names != NULL)
        add(text, size, ",\"names\":%s", s->names);
    if (s->units != NULL)
        add(text, size, ",\"units\":%s", s->units);
    add(text, size, ",\"attributes\":%s", s->run ? s->run : "{}");
    if (s->window_samples > 0)
        add(text, size, ",\"window\":{\"samples\":%ld,\"hop\":%ld%s%s%s%s}", s->window_samples, s->window_hop > 0 ? s->window_hop : s->window_samples,
            s->options ? ",\"options\":" : "", s->options ? s->options : "", s->alarms ? ",\"alarms\":" : "", s->alarms ? s->alarms : "");
    add(text, size, "}");
}

/* The body of a message: the first LENGTH bytes of DATA, lent. */
static bool send_body(modald_stream *s, double *data, size_t length)
{
    zmq_msg_t message;
    bool sent;

    atomic_fetch_add_explicit(&loan_of(data)->holders, 1, memory_order_relaxed);
    if (zmq_msg_init_data(&message, data, length, give_back, NULL) != 0) {
        loan_drop(data);
        return false;
    }
    sent = zmq_msg_send(&message, s->socket, ZMQ_DONTWAIT) >= 0;
    if (!sent)
        zmq_msg_close(&message);                        /* which gives it back */
    return sent;
}

static bool send_message(modald_stream *s, const char *verb, const char *header, double *body, size_t length)
{
    if (!s->ready || zmq_send(s->socket, version, strlen(version), ZMQ_SNDMORE | ZMQ_DONTWAIT) < 0)
        return false;
    return zmq_send(s->socket, verb, strlen(verb), ZMQ_SNDMORE | ZMQ_DONTWAIT) >= 0
        && zmq_send(s->socket, header, strlen(header), ZMQ_DONTWAIT | (body ? ZMQ_SNDMORE : 0)) >= 0
        && (body == NULL || send_body(s, body, length));
}

static void send_open(modald_stream *s)
{
    char *text = calloc(1, HEADER_MOST);

    if (text == NULL)
        return;
    make_id(s, text, HEADER_MOST, &s->open_id);
    open_header(s, text, HEADER_MOST);
    s->opening = send_message(s, "STREAM", text, NULL, 0);
    s->asked_at = now();
    free(text);
    if (!s->opening)
        return;
    char events[1024] = "";
    make_id(s, events, sizeof events, &s->events_id);
    add(events, sizeof events, ",\"stream\":");
    add_string(events, sizeof events, s->name);
    add(events, sizeof events, "}");
    send_message(s, "EVENTS", events, NULL, 0);
}

static bool send_frame(modald_stream *s, struct frame *f)
{
    size_t length = f->count * (size_t)s->channels * sizeof(double);
    char text[512];
    int64_t id;

    make_id(s, text, sizeof text, &id);
    add(text, sizeof text, ",\"op\":\"push\",\"stream\":");
    add_string(text, sizeof text, s->stream);
    add(text, sizeof text, ",\"epoch\":%llu,\"first\":%llu,\"count\":%llu,\"crc32c\":%lu}", (unsigned long long)s->epoch, (unsigned long long)f->first,
        (unsigned long long)f->count, (unsigned long)f->crc);
    if (!send_message(s, "STREAM", text, f->data, length))
        return false;
    f->id = id;
    s->flying += length;
    s->asked_at = now();
    return true;
}

static void send_close(modald_stream *s)
{
    char text[512];

    make_id(s, text, sizeof text, &s->close_id);
    add(text, sizeof text, ",\"op\":\"close\",\"stream\":");
    add_string(text, sizeof text, s->stream);
    add(text, sizeof text, "%s}", atomic_load(&s->stop) == 2 ? ",\"broken\":true" : "");
    s->closing = send_message(s, "STREAM", text, NULL, 0);
    s->asked_at = now();
}

static void send_frames(modald_stream *s)
{
    for (int i = 0; i < s->frames; i++) {
        struct frame *f = frame_at(s, i);
        size_t length = f->count * (size_t)s->channels * sizeof(double);
        if (f->id != 0)
            continue;
        if ((s->flying > 0 && s->flying + length > s->credit) || !send_frame(s, f))
            return;
    }
}

/* The link is new or gone: nothing that was sent counts. */
static void forget_link(modald_stream *s)
{
    s->opened = s->opening = s->closing = false;
    s->first_id = s->next_id + 1;
    s->flying = 0;
    s->events_id = 0;
    for (int i = 0; i < s->frames; i++)
        frame_at(s, i)->id = 0;
    atomic_store(&s->verdict, MODALD_UNKNOWN);
}

/* The daemon is there, and does not let us in. */
static void say_refused(modald_stream *s, uint16_t event, uint32_t value)
{
    bool keys = s->keys[0][0] != 0;

    if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH)
        say(s, "the daemon refused our key; the run goes on without it");
    else if (value == ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH)
        say(s, keys ? "the daemon takes no keys (MODALD_KEYFILE); the run goes on without it"
                    : "the daemon wants a key (MODALD_KEYFILE); the run goes on without it");
}

static void note(modald_stream *s, uint16_t event, uint32_t value)
{
    if (event == ZMQ_EVENT_HANDSHAKE_SUCCEEDED) {
        forget_link(s);
        s->ready = true;
    } else if (event == ZMQ_EVENT_DISCONNECTED) {
        s->lost = true;
    } else {
        say_refused(s, event, value);
    }
}

static void listen(modald_stream *s)
{
    zmq_msg_t part;
    uint16_t event;
    uint32_t value;

    zmq_msg_init(&part);
    while (zmq_msg_recv(&part, s->monitor, ZMQ_DONTWAIT) >= 0) {
        if (!zmq_msg_more(&part) || zmq_msg_size(&part) < sizeof event + sizeof value)
            continue;
        memcpy(&event, zmq_msg_data(&part), sizeof event);
        memcpy(&value, (const char *)zmq_msg_data(&part) + sizeof event, sizeof value);
        note(s, event, value);
    }
    zmq_msg_close(&part);
}

/* Frames acknowledged from the front on leave the window, their slots or file space with them. */
static void retire(modald_stream *s)
{
    while (s->frames > 0 && frame_at(s, 0)->acknowledged) {
        struct frame *f = frame_at(s, 0);
        if (f->ring_end > 0)
            release(s, f->ring_end);
        if (f->file_end > s->spill_acknowledged)
            s->spill_acknowledged = f->file_end;
        atomic_fetch_add_explicit(&s->acknowledged, f->count, memory_order_relaxed);
        f->ring_end = f->file_end = 0;
        s->first_frame = (s->first_frame + 1) % WINDOW;
        s->frames--;
    }
    spill_drained(s);
}

/* The epoch that the daemon is in; what was said of another is no word on this one. */
static void set_epoch(modald_stream *s, uint64_t epoch)
{
    if (epoch != s->epoch) {
        atomic_store(&s->verdict, MODALD_UNKNOWN);
        atomic_store(&s->estimate_past, atomic_load(&s->estimate_version));
    }
    s->epoch = epoch;
}

static void take_reply(modald_stream *s, const char *header)
{
    int64_t id = (int64_t)count_at(member(header, "id"), 0);

    s->credit = (size_t)count_at(member(header, "credit"), s->credit);
    if (id == s->open_id && s->opening
        && read_string(member(header, "stream"), s->stream, sizeof s->stream)) {
        set_epoch(s, count_at(member(header, "epoch"), 0));
        s->opened = true;
        s->opening = false;
        s->pause = pause_least;
    } else if (id == s->close_id && s->closing) {
        s->closed = true;
    }
    for (int i = 0; i < s->frames; i++) {
        struct frame *f = frame_at(s, i);
        size_t length = f->count * (size_t)s->channels * sizeof(double);
        if (f->id != id || id == 0)
            continue;
        f->acknowledged = true;
        s->flying -= s->flying >= length ? length : s->flying;
        uint64_t epoch = count_at(member(header, "epoch"), s->epoch);
        if (epoch != s->epoch && f->first > 0 && f->first == s->went_on)       /* and we did not go back */
            say(s, "another run pushes to a stream of this name; each begins the record anew");
        s->went_on = f->first + f->count;
        set_epoch(s, epoch);
    }
    retire(s);
}

/* Errors that pass (busy, quota, storage_full, draining) are tried again, and so is a stream that somebody else closed; others end the sending, not the
 * host. */
static void take_error(modald_stream *s, const char *header)
{
    static const char *const passing[] = {
        "busy", "quota", "storage_full", "draining", "not_found"
    };
    const char *error = member(header, "error"), *code = member(error, "code");
    int64_t id = (int64_t)count_at(member(header, "id"), 0);
    char text[256], message[200];
    bool passes;

    if (id != 0 && (id == s->events_id || id < s->first_id))
        return;                                     /* no live results; or it counts no more */
    passes = s->opened && is_text(code, "conflict");
    for (size_t i = 0; i < sizeof passing / sizeof passing[0]; i++)
        passes |= is_text(code, passing[i]);
    if (passes) {
        double after = number_at(member(member(error, "detail"), "retry_after_s"), 0.5);
        s->quiet_until = now() + fmin(fmax(after, 0.05), 0.5);
        forget_link(s);                             /* open again: what was taken is known then */
        return;
    }
    if (!read_string(member(error, "message"), message, sizeof message))
        snprintf(message, sizeof message, "%.150s", header);
    snprintf(text, sizeof text, "the daemon refused it (%s); the run goes on without it", message);
    say(s, text);
    s->refused = true;
}

/* Does a live result rest on samples of this run?  Another of the same name, or this one before it was taken up again, may be told late. */
static bool is_ours(const modald_stream *s, const char *header)
{
    const char *of = member(header, "stream_id");

    return (of == NULL || is_text(of, s->stream))
        && count_at(member(header, "epoch"), s->epoch) == s->epoch;
}

static struct modald_estimate estimate_of(const char *mode, double sample)
{
    const char *std = member(mode, "std");

    return (struct modald_estimate) {
        .frequency_hz = number_at(member(mode, "frequency_hz"), 0),
        .frequency_std = number_at(member(std, "frequency_hz"), -1),
        .damping_ratio = number_at(member(mode, "damping_ratio"), HUGE_VAL),
        .damping_std = number_at(member(std, "damping_ratio"), -1),
        .sample = sample,
    };
}

/* The least damped mode, and whether all is stable, of a live result. */
static void take_event(modald_stream *s, const char *header)
{
    const char *stable = member(member(header, "stability"), "stable");
    const char *mode = first_element(member(header, "modes"));
    struct modald_estimate best = { .damping_ratio = HUGE_VAL };
    double sample = number_at(member(header, "last"), number_at(member(header, "to"), -1));

    if (stable == NULL || !is_ours(s, header))
        return;
    for (; mode != NULL; mode = next_element(mode)) {
        struct modald_estimate e = estimate_of(mode, sample);
        if (e.damping_ratio < best.damping_ratio)
            best = e;
    }
    if (best.damping_ratio < HUGE_VAL) {
        atomic_fetch_add_explicit(&s->estimate_version, 1, memory_order_acq_rel);
        s->estimate = best;
        atomic_fetch_add_explicit(&s->estimate_version, 1, memory_order_release);
    }
    bool yes = strncmp(stable, "true", 4) == 0, no = strncmp(stable, "false", 5) == 0;
    atomic_store(&s->verdict, yes ? MODALD_STABLE : no ? MODALD_UNSTABLE : MODALD_UNDECIDED);
}

/* A message of KIND, its header as text that is ours to read. */
static void take_message(modald_stream *s, const char *kind, const char *header)
{
    static const struct { const char *kind; void (*take)(modald_stream *, const char *); } kinds[] = {
        { "REPLY", take_reply }, { "ERROR", take_error }, { "EVENT", take_event },
    };

    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
        if (strcmp(kind, kinds[i].kind) == 0)
            kinds[i].take(s, skip_space(header));
}

/* One message: what it cost; 0: there is none. */
static size_t receive(modald_stream *s)
{
    char kind[8] = "", *header = NULL;
    size_t cost = 0;
    bool more = true;
    zmq_msg_t part;

    zmq_msg_init(&part);
    for (int i = 0; more && cost <= BACKLOG_MOST; i++) {
        if (zmq_msg_recv(&part, s->socket, ZMQ_DONTWAIT) < 0)
            break;
        size_t size = zmq_msg_size(&part);
        more = zmq_msg_more(&part);
        cost += MESSAGE_COST + size;
        if (i == 1 && size < sizeof kind)
            memcpy(kind, zmq_msg_data(&part), size);
        if (i == 2)
            header = strndup(zmq_msg_data(&part), size);
    }
    zmq_msg_close(&part);
    if (header != NULL)
        take_message(s, kind, header);
    free(header);
    return cost;
}

/* ------------------------------------------------------------------ the sender's thread */

/* A key file as modalctl keygen writes it: NAME = "40 signs". */
static bool read_key(char key[KEY_SIGNS + 1], const char *text, const char *name)
{
    const char *at = strstr(text, name), *quote = at ? strchr(at, '"') : NULL;

    if (quote == NULL || strcspn(quote + 1, "\"") != KEY_SIGNS)
        return false;
    memcpy(key, quote + 1, KEY_SIGNS);
    return true;
}

/* Once, at the start: a host may give up the right to read them. */
static bool read_keys(modald_stream *s)
{
    static const char *const names[KEYS] = { "public-key", "secret-key", "server-key" };
    char text[1024] = "";
    struct stat st;
    int fd;
    bool good;

    if (s->keyfile == NULL)
        return true;
    fd = open(s->keyfile, O_RDONLY | O_CLOEXEC);
    good = fd >= 0 && fstat(fd, &st) == 0 && (st.st_mode & 077) == 0
        && read(fd, text, sizeof text - 1) > 0;
    for (int i = 0; good && i < KEYS; i++)
        good = read_key(s->keys[i], text, names[i]);
    explicit_bzero(text, sizeof text);
    if (fd >= 0)
        close(fd);
    return good;
}

static void *pass(void *gate)
{
    pthread_mutex_lock(gate);
    pthread_mutex_unlock(gate);
    return NULL;
}

/* libzmq ends the process where it gets no thread or no descriptor: there are as many as it takes, tried together. */
static bool may_begin(void)
{
    pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;
    pthread_t threads[2];
    int fds[DESCRIPTORS], made = 0, opened = 0;

    pthread_mutex_lock(&gate);
    while (made < 2 && pthread_create(&threads[made], NULL, pass, &gate) == 0)
        made++;
    while (opened < DESCRIPTORS && (fds[opened] = eventfd(0, EFD_CLOEXEC)) >= 0)
        opened++;
    pthread_mutex_unlock(&gate);
    for (int i = 0; i < made; i++)
        pthread_join(threads[i], NULL);
    for (int i = 0; i < opened; i++)
        close(fds[i]);
    return made == 2 && opened == DESCRIPTORS;
}

static bool set_options(const modald_stream *s)
{
    static const struct { int name, value; } options[] = {
        { ZMQ_LINGER, 0 }, { ZMQ_RECONNECT_IVL, 50 }, { ZMQ_RECONNECT_IVL_MAX, 1000 },
        { ZMQ_SNDHWM, 64 }, { ZMQ_RCVHWM, 0 },
        { ZMQ_TCP_KEEPALIVE, 1 }, { ZMQ_TCP_KEEPALIVE_IDLE, 5 },
        { ZMQ_TCP_KEEPALIVE_INTVL, 5 }, { ZMQ_TCP_KEEPALIVE_CNT, 2 }, { ZMQ_TCP_MAXRT, 15000 },
    };
    static const int keys[KEYS] = { ZMQ_CURVE_PUBLICKEY, ZMQ_CURVE_SECRETKEY, ZMQ_CURVE_SERVERKEY };
    const size_t value = sizeof options[0].value;
    int64_t most = HEARD_MOST;
    bool good = zmq_setsockopt(s->socket, ZMQ_MAXMSGSIZE, &most, sizeof most) == 0;

    for (size_t i = 0; i < sizeof options / sizeof options[0]; i++)
        good &= zmq_setsockopt(s->socket, options[i].name, &options[i].value, value) == 0;
    for (int i = 0; i < KEYS && s->keys[i][0] != 0; i++)
        good &= zmq_setsockopt(s->socket, keys[i], s->keys[i], sizeof s->keys[i]) == 0;
    return good;
}

/* The socket's own account of its connection; it must never wait for us. */
static bool open_monitor(modald_stream *s)
{
    static const int events = ZMQ_EVENT_HANDSHAKE_SUCCEEDED | ZMQ_EVENT_DISCONNECTED
                            | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH
                            | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL, none = 0;
    char name[64];

    snprintf(name, sizeof name, "inproc://modald-%u", ++s->links);
    s->monitor = zmq_socket(s->context, ZMQ_PAIR);
    return s->monitor != NULL && zmq_socket_monitor(s->socket, name, events) == 0
        && zmq_setsockopt(s->monitor, ZMQ_LINGER, &none, sizeof none) == 0
        && zmq_setsockopt(s->monitor, ZMQ_RCVHWM, &none, sizeof none) == 0
        && zmq_connect(s->monitor, name) == 0;
}

static void close_link(modald_stream *s)
{
    if (s->socket != NULL) {
        zmq_socket_monitor(s->socket, NULL, 0);
        zmq_close(s->socket);
    }
    if (s->monitor != NULL)
        zmq_close(s->monitor);
    s->socket = s->monitor = NULL;
    s->ready = s->lost = false;
}

static bool open_link(modald_stream *s)
{
    s->socket = zmq_socket(s->context, ZMQ_DEALER);
    if (s->socket != NULL && set_options(s) && open_monitor(s)
        && zmq_connect(s->socket, s->url) == 0)
        return true;
    close_link(s);
    s->begin_at = now() + pause_most;
    return false;
}

/* Nothing more is said or heard on this link; the next begins after a pause. */
static void drop_link(modald_stream *s)
{
    forget_link(s);
    close_link(s);
    s->begin_at = now() + s->pause;
    s->pause = fmin(2 * s->pause, pause_most);
}

static bool connect_socket(modald_stream *s)
{
    if (!read_keys(s)) {
        say(s, "the key file is not one of mode 0600 with three keys; "
               "the run goes on without modald");
        return false;
    }
    s->pause = pause_least;
    s->context = may_begin() ? zmq_ctx_new() : NULL;
    return s->context != NULL && open_link(s);
}

static void close_socket(modald_stream *s)
{
    close_link(s);
    if (s->context != NULL)
        zmq_ctx_term(s->context);
    s->context = NULL;
    explicit_bzero(s->keys, sizeof s->keys);
}

/* What came in.  True: something did. */
static bool hear(modald_stream *s)
{
    size_t taken = 0, cost = 1;

    if (s->socket == NULL && (now() < s->begin_at || !open_link(s)))
        return false;
    listen(s);
    for (; cost > 0 && taken <= BACKLOG_MOST; taken += cost)
        cost = receive(s);
    if (taken > BACKLOG_MOST)
        s->pause = pause_most;
    if (s->lost || taken > BACKLOG_MOST)
        drop_link(s);
    return taken > 0;
}

/* Is everything that was pushed acknowledged? */
static bool drained(const modald_stream *s)
{
    return s->taken == atomic_load(&s->page->head) && s->build.count == 0 && s->frames == 0 && !spilling(s);
}

/* One turn: what came in, what was pushed, what goes out.  True: something moved. */
static bool turn(modald_stream *s, bool flush)
{
    uint64_t before = s->taken;
    bool moved = hear(s);

    if (s->refused) {                                   /* nobody wants them: the ring stays empty */
        release(s, s->taken = atomic_load(&s->page->head));
        return false;
    }
    take(s);
    if (s->build.count > 0 && (flush || now() > s->build_since + 0.02))
        finish_build(s);
    spill_if_needed(s, false);
    fill_window(s);
    if (s->ready && !s->opened && !s->opening && (s->frames > 0 || flush)
        && now() >= s->quiet_until)
        send_open(s);
    if (s->opened)
        send_frames(s);
    if ((s->opening || s->flying > 0) && now() > s->asked_at + answer_patience)
        drop_link(s);
    return moved || s->taken != before;
}

/* The rest of an uneven record: its last point has none beyond. */
static void end_resampling(modald_stream *s)
{
    if (s->points > 1)
        resample(s, s->history[s->points - 1].t);
    s->points = 0;
}

static void finish(modald_stream *s, double until)
{
    while (!s->refused && now() < until && !(drained(s) && (s->closed || !s->seal))) {
        bool moved = turn(s, true);
        if (s->taken == atomic_load(&s->page->head))
            end_resampling(s);
        if (drained(s) && s->opened && !s->closing)
            send_close(s);
        if (!moved)
            rest(0.0005);
    }
}

/* What could not be sent goes into the spill file. */
static void keep(modald_stream *s)
{
    if (s->refused || drained(s))
        return;
    do {
        finish_build(s);
        spill_if_needed(s, true);
        take(s);
    } while (!s->spill_failed && s->spill_most > 0 && s->taken < atomic_load(&s->page->head));
    end_resampling(s);
    finish_build(s);
    spill_if_needed(s, true);
}

/* A table of descriptors of our own: stderr and the ring's lock from the host's, nothing on 0 and 1.  A kernel before 5.9 has no such call, and it is shared. */
static void take_descriptors(modald_stream *s)
{
    unsigned keep = s->ring_fd > 2 ? (unsigned)s->ring_fd : 2, unshare_too = 2;
    int null;

    if (syscall(SYS_close_range, keep + 1, ~0u, unshare_too) != 0)
        return;
    s->own_descriptors = true;
    if (keep > 3)
        syscall(SYS_close_range, 3u, keep - 1, 0u);
    null = open("/dev/null", O_RDWR | O_CLOEXEC);
    for (int fd = 0; fd < 3 && null >= 0; fd++)
        if (fd != null && (fd < 2 || fcntl(fd, F_GETFD) < 0))
            dup2(null, fd);
    if (null > 2)
        close(null);
}

/* The spill file goes when it is empty; else it is said where it is. */
static void end_spill(modald_stream *s)
{
    char text[700];
    bool left = spilling(s);

    if (s->spill_fd < 0)
        return;
    close(s->spill_fd);
    if (!left)
        unlink(s->spill_path);
    snprintf(text, sizeof text, "some samples could not be sent; `modalctl replay %s` sends them", s->spill_path);
    if (left)
        tell(s->name, text);
}

static void end_sending(modald_stream *s)
{
    uint64_t dropped = atomic_load(&s->dropped);
    char text[100];

    close_socket(s);
    snprintf(text, sizeof text, "%llu samples were dropped; the record shows the gap", (unsigned long long)dropped);
    if (dropped > 0)
        tell(s->name, text);
    end_spill(s);
    if (s->ring_fd >= 0)
        close(s->ring_fd);
}

static void *sender(void *argument)
{
    modald_stream *s = argument;
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    double idle = 0.0005;

    uselocale(c);
    take_descriptors(s);
    sem_post(&s->begun);
    if (!connect_socket(s)) {
        s->refused = true;
        say(s, "no socket to the daemon; the run goes on without it");
    }
    while (atomic_load(&s->stop) == 0) {
        bool moved = s->refused ? (release(s, s->taken = atomic_load(&s->page->head)), false) : turn(s, false);
        idle = moved ? 0.0005 : fmin(2 * idle, 0.005);
        rest(idle);
    }
    s->seal = atomic_load(&s->page->head) > 0;
    if (!s->refused) {
        finish(s, now() + s->close_wait);
        keep(s);
    }
    end_sending(s);
    uselocale(LC_GLOBAL_LOCALE);
    freelocale(c);
    atomic_store(&s->finished, true);
    return NULL;
}

/* ------------------------------------------------------------------ open and close */

static double number_from(const char *name, double otherwise, double most)
{
    const char *text = getenv(name);
    char *end;
    double value = text && *text ? strtod(text, &end) : 0;

    return text && *text && *end == 0 && value >= 0 && value <= most ? value : otherwise;
}

static size_t size_from(const char *name, size_t otherwise)
{
    return (size_t)number_from(name, (double)otherwise, 1e15);
}

/* PATH from the root, whatever the host's folder is later. */
static void absolute(char *out, size_t size, const char *path)
{
    char here[256];

    if (*path == '/' || getcwd(here, sizeof here) == NULL)
        snprintf(out, size, "%s", path);
    else
        snprintf(out, size, "%s/%s", here, path);
}

/* Every page is there, and known to this processor, before the first push. */
static void touch(void *base, size_t bytes)
{
    for (volatile char *p = base; p < (volatile char *)base + bytes; p += PAGE)
        *p = *p;
}

/* Zeroed, in huge pages where the system gives them and it fills one. */
static void *map_memory(size_t bytes)
{
    size_t spare = bytes >= HUGE_PAGE ? HUGE_PAGE : 0, before;
    char *base = mmap(NULL, bytes + spare, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);

    if (base == MAP_FAILED && spare > 0) {
        spare = 0;
        base = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    }
    if (base == MAP_FAILED)
        return NULL;
    if (spare > 0) {
        size_t end = (bytes + PAGE - 1) / PAGE * PAGE;
        before = (HUGE_PAGE - (uintptr_t)base % HUGE_PAGE) % HUGE_PAGE;
        if (before > 0)
            munmap(base, before);
        if (before + end < bytes + spare)
            munmap(base + before + end, bytes + spare - before - end);
        base += before;
        madvise(base, bytes, MADV_HUGEPAGE);
    }
    touch(base, bytes);
    return base;
}

/* Has the file of FD room for BYTES?  Its blocks too: a mapped page that the disk is too full for would end the host. */
static bool allocate(int fd, size_t bytes)
{
    struct stat st;

    return fstat(fd, &st) == 0 && posix_fallocate(fd, 0, (off_t)bytes) == 0 && ((size_t)st.st_size <= bytes || ftruncate(fd, (off_t)bytes) == 0);
}

/* What an earlier run left in the file is kept: is it a ring like ours? */
static bool is_left(const modald_stream *s, const struct ring_page *page)
{
    uint64_t waiting = atomic_load(&page->head) - atomic_load(&page->tail);

    return memcmp(page->magic, ring_magic, sizeof ring_magic) == 0 && page->channels == (uint64_t)s->channels && page->slots == s->slots && page->dt == s->dt
        && strcmp(page->name, s->name) == 0 && waiting <= s->slots;
}

static void fill_head(const modald_stream *s, struct ring_page *page)
{
    memset((void *)page, 0, sizeof *page);
    page->channels = (uint64_t)s->channels;
    page->slots = s->slots;
    page->dt = s->dt;
    snprintf(page->name, sizeof page->name, "%s", s->name);
    memcpy(page->magic, ring_magic, sizeof ring_magic);
}

/* A file that is new has its head at once: a host killed while the rest is made leaves an empty ring, not a file of nothing. */
static bool begin_file(const modald_stream *s, int fd, bool *fresh)
{
    struct ring_page page;
    struct rlimit most;
    struct stat st;

    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode) || getrlimit(RLIMIT_FSIZE, &most) != 0 || most.rlim_cur < s->ring_bytes)
        return false;                                   /* a file past that limit is a signal to the host */
    *fresh = st.st_size == 0;
    fill_head(s, &page);
    return !*fresh || pwrite(fd, &page, sizeof page, 0) == (ssize_t)sizeof page;
}

/* The ring in the file at PATH (%s: the stream's name), locked as long as it is ours; NULL: it cannot be there. */
static void *map_file(modald_stream *s, const char *file)
{
    const char *mark = strstr(file, "%s");
    char path[512], name[sizeof s->name];
    void *base = MAP_FAILED;
    bool fresh = false;
    int fd, n;

    snprintf(name, sizeof name, "%s", s->name);
    for (char *p = name; *p != 0; p++)
        *p = *p == '/' ? '_' : *p;
    n = snprintf(path, sizeof path, "%.*s%s%s", mark ? (int)(mark - file) : (int)strlen(file), file, mark ? name : "", mark ? mark + 2 : "");
    fd = n < (int)sizeof path ? open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600) : -1;
    if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
        tell(s->name, "another stream has the ring's file; this one is kept in memory");
    else if (fd >= 0 && begin_file(s, fd, &fresh) && allocate(fd, s->ring_bytes))
        base = mmap(NULL, s->ring_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    else
        tell(s->name, "the ring's file cannot be used; it is kept in memory");
    if (base == MAP_FAILED) {
        if (fresh)
            unlink(path);
        if (fd >= 0)
            close(fd);
        return NULL;
    }
    touch(base, s->ring_bytes);
    s->ring_fd = fd;
    return base;
}

/* The ring, in memory or in a file. */
static bool make_ring(modald_stream *s, size_t bytes, const char *file)
{
    size_t slot;

    s->stride = (size_t)s->channels + 2;
    slot = s->stride * sizeof(double);
    if (file != NULL && *file != 0) {
        s->slots = bytes / slot < 8 ? 8 : bytes / slot;
        s->ring_bytes = RING_HEAD + s->slots * slot;
        s->page = map_file(s, file);
    }
    if (s->page == NULL) {                              /* its head included, so that 8 MiB are four huge pages */
        s->slots = bytes < RING_HEAD + 8 * slot ? 8 : (bytes - RING_HEAD) / slot;
        s->ring_bytes = RING_HEAD + s->slots * slot;
        s->page = map_memory(s->ring_bytes);
    }
    if (s->page == NULL)
        return false;
    s->ring = (double *)((char *)s->page + RING_HEAD);
    if (!is_left(s, s->page))
        fill_head(s, s->page);
    s->head = atomic_load(&s->page->head);
    s->taken = s->tail_seen = atomic_load(&s->page->tail);
    s->cursor = s->head % s->slots;
    return true;
}

static bool make_frames(modald_stream *s)
{
    size_t sample = (size_t)s->channels * sizeof(double);

    s->frame_samples = sample < FRAME_BYTES ? FRAME_BYTES / sample : 1;
    for (int i = 0; i < WINDOW; i++)
        if ((s->window[i].data = loan_new(frame_bytes(s))) == NULL)
            return false;
    for (int i = 0; i < HISTORY; i++)
        if ((s->history[i].y = malloc(sample)) == NULL)
            return false;
    s->build.data = loan_new(frame_bytes(s));
    s->rms = calloc((size_t)s->channels, sizeof *s->rms);
    s->sample = calloc((size_t)s->channels, sizeof *s->sample);
    return s->build.data && s->rms && s->sample;
}

/* A closed stream's handle: what is done to it does nothing, until so many were closed after it. */
static void bury(modald_stream *s)
{
    static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    static modald_stream *closed[CLOSED_KEPT];
    static unsigned next;
    modald_stream *oldest;

    pthread_mutex_lock(&lock);
    oldest = closed[next];
    closed[next] = s;
    next = (next + 1) % CLOSED_KEPT;
    pthread_mutex_unlock(&lock);
    free(oldest);
}

static void stream_free(modald_stream *s)
{
    if (s->page != NULL)
        munmap(s->page, s->ring_bytes);
    for (int i = 0; i < WINDOW; i++)
        loan_drop(s->window[i].data);
    for (int i = 0; i < HISTORY; i++)
        free(s->history[i].y);
    loan_drop(s->build.data);
    free(s->rms);
    free(s->sample);
    free(s->names);
    free(s->units);
    free(s->options);
    free(s->alarms);
    free(s->url);
    free(s->keyfile);
    free(s->open_text);
    free(s->run);
    sem_destroy(&s->begun);
    s->forks = CLOSED;
    bury(s);
}

/* A relative path of ipc is the host's folder's too, where the longer name fits (107 bytes). */
static char *copy_url(const char *url)
{
    char path[108 + 256];

    if (strncmp(url, "ipc://", 6) != 0 || url[6] == '/' || url[6] == '@')
        return strdup(url);
    snprintf(path, 7, "ipc://");
    absolute(path + 6, sizeof path - 6, url + 6);
    return strdup(strlen(path) - 6 < 108 ? path : url);
}

static char *copy_keyfile(void)
{
    const char *keyfile = getenv("MODALD_KEYFILE");
    char path[1024];

    if (keyfile == NULL || *keyfile == 0)
        return NULL;
    absolute(path, sizeof path, keyfile);
    return strdup(path);
}

static char *copy_of(const char *name)
{
    const char *text = getenv(name);

    return text && *text ? strdup(text) : NULL;
}

/* Everything that the environment says is read here, in the host's thread. */
static modald_stream *stream_new(const char *name, int channels, double dt, const char *url, size_t ring, const char *ring_file)
{
    const char *folder = getenv("MODALD_SPILL"), *tmp = getenv("TMPDIR");
    modald_stream *s = aligned_alloc(LINE, sizeof *s);

    if (s == NULL)
        return NULL;
    memset((void *)s, 0, sizeof *s);
    snprintf(s->name, sizeof s->name, "%s", name);
    pthread_once(&fork_once, watch_forks);
    s->forks = atomic_load(&forks);
    s->channels = channels;
    s->dt = dt;
    s->spill_fd = s->ring_fd = -1;
    sem_init(&s->begun, 0, 0);
    s->spill_most = size_from("MODALD_SPILL_MAX", (size_t)1 << 30);
    absolute(s->spill_folder, sizeof s->spill_folder, folder && *folder ? folder : tmp && *tmp ? tmp : "/tmp");
    s->close_wait = number_from("MODALD_CLOSE_WAIT", 5, 1e6);
    s->window_samples = (long)size_from("MODALD_WINDOW", 0);
    s->window_hop = (long)size_from("MODALD_HOP", 0);
    s->credit = FRAME_BYTES;
    s->url = copy_url(url);
    s->keyfile = copy_keyfile();
    s->options = copy_of("MODALD_OPTIONS");
    s->alarms = copy_of("MODALD_ALARMS");
    s->run = describe_run();
    if (s->url == NULL || !make_ring(s, ring, ring_file) || !make_frames(s)) {
        if (s->ring_fd >= 0)
            close(s->ring_fd);
        stream_free(s);
        return NULL;
    }
    return s;
}

/* The sender's thread; no signal is ever its own.  A host with more of its own data a thread than SENDER_STACK gets the usual stack. */
static bool start(modald_stream *s)
{
    pthread_attr_t attr;
    sigset_t all, before;
    bool good;

    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, &before);
    pthread_attr_init(&attr);
    pthread_attr_setstacksize(&attr, SENDER_STACK);
    good = pthread_create(&s->thread, &attr, sender, s) == 0 || pthread_create(&s->thread, NULL, sender, s) == 0;
    pthread_attr_destroy(&attr);
    while (good && sem_wait(&s->begun) != 0)
        ;
    if (s->ring_fd >= 0 && (!good || s->own_descriptors))
        close(s->ring_fd);                              /* the sender has its own */
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return good;
}

modald_stream *modald_open(const char *name, int channels, double dt)
{
    const char *url = getenv("MODALD_URL");
    modald_stream *s;

    if (url == NULL || *url == 0)
        return NULL;
    if (name == NULL || *name == 0 || strlen(name) > 128 || channels < 1 || channels > CHANNELS_MOST || !(dt > 0) || !isfinite(dt)) {
        tell(NULL, "modald_open: a name of 1 to 128 bytes, 1 to 65536 channels and a positive dt are needed");
        return NULL;
    }
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0), before = uselocale(c);       /* numbers have a point */
    s = stream_new(name, channels, dt, url, size_from("MODALD_RING", (size_t)8 << 20), getenv("MODALD_RING_FILE"));
    uselocale(before);
    freelocale(c);
    if (s != NULL && !start(s)) {
        stream_free(s);
        s = NULL;
    }
    if (s == NULL)
        tell(name, "no memory or no thread; the run goes on without it");
    return s;
}

void modald_describe(modald_stream *s, const char *const *names, const char *units, double period)
{
    size_t size = HEADER_MOST / 2;

    if (s == NULL || is_dead(s))
        return;
    s->period = period;
    if (names != NULL && s->names == NULL && (s->names = calloc(1, size)) != NULL) {
        for (int i = 0; i < s->channels; i++) {
            add(s->names, size, i ? "," : "[");
            add_string(s->names, size, names[i]);
        }
        add(s->names, size, "]");
    }
    if (units != NULL && s->units == NULL && (s->units = calloc(1, 1024)) != NULL)
        add_string(s->units, 1024, units);
}

void modald_window(modald_stream *s, long samples, long hop, const char *options)
{
    if (s == NULL || is_dead(s))
        return;
    s->window_samples = samples;
    s->window_hop = hop;
    if (options != NULL) {
        free(s->options);
        s->options = strdup(options);
    }
}

static void end(modald_stream *s, int how)
{
    double until;

    if (s == NULL || is_dead(s))
        return;
    until = now() + s->close_wait + 1;
    atomic_store(&s->stop, how);
    while (!atomic_load(&s->finished) && now() < until)
        rest(0.0005);
    if (atomic_load(&s->finished)) {
        pthread_join(s->thread, NULL);
        stream_free(s);
    } else {                                            /* the thread hangs in a file system: leave it */
        pthread_detach(s->thread);
        s->forks = CLOSED;
    }
}

void modald_close(modald_stream *s)
{
    end(s, 1);
}

void modald_abandon(modald_stream *s)
{
    end(s, 2);
}

/* ------------------------------------------------------------------ replay */

/* A stream whose spill file is FD: its head says what it was. */
static modald_stream *from_spill(int fd, const char *url, char *message, size_t size)
{
    char *text = calloc(1, HEADER_MOST + 1);
    uint32_t length = 0;
    modald_stream *s = NULL;
    char name[256] = "";

    if (flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        snprintf(message, size, "a run still writes it");
        free(text);
        return NULL;
    }
    if (text != NULL && pread(fd, &length, sizeof length, sizeof spill_magic) == (ssize_t)sizeof length && length <= HEADER_MOST
        && pread(fd, text, length, sizeof spill_magic + sizeof length) == (ssize_t)length) {
        text[0] = '{';                                  /* as the message has an id before it */
        uint64_t channels = count_at(member(text, "channels"), 0);
        double dt = number_at(member(text, "dt"), 0);
        if (channels >= 1 && channels <= CHANNELS_MOST && dt > 0
            && read_string(member(text, "name"), name, sizeof name) && name[0] != 0)
            s = stream_new(name, (int)channels, dt, url, 4096, NULL);
        text[0] = ',';
    }
    if (s == NULL) {
        snprintf(message, size, "its head cannot be read");
        free(text);
        return NULL;
    }
    s->open_text = text;
    s->spill_fd = fd;
    s->spill_most = 0;
    s->spill_start = s->spill_read = s->spill_acknowledged = sizeof spill_magic + sizeof length + length;
    s->spill_end = (uint64_t)lseek(fd, 0, SEEK_END);
    return s;
}

/* A stream whose ring is the file at PATH. */
static modald_stream *from_ring(int fd, const char *path, const char *url, char *message, size_t size)
{
    struct ring_page page;
    modald_stream *s = NULL;

    if (pread(fd, &page, sizeof page, 0) == (ssize_t)sizeof page && page.channels >= 1 && page.channels <= CHANNELS_MOST && page.dt > 0
        && page.slots >= 8 && page.slots < (uint64_t)1 << 40 && memchr(page.name, 0, sizeof page.name) != NULL)
        s = stream_new(page.name, (int)page.channels, page.dt, url, page.slots * (page.channels + 2) * sizeof(double), path);
    if (s == NULL)
        snprintf(message, size, "its head cannot be read");
    close(fd);
    if (s != NULL && s->ring_fd < 0) {
        snprintf(message, size, "a run still has it, or it cannot be written");
        stream_free(s);
        s = NULL;
    }
    return s;
}

/* What of a file was not what was written; "": all was. */
static void tell_damage(const modald_stream *s, char *message, size_t size)
{
    message[0] = 0;
    if (s->damaged > 0)
        add(message, size, "%llu samples were damaged and left out", (unsigned long long)s->damaged);
    if (s->torn > 0)
        add(message, size, "%sthe last %llu bytes were torn", s->damaged > 0 ? ", " : "", (unsigned long long)s->torn);
}

/* All of it, in at most TIMEOUT seconds? */
static bool send_all(modald_stream *s, double timeout, char *message, size_t size)
{
    bool good = false;

    s->seal = true;
    if (!connect_socket(s)) {
        snprintf(message, size, "no socket to %s", s->url);
        return false;
    }
    finish(s, now() + timeout);
    good = drained(s) && s->closed;
    if (good)
        tell_damage(s, message, size);
    else
        snprintf(message, size, "%s", s->refused ? "the daemon refused it" : s->ready ? "not all of it was acknowledged in time" : "no server");
    return good;
}

int modald_replay(const char *path, double timeout, double *samples, char *message, size_t size)
{
    const char *url = getenv("MODALD_URL");
    char magic[8] = "";
    int fd = open(path, O_RDWR | O_CLOEXEC);
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0), before = uselocale(c);
    modald_stream *s = NULL;
    bool good = false;

    snprintf(message, size, "%s", fd < 0 ? strerror(errno) : "it is no spill or ring file");
    if (fd >= 0 && pread(fd, magic, sizeof magic, 0) == (ssize_t)sizeof magic && memcmp(magic, spill_magic, sizeof magic) == 0)
        s = from_spill(fd, url ? url : "", message, size);
    else if (fd >= 0 && memcmp(magic, ring_magic, sizeof magic) == 0)
        s = from_ring(fd, path, url ? url : "", message, size);
    if (s != NULL) {
        good = send_all(s, timeout, message, size);
        *samples = (double)atomic_load(&s->acknowledged);
        close_socket(s);
        if (s->spill_fd >= 0)
            close(s->spill_fd);
        if (s->ring_fd >= 0)
            close(s->ring_fd);
        stream_free(s);
    }
    uselocale(before);
    freelocale(c);
    return good;
}
