/*
 * powers.c - powers of a multiplier by a table and blocks
 *
 * z^{k + j} = z^k z^j with j < TABLE: one sine, cosine and exponential a row of the table and a
 * block, and one product each.  b k is taken in twice the precision (high + low), for the phase is
 * large where the record is long.  Growth of more than STEEP a row would overflow the table, though
 * nothing overflows once it is divided by the last: such columns, zero but for their last rows, are
 * made row by row.
 */
#include "modal/identify/linear/powers.h"
#include <math.h>

enum { TABLE = 64 };              /* rows for which one exponential is multiplied out */
/* growth a row: a table of so many rows does not overflow */
static const double STEEP = EXPONENT_MOST / TABLE;

/* e^{i b l}. */
static void turn(double b, int l, double *c, double *s)
{
    double high = b * l, low = fma(b, l, -high), cosine = cos(high), sine = sin(high);

    *c = cosine - low * sine, *s = sine + low * cosine;
}

static void pair_powers(double a, double b, double reference, int L, double *re, double *im)
{
    double tr[TABLE], ti[TABLE], c, s;

    for (int j = 0; j < TABLE && j < L; j++) {
        double e = exp(a * j);
        turn(b, j, &c, &s);
        tr[j] = e * c, ti[j] = -e * s;
    }
    for (int k = 0; k < L; k += TABLE) {
        double e = exp(a * k - reference);
        turn(b, k, &c, &s);
        c *= e, s *= -e;
        for (int j = 0; j < TABLE && k + j < L; j++) {
            re[k + j] = c * tr[j] - s * ti[j];
            im[k + j] = c * ti[j] + s * tr[j];
        }
    }
}

static void real_powers(double a, double reference, bool alternate, int L, double *x)
{
    double table[TABLE];

    for (int j = 0; j < TABLE && j < L; j++)
        table[j] = alternate && j % 2 ? -exp(a * j) : exp(a * j);
    for (int k = 0; k < L; k += TABLE) {
        double e = exp(a * k - reference);
        for (int j = 0; j < TABLE && k + j < L; j++)
            x[k + j] = e * table[j];
    }
}

static void steep_powers(enum pole_kind kind, double a, double b, int L, double *x, int ld)
{
    for (int l = 0; l < L; l++) {
        double e = exp(a * (l - (L - 1))), c, s;
        turn(b, l, &c, &s);
        x[l] = kind == POLE_PAIR ? e * c : kind == POLE_NEGATIVE && l % 2 ? -e : e;
        if (kind == POLE_PAIR)
            x[l + ld] = -e * s;
    }
}

void powers_of(enum pole_kind kind, double a, double b, int L, double *x, int ld)
{
    double reference = a > 0 ? a * (L - 1) : 0;

    if (a > STEEP)
        steep_powers(kind, a, b, L, x, ld);
    else if (kind == POLE_PAIR)
        pair_powers(a, b, reference, L, x, x + ld);
    else
        real_powers(a, reference, kind == POLE_NEGATIVE, L, x);
}

double powers_centre(double a, int L)
{
    return a == 0 ? 0.5 * (L - 1) : a > 0 ? L - 1 - fmin(0.5 * L, 1 / a) : fmin(0.5 * L, -1 / a);
}

double complex powers_grown(double complex x)
{
    double s = sin(0.5 * cimag(x)), e = exp(creal(x));

    /* cos y = 1 - 2 sin^2(y/2) */
    return CMPLX(expm1(creal(x)) - 2 * e * s * s, e * sin(cimag(x)));
}
