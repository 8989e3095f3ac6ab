/* numbers.c - see numbers.h */
#include "modal/numbers.h"
#include <math.h>
#include <stdlib.h>

/* numbers, which n^2 / 4 moves sort sooner than qsort's calls do: by measurement up to 256, and in
 * the reverse order there are twice as many moves */
enum { FEW = 64 };

/* Each leaves half on average: so many leave all only where the order is made for that. */
enum { PASSES = 64 };

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

void numbers_sort(double *x, size_t count)
{
    for (size_t i = 1; i < count && count <= FEW; i++) {
        double v = x[i];
        size_t k = i;

        for (; k > 0 && x[k - 1] > v; k--)
            x[k] = x[k - 1];
        x[k] = v;
    }
    if (count > FEW)
        qsort(x, count, sizeof *x, by_value);
}

static double middle(double a, double b, double c)
{
    return fmax(fmin(a, b), fmin(fmax(a, b), c));
}

double numbers_ranked(double *x, size_t count, size_t k)
{
    size_t low = 0, high = count > 0 ? count - 1 : 0;

    for (int pass = 0; high - low >= FEW && pass < PASSES; pass++) {
        const double pivot = middle(x[low], x[low + (high - low) / 2], x[high]);
        size_t i = low, j = high;

        for (;; i++, j--) {                   /* two of the three stop these */
            while (x[i] < pivot)
                i++;
            while (x[j] > pivot)
                j--;
            if (i >= j)
                break;
            const double v = x[i];
            x[i] = x[j], x[j] = v;
        }
        *(k <= j ? &high : &low) = k <= j ? j : j + 1;        /* none up to j is above the rest */
    }
    numbers_sort(x + low, high - low + 1);
    return x[k];
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

double complex numbers_row_dot(int count, const double complex *a, int lda,
                               const double complex *b, int ldb)
{
    double complex sum = 0;

    for (int i = 0; i < count; i++)
        sum += conj(a[(size_t)i * (size_t)lda]) * b[(size_t)i * (size_t)ldb];
    return sum;
}
