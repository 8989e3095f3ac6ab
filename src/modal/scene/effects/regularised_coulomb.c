/* regularised_coulomb.c - limit tanh(d' / velocity), limit in N, velocity > 0 in m/s
 *
 * Smooth, so it is sampled and stepped without events; but where the speed changes sign within
 * velocity, that layer must be resolved: N of order 2 pi v_max / velocity samples.
 */
#include "modal/scene/effects/local_law.h"

struct regularised { struct local_ends at; double limit, velocity; };

static const struct scene_key keys[] = {
    { "limit", SCENE_NUMBER, offsetof(struct regularised, limit), "N", 0, HUGE_VAL, .needed = true,
      .means = "the force at speeds far above velocity", .example = "0.8" },
    { "velocity", SCENE_NUMBER, offsetof(struct regularised, velocity), "m/s", SCENE_POSITIVE,
      HUGE_VAL, .needed = true, .means = "width of the rounded step about d' = 0",
      .example = "1e-3" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct regularised *s = e->values;
    struct law law;

    if (s->limit == 0)
        return MODAL_OK;
    return local_law_add(l, e, law_regularised_coulomb(s->limit, s->velocity, &law, err),
                         s->at.along, &law, err);
}

const struct scene_effect_kind effect_regularised_coulomb = {
    .name = "regularised_coulomb", .keys = { lowering_ends_keys, keys },
    .size = sizeof(struct regularised), .law = "minus limit tanh(d' / velocity) on dof",
    .lower = lower,
};
