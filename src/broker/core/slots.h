/* slots.h - the pool: worker processes and what each has; for the files that drive them */
#ifndef BROKER_SLOTS_H
#define BROKER_SLOTS_H
#include "broker/core/state.h"

enum slot_state { SLOT_EMPTY, SLOT_STARTING, SLOT_IDLE, SLOT_TAKEN, SLOT_BUSY, SLOT_KILLED };

struct slot {
    enum slot_state state;
    bool watched;                         /* a TIMER_LEASE is set */
    struct job *job;
    int attempt;
    int64_t heard_ns, started_ns;         /* mono */
    int64_t jobs;                         /* begun by this process */
    int quick_deaths;                     /* in a row, without a job: starting again is put off */
    char *document; size_t document_size, document_total;
    int parts;                            /* PARTs that wait for their GO */
    bool late_told;                       /* something late was logged since the latest start */
    struct input *output;                 /* signals on their way */
    bool finishing;                       /* DONE has come; the output is being sealed */
    bool ready;                           /* READY has come meanwhile */
    /* expected_s: what its user's share was charged at the start */
    double cpu_s, expected_s;
    struct stream *live;                  /* whose window it has instead of a job */
    uint64_t process;                     /* counts the slot's processes */
};

struct slots {
    struct slot at[SLOTS_MOST];
    int count;
    int windows;                          /* begun: their attempts have numbers of their own */
    /* streams whose windows are due; up to `round_end` who had none in this round of turns */
    struct stream *due, **due_end; int due_count;
    struct stream **round_end; int64_t round;
    int64_t windows_skipped;
    /* had of workers by windows and by jobs since both have waited for one, ns */
    int64_t windows_ns, jobs_ns;
};
#endif
