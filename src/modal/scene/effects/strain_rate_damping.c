/* strain_rate_damping.c - C = mu K of the elastic members, mu in s; a structure whose members turn says how itself */
#include <math.h>
#include "modal/scene/lowering.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    double mu = 0;
    enum modal_status rc = json_need_number(e->json, e->path, "mu", -HUGE_VAL, HUGE_VAL, &mu, err);

    if (rc != MODAL_OK || mu == 0)
        return rc;
    if (l->structure->strain_rate != NULL)
        return l->structure->strain_rate(l, mu, err);
    for (int i = 0; i < l->structural[PROGRAM_K]; i++) {
        struct triplet t = l->constant[PROGRAM_K].x[i];
        lowering_add(l, PROGRAM_C, t.i, t.j, mu * t.value);
    }
    return MODAL_OK;
}

static const char *const keys[] = { "mu", NULL };
const struct scene_effect_kind effect_strain_rate_damping = { "strain_rate_damping", keys, NULL, lower };
