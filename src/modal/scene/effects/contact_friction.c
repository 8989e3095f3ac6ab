/* contact_friction.c - contact and friction at one place: a normal spring under preload, a
 * tangential slider whose bound is mu times the momentary normal force.  `normal` and `tangential`
 * say where: a dof against the ground, or a direction of several
 *
 * With d_n = x_normal, d_t = x_tangential,
 *
 *     N = max(0, preload + normal_stiffness d_n),    |f_t| <= mu N,                         (1)
 *
 * f_t from a spring tangential_stiffness whose slider is dragged where (1) would be passed. The
 * two directions are coupled one way: d_t does not act on N.
 */
#include "modal/scene/effects/local_law.h"

struct contact {
    struct scene_ends normal, tangential;
    double normal_stiffness, preload, tangential_stiffness, mu;
};

static const struct scene_key keys[] = {
    { "normal", SCENE_PLACE, offsetof(struct contact, normal), "", .needed = true,
      .means = "d_n into the contact: a dof, or weights by dof name", .example = "\"x1\"" },
    { "tangential", SCENE_PLACE, offsetof(struct contact, tangential), "", .needed = true,
      .means = "d_t along the contact, likewise", .example = "\"x2\"" },
    { "normal_stiffness", SCENE_NUMBER, offsetof(struct contact, normal_stiffness), "N/m", 0,
      HUGE_VAL, .needed = true, .means = "k_n in N = max(0, preload + k_n d_n)",
      .example = "5000" },
    { "preload", SCENE_NUMBER, offsetof(struct contact, preload), "N", -HUGE_VAL, HUGE_VAL,
      .means = "normal force at d_n = 0; < 0 is an open gap", .example = "10" },
    { "tangential_stiffness", SCENE_NUMBER, offsetof(struct contact, tangential_stiffness), "N/m",
      0, HUGE_VAL, .needed = true, .means = "of the spring before the slider", .example = "4000" },
    { "mu", SCENE_NUMBER, offsetof(struct contact, mu), "", 0, HUGE_VAL, .needed = true,
      .means = "friction bound over momentary normal force", .example = "0.3" },
    { 0 },
};

/* Input 0 is the normal, 1 the tangential displacement (law.h). */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct contact *s = e->values;
    struct law law;
    char where[128];

    json_path(where, e->path, "tangential");
    if (s->normal.count == 1 && s->tangential.count == 1
        && s->normal.x[0].dof == s->tangential.x[0].dof)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s: `normal` and `tangential` must be two different dofs",
                                e->path);
    if (s->normal_stiffness == 0 && s->preload <= 0)       /* never in contact: it leaves nothing */
        return MODAL_OK;
    enum modal_status rc = law_contact_friction(s->normal_stiffness, s->preload,
                                                s->tangential_stiffness, s->mu, &law, err);
    if (rc != MODAL_OK)
        return rc;
    lowering_place(l, &law, 0, s->normal);
    lowering_place(l, &law, 1, s->tangential);
    lowering_add_law(l, &law);
    return MODAL_OK;
}

const struct scene_effect_kind effect_contact_friction = {
    .name = "contact_friction",
    .keys = { scene_type_keys, keys },
    .size = sizeof(struct contact),
    .law = "minus N = max(0, preload + normal_stiffness d_n) on normal; on tangential minus a "
           "friction "
           "element of tangential_stiffness whose limit is mu N",
    .lower = lower,
};
