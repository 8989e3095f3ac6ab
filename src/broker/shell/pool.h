/* pool.h - worker processes: started by posix_spawn in groups of their own,
 * their stderr kept, ended by SIGKILL
 *
 * Each has one end of a pair of sockets as its descriptor 3: by it come the files that it cannot
 * open itself, and its end is ours.
 */
#ifndef BROKER_POOL_H
#define BROKER_POOL_H
#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>
#include "broker/core/state.h"

enum { STDERR_KEPT = 65536 };   /* as much as a pipe holds: the last words of what died at once */

struct process {
    pid_t pid;                  /* 0: none */
    int stderr_fd;              /* read end; -1 */
    int inputs;                 /* our end of its pair; -1 */
    char *tail;                 /* the last STDERR_KEPT bytes */
    size_t tail_size;
    uint64_t peer;              /* its connection, once it said READY; 0 */
};

struct pool {
    struct process slots[SLOTS_MOST];
    const char *program;
    const char *endpoint, *data, *user;
    int64_t memory;
    bool sandbox;
};

/* Start a process for SLOT; false: it could not be started (errno). */
bool pool_spawn(struct pool *pool, int slot);
/* End its whole group; the exit is seen by pool_reap. */
void pool_kill(struct pool *pool, int slot);
/* All groups, and wait for them. */
void pool_kill_all(struct pool *pool);
/* Hand DESCRIPTOR, which stays ours, to the process of SLOT, named by TEXT.  Where it takes nothing
 * in, it finds nothing. */
void pool_hand(struct pool *pool, int slot, const char *text, int descriptor);
/* Take in what SLOT wrote to stderr; false: it closed it. */
bool pool_read(struct pool *pool, int slot);
/* A process that ended: its slot, status and the text it left (the pool's until the slot is
 * started again); -1: none. */
int pool_reap(struct pool *pool, int *status, const char **text);
/* The slot of process PID; -1: none of ours. */
int pool_slot_of_pid(const struct pool *pool, pid_t pid);
/* The slot whose worker's connection is PEER; -1: none. */
int pool_slot_of_peer(const struct pool *pool, uint64_t peer);
/* The worker program: beside the daemon, or in ../libexec/modald; false: not found. */
bool pool_find_program(char path[4096]);
#endif
