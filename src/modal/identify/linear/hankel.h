/* hankel.h - the Hankel pair H0, H1 of one or many signals, formed or as an operator */
#ifndef MODAL_HANKEL_H
#define MODAL_HANKEL_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/lanczos.h"
#include "modal/linalg/matrix.h"

/*
 * Signal s is column s of Y (K samples x S signals).  Block s of the pair, stacked by rows (18), is
 *
 *   H0[s m + i, l] = Y[start + i + l p, s],    H1[s m + i, l] = Y[start + i + (l+1) p, s],
 *   i = 0..m-1,  l = 0..n-1,                                                              (14)
 *
 * and needs start + n p + m <= K.  H1 is H0 with start + p.
 */
struct hankel {
    const struct matrix *Y;   /* borrowed */
    int start, rows, columns, shift;
};

/* Room for the pair? MODAL_BAD_INPUT names the option (`rows` or `columns`) that asks too much. */
enum modal_status hankel_check(const struct hankel *h, struct modal_error *err);

/* Default sizes for what is 0.  shift 1: rows about K/3 per signal; shift > 1: one period of rows,
 * every whole column. */
void hankel_default_sizes(int samples, int shift, int *rows, int *columns);

/* H0 into OUT, (S rows) x columns. */
void hankel_form(const struct hankel *h, struct matrix *out);

/* y = H0 x (S rows numbers), x = H0^T y, without forming it: direct sums. */
void hankel_apply(const struct hankel *h, const double *x, double *y);
void hankel_apply_transpose(const struct hankel *h, const double *y, double *x);
#endif
