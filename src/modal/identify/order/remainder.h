/* remainder.h - poles in what a fit leaves of the signals */
#ifndef MODAL_REMAINDER_H
#define MODAL_REMAINDER_H
#include "modal/identify/fit/refine.h"

/*
 * E = Y - Phi C of the poles of FIT, its columns over the noise that the fit says they have; E is
 * L x S, the caller's to free. Columns that are exact to rounding, or zero, are zero; parts that
 * cancel each other round as they are, not as their sum. E->x is NULL where the poles coincide.
 */
enum modal_status remainder_of(const struct refine_data *data, const struct refined *fit,
                               struct matrix *E, struct modal_error *err);

/* What column C of it is multiplied by, 0 where it is made zero: of amplitudes in p->Z. */
double remainder_unit(const struct refine_data *data, const struct refined *fit,
                      const struct projected *p, int c);

/*
 * The undamped, decaying or growing pole that E shows most of, of a grid (remainder.c), in 1/s, and
 * the chi-squared of its amplitudes in all columns: 0.6 and more of that of the best of all poles,
 * and, beside others that were fitted, less than fitting it with them would take.
 */
enum modal_status remainder_peak(const struct matrix *E, double tau, double complex *lambda,
                                 double *chi2, struct modal_error *err);

/* Poles of E by the pencil, at most `most` of them, into LAMBDA: those above the edge of noise,
 * but two directions at least. */
enum modal_status remainder_poles(const struct matrix *E, double tau, int most,
                                  double complex *lambda, int *count, struct modal_error *err);

/*
 * Chi-squared that a second pole beside LAMBDA, a pair, could take from E at most, to first
 * order: two neighbours lambda +- d span e^{lambda t}, t e^{lambda t} and t^2 e^{lambda t}, and
 * the fit of one has the first two; of lines that share their exponent (TIED) the first alone.
 * HUGE_VAL where the record hardly tells those apart.
 */
enum modal_status remainder_split(const struct matrix *E, double tau, double complex lambda,
                                  bool tied, double *chi2, struct modal_error *err);

/*
 * The same of a record by blocks (compressed.h): of E in each block its Q^T, REST, rows x blocks x
 * columns, and its rows after them, TAIL.
 */
enum modal_status remainder_split_blocks(const struct compressed *blocks, const double *rest,
                                         const struct matrix *tail, double tau,
                                         double complex lambda, double *chi2,
                                         struct modal_error *err);
#endif
