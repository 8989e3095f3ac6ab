/*
 * coulomb.c - rigid friction: limit [N] against the motion, at rest whatever holds, up to limit
 *
 * Two of them side by side hold as one of both limits; nothing says how they share it.  The
 * second's law is the first's.
 */
#include <float.h>
#include <math.h>
#include "modal/scene/effects/local_law.h"

static const double SAME = 4 * DBL_EPSILON;  /* of two products of two numbers each */

/* How often the direction of LAW fits into AT, of either sign; 0: they are not parallel. */
static double ratio(const struct law *law, struct scene_ends at)
{
    double found = 0;

    for (int i = 0; i < at.count; i++) {
        int e = 0;

        while (e < law->start[1] && law->end[e].dof != at.x[i].dof)
            e++;
        if (at.count != law->start[1] || e == law->start[1])
            return 0;
        if (i == 0)
            found = at.x[i].weight / law->end[e].weight;
        if (fabs(found * law->end[e].weight - at.x[i].weight) > SAME * fabs(at.x[i].weight))
            return 0;
    }
    return fabs(found);
}

/* The rigid friction that already acts along the same direction, or NULL. */
static struct law *beside(struct lowering *l, struct scene_ends at)
{
    for (int i = 0; i < l->p->laws; i++)
        if (l->p->law[i].kind->set_valued && ratio(&l->p->law[i], at) > 0)
            return &l->p->law[i];
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
    lowering_place(l, &sum, 0, (struct scene_ends) { law->end, law->start[1] });
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
    struct law law, *same = beside(l, s->at.along);

    if (s->limit == 0)
        return MODAL_OK;
    if (same != NULL)  /* limit sign(r d') r on the first's direction, d' its rate */
        return strengthen(l, same, s->limit * ratio(same, s->at.along), err);
    return local_law_add(l, e, law_coulomb(s->limit, &law, err), s->at.along, &law, err);
}

const struct scene_effect_kind effect_coulomb = {
    .name = "coulomb", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct coulomb),
    .law = "minus limit sign(d') on dof; at d' = 0 what holds it, at most limit", .lower = lower,
};
