/* numbers.c - see numbers.h */
#include "modal/numbers.h"
#include <math.h>
#include <stdlib.h>

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

void numbers_sort(double *x, size_t count)
{
    qsort(x, count, sizeof *x, by_value);
}

double numbers_largest(const double *x, size_t count)
{
    double most = 0;

    for (size_t i = 0; i < count; i++)
        most = fmax(most, fabs(x[i]));
    return most;
}

double numbers_modulus(const double complex *x, size_t count)
{
    double most = 0;

    for (size_t i = 0; i < count; i++)
        most = fmax(most, cabs(x[i]));
    return most;
}
