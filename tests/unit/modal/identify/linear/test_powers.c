/* Powers of a multiplier against extended precision. */
#include "modal/identify/linear/powers.h"
#include <float.h>
#include <math.h>
#include "check.h"

/* e^{i b l} with b l exact: b in two parts whose products with l fit into 64 bits. */
static void turned(double b, int l, long double *c, long double *s)
{
    long double high = (float)b, x = high * l, y = (b - high) * l;

    *c = cosl(x) * cosl(y) - sinl(x) * sinl(y), *s = sinl(x) * cosl(y) + cosl(x) * sinl(y);
}

/* One product of two numbers known to about one DBL_EPSILON each, of phases exact to the rounded b:
 * 4 of them. */
TEST(powers_of_every_kind_are_right_to_the_last_digits_however_long_the_record)
{
    enum { L = 100003 };
    static const struct { enum pole_kind kind; double a, b; int rows;
    } cases[] = {
        { POLE_PAIR, -3.1 / L, 2.913, L }, { POLE_PAIR, 690.0 / L, 0.0171, L },
        { POLE_PAIR, 0, M_PI - 1e-9, L },  { POLE_PAIR, -36, 1.3, 40 },
        { POLE_REAL, -0.013, 0, L },       { POLE_REAL, 0, 0, 77 },
        { POLE_NEGATIVE, 5.0 / L, 0, L },  { POLE_NEGATIVE, -0.2, 0, 1 },
        { POLE_PAIR, 0.3, 0.7, 64 },       { POLE_REAL, 744.4, 0, 48 },
        { POLE_PAIR, 744.4, 2.5, 70 },     { POLE_NEGATIVE, 30, 0, 100 },
    };
    static double x[2 * (L + 5)];

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int n = cases[i].rows, ld = n + 5;
        long double a = cases[i].a, worst = 0, c, s;
        powers_of(cases[i].kind, cases[i].a, cases[i].b, n, x, ld);
        for (int l = 0; l < n; l++) {
            long double e = expl(a * l - (a > 0 ? a * (n - 1) : 0)), scale = e + DBL_MIN;
            if (cases[i].kind == POLE_PAIR) {
                turned(cases[i].b, l, &c, &s);
                worst = fmaxl(worst, fmaxl(fabsl(x[l] - e * c), fabsl(x[l + ld] + e * s)) / scale);
            } else {
                worst =
                    fmaxl(worst,
                          fabsl(x[l] - (cases[i].kind == POLE_NEGATIVE && l % 2 ? -e : e)) / scale);
            }
        }
        /* the exponential's argument, up to 700, is rounded too */
        CHECK_NEAR((double)worst, 0, (4 + fabs(cases[i].a) * n) * DBL_EPSILON);
    }
}
