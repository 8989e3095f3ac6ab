/* rotary_inertia.c - the inertia of a shaft's cross-sections against tilting
 *
 * `I_rho` in kg m is the polar mass moment of inertia per length; half of it acts in each plane,
 * and with `gyroscopic` all of it on the turning sections.  A massless shaft has none.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/structures/shaft.h"

struct rotary { double I_rho; };

static const struct scene_key keys[] = {
    { "I_rho", SCENE_NUMBER, offsetof(struct rotary, I_rho), "kg m", 0, SCENE_LARGE,
      .needed = true, .means = "polar mass moment of inertia of the sections per length",
      .example = "1e-4" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct rotary *r = e->values;
    struct shaft *shaft = l->mesh;

    if (shaft->massless)
        return modal_fail_field(err, MODAL_BAD_INPUT, e->path,
                                "%s: a massless shaft has no rotary inertia; "
                                "use structure.model \"finite_elements\"",
                                e->path);
    shaft->I_rho += r->I_rho;
    shaft->rotary_effect = e->index;
    return MODAL_OK;
}

static const char *const structures[] = { "shaft", NULL };
const struct scene_effect_kind effect_rotary_inertia = {
    .name = "rotary_inertia",
    .keys = { scene_type_keys, keys },
    .size = sizeof(struct rotary),
    .structures = structures,
    .law = "M gains I_rho / 2 of the slopes in each plane, along the length",
    .lower = lower,
};
