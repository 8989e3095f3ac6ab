/* polynomial_damper.c - the sum of coefficients[i] d^i d'; a constant one is a linear damper and
 * becomes one
 *
 * Negative damping at small d and positive at large, [-mu, 0, mu], is van der Pol's: self-excited,
 * and its limit cycle has amplitude 2 for small mu.
 */
#include "modal/scene/effects/local_law.h"

static const struct scene_key keys[] = {
    { "coefficients", SCENE_NUMBERS, offsetof(struct local_polynomial, coefficients), "N s/m^(i+1)",
      -HUGE_VAL, HUGE_VAL, .needed = true,
      .means = "c_i of f = sum c_i d^i d', i from 0; van der Pol: [-mu, 0, mu]",
      .example = "[-0.1, 0, 0.1]" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    return local_law_polynomial(l, e, PROGRAM_C, law_polynomial_damper, err);
}

const struct scene_effect_kind effect_polynomial_damper = {
    .name = "polynomial_damper", .keys = { lowering_ends_keys, keys },
    .size = sizeof(struct local_polynomial),
    .law = "minus the sum of coefficients[i] d^i d' on dof", .lower = lower,
};
