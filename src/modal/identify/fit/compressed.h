/* compressed.h - a very long record, each block of rows by what it shows near a set of poles */
#ifndef MODAL_COMPRESSED_H
#define MODAL_COMPRESSED_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/linear/powers.h"
#include "modal/linalg/matrix.h"

/*
 * Y, whose rows are (block << levels) and `left` more, and Q, block x rows, an orthonormal basis
 * of what poles near the known ones have in a block, be it any. Column c of Y is Q^T of each of
 * its blocks, rows x blocks from data + c * rows * blocks on, what they leave, and its last `left`
 * rows as they are.
 */
struct compressed {
    struct matrix Y;             /* x borrowed */
    int block, levels, left, rows;
    double *Q, *data;
    double *rest;                /* per column: sums of squares of what Q leaves of the first half
                                  * of the blocks, and of the others */
    double *energy, *swing;      /* per column of Y: sums of squares of it, of its steps */
    double *a, *angle;           /* per known pole */
    int count;
};

/* Of Y, borrowed until compressed_free, and no poles yet; NULL: no memory. */
struct compressed *compressed_new(const struct matrix *Y);
void compressed_free(struct compressed *c);

/* The same of the first half of its blocks, or of the rows after them (LATER); NULL: no memory. */
struct compressed *compressed_half(const struct compressed *c, bool later);

/* Does it tell of these poles what Y does, but for 1e-11 of their part of it? */
bool compressed_holds(const struct compressed *c, const struct doubling_poles *poles);

/*
 * Make it hold: one pass over Y. Fails with MODAL_NO_MEMORY, and MODAL_NO_CONVERGENCE (LAPACK),
 * and then knows no poles.
 */
enum modal_status compressed_about(struct compressed *c, const struct doubling_poles *poles,
                                   struct modal_error *err);
#endif
