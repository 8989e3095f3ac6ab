/* rank.h - how many singular values are signal: the rules, each by its name */
#ifndef MODAL_RANK_H
#define MODAL_RANK_H
#include "base/error.h"

enum rank_rule {
    RANK_AUTO,             /* candidates by several rules, the order by BIC of the fits */
    RANK_FIXED,            /* as told */
    RANK_ENERGY,           /* (A3): least r with sum_{i<=r} s_i >= energy * sum s_i */
    RANK_ENERGY_SQUARED,   /* the same with s_i^2, which is the Frobenius closeness of (A2) */
    RANK_THRESHOLD,        /* s_i > threshold * s_1 */
    RANK_GAVISH_DONOHO,   /* s_i > omega(beta) * median(s): optimal hard threshold, unknown noise */
    RANK_MDL,              /* Wax-Kailath minimum description length */
    RANK_RULE_COUNT
};
/* "auto", "fixed", "energy", "energy-squared", "threshold", "gavish-donoho", "mdl";
 * NULL-terminated. */
extern const char *const rank_rule_names[RANK_RULE_COUNT + 1];

struct rank_options {
    enum rank_rule rule;
    double energy;         /* 0: 0.9999 */
    double threshold;      /* 0: max(m,n) * DBL_EPSILON */
    int fixed;
    int most;              /* upper limit; 0: none */
};

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
