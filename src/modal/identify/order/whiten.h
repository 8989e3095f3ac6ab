/* whiten.h - noise that the samples before tell of in a periodic system, made white */
#ifndef MODAL_WHITEN_H
#define MODAL_WHITEN_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * How unequal the directions are in which the noise E of M free rows is free in its S columns:
 * S sum w^2 / (sum w)^2 of their variances w; 1 of white noise but for chance, which moves it by
 * 2 / M, 1 over the share of columns of what is correlated along a row, and up to S of a multiplier
 * that is missing from the fit. Of the Wishart matrix A = E E^T
 *
 *     E tr A = M sum w,    E (tr A^2 - (tr A)^2 / M) = (M - 1) (M + 2) sum w^2.
 *
 *   spread   0 where E is zero; HUGE_VAL of one row, which tells nothing
 */
#define NOISE_CHANCE 6.0        /* over M: three standard errors of it */
enum modal_status noise_spread(const struct matrix *E, int M, double *spread,
                               struct modal_error *err);

/* Periods as rows, `phases` samples of each signal side by side. */
struct periods {
    struct matrix *Y;           /* borrowed */
    int phases;
    int samples;                /* of a signal: some that begin a period lie after the last */
};

/*
 * E is what a fit of ORDER columns leaves of the periods. Each signal's noise is predicted from the
 * samples before it (whiten.c); where that lowers -2 ln(likelihood) of all signals by more than
 * LEAST beside its price, and what it tells of is noise (in no multiplier more than noise as
 * unequal puts there: one that E holds still is not told away; of rows too few for
 * that, what it leaves is spread as by chance), every sample becomes what those
 * before it do not tell. The first of the record, which have too few, are gone, and with them a
 * period: multipliers stay as they are, amplitudes change.
 *
 *   told   the share of the noise's variance that was told, the signals alike; 0: all is as it was
 *
 * Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status whiten_periods(struct periods *of, const struct matrix *E, int order,
                                 double least, double *told, struct modal_error *err);

/*
 * The same before any fit: noise may be correlated by a^j over j samples, a = +-(1/2, 3/4, 7/8 ..),
 * the memory twice as long as long as that is better by (3) of whiten.c, signal g times WEIGHT[g]
 * (NULL: 1), and in the end by more than LEAST; from there a is found as well as it is known. Of
 * columns fewer than twice the periods nothing is asked.
 */
enum modal_status whiten_first(struct periods *of, const double *weight, double least,
                               double *told, struct modal_error *err);
#endif
