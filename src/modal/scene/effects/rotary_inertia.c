/* rotary_inertia.c - the inertia of a shaft's cross-sections against tilting
 *
 * `I_rho` in kg m is the polar mass moment of inertia per length; half of it acts in each plane, and with `gyroscopic` all of it on
 * the turning sections.  A massless shaft has none.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/structures/shaft.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct shaft *shaft = l->mesh;
    double I_rho = 0;
    enum modal_status rc = json_need_number(e->json, e->path, "I_rho", 0, 1e300, &I_rho, err);

    if (rc != MODAL_OK)
        return rc;
    if (shaft->massless)
        return modal_fail_field(err, MODAL_BAD_INPUT, e->path, "%s: a massless shaft has no rotary inertia; "
                                "use structure.model \"finite_elements\"", e->path);
    shaft->I_rho += I_rho;
    shaft->rotary_effect = e->index;
    return MODAL_OK;
}

static const char *const keys[] = { "I_rho", NULL };
static const char *const structures[] = { "shaft", NULL };
const struct scene_effect_kind effect_rotary_inertia = { "rotary_inertia", keys, structures, lower };
