/* places.h - the page's connections: who has asked for nothing yet makes room for who comes
 *
 * A connection rests from its beginning to its first whole request, and from an answer to the next
 * whole request.  Where few places are left, those that rest longest are hung up on.
 */
#ifndef WEB_PLACES_H
#define WEB_PLACES_H
#include <microhttpd.h>

struct place;
struct places {
    struct place *first, *last;      /* who rests, the longest first */
    int count;                       /* of all */
    unsigned long closed;            /* hung up on for others */
};

/* Of MHD_OPTION_NOTIFY_CONNECTION; CONTEXT: the places. */
void places_note(void *context, struct MHD_Connection *connection, void **own,
                 enum MHD_ConnectionNotificationCode code);
/* CONNECTION has a whole request, and is left alone until it is answered. */
void places_work(struct places *places, struct MHD_Connection *connection);
/* It has its answer. */
void places_rest(struct places *places, struct MHD_Connection *connection);
#endif
