/* friction.c - an elastic, perfectly plastic (Jenkins) element: stiffness [N/m] in series with a slider of strength limit [N];
 * of either 0, it holds nothing and leaves nothing */
#include <math.h>
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    double stiffness = 0, limit = 0;
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "stiffness", 0, HUGE_VAL, &stiffness, err);
    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "limit", 0, HUGE_VAL, &limit, err);
    if (rc != MODAL_OK || stiffness == 0 || limit == 0)
        return rc;
    return local_law_add(l, e, law_jenkins(stiffness, limit, &law, err), at, &law, err);
}

static const char *const keys[] = { "dof", "to", "stiffness", "limit", NULL };
const struct scene_effect_kind effect_friction = { "friction", keys, NULL, lower };
