/* places.c - see places.h */
#include "places.h"
#include <stdbool.h>
#include <stdlib.h>
#include <sys/socket.h>
#include "http.h"

enum { SPARE = 16 };        /* places kept free: libmicrohttpd takes ten connections at a time */

struct place {
    struct place *before, *after;
    struct MHD_Connection *connection;
    bool rests;
};

static struct place *place_of(struct MHD_Connection *connection)
{
    const union MHD_ConnectionInfo *info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);

    return info != NULL ? info->socket_context : NULL;
}

/* Out of those who rest. */
static void take(struct places *all, struct place *p)
{
    if (!p->rests)
        return;
    p->rests = false;
    *(p->before != NULL ? &p->before->after : &all->first) = p->after;
    *(p->after != NULL ? &p->after->before : &all->last) = p->before;
}

/* Behind those who rest. */
static void put(struct places *all, struct place *p)
{
    take(all, p);
    p->rests = true;
    p->before = all->last;
    p->after = NULL;
    *(p->before != NULL ? &p->before->after : &all->first) = p;
    all->last = p;
}

/* libmicrohttpd reads the end, and closes it. */
static void hang_up(struct places *all, struct place *p)
{
    shutdown(MHD_get_connection_info(p->connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd,
             SHUT_RDWR);
    take(all, p);
    all->closed++;
}

static void begin(struct places *all, struct MHD_Connection *connection, void **own)
{
    struct place *p = calloc(1, sizeof *p);

    *own = p;
    all->count++;
    if (all->count > HTTP_CONNECTIONS - SPARE && all->first != NULL)
        hang_up(all, all->first);
    if (p == NULL)                           /* it rests unseen, until its time is up */
        return;
    p->connection = connection;
    put(all, p);
}

void places_note(void *context, struct MHD_Connection *connection, void **own,
                 enum MHD_ConnectionNotificationCode code)
{
    struct places *all = context;

    if (code == MHD_CONNECTION_NOTIFY_STARTED) {
        begin(all, connection, own);
        return;
    }
    all->count--;
    if (*own != NULL)
        take(all, *own);
    free(*own);
    *own = NULL;
}

void places_work(struct places *all, struct MHD_Connection *connection)
{
    struct place *p = place_of(connection);

    if (p != NULL)
        take(all, p);
}

void places_rest(struct places *all, struct MHD_Connection *connection)
{
    struct place *p = place_of(connection);

    if (p != NULL)
        put(all, p);
}
