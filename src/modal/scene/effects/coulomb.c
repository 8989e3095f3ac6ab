/* coulomb.c - rigid friction: limit [N] against the motion, at rest whatever holds, up to limit */
#include <math.h>
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    double limit = 0;
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "limit", 0, HUGE_VAL, &limit, err);
    if (rc != MODAL_OK || limit == 0)
        return rc;
    return local_law_add(l, e, law_coulomb(limit, &law, err), at, &law, err);
}

static const char *const keys[] = { "dof", "to", "limit", NULL };
const struct scene_effect_kind effect_coulomb = { "coulomb", keys, NULL, lower };
