/*
 * criterion.c - Bayes' information criterion with the price of a search
 *
 *     sum_g n_g ln max(rss_g / n_g, floor_g^2) + h k ln n,                              (1)
 *
 * n_g the independent numbers of signal g, n their sum, k = S q + (1 + 1/S) x parameters for q
 * columns in each of S. The part 1/S pays for the search: among n places the best finds a factor
 * n more in noise than one given column does, whatever S is, and one channel's amplitudes alone
 * would let it pass in a few of a hundred records. With u = S q + parameters unknowns one more
 * lowers n ln rss by noise alone not by 1 but by n / (n - u), so that their price rises, on
 * average over the u of them, by
 *
 *     h = -ln(1 - u/n) / (u/n),                                                    (2)
 *
 * which is 1 for records much longer than their model.
 */
#include "modal/identify/criterion.h"
#include <float.h>
#include <math.h>

static const double SCARCE_MOST = 0.95;     /* of the numbers, for (2) */

/* (2). */
static double scarcity(double unknowns, double numbers)
{
    double x = fmin(numbers > 0 ? unknowns / numbers : 0, SCARCE_MOST);

    return x > 0 ? -log1p(-x) / x : 1;
}

double criterion_price(const struct criterion *c, int order, int parameters)
{
    double used = 0, live = 0;

    for (int g = 0; g < c->groups; g++)
        if (c->energy[g] > 0)
            used += c->own, live += c->phases;
    return scarcity(live * order + parameters, used)
         * (live * order + (1 + 1 / fmax(live, 1)) * parameters) * log(fmax(used, 2));
}

double criterion_of(const struct criterion *c, const double *rss, double factor, int order,
                    int parameters)
{
    double sum = 0;

    for (int g = 0; g < c->groups; g++)
        if (c->energy[g] > 0)
            sum += c->own * log(fmax(factor * rss[g] / c->numbers, fmax(c->floor2[g], DBL_MIN)));
    return sum + criterion_price(c, order, parameters);
}
