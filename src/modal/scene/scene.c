/*
 * scene.c - see scene.h
 *
 * One pass in a fixed order: the structure, the effects as listed, excitation, initial state, sensors; then the
 * entries become compressed matrices and the program is checked as a whole: its mass is positive definite (banded
 * Cholesky) and its period fits every harmonic.
 */
#include "modal/scene/scene.h"
#include <lapacke.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/loads.h"
#include "modal/scene/lowering.h"

static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
}

/* "type" and the keys of a row, checked. */
static enum modal_status check_keys(const cJSON *json, const char *path, const char *const *keys, struct modal_error *err)
{
    const char *all[32] = { "type" };
    int n = 1;

    for (int i = 0; keys[i] != NULL && n < 31; i++)
        all[n++] = keys[i];
    return json_keys(json, path, all, err);
}

static const struct scene_structure_kind *find_structure(const char *name)
{
    for (int i = 0; scene_structures[i] != NULL; i++)
        if (strcmp(scene_structures[i]->name, name) == 0)
            return scene_structures[i];
    return NULL;
}

static enum modal_status lower_structure(struct lowering *l, const cJSON *scene, struct modal_error *err)
{
    const cJSON *json = cJSON_GetObjectItemCaseSensitive(scene, "structure");
    const char *type = NULL;
    char list[256] = "";
    enum modal_status rc;

    if (!cJSON_IsObject(json))
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure", "a scene needs an object \"structure\"");
    if ((rc = json_need_string(json, "structure", "type", &type, err)) != MODAL_OK)
        return rc;
    if ((l->structure = find_structure(type)) == NULL) {
        for (int i = 0; scene_structures[i] != NULL; i++)
            snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", i ? ", " : "", scene_structures[i]->name);
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.type", "unknown structure \"%.40s\"; accepted: %s", type, list);
    }
    rc = check_keys(json, "structure", l->structure->keys, err);
    if (rc == MODAL_OK)
        rc = l->structure->lower(l, json, "structure", err);
    for (int i = 0; i < 3; i++)
        l->structural[i] = l->constant[i].count;
    return rc;
}

static bool takes(const struct scene_effect_kind *kind, const char *structure)
{
    for (int i = 0; kind->structures != NULL && kind->structures[i] != NULL; i++)
        if (strcmp(kind->structures[i], structure) == 0)
            return true;
    return kind->structures == NULL;
}

/* The row of TABLE called TYPE, if the structure takes it. */
static enum modal_status find_effect(const struct lowering *l, const struct scene_effect_kind *const *table, const char *type,
                                     const char *path, const struct scene_effect_kind **kind, struct modal_error *err)
{
    char where[128], list[448] = "";
    bool known = false;

    for (int i = 0; table[i] != NULL; i++) {
        bool same = strcmp(table[i]->name, type) == 0;
        known = known || same;
        if (!takes(table[i], l->structure->name))
            continue;
        if (same) {
            *kind = table[i];
            return MODAL_OK;
        }
        snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", list[0] ? ", " : "", table[i]->name);
    }
    json_path(where, path, "type");
    return modal_fail_field(err, MODAL_BAD_INPUT, where, known ? "a %2$s takes no \"%1$.40s\"; accepted: %3$s"
                            : "unknown effect \"%1$.40s\" for a %2$s; accepted: %3$s", type, l->structure->name, list);
}

/* Everything that an effect can have written, counted. */
static int written(const struct lowering *l)
{
    int count = l->p->laws + l->p->n_linear;

    for (int i = 0; i < 3; i++)
        count += l->constant[i].count;
    for (int h = 0; h < l->harmonics; h++)
        for (int i = 0; i < 3; i++)
            count += l->harmonic[h].cosine[i].count + l->harmonic[h].sine[i].count;
    for (int i = 0; i < LOWER_BLOCKS; i++)
        count += l->block[i].count;
    return count;
}

static enum modal_status lower_effect(struct lowering *l, const struct scene_effect_kind *const *table, const cJSON *json, int position,
                                      struct modal_error *err)
{
    char path[32];
    struct program_effect *row = &l->p->effect[l->p->effects];
    const struct scene_effect_kind *kind = NULL;
    const char *type = NULL;
    int before = written(l), laws = l->p->laws;
    enum modal_status rc;

    snprintf(path, sizeof path, "effects[%d]", position);
    if (!cJSON_IsObject(json))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be an object", path);
    if ((rc = json_need_string(json, path, "type", &type, err)) != MODAL_OK)
        return rc;
    if ((rc = find_effect(l, table, type, path, &kind, err)) != MODAL_OK)
        return rc;
    if ((rc = check_keys(json, path, kind->keys, err)) != MODAL_OK)
        return rc;
    if ((row->type = strdup(type)) == NULL)
        return no_memory(err);
    l->effect = l->p->effects++;
    rc = kind->lower(l, &(struct scene_effect) { json, path, l->effect }, err);
    if (rc == MODAL_OK && (l->p->laws > laws || row->carrier > 0) && (row->law_text = json_print(json)) == NULL)
        rc = no_memory(err);
    row->active = written(l) > before && l->p->laws == laws;   /* laws say so themselves, when they act */
    l->effect = -1;
    return rc;
}

static enum modal_status lower_effects(struct lowering *l, const cJSON *scene, const struct scene_options *options,
                               struct modal_error *err)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(scene, "effects"), *item;
    const struct scene_effect_kind *const *table = options != NULL && options->effects != NULL ? options->effects : scene_effects;
    int position = 0, count;
    enum modal_status rc = MODAL_OK;

    if (list != NULL && !cJSON_IsArray(list))
        return modal_fail_field(err, MODAL_BAD_INPUT, "effects", "effects must be a list");
    count = list != NULL ? cJSON_GetArraySize(list) : 0;
    if (count > SCENE_EFFECTS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "effects", "a scene lists %d effects; at most %d", count, SCENE_EFFECTS_MOST);
    if ((l->p->effect = calloc((size_t)count + 1, sizeof *l->p->effect)) == NULL)
        return no_memory(err);
    cJSON_ArrayForEach(item, list) {
        if (rc == MODAL_OK && !(options != NULL && options->without[position]))
            rc = lower_effect(l, table, item, position, err);
        position++;
    }
    if (rc == MODAL_OK && l->structure->finish != NULL)
        rc = l->structure->finish(l, err);
    return rc;
}

static enum modal_status read_state(const struct program *p, const cJSON *initial, const char *key, double *x, struct modal_error *err)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(initial, key), *item;
    char path[128], base[32];

    snprintf(base, sizeof base, "initial.%s", key);
    if (list != NULL && !cJSON_IsObject(list))
        return modal_fail_field(err, MODAL_BAD_INPUT, base, "%s must be an object: numbers by dof name", base);
    cJSON_ArrayForEach(item, list) {
        int dof = program_dof(p, item->string);
        json_path(path, base, item->string);
        if (dof < 0)
            return modal_fail_field(err, MODAL_BAD_INPUT, path, "no dof \"%.40s\" in this structure; its dofs run from %s to %s", item->string,
                                    p->dofs[0], p->dofs[p->n - 1]);
        if (!cJSON_IsNumber(item))
            return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be a number", path);
        x[dof] = item->valuedouble;
    }
    return MODAL_OK;
}

static enum modal_status read_initial(struct program *p, const cJSON *scene, struct modal_error *err)
{
    static const char *const keys[] = { "x", "v", NULL };
    const cJSON *initial = cJSON_GetObjectItemCaseSensitive(scene, "initial");
    enum modal_status rc;

    p->x0 = calloc((size_t)p->n, sizeof *p->x0);
    p->v0 = calloc((size_t)p->n, sizeof *p->v0);
    if (p->x0 == NULL || p->v0 == NULL)
        return no_memory(err);
    if (initial == NULL)
        return MODAL_OK;
    rc = json_keys(initial, "initial", keys, err);
    if (rc == MODAL_OK)
        rc = read_state(p, initial, "x", p->x0, err);
    if (rc == MODAL_OK)
        rc = read_state(p, initial, "v", p->v0, err);
    return rc;
}

/* A channel is called after its dof, with _dot or _ddot for rates and accelerations. */
static enum modal_status dof_sensor(struct lowering *l, const cJSON *json, const char *path, struct program_output *out, struct modal_error *err)
{
    static const char *const keys[] = { "dof", "derivative", "name", NULL };
    static const char *const suffix[] = { "", "_dot", "_ddot" };
    const char *name = NULL;
    char text[96], where[128];
    int dof = -1, derivative = 0;
    enum modal_status rc = json_keys(json, path, keys, err);

    if (rc == MODAL_OK)
        rc = lowering_dof(l, json, path, "dof", true, &dof, err);
    json_path(where, path, "dof");
    if (rc == MODAL_OK && dof < 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: the ground does not move", where);
    if (rc == MODAL_OK)
        rc = json_get_int(json, path, "derivative", 0, 2, &derivative, err);
    if (rc == MODAL_OK)
        rc = json_get_string(json, path, "name", &name, err);
    if (rc != MODAL_OK)
        return rc;
    snprintf(text, sizeof text, "%s%s", l->p->dofs[dof], suffix[derivative]);
    lowering_add_term(l, out, derivative, dof, 1);
    return (out->name = strdup(name != NULL ? name : text)) != NULL ? MODAL_OK : no_memory(err);
}

/* On turning axes that are seen from fixed ones, what is given is x' at t = 0: q' = x' - W J x. */
static void turn_initial(const struct lowering *l)
{
    const struct program *p = l->p;

    for (int i = 0; p->seen_fixed && i < p->n; i++)
        p->v0[i] -= p->turn_speed * l->turn_sign[i] * p->x0[l->turn_partner[i]];
}

static enum modal_status add_sensor(struct lowering *l, const cJSON *json, const char *path, struct modal_error *err)
{
    struct program_output *out = &l->p->output[l->p->outputs++];

    if (!cJSON_IsObject(json))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be an object", path);
    const cJSON *dof = cJSON_GetObjectItemCaseSensitive(json, "dof");
    if (l->structure->sensor != NULL && (dof == NULL || l->p->seen_fixed || cJSON_GetObjectItemCaseSensitive(json, "frame") != NULL
                                         || (cJSON_IsString(dof) && program_dof(l->p, dof->valuestring) < 0)))
        return l->structure->sensor(l, json, path, out, err);
    return dof_sensor(l, json, path, out, err);
}

/* Dof I as a channel, as {"dof": its name} would. */
static enum modal_status sense_dof(struct lowering *l, int i, struct modal_error *err)
{
    cJSON *json = cJSON_CreateObject();
    enum modal_status rc = json != NULL && cJSON_AddStringToObject(json, "dof", l->p->dofs[i]) != NULL ? add_sensor(l, json, "sensors", err) : no_memory(err);

    cJSON_Delete(json);
    return rc;
}

static enum modal_status read_sensors(struct lowering *l, const cJSON *scene, struct modal_error *err)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(scene, "sensors"), *item;
    struct program *p = l->p;
    char path[32];
    int count;
    enum modal_status rc = MODAL_OK;

    if (list != NULL && !cJSON_IsArray(list))
        return modal_fail_field(err, MODAL_BAD_INPUT, "sensors", "sensors must be a list");
    count = list != NULL ? cJSON_GetArraySize(list) : p->n;
    if (count > LOWERING_DOFS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "sensors", "a scene lists %d sensors; at most %d", count, LOWERING_DOFS_MOST);
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

/* Entries into compressed rows; no entries: an empty matrix of m = 0, but for M, C, K themselves. */
static enum modal_status compress(const struct lowering_entries *e, int m, int n, bool always, struct sparse *out, struct modal_error *err)
{
    if (e->count == 0 && !always)
        return MODAL_OK;
    return sparse_from_triplets(m, n, e->x, e->count, out, err);
}

static enum modal_status compress_harmonics(struct lowering *l, struct modal_error *err)
{
    struct program *p = l->p;
    enum modal_status rc = MODAL_OK;

    if (l->harmonics == 0)
        return MODAL_OK;
    if ((p->harmonic = calloc((size_t)l->harmonics, sizeof *p->harmonic)) == NULL)
        return no_memory(err);
    p->harmonics = l->harmonics;
    for (int h = 0; h < l->harmonics; h++) {
        p->harmonic[h].k = l->harmonic[h].k;
        for (int i = 0; i < 3 && rc == MODAL_OK; i++) {
            rc = compress(&l->harmonic[h].cosine[i], p->n, p->n, false, &p->harmonic[h].cosine[i], err);
            if (rc == MODAL_OK)
                rc = compress(&l->harmonic[h].sine[i], p->n, p->n, false, &p->harmonic[h].sine[i], err);
        }
    }
    return rc;
}

static enum modal_status compress_all(struct lowering *l, struct modal_error *err)
{
    struct program *p = l->p;
    struct sparse *block[LOWER_BLOCKS] = { &p->E, &p->A, &p->Bx, &p->Bv, &p->Ba, &p->F };
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < 3 && rc == MODAL_OK; i++)
        rc = compress(&l->constant[i], p->n, p->n, true, &p->constant[i], err);
    if (rc == MODAL_OK)
        rc = compress_harmonics(l, err);
    for (int i = 0; i < LOWER_BLOCKS && rc == MODAL_OK && p->n_linear > 0; i++)
        rc = compress(&l->block[i], i == LOWER_F ? p->n : p->n_linear, i == LOWER_E || i == LOWER_A || i == LOWER_F ? p->n_linear : p->n,
                      true, block[i], err);
    return rc;
}

static bool has_key(const struct scene_structure_kind *kind, const char *key)
{
    for (int i = 0; kind->keys != NULL && kind->keys[i] != NULL; i++)
        if (strcmp(kind->keys[i], key) == 0)
            return true;
    return false;
}

/* M_0 positive definite, by a Cholesky factor of its band: n b^2 operations, b the bandwidth. */
static enum modal_status check_mass(const struct lowering *l, struct modal_error *err)
{
    const struct program *p = l->p;
    const struct sparse *M = &p->constant[PROGRAM_M];
    int b = 0, info;
    double *band;

    for (int i = 0; i < M->m; i++)
        for (int k = M->start[i]; k < M->start[i + 1]; k++)
            b = M->index[k] > i && M->index[k] - i > b ? M->index[k] - i : b;
    if ((band = calloc((size_t)(b + 1) * (size_t)p->n, sizeof *band)) == NULL)
        return no_memory(err);
    for (int i = 0; i < M->m; i++)
        for (int k = M->start[i]; k < M->start[i + 1]; k++)
            if (M->index[k] >= i)                     /* upper: entry (i, j) at [b + i - j + j (b + 1)] */
                band[(size_t)(b + i - M->index[k]) + (size_t)M->index[k] * (size_t)(b + 1)] = M->value[k];
    info = LAPACKE_dpbtrf(LAPACK_COL_MAJOR, 'U', p->n, b, band, b + 1);
    free(band);
    if (info == 0)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT,
                            has_key(l->structure, "M") ? "structure.M" : "structure",
                            "the mass matrix is not positive definite (at dof %s)",
                            p->dofs[info > 0 ? info - 1 : 0]);
}

/* A period must hold a whole number of cycles of every harmonic. */
static enum modal_status check_period(const struct program *p, struct modal_error *err)
{
    for (int h = 0; h < p->harmonics && p->period > 0; h++) {
        double cycles = p->harmonic[h].k * p->omega * p->period / (2 * M_PI);
        if (!(fabs(cycles - round(cycles)) <= 1e-9 * cycles) || round(cycles) < 1)
            return modal_fail_field(err, MODAL_BAD_INPUT, "period", "the period %g s holds %.10g cycles of the scene's harmonic %d of omega = %g rad/s; "
                                    "it must hold a whole number", p->period, cycles, p->harmonic[h].k, p->omega);
    }
    return MODAL_OK;
}

/* What stands in `time`, whoever will read it: 0 where it does not. */
static enum modal_status read_time(const cJSON *json, struct scene_time *t, double *periods, struct modal_error *err)
{
    static const char *const keys[] = { "dt", "duration", "periods", "start", NULL };
    enum modal_status rc = json_keys(json, "time", keys, err);

    if (rc == MODAL_OK)
        rc = json_get_number(json, "time", "dt", 1e-300, 1e300, &t->dt, err);
    if (rc == MODAL_OK)
        rc = json_get_number(json, "time", "duration", 0, 1e300, &t->duration, err);
    if (rc == MODAL_OK)
        rc = json_get_number(json, "time", "periods", 0, 1e300, periods, err);
    return rc == MODAL_OK ? json_get_number(json, "time", "start", 0, 1e300, &t->start, err) : rc;
}

static enum modal_status check_time(const cJSON *scene, struct modal_error *err)
{
    const cJSON *json = cJSON_GetObjectItemCaseSensitive(scene, "time");
    struct scene_time t = { 0 };
    double periods = 0;

    return json != NULL ? read_time(json, &t, &periods, err) : MODAL_OK;
}

static enum modal_status read_scene(struct lowering *l, const cJSON *scene, const struct scene_options *options,
                               struct modal_error *err)
{
    static const char *const keys[] = { "structure", "effects", "excitation", "initial", "sensors", "omega", "period", "time", "steady",
                                        "units", NULL };
    const char *units = NULL;
    enum modal_status rc = json_keys(scene, "", keys, err);

    if (rc == MODAL_OK)
        rc = json_get_string(scene, "", "units", &units, err);
    if (rc == MODAL_OK)
        rc = json_get_number(scene, "", "omega", 1e-300, 1e300, &l->p->omega, err);
    if (rc == MODAL_OK)
        rc = json_get_number(scene, "", "period", 1e-300, 1e300, &l->p->period, err);
    if (rc == MODAL_OK)
        rc = lower_structure(l, scene, err);
    if (rc == MODAL_OK && l->no_memory)
        rc = no_memory(err);
    if (rc == MODAL_OK)
        rc = lower_effects(l, scene, options, err);
    if (rc == MODAL_OK)
        rc = loads_lower(l, cJSON_GetObjectItemCaseSensitive(scene, "excitation"), err);
    if (rc == MODAL_OK)
        rc = read_initial(l->p, scene, err);
    if (rc == MODAL_OK)
        turn_initial(l);
    if (rc == MODAL_OK)
        rc = read_sensors(l, scene, err);
    return rc == MODAL_OK ? check_time(scene, err) : rc;
}

static enum modal_status finish(struct lowering *l, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (l->no_memory)
        return no_memory(err);
    if (l->too_many)
        return modal_fail_field(err, MODAL_TOO_LARGE, "effects", "the scene lowers to more than %d entries of a matrix or %d linear states",
                                LOWERING_ENTRIES_MOST, LOWERING_STATES_MOST);
    rc = compress_all(l, err);
    if (rc == MODAL_OK)
        rc = check_mass(l, err);
    if (rc == MODAL_OK)
        rc = check_period(l->p, err);
    if (rc == MODAL_OK)
        program_hash(l->p);
    return rc;
}

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
    program_free(l->p);
}

enum modal_status scene_lower(const cJSON *scene, const struct scene_options *options, struct program **out,
                              struct modal_error *err)
{
    struct lowering l = { .scene = scene, .options = options, .p = calloc(1, sizeof *l.p), .effect = -1 };
    enum modal_status rc = l.p != NULL ? read_scene(&l, scene, options, err) : no_memory(err);

    if (rc == MODAL_OK)
        rc = finish(&l, err);
    if (rc == MODAL_BAD_INPUT && err != NULL && err->field[0] == '\0' && cJSON_IsObject(scene))
        snprintf(err->field, sizeof err->field, "structure");       /* numbers that no key is to blame for alone: an overflow, no stiffness */
    if (rc == MODAL_OK) {
        *out = l.p;
        l.p = NULL;
    }
    lowering_done(&l);
    return rc;
}

enum modal_status scene_time(const cJSON *scene, const struct program *p, struct scene_time *out, struct modal_error *err)
{
    const cJSON *json = cJSON_GetObjectItemCaseSensitive(scene, "time");
    struct scene_time t = { 0 };
    double periods = 0, period = p->period > 0 ? p->period : p->omega > 0 ? 2 * M_PI / p->omega : 0, steps;
    bool counted = json != NULL && cJSON_GetObjectItemCaseSensitive(json, "periods") != NULL;
    enum modal_status rc;

    if (json == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "time", "simulating needs \"time\": {\"dt\", \"duration\" or \"periods\"}");
    rc = read_time(json, &t, &periods, err);
    if (rc == MODAL_OK)
        rc = json_need_number(json, "time", "dt", 1e-300, 1e300, &t.dt, err);
    if (rc == MODAL_OK && !counted)
        rc = json_need_number(json, "time", "duration", 0, 1e300, &t.duration, err);
    if (rc != MODAL_OK)
        return rc;
    if (counted && cJSON_GetObjectItemCaseSensitive(json, "duration") != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "time.periods", "time holds duration and periods; accepted: one of them");
    if (counted && period == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "time.periods", "time.periods needs the scene's period or omega");
    if (counted)
        t.duration = periods * period;
    steps = t.duration / t.dt;
    if (!(steps <= SCENE_SAMPLES_MOST - 1))
        return modal_fail_field(err, MODAL_TOO_LARGE, "time", "the record would have %.3g samples; at most %d", steps, SCENE_SAMPLES_MOST);
    t.samples = (long)(floor(steps * (1 + 1e-12) + 1e-9)) + 1;       /* a duration of whole steps, up to rounding */
    *out = t;
    return MODAL_OK;
}
