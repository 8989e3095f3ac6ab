/*
 * modal_damping.c - a damping ratio for each mode of the structure
 *
 * With K phi_i = w_i^2 M phi_i, Phi^T M Phi = I, the matrix C = sum_i 2 zeta_i w_i (M phi_i) (M
 * phi_i)^T gives mode i of the structure the ratio zeta_i and couples none.  `ratios` holds them in
 * ascending frequency, modes past the list get none; or `ratio`, one for all.  K must be symmetric
 * with no negative w_i^2 where zeta_i is not 0.
 */
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include "modal/scene/lowering.h"

/* C is full: at 1000 dofs it has 1e6 entries, a twentieth of LOWERING_ENTRIES_MOST, and the modes
 * take some seconds. */
enum { MODAL_DAMPING_DOFS_MOST = 1000 };
/* far past any critical damping; 2 zeta w stays far from overflow */
#define RATIO_MOST 1e6
/* of the largest w^2: rounding of a zero one is some n DBL_EPSILON */
#define RIGID 1e-12

/* Columns of M Phi in M's place: K is overwritten by Phi, w2 by the squared frequencies. */
static enum modal_status modes(struct lowering *l, double **M, double **K, double *w2,
                               struct modal_error *err)
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
    /* Phi^T M Phi = 1 */
    int info = LAPACKE_dsygvd(LAPACK_COL_MAJOR, 1, 'V', 'U', n, *K, n, factor, n, w2);
    free(factor);
    return info == 0 ? MODAL_OK
                     : modal_fail_field(err, MODAL_BAD_INPUT, "structure",
                                        "modal_damping: the structure has no modes (its mass "
                                        "matrix is not positive definite)");
}

/* C += FACTOR (M phi)(M phi)^T; WORK holds M phi. */
static void add_mode(struct lowering *l, const double *M, const double *phi, double factor,
                     double *work)
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

/* The sum over modes; M and K hold M and Phi after `modes`. */
static enum modal_status add_ratios(struct lowering *l, const struct scene_effect *e,
                                    const double *ratios, size_t count, struct modal_error *err)
{
    int n = l->p->n;
    double *M = NULL, *K = NULL, *w2 = malloc(2 * (size_t)n * sizeof *w2);
    enum modal_status rc = w2 != NULL ? modes(l, &M, &K, w2, err)
                                      : modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");

    for (int i = 0; rc == MODAL_OK && i < n && (size_t)i < count; i++) {
        /* a rigid motion has no ratio */
        if (ratios[i] == 0 || fabs(w2[i]) <= RIGID * fabs(w2[n - 1]))
            continue;
        if (w2[i] < 0) {  /* a ratio of an imaginary frequency */
            rc = modal_fail_field(
                err, MODAL_BAD_INPUT, e->path,
                "mode %d of the structure diverges (w^2 = %g): it has no damping ratio", i + 1,
                w2[i]);
            break;
        }
        add_mode(l, M, K + (size_t)i * (size_t)n, 2 * ratios[i] * sqrt(w2[i]), w2 + n);
    }
    free(M);
    free(K);
    free(w2);
    return rc;
}

struct modal_damping { double ratio; struct scene_numbers ratios; };

static const struct scene_key keys[] = {
    { "ratio", SCENE_NUMBER, offsetof(struct modal_damping, ratio), "", -RATIO_MOST, RATIO_MOST,
      .needed = true, .unless = "ratios", .means = "zeta of every mode", .example = "0.02" },
    { "ratios", SCENE_NUMBERS, offsetof(struct modal_damping, ratios), "", -RATIO_MOST, RATIO_MOST,
      .otherwise = "ratio for every mode",
      .means = "zeta of each mode in ascending frequency; modes past the list get none",
      .example = "[0.02]" },
    { 0 },
};

/* The ratios, or as many of the one. */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    struct modal_damping *s = e->values;
    size_t modes = (size_t)l->p->n;
    char where[128];

    json_path(where, e->path, "ratios");
    if (s->ratios.count > modes)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s has %zu numbers; the structure has "
                                "%zu modes",
                                where, s->ratios.count, modes);
    if (l->p->n > MODAL_DAMPING_DOFS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, e->path,
                                "modal_damping fills a matrix: at most "
                                "%d dofs, not %d",
                                MODAL_DAMPING_DOFS_MOST, l->p->n);
    if (s->ratios.x == NULL) {
        if ((s->ratios.x = malloc(modes * sizeof *s->ratios.x)) == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
        while (s->ratios.count < modes)
            s->ratios.x[s->ratios.count++] = s->ratio;
    }
    return add_ratios(l, e, s->ratios.x, s->ratios.count, err);
}

const struct scene_effect_kind effect_modal_damping = {
    .name = "modal_damping",
    .keys = { scene_type_keys, keys },
    .size = sizeof(struct modal_damping),
    .law = "C gains sum_i 2 zeta_i w_i (M phi_i)(M phi_i)^T over the structure's modes",
    .lower = lower,
};
