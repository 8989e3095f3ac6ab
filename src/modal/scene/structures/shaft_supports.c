/*
 * shaft_supports.c - what holds a shaft's ends: bearing and coupling in series, or a journal in a
 * clearance
 */
#include "modal/scene/structures/shaft_parts.h"
#include <stdio.h>

const char *const shaft_ends[] = { [SHAFT_LEFT] = "left", [SHAFT_RIGHT] = "right", NULL };

/* Bearing and coupling in series: what is not given is no link; none given: no spring. */
static double series(bool has_a, double a, bool has_b, double b)
{
    if (has_a && has_b)
        /* a link of 0 holds nothing, nor does the series */
        return a > 0 && b > 0 ? 1 / (1 / a + 1 / b) : 0;
    return has_a ? a : has_b ? b : 0;  /* the other is no link */
}

double shaft_transverse(const struct shaft_end *e)
{
    return series(e->bearing.has_transverse, e->bearing.transverse, e->coupling.has_transverse,
                  e->coupling.transverse);
}

double shaft_rotational(const struct shaft_end *e)
{
    return series(e->bearing.has_rotational, e->bearing.rotational, e->coupling.has_rotational,
                  e->coupling.rotational);
}

/* Row EFFECT acts: its entries were not counted when it was lowered. */
static void mark(struct lowering *l, int effect, bool acts)
{
    if (acts)
        l->p->effect[effect].active = true;
}

void shaft_mark_active(struct lowering *l)
{
    const struct shaft *s = l->mesh;

    for (int end = 0; end < 2; end++) {
        const struct shaft_end *e = &s->end[end];

        if (e->bearing.listed)
            mark(l, e->bearing.effect,
                 e->bearing.transverse > 0 || e->bearing.rotational > 0 || e->damping > 0);
        if (e->coupling.listed)
            mark(l, e->coupling.effect, e->coupling.transverse > 0 || e->coupling.rotational > 0);
    }
    if (s->strain_rate != 0)
        mark(l, s->strain_rate_effect, true);
    if (s->gyroscopic)
        mark(l, s->gyroscopic_effect, s->speed != 0 && (s->disk_mass > 0 || s->I_rho > 0));
    if (s->I_rho > 0)
        mark(l, s->rotary_effect, true);
}

/* Bearing and clearance are two ways to hold one end. */
enum modal_status shaft_check_ends(const struct shaft *s, struct modal_error *err)
{
    char where[64];

    for (int end = 0; end < 2; end++) {
        const struct shaft_end *e = &s->end[end];
        /* the later of both is told */
        int other = e->bearing.listed ? e->bearing.effect : e->coupling.effect;

        if (!e->clearance.listed || !(e->bearing.listed || e->coupling.listed))
            continue;
        snprintf(where, sizeof where, "effects[%d].at",
                 e->clearance.effect > other ? e->clearance.effect : other);
        return modal_fail_field(
            err, MODAL_BAD_INPUT, where,
            "%s: the shaft's %s end has a clearance, which takes the place of bearing and "
            "coupling there",
            where, end == SHAFT_LEFT ? "left" : "right");
    }
    return MODAL_OK;
}

enum modal_status shaft_add_clearance(struct lowering *l, int end, int y, int z,
                                      const double *stiffness, struct modal_error *err)
{
    const struct shaft *s = l->mesh;
    struct law law;
    enum modal_status rc = law_clearance(s->end[end].clearance.gap, s->end[end].clearance.stiffness,
                                         s->end[end].clearance.dissipation, stiffness, &law, err);

    if (rc != MODAL_OK)
        return rc;
    lowering_place(l, &law, 0, (struct scene_ends) { &(struct law_end) { y, 1 }, 1 });
    /* inputs (y, z): law.h */
    lowering_place(l, &law, 1, (struct scene_ends) { &(struct law_end) { z, 1 }, 1 });
    l->effect = s->end[end].clearance.effect;  /* the row that lists it, not the structure */
    lowering_add_law(l, &law);
    l->effect = -1;
    return MODAL_OK;
}
