/* rayleigh_damping.c - C = alpha M + beta K of the structure (alpha in 1/s, beta in s)
 *
 * Where members turn, beta damps their strain on their own axes and alpha acts against still air.
 */
#include <math.h>
#include "modal/scene/lowering.h"

static void add_alpha(struct lowering *l, double alpha)
{
    for (int i = 0; alpha != 0 && i < l->structural[PROGRAM_M]; i++) {
        struct triplet t = l->constant[PROGRAM_M].x[i];
        lowering_add_still_damping(l, t.i, t.j, alpha * t.value);
    }
}

static enum modal_status add_beta(struct lowering *l, double beta, struct modal_error *err)
{
    if (beta != 0 && l->structure->strain_rate != NULL)
        return l->structure->strain_rate(l, beta, err);
    for (int i = 0; beta != 0 && i < l->structural[PROGRAM_K]; i++) {
        struct triplet t = l->constant[PROGRAM_K].x[i];
        lowering_add(l, PROGRAM_C, t.i, t.j, beta * t.value);
    }
    return MODAL_OK;
}

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    double alpha = 0, beta = 0;
    enum modal_status rc = json_get_number(e->json, e->path, "alpha", -HUGE_VAL, HUGE_VAL, &alpha, err);

    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "beta", -HUGE_VAL, HUGE_VAL, &beta, err);
    if (rc != MODAL_OK)
        return rc;
    add_alpha(l, alpha);
    return add_beta(l, beta, err);
}

static const char *const keys[] = { "alpha", "beta", NULL };
const struct scene_effect_kind effect_rayleigh_damping = { "rayleigh_damping", keys, NULL, lower };
