/* projection.h - the Hankel pair in the coordinates of its leading triplets: all orders, and error
 * bars, from small matrices */
#ifndef MODAL_PROJECTION_H
#define MODAL_PROJECTION_H
#include <complex.h>
#include "base/error.h"
#include "modal/identify/linear/hankel.h"
#include "modal/identify/result.h"
#include "modal/linalg/matrix.h"

/* H0 = U S V^T + rest; W = U^T H1.  Since column l of H1 is column l+1 of H0, W is S V^T moved by
 * one column, and U^T times the one new column. */
struct projection {
    int m, n;                   /* of H0 */
    int count;                  /* k triplets */
    double *s;                  /* k, descending */
    struct matrix VT;           /* k x n */
    struct matrix W;            /* k x n */
    struct matrix G;            /* k x k: U^T H1 V */
};

/* The leading triplets, at least `wanted` of them or all above rounding.  The caller frees *out
 * with projection_done. */
enum modal_status projection_make(const struct hankel *h, int wanted, struct projection *out,
                                  struct modal_error *err);
void projection_done(struct projection *p);

/* The poles of rank R (exponents.h; tau seconds a shift), into LAMBDA (room for R).  *dropped:
 * multipliers that are zero to rounding. */
enum modal_status projection_poles(const struct projection *p, enum identify_method method, int r,
                                   double tau, double complex *lambda, int *count, int *dropped,
                                   struct modal_error *err);

/*
 * How far the multipliers of rank R move when the first columns, and then the last, are left out
 * (one period; a tenth where there is none), and when time runs backwards (1/eig of the pair (H1,
 * H0)): the largest of the three, for each of the COUNT poles; NAN where too few columns would be
 * left.
 */
enum modal_status projection_bars(const struct projection *p, int r, int left_out, double tau,
                                  const double complex *lambda, int count, double *bar,
                                  struct modal_error *err);

/* Of each of COUNT poles the sine of the angle between (1, rho, rho^2, ...) and the span of the R
 * leading right vectors, rows of VT: 0 for a multiplier that the signals obey exactly; NAN: no
 * memory. */
void projection_angles(const struct matrix *VT, int r, const double complex *lambda, int count,
                       double tau, double *angle);
#endif
