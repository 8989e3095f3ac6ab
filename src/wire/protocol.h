/* protocol.h - the protocol's names, and every size and count of proto/PROTOCOL.md, section 8; each
 * is tested by tests/unit/wire/test_wire.c */
#ifndef WIRE_PROTOCOL_H
#define WIRE_PROTOCOL_H

#define WIRE_VERSION   "MODALD1"     /* frame 0 between clients and daemon */
#define WIRE_WORKER    "MODALW1"     /* frame 0 between workers and daemon */

enum {
    WIRE_FRAMES_LEAST    = 3,                 /* version, verb, header */
    WIRE_FRAMES_MOST     = 8,                 /* those and five of the body */
    WIRE_VERB_MOST       = 16,                /* bytes: twice what the longest has */
    WIRE_HEADER_MOST     = 65536,             /* bytes: WIRE_NAME_MOST for 256 channels */
    WIRE_WORKER_HEADER_MOST = 1048576,        /* between daemon and worker: RUN joins the headers
                                                 of UPLOAD and SUBMIT */
    WIRE_PROGRESS_MOST   = 4096,              /* bytes as JSON: each subscriber is sent it */
    WIRE_SAID_MOST       = 8192,              /* of a worker's header at any time: a progress and
                                                 its job */
    WIRE_SAID_LONG_MOST  = 2 * 1048576,       /* of all its longer ones after a RUN but
                                                 PROGRESS: what signals there are, an error */
    WIRE_BODY_MOST       = 1048576,           /* one body frame; chosen: four chunks */
    WIRE_ID_MOST         = 64,                /* bytes: a UUID's 36, or a name and a count */
    WIRE_PARTS_MOST      = 4,                 /* of a worker, without their GO */
    WIRE_PULLS_MOST      = 4,                 /* INPUTs of a worker elsewhere without CHUNK: at
                                                 10 ms to and fro 400 MB/s */
    WIRE_KEY_MOST        = 128,               /* bytes: two SHA-256 in hexadecimal */
    WIRE_INLINE_MOST     = 65536,             /* an input in SUBMIT's own body; chosen: 8192
                                                 doubles, sent again whole if need be */
    WIRE_JOBS_MOST       = 256,               /* in SUBMITS: 256 bytes of its header to each */
    WIRE_PUSHES_MOST     = 512,               /* in one message: 128 bytes of its header to each */
    WIRE_CHUNK_MOST      = 262144,            /* bytes, chosen: 2 ms at 1 Gbit/s for who waits
                                                 behind */
    WIRE_CHANNELS_MOST   = 65536,             /* a row of 512 KiB fits one body frame */
    WIRE_NAME_MOST       = 256,               /* bytes of a channel's name, of its units; chosen:
                                                 three lines of a terminal */
    WIRE_ATTRIBUTES_MOST = 16384,             /* bytes, as JSON: a quarter of the header */
    WIRE_SCENE_MOST      = 16777216,          /* bytes of a scene's text: three dense matrices of
                                                 480 dofs, 24 a number of 17 digits */
    WIRE_DOCUMENT_MOST   = 67108864,          /* bytes, chosen: four of the largest scenes; who
                                                 parses it takes some ten times as many */
    WIRE_STDERR_MOST     = 65536,             /* bytes kept: as much as a pipe holds */
    WIRE_PAGE_MOST       = 1000,              /* jobs in an answer to LIST: of 1 KiB each they
                                                 fill a body frame */
    WIRE_PAGE_DEFAULT    = 100,               /* chosen: a screen or two */
    WIRE_TIMEOUT_MOST    = 3600,              /* s, of WAIT; chosen: nobody who is gone waits
                                                 for longer than an hour */
    WIRE_TIMEOUT_DEFAULT = 30,                /* s, chosen: who waits hears twice a minute that
                                                 the daemon lives */
    WIRE_UPLOADS_MOST    = 64,                /* open, a user; chosen: one for each file of a
                                                 test on as many machines */
    WIRE_WAITS_MOST      = 4096,              /* a user; chosen: as many as streams of his */
    WIRE_READS_MOST      = 4096,              /* a user: each wait that ends may be one */
    WIRE_SUBSCRIPTIONS_MOST = 4160,           /* a user: one a stream of his, and 64 beside */
    WIRE_PRIORITY_DEFAULT = 100,              /* chosen: room on both sides */
    WIRE_ATTEMPTS_MOST   = 10,                /* of a job, chosen: a worker may die in each */
    WIRE_ATTEMPTS_DEFAULT = 3,                /* chosen: who kills three workers is to blame */
};

/* A worker's exit status: there was no memory for a document of its job. */
enum { WIRE_WORKER_NO_MEMORY = 3 };

#define WIRE_INTEGER_MOST 9007199254740992.0  /* 2^53 */

#endif
