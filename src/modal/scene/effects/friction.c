/* friction.c - an elastic, perfectly plastic (Jenkins) element: stiffness [N/m] in series with a
 * slider of strength limit [N]; of either 0, it holds nothing and leaves nothing
 *
 * The slider starts at 0, and its place is the law's memory. What it dissipates in a cycle of
 * amplitude a > limit/stiffness is 4 limit (a - limit/stiffness).
 */
#include "modal/scene/effects/local_law.h"

struct friction { struct local_ends at; double stiffness, limit; };

static const struct scene_key keys[] = {
    { "stiffness", SCENE_NUMBER, offsetof(struct friction, stiffness), "N/m", 0, HUGE_VAL,
      .needed = true, .means = "of the spring, while the slider holds", .example = "2000" },
    { "limit", SCENE_NUMBER, offsetof(struct friction, limit), "N", 0, HUGE_VAL,
      .needed = true, .means = "strength of the slider, which the force never exceeds",
      .example = "0.8" },
    { 0 },
};

/* Of stiffness or limit 0 it never pushes: no law, and the scene stays linear. */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct friction *s = e->values;
    struct law law;

    if (s->stiffness == 0 || s->limit == 0)
        return MODAL_OK;
    return local_law_add(l, e, law_jenkins(s->stiffness, s->limit, &law, err), s->at.along,
                         &law, err);
}

const struct scene_effect_kind effect_friction = {
    .name = "friction", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct friction),
    .law = "minus stiffness (d - z) on dof, z the slider's place, moved so that |force| <= limit",
    .lower = lower,
};
