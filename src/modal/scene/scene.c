/*
 * scene.c - see scene.h
 *
 * One pass in a fixed order: the structure, the effects as listed, excitation, initial state,
 * sensors; then the entries become matrices and the program is checked as a whole, by
 * lowering_finish().
 *
 * A part of the scene is read by its rows (scene_key.h) into a struct of values, then lowered:
 * reading knows nothing of matrices, lowering nothing of JSON, but for forms of their own.
 */
#include "modal/scene/scene.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"
#include "modal/scene/loads.h"
#include "modal/scene/lowering.h"

enum { TYPES_MOST = 64 };            /* of structures, of effects: twice what there is */

/* Of duration / dt: both decimals are off their doubles by DBL_EPSILON / 2, their quotient by as
 * many; a thousandfold of it is still far below half a step of the longest record. */
static const double QUOTIENT_ROUNDING = 1e-12;
/* steps: of a record of few samples, written with few digits */
static const double STEP_ROUNDING = 1e-9;

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
}

/* SIZE zeroed bytes for what a part's keys are read into; scene_keys_free and free release them. */
static void *values_new(size_t size)
{
    return calloc(1, size > 0 ? size : 1);
}

/* NULL: no such structure. */
static const struct scene_structure_kind *find_structure(const char *name)
{
    for (int i = 0; scene_structures[i] != NULL; i++)
        if (strcmp(scene_structures[i]->name, name) == 0)
            return scene_structures[i];
    return NULL;
}

/* First of all: dofs must have names before an effect, a load or a sensor can say where it
 * acts. */
static enum modal_status lower_structure(struct lowering *l, const cJSON *json,
                                         struct modal_error *err)
{
    const char *type = NULL, *names[TYPES_MOST + 1];  /* borrowed from the scene, from tables */
    char list[NEAR_ACCEPTED];
    void *values;
    enum modal_status rc;

    if (!cJSON_IsObject(json))  /* the row of `structure` has seen that it is there */
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure",
                                "a scene needs an object \"structure\"");
    if ((rc = json_need_string(json, "structure", "type", &type, err)) != MODAL_OK)
        return rc;
    /* all that there are are named: they are few */
    if ((l->structure = find_structure(type)) == NULL) {
        int count = 0;
        for (; scene_structures[count] != NULL && count < TYPES_MOST; count++)
            names[count] = scene_structures[count]->name;
        names[count] = NULL;
        near_accepted(type, names, list);
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.type",
                                "unknown structure \"%.40s\"%s", type, list);
    }
    if ((values = values_new(l->structure->size)) == NULL)
        return no_memory(err);
    /* no dof has a name yet */
    rc = scene_keys_read(NULL, json, "structure", l->structure->keys, values, err);
    if (rc == MODAL_OK)
        rc = l->structure->lower(l, values, err);
    if (rc == MODAL_OK)
        rc = program_order_names(l->p, err);
    scene_keys_free(l->structure->keys, values);  /* what it kept of them it has copied */
    free(values);
    for (int i = 0; i < 3; i++)
        l->structural[i] = l->constant[i].count;  /* damping of the structure reads up to here */
    return rc;
}

/* Whether KIND's effect means something on STRUCTURE. */
static bool takes(const struct scene_effect_kind *kind, const char *structure)
{
    for (int i = 0; kind->structures != NULL && kind->structures[i] != NULL; i++)
        if (strcmp(kind->structures[i], structure) == 0)
            return true;
    return kind->structures == NULL;
}

/* The row of TABLE called TYPE, if the structure takes it. */
static enum modal_status find_effect(const struct lowering *l,
                                     const struct scene_effect_kind *const *table, const char *type,
                                     const char *path, const struct scene_effect_kind **kind,
                                     struct modal_error *err)
{
    const char *names[TYPES_MOST + 1];
    char where[128], list[NEAR_ACCEPTED];
    bool known = false;
    int count = 0;

    for (int i = 0; table[i] != NULL && count < TYPES_MOST; i++) {
        bool same = strcmp(table[i]->name, type) == 0;
        known = known || same;  /* of another structure: the message says so */
        if (!takes(table[i], l->structure->name))
            continue;
        if (same) {
            *kind = table[i];
            return MODAL_OK;
        }
        names[count++] = table[i]->name;
    }
    names[count] = NULL;
    near_accepted(type, names, list);
    json_path(where, path, "type");
    return modal_fail_field(err, MODAL_BAD_INPUT, where,
                            known ? "a %2$s takes no \"%1$.40s\"%3$s"
                                  : "unknown effect \"%1$.40s\" for a %2$s%3$s",
                            type, l->structure->name, list);
}

/* Everything that an effect can have written, counted. */
static int written(const struct lowering *l)
{
    int count = l->p->laws + l->p->n_linear;  /* states of effects */

    for (int i = 0; i < 3; i++)
        count += l->constant[i].count;
    for (int h = 0; h < l->harmonics; h++)
        for (int i = 0; i < 3; i++)
            count += l->harmonic[h].cosine[i].count + l->harmonic[h].sine[i].count;
    for (int i = 0; i < LOWER_BLOCKS; i++)
        count += l->block[i].count;
    return count;
}

/* `dof` and `to` of a local effect, with which its values begin, are two places, and exclude a
 * `direction`; they become its ends. */
static enum modal_status make_ends(const struct scene_effect_kind *kind,
                                   const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends *at = e->values;  /* where the first table says so */
    bool both = json_member(e->json, "dof") != NULL || json_member(e->json, "to") != NULL;
    char where[128];

    if (kind->keys[0] != lowering_ends_keys)  /* the others have no two ends */
        return MODAL_OK;
    json_path(where, e->path, at->along.count > 0 ? "direction" : at->dof < 0 ? "dof" : "to");
    if (at->along.count > 0)
        return both ? modal_fail_field(err, MODAL_BAD_INPUT, where,
                                       "%s stands beside `dof` or `to`; accepted: one of both",
                                       where)
                    : MODAL_OK;
    if (at->dof == at->to)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s: `dof` and `to` are one place; they must differ", e->path);
    if ((at->along.x = malloc(2 * sizeof *at->along.x)) == NULL)
        return no_memory(err);
    if (at->dof >= 0)
        at->along.x[at->along.count++] = (struct law_end) { at->dof, 1 };
    if (at->to >= 0)
        at->along.x[at->along.count++] = (struct law_end) { at->to, -1 };
    return MODAL_OK;
}

/* E, of KIND, read and lowered. */
static enum modal_status lower_kind(struct lowering *l, const struct scene_effect_kind *kind,
                                    struct scene_effect *e, struct modal_error *err)
{
    enum modal_status rc;

    if ((e->values = values_new(kind->size)) == NULL)
        return no_memory(err);
    rc = scene_keys_read(l, e->json, e->path, kind->keys, e->values, err);
    if (rc == MODAL_OK)
        rc = make_ends(kind, e, err);
    if (rc == MODAL_OK)
        rc = kind->lower(l, e, err);
    scene_keys_free(kind->keys, e->values);
    free(e->values);
    return rc;
}

/* One entry of the scene's effects, at POSITION, into the program's next row. */
static enum modal_status lower_effect(struct lowering *l,
                                      const struct scene_effect_kind *const *table,
                                      const cJSON *json, int position, struct modal_error *err)
{
    char path[32];  /* "effects[4095]" */
    struct program_effect *row = &l->p->effect[l->p->effects];
    const struct scene_effect_kind *kind = NULL;
    const char *type = NULL;
    int before = written(l), laws = l->p->laws;  /* an effect that writes nothing is not active */
    enum modal_status rc;

    snprintf(path, sizeof path, "effects[%d]", position);
    if (!cJSON_IsObject(json))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be an object", path);
    if ((rc = json_need_string(json, path, "type", &type, err)) != MODAL_OK)
        return rc;
    if ((rc = find_effect(l, table, type, path, &kind, err)) != MODAL_OK)
        return rc;
    if ((row->type = strdup(type)) == NULL)
        return no_memory(err);
    l->effect = l->p->effects++;  /* what is added from here on is this row's */
    rc = lower_kind(l, kind, &(struct scene_effect) { json, path, l->effect, NULL }, err);
    if (rc == MODAL_OK && (l->p->laws > laws || row->carrier > 0)
        && (row->law_text = json_print(json)) == NULL)
        rc = no_memory(err);
    /* laws say so themselves, when they act */
    row->active = written(l) > before && l->p->laws == laws;
    l->effect = -1;  /* the structure's again */
    return rc;
}

/* In the scene's order; those left out by ablation have no row. */
static enum modal_status lower_effects(struct lowering *l, const cJSON *list,
                                       const struct scene_options *options, struct modal_error *err)
{
    const cJSON *item;
    const struct scene_effect_kind *const *table =
        options != NULL && options->effects != NULL ? options->effects : scene_effects;
    int position = 0, count;
    enum modal_status rc = MODAL_OK;

    if (list != NULL && !cJSON_IsArray(list))
        return modal_fail_field(err, MODAL_BAD_INPUT, "effects", "effects must be a list");
    count = list != NULL ? cJSON_GetArraySize(list) : 0;
    if (count > SCENE_EFFECTS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "effects",
                                "a scene lists %d effects; at most %d", count, SCENE_EFFECTS_MOST);
    if ((l->p->effect = calloc((size_t)count + 1, sizeof *l->p->effect)) == NULL)
        return no_memory(err);
    cJSON_ArrayForEach(item, list) {
        if (rc == MODAL_OK && !(options != NULL && options->without[position]))
            rc = lower_effect(l, table, item, position, err);
        position++;  /* of the scene: rows close up over those left out */
    }
    if (rc == MODAL_OK && l->structure->finish != NULL)
        rc = l->structure->finish(l, err);
    return rc;
}

struct initial { const cJSON *x, *v; };

static const struct scene_key initial_keys[] = {
    { "x", SCENE_OWN, offsetof(struct initial, x), "m", .otherwise = "all 0",
      .means = "displacements at t = 0, by dof name", .example = "{\"x1\": 0.1}" },
    { "v", SCENE_OWN, offsetof(struct initial, v), "m/s", .otherwise = "all 0",
      .means = "velocities at t = 0, by dof name", .example = "{\"x1\": -1}" },
    { 0 },
};

/* LIST, the member KEY of `initial`, into X. */
static enum modal_status read_state(const struct program *p, const cJSON *list, const char *key,
                                    double *x, struct modal_error *err)
{
    const cJSON *item;
    char path[128], base[32], meant[NEAR_TEXT];

    snprintf(base, sizeof base, "initial.%s", key);
    if (list != NULL && !cJSON_IsObject(list))
        return modal_fail_field(err, MODAL_BAD_INPUT, base,
                                "%s must be an object: numbers by dof name", base);
    cJSON_ArrayForEach(item, list) {
        int dof = program_dof(p, item->string);  /* the ground has no state either */
        json_path(path, base, item->string);
        if (dof < 0) {
            near_given(item->string, (const char *const *)p->dofs, (size_t)p->n, meant);
            return modal_fail_field(
                err, MODAL_BAD_INPUT, path,
                "no dof \"%.40s\" in this structure%s; its dofs run from %s to %s", item->string,
                meant, p->dofs[0], p->dofs[p->n - 1]);
        }
        if (!cJSON_IsNumber(item))
            return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be a number", path);
        x[dof] = item->valuedouble;  /* keys stand once: json.h */
    }
    return MODAL_OK;
}

/* Always made, zeros where the scene says nothing. */
static enum modal_status read_initial(struct program *p, const cJSON *initial,
                                      struct modal_error *err)
{
    static const struct scene_key *const tables[] = { initial_keys, NULL };
    struct initial at = { 0 };
    enum modal_status rc;

    p->x0 = calloc((size_t)p->n, sizeof *p->x0);
    p->v0 = calloc((size_t)p->n, sizeof *p->v0);
    if (p->x0 == NULL || p->v0 == NULL)
        return no_memory(err);
    if (initial == NULL)  /* zeros */
        return MODAL_OK;
    rc = scene_keys_read(NULL, initial, "initial", tables, &at, err);
    if (rc == MODAL_OK)
        rc = read_state(p, at.x, "x", p->x0, err);
    if (rc == MODAL_OK)
        rc = read_state(p, at.v, "v", p->v0, err);
    return rc;
}

struct dof_sensor { int dof, derivative; const char *name; };

static const struct scene_key dof_sensor_keys[] = {
    { "dof", SCENE_DOF, offsetof(struct dof_sensor, dof), .needed = true, .means = "which is read",
      .example = "\"x1\"" },
    { "derivative", SCENE_WHOLE, offsetof(struct dof_sensor, derivative), "", 0, 2,
      .means = "in time: displacement, velocity, acceleration", .example = "2" },
    { "name", SCENE_TEXT, offsetof(struct dof_sensor, name),
      .otherwise = "the dof's, with _dot or _ddot", .means = "of the channel",
      .example = "\"gauge\"" },
    { 0 },
};
static const struct scene_table dof_sensors[] = {
    { .list = "sensors", .keys = { dof_sensor_keys }, .law = "x, x' or x'' of a dof" },
    { 0 },
};

/* A channel is called after its dof, with _dot or _ddot for rates and accelerations. */
static enum modal_status dof_sensor(struct lowering *l, const cJSON *json, const char *path,
                                    struct program_output *out, struct modal_error *err)
{
    char text[96], where[128];
    struct dof_sensor s = { 0 };
    enum modal_status rc = scene_keys_read(l, json, path, dof_sensors[0].keys, &s, err);

    json_path(where, path, "dof");
    if (rc == MODAL_OK && s.dof < 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: the ground does not move", where);
    if (rc != MODAL_OK)
        return rc;
    /* the channel's name where the scene gives none */
    snprintf(text, sizeof text, "%s%s", l->p->dofs[s.dof], lowering_suffix[s.derivative]);
    lowering_add_term(l, out, s.derivative, s.dof, 1);
    return (out->name = strdup(s.name != NULL ? s.name : text)) != NULL ? MODAL_OK : no_memory(err);
}

/* On turning axes that are seen from fixed ones, what is given is x' at t = 0: q' = x' - W J x. */
static void turn_initial(const struct lowering *l)
{
    const struct program *p = l->p;

    for (int i = 0; p->seen_fixed && i < p->n; i++)
        p->v0[i] -= p->turn_speed * l->turn_sign[i] * p->x0[l->turn_partner[i]];
}

/* The structure's own kinds first, where the entry is one; else a dof's. */
static enum modal_status add_sensor(struct lowering *l, const cJSON *json, const char *path,
                                    struct modal_error *err)
{
    /* counted before it is filled: program_free frees its name */
    struct program_output *out = &l->p->output[l->p->outputs++];

    if (!cJSON_IsObject(json))
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%s must be an object, such as {\"dof\": \"x1\"}", path);
    const cJSON *dof = cJSON_GetObjectItemCaseSensitive(json, "dof");
    if (l->structure->sensor != NULL
        && (dof == NULL || l->p->seen_fixed
            || cJSON_GetObjectItemCaseSensitive(json, "frame") != NULL
            || (cJSON_IsString(dof) && program_dof(l->p, dof->valuestring) < 0)))
        return l->structure->sensor(l, json, path, out, err);
    return dof_sensor(l, json, path, out, err);
}

/* Dof I as a channel, as {"dof": its name} would. */
static enum modal_status sense_dof(struct lowering *l, int i, struct modal_error *err)
{
    cJSON *json = cJSON_CreateObject();  /* so that one way serves both */
    enum modal_status rc =
        json != NULL && cJSON_AddStringToObject(json, "dof", l->p->dofs[i]) != NULL
            ? add_sensor(l, json, "sensors", err)
            : no_memory(err);

    cJSON_Delete(json);
    return rc;
}

/* Absent: every dof; an empty list: no channel. */
static enum modal_status read_sensors(struct lowering *l, const cJSON *list,
                                      struct modal_error *err)
{
    const cJSON *item;
    struct program *p = l->p;
    char path[32];
    int count;
    enum modal_status rc = MODAL_OK;

    if (list != NULL && !cJSON_IsArray(list))
        return modal_fail_field(err, MODAL_BAD_INPUT, "sensors", "sensors must be a list");
    count = list != NULL ? cJSON_GetArraySize(list) : p->n;  /* absent: all dofs */
    if (count > LOWERING_DOFS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "sensors",
                                "a scene lists %d sensors; at most %d", count, LOWERING_DOFS_MOST);
    if ((p->output = calloc((size_t)count + 1, sizeof *p->output)) == NULL)
        return no_memory(err);
    for (int i = 0; list == NULL && i < p->n && rc == MODAL_OK; i++)
        rc = sense_dof(l, i, err);
    cJSON_ArrayForEach(item, list) {
        snprintf(path, sizeof path, "sensors[%d]", p->outputs);
        if (rc == MODAL_OK)
            rc = add_sensor(l, item, path, err);
    }
    return rc;
}

struct time_keys { double dt, duration, periods, start; };

static const struct scene_key time_keys[] = {
    { "dt", SCENE_NUMBER, offsetof(struct time_keys, dt), "s", SCENE_POSITIVE, SCENE_LARGE,
      .otherwise = "none: simulating needs it", .means = "between samples", .example = "0.01" },
    { "duration", SCENE_NUMBER, offsetof(struct time_keys, duration), "s", 0, SCENE_LARGE,
      .otherwise = "none: simulating needs it or periods",
      .means = "of the record: duration/dt + 1 samples", .example = "2" },
    { "periods", SCENE_NUMBER, offsetof(struct time_keys, periods), "", 0, SCENE_LARGE,
      .otherwise = "duration", .means = "the record's length in the scene's periods",
      .example = "10" },
    { "start", SCENE_NUMBER, offsetof(struct time_keys, start), "s", 0, SCENE_LARGE,
      .means = "of the record; the motion begins at 0", .example = "1" },
    { 0 },
};

/* What stands in `time`, whoever will read it: 0 where it does not. */
static enum modal_status read_time(const cJSON *json, struct time_keys *out,
                                   struct modal_error *err)
{
    static const struct scene_key *const tables[] = { time_keys, NULL };

    return scene_keys_read(NULL, json, "time", tables, out, err);
}

struct scene_keys {
    double omega, period;  /* 0: not given */
    const char *units;
    const cJSON *structure, *effects, *excitation, *initial, *sensors, *time, *steady;
};

static const struct scene_key scene_keys[] = {
    { "units", SCENE_TEXT, offsetof(struct scene_keys, units), .otherwise = "SI",
      .means = "kept as provenance, never converted: one consistent system",
      .example = "\"ft, slug, s\"" },
    { "omega", SCENE_NUMBER, offsetof(struct scene_keys, omega), "rad/s", SCENE_POSITIVE,
      SCENE_LARGE, .otherwise = "a shaft's speed, else none",
      .means = "of harmonics in excitation and effects", .example = "3" },
    { "period", SCENE_NUMBER, offsetof(struct scene_keys, period), "s", SCENE_POSITIVE, SCENE_LARGE,
      .otherwise = "2 pi / omega", .means = "of the system; whole cycles of each harmonic of omega",
      .example = "2.0943951023931953" },
    { "structure", SCENE_OWN, offsetof(struct scene_keys, structure), .needed = true,
      .means = "an object of a type",
      .example = "{\"type\": \"chain\", \"masses\": [1], \"springs\": [1, 0]}" },
    { "effects", SCENE_OWN, offsetof(struct scene_keys, effects), .otherwise = "none",
      .means = "a list of objects, each of a type", .example = "[]" },
    { "excitation", SCENE_OWN, offsetof(struct scene_keys, excitation), .otherwise = "none",
      .means = "a list of loads", .example = "[]" },
    { "initial", SCENE_OWN, offsetof(struct scene_keys, initial), .otherwise = "rest",
      .members = initial_keys, .means = "the state at t = 0", .example = "{}" },
    { "sensors", SCENE_OWN, offsetof(struct scene_keys, sensors), .otherwise = "all dofs",
      .means = "a list of what is recorded", .example = "[{\"dof\": \"x1\"}]" },
    { "time", SCENE_OWN, offsetof(struct scene_keys, time), .otherwise = "none",
      .members = time_keys, .means = "of the record that simulating makes",
      .example = "{\"dt\": 0.01}" },
    { "steady", SCENE_OWN, offsetof(struct scene_keys, steady), .otherwise = "the method's",
      .means = "options of the steady state", .example = "{}" },
    { 0 },
};

/* Keys and ranges only: what is needed depends on who asks. */
static enum modal_status check_time(const cJSON *json, struct modal_error *err)
{
    struct time_keys t = { 0 };

    return json != NULL ? read_time(json, &t, err) : MODAL_OK;
}

/* The loads, with the time by which noise is drawn; nothing else here asks for one. */
static enum modal_status lower_loads(struct lowering *l, const cJSON *excitation,
                                     struct modal_error *err)
{
    struct scene_time time = { 0 };
    const cJSON *item, *type;
    bool noise = false;
    enum modal_status rc = MODAL_OK;

    cJSON_ArrayForEach(item, excitation) {
        type = cJSON_IsObject(item) ? json_member(item, "type") : NULL;
        noise |= cJSON_IsString(type) && strcmp(type->valuestring, "noise") == 0;
    }
    if (noise && json_member(l->scene, "time") != NULL)
        rc = scene_time(l->scene, l->p, &time, err);
    return rc == MODAL_OK ? loads_lower(l, excitation, &time, err) : rc;
}

/* The order in which parts depend on each other. */
static enum modal_status read_scene(struct lowering *l, const cJSON *scene,
                                    const struct scene_options *options, struct modal_error *err)
{
    static const struct scene_key *const tables[] = { scene_keys, NULL };
    struct scene_keys s = { 0 };
    enum modal_status rc = scene_keys_read(NULL, scene, "", tables, &s, err);

    l->p->omega = s.omega;  /* before the structure: a shaft sets it where it is 0 */
    l->p->period = s.period;
    loads_tones(s.steady, l->p);
    if (rc == MODAL_OK)
        rc = lower_structure(l, s.structure, err);
    if (rc == MODAL_OK && l->no_memory)
        rc = no_memory(err);
    if (rc == MODAL_OK)
        rc = lower_effects(l, s.effects, options, err);
    if (rc == MODAL_OK)
        rc = lower_loads(l, s.excitation, err);
    if (rc == MODAL_OK)
        rc = read_initial(l->p, s.initial, err);
    if (rc == MODAL_OK)
        turn_initial(l);
    if (rc == MODAL_OK)
        rc = read_sensors(l, s.sensors, err);
    return rc == MODAL_OK ? check_time(s.time, err) : rc;
}

/* Also of a lowering half done; the program is freed unless it was handed over. */
static void lowering_done(struct lowering *l)
{
    for (int i = 0; i < 3; i++)
        free(l->constant[i].x);
    for (int h = 0; h < l->harmonics; h++)
        for (int i = 0; i < 3; i++) {
            free(l->harmonic[h].cosine[i].x);
            free(l->harmonic[h].sine[i].x);
        }
    free(l->harmonic);
    for (int i = 0; i < LOWER_BLOCKS; i++)
        free(l->block[i].x);
    if (l->structure != NULL && l->structure->mesh_free != NULL)
        l->structure->mesh_free(l->mesh);
    else
        free(l->mesh);
    free(l->turn_partner);
    free(l->turn_sign);
    program_free(l->p);  /* NULL where it was handed over */
}

enum modal_status scene_lower(const cJSON *scene, const struct scene_options *options,
                              struct program **out, struct modal_error *err)
{
    struct lowering l = { .scene = scene,  /* effect -1: the structure comes first */
                          .options = options,
                          .p = calloc(1, sizeof *l.p),
                          .effect = -1 };
    enum modal_status rc = l.p != NULL ? read_scene(&l, scene, options, err) : no_memory(err);

    if (rc == MODAL_OK)
        rc = lowering_finish(&l, err);
    if (rc == MODAL_BAD_INPUT && err != NULL && err->field[0] == '\0' && cJSON_IsObject(scene))
        /* numbers that no key is to blame for alone: an overflow, no stiffness */
        snprintf(err->field, sizeof err->field, "structure");
    if (rc == MODAL_OK) {
        *out = l.p;
        l.p = NULL;  /* the caller's now */
    }
    lowering_done(&l);
    return rc;
}

/* The record's length, by duration or by periods of P, one of them. */
static enum modal_status duration_of(const cJSON *json, const struct program *p,
                                     const struct time_keys *t, double *duration,
                                     struct modal_error *err)
{
    /* the scene's own first */
    double period = p->period > 0 ? p->period : p->omega > 0 ? 2 * M_PI / p->omega : 0;

    *duration = t->duration;
    if (json_member(json, "periods") == NULL)
        return scene_key_need(json, "time", time_keys, "duration", err);
    if (json_member(json, "duration") != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "time.periods",
                                "time holds duration and periods; accepted: one of them");
    if (period == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "time.periods",
                                "time.periods needs the scene's period or omega");
    *duration = t->periods * period;
    return MODAL_OK;
}

enum modal_status scene_time(const cJSON *scene, const struct program *p, struct scene_time *out,
                             struct modal_error *err)
{
    const cJSON *json = cJSON_GetObjectItemCaseSensitive(scene, "time");
    struct time_keys t = { 0 };
    double duration = 0, steps;
    enum modal_status rc;

    if (json == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "time",
                                "simulating needs \"time\": {\"dt\", \"duration\" or \"periods\"}");
    rc = read_time(json, &t, err);
    if (rc == MODAL_OK)
        rc = scene_key_need(json, "time", time_keys, "dt", err);
    if (rc == MODAL_OK)
        rc = duration_of(json, p, &t, &duration, err);
    if (rc != MODAL_OK)
        return rc;
    steps = duration / t.dt;  /* compared as a double: it may be past any integer */
    if (!(steps <= SCENE_SAMPLES_MOST - 1))
        return modal_fail_field(err, MODAL_TOO_LARGE, "time",
                                "the record would have %.3g samples; at most %d", steps,
                                SCENE_SAMPLES_MOST);
    *out = (struct scene_time) {
        .dt = t.dt, .start = t.start, .duration = duration,
        /* a duration of whole steps, up to rounding: relative of the quotient, absolute of a
         * short one */
        .samples = (long)(floor(steps * (1 + QUOTIENT_ROUNDING) + STEP_ROUNDING)) + 1,
    };
    return MODAL_OK;
}

/* ---- all tables, for whoever tells them ---- */

/* What stands at I of TABLES, an array ended by one without `list`; else I less their count. */
static bool in_tables(const struct scene_table *tables, int *i, struct scene_table *out)
{
    for (; tables != NULL && tables->list != NULL; tables++)
        if ((*i)-- == 0) {
            *out = *tables;
            return true;
        }
    return false;
}

bool scene_tables(int i, struct scene_table *out)
{
    static const struct scene_table own[] = {
        { .list = "", .keys = { scene_keys }, .law = "M x'' + C x' + K x + f(x, x') = p(t)" },
        { .list = "initial", .keys = { initial_keys }, .law = "x(0), x'(0)" },
        { .list = "time", .keys = { time_keys }, .law = "samples at start + j dt" },
        { 0 },
    };

    if (in_tables(own, &i, out))
        return true;
    for (const struct scene_structure_kind *const *k = scene_structures; *k != NULL; k++)
        if (i-- == 0) {  /* this one; else one less to go */
            *out =
                (struct scene_table){ .list = "structure", .name = (*k)->name, .law = (*k)->law };
            /* the rows stay where they are: static */
            memcpy(out->keys, (*k)->keys, sizeof out->keys);
            return true;
        }
    for (const struct scene_effect_kind *const *k = scene_effects; *k != NULL; k++)
        if (i-- == 0) {
            *out = (struct scene_table) { .list = "effects", .name = (*k)->name,
                                          .structures = (*k)->structures, .law = (*k)->law };
            memcpy(out->keys, (*k)->keys, sizeof out->keys);
            return true;
        }
    if (in_tables(loads_types, &i, out) || in_tables(dof_sensors, &i, out))
        return true;
    for (const struct scene_structure_kind *const *k = scene_structures; *k != NULL; k++)
        if (in_tables((*k)->sensors, &i, out))
            return true;
    return false;
}
