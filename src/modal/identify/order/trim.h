/* trim.h - poles that a set does without, told from one factorisation of the set */
#ifndef MODAL_TRIM_H
#define MODAL_TRIM_H
#include "modal/identify/fit/refine.h"

/* When a pole goes: what the signals lose by it, in the criterion, is less than `share` of its
 * price plus `reach`. */
struct trim_options {
    double share, reach;
    int most;                    /* poles left out at most; 0: any number, but one stays */
    int order;                   /* whatever they cost, until no more columns are left; 0: no */
};

/*
 * Leave out of LAMBDA (COUNT poles) the one whose absence costs least, the amplitudes of all
 * others being fitted anew, as long as it may go, and *count becomes theirs. Poles that are linear
 * combinations of those listed before them go first.
 *
 *   work    is added to.  May be NULL
 *
 * Fails as refine_project does.
 */
enum modal_status trim_poles(const struct refine_data *data, double complex *lambda, int *count,
                             const struct trim_options *opt, double *work, struct modal_error *err);
#endif
