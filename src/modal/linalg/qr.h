/* qr.h - Householder QR of a tall matrix */
#ifndef MODAL_QR_H
#define MODAL_QR_H
#include "modal/error.h"
#include "modal/linalg/matrix.h"

/*
 * A = Q R, m >= n.  A (m x n) becomes Q with orthonormal columns; R (n x n, or x NULL: not wanted) the upper triangle, zeros
 * below.  Fails with MODAL_BAD_INPUT (m < n), MODAL_NO_MEMORY.
 */
enum modal_status qr_orthonormal(struct matrix *A, struct matrix *R, struct modal_error *err);

/*
 * The factor R alone (n x n, zeros below), A destroyed.  A tall A is read once, by panels of rows that stay in the cache, each joined to
 * the triangle of those before: as stable as one QR, and not bound by memory.
 */
enum modal_status qr_triangle(struct matrix *A, struct matrix *R, struct modal_error *err);
#endif
