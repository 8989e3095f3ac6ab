/* iwan.c - Jenkins elements side by side: stiffnesses [N/m] and limits [N], as many of each;
 * those of stiffness or limit 0 are left out
 *
 * Their sum is a smooth curve as far as one looks: masses of small sliders begin to slip one after
 * the other. The force at large d is the sum of the limits, the slope at rest that of the
 * stiffnesses.
 */
#include "modal/scene/effects/local_law.h"

/* Each slider is a state that is stepped and sampled at every instant: a backbone of as many
 * straight pieces is within 1/256 of any smooth one. */
enum { SLIDERS_MOST = 256 };

struct iwan { struct local_ends at; struct scene_numbers stiffnesses, limits; };

static const struct scene_key keys[] = {
    { "stiffnesses", SCENE_NUMBERS, offsetof(struct iwan, stiffnesses), "N/m", 0, HUGE_VAL,
      .needed = true, .means = "of each element's spring", .example = "[1000, 500]" },
    { "limits", SCENE_NUMBERS, offsetof(struct iwan, limits), "N", 0, HUGE_VAL,
      .needed = true, .means = "of each element's slider, as many as stiffnesses",
      .example = "[0.5, 1]" },
    { 0 },
};

/* Elements that never push are left out, each being a state. */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct iwan *s = e->values;
    double *k = s->stiffnesses.x, *limit = s->limits.x;
    size_t springs = s->stiffnesses.count;
    bool fits = springs >= 1 && springs <= SLIDERS_MOST;
    struct law law;
    int count = 0;
    char where[128];

    json_path(where, e->path, fits ? "limits" : "stiffnesses");
    if (!fits || springs != s->limits.count)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s has %zu numbers; accepted: 1 to %d "
                                "stiffnesses and as many limits",
                                where, fits ? s->limits.count : springs, SLIDERS_MOST);
    for (size_t i = 0; i < springs; i++)
        if (k[i] > 0 && limit[i] > 0) {
            k[count] = k[i];
            limit[count++] = limit[i];
        }
    if (count == 0)
        return MODAL_OK;
    return local_law_add(l, e, law_iwan(k, limit, count, &law, err), s->at.along, &law, err);
}

const struct scene_effect_kind effect_iwan = {
    .name = "iwan", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct iwan),
    .law = "minus the sum over i of a friction element of stiffnesses[i], limits[i] on dof",
    .lower = lower,
};
