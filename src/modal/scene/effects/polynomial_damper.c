/* polynomial_damper.c - the sum of coefficients[i] d^i d'; a constant one is a linear damper and becomes one */
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    return local_law_polynomial(l, e, PROGRAM_C, law_polynomial_damper, err);
}

static const char *const keys[] = { "dof", "to", "coefficients", NULL };
const struct scene_effect_kind effect_polynomial_damper = { "polynomial_damper", keys, NULL, lower };
