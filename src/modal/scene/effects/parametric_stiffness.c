/*
 * parametric_stiffness.c - a spring whose stiffness pulsates: stiffness cos(k omega t + phase)
 * between `dof` and `to`
 *
 * cos(k omega t + phase) = cos(phase) cos(k omega t) - sin(phase) sin(k omega t).  k is a whole
 * number, default 1.
 */
#include "modal/scene/lowering.h"

struct parametric { struct local_ends at; double stiffness, phase; int k; };

static const struct scene_key keys[] = {
    { "stiffness", SCENE_NUMBER, offsetof(struct parametric, stiffness), "N/m", -HUGE_VAL, HUGE_VAL,
      .needed = true, .means = "amplitude of the pulsation, of any sign", .example = "50" },
    { "k", SCENE_WHOLE, offsetof(struct parametric, k), "", 0, LOWERING_HARMONIC_MOST,
      .standard = 1, .means = "its harmonic of omega; 0: constant", .example = "2" },
    { "phase", SCENE_NUMBER, offsetof(struct parametric, phase), "rad", -HUGE_VAL, HUGE_VAL,
      .means = "of the pulsation at t = 0", .example = "0.5" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct parametric *s = e->values;
    enum modal_status rc =
        s->k > 0 ? lowering_need_omega(l, "parametric_stiffness", err) : MODAL_OK;

    if (rc == MODAL_OK)
        lowering_along_harmonic(l, s->k, s->at.along, s->stiffness * cos(s->phase),
                                s->phase != 0 ? -s->stiffness * sin(s->phase) : 0);
    return rc;
}

const struct scene_effect_kind effect_parametric_stiffness = {
    .name = "parametric_stiffness", .keys = { lowering_ends_keys, keys },
    .size = sizeof(struct parametric), .law = "minus stiffness cos(k omega t + phase) d on dof",
    .lower = lower,
};
