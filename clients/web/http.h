/* http.h - who may come and what he gets: libmicrohttpd, driven from the page's own loop
 *
 * Everything that comes is a stranger's: its size, its method, its Host and where an action comes
 * from are looked at before anything is done.
 */
#ifndef WEB_HTTP_H
#define WEB_HTTP_H
#include "base/error.h"

struct site;

enum {
    HTTP_CONNECTIONS = 256,          /* at once; READERS_MOST of them may stay */
    HTTP_MEMORY = 32768,             /* bytes of a connection: request, and what is on its way */
    HTTP_IDLE_S = 15,                /* of a connection that says and takes nothing */
};

/* Listen; MODAL_BAD_INPUT, field "bind". */
enum modal_status http_start(struct site *site, struct modal_error *err);
/* Do what can be done without waiting. */
void http_step(struct site *site);
/* What becomes readable when there is something to do. */
int http_descriptor(const struct site *site);
/* s until something is due without that, at most MOST. */
double http_wait(const struct site *site, double most);
/* End all connections. */
void http_stop(struct site *site);
#endif
