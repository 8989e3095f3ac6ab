/*
 * coulomb.c - rigid friction: limit [N] against the motion, at rest whatever holds, up to limit
 *
 * Two of them side by side hold as one of both limits; nothing says how they share it.  The second's law is the first's.
 */
#include <math.h>
#include "modal/scene/effects/local_law.h"

/* The rigid friction that already acts between the same dofs, or NULL. */
static struct law *beside(struct lowering *l, struct local_ends at)
{
    for (int i = 0; i < l->p->laws; i++) {
        struct law *law = &l->p->law[i];

        if (law->kind->set_valued && ((law->dof[0] == at.dof && law->to[0] == at.to) || (law->dof[0] == at.to && law->to[0] == at.dof)))
            return law;
    }
    return NULL;
}

/* LAW holds LIMIT more; the effect at hand is told by its row. */
static enum modal_status strengthen(struct lowering *l, struct law *law, double limit, struct modal_error *err)
{
    struct law sum;
    enum modal_status rc = law_coulomb(law->limit + limit, &sum, err);

    if (rc != MODAL_OK)
        return rc;
    sum.effect = law->effect;
    sum.dof[0] = law->dof[0];
    sum.to[0] = law->to[0];
    law_done(law);
    *law = sum;
    l->p->effect[l->effect].carrier = sum.effect + 1;
    return MODAL_OK;
}

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    double limit = 0;
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "limit", 0, HUGE_VAL, &limit, err);
    if (rc != MODAL_OK || limit == 0)
        return rc;
    if (beside(l, at) != NULL)
        return strengthen(l, beside(l, at), limit, err);
    return local_law_add(l, e, law_coulomb(limit, &law, err), at, &law, err);
}

static const char *const keys[] = { "dof", "to", "limit", NULL };
const struct scene_effect_kind effect_coulomb = { "coulomb", keys, NULL, lower };
