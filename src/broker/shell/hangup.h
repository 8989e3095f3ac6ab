/* hangup.h - a hang-up reaches libzmq only where it reads:
 * what it otherwise ends the process for */
#ifndef BROKER_HANGUP_H
#define BROKER_HANGUP_H

/* Hang-ups kept from connections whose input waited for the loop, since the start. */
long hangup_kept(void);
#endif
