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
#include "modal/scene/program.h"

struct hill_hint { double complex exponent; double complex multiplier; double residual; };

struct hill_leading {
    /* as many as were wanted, or one more: no pair is parted; fewer where the others vanish in a
     * period, to 1e-9 of the largest */
    int count;
    double complex *multiplier;  /* descending in modulus, pairs together */
    double *residual;            /* |Phi y - rho y|, y of unit norm in roots of energies */
    double *condition;           /* >= 1 */
    double complex *start;       /* 2 n x count: y */
    bool settled;                /* what was looked at farther out added none, nor did a hint */
    bool alike;                  /* others were found whose moduli do not differ from the last's */
    int windows, harmonics;      /* looked through; of each, to one side */
    struct workspace space;      /* of the arrays */
};

/*
 * WANTED multipliers of P over PERIOD, laws and loads left out.  P is one that period_map_serves.
 * HINTS: multipliers that may be leading ones, to their residuals, with exponents that are not
 * folded.  Fails with MODAL_TOO_LARGE (a window is too large), MODAL_NO_CONVERGENCE (none was
 * found), MODAL_NO_MEMORY.  hill_leading_done frees.
 */
enum modal_status hill_leading(const struct program *p, double period, int wanted,
                               const struct hill_hint *hint, int hints, struct hill_leading *out,
                               struct modal_error *err);
/* *H becomes zeros. */
void hill_leading_done(struct hill_leading *h);
#endif
