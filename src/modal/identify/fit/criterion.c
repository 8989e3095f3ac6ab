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
 *
 * Of a periodic system each sample of a period has an amplitude of its own, and ln n for each of S
 * of those is many times what keeps noise out: of S columns of white noise k given ones of the
 * basis take chi-squared of k S degrees of freedom, more than k S + 2 sqrt(k S x) + 2 x with less
 * than e^-x [LM00], and with e^-x = FALSE_ALARM / CRITERION_PLACES L the best of the poles in L
 * rows does so in a share FALSE_ALARM of records at most. One of k columns that comes where m
 * numbers are left free lowers -2 ln(likelihood) by noise by less than
 *
 *     -n ln(1 - (k (S + 1) + 2 sqrt(k S x) + 2 x) / m),                             (3)
 *
 * no matter how few rows are left. Such a model pays (3) for each pair and for each real pole
 * (poles_apart), where that is less than what (1) asks: a second real pole that came for the rest
 * of a pair's price would be given by noise in one of twenty records that have one.
 *
 * Noise that is not white along a row has other variances w in its S directions, of mean 1;
 * chi-squared is then less than k S + 2 sqrt(k x sum w^2) + 2 x max w [LM00]. What share of them is
 * as good as free, s = S / sum w^2, says the largest too, for noise that is forgotten at one rate:
 * correlated by a^j over j samples it has
 *
 *     s = (1 - a^2) / (1 + a^2),    max w = (1 + a) / (1 - a).
 *
 * [LM00] Laurent and Massart, Ann. Statist. 28 (2000) 1302-1338.
 * [WH31] Wilson and Hilferty, Proc. Natl. Acad. Sci. 17 (1931) 684-688: the cube root of
 *        chi-squared of f degrees over f is normal, of mean 1 - 2 / (9 f) and variance 2 / (9 f).
 */
#include "modal/identify/fit/criterion.h"
#include <float.h>
#include <math.h>

static const double
    SCARCE_MOST = 0.95,         /* of the numbers, for (2) */
    FALSE_ALARM = 1e-3;         /* of records, for (3) */

double criterion_scarcity(double unknowns, double numbers)
{
    double x = fmin(numbers > 0 ? unknowns / numbers : 0, SCARCE_MOST);

    return x > 0 ? -log1p(-x) / x : 1;
}

/* What noise gives a pole of K columns of S amplitudes, of so many NUMBERS, at most. */
static double noise_most(double S, double white, double numbers, int k)
{
    double x = log(CRITERION_PLACES * numbers / S / FALSE_ALARM);
    double a = sqrt((1 - white) / (1 + white));

    return k * (S + 1) + 2 * sqrt(k * S / white * x) + 2 * x * (1 + a) / (1 - a);
}

double criterion_noise_pair(double columns, double white, double numbers)
{
    return noise_most(columns, white, numbers, 2);
}

double criterion_chance(double columns, double numbers, double chi2, int k)
{
    double freedom = k * (columns + 1), spread = 2 / (9 * freedom);
    double normal = (cbrt(chi2 / freedom) - (1 - spread)) / sqrt(spread);            /* [WH31] */

    return fmin(CRITERION_PLACES * numbers / columns * erfc(normal / M_SQRT2) / 2, 1);
}

int criterion_order_told(double columns, double numbers)
{
    return (int)fmax((numbers - criterion_noise_pair(columns, 1, numbers)) / (columns + 1), 0);
}

/* (3) for the first POLES, each of K columns of S amplitudes, after USED ones. */
static double false_alarm(double S, double white, double numbers, int poles, int k, int used)
{
    double most = noise_most(S, white, numbers, k), sum = 0;

    for (int j = 0; j < poles; j++) {
        double left = numbers - (used + j * k) * (S + 1);
        sum -= log(fmax(1 - most / fmax(left, 1), 1 / numbers));
    }
    return numbers * sum;
}

double criterion_price(const struct criterion *c, int poles, int order, int parameters)
{
    double used = 0, live = 0, bayes, white = c->white > 0 ? c->white : 1;
    int pairs = order - poles;      /* of POLES, these have two columns */

    for (int g = 0; g < c->groups; g++)
        if (c->energy[g] > 0)
            used += c->own, live += c->phases;
    bayes = criterion_scarcity(live * order + parameters, used)
          * (live * order + (1 + 1 / fmax(live, 1)) * parameters) * log(fmax(used, 2));
    return c->phases == 1 || c->exact || live == 0 ? bayes
         : fmin(bayes, false_alarm(live, white, used, pairs, 2, 0)
                       + false_alarm(live, white, used, poles - pairs, 1, 2 * pairs));
}

double criterion_of(const struct criterion *c, const double *rss, double factor, int poles,
                    int order, int parameters)
{
    double sum = 0;

    for (int g = 0; g < c->groups; g++)
        if (c->energy[g] > 0)
            sum += c->own * log(fmax(factor * rss[g] / c->numbers, fmax(c->floor2[g], DBL_MIN)));
    return sum + criterion_price(c, poles, order, parameters);
}
