/* strain_rate_damping.c - C = mu K of the elastic members, mu in s; a structure whose members
 * turn says how itself
 *
 * Kelvin and Voigt's solid: stress = E (strain + mu strain').  The strain's rate is that of the
 * member on its own axes, so on fixed ones a turning shaft adds -mu W Ks J to K beside C ((2) of
 * shaft.c): above the critical speed it destabilises.
 */
#include "modal/scene/lowering.h"

struct strain_rate { double mu; };

static const struct scene_key keys[] = {
    { "mu", SCENE_NUMBER, offsetof(struct strain_rate, mu), "s", -HUGE_VAL, HUGE_VAL,
      .needed = true, .means = "stress per strain rate over stress per strain", .example = "1e-4" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct strain_rate *s = e->values;

    return lowering_strain_rate(l, s->mu, err);
}

const struct scene_effect_kind effect_strain_rate_damping = {
    .name = "strain_rate_damping",
    .keys = { scene_type_keys, keys },
    .size = sizeof(struct strain_rate),
    .law = "C gains mu K of the elastic members",
    .lower = lower,
};
