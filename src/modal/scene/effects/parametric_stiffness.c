/*
 * parametric_stiffness.c - a spring whose stiffness pulsates: stiffness cos(k omega t + phase) between `dof` and `to`
 *
 * cos(k omega t + phase) = cos(phase) cos(k omega t) - sin(phase) sin(k omega t).  k is a whole number, default 1.
 */
#include <math.h>
#include "modal/scene/lowering.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    double stiffness = 0, phase = 0;
    int k = 1;
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "stiffness", -HUGE_VAL, HUGE_VAL, &stiffness, err);
    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "phase", -HUGE_VAL, HUGE_VAL, &phase, err);
    if (rc == MODAL_OK)
        rc = json_get_int(e->json, e->path, "k", 0, LOWERING_HARMONIC_MOST, &k, err);
    if (rc == MODAL_OK && k > 0)
        rc = lowering_need_omega(l, "parametric_stiffness", err);
    if (rc == MODAL_OK)
        lowering_between_harmonic(l, PROGRAM_K, k, at, stiffness * cos(phase), phase != 0 ? -stiffness * sin(phase) : 0);
    return rc;
}

static const char *const keys[] = { "dof", "to", "stiffness", "k", "phase", NULL };
const struct scene_effect_kind effect_parametric_stiffness = { "parametric_stiffness", keys, NULL, lower };
