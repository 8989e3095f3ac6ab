/* loads.c - see loads.h */
#include "modal/scene/loads.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The types in the order of enum program_load_type; the row's keys are what an entry may hold. */
static const struct {
    const char *name;
    const char *const keys[9];
} types[] = {
    [LOAD_HARMONIC]         = { "harmonic",         { "dof", "type", "frame", "k", "cos", "sin", NULL } },
    [LOAD_IMPULSE]          = { "impulse",          { "dof", "type", "frame", "start", "amplitude", NULL } },
    [LOAD_HALF_SINE]        = { "half_sine",        { "dof", "type", "frame", "start", "amplitude", "duration", NULL } },
    [LOAD_ONE_MINUS_COSINE] = { "one_minus_cosine", { "dof", "type", "frame", "start", "amplitude", "duration", NULL } },
    [LOAD_STEP]             = { "step",             { "dof", "type", "frame", "start", "amplitude", "duration", NULL } },
    [LOAD_TABLE]            = { "table",            { "dof", "type", "frame", "start", "amplitude", "points", "time", "force", NULL } },
};
enum { TYPES = sizeof types / sizeof *types };

static enum modal_status read_harmonic(const struct lowering *l, const cJSON *json, const char *path, struct program_load *load,
                                       struct modal_error *err)
{
    enum modal_status rc;

    load->k = 1;
    rc = json_get_int(json, path, "k", 0, LOWERING_HARMONIC_MOST, &load->k, err);
    if (rc == MODAL_OK)
        rc = json_get_number(json, path, "cos", -HUGE_VAL, HUGE_VAL, &load->cosine, err);
    if (rc == MODAL_OK)
        rc = json_get_number(json, path, "sin", -HUGE_VAL, HUGE_VAL, &load->sine, err);
    if (rc == MODAL_OK && load->k > 0)
        rc = lowering_need_omega(l, "a harmonic excitation", err);
    return rc;
}

/* `points` as two arrays. */
static enum modal_status read_points(const cJSON *list, const char *path, struct program_load *load, struct modal_error *err)
{
    const cJSON *point;
    char where[160];
    int n = cJSON_IsArray(list) ? cJSON_GetArraySize(list) : 0;

    load->time = malloc(((size_t)n + 1) * sizeof *load->time);
    load->force = malloc(((size_t)n + 1) * sizeof *load->force);
    if (load->time == NULL || load->force == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    cJSON_ArrayForEach(point, list) {
        const cJSON *t = cJSON_GetArrayItem(point, 0), *f = cJSON_GetArrayItem(point, 1);
        if (!cJSON_IsArray(point) || cJSON_GetArraySize(point) != 2 || !cJSON_IsNumber(t) || !cJSON_IsNumber(f)) {
            snprintf(where, sizeof where, "%.90s.points[%d]", path, load->points);
            return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s must be [t, force]", where);
        }
        load->time[load->points] = t->valuedouble;
        load->force[load->points++] = f->valuedouble;
    }
    return MODAL_OK;
}

static enum modal_status read_lists(const cJSON *json, const char *path, struct program_load *load, struct modal_error *err)
{
    size_t times = 0, forces = 0;
    char where[128];
    enum modal_status rc = json_get_numbers(json, path, "time", -HUGE_VAL, HUGE_VAL, &load->time, &times, err);

    if (rc == MODAL_OK)
        rc = json_get_numbers(json, path, "force", -HUGE_VAL, HUGE_VAL, &load->force, &forces, err);
    json_path(where, path, "force");
    if (rc == MODAL_OK && times != forces)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s has %zu numbers, time has %zu; as many of each", where, forces, times);
    if (rc == MODAL_OK && times <= LOWERING_POINTS_MOST)
        load->points = (int)times;
    return rc;
}

static enum modal_status read_table(const cJSON *json, const char *path, struct program_load *load, struct modal_error *err)
{
    const cJSON *points = cJSON_GetObjectItemCaseSensitive(json, "points");
    enum modal_status rc = points != NULL ? read_points(points, path, load, err) : read_lists(json, path, load, err);
    const char *key = points != NULL ? "points" : "time";
    char where[160];

    if (rc != MODAL_OK)
        return rc;
    json_path(where, path, key);
    if (load->points < 2 || load->points > LOWERING_POINTS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: a table has 2 to %d points", where, LOWERING_POINTS_MOST);
    for (int i = 1; i < load->points; i++)
        if (load->time[i] <= load->time[i - 1]) {
            snprintf(where, sizeof where, "%.90s.%s[%d]", path, key, i);
            return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: times must ascend; %g follows %g", where, load->time[i], load->time[i - 1]);
        }
    for (int i = 0; i < load->points; i++)
        load->force[i] *= load->amplitude;
    return MODAL_OK;
}

static enum modal_status read_pulse(const cJSON *json, const char *path, struct program_load *load, struct modal_error *err)
{
    bool table = load->type == LOAD_TABLE, ends = load->type == LOAD_HALF_SINE || load->type == LOAD_ONE_MINUS_COSINE;
    enum modal_status rc;

    load->amplitude = 1;
    rc = table ? json_get_number(json, path, "amplitude", -HUGE_VAL, HUGE_VAL, &load->amplitude, err)
               : json_need_number(json, path, "amplitude", -HUGE_VAL, HUGE_VAL, &load->amplitude, err);
    if (rc == MODAL_OK)
        rc = json_get_number(json, path, "start", 0, HUGE_VAL, &load->start, err);
    load->duration = load->type == LOAD_STEP ? HUGE_VAL : 0;
    if (rc == MODAL_OK && ends)
        rc = json_need_number(json, path, "duration", 1e-300, HUGE_VAL, &load->duration, err);
    if (rc == MODAL_OK && load->type == LOAD_STEP)
        rc = json_get_number(json, path, "duration", 1e-300, HUGE_VAL, &load->duration, err);
    if (rc == MODAL_OK && table)
        rc = read_table(json, path, load, err);
    return rc;
}

/* A load fixed in space on turning axes acts on two dofs. */
static enum modal_status read_frame(const struct lowering *l, const cJSON *json, const char *path, struct program_load *load,
                                    struct modal_error *err)
{
    static const char *const frames[] = { "rotating", "fixed", NULL };
    int frame = -1;
    char where[128];
    enum modal_status rc = json_get_choice(json, path, "frame", frames, &frame, err);

    load->dof_sine = -1;
    frame = frame < 0 && l->p->seen_fixed ? 1 : frame;
    if (rc != MODAL_OK || frame < 0)
        return rc;
    json_path(where, path, "frame");
    if (!l->names_frames)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: the axes of a %s do not turn", where, l->structure->name);
    if (frame == 0 && (l->turn_partner == NULL || l->p->seen_fixed))
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: the structure's dofs are on fixed axes; a load on turning ones needs "
                                "structure.frame \"rotating\"", where);
    if (frame == 1 && l->turn_partner != NULL) {
        load->dof_sine = l->turn_partner[load->dof];
        load->turn = l->turn_sign[load->dof];
    }
    return MODAL_OK;
}

static enum modal_status read_load(const struct lowering *l, const cJSON *json, const char *path, struct program_load *load,
                                   struct modal_error *err)
{
    const char *names[TYPES + 1] = { NULL };
    char where[128];
    int type = LOAD_HARMONIC;
    enum modal_status rc;

    for (int i = 0; i < TYPES; i++)
        names[i] = types[i].name;
    if (!cJSON_IsObject(json))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be an object", path);
    rc = json_get_choice(json, path, "type", names, &type, err);
    if (rc == MODAL_OK)
        rc = json_keys(json, path, types[type].keys, err);
    load->type = (enum program_load_type)type;
    load->dof = -1;
    if (rc == MODAL_OK)
        rc = lowering_dof(l, json, path, "dof", true, &load->dof, err);
    json_path(where, path, "dof");
    if (rc == MODAL_OK && load->dof < 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: the ground cannot be excited", where);
    if (rc == MODAL_OK)
        rc = read_frame(l, json, path, load, err);
    if (rc != MODAL_OK)
        return rc;
    return load->type == LOAD_HARMONIC ? read_harmonic(l, json, path, load, err) : read_pulse(json, path, load, err);
}

enum modal_status loads_lower(struct lowering *l, const cJSON *excitation, struct modal_error *err)
{
    const cJSON *item;
    char path[32];
    int count;
    enum modal_status rc = MODAL_OK;

    if (excitation == NULL)
        return MODAL_OK;
    if (!cJSON_IsArray(excitation))
        return modal_fail_field(err, MODAL_BAD_INPUT, "excitation", "excitation must be a list");
    count = cJSON_GetArraySize(excitation);
    if (count > LOWERING_LOADS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "excitation", "excitation lists %d loads; at most %d", count, LOWERING_LOADS_MOST);
    if ((l->p->load = calloc((size_t)count + 1, sizeof *l->p->load)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    cJSON_ArrayForEach(item, excitation) {
        snprintf(path, sizeof path, "excitation[%d]", l->p->loads);
        if (rc == MODAL_OK)
            rc = read_load(l, item, path, &l->p->load[l->p->loads++], err);
    }
    return rc;
}
