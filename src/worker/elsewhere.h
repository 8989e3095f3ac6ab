/* elsewhere.h - a worker's way to a daemon on another host: keys, JOIN and its answer
 *
 * All before the walls go up (confine.h): what follows on the connection opens nothing.
 */
#ifndef WORKER_ELSEWHERE_H
#define WORKER_ELSEWHERE_H
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"
#include "wire/keyfile.h"

struct elsewhere_options {
    struct keyfile keys;          /* until elsewhere_guard */
    char name[64], node[64];      /* for people: what JOIN says of this worker and its host */
    uint64_t memory;              /* bytes that an input may have */
};

/* What WELCOME says. */
struct elsewhere {
    int lease_ms;                 /* BEAT at least so often */
    int credit, chunk;            /* INPUTs without their CHUNK; bytes of one */
};

/* HOST of the endpoint FROM, tcp://HOST:PORT, as a number, into TO[SIZE]: names are looked up while
 * files can be read.  MODAL_BAD_INPUT: another form; MODAL_NO_SERVER: no such host. */
enum modal_status elsewhere_find(const char *from, char *to, size_t size, struct modal_error *err);
/* Name and node of this process into OUT: the host's, and Slurm's where it runs there. */
void elsewhere_name(struct elsewhere_options *out);
/* The keys of PATH, the daemon's among them, into OUT: read while files can be.
 * MODAL_BAD_INPUT. */
enum modal_status elsewhere_keys(const char *path, struct elsewhere_options *out,
                                 struct modal_error *err);
/* The keys of OPTIONS for DEALER, which connects afterwards; here they are wiped. */
enum modal_status elsewhere_guard(void *dealer, struct elsewhere_options *options,
                                  struct modal_error *err);
/* A socket of CONTEXT that is readable once DEALER's connection has ended or was refused. */
enum modal_status elsewhere_monitor(void *context, void *dealer, void **out,
                                    struct modal_error *err);
/* JOIN on DEALER, with LEFT_S seconds left (below 0: no limit), and the answer within WAIT_MS.
 * MODAL_DENIED: this key is no worker's, MODAL_BAD_VERSION, MODAL_BUSY, MODAL_NO_SERVER. */
enum modal_status elsewhere_join(void *dealer, void *monitor,
                                 const struct elsewhere_options *options, double left_s,
                                 int wait_ms, struct elsewhere *out, struct modal_error *err);

#endif
