/* slots.h - the pool: worker processes, those elsewhere too, and what each has; for the files that
 * drive them */
#ifndef BROKER_SLOTS_H
#define BROKER_SLOTS_H
#include "broker/core/state.h"

enum slot_state { SLOT_EMPTY, SLOT_STARTING, SLOT_IDLE, SLOT_TAKEN, SLOT_BUSY, SLOT_KILLED };

/* What is known of a worker on another host, whom no process of ours is. */
struct remote {
    int slot;
    uint64_t peer;                        /* its connection */
    bool heard;                           /* false: nothing of it is believed any more */
    bool leaving;                         /* it takes no job any more */
    char name[NAME_MOST], node[NAME_MOST], key[KEY_TEXT];
    uint64_t memory;                      /* bytes that an input of it may have */
    int64_t end_ns;                       /* mono, when its time is over; INT64_MAX: never */
    int pulls;                            /* INPUTs of its job without their CHUNK */
    uint64_t asked;                       /* bytes of them all, since */
    int64_t asked_ns;                     /* mono, the first of them */
    double pull_s;                        /* that its job's large input took to come; 0: not here */
    int64_t way_ns, way_told_ns;          /* of its last live window; mono, when; 0: had none */
    char *said;                           /* its last STDERR; NULL: none */
};

/* Seconds of work that came due, each counted less the longer ago; mono, until when. */
struct demand { double s; int64_t at_ns; };

/* Streams that wait, first whose window is left out first; what their windows are expected to
 * take. */
struct waiting { struct heap streams; double cost_s; };

struct slot {
    enum slot_state state;
    bool watched;                         /* a TIMER_LEASE is set */
    struct job *job;
    int attempt;
    int64_t heard_ns, started_ns;         /* mono */
    int64_t jobs;                         /* begun by this process, live windows not counted */
    int quick_deaths;                     /* in a row, without a job: starting again is put off */
    char *document; size_t document_size, document_total;
    int parts;                            /* PARTs that wait for their GO */
    bool late_told;                       /* something late was logged since the latest start */
    struct input *output;                 /* signals on their way */
    bool finishing;                       /* DONE has come; the output is being sealed */
    bool ready;                           /* READY has come meanwhile */
    /* expected_s: what its user's share was charged at the start */
    double cpu_s, expected_s;
    /* whose window it has instead of a job; behind it, in their order, those that it has ahead */
    struct stream *live, **live_end;
    int ahead; double ahead_s;            /* how many these are, and what they are to take */
    struct waiting due[2];                /* as slots.due, of streams whose window it has */
    struct demand demand;                 /* of all of these */
    double lead;                          /* windows of each beyond what is fair (window_turns.c) */
    int64_t latest;                       /* of these, the stream that came last */
    uint64_t process;                     /* counts the slot's processes */
    struct remote *remote;                /* NULL: its worker is a process of ours */
};

struct slots {
    struct slot at[SLOTS_MOST + REMOTES_MOST];
    int count;                            /* of this host's */
    int remotes;                          /* slots behind SLOTS_MOST that are, or were, in use */
    int remotes_idle;
    struct map peers;                     /* struct remote by peer, those that are heard */
    double link_bytes_s;                  /* at which a large input went elsewhere last, */
    int64_t link_ns;                      /* mono, at that time; 0: none did */
    int windows;                          /* begun: their attempts have numbers of their own */
    /* Streams whose windows are due and that no worker has; at [round % 2] who had none in this
     * round of turns.  In all such lists there are `due_count`, and `due_now` of this round. */
    struct waiting due[2]; int due_count, due_now;
    int64_t round, turns;                 /* turns: that have been waited for so far */
    int64_t windows_skipped;
    /* had of workers by windows and by jobs since both have waited for one, ns */
    int64_t windows_ns, jobs_ns;
};

/* The slot of the worker elsewhere whose connection is PEER; -1: none is heard. */
int slot_of_peer(const struct core *c, uint64_t peer);
/* A slot for the worker of PEER, which is STARTING; NULL: there is none. */
struct remote *slot_join(struct core *c, uint64_t peer);
/* The worker elsewhere is gone from SLOT, which is EMPTY. */
void slot_leave(struct core *c, int slot);
/* S, of SLOT, becomes IDLE, or what it becomes then. */
void slot_set(struct core *c, int slot, enum slot_state state);
/* Is S neither at work nor at rest?  Nothing but READY is a sign of life then: else who sends BEAT
 * and asks for nothing keeps the slot for good. */
bool slot_owes_ready(const struct slot *s);
/* INPUT of LENGTH bytes came from the worker elsewhere in SLOT: the last one of a large input says
 * how fast the link is. */
void slot_pulled(struct core *c, int slot, uint64_t length);
/* Seconds of work, without the way there, that the job of SLOT has taken on each byte of its large
 * input; 0: it has none, or not all of it. */
double slot_work_s_byte(const struct core *c, int slot);
/* The live window of SLOT is back: all but CPU_S of its time was the way there and back. */
void slot_window_back(struct core *c, int slot, double cpu_s);
/* How long it may be silent. */
int64_t slot_lease_ns(const struct core *c, int slot);
#endif
