/* whiten.h - noise that the samples before tell of in a periodic system, made white */
#ifndef MODAL_WHITEN_H
#define MODAL_WHITEN_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* Periods as rows, `phases` samples of each signal side by side. */
struct periods {
    struct matrix *Y;           /* borrowed */
    int phases;
    int samples;                /* of a signal: some that begin a period lie after the last */
};

/*
 * E is what a fit of ORDER columns leaves of the periods. Each signal's noise is predicted from the
 * samples before it (whiten.c); where that lowers -2 ln(likelihood) of all signals by more than
 * LEAST beside its price, every sample becomes what those before it do not tell. The first of the
 * record, which have too few, are gone, and with them a period: multipliers stay as they are,
 * amplitudes change.
 *
 *   told   the share of the noise's variance that was told, the signals alike; 0: all is as it was
 *
 * Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status whiten_periods(struct periods *of, const struct matrix *E, int order,
                                 double least, double *told, struct modal_error *err);
#endif
