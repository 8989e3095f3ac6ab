/* large_stability.h - the leading multipliers of a motion of many states, and the verdict by them
 */
#ifndef MODAL_LARGE_STABILITY_H
#define MODAL_LARGE_STABILITY_H
#include "base/error.h"

struct disturbance;
struct stability;

/*
 * The verdict of U, followed, into OUT, with the multipliers that it is by; or u->reason.  What it
 * costs is counted in u->budget, and an end of that is a reason.  Fails with MODAL_NO_MEMORY or as
 * a law does.
 */
enum modal_status large_stability(struct disturbance *u, struct stability *out,
                                  struct modal_error *err);
#endif
