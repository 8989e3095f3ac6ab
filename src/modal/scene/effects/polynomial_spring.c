/* polynomial_spring.c - the sum of coefficients[i] d^(i+1); a polynomial of degree 1 is a linear
 * spring and becomes one
 *
 * The terms from the second on are the law's, the first alone goes into K; trailing zeros do not
 * count, so that the degree, and with it the number of samples, is that of the force.
 */
#include "modal/scene/effects/local_law.h"

static const struct scene_key keys[] = {
    { "coefficients", SCENE_NUMBERS, offsetof(struct local_polynomial, coefficients), "N/m^(i+1)",
      -HUGE_VAL, HUGE_VAL, .needed = true, .means = "c_i of f = sum c_i d^(i+1), i from 0",
      .example = "[1000, 0, 1e6]" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    return local_law_polynomial(l, e, PROGRAM_K, law_polynomial_spring, err);
}

const struct scene_effect_kind effect_polynomial_spring = {
    .name = "polynomial_spring", .keys = { lowering_ends_keys, keys },
    .size = sizeof(struct local_polynomial),
    .law = "minus the sum of coefficients[i] d^(i+1) on dof", .lower = lower,
};
