/* link.h - a worker's line to the daemon: messages of proto/PROTOCOL.md, section 13, and a
 * heartbeat of its own
 *
 * A thread owns the DEALER socket, says BEAT every second whether the job's thread works or not,
 * and passes messages both ways.  The job's thread alone calls the functions below.
 *
 * To a daemon on another host it joins (elsewhere.h) and leaves (leave.h) as well: that thread says
 * LEAVE in place of READY, gives a job back by RELEASE, sends what stderr says (words.h), and ends
 * the process where the daemon stops it in its work or the connection ends.  SIGTERM and SIGUSR1
 * ask it to leave.
 */
#ifndef WORKER_LINK_H
#define WORKER_LINK_H
#include <stdint.h>
#include "base/error.h"
#include "base/json.h"
#include "wire/frame.h"
#include "worker/elsewhere.h"
#include "worker/leave.h"

struct link;

struct link_options {
    const char *endpoint;         /* "ipc:///..." or "tcp://..." */
    int beat_ms, connect_ms;      /* 0: 1000 and 10000 */
    int watched;                  /* a descriptor whose other end is the daemon's: its end is
                                     this process's; 0: none */
    struct elsewhere_options *elsewhere;   /* NULL: the daemon is on this host */
    struct leave_options leave;
};

/* Connect, and wait until the connection stands; its threads run from then on.  MODAL_NO_SERVER,
 * MODAL_NO_MEMORY. */
enum modal_status link_open(const struct link_options *options, struct link **out,
                            struct modal_error *err);
/* Let messages under way go out for a second at most, and end. */
void link_close(struct link *link);

/* Of a daemon on another host: INPUTs without their CHUNK, and bytes of one, at most. */
int link_credit(const struct link *link);
int link_chunk(const struct link *link);

/* What BEAT says from now on; JOB NULL: idle. */
void link_working(struct link *link, const char *job, int attempt);

/* Send VERB with HEADER (freed here in every case) and a body (DATA may be NULL: none). */
enum modal_status link_send(struct link *link, const char *verb, cJSON *header, const void *data,
                            size_t length, struct modal_error *err);

/* The same, but it waits here, behind others, for the next link_send() or link_let_go(): what goes
 * together wakes the threads on its way, and the daemon, once. */
enum modal_status link_keep(struct link *link, const char *verb, cJSON *header, const void *data,
                            size_t length, struct modal_error *err);
/* What was kept is sent. */
enum modal_status link_let_go(struct link *link, struct modal_error *err);
/* Since when the first of what is kept has waited, in ms; 0: nothing is. */
int64_t link_kept_ms(const struct link *link);
/* Has the daemon said something that link_receive() has not told yet? */
bool link_waits(struct link *link);

/* A message from the daemon; its frames are the link's until the next call.  Waits for ever. */
enum modal_status link_receive(struct link *link, const struct wire_message **out,
                               struct modal_error *err);

#endif
