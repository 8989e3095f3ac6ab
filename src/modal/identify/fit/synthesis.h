/* synthesis.h - the signals rebuilt from the exponents: one column-scaled Vandermonde least-squares
 * solve */
#ifndef MODAL_SYNTHESIS_H
#define MODAL_SYNTHESIS_H
#include <complex.h>
#include "base/error.h"
#include "modal/linalg/least_squares.h"
#include "modal/linalg/matrix.h"

/*
 * The model on rows l = 0..L-1, a step tau apart, poles as in exponents.h, channel c:
 *
 *   y[l, c] = Re sum_j B[j, c] exp(lambda_j tau l),        B real for the real kinds.
 *
 * Columns of the basis are scaled to largest magnitude 1 over the record, so growth does not
 * overflow: the coefficient belongs to exp(lambda_j tau l - reference_j), reference_j = max(0, Re
 * lambda_j tau (L-1)).
 */
struct synthesis {
    int poles, order, rows, channels;
    double complex *coefficient;  /* (j, c) at j + c*poles: of the scaled column */
    double *reference;            /* poles: ln of the scale taken out of each */
    double *channel_residual;     /* channels: norm of Y - fit in each */
    int rank;                     /* of the basis */
    double residual;              /* Frobenius norm of Y - fit */
};

/* Fit Y (L x channels, kept).  *out is the caller's to synthesis_done.  FIT, L x channels, may be
 * NULL. */
enum modal_status synthesis_fit(const double complex *lambda, int count, double tau,
                                const struct matrix *Y, struct matrix *fit, struct synthesis *out,
                                struct modal_error *err);
/* The same of the record of BLOCKS, which are made to hold where they do not. */
struct compressed;
enum modal_status synthesis_fit_blocks(const double complex *lambda, int count, double tau,
                                       struct compressed *blocks, struct synthesis *out,
                                       struct modal_error *err);
void synthesis_done(struct synthesis *s);

/* The products of all columns of the basis of L rows, columns scaled: G, order x order. They are
 * geometric sums, right to the rounding of the larger of the two columns of each pole: no column is
 * made. */
void synthesis_products(const double complex *lambda, int count, double tau, int L, double *G);
#endif
