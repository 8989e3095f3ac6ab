/*
 * rank.c - the rank rules
 *
 *   energy           least r with sum_{i<=r} s_i >= E sum s_i: (A3) of the paper as printed, which
 *                    sums s, not s^2
 *   energy-squared   the same with s_i^2
 *   gavish-donoho    s_i > w(beta) median(s), beta = min(m,n)/max(m,n), w = 0.56 b^3 - 0.95 b^2 +
 *                    1.82 b + 1.43 [GD14, eq. (5)]
 *   mdl              r that minimises  -N (q - r) ln(geometric/arithmetic mean of s_i^2, i > r) + r
 *                    (2q - r) ln(N) / 2, q = min(m,n), N = max(m,n) [WK85]
 *
 * All squares are of s_i / s_1, floored at rounding, so that nothing overflows and clean data have
 * an exact rank.  GD14 and WK85 assume white noise in every entry; a Hankel matrix repeats each
 * sample, so both are starting points for the order, not the last word.
 *
 * [GD14] Gavish and Donoho, IEEE Trans. Inf. Theory 60 (2014) 5040-5053.  [WK85] Wax and Kailath,
 * IEEE Trans. ASSP 33 (1985) 387-392.
 */
#include "modal/identify/linear/rank.h"
#include <float.h>
#include <math.h>
#include <stddef.h>

const char *const rank_rule_names[RANK_RULE_COUNT + 1] = {
    "auto", "fixed", "energy", "energy-squared", "threshold", "gavish-donoho", "mdl", NULL,
};

static double rounding(int m, int n)
{
    return (m > n ? m : n) * DBL_EPSILON;
}

static int count_above(const double *s, int count, double level)
{
    int r = 0;

    while (r < count && s[r] > level)
        r++;
    return r;
}

int rank_above_rounding(const double *s, int count, int m, int n)
{
    return count > 0 && s[0] > 0 ? count_above(s, count, rounding(m, n) * s[0]) : 0;
}

static double power_sum(const double *s, int count, int power)
{
    double sum = 0;

    for (int i = 0; i < count && s[0] > 0; i++)
        /* over s_1: squares neither overflow nor vanish */
        sum += power == 2 ? (s[i] / s[0]) * (s[i] / s[0]) : s[i] / s[0];
    return sum;
}

static int by_energy(const double *s, int count, double energy, int power)
{
    double all = power_sum(s, count, power);
    int r = 0;

    while (r < count && power_sum(s, r, power) < energy * all)
        r++;
    return r;
}

static int gavish_donoho(const double *s, int count, int m, int n)
{
    int q = m < n ? m : n, middle = q / 2 < count ? q / 2 : count - 1;
    double b = (double)q / (m > n ? m : n);

    /* Gavish and Donoho's omega(beta), times the median: unknown noise */
    return count_above(s, count, (((0.56 * b - 0.95) * b + 1.82) * b + 1.43) * s[middle]);
}

static int description_length(const double *s, int count, int m, int n)
{
    int q = m < n ? m : n, best = 0;
    double N = m > n ? m : n, least = HUGE_VAL, sum = 0, logs = 0, floor = rounding(m, n);

    /* tails from the end; the values beyond `count` are taken as the last known one */
    for (int r = q - 1; r >= 0; r--) {
        double a = s[r < count ? r : count - 1] / s[0], length;
        a = a > floor ? a * a : floor * floor;  /* rounding has no logarithm to speak of */
        sum += a;
        logs += log(a);
        /* Wax and Kailath: arithmetic over geometric mean of the tail, and its free parameters */
        length = -N * (logs - (q - r) * log(sum / (q - r))) + 0.5 * r * (2.0 * q - r) * log(N);
        if (length < least && r <= count) {
            least = length;
            best = r;
        }
    }
    return best;
}

static int larger(int a, int b) { return a > b ? a : b; }

int rank_estimate(const double *s, int count, int m, int n, const struct rank_options *opt)
{
    int full = rank_above_rounding(s, count, m, n), r;
    double energy = opt->energy > 0 ? opt->energy : 0.9999;

    if (full == 0)
        return 0;
    switch (opt->rule) {
    case RANK_FIXED:
        r = opt->fixed;
        full = count;
        break;
    case RANK_ENERGY:
        r = by_energy(s, count, energy, 1);
        break;
    case RANK_ENERGY_SQUARED:
        r = by_energy(s, count, energy, 2);
        break;
    case RANK_THRESHOLD:
        r = opt->threshold > 0 ? count_above(s, count, opt->threshold * s[0]) : full;
        break;
    case RANK_GAVISH_DONOHO:
        r = gavish_donoho(s, count, m, n);
        break;
    case RANK_MDL:
        r = description_length(s, count, m, n);
        break;
    default:
        /* poles too many cost little once they are refined, too few bias the rest */
        r = larger(gavish_donoho(s, count, m, n), description_length(s, count, m, n));
    }
    if (opt->most > 0 && r > opt->most)
        r = opt->most;
    return r < full ? (r > 1 ? r : 1) : full;
}
