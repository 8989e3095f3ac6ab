/* window_qr.h - the triangle of the rows in a moving window: rows come in blocks, the oldest block
 * leaves */
#ifndef MODAL_WINDOW_QR_H
#define MODAL_WINDOW_QR_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * A queue of blocks of rows of n columns.  R^T R is the Gram matrix of all rows in the queue: the
 * singular values and right vectors of R are those of the rows, which are the proper orthogonal
 * modes where columns are channels.
 */
struct window_qr;

/* The caller frees *out with window_qr_free.  Fails with MODAL_BAD_INPUT (n < 1), MODAL_NO_MEMORY.
 */
enum modal_status window_qr_new(int n, struct window_qr **out, struct modal_error *err);
void window_qr_free(struct window_qr *q);      /* NULL too */
void window_qr_clear(struct window_qr *q);     /* as it was when new */

/* Rows (m x n, m >= 1, destroyed) join as the newest block.  Fails with MODAL_NO_MEMORY. */
enum modal_status window_qr_push(struct window_qr *q, struct matrix *rows, struct modal_error *err);

/* The oldest block leaves; nothing happens where there is none.  Fails with MODAL_NO_MEMORY. */
enum modal_status window_qr_pop(struct window_qr *q, struct modal_error *err);

/* R: n x n, zeros below the diagonal; all zero where the queue is empty.  MORE (m x n, kept; may be
 * NULL): rows that count beside the queue's. */
enum modal_status window_qr_factor(const struct window_qr *q, const struct matrix *more, double *R,
                                   struct modal_error *err);
#endif
