/* rayleigh_damping.c - C = alpha M + beta K of the structure (alpha in 1/s, beta in s)
 *
 * Where members turn, beta damps their strain on their own axes and alpha acts against still air.
 */
#include "modal/scene/lowering.h"

/* alpha M of the structure alone: entries of other effects come after `structural`. */
static void add_alpha(struct lowering *l, double alpha)
{
    for (int i = 0; alpha != 0 && i < l->structural[PROGRAM_M]; i++) {
        struct triplet t = l->constant[PROGRAM_M].x[i];
        lowering_add_still_damping(l, t.i, t.j, alpha * t.value);
    }
}

struct rayleigh { double alpha, beta; };

static const struct scene_key keys[] = {
    { "alpha", SCENE_NUMBER, offsetof(struct rayleigh, alpha), "1/s", -HUGE_VAL, HUGE_VAL,
      .means = "C gains alpha M of the structure", .example = "0.5" },
    { "beta", SCENE_NUMBER, offsetof(struct rayleigh, beta), "s", -HUGE_VAL, HUGE_VAL,
      .means = "C gains beta K of the structure", .example = "1e-4" },
    { 0 },
};

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct rayleigh *s = e->values;

    add_alpha(l, s->alpha);
    return lowering_strain_rate(l, s->beta, err);
}

const struct scene_effect_kind effect_rayleigh_damping = {
    .name = "rayleigh_damping", .keys = { scene_type_keys, keys }, .size = sizeof(struct rayleigh),
    .law = "C gains alpha M + beta K of the structure", .lower = lower,
};
