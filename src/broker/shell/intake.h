/* intake.h - what a connection sends, before libzmq reads it: no name of its own choosing, and no
 * more than messages can hold */
#ifndef BROKER_INTAKE_H
#define BROKER_INTAKE_H
#include <stdbool.h>
#include <stdint.h>

/* Whole messages of a connection that may wait for the loop: ZMQ_RCVHWM. */
enum { INTAKE_WAITING = 16 };

/* FD is a connection just accepted; nothing was read of it yet.  LISTED: it is silent until its
 * handshake is over. */
void intake_begin(int fd, bool listed);
/* Of the silent *FD has been so for longest, for *MS; false: there is none.  By the same thread. */
bool intake_silent(int *fd, int64_t *ms);
/* FD ends; by the thread that accepts and receives. */
void intake_end(int fd);
/* The loop has taken a message of FD. */
void intake_taken(int fd);
/* FD, which is open or not free yet, is ended for what it does not read. */
void intake_hang_up(int fd);
/* Connections ended here, since the start. */
long intake_ended(void);
#endif
