/* verdict.h - clusters of modes, and stable, unstable or undecided */
#ifndef MODAL_VERDICT_H
#define MODAL_VERDICT_H
#include "modal/error.h"
#include "modal/identify/identify.h"

/*
 * Clusters among result->modes: multipliers closer than their bars, or than a record of `duration` seconds can tell apart while their parts cancel.
 * The members' bars become at least the cluster's radius.  A pair that nearly meets its own conjugate on the real axis is a cluster of one.
 */
enum modal_status verdict_clusters(struct identify_result *result, double duration, struct modal_error *err);

/*
 * Three values.  With g = Re(exponent) and its half width b (95 %): unstable where g - b > 0 for a mode, stable where g + b < 0 for all, else undecided.
 * b is never below what rounding leaves.  No modes: undecided.
 */
void verdict_stability(struct identify_result *result);
#endif
