/* confine.h - what a worker may still do: limits, another user, and no way out
 *
 * In this order: confine_limits, confine_files (before there are threads), then the connection,
 * then confine_user, confine_calls.  After that a job can compute, take in descriptors of inputs by
 * CONFINE_INPUTS, and speak on the connection; it cannot open a socket, start a program, write or
 * make a file, read files but those of the system that computing needs (where the kernel has
 * Landlock), signal others, or change limits, its own or others'.
 */
#ifndef WORKER_CONFINE_H
#define WORKER_CONFINE_H
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include "base/error.h"

enum { CONFINE_INPUTS = 3 }; /* the descriptor by which others may come in; see descriptors.h */

struct confine_options {
    uint64_t memory;       /* bytes of its own: the input, which is mapped, is none; 0: no limit.
                              None under a sanitizer. */
    const char *user;      /* name to run under, where we are root; NULL: stay */
    const char *data;      /* the daemon's folder, of which nothing may be read; NULL: no
                              restriction of reading */
    bool calls;            /* filter system calls */
    bool elsewhere;        /* the daemon is on another host: it is not our parent, whose group we
                              stay in, and nobody else keeps what stderr says */
};

/* Not a child of the daemon's: the end of the parent is its own again. */
enum modal_status confine_survive(struct modal_error *err);

/* The end of the parent is this process's; asked again by what clears it.  The parent may have
 * ended before: see descriptors_open. */
enum modal_status confine_death(struct modal_error *err);

/* Niceness 10, no core files, 256 descriptors, no file growth, the memory limit, half of the user's
 * threads; end with the parent, in a process group. */
enum modal_status confine_limits(const struct confine_options *options, struct modal_error *err);

/* Landlock: read-only, below /proc/self, /sys and /usr/lib only.
 * *DONE false where the kernel has none. */
enum modal_status confine_files(const struct confine_options *options, bool *done,
                                struct modal_error *err);

/* Become options->user for good, without other groups than its own. */
enum modal_status confine_user(const struct confine_options *options, struct modal_error *err);

/* Filter the system calls of all threads: what is not on the list fails with EPERM.  *DONE false
 * under a sanitizer. */
enum modal_status confine_calls(bool *done, struct modal_error *err);

/* Where the kernel has no Landlock, ahead of confine_calls: no file is opened any more,
 * for reading neither. */
enum modal_status confine_opening(bool *done, struct modal_error *err);

/* That list, a line each: `name`, or `name: what of it`. */
void confine_print(FILE *out);

#endif
