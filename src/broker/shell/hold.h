/* hold.h - connections that are not read while what they sent waits: the rest stays with the
 * system, and its sender waits, at nobody's cost */
#ifndef BROKER_HOLD_H
#define BROKER_HOLD_H
#include <stdbool.h>
#include <stdint.h>

/* The data of an event that epoll tells of a connection: OURS, the marks, the descriptor.  No
 * pointer has the highest bit.  NO_INPUT: it is not to be read; OUTPUT: that may be written to. */
#define HOLD_OURS (UINT64_C(1) << 63)
#define HOLD_NO_INPUT (UINT64_C(1) << 32)
#define HOLD_OUTPUT (UINT64_C(1) << 33)

/* libzmq's own data of such an event of FD. */
void *hold_pointer(int fd);
/* Nothing more is read of FD, an open connection, or it is again; by any thread. */
void hold_set(int fd, bool hold);
bool hold_is(int fd);
/* FD has hung up, and is held no more: whether it was. */
bool hold_end(int fd);
#endif
