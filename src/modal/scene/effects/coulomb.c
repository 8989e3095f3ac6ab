/*
 * coulomb.c - rigid friction: limit [N] against the motion, at rest whatever holds, up to limit
 *
 * Two of them side by side hold as one of both limits; nothing says how they share it.  The
 * second's law is the first's.
 */
#include "modal/scene/effects/local_law.h"

/* The rigid friction that already acts between the same dofs, or NULL. */
static struct law *beside(struct lowering *l, struct local_ends at)
{
    for (int i = 0; i < l->p->laws; i++) {
        struct law *law = &l->p->law[i];

        if (law->kind->set_valued
            && ((law->dof[0] == at.dof && law->to[0] == at.to)
                || (law->dof[0] == at.to && law->to[0] == at.dof)))
            return law;
    }
    return NULL;
}

/* LAW holds LIMIT more; the effect at hand is told by its row. */
static enum modal_status strengthen(struct lowering *l, struct law *law, double limit,
                                    struct modal_error *err)
{
    struct law sum;
    enum modal_status rc = law_coulomb(law->limit + limit, &sum, err);

    if (rc != MODAL_OK)
        return rc;
    sum.effect = law->effect;  /* the first's row goes on counting */
    sum.dof[0] = law->dof[0];
    sum.to[0] = law->to[0];
    law_done(law);
    *law = sum;
    l->p->effect[l->effect].carrier = sum.effect + 1;
    return MODAL_OK;
}

struct coulomb { struct local_ends at; double limit; };

static const struct scene_key keys[] = {
    { "limit", SCENE_NUMBER, offsetof(struct coulomb, limit), "N", 0, HUGE_VAL,
      .needed = true, .means = "against the motion; at rest whatever holds, up to it",
      .example = "0.8" },
    { 0 },
};

/* A limit of 0 leaves nothing: its law would only make the scene nonlinear. */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct coulomb *s = e->values;
    struct law law;

    if (s->limit == 0)
        return MODAL_OK;
    if (beside(l, s->at) != NULL)
        return strengthen(l, beside(l, s->at), s->limit, err);
    return local_law_add(l, e, law_coulomb(s->limit, &law, err), s->at, &law, err);
}

const struct scene_effect_kind effect_coulomb = {
    .name = "coulomb", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct coulomb),
    .law = "minus limit sign(d') on dof; at d' = 0 what holds it, at most limit", .lower = lower,
};
