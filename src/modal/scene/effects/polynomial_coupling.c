/* polynomial_coupling.c - forces that are products of powers of several dofs, as reduced models of
 * shells, beams and frames have them
 *
 * A law has at most LAW_INPUTS_MOST inputs: terms share one as long as its dofs are no more, and
 * each goes to the first where its own fit, so that the cost of a motion is shared and any number
 * of dofs is served.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "modal/scene/lowering.h"

enum {
    TERMS_MOST = 4096,               /* chosen: all cubic terms of eleven modes */
    DEGREE_MOST = LAW_TERMS_MOST,    /* as of polynomial_spring */
};

struct effect { const cJSON *terms; };
struct term { double coefficient; struct scene_ends powers; int on; };

static const struct scene_key term_keys[] = {
    { "coefficient", SCENE_NUMBER, offsetof(struct term, coefficient), "N/m^n", -HUGE_VAL,
      HUGE_VAL, .needed = true, .means = "c in f = c x_a^n x_b^m .., of any sign, n the sum of its "
                                         "powers",
      .example = "100" },
    { "powers", SCENE_ENDS, offsetof(struct term, powers), "", .needed = true,
      .means = "whole numbers by dof name, from 1, together at most 64", .example = "{\"x1\": 3}" },
    { "on", SCENE_DOF, offsetof(struct term, on), .needed = true,
      .means = "the dof on which minus f acts", .example = "\"x1\"" },
    { 0 },
};

static const struct scene_key keys[] = {
    { "terms", SCENE_LIST, offsetof(struct effect, terms), "", 1, TERMS_MOST, .needed = true,
      .members = term_keys,
      .means = "of at most 4 dofs each, that of `on` among them; they need not come from a "
               "potential",
      .example = "[{\"coefficient\": 100, \"powers\": {\"x1\": 3}, \"on\": \"x1\"}]" },
    { 0 },
};

/* The terms of one law, and its dofs. */
struct group { int dof[LAW_INPUTS_MOST], dofs, count; struct law_term *term; };

/* DOF's input in G, new where there is room; -1: there is none. */
static int input_of(struct group *g, int dof)
{
    for (int i = 0; i < g->dofs; i++)
        if (g->dof[i] == dof)
            return i;
    if (g->dofs == LAW_INPUTS_MOST)
        return -1;
    g->dof[g->dofs] = dof;
    return g->dofs++;
}

/* T into G, if its dofs fit.  False: they do not, or (*no_memory) there is none. */
static bool join(struct group *g, const struct term *t, bool *no_memory)
{
    struct group with = *g;
    struct law_term term = { .coefficient = t->coefficient, .on = input_of(&with, t->on) };

    for (int i = 0; i < t->powers.count; i++) {
        int input = input_of(&with, t->powers.x[i].dof);

        if (input < 0)
            return false;
        term.power[input] = (int)t->powers.x[i].weight;
    }
    if (term.on < 0)
        return false;
    with.term = realloc(g->term, ((size_t)g->count + 1) * sizeof term);
    *no_memory = with.term == NULL;
    if (*no_memory)
        return false;
    with.term[with.count++] = term;
    *g = with;
    return true;
}

/* What its rows cannot say of a term at PATH: its dofs, its degree. */
static enum modal_status check_term(const struct term *t, const char *path,
                                    struct modal_error *err)
{
    double degree = 0;
    int dofs = 1;
    char where[128];

    json_path(where, path, "powers");
    for (int i = 0; i < t->powers.count; i++) {
        double n = t->powers.x[i].weight;

        if (!(n >= 1 && n <= DEGREE_MOST && n == floor(n)))
            return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                    "%s has a power %g; accepted: whole numbers from 1 to %d",
                                    where, n, DEGREE_MOST);
        degree += n;
        dofs += t->powers.x[i].dof != t->on;
    }
    if (degree > DEGREE_MOST || dofs > LAW_INPUTS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, where,
                                "%s: degree %g in %d dofs, that of `on` among them; at most %d and "
                                "%d", where, degree, dofs, DEGREE_MOST, LAW_INPUTS_MOST);
    json_path(where, path, "on");
    if (t->on < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s is the ground; accepted: the name of a dof", where);
    return MODAL_OK;
}

/* T among the groups, COUNT of them; a linear one is an entry of K. */
static enum modal_status place_term(struct lowering *l, const struct term *t, struct group *group,
                                    int *count, struct modal_error *err)
{
    bool no_memory = false;
    int g = 0;

    if (t->coefficient == 0)
        return MODAL_OK;
    if (t->powers.count == 1 && t->powers.x[0].weight == 1) {
        lowering_add(l, PROGRAM_K, t->on, t->powers.x[0].dof, t->coefficient);
        return MODAL_OK;
    }
    while (g < TERMS_MOST && !join(&group[g], t, &no_memory) && !no_memory)
        g++;
    *count = g >= *count ? g + 1 : *count;
    return no_memory ? modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory") : MODAL_OK;
}

/* The laws of the groups. */
static enum modal_status add_laws(struct lowering *l, const struct group *group, int count,
                                  struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int g = 0; rc == MODAL_OK && g < count; g++) {
        struct law law;

        rc = law_coupling(group[g].term, group[g].count, group[g].dofs, &law, err);
        for (int i = 0; rc == MODAL_OK && i < group[g].dofs; i++)
            lowering_place(l, &law, i, (struct scene_ends) {
                                           &(struct law_end) { group[g].dof[i], 1 }, 1 });
        if (rc == MODAL_OK)
            lowering_add_law(l, &law);
    }
    return rc;
}

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    static const struct scene_key *const tables[] = { term_keys, NULL };
    const struct effect *s = e->values;
    struct group *group = calloc(TERMS_MOST, sizeof *group);
    int count = 0, i = 0;
    char path[128];
    const cJSON *item;
    enum modal_status rc =
        group != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");

    cJSON_ArrayForEach(item, s->terms) {
        struct term t = { 0 };

        if (rc != MODAL_OK)
            break;
        snprintf(path, sizeof path, "%s.terms[%d]", e->path, i++);
        rc = scene_keys_read(l, item, path, tables, &t, err);
        if (rc == MODAL_OK)
            rc = check_term(&t, path, err);
        if (rc == MODAL_OK)
            rc = place_term(l, &t, group, &count, err);
        scene_keys_free(tables, &t);
    }
    if (rc == MODAL_OK)
        rc = add_laws(l, group, count, err);
    for (int g = 0; g < count; g++)
        free(group[g].term);
    free(group);
    return rc;
}

const struct scene_effect_kind effect_polynomial_coupling = {
    .name = "polynomial_coupling", .keys = { scene_type_keys, keys }, .size = sizeof(struct effect),
    .law = "minus the coefficient times the product of the powers on the dof `on` of each term",
    .lower = lower,
};
