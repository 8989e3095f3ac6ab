/*
 * modal_damping.c - a damping ratio for each mode of the structure
 *
 * With K phi_i = w_i^2 M phi_i, Phi^T M Phi = I, the matrix C = sum_i 2 zeta_i w_i (M phi_i) (M phi_i)^T gives mode i of
 * the structure the ratio zeta_i and couples none.  `ratios` holds them in ascending frequency, modes past the list get
 * none; or `ratio`, one for all.  K must be symmetric with no negative w_i^2 where zeta_i is not 0.
 */
#include <lapacke.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "modal/scene/lowering.h"

enum { MODAL_DAMPING_DOFS_MOST = 1000 };

/* Columns of M Phi in M's place: K is overwritten by Phi, w2 by the squared frequencies. */
static enum modal_status modes(struct lowering *l, double **M, double **K, double *w2, struct modal_error *err)
{
    int n = l->p->n;
    double *factor;

    *M = lowering_structural_dense(l, PROGRAM_M);
    *K = lowering_structural_dense(l, PROGRAM_K);
    factor = lowering_structural_dense(l, PROGRAM_M);
    if (*M == NULL || *K == NULL || factor == NULL) {
        free(factor);
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    }
    int info = LAPACKE_dsygvd(LAPACK_COL_MAJOR, 1, 'V', 'U', n, *K, n, factor, n, w2);
    free(factor);
    return info == 0 ? MODAL_OK : modal_fail_field(err, MODAL_BAD_INPUT, "structure", "modal_damping: the structure has no modes (its mass "
                                                   "matrix is not positive definite)");
}

static void add_mode(struct lowering *l, const double *M, const double *phi, double factor, double *work)
{
    int n = l->p->n;

    for (int i = 0; i < n; i++) {
        work[i] = 0;
        for (int j = 0; j < n; j++)
            work[i] += M[i + (size_t)j * (size_t)n] * phi[j];
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            lowering_add(l, PROGRAM_C, i, j, factor * work[i] * work[j]);
}

static enum modal_status add_ratios(struct lowering *l, const struct scene_effect *e, const double *ratios, size_t count,
                                    struct modal_error *err)
{
    int n = l->p->n;
    double *M = NULL, *K = NULL, *w2 = malloc(2 * (size_t)n * sizeof *w2);
    enum modal_status rc = w2 != NULL ? modes(l, &M, &K, w2, err) : modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");

    for (int i = 0; rc == MODAL_OK && i < n && (size_t)i < count; i++) {
        if (ratios[i] == 0 || fabs(w2[i]) <= 1e-12 * fabs(w2[n - 1]))     /* a rigid motion has no ratio */
            continue;
        if (w2[i] < 0) {
            rc = modal_fail_field(err, MODAL_BAD_INPUT, e->path, "mode %d of the structure diverges (w^2 = %g): it has no damping ratio", i + 1, w2[i]);
            break;
        }
        add_mode(l, M, K + (size_t)i * (size_t)n, 2 * ratios[i] * sqrt(w2[i]), w2 + n);
    }
    free(M);
    free(K);
    free(w2);
    return rc;
}

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    double ratio = 0, *ratios = NULL;
    size_t count = 0;
    char where[128];
    enum modal_status rc = json_get_numbers(e->json, e->path, "ratios", -1e6, 1e6, &ratios, &count, err);

    if (rc == MODAL_OK && ratios == NULL)
        rc = json_need_number(e->json, e->path, "ratio", -1e6, 1e6, &ratio, err);
    json_path(where, e->path, "ratios");
    if (rc == MODAL_OK && count > (size_t)l->p->n)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s has %zu numbers; the structure has %d modes", where, count, l->p->n);
    if (rc == MODAL_OK && l->p->n > MODAL_DAMPING_DOFS_MOST)
        rc = modal_fail_field(err, MODAL_TOO_LARGE, e->path, "modal_damping fills a matrix: at most %d dofs, not %d", MODAL_DAMPING_DOFS_MOST, l->p->n);
    if (rc == MODAL_OK && ratios == NULL) {
        count = (size_t)l->p->n;
        if ((ratios = malloc(count * sizeof *ratios)) == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
        for (size_t i = 0; i < count; i++)
            ratios[i] = ratio;
    }
    if (rc == MODAL_OK)
        rc = add_ratios(l, e, ratios, count, err);
    free(ratios);
    return rc;
}

static const char *const keys[] = { "ratio", "ratios", NULL };
const struct scene_effect_kind effect_modal_damping = { "modal_damping", keys, NULL, lower };
