/* lanczos.h - leading singular triplets of an operator, by Golub-Kahan bidiagonalisation with full
 * reorthogonalisation */
#ifndef MODAL_LANCZOS_H
#define MODAL_LANCZOS_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* A linear map from n to m numbers, known by its products only.  Both return a status: an operator
 * may read a file. */
struct linear_operator {
    int m, n;
    void *context;
    /* y = A x */
    enum modal_status (*apply)(void *context, const double *x, double *y, struct modal_error *err);
    /* x = A^T y */
    enum modal_status (*apply_transpose)(void *context, const double *y, double *x,
                                         struct modal_error *err);
};

struct lanczos_options {
    int wanted;         /* triplets; 1 .. min(m, n) */
    int steps;          /* most steps; 0: min(m, n) */
    int least;          /* steps before the first look, at least, as far as there are any */
    double tolerance;  /* a triplet has converged when its residual <= tolerance * s[0]; 0: 1e-14 */
    double *residuals;  /* out: |A^T u - s v| of each that is returned; NULL: not wanted */
};

struct lanczos_result {
    /* converged triplets, <= wanted; fewer where the operator's rank is less or steps ran out */
    int count;
    int steps;          /* taken: each is one product with A and one with A^T */
    double residual;    /* the largest |A^T u - s v| of those returned */
};

/*
 *   s    `wanted` values, descending
 *   U    m x wanted, VT wanted x n: the vectors; x NULL: not wanted, each on its own
 *
 * The start vector is fixed, so the answer is the same every time.  Every new vector is
 * orthogonalised against all before it: no ghosts, and the vectors are orthonormal to
 * rounding.  A breakdown (an invariant subspace) is continued with a fresh orthogonal vector; where
 * that one too is mapped to nothing above rounding, the rank is exhausted and the iteration ends.
 * Fails with what the operator fails with, MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE (the small SVD).
 */
enum modal_status lanczos_svd(const struct linear_operator *A, const struct lanczos_options *opt,
                              double *s, struct matrix *U, struct matrix *VT,
                              struct lanczos_result *out, struct modal_error *err);

/*
 * The same from where a call with the same A and fewer `wanted` ended, to the same answer as from
 * the start.  *run is NULL before the first call, which says the most `steps`; to lanczos_free,
 * whatever a call returned.
 */
struct lanczos;
enum modal_status lanczos_more(struct lanczos **run, const struct linear_operator *A,
                               const struct lanczos_options *opt, double *s, struct matrix *U,
                               struct matrix *VT, struct lanczos_result *out,
                               struct modal_error *err);
void lanczos_free(struct lanczos *run);

/* The operator of a dense matrix, borrowed: A->x[i + j*ld]. */
struct linear_operator dense_operator(const struct matrix *A);
#endif
