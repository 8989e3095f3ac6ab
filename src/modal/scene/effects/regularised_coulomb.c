/* regularised_coulomb.c - limit tanh(d' / velocity), limit in N, velocity > 0 in m/s */
#include <math.h>
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    double limit = 0, velocity = 0;
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "limit", 0, HUGE_VAL, &limit, err);
    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "velocity", 1e-300, HUGE_VAL, &velocity, err);
    if (rc != MODAL_OK || limit == 0)
        return rc;
    return local_law_add(l, e, law_regularised_coulomb(limit, velocity, &law, err), at, &law, err);
}

static const char *const keys[] = { "dof", "to", "limit", "velocity", NULL };
const struct scene_effect_kind effect_regularised_coulomb = { "regularised_coulomb", keys, NULL, lower };
