/* clearance.c - a shaft's end as a journal in a circular race: `gap` in m, `stiffness` in N/m,
 * `dissipation` in s/m, `journal_mass` in kg
 *
 * It takes the place of the bearing at its end; laws/journal_contact.c has the force.  With finite
 * elements, or with a journal_mass, the journal's position is the shaft's dofs there; a massless
 * shaft without journal_mass has it from a scalar balance.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/structures/shaft.h"

struct clearance { int at; double gap, stiffness, dissipation, journal_mass; };

static const struct scene_key keys[] = {
    { "at", SCENE_WORD, offsetof(struct clearance, at), .needed = true, .words = shaft_ends,
      .means = "the end of the shaft", .example = "\"left\"" },
    { "gap", SCENE_NUMBER, offsetof(struct clearance, gap), "m", 0, SCENE_LARGE,
      .needed = true, .means = "radial, between journal and race", .example = "1e-4" },
    { "stiffness", SCENE_NUMBER, offsetof(struct clearance, stiffness), "N/m", 0, SCENE_LARGE,
      .needed = true, .means = "of the contact, radial", .example = "1e7" },
    { "dissipation", SCENE_NUMBER, offsetof(struct clearance, dissipation), "s/m", 0, SCENE_LARGE,
      .means = "mu of the factor 1 + mu a', a the depth; it never pulls", .example = "0.1" },
    { "journal_mass", SCENE_NUMBER, offsetof(struct clearance, journal_mass), "kg", 0, SCENE_LARGE,
      .means = "of the journal", .example = "0.05" },
    { 0 },
};

/* Only noted: whether the journal has mass decides what its law reads (shaft.c). */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct clearance *s = e->values;
    struct shaft_end *end = &((struct shaft *)l->mesh)->end[s->at];
    char where[128];

    json_path(where, e->path, "at");
    if (end->clearance.listed)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s: this end of the shaft has a clearance already", where);
    end->clearance.listed = true;
    end->clearance.gap = s->gap;
    end->clearance.stiffness = s->stiffness;
    end->clearance.dissipation = s->dissipation;
    end->clearance.journal_mass = s->journal_mass;
    end->clearance.effect = e->index;
    /* the law is lowered with the shaft's ends, past the place where scene.c would note its text */
    l->p->effect[e->index].law_text = json_print(e->json);
    return l->p->effect[e->index].law_text != NULL
           ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "clearance: out of memory");
}

static const char *const structures[] = { "shaft", NULL };
const struct scene_effect_kind effect_clearance = {
    .name = "clearance", .keys = { scene_type_keys, keys }, .size = sizeof(struct clearance),
    .structures = structures,
    .law = "minus stiffness a (1 + dissipation a') radially on the journal where a = |d| - gap > 0",
    .lower = lower,
};
