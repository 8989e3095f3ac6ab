/* rank.h - how many singular values are signal: the rules, each by its name */
#ifndef MODAL_RANK_H
#define MODAL_RANK_H
#include "modal/identify/result.h"

/*
 * The rank of an m x n matrix with singular values s[0..count-1], descending, count <= min(m, n):
 * all or the leading ones.  Never more than what exceeds rounding, max(m,n) DBL_EPSILON s[0],
 * except RANK_FIXED, which is what was asked up to `count`. Gavish-Donoho and MDL need all the
 * values (count = min(m,n)) and fall back to those given.  RANK_AUTO answers the larger of the last
 * two.
 */
int rank_estimate(const double *s, int count, int m, int n, const struct rank_options *opt);

/* Those above max(m,n) DBL_EPSILON s[0]. */
int rank_above_rounding(const double *s, int count, int m, int n);
#endif
