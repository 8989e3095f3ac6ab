/* confine.h - what a worker may still do: limits, another user, and no way out
 *
 * In this order: confine_limits, confine_files (before there are threads), then the connection, then confine_user,
 * confine_calls.  After that a job can compute, read files of the spool, and speak on the connection; it cannot open a
 * socket, start a program, write or make a file, read other files (where the kernel has Landlock), or signal others.
 */
#ifndef WORKER_CONFINE_H
#define WORKER_CONFINE_H
#include <stdbool.h>
#include <stdint.h>
#include "modal/error.h"

struct confine_options {
    uint64_t memory;       /* bytes of address space; 0: no limit */
    const char *user;      /* name to run under, where we are root; NULL: stay */
    const char *data;      /* the folder whose files may be read; NULL: no restriction of reading */
    bool calls;            /* filter system calls */
};

/* Niceness 10, no core files, 256 descriptors, no file growth, the memory limit; end with the parent, in a process group. */
enum modal_status confine_limits(const struct confine_options *options, struct modal_error *err);

/* Landlock: read-only, below data, /proc, /sys and /usr only.  *DONE false where the kernel has none. */
enum modal_status confine_files(const struct confine_options *options, bool *done, struct modal_error *err);

/* Become options->user for good; groups are left to those of the daemon's own, so that the spool's group may read. */
enum modal_status confine_user(const struct confine_options *options, struct modal_error *err);

/* Filter the system calls of all threads: what is not on the list fails with EPERM.  *DONE false under a sanitizer. */
enum modal_status confine_calls(bool *done, struct modal_error *err);

#endif
