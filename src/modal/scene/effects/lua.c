/* lua.c - a user's force(t, x, v, memory) in Lua: `source`, its sign that of the other effects
 *
 * The force may read the time and keep a memory, so such a scene is stepped in order and asked
 * once a step; laws/user_law.c has the sandbox and its limits.
 */
#include <string.h>
#include "modal/scene/effects/local_law.h"

struct lua { struct local_ends at; const char *source; };

static const struct scene_key keys[] = {
    { "source", SCENE_TEXT, offsetof(struct lua, source), .needed = true,
      .means = "Lua that defines force(t, x, v, memory), x = d in m, v = d' in m/s, giving N",
      .example = "\"function force(t, x, v, memory) return 3 * x end\"" },
    { 0 },
};

/* Compiled here, so that a source that does not compile is told before anything runs. */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct lua *s = e->values;
    struct law law;
    char where[128];

    json_path(where, e->path, "source");
    if (strlen(s->source) > LAW_SOURCE_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, where, "%s has %zu bytes; at most %d", where,
                                strlen(s->source), LAW_SOURCE_MOST);
    return local_law_add(l, e, law_lua(s->source, &l->p->lua_bytes, &law, err), s->at.along, &law,
                         err);
}

const struct scene_effect_kind effect_lua = {
    .name = "lua", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct lua),
    .law = "minus force(t, d, d', memory) on dof", .lower = lower,
};
