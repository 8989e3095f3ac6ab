/* gap.c - unilateral contact: stiffness (d - clearance) where d > clearance, times (1 + dissipation
 * d') and never pulling; a negative clearance [m] is a preload; both_sides adds the mirror image
 * (clearance then >= 0)
 *
 * Contact begins with force 0 whatever the speed, since the factor multiplies stiffness and depth:
 * the force is continuous with a kink, its harmonics fall as k^-2 and the motion's as k^-4.
 */
#include "modal/scene/effects/local_law.h"

struct gap { struct local_ends at; double stiffness, clearance, dissipation; bool both_sides; };

static const struct scene_key keys[] = {
    { "stiffness", SCENE_NUMBER, offsetof(struct gap, stiffness), "N/m", 0, HUGE_VAL,
      .needed = true, .means = "of the stop, where d > clearance", .example = "1e5" },
    { "clearance", SCENE_NUMBER, offsetof(struct gap, clearance), "m", -HUGE_VAL, HUGE_VAL,
      .needed = true,
      .means = "the d at which contact begins; < 0 is a preload, not with both_sides",
      .example = "1e-3" },
    { "dissipation", SCENE_NUMBER, offsetof(struct gap, dissipation), "s/m", 0, HUGE_VAL,
      .means = "mu of the factor 1 + mu d', which never makes it pull", .example = "0.1" },
    { "both_sides", SCENE_TRUTH, offsetof(struct gap, both_sides),
      .means = "contact also where d < -clearance", .example = "true" },
    { 0 },
};

/* The range of `clearance` depends on `both_sides`, which its row cannot say. */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct gap *s = e->values;
    char where[128];
    struct law law;

    json_path(where, e->path, "clearance");
    if (s->both_sides && s->clearance < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s is %g; accepted with both_sides: "
                                "a number of at least 0", where, s->clearance);
    if (s->stiffness == 0)
        return MODAL_OK;
    return local_law_add(l, e, law_gap(s->stiffness, s->clearance, s->dissipation, s->both_sides,
                                       &law, err), s->at.along, &law, err);
}

const struct scene_effect_kind effect_gap = {
    .name = "gap", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct gap),
    .law = "minus stiffness (d - clearance)(1 + dissipation d') on dof where d > clearance, else 0",
    .lower = lower,
};
