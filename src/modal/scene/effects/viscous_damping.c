/* viscous_damping.c - damping spread like the mass: C = per_length / mass_per_length M of the structure, by air that does not turn */
#include <math.h>
#include "modal/scene/lowering.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    double per_length = 0;
    enum modal_status rc = json_need_number(e->json, e->path, "per_length", -HUGE_VAL, HUGE_VAL, &per_length, err);

    if (rc == MODAL_OK && !(l->mass_per_length > 0))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, e->path, "%s: viscous_damping needs a structure with mass along its length", e->path);
    for (int i = 0; rc == MODAL_OK && per_length != 0 && i < l->structural[PROGRAM_M]; i++) {
        struct triplet t = l->constant[PROGRAM_M].x[i];
        lowering_add_still_damping(l, t.i, t.j, per_length / l->mass_per_length * t.value);
    }
    return rc;
}

static const char *const keys[] = { "per_length", NULL };
static const char *const structures[] = { "beam", "shaft", "wing", NULL };
const struct scene_effect_kind effect_viscous_damping = { "viscous_damping", keys, structures, lower };
