/* envelope.h - a symmetric matrix of blocks, each row of them from its first that is not zero */
#ifndef MODAL_ENVELOPE_H
#define MODAL_ENVELOPE_H
#include <stdbool.h>
#include "modal/linalg/workspace.h"

/* A row of blocks: rows x (the columns of block FIRST to its own last), by columns; START: its own
 * first column in the matrix. */
struct envelope_block { int first, rows, start; size_t size; double *entries, *factor; };

struct envelope {
    struct envelope_block *block;     /* COUNT of them, the caller's; first and rows are set */
    int count;
    double work;                      /* entries times columns of all factors so far */
};

/* Starts and sizes of the blocks, and room for them in MEMORY, which may fail. */
void envelope_room(struct envelope *e, struct workspace *memory);

/* All entries zero. */
void envelope_clear(struct envelope *e);

/* Entry (ROW of BLOCK, COLUMN of OTHER, none after it, nor before its first). */
double *envelope_entry(const struct envelope *e, int block, int row, int other, int column);

/* The factor F of D E D + damping, D the diagonal SCALE that makes E's ones, or zeros of its zeros,
 * which are taken as ones; false where it is not positive. */
bool envelope_factor(struct envelope *e, const double *scale, double damping);

/* F^-1 x in place of x, which is zero before block FROM; F^-T x. */
void envelope_forward(const struct envelope *e, int from, double *x);
void envelope_back(const struct envelope *e, double *x);
#endif
