/* bearing.c - a shaft's end held by springs to the ground, and damped: `transverse` in N/m, `rotational` in N m/rad, `damping` in N s/m
 *
 * With a coupling at the same end the springs act in series; the damping acts on the shaft's end, on fixed axes.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/structures/shaft.h"

static enum modal_status read_spring(const struct scene_effect *e, struct shaft_spring *out, struct modal_error *err)
{
    struct shaft_spring spring = { .listed = true, .effect = e->index };
    enum modal_status rc = json_get_number(e->json, e->path, "transverse", 0, 1e300, &spring.transverse, err);

    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "rotational", 0, 1e300, &spring.rotational, err);
    if (rc != MODAL_OK)
        return rc;
    if (out->listed)
        return modal_fail_field(err, MODAL_BAD_INPUT, e->path, "%s: this end of the shaft has one already", e->path);
    spring.has_transverse = cJSON_GetObjectItemCaseSensitive(e->json, "transverse") != NULL;
    spring.has_rotational = cJSON_GetObjectItemCaseSensitive(e->json, "rotational") != NULL;
    *out = spring;
    return MODAL_OK;
}

static enum modal_status lower_bearing(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct shaft *shaft = l->mesh;
    double damping = 0;
    int end = 0;
    enum modal_status rc = shaft_end_of(l, e, &end, err);

    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "damping", 0, 1e300, &damping, err);
    if (rc == MODAL_OK)
        rc = read_spring(e, &shaft->end[end].bearing, err);
    if (rc == MODAL_OK)
        shaft->end[end].damping = damping;
    return rc;
}

static enum modal_status lower_coupling(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct shaft *shaft = l->mesh;
    int end = 0;
    enum modal_status rc = shaft_end_of(l, e, &end, err);

    return rc == MODAL_OK ? read_spring(e, &shaft->end[end].coupling, err) : rc;
}

static const char *const structures[] = { "shaft", NULL };
static const char *const bearing_keys[] = { "at", "transverse", "rotational", "damping", NULL };
static const char *const coupling_keys[] = { "at", "transverse", "rotational", NULL };
const struct scene_effect_kind effect_bearing = { "bearing", bearing_keys, structures, lower_bearing };
const struct scene_effect_kind effect_coupling = { "coupling", coupling_keys, structures, lower_coupling };
