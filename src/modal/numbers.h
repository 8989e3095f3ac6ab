/* numbers.h - an array of numbers in order, or one of them by its rank, its largest magnitude, and
 * rows of matrices */
#ifndef MODAL_NUMBERS_H
#define MODAL_NUMBERS_H
#include <complex.h>
#include <stddef.h>

/* Sorts the COUNT numbers of X, none of them NAN, ascending. */
void numbers_sort(double *x, size_t count);

/* The one of them that would be the K-th, from 0, were they sorted, in the time of reading them a
 * few times; X is left in some order. */
double numbers_ranked(double *x, size_t count, size_t k);

/* max |x_i| of COUNT numbers, real or complex, those that are NAN passed over; 0 of none. */
double numbers_largest(const double *x, size_t count);
double numbers_modulus(const double complex *x, size_t count);

/* sum conj(a_i) b_i of COUNT numbers, each LDA and LDB after the one before: rows of matrices by
 * columns.  cblas_zdotc_sub of OpenBLAS 0.3.21 reads a number beyond the last of such rows, and
 * ends the program where that is another page's; with a step of 1 it does not. */
double complex numbers_row_dot(int count, const double complex *a, int lda,
                               const double complex *b, int ldb);

/* |z|^2 */
static inline double numbers_square(double complex z)
{
    return creal(z) * creal(z) + cimag(z) * cimag(z);
}

/* a b of finite numbers: C's product asks whether they are. */
static inline double complex numbers_times(double complex a, double complex b)
{
    return CMPLX(creal(a) * creal(b) - cimag(a) * cimag(b),
                 creal(a) * cimag(b) + cimag(a) * creal(b));
}
#endif
