/* blocks.h - the derivative of a balance on many dofs: sparse, of blocks
 *
 * A block has m = 2 HJ + 1 rows and columns, in the order of aft.h's real vector.  Where laws or
 * periodic matrices act it is full; elsewhere each harmonic acts on itself alone, and of column
 * 2k-1 or 2k only rows 2k-1 and 2k are there.
 */
#ifndef MODAL_BLOCKS_H
#define MODAL_BLOCKS_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct pattern;

struct blocks;

/* Of PATTERN, borrowed.  BORDERED: with one more row and column.  Fails with MODAL_NO_MEMORY or
 * MODAL_TOO_LARGE (field "steady.harmonics"). */
enum modal_status blocks_new(const struct pattern *pattern, int HJ, bool bordered,
                             struct blocks **out, struct modal_error *err);
/* Frees B; NULL is none. */
void blocks_free(struct blocks *b);
/* The HJ it was made for. */
int blocks_harmonics(const struct blocks *b);
/* Every entry 0: derivatives are added up. */
void blocks_clear(struct blocks *b);
/* Column C of block (i, j): entry r at [r], for those r that are there. */
double *blocks_column(struct blocks *b, int i, int j, int c);
/* The bordered B <- [scale A, column; row, corner]: A of the same pattern and HJ, COLUMN and ROW of
 * its order. */
void blocks_set_border(struct blocks *b, const struct blocks *a, double scale, const double *column,
                       const double *row, double corner);
/* False where it is singular to rounding.  The sign of the determinant into *SIGN (may be NULL). */
bool blocks_factor(struct blocks *b, int *sign);
/* The same with MU times the largest entry added on the diagonal; the blocks stay. */
bool blocks_factor_stiffened(struct blocks *b, double mu);
/* Of the last factorization: the least pivot over the largest. */
double blocks_rcond(const struct blocks *b);
/* y <- the inverse of what was last factored times y, in place. */
void blocks_solve(struct blocks *b, double *y);
/* T[e], entry e of the pattern: what harmonic K of dof j does to itself of dof i, as in (3) of
 * balance.c; of no border. */
void blocks_within(const struct blocks *b, int k, double complex *T);
/* y <- B x. */
void blocks_multiply(const struct blocks *b, const double *x, double *y);
/* Numbers in all. */
double blocks_entries(const struct blocks *b);
/* Floating-point operations of all factorizations so far. */
double blocks_work(const struct blocks *b);
#endif
