/* local_law.c - see local_law.h */
#include "modal/scene/effects/local_law.h"
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
