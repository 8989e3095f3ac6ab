/* numbers.h - an array of numbers in order, and its largest magnitude */
#ifndef MODAL_NUMBERS_H
#define MODAL_NUMBERS_H
#include <complex.h>
#include <stddef.h>

/* Sorts the COUNT numbers of X, none of them NAN, ascending. */
void numbers_sort(double *x, size_t count);

/* max |x_i| of COUNT numbers, real or complex, those that are NAN passed over; 0 of none. */
double numbers_largest(const double *x, size_t count);
double numbers_modulus(const double complex *x, size_t count);
#endif
