/* qr.h - Householder QR of a tall matrix */
#ifndef MODAL_QR_H
#define MODAL_QR_H
#include <stdbool.h>
#include <stddef.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * A = Q R, m >= n.  A (m x n) becomes Q with orthonormal columns; R (n x n, or x NULL: not wanted)
 * the upper triangle, zeros below.  Fails with MODAL_BAD_INPUT (m < n), MODAL_NO_MEMORY.
 */
enum modal_status qr_orthonormal(struct matrix *A, struct matrix *R, struct modal_error *err);

/*
 * The factor R alone (n x n, zeros below), A destroyed, but kept where m > QR_KEPT(n): so tall it
 * is read once, by panels of rows
 * that stay in the cache, each joined to the triangle of those before: as stable as one QR, and not
 * bound by memory.
 */
#define QR_KEPT(n) (8 * (n) + 512)
enum modal_status qr_triangle(struct matrix *A, struct matrix *R, struct modal_error *err);

/* Columns at a time; numbers that a QR of n columns works in. */
enum { QR_BLOCK = 32 };
#define QR_ROOM(n) (2 * QR_BLOCK * (size_t)(n))

/*
 * The triangle of X (m x n, leading dimension LD) in its place, over what LAPACK keeps below it;
 * WORK has room for QR_ROOM(n) numbers. False: LAPACK refused. Up to 128 columns dgeqrf takes one
 * by one; this takes them by blocks.
 */
bool qr_in_place(int m, int n, double *x, int ld, double *work);

/*
 * The first K columns of A (m x n, k <= m, k <= n) become a triangle, zeros below, by K reflections
 * that act on all n columns, in place: rows 0 .. k-1 of the others are their part in the span of
 * the first K, the rows below what is left of them.  For small A, where dgeqrf spends its time on
 * preparations.  WORK has room for n numbers.
 */
void qr_reflect(struct matrix *A, int k, double *work);

/* Does column J of a triangle, its j + 1 entries COLUMN, lie in the span of those before it, to the
 * rounding of its own length? */
bool qr_dependent(const double *column, int j);
#endif
