/* stability.h - multipliers of a steady state: its disturbances over one period, through the same
 * laws
 *
 * Disturbances of (1) and (2) of program.h about a periodic motion obey a linear equation with
 * periodic coefficients,
 *
 *     M y'' + (C + sum B g_v B^T) y' + (K + sum B g_d B^T) y + sum B c = F z,                   (1)
 *
 * g_d, g_v the laws' slopes along the motion; c is what each stuck slider holds, constant while it
 * sticks, and set anew from y where it comes to rest.  The state is (y, y', z, one c a slider); its
 * map over a period has the multipliers. */
#ifndef MODAL_STABILITY_H
#define MODAL_STABILITY_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/steady/budget.h"

struct steady;
struct steady_point;

enum stability_verdict {
    STABILITY_UNKNOWN,
    STABILITY_STABLE,
    STABILITY_UNSTABLE,
    STABILITY_UNDECIDED
};

struct stability {
    enum stability_verdict verdict;
    int count;                        /* of all states, or of the leading ones */
    double complex *multiplier;       /* over 2 pi / omega, |.| descending; the caller frees by
                                       * stability_done */
    double largest, error;            /* max |.|; the estimated error of the integration */
    const char *reason;               /* STABILITY_UNKNOWN: why */
    struct budget work;               /* of its maps */
};

/* States of which a dense map is made and its eigenvalues found, some seconds; of more the leading
 * multipliers are. */
enum { STABILITY_STATES_MOST = 400 };
/* A multiplier this near the unit circle is on it: that of an autonomous motion is, to rounding. */
#define STABILITY_ON_CIRCLE 1e-8

/*
 * Of POINT, converged, of session S.  UNDECIDED: a multiplier on the unit circle to within 1e-8 or
 * the error.  UNKNOWN is an answer: the work allowed spent, a singular mass, a motion with
 * jumps.  Fails with MODAL_NO_MEMORY, MODAL_CANCELLED or as a law
 * does.
 */
enum modal_status stability_of(struct steady *s, const struct steady_point *point,
                               struct stability *out, struct modal_error *err);
/* Whether one more verdict is paid: of an answer's WORK, or of what its verdicts, of which KNOWN is
 * one, are given beside it.  So what a search found is judged though it spent the rest. */
bool stability_pays(const struct budget *work, const struct stability *known);
/* Frees what S holds, and makes it 0. */
void stability_done(struct stability *s);
#endif
