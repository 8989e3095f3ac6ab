/*
 * grid.c - the common divisor of differences that are known to rounding
 *
 * Neighbours among the sorted values differ by whole multiples of the step.  They are taken in ascending order, each known to delta: with q = d / k found so far,
 * and so known to delta / k,
 *
 *     |d' - k' q| <= SLACK (delta + k' delta / k),        k' = round(d' / q),                                        (1)
 *
 * makes q = d' / k' if k' > k; where (1) fails q becomes the common divisor of q and the remainder, by Euclid.  That ends for numbers of the continuum where q
 * is no longer large beside the errors of (1).  Last, all samples are held against the grid.
 */
#include "modal/identify/grid.h"
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

static const double LEAST = 1e-10, SLACK = 2, CLEAR = 40;

struct divisor { double q, k, delta; };      /* q = d / k */

static double uncertainty(const struct divisor *g, double times)
{
    return SLACK * g->delta * (1 + times / g->k);
}

/* (1).  False where q is lost. */
static bool take_difference(struct divisor *g, double d, double least)
{
    double times = nearbyint(d / g->q), rest = fabs(d - times * g->q);

    while (rest > uncertainty(g, times)) {
        double before = g->q;
        *g = (struct divisor) { rest, 1, 2 * g->delta * (1 + times / g->k) };
        if (g->q < least || g->q < CLEAR * g->delta)
            return false;
        times = nearbyint(before / g->q), rest = fabs(before - times * g->q);
    }
    times = nearbyint(d / g->q);
    if (CLEAR * uncertainty(g, times) > SLACK * g->q)
        return false;
    if (times > g->k)
        g->q = d / times, g->k = times;
    return true;
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* N sorted values, each known to delta / 2. */
static double divisor_of(const double *sorted, int n, double *difference, double delta)
{
    double least = fmax(LEAST * (sorted[n - 1] - sorted[0]), CLEAR * delta);
    struct divisor g;
    int count = 0;

    for (int k = 1; k < n; k++)
        if (sorted[k] - sorted[k - 1] > delta)
            difference[count++] = sorted[k] - sorted[k - 1];
    if (count < GRID_VALUES_LEAST - 1)
        return 0;
    qsort(difference, (size_t)count, sizeof *difference, by_value);
    g = (struct divisor) { difference[0], 1, delta };
    if (g.q < least)
        return 0;
    for (int k = 1; k < count; k++)
        if (!take_difference(&g, difference[k], least))
            return 0;
    for (int k = 1; k < n; k++)         /* longer and longer spans: the last digits of q */
        if (sorted[k] - sorted[0] > delta && !take_difference(&g, sorted[k] - sorted[0], least))
            return 0;
    return g.q;
}

static bool all_on_grid(const double *x, size_t stride, int L, double q, double slack)
{
    for (int k = 1; k < L; k++) {
        double d = x[(size_t)k * stride] - x[0];
        if (fabs(d - nearbyint(d / q) * q) > slack)
            return false;
    }
    return true;
}

double grid_step(const double *x, size_t stride, int L)
{
    const double precisions[] = { 4 * DBL_EPSILON, 0x1p-23 };
    int n = L < GRID_SAMPLES ? L : GRID_SAMPLES;
    double *sorted = L > 1 ? malloc(2 * sizeof *sorted * (size_t)n) : NULL, most = 0, q = 0;

    if (sorted == NULL)
        return 0;
    for (int k = 0; k < n; k++)
        sorted[k] = x[(size_t)((double)k * (L - 1) / (n - 1)) * stride];
    qsort(sorted, (size_t)n, sizeof *sorted, by_value);
    most = fmax(fabs(sorted[0]), fabs(sorted[n - 1]));
    for (int i = 0; i < 2 && q == 0; i++) {
        q = divisor_of(sorted, n, sorted + n, precisions[i] * most);
        if (q > 0 && !all_on_grid(x, stride, L, q, 0.02 * q))
            q = 0;
    }
    free(sorted);
    return q;
}
