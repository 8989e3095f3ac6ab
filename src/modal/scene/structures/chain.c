/*
 * chain.c - masses in a row, springs and dampers between neighbours and to the ground at both ends
 *
 * Spring i of 0..n joins mass i-1 to mass i; masses -1 and n are the ground.  A spring or damper of
 * 0 is none.
 *
 * M is diagonal; K and C gain k [1 -1; -1 1] an element, tridiagonal in all. Negative springs are
 * allowed: their chain may be unstable, which is for the solvers to say.
 */
#include <stdio.h>
#include "modal/scene/lowering.h"

struct chain { struct scene_numbers masses, springs, dampers; };

static const struct scene_key keys[] = {
    { "masses", SCENE_NUMBERS, offsetof(struct chain, masses), "kg", -HUGE_VAL, HUGE_VAL,
      .needed = true, .means = "n of them, from left to right, each > 0", .example = "[1, 2]" },
    { "springs", SCENE_NUMBERS, offsetof(struct chain, springs), "N/m", -HUGE_VAL, HUGE_VAL,
      .needed = true, .means = "n + 1 from ground to ground, of any sign; 0: none",
      .example = "[100, 50, 100]" },
    { "dampers", SCENE_NUMBERS, offsetof(struct chain, dampers), "N s/m", -HUGE_VAL, HUGE_VAL,
      .otherwise = "none", .means = "n + 1 from ground to ground, of any sign; 0: none",
      .example = "[0.1, 0.2, 0]" },
    { 0 },
};

/* A dof x1, x2, .. each. */
static enum modal_status add_masses(struct lowering *l, const struct scene_numbers *m,
                                    struct modal_error *err)
{
    char where[64], name[32];

    for (size_t i = 0; i < m->count; i++) {
        if (m->x[i] <= 0) {
            snprintf(where, sizeof where, "structure.masses[%zu]", i);
            return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s is %g; a mass is > 0", where,
                                    m->x[i]);
        }
        snprintf(name, sizeof name, "x%zu", i + 1);
        lowering_add_dof(l, name);
        lowering_add(l, PROGRAM_M, (int)i, (int)i, m->x[i]);
    }
    return MODAL_OK;
}

/* The n + 1 elements K, which stand at WHERE, into MATRIX; an absent list has none. */
static enum modal_status add_elements(struct lowering *l, int matrix, size_t n,
                                      const struct scene_numbers *k, const char *where,
                                      struct modal_error *err)
{
    if (k->x != NULL && k->count != n + 1)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s has %zu numbers; %zu masses take %zu, "
                                "ground to ground",
                                where, k->count, n, n + 1);
    for (size_t i = 0; i < k->count; i++) {
        struct law_end end[2] = { { (int)i, 1 }, { (int)i - 1, -1 } };

        /* masses -1 and n are the ground */
        lowering_along(l, matrix, i == n ? (struct scene_ends) { end + 1, 1 }
                                         : (struct scene_ends) { end, i > 0 ? 2 : 1 }, k->x[i]);
    }
    return MODAL_OK;
}

/* Counts first: n is the masses', and the other lists answer to it. */
static enum modal_status lower(struct lowering *l, void *values, struct modal_error *err)
{
    const struct chain *c = values;
    size_t n = c->masses.count;
    enum modal_status rc;

    if (n < 1 || n > LOWERING_DOFS_MOST)
        return modal_fail_field(err, n < 1 ? MODAL_BAD_INPUT : MODAL_TOO_LARGE, "structure.masses",
                                "a chain has 1 to %d masses, not %zu", LOWERING_DOFS_MOST, n);
    rc = add_masses(l, &c->masses, err);
    if (rc == MODAL_OK)
        rc = add_elements(l, PROGRAM_K, n, &c->springs, "structure.springs", err);
    if (rc == MODAL_OK)
        rc = add_elements(l, PROGRAM_C, n, &c->dampers, "structure.dampers", err);
    return rc;
}

const struct scene_structure_kind structure_chain = {
    .name = "chain", .keys = { scene_type_keys, keys }, .size = sizeof(struct chain),
    .law = "m_i x_i'' + the forces of springs and dampers i and i + 1 = p_i", .lower = lower,
};
