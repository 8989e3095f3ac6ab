/* bearing.c - a shaft's end held by springs to the ground, and damped: `transverse` in N/m,
 * `rotational` in N m/rad, `damping` in N s/m
 *
 * With a coupling at the same end the springs act in series; the damping acts on the shaft's end,
 * on fixed axes. A spring that is not given is no link of that series, one given as 0 holds
 * nothing: so presence counts.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/structures/shaft.h"

struct support { int at; double transverse, rotational, damping; };

static const struct scene_key spring_keys[] = {        /* of both */
    { "at", SCENE_WORD, offsetof(struct support, at), .needed = true, .words = shaft_ends,
      .means = "the end of the shaft", .example = "\"left\"" },
    { "transverse", SCENE_NUMBER, offsetof(struct support, transverse), "N/m", 0, SCENE_LARGE,
      .otherwise = "no link", .means = "against the end's displacement, alike in both planes",
      .example = "1e6" },
    { "rotational", SCENE_NUMBER, offsetof(struct support, rotational), "N m/rad", 0, SCENE_LARGE,
      .otherwise = "no link", .means = "against the end's slope, alike in both planes",
      .example = "100" },
    { 0 },
};
static const struct scene_key damping_keys[] = {
    { "damping", SCENE_NUMBER, offsetof(struct support, damping), "N s/m", 0, SCENE_LARGE,
      .means = "against the end's velocity on fixed axes", .example = "50" },
    { 0 },
};

/* Only noted: what the end's series is depends on the other effect (shaft_supports.c). */
static enum modal_status note_spring(const struct scene_effect *e, struct shaft_spring *out,
                                     struct modal_error *err)
{
    const struct support *s = e->values;

    if (out->listed)
        return modal_fail_field(err, MODAL_BAD_INPUT, e->path,
                                "%s: this end of the shaft has one already", e->path);
    *out = (struct shaft_spring){
        .listed = true,
        .effect = e->index,
        .transverse = s->transverse,
        .rotational = s->rotational,
        .has_transverse = json_member(e->json, "transverse") != NULL,
        .has_rotational = json_member(e->json, "rotational") != NULL,
    };
    return MODAL_OK;
}

static enum modal_status lower_bearing(struct lowering *l, const struct scene_effect *e,
                                       struct modal_error *err)
{
    const struct support *s = e->values;
    struct shaft_end *end = &((struct shaft *)l->mesh)->end[s->at];
    enum modal_status rc = note_spring(e, &end->bearing, err);

    if (rc == MODAL_OK)
        end->damping = s->damping;
    return rc;
}

static enum modal_status lower_coupling(struct lowering *l, const struct scene_effect *e,
                                        struct modal_error *err)
{
    const struct support *s = e->values;

    return note_spring(e, &((struct shaft *)l->mesh)->end[s->at].coupling, err);
}

static const char *const structures[] = { "shaft", NULL };
const struct scene_effect_kind effect_bearing = {
    .name = "bearing", .keys = { scene_type_keys, spring_keys, damping_keys },
    .size = sizeof(struct support), .structures = structures,
    .law = "minus transverse u - damping u' and minus rotational slope, in series with a coupling",
    .lower = lower_bearing,
};
const struct scene_effect_kind effect_coupling = {
    .name = "coupling", .keys = { scene_type_keys, spring_keys }, .size = sizeof(struct support),
    .structures = structures,
    .law = "minus transverse u and minus rotational slope, in series with a bearing",
    .lower = lower_coupling,
};
