/* descriptors.h - the descriptors of inputs, which the daemon hands to a worker that cannot open
 * files itself
 *
 * Descriptor CONFINE_INPUTS is one end of a pair of sockets that was made with the process.  For
 * each job whose input is no part of RUN a message comes by it: `JOB ATTEMPT` as text, and one
 * descriptor.  That the other end is gone means that the daemon is.
 */
#ifndef WORKER_DESCRIPTORS_H
#define WORKER_DESCRIPTORS_H
#include "base/error.h"

/* Check that the socket is there and that its maker, our parent, lives:
 * MODAL_NO_SERVER where it has ended already. */
enum modal_status descriptors_open(struct modal_error *err);

/* The descriptor for this attempt of JOB, to be closed by the caller; those for others that came
 * before are closed. MODAL_IO: none came. */
enum modal_status descriptors_receive(const char *job, int attempt, int *out,
                                      struct modal_error *err);

#endif
