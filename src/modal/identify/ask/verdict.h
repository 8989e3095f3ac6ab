/* verdict.h - clusters of modes, and stable, unstable or undecided */
#ifndef MODAL_VERDICT_H
#define MODAL_VERDICT_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/result.h"

/* A mode of less than this share of the energy has its say only where it persists. */
#define VERDICT_WEAK 1e-3
/* Standard errors to either side of a growth.  A verdict is by the largest of a record's modes, of
 * one record after the other: of bench_identify_random.py's, with errors that are normal and at
 * their bounds, 3 would tell 1.6e-4 of them falsely, 3 in 20,000, and 4 tell 3e-6; of those whose
 * growth is beyond five bounds 0.3 % are left open then. */
#define VERDICT_CLEAR 4.0

/*
 * Clusters among result->modes: multipliers closer than their bars, or than a record of `duration`
 * seconds can tell apart while their parts cancel. The members' bars become at least the cluster's
 * radius.  A pair that nearly meets its own conjugate on the real axis is a cluster of one.
 */
enum modal_status verdict_clusters(struct identify_result *result, double duration,
                                   struct modal_error *err);

/*
 * Three values.  With g = Re(exponent) and its half width b (VERDICT_CLEAR standard errors):
 * unstable where g - b > 0 for a mode, stable where |rho| (1 + T b) < 1 for all (over one sample,
 * without a period T, that is g + b < 0), else undecided.  b is never below what rounding leaves.
 * No modes: undecided.  Persistence must be known by now.  result->decides is the mode that says
 * it.
 *
 *   in parts   where halves of the record contradict the whole, b is as wide as that; but a mode
 *              that decays in the whole and in either half, each by three of its own errors, is
 *              stable all the same (GROWTH_NEVER)
 *   doubtful   a mode of little energy, or slower than the record (DURATION, s), makes unstable
 *              only if half of the record alone shows the growth, and not at all if it rises little
 *              and slowly, as drift does, or is a weak neighbour of a strong mode; else it is said
 *              by the diagnostic growth_unconfirmed, and leaves the verdict undecided; so does one
 *              that may as well decay beside another in a crowd (GROWTH_IN_CROWD).  What fits
 *              to rounding is not doubted.
 *   spurious   a mode of little energy that most orders do not show has no say at all
 */
void verdict_stability(struct identify_result *result, double duration);
/* Neither errors nor a verdict: what they would rest on, a fit at its least to a free decay,
 * is not there. */
void verdict_withhold(struct identify_result *result);
/* Do more than two modes grow beyond their errors?  So many together may draw something else than
 * growth: the end of a record where it was set off anew. */
bool verdict_crowd_grows(const struct identify_result *result);

/* Slower than a record of so many seconds, and not for sure, by its standard error, rising in it by
 * e^3: drift looks so. */
bool verdict_slow(double complex lambda, double std_re, double seconds);
#endif
