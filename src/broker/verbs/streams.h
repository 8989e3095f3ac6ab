/* streams.h - what is known of a stream; for the files that own it */
#ifndef BROKER_STREAMS_H
#define BROKER_STREAMS_H
#include "broker/core/alarms.h"
#include "broker/core/slots.h"
#include "broker/verbs/verbs.h"

/* Samples that wait until those before them are compared with the file. */
struct push {
    struct push *next;
    struct reply reply;
    uint64_t first, count;
    uint32_t crc;
    struct blob *body;
    const char *data;        /* of the samples, in the body */
    enum sameness same;      /* as those of their indices that are there */
};

/* Samples without a gap between them. */
struct segment { uint64_t epoch, first, count; };

/* The live window of a stream, and where it is; see windows.c. */
struct window {
    uint64_t samples, hop;                /* 0: the stream has none */
    uint64_t next;                        /* the index at which one is due */
    bool first;                           /* that is the first one of samples without a gap */
    uint64_t waits_from;                  /* what was durable when it began to wait for a worker */
    char *options;
    char *recent;                         /* the last durable ones, by index % samples */
    struct alarms *alarms;                /* NULL: none */
    char *tracks;                         /* as the latest worker told them; NULL: nothing yet */
    bool running;                         /* a worker has it, or had it before it is told dead */
    int attempt;                          /* its number, for that worker */
    bool anew;                            /* that worker has none of its samples of before */
    /* s of a processor, 0: not known: of one gone on with, on average; of the last anew; for this
     * one */
    double cost_s, anew_s, expected_s;
    struct demand demand;                 /* counted at its worker, too */
    bool queued;                          /* among those that wait for a worker */
    struct stream *behind;                /* of those that its worker has */
    int64_t late_ns;                      /* mono, when the next will be due, and it is left out */
    uint64_t paced; int64_t paced_ns;     /* what was durable when it waited before this time */
    int64_t round;                        /* of turns, in which it had its latest window */
    uint64_t lost;                        /* left out since its worker had the first */
    uint64_t skipped;                     /* left out since the one told last */
    uint64_t skipped_all;                 /* and since the daemon began with the stream */
    /* of the one told last: its verdict, NULL where it had none, its epoch and last sample */
    const char *verdict; uint64_t told_epoch, told;
    uint64_t here;                        /* no sample before this one is in `recent` */
    bool reading;                         /* samples of before are under way to it */
    uint64_t epoch, from, to;             /* of the one that runs, or ran last */
    int slot; uint64_t process;           /* the worker that has its samples up to `to`; -1: none */
    int died;                             /* workers under the present one */
    bool alone;                           /* it was with one that died: no other beside it */
};

/* Samples of unknown number; see streams.c. */
struct stream {
    struct stream *next_stream;
    int64_t id;
    struct user *user;
    char *name, *header;                  /* header: what open said, as JSON */
    size_t input_length;                  /* of it what is said of samples, before `window` */
    uint64_t channels;
    double dt, period;
    /* of the present epoch: its first sample, the next to come */
    uint64_t epoch, begin, next;
    /* the next sample to be committed, and the epoch that is committed so far */
    uint64_t durable_epoch, durable;
    uint64_t run_from;                    /* first sample after the last gap */
    /* of all epochs, as they came */
    struct segment *segments; size_t segment_count, segment_room;
    uint64_t bytes;                       /* of all segments: the end of its file */
    uint64_t (*gaps)[2]; size_t gap_count;
    /* bytes of its gaps, which its user is charged like samples */
    uint64_t missing;
    /* of each sample from `crc_first` on; 0: not known */
    uint32_t *crcs; uint64_t crc_first, crc_count, crc_room;
    struct push *held, **held_end;        /* in their order; a task compares the first */
    uint64_t held_reach;                  /* the end of the farthest of them */
    bool comparing;
    int64_t in_flight;                    /* bytes */
    struct transaction *last;
    struct after *askers;                 /* who closed it */
    struct input *sealed;                 /* until it is closed */
    uint8_t sha256[32];                   /* of its batch, once it is closed; where it has one */
    int64_t batch;                        /* its number, once its row is given away */
    bool closing, closed, broken, has_batch;
    /* samples were refused for want of disk, and others are under way behind them */
    atomic_bool fence;
    bool resumes;                         /* the refused ones are to come again before any other */
    bool slowed;                          /* and were refused for a limit, not for want of disk */
    int64_t touched_ns;                   /* UTC: opened, or samples came */
    int64_t closed_ns, commits_awaited;
    struct window window;
};

/* Bytes of one sample of all its channels. */
static inline uint64_t sample_bytes(const struct stream *s)
{
    return 8 * s->channels;
}

/* Whether all that came is committed. */
static inline bool is_durable(const struct stream *s)
{
    return s->durable_epoch == s->epoch && s->durable == s->next;
}
#endif
