/* clearance.c - a shaft's end as a journal in a circular race: `gap` in m, `stiffness` in N/m, `dissipation` in s/m, `journal_mass` in kg
 *
 * It takes the place of the bearing at its end; laws/journal_contact.c has the force.  With finite elements, or with a journal_mass, the
 * journal's position is the shaft's dofs there; a massless shaft without journal_mass has it from a scalar balance.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/structures/shaft.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct shaft *shaft = l->mesh;
    double gap = 0, stiffness = 0, dissipation = 0, mass = 0;
    int end = 0;
    char where[128];
    enum modal_status rc = shaft_end_of(l, e, &end, err);

    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "gap", 0, 1e300, &gap, err);
    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "stiffness", 0, 1e300, &stiffness, err);
    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "dissipation", 0, 1e300, &dissipation, err);
    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "journal_mass", 0, 1e300, &mass, err);
    if (rc != MODAL_OK)
        return rc;
    json_path(where, e->path, "at");
    if (shaft->end[end].clearance.listed)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: this end of the shaft has a clearance already", where);
    shaft->end[end].clearance.listed = true;
    shaft->end[end].clearance.gap = gap;
    shaft->end[end].clearance.stiffness = stiffness;
    shaft->end[end].clearance.dissipation = dissipation;
    shaft->end[end].clearance.journal_mass = mass;
    shaft->end[end].clearance.effect = e->index;
    l->p->effect[e->index].law_text = json_print(e->json);     /* the law is lowered with the shaft's ends */
    return l->p->effect[e->index].law_text != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "clearance: out of memory");
}

static const char *const keys[] = { "at", "gap", "stiffness", "dissipation", "journal_mass", NULL };
static const char *const structures[] = { "shaft", NULL };
const struct scene_effect_kind effect_clearance = { "clearance", keys, structures, lower };
