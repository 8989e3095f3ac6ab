/* local_law.c - see local_law.h */
#include "modal/scene/effects/local_law.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum modal_status local_law_add(struct lowering *l, const struct scene_effect *e, enum modal_status rc, struct local_ends at,
                                struct law *law, struct modal_error *err)
{
    if (rc != MODAL_OK) {
        if (err != NULL && strncmp(err->field, e->path, strlen(e->path)) != 0) {
            char path[128];
            json_path(path, e->path, err->field);
            strcpy(err->field, path);
        }
        return rc;
    }
    law->dof[0] = at.dof;
    law->to[0] = at.to;
    lowering_add_law(l, law);
    return MODAL_OK;
}

enum modal_status local_law_polynomial(struct lowering *l, const struct scene_effect *e, int matrix,
                                       enum modal_status (*make)(const double *, int, struct law *, struct modal_error *), struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    double *c = NULL;
    size_t count = 0;
    char where[128];
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_get_numbers(e->json, e->path, "coefficients", -HUGE_VAL, HUGE_VAL, &c, &count, err);
    json_path(where, e->path, "coefficients");
    if (rc == MODAL_OK && (count < 1 || count > LAW_TERMS_MOST))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s must list 1 to %d numbers", where, LAW_TERMS_MOST);
    while (count > 1 && c[count - 1] == 0)
        count--;
    if (rc == MODAL_OK && count == 1)
        lowering_between(l, matrix, at, c[0]);
    if (rc == MODAL_OK && count > 1)
        rc = local_law_add(l, e, make(c, (int)count, &law, err), at, &law, err);
    free(c);
    return rc;
}
