/*
 * quadrature.c - see quadrature.h
 *
 * The points are the roots of P_n by Newton from cos(pi (i + 3/4)/(n + 1/2)), the weights 2/((1 -
 * x^2) P_n'^2).
 */
#include "modal/scene/quadrature.h"
#include <math.h>

/* P_n(x) and its derivative, |x| < 1, by the three-term recurrence. */
static double legendre(int n, double x, double *derivative)
{
    double before = 1, p = x;

    for (int k = 2; k <= n; k++) {
        double next = ((2 * k - 1) * x * p - (k - 1) * before) / k;
        before = p;
        p = next;
    }
    *derivative = n * (x * p - before) / (x * x - 1);
    return p;
}

void gauss_legendre(int count, double length, double *position, double *weight)
{
    for (int i = 0; i < count; i++) {
        double x = -cos(M_PI * (i + 0.75) / (count + 0.5)), slope = 1;

        for (int step = 0; step < 8; step++)          /* quadratic: 4 suffice for any count here */
            x -= legendre(count, x, &slope) / slope;
        legendre(count, x, &slope);
        position[i] = length * (1 + x) / 2;
        weight[i] = length / ((1 - x * x) * slope * slope);
    }
}
