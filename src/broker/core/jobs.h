/* jobs.h - the queue: jobs, what they await and who awaits them; for the files that own or
 * move them */
#ifndef BROKER_JOBS_H
#define BROKER_JOBS_H
#include "broker/core/state.h"

struct failure { enum modal_status status; char *message, *field, *detail; };

struct job {
    int64_t id;
    struct user *user;
    char *key, *options;                  /* options: NULL once it has ended */
    const char *kind;                     /* of the table of kinds */
    struct input *input, *output;
    uint8_t fingerprint[32], settings[32];
    int priority, max_attempts;
    int64_t run_limit_ns, deadline_ns, not_before_ns;
    enum job_state state, shown;          /* decided; committed */
    int attempts, shown_attempts, crashes;
    int64_t submitted_ns, started_ns, finished_ns, cpu_ns;
    struct failure *failure;
    uint64_t result_bytes;
    struct blob *document;                /* while the cache keeps it */
    int64_t source;                       /* cached: the job whose result it shows; 0: its own */
    int shares;                           /* jobs that show this one's result */
    bool hidden;                          /* deleted, kept for those */
    bool cached, committed, ready, deleting, indexed;
    int8_t kind_row;                      /* of the table of kinds; -1: it has none of that name */
    struct transaction *last;             /* the latest that is not committed */
    struct after *asks;                   /* to be answered by the next transaction */
    enum ending ending;
    int slot;                             /* of the worker that has it; -1 */
    char *progress, *stderr_text;
    struct wait *waits;
};

struct wait {
    struct wait *next, **link;            /* of the job's */
    struct wait *beside, **beside_link;   /* of the connection's */
    uint64_t number;
    struct job *job;
    struct reply reply;
    bool result;
    struct user *user;
    char key[KEY_TEXT];
};

/* A connection that waits for jobs, or for bytes that are read. */
struct asker { uint64_t peer; struct wait *waits; int reads; };

/* who waits asks within so many ends; 64 inline documents are 4 MiB */
enum { DOCUMENTS_KEPT = 64 };

enum { JOB_KINDS_MOST = 16 };             /* more than the table has */

struct jobs {
    struct map all, results;              /* by id; those whose result may answer again */
    int64_t next_job;
    int64_t state_counts[JOB_STATE_COUNT];
    int64_t kind_counts[JOB_KINDS_MOST];  /* by row, of jobs that are not hidden */
    /* bytes of results, and of those whose deletion is on its way to the disk */
    int64_t result_total, result_leaving;
    /* ids in the order of ending, for retention */
    int64_t *ended; size_t ended_first, ended_count, ended_room;
    bool retaining;                       /* the next step of retention has its timer */
    /* jobs whose documents are kept */
    struct job *document_ring[DOCUMENTS_KEPT]; int document_at;
    struct map waits, askers;
    uint64_t next_wait;
    size_t waits_past;                    /* timers of waits that have ended */
    /* the latest kind and options, and their hash */
    struct { char *text; uint8_t settings[32]; } asked;
    struct arena *kinds;                  /* names of kinds this build no longer knows */
};
#endif
