/* accept.h - the connections that libzmq accepts and closes: how many there are and may be,
 * and which have ended */
#ifndef BROKER_ACCEPT_H
#define BROKER_ACCEPT_H
#include <stdbool.h>

/* Descriptors below it; none beyond is given to a connection. */
enum { CONNECTIONS_TRACKED = 65536 };

/* From now on connections beyond MOST, 0: any number, are closed as they come, and those beyond what the descriptor limit leaves
 * (accept_default).  Those of workers are neither counted nor closed.  Where one ends,
 * 1 is added to the eventfd WAKE. */
void accept_most(int most);
void accept_wake(int wake);
/* Of the descriptors of this process, those that clients may have: the rest is for files, workers and ourselves. */
int accept_default(void);

int accept_open(void);             /* connections now */
long accept_refused(void);         /* closed as they came, since the start */

/* FD's other end has hung up, though not all that it sent is read; whether it has, or the
 * connection has ended: nobody reads what it would be answered. */
void accept_hung_up(int fd);
bool accept_gone(int fd);

/* A connection that ends is closed at once, but its descriptor's number is not given out again
 * before accept_free: until then ZMQ_SRCFD says whose a message is.  accept_ended takes up those
 * that have ended since the last were freed, and says whether there are any; what was received of
 * them is in the pipes then.  accept_next: one of them, -1: no more.  One thread calls these. */
bool accept_ended(void);
int accept_next(void);
void accept_free(int fd);
#endif
