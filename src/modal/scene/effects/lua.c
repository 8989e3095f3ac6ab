/* lua.c - a user's force(t, x, v, memory) in Lua: `source`, its sign that of the other effects */
#include <math.h>
#include <string.h>
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    const char *source = NULL;
    char where[128];
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_need_string(e->json, e->path, "source", &source, err);
    json_path(where, e->path, "source");
    if (rc == MODAL_OK && strlen(source) > LAW_SOURCE_MOST)
        rc = modal_fail_field(err, MODAL_TOO_LARGE, where, "%s has %zu bytes; at most %d", where, strlen(source), LAW_SOURCE_MOST);
    if (rc != MODAL_OK)
        return rc;
    return local_law_add(l, e, law_lua(source, &l->p->lua_bytes, &law, err), at, &law, err);
}

static const char *const keys[] = { "dof", "to", "source", NULL };
const struct scene_effect_kind effect_lua = { "lua", keys, NULL, lower };
