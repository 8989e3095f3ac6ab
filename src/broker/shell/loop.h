/* loop.h - the daemon's one loop, and what it holds; for the files that begin and end it */
#ifndef BROKER_LOOP_H
#define BROKER_LOOP_H
#include "broker/shell/config.h"
#include "broker/shell/daemon.h"
#include "broker/shell/door.h"
#include "broker/shell/peers.h"
#include "broker/shell/pool.h"
#include "broker/shell/queue.h"
#include "broker/shell/zap.h"
#include <time.h>

struct daemon {
    struct config *config;
    config_again *again;
    void *again_context;
    struct core *core;
    struct ledger *ledger;
    struct ledger_thread *ledger_thread;
    struct spool_threads *spool;
    struct done_queue done;
    struct transaction *gathered, **gathered_end;   /* on their way to the ledger, as a group */
    bool gathers;                                   /* more may come to it before it goes */
    struct task *tasks;                           /* that are done, and the core has not heard of */
    struct pool pool;
    struct door door;
    struct peers clients, workers, remotes;       /* remotes: workers elsewhere */
    void *context, *client_socket, *worker_socket, *remote_socket, *zap;   /* remote: or NULL */
    int signals;
    char worker_endpoint[PATH_ROOM], worker_folder[PATH_ROOM], program[PATH_ROOM];
    bool stop, terminating;
    int status;
    int64_t trim_ns;              /* when rest begins, at which memory is given back; 0: nothing
                                   * happened since it began */
    int64_t next_trim_ns;         /* when it is given back at work */
    int64_t watchdog_ns, next_ping_ns, drain_until_ns, next_flush_ns, next_metrics_ns,
        next_strangers_ns, flush_wait_ns;
    struct zap_refused strangers;  /* not told yet */
    int64_t next_ended_ns;         /* when connections that were ended may be told of again */
    long ended_told;               /* of intake_ended */
    int64_t next_hear_ns;          /* when connections that are held are read again */
    uint64_t taken, ended_until;   /* messages; by then all of those whose connections have ended
                                      are taken */
};

/* Serve until D->stop, which leaves the exit status in D->status. */
void loop_run(struct daemon *d);
/* Do what the core asked for, which is nobody's afterwards. */
void loop_carry_out(struct daemon *d, const struct actions *actions);
/* ns of one clock as it is now; of a wall clock from 1970 to 2116, beyond which it stands still. */
int64_t loop_clock_ns(clockid_t clock);
/* Both clocks as they are now. */
struct moment loop_now(void);
/* One line of logfmt, escaped by base/log.h, with its time; only `level=info` may wait
 * for others. */
void loop_log(const char *format, ...) __attribute__((format(printf, 1, 2)));
/* TEXT as such a line: it is written before the answer that it is about, unless it is one of the
 * many. */
void loop_write_line(const char *text);
/* ERR as such a line about EVENT. */
void loop_log_error(const char *event, const struct modal_error *err);
/* What stderr takes of them, and what it did not when it takes again. */
void loop_flush_log(void);
#endif
