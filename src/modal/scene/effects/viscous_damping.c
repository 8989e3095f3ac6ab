/* viscous_damping.c - damping spread like the mass: C = per_length / mass_per_length M of the
 * structure, by air that does not turn
 *
 * The air stands still, so on turning axes its force on a point is that of the point's speed in
 * space: C and, in K, W C J (shaft.c, (1)), which stabilises where strain-rate damping does not.
 */
#include "modal/scene/lowering.h"

struct viscous { double per_length; };

static const struct scene_key keys[] = {
    { "per_length", SCENE_NUMBER, offsetof(struct viscous, per_length), "N s/m^2", -HUGE_VAL,
      HUGE_VAL, .needed = true, .means = "force per length over velocity, against the motion",
      .example = "0.2" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct viscous *s = e->values;

    if (!(l->mass_per_length > 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, e->path,
                                "%s: viscous_damping needs a structure "
                                "with mass along its length",
                                e->path);
    for (int i = 0; s->per_length != 0 && i < l->structural[PROGRAM_M]; i++) {
        struct triplet t = l->constant[PROGRAM_M].x[i];
        lowering_add_still_damping(l, t.i, t.j, s->per_length / l->mass_per_length * t.value);
    }
    return MODAL_OK;
}

static const char *const structures[] = { "beam", "shaft", "wing", NULL };
const struct scene_effect_kind effect_viscous_damping = {
    .name = "viscous_damping", .keys = { scene_type_keys, keys }, .size = sizeof(struct viscous),
    .structures = structures, .law = "C gains per_length / mass_per_length M of the structure",
    .lower = lower,
};
