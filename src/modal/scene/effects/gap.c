/* gap.c - unilateral contact: stiffness (d - clearance) where d > clearance, times (1 + dissipation d') and never pulling;
 * a negative clearance [m] is a preload; both_sides adds the mirror image (clearance then >= 0) */
#include <math.h>
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    double stiffness = 0, clearance = 0, dissipation = 0;
    bool both_sides = false;
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "stiffness", 0, HUGE_VAL, &stiffness, err);
    if (rc == MODAL_OK)
        rc = json_get_bool(e->json, e->path, "both_sides", &both_sides, err);
    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "clearance", both_sides ? 0 : -HUGE_VAL, HUGE_VAL, &clearance, err);
    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "dissipation", 0, HUGE_VAL, &dissipation, err);
    if (rc != MODAL_OK || stiffness == 0)
        return rc;
    return local_law_add(l, e, law_gap(stiffness, clearance, dissipation, both_sides, &law, err), at, &law, err);
}

static const char *const keys[] = { "dof", "to", "stiffness", "clearance", "dissipation", "both_sides", NULL };
const struct scene_effect_kind effect_gap = { "gap", keys, NULL, lower };
