/* moving_columns.h - exponentials on the compressed rows of a window */
#ifndef MODAL_MOVING_COLUMNS_H
#define MODAL_MOVING_COLUMNS_H
#include <complex.h>
#include <stddef.h>
#include "base/error.h"

enum { MOVING_MOMENTS = 3 };     /* of a column, at most: e^{lambda t}, and times t, times t^2 */

/*
 * A window of L samples at steps tau: `lead` samples as they are, `blocks` blocks of `length`
 * samples, each as its k numbers Q^T y, and `trail` samples as they are.  Q, length x k, has
 * orthonormal columns that hold every exponential near the poles (moving.c says how near).
 */
struct moving_rows {
    int lead, blocks, trail;
    int length, k;
    const double *Q;             /* borrowed */
    double tau;
    int anchors;                 /* 0: columns are multiplied by Q, whatever they are */
    const double complex *anchor;        /* 1/s, borrowed */
    const double *table;         /* of moving_table, borrowed */
};

/* lead + blocks k + trail; lead + blocks length + trail. */
int moving_rows_count(const struct moving_rows *rows);
int moving_rows_samples(const struct moving_rows *rows);

/* Columns of one pole, `moments` pairs: e^{lambda t} over its largest entry times (t - centre)^i, t
 * in steps; real and minus imaginary part. */
struct moving_column {
    double *re[MOVING_MOMENTS], *im[MOVING_MOMENTS];
    double reference, centre;    /* set by moving_columns: ln of that entry; about the column's
                                  * weight */
};

/* ln of the largest entry of e^{lambda t}. */
double moving_reference(const struct moving_rows *rows, double complex lambda);

/* How many numbers of scratch moving_columns needs. */
size_t moving_columns_scratch(const struct moving_rows *rows);
void moving_columns(const struct moving_rows *rows, double complex lambda, int moments,
                    struct moving_column *column, double *scratch);

/*
 * What the columns of ROWS's anchors are made of: Q^T of the moments of their exponentials.  *table
 * is the caller's, to free. Fails with MODAL_NO_MEMORY.
 */
enum modal_status moving_table(const struct moving_rows *rows, double **table,
                               struct modal_error *err);

/* The columns of COUNT poles side by side into PHI, as many as their order, ld the rows, and room
 * for one more: a real pole's imaginary part. */
void moving_basis(const struct moving_rows *r, const double complex *lambda, int count, double *Phi,
                  double *scratch);
#endif
