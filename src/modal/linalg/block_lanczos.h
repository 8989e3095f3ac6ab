/* block_lanczos.h - a symmetric matrix, given by its products, brought to block tridiagonal form
 * from several vectors at once
 *
 * From Q_1 R_1, the vectors to begin with,
 *
 *     N Q_j = Q_j-1 B_j^T + Q_j A_j + Q_j+1 B_j+1,                                              (1)
 *
 * the columns of each Q_j orthonormal: T_j, block tridiagonal of the A and B, is N as seen from
 * them.  Three blocks are held, and no basis. */
#ifndef MODAL_BLOCK_LANCZOS_H
#define MODAL_BLOCK_LANCZOS_H
#include <stdbool.h>
#include "modal/linalg/workspace.h"

/* Blocks of vectors are rows of `ld` numbers, one row of each of n: those of a step's `wide`
 * columns, then what is of no meaning; ld is a multiple of LANES (lanes.h). */

/* Q_j has WIDE columns; A_j; B_j+1, `next` x wide, in columns of `wide`, next <= wide. */
struct block_step { int wide, next; double *A, *B; };

struct block_lanczos {
    int n, sides, ld;               /* sides: vectors to begin with */
    double *Q[4];                   /* of the last step, of this, of the next; scratch */
    double *R;                      /* R_1, step[0].wide x sides, in columns of `sides` */
    struct block_step *step;
    int steps, places;              /* steps that are made; step[steps] has its width alone */
    double scale;                   /* of N: the largest entry of an A_j */
    bool ended;                     /* no more steps */
    double *small;                  /* 2 sides x sides */
    struct workspace space, blocks; /* of the arrays; of A and B */
};

/* Y <- N X of the first COLUMNS, a multiple of LANES, of rows of LD; X is lost; false: no
 * memory. */
typedef bool block_product(void *context, int columns, int ld, double *X, double *Y);

/* Room for SIDES vectors of N numbers in Q[1], which are 0; false: no memory.  To done in any
 * case. */
bool block_lanczos_init(struct block_lanczos *l, int n, int sides);
void block_lanczos_done(struct block_lanczos *l);
/* The vectors are in Q[1]: Q_1 R_1 of them; false: they are all 0, or no memory. */
bool block_lanczos_begin(struct block_lanczos *l);
/* One step of (1); false: there is none, or no memory. */
bool block_lanczos_step(struct block_lanczos *l, block_product *product, void *context);
/* Operations of a step beside the product. */
double block_lanczos_work(const struct block_lanczos *l);
#endif
