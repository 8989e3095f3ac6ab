/* daemon.h - the loop around the core: sockets, signals, threads, workers, the service manager */
#ifndef BROKER_DAEMON_H
#define BROKER_DAEMON_H
#include "base/error.h"

struct config;

/* The configuration once more, into OUT, which config_done frees; CONTEXT is daemon_run's. */
typedef enum modal_status config_again(struct config *out, void *context, struct modal_error *err);

/* Serve with CONFIG until SIGTERM (drain, then stop), a second one (stop at once), or a failure
 * that stable storage does not survive.  SIGHUP reads CONFIG.file again, with ARGUMENTS over it as
 * at the start.  Returns the exit status. */
int daemon_run(struct config *config, config_again *again, void *context);
#endif
