/* pull.h - the input of a job from a daemon on another host, in pieces, into memory of no file */
#ifndef WORKER_PULL_H
#define WORKER_PULL_H
#include <stdint.h>
#include "base/error.h"
#include "worker/link.h"

/* Memory of pulled bytes; all zero: none. */
struct pulled { void *data; uint64_t bytes; };

/*
 * BYTES bytes, whose CRC-32C is CRC, for ATTEMPT of JOB; each piece comes with its own.  The link's
 * credit bounds what is under way.  MODAL_CORRUPT, MODAL_NO_MEMORY, what the daemon says of its own
 * disk; *OUT is then empty.
 */
enum modal_status pull_input(struct link *link, const char *job, int attempt, uint64_t bytes,
                             uint32_t crc, struct pulled *out, struct modal_error *err);
/* Give it back; all zero is nothing. */
void pull_done(struct pulled *pulled);

#endif
