/* notify.h - what the service manager is told (sd_notify's protocol: one datagram a message) */
#ifndef BROKER_NOTIFY_H
#define BROKER_NOTIFY_H
#include <stdint.h>
#include "base/error.h"

/* STATE as in sd_notify(3), such as "READY=1\nSTATUS=..."; nothing happens
 * without $NOTIFY_SOCKET. */
void notify_manager(const char *state);
/* Half of $WATCHDOG_USEC into *NS where it is meant for this process; 0: no watchdog.
 * MODAL_BAD_INPUT where it or $WATCHDOG_PID is no number of its kind: who set it would end a
 * process that does not report. */
enum modal_status notify_watchdog(int64_t *ns, struct modal_error *err);
#endif
