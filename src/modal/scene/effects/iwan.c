/* iwan.c - Jenkins elements side by side: stiffnesses [N/m] and limits [N], as many of each; those of stiffness or limit 0 are left out */
#include <math.h>
#include <stdlib.h>
#include "modal/scene/effects/local_law.h"

enum { SLIDERS_MOST = 256 };

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    double *stiffness = NULL, *limit = NULL;
    size_t springs = 0, sliders = 0;
    int count = 0;
    char where[128];
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_get_numbers(e->json, e->path, "stiffnesses", 0, HUGE_VAL, &stiffness, &springs, err);
    if (rc == MODAL_OK)
        rc = json_get_numbers(e->json, e->path, "limits", 0, HUGE_VAL, &limit, &sliders, err);
    json_path(where, e->path, springs < 1 || springs > SLIDERS_MOST ? "stiffnesses" : "limits");
    if (rc == MODAL_OK && (springs < 1 || springs > SLIDERS_MOST || springs != sliders))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: stiffnesses and limits must be 1 to %d numbers, as many of each", e->path, SLIDERS_MOST);
    for (size_t i = 0; rc == MODAL_OK && i < springs; i++)
        if (stiffness[i] > 0 && limit[i] > 0) {
            stiffness[count] = stiffness[i];
            limit[count++] = limit[i];
        }
    if (rc == MODAL_OK && count > 0)
        rc = local_law_add(l, e, law_iwan(stiffness, limit, count, &law, err), at, &law, err);
    free(stiffness);
    free(limit);
    return rc;
}

static const char *const keys[] = { "dof", "to", "stiffnesses", "limits", NULL };
const struct scene_effect_kind effect_iwan = { "iwan", keys, NULL, lower };
