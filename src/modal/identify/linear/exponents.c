/*
 * exponents.c - multipliers and exponents
 *
 *     lambda = (ln|rho| + i arg rho) / tau,   arg in (-pi, pi].                                 (1)
 *
 * Eq. (10) of the paper, zeta = sqrt(c^2/(1+c^2)), omega = c phi/(zeta T), c = ln|rho|/phi, loses
 * the sign of zeta and is NaN at phi = 0, at |rho| = 1 and at rho = 0.  (1) has none of these, and
 * omega = |lambda|, zeta = -Re lambda / |lambda|; the paper's zeta has the opposite sign.
 *
 * Near |rho| = 1, ln|rho| by the hypotenuse loses what damping of 1e-6 is made of; with a >= b the
 * two magnitudes,
 *
 *     ln|rho| = log1p((a - 1)(a + 1) + b^2) / 2                                                 (2)
 *
 * keeps it: a - 1 is exact for a in [1/2, 2].
 */
#include "modal/identify/linear/exponents.h"
#include <math.h>
#include <stdlib.h>

enum pole_kind pole_kind(double complex lambda, double tau)
{
    if (cimag(lambda) == 0)
        return POLE_REAL;
    return cimag(lambda) == M_PI / tau ? POLE_NEGATIVE : POLE_PAIR;
}

int pole_order(double complex lambda, double tau)
{
    return pole_kind(lambda, tau) == POLE_PAIR ? 2 : 1;
}

int poles_order(const double complex *lambda, int count, double tau)
{
    int order = 0;

    for (int i = 0; i < count; i++)
        order += pole_order(lambda[i], tau);
    return order;
}

int poles_apart(const double complex *lambda, int count, double tau, int rows)
{
    int apart = count;

    for (int i = 0; i < count; i++) {
        double turn = fmin(cimag(lambda[i]), M_PI / tau - cimag(lambda[i])) * tau;
        apart += pole_kind(lambda[i], tau) == POLE_PAIR && 2 * turn * rows < M_PI;
    }
    return apart;
}

double log_modulus(double complex rho)
{
    double a = fabs(creal(rho)), b = fabs(cimag(rho)), t, excess;

    if (a < b)
        t = a, a = b, b = t;
    if (a > 2 || a < 0.5)
        return log(hypot(a, b));
    excess = (a - 1) * (a + 1) + b * b;  /* (2) */
    return fabs(excess) < 0.5 ? 0.5 * log1p(excess) : log(hypot(a, b));
}

double complex exponent_of(double complex rho, double tau)
{
    double re, im = cimag(rho);

    if (rho == 0)
        return CMPLX(-HUGE_VAL, 0);
    re = log_modulus(rho) / tau;
    if (im == 0)
        /* the principal branch: a negative multiplier turns by pi a step */
        return CMPLX(re, creal(rho) > 0 ? 0 : M_PI / tau);
    return CMPLX(re, carg(rho) / tau);
}

double complex multiplier_of(double complex lambda, double tau)
{
    double modulus = exp(creal(lambda) * tau);

    switch (pole_kind(lambda, tau)) {
    case POLE_REAL:
        return modulus;
    case POLE_NEGATIVE:
        return -modulus;
    default:
        return CMPLX(modulus * cos(cimag(lambda) * tau), modulus * sin(cimag(lambda) * tau));
    }
}

double frequency_of(double complex lambda)
{
    return hypot(creal(lambda), cimag(lambda));
}

double damping_ratio_of(double complex lambda)
{
    double omega = frequency_of(lambda);

    return omega > 0 ? 0 - creal(lambda) / omega : 0;
}

static int by_modulus(const void *a, const void *b)
{
    double complex p = *(const double complex *)a, q = *(const double complex *)b;

    if (creal(p) != creal(q))
        return creal(p) > creal(q) ? -1 : 1;
    return (cimag(p) > cimag(q)) - (cimag(p) < cimag(q));
}

int poles_of_multipliers(const double complex *rho, int count, double tau, double floor,
                         double complex *lambda, int *dropped)
{
    int poles = 0, lost = 0;

    for (int i = 0; i < count; i++) {
        /* ln of it is rounding */
        if (!(cabs(rho[i]) > floor) || !isfinite(creal(rho[i])) || !isfinite(cimag(rho[i])))
            lost++;
        else if (cimag(rho[i]) >= 0)  /* of a pair the one above: real matrices have both */
            lambda[poles++] = exponent_of(rho[i], tau);
    }
    qsort(lambda, poles, sizeof *lambda, by_modulus);
    if (dropped != NULL)
        *dropped = lost;
    return poles;
}
