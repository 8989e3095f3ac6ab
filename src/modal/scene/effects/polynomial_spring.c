/* polynomial_spring.c - the sum of coefficients[i] d^(i+1); a polynomial of degree 1 is a linear spring and becomes one */
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    return local_law_polynomial(l, e, PROGRAM_K, law_polynomial_spring, err);
}

static const char *const keys[] = { "dof", "to", "coefficients", NULL };
const struct scene_effect_kind effect_polynomial_spring = { "polynomial_spring", keys, NULL, lower };
