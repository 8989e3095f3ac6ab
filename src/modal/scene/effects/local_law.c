/* local_law.c - see local_law.h
 *
 * A local law is of one input, d along its ends; what its constructor refuses is told at the
 * effect's path, since the constructor knows only its own numbers.
 */
#include "modal/scene/effects/local_law.h"
#include <string.h>

enum modal_status local_law_add(struct lowering *l, const struct scene_effect *e,
                                enum modal_status rc, struct scene_ends at, struct law *law,
                                struct modal_error *err)
{
    if (rc != MODAL_OK) {
        if (err != NULL && strncmp(err->field, e->path, strlen(e->path)) != 0) {
            char path[128];
            /* a constructor knows its number, not the scene */
            json_path(path, e->path, err->field);
            strcpy(err->field, path);
        }
        return rc;
    }
    lowering_place(l, law, 0, at);
    lowering_add_law(l, law);
    return MODAL_OK;
}

enum modal_status local_law_polynomial(struct lowering *l, const struct scene_effect *e, int matrix,
                                       enum modal_status (*make)(const double *, int, struct law *,
                                                                 struct modal_error *),
                                       struct modal_error *err)
{
    const struct local_polynomial *s = e->values;
    const double *c = s->coefficients.x;
    size_t count = s->coefficients.count;
    struct law law;
    char where[128];

    json_path(where, e->path, "coefficients");
    if (count < 1 || count > LAW_TERMS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s must list 1 to %d numbers", where,
                                LAW_TERMS_MOST);
    while (count > 1 && c[count - 1] == 0)
        count--;  /* trailing zeros are no terms */
    if (count > 1)
        return local_law_add(l, e, make(c, (int)count, &law, err), s->at.along, &law, err);
    lowering_along(l, matrix, s->at.along, c[0]);
    return MODAL_OK;
}
