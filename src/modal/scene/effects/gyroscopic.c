/* gyroscopic.c - the polar inertia of a turning shaft's disk (and of its sections, with
 * rotary_inertia): no keys
 *
 * With the polar inertia Mg, -W Mg J adds to C, and on turning axes W^2 Mg to K (shaft.c, (1),
 * (2)): it splits forward from backward whirl.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/structures/shaft.h"

/* Only noted: Mg is known once rotary_inertia has been read. */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    struct shaft *shaft = l->mesh;

    if (shaft->gyroscopic)
        return modal_fail_field(err, MODAL_BAD_INPUT, e->path, "%s: gyroscopic is listed already",
                                e->path);
    shaft->gyroscopic = true;
    shaft->gyroscopic_effect = e->index;
    return MODAL_OK;
}

static const char *const structures[] = { "shaft", NULL };
const struct scene_effect_kind effect_gyroscopic = {
    .name = "gyroscopic", .keys = { scene_type_keys }, .structures = structures,
    .law = "C gains -speed Mg J, Mg the polar inertia of disk and sections, J turning y into z",
    .lower = lower,
};
