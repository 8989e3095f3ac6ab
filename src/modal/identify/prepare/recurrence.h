/* recurrence.h - what each sample of a column is by those before it, or after it */
#ifndef MODAL_RECURRENCE_H
#define MODAL_RECURRENCE_H
#include <stdbool.h>

enum {
    RECURRENCE_MOST = 64,        /* order */
    RECURRENCE_SPARE = 8         /* times it, rows: of fewer it is the samples themselves */
};

/*
 * The recurrences of order P, up to RECURRENCE_MOST, that leave the least sum of squares of
 *
 *     e[l] = sum_j a_j z[l -+ j],   j = 0 .. P,   a_0 = 1,
 *
 * FORWARD and BACK (or NULL), P + 1 numbers each, over those l whose e has no row that is OUT (L of
 * them; NULL: none is). False: they are too few.
 */
bool recurrence_fit(const double *z, const bool *out, int L, int p, double *forward, double *back);

/* e, L of them, 0 where z has no P rows before (after), of the recurrence A forward (SENSE 1) or
 * back (-1). */
void recurrence_leaves(const double *a, int p, int sense, const double *z, int L, double *e);

/* x = B^-1 x, B symmetric of bandwidth KD: entry (i, i - d) at B[i (KD + 1) + d]; destroyed.
 * False: not positive. */
bool recurrence_band_solve(double *B, int n, int kd, double *x);
#endif
