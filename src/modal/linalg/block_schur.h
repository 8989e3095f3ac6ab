/* block_schur.h - F^T (a + c T)^-1 F of a block tridiagonal T, block after block
 *
 * T of the blocks A_j and B_j+1 of block_lanczos.h, F zero but for P_1 in its first block:
 *
 *     D_1 = a + c A_1,    D_j+1 = a + c A_j+1 - c^2 B_j+1 D_j^-1 B_j+1^T,
 *     P_j+1 = -c B_j+1 D_j^-1 P_j,    F^T (a + c T_j)^-1 F = sum_i P_i^T D_i^-1 P_i.            (1)
 */
#ifndef MODAL_BLOCK_SCHUR_H
#define MODAL_BLOCK_SCHUR_H
#include <complex.h>
#include "modal/linalg/block_lanczos.h"

struct block_schur {
    int columns, widest, wide;      /* of F; of any block; of the block at hand */
    /* rows of `stride` real parts and as many imaginary ones: of [P_j D_j c B_j+1^T], the next ones
     * of P and D, and of the sum */
    double *row, *next, *sum;
    size_t stride, of_D;            /* of_D: where D begins in a row */
    int *done;                      /* of the rows: eliminated */
    struct workspace space;
};

/* Room for COLUMNS of F and blocks of at most WIDEST; false: no memory.  To done in any case. */
bool block_schur_init(struct block_schur *f, int columns, int widest);
void block_schur_done(struct block_schur *f);
/* Begins anew, with P_1 = 0. */
void block_schur_begin(struct block_schur *f);
/* P_1(i, j). */
void block_schur_set(struct block_schur *f, size_t i, size_t j, double complex value);
/* One block of (1), S; the largest |z_i^2 / d| that a pivot d brought to one of the first WATCHED
 * of the sum's diagonal, whose rounding is that of the sum, or -1 where D is singular. */
double block_schur_step(struct block_schur *f, const struct block_step *s, double complex a,
                        double complex c, int watched);
/* The sum so far, at (i, j). */
double complex block_schur_sum(const struct block_schur *f, size_t i, size_t j);
/* |P_j+1 e_J|, of the block that is next. */
double block_schur_left(const struct block_schur *f, size_t j);
#endif
