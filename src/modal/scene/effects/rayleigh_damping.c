/* rayleigh_damping.c - C = alpha M + beta K of the structure (alpha in 1/s, beta in s) */
#include <math.h>
#include "modal/scene/lowering.h"

static void add_share(struct lowering *l, int matrix, double factor)
{
    for (int i = 0; factor != 0 && i < l->structural[matrix]; i++) {
        struct triplet t = l->constant[matrix].x[i];
        lowering_add(l, PROGRAM_C, t.i, t.j, factor * t.value);
    }
}

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    double alpha = 0, beta = 0;
    enum modal_status rc = json_get_number(e->json, e->path, "alpha", -HUGE_VAL, HUGE_VAL, &alpha, err);

    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "beta", -HUGE_VAL, HUGE_VAL, &beta, err);
    if (rc != MODAL_OK)
        return rc;
    add_share(l, PROGRAM_M, alpha);
    add_share(l, PROGRAM_K, beta);
    return MODAL_OK;
}

static const char *const keys[] = { "alpha", "beta", NULL };
const struct scene_effect_kind effect_rayleigh_damping = { "rayleigh_damping", keys, NULL, lower };
