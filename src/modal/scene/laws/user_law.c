/*
 * user_law.c - a user's own force, in Lua, in a sandbox
 *
 *     function force(t, x, v, memory) return ... end
 *
 * x and v are d and its rate; the number returned resists like any law's.  `memory` is a table,
 * empty at the start of a period, that lives over it.  Each law has a Lua state of its own, so
 * elements share no globals.  Of the libraries only math is open, without random; of the base, what
 * cannot load code or reach outside (see base_kept).
 *
 * Limits: INSTRUCTIONS a call (a hook counts), LAW_LUA_MOST bytes a state and LAW_LUA_TOGETHER_MOST
 * all states of a program, STRING_MOST a string (the allocator counts all three); passing one is a
 * failure like any other, named with its line or with the limit.  What one instruction may make Lua
 * do without end is counted as the instructions it is worth: `next` passes empty entries, at most
 * those of the largest table there was, and a table that is given a key when it has no room looks
 * at all of its own and asks for its parts anew.  Derivatives are central differences, with h =
 * cbrt(eps) max(|d|, scale / 10), scale the largest |d| (|v|) of this period and the one before:
 * error of order h^2, about 1e-10 of the force, at a period's first instant, too.  A difference
 * must not be remembered, so `memory` is copied before it and put back; as long as nothing is in
 * it there is nothing to copy.
 */
#include <float.h>
#include <lauxlib.h>
#include <lua.h>
#include <lualib.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/law.h"

enum {
    INSTRUCTIONS = 1000000,    /* some 10 ms: a law is asked thousands of times a period */
    HOOK_STEP = 10000,         /* between two counts: a hundredth of that, and no cost */
    STRING_MOST = 256,         /* bytes: to compare two is one instruction, of 9 ns a byte where
                                  they are zeros */
    WALK_BYTES = 128,          /* of a table that are passed in the time of an instruction: eight
                                  entries of 16, by measurement 1 ns and 5 to 10 */
    COPY_WORK = 10,            /* instructions: of an entry that is copied, 50 ns */
    MEMORY_DEPTH = 8,          /* copied by calls that call themselves, on a C stack */
};

/* Of a step that led out, the next: a prefix of the units that laws are written in. */
static const double NEARER = 1e-3;

struct lua_law {
    lua_State *L;  /* its own: elements share nothing */
    size_t used, *together;  /* bytes of this one; of all of a program */
    size_t largest;               /* bytes that a part of a table had at most */
    bool unlimited;               /* outside a protected call, where a refusal would end the
                                     process: a table without entries */
    enum { NO_LIMIT, OF_ONE, OF_ALL, OF_STRING, OF_WORK } passed;  /* by what was refused last */
    long left;                    /* instructions of this call */
    double scale_d, scale_v;      /* the largest of this period: see the opening */
    double before_d, before_v;    /* of the one before */
    double reach_d, reach_v;      /* the largest of a period all of whose forces were finite */
    bool infinite;                /* in this period one was not, */
    bool beyond;                  /* and the last was none, past those */
    bool kept;                    /* `memory` has had an entry in this period */
};

/* What forbids S a block of KIND that has SIZE bytes, MORE than now. */
static int limit_passed(const struct lua_law *s, size_t kind, size_t size, size_t more)
{
    if (kind == LUA_TSTRING && size > STRING_MOST)
        return OF_STRING;
    if (kind == 0 && s->left < 0)
        return OF_WORK;
    if (s->used + more > LAW_LUA_MOST)
        return OF_ONE;
    return *s->together + more > LAW_LUA_TOGETHER_MOST ? OF_ALL : NO_LIMIT;
}

/* lua_Alloc that counts: NULL past a limit, which Lua makes an error of. */
static void *allocate(void *context, void *block, size_t old, size_t size)
{
    struct lua_law *s = context;
    size_t kind = block == NULL ? old : 0;  /* of a new block Lua passes it in `old`; 0: a part */
    void *moved;

    old = block == NULL ? 0 : old;
    s->left -= (long)((old > size ? old : size) / WALK_BYTES);
    if (size == 0) {
        free(block);
        s->used -= old;
        *s->together -= old;
        return NULL;
    }
    if (size > old && !s->unlimited) {
        int passed = limit_passed(s, kind, size, size - old);
        if (passed != NO_LIMIT) {
            s->passed = passed;
            return NULL;
        }
    }
    moved = realloc(block, size);
    if (moved == NULL) {
        s->passed = NO_LIMIT;  /* the machine itself has no more */
        return NULL;
    }
    s->used += size - old;
    *s->together += size - old;
    if (kind == 0 && size > s->largest)
        s->largest = size;
    return moved;
}

static struct lua_law *law_of(lua_State *L)
{
    void *s;

    lua_getallocf(L, &s);  /* the one thing that a state carries along */
    return s;
}

#define TOO_MANY "more than %d instructions in one call"

/* Past the most INSTRUCTIONS of a call it raises an error in Lua. */
static void spend(lua_State *L, long instructions)
{
    struct lua_law *s = law_of(L);

    s->left -= instructions;
    if (s->left < 0)
        luaL_error(L, TOO_MANY, INSTRUCTIONS);
}

/* Places in Lua's registry: the address is the key, which no string has to be compared with. */
static const char force_key, memory_key, before_key;

static void count_instructions(lua_State *L, lua_Debug *at)
{
    (void)at;
    spend(L, HOOK_STEP);
}

static const char *const base_kept[] = { "assert",   "error",    "ipairs", "math",   "select",
                                         "tonumber", "type",     "rawequal", "rawget", "rawset",
                                         "rawlen",   "_VERSION", NULL };

/* The base's, but a walk over a table is paid for where it begins.  Who goes on from the key that
 * was given last, as `pairs` does, passes each entry once; the table and that key are upvalues. */
static int next_counted(lua_State *L)
{
    bool more;

    luaL_checktype(L, 1, LUA_TTABLE);
    lua_settop(L, 2);
    if (lua_isnil(L, 2) || !lua_rawequal(L, 1, lua_upvalueindex(1))
        || !lua_rawequal(L, 2, lua_upvalueindex(2)))
        spend(L, (long)(law_of(L)->largest / WALK_BYTES));
    lua_pushvalue(L, 1);
    lua_replace(L, lua_upvalueindex(1));
    more = lua_next(L, 1) != 0;
    if (!more)
        lua_pushnil(L);
    lua_pushvalue(L, more ? -2 : -1);
    lua_replace(L, lua_upvalueindex(2));
    return more ? 2 : 1;
}

static int pairs_counted(lua_State *L)
{
    luaL_checkany(L, 1);
    lua_pushvalue(L, lua_upvalueindex(1));
    lua_pushvalue(L, 1);
    lua_pushnil(L);
    return 3;
}

/* The base's tells where in memory a table or a function lies: nothing a force may depend on, and
 * nobody's to know. */
static int print_value(lua_State *L)
{
    luaL_checkany(L, 1);
    if (lua_istable(L, 1) || lua_isfunction(L, 1))
        lua_pushstring(L, luaL_typename(L, 1));
    else
        luaL_tolstring(L, 1, NULL);
    return 1;
}

/* Open the base and math, then keep only what base_kept names. */
static int open_sandbox(lua_State *L)
{
    luaL_requiref(L, "_G", luaopen_base, 1);
    luaL_requiref(L, "math", luaopen_math, 1);
    lua_pushnil(L);
    lua_setfield(L, -2, "random");
    lua_pushnil(L);
    lua_setfield(L, -2, "randomseed");  /* a force must be a function of its arguments */
    lua_settop(L, 0);
    lua_newtable(L);
    for (int i = 0; base_kept[i] != NULL; i++) {
        lua_getglobal(L, base_kept[i]);
        lua_setfield(L, 1, base_kept[i]);
    }
    lua_pushcfunction(L, print_value);
    lua_setfield(L, 1, "tostring");
    lua_pushnil(L);
    lua_pushnil(L);
    lua_pushcclosure(L, next_counted, 2);
    lua_pushvalue(L, -1);
    lua_setfield(L, 1, "next");
    lua_pushcclosure(L, pairs_counted, 1);
    lua_setfield(L, 1, "pairs");
    lua_pushvalue(L, 1);
    lua_setfield(L, 1, "_G");
    lua_rawseti(L, LUA_REGISTRYINDEX, LUA_RIDX_GLOBALS);  /* the sandbox is all there is */
    return 0;
}

/* Run the chunk under the sandbox's globals; leaves nothing. */
static int load_source(lua_State *L)
{
    const char *source = lua_touserdata(L, 1);

    open_sandbox(L);
    /* text alone: bytecode can break the interpreter */
    if (luaL_loadbufferx(L, source, strlen(source), "=source", "t") != LUA_OK)
        return lua_error(L);
    lua_call(L, 0, 0);
    if (lua_getglobal(L, "force") != LUA_TFUNCTION)
        return luaL_error(L, "the source defines no function `force`");
    lua_rawsetp(L, LUA_REGISTRYINDEX, &force_key);  /* out of the source's reach */
    lua_newtable(L);
    lua_rawsetp(L, LUA_REGISTRYINDEX, &memory_key);
    return 0;
}

/* Whether `memory` has anything, or is no table, which is something; leaves the stack alone. */
static bool any_memory(lua_State *L)
{
    int top = lua_gettop(L);
    bool any;

    spend(L, (long)(law_of(L)->largest / WALK_BYTES));  /* entries that are empty now */
    lua_rawgetp(L, LUA_REGISTRYINDEX, &memory_key);
    lua_pushnil(L);
    any = !lua_istable(L, -2) || lua_next(L, -2) != 0;
    lua_settop(L, top);
    return any;
}

static int call_force(lua_State *L)                /* t, x, v -> number */
{
    struct lua_law *s = law_of(L);

    lua_rawgetp(L, LUA_REGISTRYINDEX, &force_key);
    lua_insert(L, 1);
    lua_rawgetp(L, LUA_REGISTRYINDEX, &memory_key);
    lua_call(L, 4, 1);
    s->kept = s->kept || any_memory(L);
    if (!lua_isnumber(L, -1) || lua_type(L, -1) != LUA_TNUMBER)
        return luaL_error(L, "force returned %s, not a number", luaL_typename(L, -1));
    return 1;
}

/* Pushes the copy of the table at FROM; those of SEEN, copies by tables, are there already. */
static void copy_table(lua_State *L, int seen, int from, int depth)
{
    luaL_checkstack(L, 8, "memory is nested too deep");
    if (depth > MEMORY_DEPTH)
        luaL_error(L, "memory is nested deeper than %d tables", MEMORY_DEPTH);
    lua_pushvalue(L, from);
    if (lua_rawget(L, seen) == LUA_TTABLE)
        return;
    lua_pop(L, 1);
    lua_newtable(L);
    lua_pushvalue(L, from);
    lua_pushvalue(L, -2);
    lua_rawset(L, seen);
    for (lua_pushnil(L); lua_next(L, from) != 0; lua_pop(L, 1)) {
        spend(L, COPY_WORK);
        lua_pushvalue(L, -2);
        if (lua_istable(L, -2))
            copy_table(L, seen, lua_gettop(L) - 1, depth + 1);
        else
            lua_pushvalue(L, -2);
        lua_rawset(L, -5);
    }
}

static int memory_copy(lua_State *L)               /* key from, key to: in the registry */
{
    spend(L, (long)(law_of(L)->used / WALK_BYTES));   /* each table that there is, once */
    lua_newtable(L);
    lua_rawgetp(L, LUA_REGISTRYINDEX, lua_touserdata(L, 1));
    if (!lua_istable(L, -1))
        lua_newtable(L);
    copy_table(L, 3, lua_gettop(L), 0);
    lua_rawsetp(L, LUA_REGISTRYINDEX, lua_touserdata(L, 2));
    return 0;
}

/* As at the start of a period. */
static void empty_memory(struct lua_law *s)
{
    s->unlimited = true;  /* an empty table: see the struct */
    lua_settop(s->L, 0);
    lua_newtable(s->L);
    lua_rawsetp(s->L, LUA_REGISTRYINDEX, &memory_key);
    s->unlimited = false;
    s->kept = false;
}

/* Which limit on memory was met. */
static enum modal_status past_limit(const struct lua_law *s, struct modal_error *err)
{
    if (s->passed == NO_LIMIT)
        return modal_fail_field(err, MODAL_NO_MEMORY, "source", "lua: no memory");
    if (s->passed == OF_ONE)
        return modal_fail_field(err, MODAL_ELEMENT_FAILED, "source", "lua: not enough memory: an "
                                "element has at most %d bytes", LAW_LUA_MOST);
    if (s->passed == OF_WORK)
        return modal_fail_field(err, MODAL_ELEMENT_FAILED, "source", "lua: " TOO_MANY,
                                INSTRUCTIONS);
    if (s->passed == OF_STRING)
        return modal_fail_field(err, MODAL_ELEMENT_FAILED, "source", "lua: a string is longer than "
                                "some %d bytes", STRING_MOST);
    return modal_fail_field(err, MODAL_ELEMENT_FAILED, "source", "lua: not enough memory: all "
                            "elements of a scene have at most %d bytes together",
                            LAW_LUA_TOGETHER_MOST);
}

/* What Lua said when it ended with HOW: the STATUS of an error, or a limit of memory. */
static enum modal_status failed(struct lua_law *s, int how, enum modal_status status,
                                struct modal_error *err)
{
    const char *text = lua_tostring(s->L, -1);
    enum modal_status rc = how == LUA_ERRMEM
                               ? past_limit(s, err)
                               : modal_fail_field(err, status, "source", "lua: %.400s",
                                                  text ? text : "failed without a message");

    lua_settop(s->L, 0);
    return rc;
}

/* Under lua_pcall, since copying allocates. */
static enum modal_status copy_memory(struct lua_law *s, const char *from, const char *to,
                                     struct modal_error *err)
{
    int how;

    s->left = INSTRUCTIONS;  /* a budget a call */
    lua_pushcfunction(s->L, memory_copy);
    lua_pushlightuserdata(s->L, (void *)(size_t)from);
    lua_pushlightuserdata(s->L, (void *)(size_t)to);
    how = lua_pcall(s->L, 2, 0, 0);
    return how == LUA_OK ? MODAL_OK : failed(s, how, MODAL_ELEMENT_FAILED, err);
}

/* One call of `force`, which gives a number; the caller looks whether it is finite. */
static enum modal_status call(struct lua_law *s, double t, double d, double v, double *f,
                              struct modal_error *err)
{
    int how;

    s->left = INSTRUCTIONS;
    lua_settop(s->L, 0);
    lua_pushcfunction(s->L, call_force);
    lua_pushnumber(s->L, t);
    lua_pushnumber(s->L, d);
    lua_pushnumber(s->L, v);
    how = lua_pcall(s->L, 3, 1, 0);
    if (how != LUA_OK)
        return failed(s, how, MODAL_ELEMENT_FAILED, err);
    *f = lua_tonumber(s->L, -1);
    lua_settop(s->L, 0);
    return MODAL_OK;
}

/* A force that is no number fails.  A motion is beyond what the law has if a smaller one, of a
 * whole period, was within; where there was none but rest, the law itself is wrong.  WHERE: what
 * the message says of the place. */
static enum modal_status look_at(struct lua_law *s, const struct law_point *at, double f,
                                 const char *where, struct modal_error *err)
{
    double d = at->d[0], v = at->v[0];

    if (isfinite(f))
        return MODAL_OK;
    s->infinite = true;
    s->beyond = (s->reach_d > 0 || s->reach_v > 0)
                && (fabs(d) > s->reach_d || fabs(v) > s->reach_v);
    return modal_fail_field(err, MODAL_ELEMENT_FAILED, "source",
                            "lua: force(%.9g, %.9g, %.9g, memory) is not finite%s", at->t, d, v,
                            where);
}

/* `memory` as it was before this call: empty, or a copy of what was put aside. */
static enum modal_status put_back(struct lua_law *s, bool kept, struct modal_error *err)
{
    if (kept)
        return copy_memory(s, &before_key, &memory_key, err);
    if (s->kept)
        empty_memory(s);
    return MODAL_OK;
}

/* The quotient of differences of H on either side of d (or v), each from the memory as it was:
 * KEPT, whether it was any.  Not finite where a force is not. */
static enum modal_status difference(struct lua_law *s, const struct law_point *at, bool over_v,
                                    bool kept, double h, double *out, struct modal_error *err)
{
    /* as rounded: the quotient divides by their difference */
    double x = over_v ? at->v[0] : at->d[0], moved[2] = { x + h, x - h }, f[2];

    for (int i = 0; i < 2; i++) {
        enum modal_status rc = call(s, at->t, over_v ? at->d[0] : moved[i],
                                    over_v ? moved[i] : at->v[0], &f[i], err);

        if (rc == MODAL_OK)
            rc = put_back(s, kept, err);
        if (rc != MODAL_OK)
            return rc;
    }
    *out = (f[0] - f[1]) / (moved[0] - moved[1]);
    return MODAL_OK;
}

/* df/dd (or df/dv).  At rest nothing tells how large a motion is: where a step as for 1 m leads out
 * of what the law has, a smaller one may not. */
static enum modal_status slope(struct lua_law *s, const struct law_point *at, bool over_v,
                               bool kept, double *out, struct modal_error *err)
{
    double x = over_v ? at->v[0] : at->d[0],
           scale = over_v ? fmax(s->scale_v, s->before_v) : fmax(s->scale_d, s->before_d);
    /* truncation h^2 and rounding eps/h are alike */
    double h = cbrt(DBL_EPSILON) * (scale > 0 ? fmax(fabs(x), 0.1 * scale) : 1);
    enum modal_status rc = difference(s, at, over_v, kept, h, out, err);

    while (rc == MODAL_OK && !isfinite(*out) && scale == 0 && (h *= NEARER) >= DBL_MIN)
        rc = difference(s, at, over_v, kept, h, out, err);
    if (rc == MODAL_OK && !isfinite(*out))
        rc = look_at(s, at, *out, " close by", err);
    return rc;
}

/* The force's derivatives by central differences; the memory is as before. */
static enum modal_status slopes(struct lua_law *s, const struct law_point *at,
                                struct law_force *out, struct modal_error *err)
{
    bool kept = s->kept;
    enum modal_status rc = kept ? copy_memory(s, &memory_key, &before_key, err) : MODAL_OK;

    if (rc == MODAL_OK)
        rc = slope(s, at, false, kept, &out->fd[0][0], err);
    if (rc == MODAL_OK)
        rc = slope(s, at, true, kept, &out->fv[0][0], err);
    return rc;
}

/* The scene's place of a force that failed. */
static enum modal_status name_effect(const struct law *law, enum modal_status rc,
                                     struct modal_error *err)
{
    if (err != NULL && law->effect >= 0)
        snprintf(err->field, sizeof err->field, "effects[%d].source", law->effect);
    return rc;
}

/* The force and, where they are wanted, its derivatives before it. */
static enum modal_status lua_force(const struct law *law, const struct law_point *at,
                                   struct law_force *out, struct modal_error *err)
{
    struct lua_law *s = law->data;
    enum modal_status rc = MODAL_OK;

    s->beyond = false;
    s->scale_d = fmax(s->scale_d, fabs(at->d[0]));
    s->scale_v = fmax(s->scale_v, fabs(at->v[0]));
    if (!out->alone)
        rc = slopes(s, at, out, err);
    if (rc == MODAL_OK)
        rc = call(s, at->t, at->d[0], at->v[0], &out->f[0], err);
    if (rc == MODAL_OK)
        rc = look_at(s, at, out->f[0], "", err);
    out->acts = true;
    out->regime = 0;
    out->beyond = s->beyond;
    return rc == MODAL_ELEMENT_FAILED ? name_effect(law, rc, err) : rc;
}

/* A new period: memory is empty again. */
static void lua_restart(const struct law *law)
{
    struct lua_law *s = law->data;

    empty_memory(s);
    if (!s->infinite) {
        s->reach_d = fmax(s->reach_d, s->scale_d);
        s->reach_v = fmax(s->reach_v, s->scale_v);
    }
    s->infinite = false;
    s->before_d = s->scale_d;
    s->before_v = s->scale_v;
    s->scale_d = s->scale_v = 0;
}

/* Whether the source has put anything into `memory`. */
static bool lua_remembers(const struct law *law)
{
    const struct lua_law *s = law->data;

    return s->kept;
}

/* law_class.free: closes the interpreter, which returns its bytes to the count. */
static void lua_free(struct law *law)
{
    struct lua_law *s = law->data;

    if (s != NULL && s->L != NULL)
        lua_close(s->L);  /* its bytes go back to the count */
    free(s);
}

static const struct law_class lua_class = { .name = "lua",
                                            .inputs = 1,
                                            .reads_velocity = true,
                                            .reads_time = true,
                                            .force = lua_force,
                                            .restart = lua_restart,
                                            .remembers = lua_remembers,
                                            .free = lua_free };

enum modal_status law_lua(const char *source, size_t *together, struct law *out,
                          struct modal_error *err)
{
    struct lua_law *s;
    enum modal_status rc;
    int how;

    if (strlen(source) > LAW_SOURCE_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "source", "lua: %zu bytes; the most is %d",
                                strlen(source), LAW_SOURCE_MOST);
    s = calloc(1, sizeof *s);
    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "lua: no memory for a state");
    s->together = together;
    s->left = INSTRUCTIONS;
    s->L = lua_newstate(allocate, s);
    if (s->L == NULL) {
        rc = past_limit(s, err);
        free(s);
        return rc;
    }
    lua_sethook(s->L, count_instructions, LUA_MASKCOUNT, HOOK_STEP);
    lua_pushcfunction(s->L, load_source);
    lua_pushlightuserdata(s->L, (void *)(size_t)source);
    how = lua_pcall(s->L, 1, 0, 0);
    if (how != LUA_OK) {
        rc = failed(s, how, MODAL_BAD_INPUT, err);
        lua_close(s->L);
        free(s);
        return rc;
    }
    law_clear(out, &lua_class);
    out->data = s;
    return MODAL_OK;
}
