/* hill_leading.h - the leading multipliers of a large sparse periodic program, window by window
 *
 * Who damps little is looked for where the constant part has its exponents of least size, and where
 * others say that a multiplier is; around each the exponents are those of hill_window.h.
 */
#ifndef MODAL_HILL_LEADING_H
#define MODAL_HILL_LEADING_H
#include <complex.h>
#include <stdbool.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/hill_found.h"
#include "modal/scene/program.h"

struct hill_ask {
    int wanted;                  /* multipliers */
    int harmonics;               /* of a window to begin with, for the highest; 0: 6 */
    bool all_sums;               /* no end below the highest harmonic that pulsates: both motions */
                                 /* lie below it that it makes grow by the sum of frequencies */
    bool uncounted;              /* settled also where those that grow fast cannot be counted */
    double most;                 /* operations (budget.h), nearly; 0: no limit */
    const struct hill_hint *hint;/* that may be leading ones, to their residuals, with exponents */
    int hints;                   /* that are not folded */
    bool only_hints;             /* nothing else is looked for; settled: each has one of its own, */
                                 /* and what none is of is below the last that is wanted */
};

struct hill_leading {
    /* as many as were wanted, or one more: no pair is parted; fewer where the others vanish in a
     * period, to 1e-9 of the largest */
    int count;
    double complex *multiplier;  /* descending in modulus, pairs together */
    double *residual;            /* |Phi y - rho y|, y of unit norm in roots of energies */
    double *rounding;            /* hill_found.h's: to be added to the residual, of the matrices */
                                 /* as they are, where those before rounding are meant */
    double *condition;           /* >= 1 */
    double complex *start;       /* 2 n x count: y */
    bool settled;                /* what was looked at farther out added none, nor did a hint; */
                                 /* and all are found that grow fast */
    int growing;                 /* multipliers that grow fast, found or not, as was counted */
                                 /* (hill_growth.h); -1: it was not */
    double sums_to;              /* rad/s: pairs that grow by the sum of their frequencies were */
                                 /* looked for among frequencies up to it; 0: among all */
    bool alike;                  /* others were found whose moduli do not differ from the last's */
    int windows, harmonics;      /* looked through; of each, to one side */
    double work;                 /* operations; of a search that failed too */
    struct workspace space;      /* of the arrays */
};

/*
 * What ASK says of P over PERIOD, laws and loads left out.  P is one that period_map_serves.
 * Fails with MODAL_TOO_LARGE (a window is too large, or takes more than is left of ask->most),
 * MODAL_NO_CONVERGENCE (none was found), MODAL_NO_MEMORY.  hill_leading_done frees.
 */
enum modal_status hill_leading(const struct program *p, double period, const struct hill_ask *ask,
                               struct hill_leading *out, struct modal_error *err);
/* *H becomes zeros. */
void hill_leading_done(struct hill_leading *h);
#endif
