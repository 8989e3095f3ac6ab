/* cubic_spring.c - coefficient d^3, coefficient in N/m^3 of any sign; a coefficient of 0 leaves
 * nothing
 *
 * It is the polynomial spring of coefficients (0, 0, c), and shares its law, so that samples are
 * counted alike: degree 3 asks for N > 4 H of them.
 */
#include "modal/scene/effects/local_law.h"

struct cubic { struct local_ends at; double coefficient; };

static const struct scene_key keys[] = {
    { "coefficient", SCENE_NUMBER, offsetof(struct cubic, coefficient), "N/m^3", -HUGE_VAL,
      HUGE_VAL, .needed = true, .means = "c in f = c d^3, of any sign", .example = "1e6" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct cubic *s = e->values;
    double c[3] = { 0, 0, s->coefficient };        /* c_0 d + c_1 d^2 + c_2 d^3 */
    struct law law;

    if (s->coefficient == 0)
        return MODAL_OK;
    return local_law_add(l, e, law_polynomial_spring(c, 3, &law, err), s->at.along, &law, err);
}

const struct scene_effect_kind effect_cubic_spring = {
    .name = "cubic_spring", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct cubic),
    .law = "minus coefficient d^3 on dof", .lower = lower,
};
