/* reflect.h - Householder reflections of small matrices in the cache, where a call of LAPACK costs
 * more than its work
 *
 * Column k's reflection is I - tau_k v v^T.  Squares of the entries must neither overflow nor,
 * beside the largest of a column, matter where they underflow.
 */
#ifndef MODAL_REFLECT_H
#define MODAL_REFLECT_H

enum { REFLECT_SMALL = 24 };     /* columns up to which this is the faster way */

/* QR of A (m x n, m >= n) in place as LAPACK's dgeqrf leaves it: R on and above the diagonal, v
 * below it, 1 on it; tau: n numbers. */
void reflect_columns(int m, int n, double *A, int ld, double *tau);

/* T (n x n, upper triangular, leading dimension n) with H_1 .. H_n = I - V T V^T. */
void reflect_compact(int m, int n, const double *V, int ld, const double *tau, double *T);

/*
 * [R; B] = Q R': R n x n upper triangular, B m x n with its last `flat` rows upper trapezoidal, as
 * LAPACK's dtpqrt has it.  B becomes the lower parts of the v, whose upper ones are unit vectors;
 * what lies below the trapezoid is not read.
 */
void reflect_below(int m, int n, int flat, double *R, int ldr, double *B, int ldb, double *tau);

/* Q^T on COUNT columns of data, their upper n numbers at `top`, their lower m at `low`. */
void reflect_below_apply(int m, int n, int flat, const double *V, int ldv, const double *tau,
                         int count, double *top, int ldt, double *low, int ldl);
#endif
