/* contact_friction.c - contact and friction at one place: a normal spring under preload, a tangential slider whose bound is mu times
 * the momentary normal force.  `normal` and `tangential` name the dofs; the other side is the ground */
#include <math.h>
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    static const char *const names[] = { "normal_stiffness", "preload", "tangential_stiffness", "mu" };
    struct law law;
    double x[4] = { 0 };
    int normal = -1, tangential = -1;
    char where[128];
    enum modal_status rc = lowering_dof(l, e->json, e->path, "normal", true, &normal, err);

    if (rc == MODAL_OK)
        rc = lowering_dof(l, e->json, e->path, "tangential", true, &tangential, err);
    json_path(where, e->path, normal < 0 ? "normal" : "tangential");
    if (rc == MODAL_OK && (normal < 0 || tangential < 0 || normal == tangential))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: `normal` and `tangential` must be two different dofs", e->path);
    for (int i = 0; i < 4 && rc == MODAL_OK; i++)
        rc = i == 1 ? json_get_number(e->json, e->path, names[i], -HUGE_VAL, HUGE_VAL, &x[i], err)
                    : json_need_number(e->json, e->path, names[i], 0, HUGE_VAL, &x[i], err);
    if (rc == MODAL_OK && x[0] == 0 && x[1] <= 0)          /* never in contact: it leaves nothing */
        return rc;
    if (rc == MODAL_OK)
        rc = law_contact_friction(x[0], x[1], x[2], x[3], &law, err);
    if (rc != MODAL_OK)
        return rc;
    law.dof[1] = tangential;
    law.to[1] = -1;
    return local_law_add(l, e, rc, (struct local_ends) { normal, -1 }, &law, err);
}

static const char *const keys[] = { "normal", "tangential", "normal_stiffness", "preload", "tangential_stiffness", "mu", NULL };
const struct scene_effect_kind effect_contact_friction = { "contact_friction", keys, NULL, lower };
