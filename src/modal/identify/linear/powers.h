/* powers.h - the columns that a pole has in a basis */
#ifndef MODAL_POWERS_H
#define MODAL_POWERS_H
#include "modal/identify/linear/exponents.h"

/*
 * Of the blocks of rows that a basis is worked on by: all columns of a block are those of the first
 * one times a factor each, so that a record costs its blocks, and not its rows, in exponentials.
 * Three files take them so (fit/compressed.c, fit/doubling.c, fit/gram.c), a fourth reads what they
 * leave (order/long_rest.c).
 */
enum {
    POWERS_BLOCK_LEAST = 64,     /* rows: below, the calls cost more than the sums */
    POWERS_WIDE = 4,             /* rows a column: a block shrinks to a quarter at least, and Q',
                                  * which has two, weighs little beside it */
    POWERS_CHUNK = 1 << 14       /* rows at once: 128 kB a channel, in a second cache */
};

/* COUNT poles per step: a = Re lambda tau, b = Im lambda tau; their first columns in Phi, of ORDER
 * columns. */
struct doubling_poles {
    int count, order;
    const enum pole_kind *kind;
    const int *column;
    const double *a, *b;
};

/*
 * e^{a l} times (cos b l, -sin b l) of a pair into x[l] and x[l + ld], 1 of a real multiplier or
 * (-1)^l of a negative one into x[l], l = 0 .. L-1; growing ones are divided by their last, so that
 * nothing exceeds 1.  Phases are those of the rounded b, exact to a few DBL_EPSILON.
 */
void powers_of(enum pole_kind kind, double a, double b, int L, double *x, int ld);

/* The row of L about which e^{a l} has its weight: 1 / |a| from the end where it is large, the
 * middle at most.  Derivatives diag(l - c) Phi are taken there, which changes them by a multiple of
 * Phi and keeps them as independent of it as they can be. */
double powers_centre(double a, int L);

/* e^x - 1, without cancelling near 0. */
double complex powers_grown(double complex x);
#endif
