/* accept.h - the connections that libzmq accepts and closes: how many there are and may be,
 * and which have ended */
#ifndef BROKER_ACCEPT_H
#define BROKER_ACCEPT_H
#include <stdbool.h>

/* Descriptors below it; none beyond is given to a connection. */
enum { CONNECTIONS_TRACKED = 65536 };

/* From now on connections beyond MOST, 0: any number, are closed as they come, and those beyond
 * what the descriptor limit leaves; or silent ones for them.  Those of workers are neither counted
 * nor closed. */
void accept_most(int most);
/* From now on 1 is added to the eventfd WAKE where a connection ends. */
void accept_wake(int wake);

/* Connections of clients now. */
int accept_open(void);
/* Closed as they came, or for another before they spoke, since the start. */
long accept_refused(void);

/* FD's other end has hung up, though not all that it sent is read. */
void accept_hung_up(int fd);
/* Has it, or has the connection ended?  Nobody reads what it would be answered. */
bool accept_gone(int fd);

/* A connection that ends is closed at once, but its descriptor's number is not given out again
 * before accept_free: until then ZMQ_SRCFD says whose a message is.  One thread calls these.
 *
 * Take up those that have ended since the last were freed; are there any?  What was received of
 * them is in the pipes then. */
bool accept_ended(void);
/* One of them; -1: no more. */
int accept_next(void);
/* The number of FD, one of them, may be given out again. */
void accept_free(int fd);
#endif
