/*
 * grid.c - the common divisor of differences that are known to rounding
 *
 * Neighbours among the sorted values differ by whole multiples of the step.  They are taken in
 * ascending order, each known to delta.  With q known to epsilon so far,
 *
 *     |d - k q| <= SLACK (delta + k epsilon),        k = round(d / q),                          (1)
 *
 * makes q = d / k, known to delta / k, where that is better; where (1) fails q becomes the common
 * divisor of q and the remainder, by Euclid.  For numbers of the continuum that ends where q is no
 * longer large beside the errors of (1).  Last, all samples are held against the grid.
 *
 * A number of D significant digits, 10^e <= |x| < 10^(e+1), is a multiple of
 *
 *     q = 10^(e+1-D),                                                                           (2)
 *
 * and one of single precision of 2^(e-23) where 2^e <= |x| < 2^(e+1).
 */
#include "modal/identify/prepare/grid.h"
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include "modal/numbers.h"

enum {
    /* twice the rounding of double precision is then below a fiftieth of a step, and what eight
     * numbers of the continuum are within has odds of 10^-11 */
    DIGITS_MOST = 13,
    BITS_OF_SINGLE = 24             /* of a significand, the first one implied */
};
static const double
    CLEARLY = 1.5,                  /* between one step of single precision and the next */
    LEAST = 1e-10,                  /* of the range: no finer grid is looked for */
    SLACK = 2,                      /* (1): both differences may be off by as much */
    CLEAR = 40,                     /* a step over its error: (1) then lets pass 4 of 10 numbers of
                                     * the continuum at most, and GRID_VALUES_LEAST must pass */
    DOUBLE = 4 * DBL_EPSILON,       /* of a number: its own rounding and what it went through */
    SINGLE = 0x1p-23,               /* the same of single precision: two roundings */
    UNKNOWN = -1;                   /* of no step: there are too few values */

struct divisor { double q, error, delta; };

static double uncertainty(const struct divisor *g, double times)
{
    return SLACK * (g->delta + times * g->error);
}

/* (1).  False where q is lost. */
static bool take_difference(struct divisor *g, double d, double least)
{
    double times = nearbyint(d / g->q), rest = fabs(d - times * g->q);

    while (rest > uncertainty(g, times)) {
        double before = g->q, error = g->error;
        g->q = rest, g->error = g->delta + times * error;
        if (g->q < least || g->q < CLEAR * g->error)
            return false;
        times = nearbyint(before / g->q), rest = fabs(before - times * g->q);
    }
    times = nearbyint(d / g->q);
    if (CLEAR * (g->delta + times * g->error) > 2 * SLACK * g->q)
        return false;
    if (times > 0 && g->delta < times * g->error)
        g->q = d / times, g->error = g->delta / times;
    return true;
}

/* N sorted values, each known to delta / 2.  0: no divisor; UNKNOWN: too few values. */
static double divisor_of(const double *sorted, int n, double *difference, double delta)
{
    double least = fmax(LEAST * (sorted[n - 1] - sorted[0]), CLEAR * delta);
    struct divisor g;
    int count = 0;

    for (int k = 1; k < n; k++)
        if (sorted[k] - sorted[k - 1] > delta)  /* closer ones are one value, rounded twice */
            difference[count++] = sorted[k] - sorted[k - 1];
    if (count < GRID_VALUES_LEAST - 1)
        return UNKNOWN;
    numbers_sort(difference, (size_t)count);
    g = (struct divisor) { difference[0], delta, delta };
    if (g.q < least)
        return 0;
    for (int k = 1; k < count; k++)
        if (!take_difference(&g, difference[k], least))
            return 0;
    for (int k = 1; k < n; k++)         /* longer and longer spans: the last digits of q */
        if (sorted[k] - sorted[0] > delta && !take_difference(&g, sorted[k] - sorted[0], least))
            return 0;
    /* the least step that explains every difference within what rounding leaves of it */
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

/* Of n samples spread over the L; `scratch` has room for twice as many. */
static double divisor_of_some(const double *x, size_t stride, int L, int n, double precision,
                              double *scratch)
{
    for (int k = 0; k < n; k++)
        /* spread evenly: a quiet end alone would show few of the values */
        scratch[k] = x[(size_t)((double)k * (L - 1) / (n - 1)) * stride];
    numbers_sort(scratch, (size_t)n);
    return divisor_of(scratch, n, scratch + n,
                      precision * fmax(fabs(scratch[0]), fabs(scratch[n - 1])));
}

static bool is_single(double x) { return (double)(float)x == x; }

static bool are_single(const double *x, size_t stride, int L)
{
    for (int k = 0; k < L; k++)
        if (!is_single(x[(size_t)k * stride]))
            return false;
    return true;
}

double grid_step(const double *x, size_t stride, int L)
{
    int n = L < GRID_SAMPLES ? L : GRID_SAMPLES;
    double *scratch = L > 1 ? malloc(2 * sizeof *scratch * (size_t)n) : NULL, q;

    if (scratch == NULL)
        return 0;
    q = n > GRID_FIRST ? divisor_of_some(x, stride, L, GRID_FIRST, DOUBLE, scratch) : UNKNOWN;
    if (q != 0)
        q = fmax(divisor_of_some(x, stride, L, n, DOUBLE, scratch), 0);
    if (q == 0 && are_single(x, stride, L))
        q = fmax(divisor_of_some(x, stride, L, n, SINGLE, scratch), 0);
    free(scratch);
    return q > 0 && all_on_grid(x, stride, L, q, 0.02 * q) ? q : 0;
}

/* (2), of x other than 0. */
static double step_of_digits(double x, int digits)
{
    return pow(10, floor(log10(fabs(x))) + 1 - digits);
}

static bool has_digits(double x, int digits, double precision)
{
    double turns = x / step_of_digits(x, digits);

    return fabs(turns - nearbyint(turns)) <= precision * fabs(turns);
}

/* The fewest digits that hold L samples that are known to `precision`; 0: more than `most`. */
static int digits_of(const double *x, size_t stride, int L, double precision, int most)
{
    int digits = 1;

    for (int k = 0; k < L; k++) {
        double value = x[(size_t)k * stride];

        if (value == 0 || has_digits(value, digits, precision))
            continue;
        /* asked first, for most numbers have more: a number of fewer has so many, too */
        if (!has_digits(value, most, precision))
            return 0;
        do
            digits++;
        while (!has_digits(value, digits, precision));
    }
    return digits;
}

/* In single precision a number of more digits than six cannot be told from others.  0: of it. */
static bool digits_known(const double *x, size_t stride, int L, int *digits)
{
    *digits = digits_of(x, stride, L, 2 * DOUBLE, DIGITS_MOST);
    if (*digits > 0)
        return true;
    *digits = digits_of(x, stride, L, SINGLE, FLT_DIG);
    return are_single(x, stride, L);
}

double floating_steps(const double *x, size_t stride, int L, double least, double *q)
{
    double sum = 0;
    int digits, coarser = 0;

    if (!digits_known(x, stride, L, &digits))
        return 0;
    for (int k = 0; k < L; k++) {
        double value = x[(size_t)k * stride], step = 0;

        if (value != 0)
            step = digits > 0 ? step_of_digits(value, digits)
                              : ldexp(1, ilogb(value) + 1 - BITS_OF_SINGLE);
        sum += step * step;
        coarser += step > CLEARLY * least;
        if (q != NULL)
            q[k] = step;
    }
    return coarser >= GRID_VALUES_LEAST ? sqrt(sum / L) : 0;
}

bool grid_may_be(const double *some, int n)
{
    double scratch[2 * GRID_FIRST];

    return n < GRID_FIRST || divisor_of_some(some, 1, n, n, DOUBLE, scratch) != 0
        || are_single(some, 1, n) || digits_of(some, 1, n, 2 * DOUBLE, DIGITS_MOST) > 0;
}

struct grid grid_of_rows(const double *x, size_t stride, int L, int first, int every)
{
    double step = grid_step(x, stride, L),
           floating = floating_steps(x + (size_t)first * stride, stride * (size_t)every,
                                     (L - first + every - 1) / every, step, NULL);

    return floating > step ? (struct grid) { floating, true } : (struct grid) { step, false };
}

struct grid grid_of(const double *x, size_t stride, int L)
{
    return grid_of_rows(x, stride, L, 0, L > GRID_SAMPLES ? L / GRID_SAMPLES : 1);
}

bool grid_ends(const struct grid *grid) { return grid->step > 0 && !grid->floating; }
