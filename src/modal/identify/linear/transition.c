/*
 * transition.c - multipliers of the partial Floquet and the autoregressive method
 *
 * With H0 = U S V^T cut at rank r and G = U_r^T H1 V_r the paper's four matrices are
 *
 *    Q = H1 V_r S_r^{-1} U_r^T  (16),  Qhat = U_r^T Q U_r = G S_r^{-1}  (17, V_r^T printed for V_r)
 *     B = V_r S_r^{-1} U_r^T H1  (20),    Bhat = S_r^{-1} G                                    (21)
 *
 * Since the non-zero eigenvalues of XY and YX agree, and Qhat = S_r Bhat S_r^{-1}, all four have
 * one non-zero spectrum; the remaining ones of Q and B are exactly 0.  So r x r is all that is ever
 * decomposed.  LAPACK balances first, which undoes the grading of S.
 */
#include "modal/identify/linear/transition.h"
#include <stdlib.h>
#include "modal/linalg/eigen.h"

static bool by_columns(enum identify_method method)
{
    return method != IDENTIFY_AUTOREGRESSIVE && method != IDENTIFY_AUTOREGRESSIVE_FULL;
}

enum modal_status transition_multipliers(const struct transition *t, enum identify_method method,
                                         int r, double complex *rho, struct modal_error *err)
{
    struct matrix A = { r, r, r, NULL };
    enum modal_status rc;

    if (r < 1 || r > t->count || !(t->s[r - 1] > 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed",
                                "rank %d where the Hankel matrix has %d non-zero singular values",
                                r, t->count);
    A.x = malloc(sizeof *A.x * r * r);
    if (A.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "transition: no memory for rank %d", r);
    for (int j = 0; j < r; j++)
        for (int i = 0; i < r; i++)
            A.x[i + (size_t)j * r] =
                /* (17) or (21): one spectrum, other rounding */
                t->G[i + (size_t)j * t->count] / t->s[by_columns(method) ? j : i];
    rc = eigen_general(&A, rho, NULL, NULL, err);
    free(A.x);
    return rc;
}
