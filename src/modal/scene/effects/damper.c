/* damper.c - a linear damper: coefficient [N s/m] between `dof` and `to`, of any sign */
#include <math.h>
#include "modal/scene/lowering.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    double coefficient = 0;
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "coefficient", -HUGE_VAL, HUGE_VAL, &coefficient, err);
    if (rc == MODAL_OK)
        lowering_between(l, PROGRAM_C, at, coefficient);
    return rc;
}

static const char *const keys[] = { "dof", "to", "coefficient", NULL };
const struct scene_effect_kind effect_damper = { "damper", keys, NULL, lower };
