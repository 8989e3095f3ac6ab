/* event.h - which part of a record is one free response: after quiet and a strike, before noise */
#ifndef MODAL_EVENT_H
#define MODAL_EVENT_H
#include <stdbool.h>
#include <stddef.h>
#include "base/error.h"
#include "modal/batch.h"

/* Rows of a batch, the last included. */
struct event_rows { size_t first, last; };

/*
 * *part: the rows of WHOLE that one free response and its noise fill; *cut false, and *part is
 * WHOLE, where all of them serve. CHANNELS (COUNT indices) are those that are identified; few of
 * many are looked at.
 *
 * A record begins later where its rows, turned backwards, cease to follow the recurrence of those
 * after them, as a free response's do at whatever rate its modes decay or grow, and where there is
 * quiet before that, or nothing. Only such a record may end earlier, where white noise begins: a
 * record that begins with its free response serves whole, for white noise after it costs nothing.
 *
 * Fails with MODAL_NO_MEMORY.
 */
enum modal_status event_find(const struct batch *b, const int *channels, int count,
                             struct event_rows whole, struct event_rows *part, bool *cut,
                             struct modal_error *err);

/* *end: the row of WHOLE from which on there is white noise alone; after its last: there is none
 * such. Fails with MODAL_NO_MEMORY. */
enum modal_status event_end(const struct batch *b, const int *channels, int count,
                            struct event_rows whole, size_t *end, struct modal_error *err);
#endif
