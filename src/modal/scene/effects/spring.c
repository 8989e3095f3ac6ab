/* spring.c - a linear spring: stiffness [N/m] between `dof` and `to`, of any sign
 *
 * With d = x_dof - x_to the force is -k d on `dof` and +k d on `to`, so K gains k [1 -1; -1 1]: no
 * law, and the scene stays linear. A negative k is a load that follows, and may make it unstable.
 */
#include "modal/scene/lowering.h"

struct spring { struct local_ends at; double stiffness; };

static const struct scene_key keys[] = {
    { "stiffness", SCENE_NUMBER, offsetof(struct spring, stiffness), "N/m", -HUGE_VAL, HUGE_VAL,
      .needed = true, .means = "k in f = k d, of any sign", .example = "1000" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct spring *s = e->values;

    (void)err;
    lowering_along(l, PROGRAM_K, s->at.along, s->stiffness);
    return MODAL_OK;
}

const struct scene_effect_kind effect_spring = {
    .name = "spring", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct spring),
    .law = "minus stiffness d on dof, d = x_dof - x_to", .lower = lower,
};
