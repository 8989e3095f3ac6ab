/* queue.h - hand-over between the loop and its threads: a locked list, and a descriptor that wakes
 * the loop */
#ifndef BROKER_QUEUE_H
#define BROKER_QUEUE_H
#include <pthread.h>
#include <stdbool.h>
#include "broker/core/core.h"

/* What threads give back to the loop. */
struct done_queue {
    pthread_mutex_t mutex;
    struct transaction *transactions, **transactions_end;
    struct task *tasks, **tasks_end;
    bool pinged;                 /* the ledger thread answered a ping */
    bool stuck;                  /* it has no room for what must pass */
    bool fatal;                  /* stable storage failed: nothing may be acknowledged any more */
    struct modal_error error;    /* why */
    int wake;                    /* eventfd; readable while there is something */
};

/* Empty, with its descriptor; false: there is none (errno). */
bool done_open(struct done_queue *queue);
/* It must be empty. */
void done_close(struct done_queue *queue);
/* The list FIRST, committed or refused, is the loop's again. */
void done_transactions(struct done_queue *queue, struct transaction *first);
/* TASK is the loop's again. */
void done_task(struct done_queue *queue, struct task *task);
/* The ledger's thread lives. */
void done_ping(struct done_queue *queue);
/* What must pass waits for room on the disk. */
void done_stuck(struct done_queue *queue);
/* Stable storage failed with ERR: the loop ends. */
void done_fatal(struct done_queue *queue, const struct modal_error *err);
/* Everything, in order; the lists are the caller's. */
void done_take(struct done_queue *queue, struct transaction **transactions, struct task **tasks,
               bool *pinged, bool *stuck, bool *fatal);

/* The ledger's thread: transactions in order, those that wait together committed together. */
struct ledger_thread;
/* LEDGER, DIR and DONE are borrowed, and DIR nobody writes, until it is stopped; NULL: no thread
 * could be started. */
struct ledger_thread *ledger_thread_start(struct ledger *ledger, const char *dir,
                                          struct done_queue *done);
/* The list FIRST is the thread's, until it lies in DONE; what is put at once is one group, as far
 * as a group goes. */
void ledger_thread_put(struct ledger_thread *thread, struct transaction *first);
/* done_ping answers, if it lives. */
void ledger_thread_ping(struct ledger_thread *thread);
/* Finish what it has, end, and free; the ledger stays open. */
void ledger_thread_stop(struct ledger_thread *thread);

/* The spool's threads: tasks in any order, of each turn one before the next has its. */
struct spool_threads;
/* COUNT of them, and one that seals streams; DIR and DONE are borrowed, and DIR nobody writes,
 * until they are stopped.  NULL: none could be started. */
struct spool_threads *spool_threads_start(const char *dir, int count, struct done_queue *done);
/* TASK is theirs, until it lies in DONE. */
void spool_threads_put(struct spool_threads *threads, struct task *task);
/* Finish what they have but for streams that are not sealed yet, end, and free; accepts NULL. */
void spool_threads_stop(struct spool_threads *threads);
#endif
