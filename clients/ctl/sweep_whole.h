/* sweep_whole.h - the shares of a sweep put together, one after the other, into one result */
#ifndef CTL_SWEEP_WHOLE_H
#define CTL_SWEEP_WHOLE_H
#include "args.h"

/* All zero: no share yet. */
struct sweep_whole {
    cJSON *result;      /* of the first share, with the points of all */
    int taken;          /* points so far */
    bool as_text;       /* of the points only their text is wanted */
};

/* Is nothing but the document's text printed of the whole? */
bool sweep_whole_as_text(const struct args *args);
/* The next share's RESULT, which is moved.  Seconds add up, memory is the most that one needed. */
void sweep_whole_add(struct sweep_whole *whole, cJSON *result);
/* That was the last: *OUT, the caller's, is what one job of all POINTS gives, but for its cost.
 * MODAL_INTERNAL: the shares hold another number of points. */
enum modal_status sweep_whole_end(struct sweep_whole *whole, int points, cJSON **out,
                                  struct modal_error *err);
void sweep_whole_done(struct sweep_whole *whole);
#endif
