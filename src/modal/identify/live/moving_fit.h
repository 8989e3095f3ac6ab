/* moving_fit.h - the refined fit of refine.h on compressed rows, from a start that is already near
 * */
#ifndef MODAL_MOVING_FIT_H
#define MODAL_MOVING_FIT_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/live/moving_columns.h"
#include "modal/linalg/matrix.h"
#include "modal/linalg/workspace.h"

/* One list of signals on such rows. */
struct moving_signals {
    struct matrix X;             /* rows x r */
    const double *outside2;      /* r: sum of squares of what Q does not hold */
};

struct moving_fit {
    int poles, order, signals, parameters;
    double complex *lambda;      /* 1/s, in the order of the start */
    double *std_re, *std_im;     /* 1/s; 0 for what is fixed or exact by kind */
    double *C;                   /* order x signals, of columns divided by their largest entry */
    double *rss;                 /* per signal */
    double *energy, *floor2;     /* per signal: sum of squares; mean square that rounding leaves */
    double could_gain;           /* moving_probe: by how much -2 ln(likelihood) could fall, as
                                  * refine.c's `hopeless` reckons */
    double least_drop;           /* by how much BIC rises where the least needed pole is left out */
    double most_split;           /* by how much -2 ln(likelihood) falls where one pole becomes two
                                  * that nearly coincide, at most */
    double most_free;            /* by how much it falls where a pole that is fixed at 0 may move,
                                  * about; 0 where there is none */
    double price, pair_price;    /* what one more parameter, one more pair costs in BIC */
    double work;        /* multiplications, about: rows x columns^2 an evaluation, as in refine.h */
    bool settled;                /* at the minimum, as refine_options.settle means it */
    struct workspace space;      /* of the arrays */
};

/*
 * From START (COUNT poles, listed as in exponents.h; one that is 0 exactly keeps its value) to the
 * minimum.  `settled` false: the start was not near, or there is no minimum near; the rest is then
 * the best there was.  *out is the caller's, to moving_fit_done. Fails with MODAL_BAD_INPUT (fewer
 * rows than twice the order and the signals), MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status moving_fit(const struct moving_rows *rows, const struct moving_signals *signals,
                             const double complex *start, int count, struct moving_fit *out,
                             struct modal_error *err);

/* The same without a step: coefficients and residuals of the poles as they are. */
enum modal_status moving_look(const struct moving_rows *rows, const struct moving_signals *signals,
                              const double complex *lambda, int count, struct moving_fit *out,
                              struct modal_error *err);

/* The same with standard errors, and `could_gain`. */
enum modal_status moving_probe(const struct moving_rows *rows, const struct moving_signals *signals,
                               const double complex *lambda, int count, struct moving_fit *out,
                               struct modal_error *err);
void moving_fit_done(struct moving_fit *f);
#endif
