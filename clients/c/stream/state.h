/* state.h - a stream of samples to modald: what its parts share, and how they work together
 *
 * The parts of this folder are one translation unit: the build writes them one behind the other as
 * modald_stream.c, which hosts link or copy.  So all but the calls of modald_stream.h is static,
 * and a host meets no other name of ours.  Each part calls those before it only: state, text, ring,
 * spill, frames, messages, connection, sender, open, replay.
 *
 *   host's threads                    the sender's thread
 *   push -> ring slots -> frames of equal steps -> window -> link -> daemon
 *                                |                  ^
 *                                +-> spill file ----+     when the daemon does not keep up
 *
 * Link: the connection of a process to an endpoint with a key, and the one thread that serves all
 * streams of it.  It looks at each in turn and waits for none; what was asked is told apart by its
 * id, which names the stream's slot in the link.  Whoever opens or closes a stream holds the
 * process's lock for the list of links; who pushes holds none.
 *
 * Ring: one writer, one reader; `head` and `tail` count slots since the start.  A slot is its
 * sample's index, its time, and its channels.  The tail of a ring in a file moves only when the
 * slot's samples are acknowledged or in the spill file, so that it holds, after a kill, whatever
 * the daemon has not.  One in memory holds what is not in frames yet, which hold as much again; its
 * slots lie in pieces, the count-th of all that were taken in the piece that `order` tells, and the
 * bits of `free_pieces` are those that neither has: the host takes them, the sender puts them back.
 *
 * Frames carry what there is: one leaves when FRAME_ENOUGH is there, else when its first sample is
 * frame_age_most old and all before it is acknowledged.  A slow stream has few, a slow daemon too.
 * With the first of a link that leaves for its age go all that were begun: a beat of the link, for
 * which libzmq, kernel and daemon are waked once, however many its streams are.  They go together,
 * in messages of TOGETHER_MOST, and are answered so.  What may take the daemon longer, the first
 * frame of a stream after it was opened, which may be a repeat, goes alone: nobody waits for it.
 *
 * Window: at most WINDOW frames built and not acknowledged.  A frame is sent once a connection, in
 * order, within the daemon's credit; a lost connection makes all of them unsent.  Repeats are
 * harmless: a sample is known by its index.
 *
 * Closing: a stream that is closed has close_wait to be sent and sealed.  Where that passes and no
 * sample of the link was taken meanwhile, the next of its streams that are closed wait for nothing,
 * as long again, or until one is taken or a new connection stands: so who closes hundreds of
 * streams of a daemon that is gone waits once.
 *
 * Spilling begins when the ring is half full and, while the daemon takes frames of one in memory,
 * the window has no room: a host may push a second's worth at once while its sender has no
 * processor, and no daemon is slow then.
 * The window's frames go to the file first, then everything that is built, and the window is filled
 * from the file until it is empty again.  So the order is kept.
 *
 * push_at: the samples at k dt between times t_1 <= k dt <= t_2 are those of the cubic through
 * (t_0, t_1, t_2, t_3):
 *     y(t) = sum_j y_j prod_{m != j} (t - t_m) / (t_j - t_m).                                (1)
 * Its error is estimated by the difference to the quadratic through (t_0, t_1, t_2), which is
 * larger than that of (1) where steps are small against the motion.
 *
 * What a push costs beyond its copy is memory that is not at hand: the first touch of a page, the
 * walk through the tables of pages, and the lines themselves.  (8 channels: one push in 51 comes to
 * a new page, so the 99th percentile shows each of the three.)  So each push asks for the lines of
 * the slot AHEAD bytes on, and a ring in memory is PIECES, of which the host always takes the first
 * that is free: while its sender keeps up it goes round in a few of those that are there at open,
 * RING_TOUCHED, and no page of the ring comes or goes, however fast it is.  What lies behind that
 * comes in huge pages, one fault in many thousand pushes, where a host runs away from its sender,
 * and goes back to the system once a piece was not used for a while.
 *
 * The host's process is the host's.  The sender's thread has a table of descriptors of its own, all
 * of libzmq's and the spill file's in it: the host may close every number it finds, run out of
 * them, and count on the next.  It is given no signals, reads no environment and no locale, and a
 * closed stream's handle stays what it is, so that a push after it does nothing.
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
#ifndef STREAM_STATE_H
#define STREAM_STATE_H
#include "modald_stream.h"
#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* What a daemon, a kernel or a processor asks for. */
enum {
    CHANNELS_MOST = 65536,      /* of a stream; the daemon may take fewer, and says so */
    NAME_MOST = 128,            /* bytes of a stream's name: proto/PROTOCOL.md, section 11 */
    HEADER_MOST = 65536,        /* bytes of a message's header: section 2 */
    HEARD_MOST = 1048576,       /* bytes of a frame that comes: section 2 */
    KEYS = 3,                   /* the host's public and secret one, the daemon's public one */
    KEY_SIGNS = 40,             /* of a key in Z85: 32 bytes, five signs for four */
    LINE = 64,                  /* bytes of a line of the cache */
    PAGE = 4096,                /* bytes of a page */
    HUGE_PAGE = 2097152,        /* bytes of one where the system gives them */
    URL_PATH_MOST = 107,        /* bytes of a local socket's path: sun_path without its 0 */
};

/* How much is held, and for how long. */
enum {
    LINK_STREAMS = 4096,        /* of a connection: an id is a count of questions times this */
    NAMED = 1024,               /* places of streams by name: a few of a full link in each */
    FRAME_BYTES = 131072,       /* of a push, at least one sample: WINDOW of them are 8 MiB, which
                                 * is the ring's usual size */
    FRAME_ENOUGH = 65536,       /* bytes with which it leaves: a kernel's socket holds three */
    WINDOW = 64,                /* frames in flight; memory is touched as far as it is used */
    LOANS = WINDOW + 1,         /* and the one that is built */
    LOANS_KEPT = 2,             /* of a stream that has nothing in flight: one is built, one sent */
    RING_TOUCHED = 1048576,     /* bytes of a ring in memory that are there at open */
    PIECES = 64,                /* of a ring in memory: bits of a number */
    RING_HEAD = PAGE,           /* of a ring in a file: its samples begin on a page */
    SLOTS_LEAST = 8,            /* of a ring, however small it is asked to be */
    HISTORY = 4,                /* points of (1) */
    AHEAD = 2048,               /* bytes from its slot that a push reads on: 25 slots of 8 */
    AHEAD_MOST = 1024,          /* bytes of a slot read on; a copy of more comes by itself */
    NARROW_MOST = 64,           /* channels copied one by one: about as many stores as wait in a
                                 * processor for its cache */
    DESCRIPTORS = 32,           /* that libzmq may need: it ends the process where it gets none */
    CLOSED_KEPT = 256,          /* handles of closed streams, for hosts that push once more */
    TOGETHER_MOST = 512,        /* frames of a message, where the daemon takes as many */
    PART_MOST = 256,            /* bytes of a frame in its header: a name of 128 and four numbers */
    ASKED_MOST = 512,           /* questions of a connection without an answer: a daemon keeps 1024
                                 * answers of one that is slow to read */
    SEND_MOST = 1024,           /* messages on their way to libzmq's thread, a turn of streams;
                                 * their samples lie in windows anyway */
    BACKLOG_MOST = 4194304,     /* bytes in a turn; kernel and daemon keep less: 64 messages */
    BACKLOG_EACH = 65536,       /* and of each stream: its answers of seconds, or a live result */
    MESSAGE_COST = 64,          /* of a frame in libzmq's pipe, beside its bytes */
    SENDER_STACK = 262144,      /* bytes; its own buffers take a few thousand */
    FAILURES = 4,               /* handshakes until somebody who hangs up is told of: with the
                                 * pauses a third of a second, in which a daemon starts again */
};
static const double pause_least = 0.05;      /* s between links; doubled until one is good */
static const double pause_most = 1;          /* s */
static const double answer_patience = 10;    /* s: then the link is as good as lost */
static const double moment = 0.0005;         /* s between two looks at what came */
static const double integer_most = 0x1p53; /* beyond it doubles skip some */

static const char version[] = "MODALD1";
static const char spill_magic[8] = "MDSPILL1", ring_magic[8] = "MDRING01";

/* A ring's head page: in memory, or the first page of its file. */
struct ring_page {
    char magic[8];
    uint64_t channels, slots;
    double dt;
    char name[256];
    _Alignas(LINE) _Atomic uint64_t head;    /* written by the host only */
    _Alignas(LINE) _Atomic uint64_t tail;    /* written by the sender only */
};

struct frame {
    uint64_t first, count;
    double *data;               /* of a loan: FRAME_BYTES, or one sample; NULL: not in use */
    uint32_t crc;               /* CRC-32C of the samples, once it is built */
    uint64_t ring_end;          /* the tail once it is acknowledged; 0: it came from the file */
    uint64_t file_end;          /* the spill's offset once it is acknowledged */
    int64_t id;                 /* of the message; 0: not sent */
    int part;                   /* which one of it */
    bool acknowledged;
};

/* Frames of several streams that are one message, which is being made or has no answer yet. */
struct together {
    struct together *next;
    int64_t id;
    double sent_at;
    int count;
    short slots[TOGETHER_MOST]; /* whose, in its link */
};

/* A message of them as it is made. */
struct letter {
    size_t written, length;     /* bytes of the header so far, of the body */
    char header[HEADER_MOST];
    char body[FRAME_BYTES];
};

/* Samples of a frame: libzmq is lent them instead of taking a copy, and gives them back from a
 * thread of its own.  Those of a stream lie one behind the other, touched as far as they are used.
 */
struct loan {
    atomic_uint holders;        /* messages */
    _Alignas(LINE) double data[];
};

/* Before the loans of a stream: they go with the last of the stream and its messages. */
struct loans {
    atomic_uint holders;
    size_t bytes, stride;       /* of all; of one */
};

/* Of a record in the spill file; its samples follow. */
struct spill_head { uint64_t first, count; uint32_t crc, zero; };

/* A sample at a time of its own. */
struct point { double t; double *y; };

/* The process's connection to an endpoint with a key. */
struct link {
    /* under the process's lock */
    struct link *next;
    unsigned users;             /* streams that are not closed */
    bool left;                  /* its thread hung when a stream was closed */

    /* written at the start only */
    char *url, *keyfile;
    pthread_t thread;
    sem_t begun;                /* the sender has a table of its own */

    /* both */
    _Atomic bool refused, stop;
    _Atomic(modald_stream *) arrived;        /* the newest first, by their `next` */

    /* the sender's */
    modald_stream *streams[LINK_STREAMS];
    int slots;                  /* those in use are before it */
    modald_stream *named[NAMED];             /* by what the daemon names them */
    void *context, *socket, *monitor;        /* socket NULL: between two connections */
    char keys[KEYS][KEY_SIGNS + 1];          /* "": none */
    unsigned connections;       /* begun so far */
    unsigned failures;          /* of them without a handshake, though connected */
    bool ready, lost, warned;
    double begin_at, pause;     /* when the next connection begins; after which pause */
    double heard_at;            /* when the last message came */
    double moved_at;            /* when samples of a stream were taken last */
    double beat;                /* frames that were begun before it leave */
    bool fast;                  /* in this turn a frame of FRAME_ENOUGH was sent or taken */
    int parts_most;             /* frames that the daemon takes together; 0: none */
    struct together *making, *sent;          /* making NULL: none is begun */
    struct letter *letter;      /* of the one that is made; NULL: none was yet */
    double vain_until;          /* no close waits before: one did, and nothing moved */
    int64_t questions;          /* asked so far */
    int asked;                  /* of them without an answer */
    int start;                  /* the slot that is looked at first: others had their turn */
};

struct modald_stream {
    /* written at open only: both threads have this line */
    _Alignas(LINE) struct ring_page *page;
    double *ring;
    uint64_t slots, piece, pieces, near;     /* piece: slots of one; near: those there at open */
    size_t stride;              /* doubles of a slot: index, time, channels */
    unsigned forks;             /* of the process, when it was opened; CLOSED */
    int channels;
    double dt;

    /* the host's: nobody else reads it */
    _Alignas(LINE) uint64_t head;
    uint64_t end, index, cursor;             /* end: the head that wants room; cursor: its slot */

    /* both */
    _Alignas(LINE) _Atomic uint64_t free_pieces;
    unsigned char order[PIECES];             /* written by the host, before the head */
    _Alignas(LINE) _Atomic uint64_t dropped;
    _Atomic int verdict, stop;  /* stop: 1 close, 2 broken off */
    _Atomic bool finished, refused;
    _Atomic uint64_t acknowledged;
    _Atomic uint64_t spilled;
    _Atomic uint64_t released;  /* slots acknowledged or spilled */
    _Atomic unsigned estimate_version;       /* odd while it is written */
    _Atomic unsigned estimate_past;          /* the version of an epoch before; 0: none was */
    struct modald_estimate estimate;
    double resampling_error;
    char name[256], *names, *units, *options, *alarms, *url, *keyfile, *ring_file;
    char *run;                  /* attributes of the run, JSON */
    char spill_folder[400];
    double period, close_wait;
    long window_samples, window_hop;
    size_t ring_bytes;
    int ring_fd;                /* of a ring in a file: holds its lock; else -1 */
    struct link *link;
    modald_stream *next;        /* that arrived before it */
    sem_t begun;                /* the sender has it; its ring is there, or none can be */

    /* the sender's: what it asked */
    int slot;                   /* in its link */
    int asked;                  /* questions without an answer */
    bool opened, opening, closing, closed;
    bool flows;                 /* a frame was acknowledged since it was opened */
    double until;               /* of a stream that is closed: when it is given up; 0: it is not */
    double quiet_until;         /* nothing is asked before: the daemon said so */
    int64_t first_id;           /* what was asked before counts no more */
    int64_t open_id, close_id, events_id;
    double asked_at;
    char stream[128];           /* as the daemon names it */
    modald_stream *same;        /* the next in its place of `named` */
    uint64_t epoch, went_on;    /* went_on: the index behind the last sample acknowledged */
    size_t credit, flying;

    /* the sender's: its ring in memory */
    uint64_t given;             /* slots before it are the host's again, by whole pieces */
    uint64_t touched, recent;   /* pieces that were read, and since `rest_at` */
    double rest_at;

    /* the sender's: its frames */
    struct loans *loans;
    double *spare[LOANS];       /* not in use, the last one used last */
    int spares, spares_least;   /* least: since the others were given back */
    struct frame window[WINDOW], build;
    int first_frame, frames;    /* the window is a ring of its own */
    int retired;                /* frames acknowledged since spare ones were given back */
    uint64_t taken;             /* slots put into frames */
    double build_since;
    size_t frame_samples;
    struct point history[HISTORY];
    int points;
    uint64_t next_grid;
    double *rms, *sample;       /* a channel each: mean square so far; one resampled sample */
    uint64_t rms_count;

    /* the sender's: its spill file */
    int spill_fd;
    uint64_t spill_end, spill_read, spill_acknowledged, spill_most, spill_start;
    uint64_t damaged, torn;     /* samples of records passed over; bytes that were being written */
    char spill_path[512];
    bool spill_failed, warned;
    bool seal;                  /* the stream is to be closed at the end */
    char *open_text;            /* of a replay: the members of `open` as they were */
};

/* What a process has once: whoever reads or changes it holds the lock.  A child of the host begins
 * with neither a link nor a holder. */
static pthread_mutex_t process_lock;
static struct link *links;

/* Seconds of the monotonic clock. */
static double now(void);

/* Sleep for SECONDS, or until a signal. */
static void sleep_for(double seconds);

/* Count this process's forks from now on, once a process. */
static void watch_forks(void);

/* Is S closed, or a copy of its parent's in a child of the host?  Then nothing is done with it. */
static inline bool is_dead(const modald_stream *s);

/* WHAT about the stream NAME (NULL: of none) as one line on stderr. */
static void warn(const char *name, const char *what);

/* The same, once a stream; not where its link has said what is wrong. */
static void warn_once(modald_stream *s, const char *what);

/* The loans of a stream, SIZE bytes each, all of them spare; false: no memory. */
static bool loans_new(modald_stream *s, size_t size);

/* A spare one that no message of an old connection has still; NULL: there is none now. */
static double *loan_take(modald_stream *s);

/* It is spare again; NULL is none. */
static void loan_put(modald_stream *s, double *data);

/* The loan whose samples are at DATA. */
static struct loan *loan_of(double *data);

/* One holder less of LOANS; the last frees them.  NULL is none. */
static void loans_drop(struct loans *loans);

/* A message is done with DATA of the loans HINT, as libzmq says it. */
static void give_back(void *data, void *hint);

/* Bytes of COUNT samples. */
static size_t bytes_of(const modald_stream *s, uint64_t count);

/* Frame I of the window, the oldest first. */
static struct frame *frame_at(modald_stream *s, int i);
#endif
