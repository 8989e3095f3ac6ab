/* ragged.h - whether a spectrum is as ragged as that of a response which noise drives */
#ifndef MODAL_RAGGED_H
#define MODAL_RAGGED_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

struct ragged {
    /* More poles than any set of modes has stand out of the noise, nearer to each other than a
     * record resolves: no search for all of them ends. */
    bool endless;
    bool driven;                /* and they have most of the energy */
};

/*
 * Is the record Y (samples x signals, borrowed) no sum of exponentials that its spectrum resolves,
 * in white noise?  Of such sums less than 1 in 10^5 is held for another thing (ragged.c). A short
 * driven response may not be told. Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status ragged_spectrum(const struct matrix *Y, struct ragged *out,
                                  struct modal_error *err);
#endif
