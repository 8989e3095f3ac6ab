/* serve.h - a worker's jobs: one RUN after the other, each answered by DONE or FAILED */
#ifndef WORKER_SERVE_H
#define WORKER_SERVE_H
#include "worker/link.h"

struct serve_options {
    int jobs_most;       /* end after so many, for a fresh process; 0: no limit */
    uint64_t memory;     /* the limit that this process has, for the error of a job that met it;
                            0: none */
};

/*
 * Say READY, run what comes, until STOP (MODAL_OK) or the link breaks.  An input is mapped from the
 * descriptor that came for it (descriptors.h), or taken from the message, and checked against its
 * CRC-32C.  Every failure of a job, MODAL_CORRUPT of its input among them, is FAILED's error; what
 * is returned is the link's.
 */
enum modal_status serve(struct link *link, const struct serve_options *options,
                        struct modal_error *err);
#endif
