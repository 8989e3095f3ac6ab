/* cubic_spring.c - coefficient d^3, coefficient in N/m^3 of any sign; a coefficient of 0 leaves nothing */
#include <math.h>
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    double c[3] = { 0 };
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "coefficient", -HUGE_VAL, HUGE_VAL, &c[2], err);
    if (rc != MODAL_OK || c[2] == 0)
        return rc;
    return local_law_add(l, e, law_polynomial_spring(c, 3, &law, err), at, &law, err);
}

static const char *const keys[] = { "dof", "to", "coefficient", NULL };
const struct scene_effect_kind effect_cubic_spring = { "cubic_spring", keys, NULL, lower };
