/* notify.h - what the service manager is told (sd_notify's protocol: one datagram a message) */
#ifndef BROKER_NOTIFY_H
#define BROKER_NOTIFY_H
#include <stdint.h>
/* STATE as in sd_notify(3), such as "READY=1\nSTATUS=..."; nothing happens
 * without $NOTIFY_SOCKET. */
void notify_manager(const char *state);
/* Half of $WATCHDOG_USEC where it is meant for this process, in ns; 0: no watchdog. */
int64_t notify_watchdog_ns(void);
#endif
