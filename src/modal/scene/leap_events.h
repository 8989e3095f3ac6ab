/* leap_events.h - the first instant within a leap at which a law leaves its smooth piece */
#ifndef MODAL_LEAP_EVENTS_H
#define MODAL_LEAP_EVENTS_H
#include "modal/scene/leap.h"

/*
 * Of law LAW, an index of the program's, over the leap L that has been made with MEMORY at its
 * start: *THETA is where it changes, looked for up to LIMIT (a little past 1, on the same
 * interpolant), or HUGE_VAL.
 */
enum modal_status leap_find_event(const struct leap *l, const double *memory, int law, double limit,
                                  double *theta, struct modal_error *err);
#endif
