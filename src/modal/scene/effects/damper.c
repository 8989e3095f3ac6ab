/* damper.c - a linear damper: coefficient [N s/m] between `dof` and `to`, of any sign
 *
 * C gains c [1 -1; -1 1] between the ends. On turning axes it is a damper that turns with them: a
 * bearing's or the air's, which stand still, come by lowering_add_still_damping.
 */
#include "modal/scene/lowering.h"

struct damper { struct local_ends at; double coefficient; };

static const struct scene_key keys[] = {
    { "coefficient", SCENE_NUMBER, offsetof(struct damper, coefficient), "N s/m", -HUGE_VAL,
      HUGE_VAL, .needed = true, .means = "c in f = c d', of any sign", .example = "2.5" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct damper *s = e->values;

    (void)err;
    lowering_along(l, PROGRAM_C, s->at.along, s->coefficient);
    return MODAL_OK;
}

const struct scene_effect_kind effect_damper = {
    .name = "damper", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct damper),
    .law = "minus coefficient d' on dof, d = x_dof - x_to", .lower = lower,
};
