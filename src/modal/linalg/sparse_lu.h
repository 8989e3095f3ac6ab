/* sparse_lu.h - LU factors of square sparse matrices of one structure, real or complex */
#ifndef MODAL_SPARSE_LU_H
#define MODAL_SPARSE_LU_H
#include <stdbool.h>
#include "base/error.h"

struct sparse_lu;

/*
 * For matrices of order N whose column j has its rows at index[start[j]] .. index[start[j+1] - 1],
 * ascending: the structure is copied, and analysed at the first factorization.  OF_COMPLEX:
 * values are double complex.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status sparse_lu_new(int n, const int *start, const int *index, bool of_complex,
                                struct sparse_lu **out, struct modal_error *err);
void sparse_lu_free(struct sparse_lu *f);       /* NULL too */

/*
 * Factor VALUE, in the order of the structure, borrowed until the next factorization
 * (sparse_lu_solve reads it).  False where it is singular to rounding, not finite, or memory ran
 * out; then nothing is factored.
 */
bool sparse_lu_factor(struct sparse_lu *f, const void *value);
/* What a pivot lacks: its row, -1 where none does; its value. */
struct sparse_lu_pivot { int row; double value; };
/*
 * Factors as above a real symmetric matrix along its diagonal; the first pivot that is not above
 * LEAST of its diagonal entry into *OUT: where there is none the matrix is positive.  False also
 * where the diagonal does not serve.
 */
bool sparse_lu_diagonal(struct sparse_lu *f, const double *value, double least,
                        struct sparse_lu_pivot *out);
/* x of A x = b, n entries each, not overlapping. */
void sparse_lu_solve(struct sparse_lu *f, const void *b, void *x);
/* The same of A^H x = b. */
void sparse_lu_solve_adjoint(struct sparse_lu *f, const void *b, void *x);
/* Sign of the real determinant: -1 or 1. */
int sparse_lu_sign(struct sparse_lu *f);
/* Of the last factorization: the least pivot over the largest, in size. */
double sparse_lu_rcond(const struct sparse_lu *f);
/* What finding and moving an entry of the matrix or of its factors costs, in operations: of blocks
 * as small as those of a chain that is nearly all (25 ns at 4 operations a ns, orders 500 to 7500).
 */
enum { SPARSE_LU_ENTRY = 100 };
/* Floating-point operations of the last factorization, SPARSE_LU_ENTRY for each entry included, */
double sparse_lu_work(const struct sparse_lu *f);
/* and without; */
double sparse_lu_flops(const struct sparse_lu *f);
/* entries of its factors. */
double sparse_lu_fill(const struct sparse_lu *f);
#endif
