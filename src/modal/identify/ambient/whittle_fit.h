/* whittle_fit.h - to the summit of the likelihood of a spectral matrix */
#ifndef MODAL_WHITTLE_FIT_H
#define MODAL_WHITTLE_FIT_H
#include "modal/identify/ambient/whittle.h"

/*
 * A climb ends where a step gains less than `gain` in the logarithm of the likelihood, many steps
 * like the last would not reach `needed`, `most` steps are done or no work is left.  Then what is
 * seen is corrected by what was found, and climbed anew, `corrections` times.  errors: the standard
 * errors, too, from the information matrix; of what converged.
 */
struct whittle_limits {
    double gain, needed;             /* needed: of the logarithm of the likelihood; -HUGE_VAL */
    int most, corrections;
    bool errors;
    double *work;                    /* what is left of it, of likelihoods and scoring_work() */
    bool (*cancelled)(void *context);
    void *context;
};

/* *M, its modes sorted, is where the climb from it ended, by those LIMITS; BINS as it is seen
 * there.  Fails with MODAL_NO_MEMORY, MODAL_CANCELLED. */
enum modal_status whittle_fit(struct whittle *m, struct bins *bins,
                              const struct whittle_limits *limits, struct modal_error *err);
#endif
