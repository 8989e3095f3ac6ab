/*
 * scene_mesh.c - see scene_mesh.h
 *
 * Node i of N lies at i / N of the length, so it is node i E / N of E elements where that is whole.
 * A new node at the fraction xi of an old element has the state that the element's functions give
 * there: Hermite's cubics of displacement and slope, and for the wing's torsion (three nodes an
 * element) the cubic of Lagrange through its four.
 *
 * Tested by tests/unit/job/test_scene_jobs.c.
 */
#include "job/scene_mesh.h"
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/hermite.h"
#include "modal/scene/scene.h"

struct field { const char *value, *slope; };          /* dof names; slope NULL: torsion, three nodes
                                                         an element */

static const struct mesh_kind { const char *type; struct field fields[3]; } kinds[] = {
    { "beam", { { "w", "th" } } },
    { "shaft", { { "y", "sy" }, { "z", "sz" } } },
    { "wing", { { "w", "wp" }, { "phi", NULL } } },
};
enum { KINDS = sizeof kinds / sizeof *kinds, FIELDS_MOST = 3, NAME_MOST = 64 };

struct remesh {
    const struct mesh_kind *kind;
    int from, to;
    double length;
};

static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
}

/* The nodes an element of the field that dof NAME belongs to, and the node; 0: NAME is no dof of a
 * mesh. */
static int place_of(const struct remesh *r, const char *name, long *node)
{
    size_t letters = strcspn(name, "0123456789");
    char *end;

    if (letters == 0 || !isdigit((unsigned char)name[letters]))
        return 0;
    *node = strtol(name + letters, &end, 10);
    for (int i = 0; *end == '\0' && i < FIELDS_MOST && r->kind->fields[i].value != NULL; i++) {
        const struct field *f = &r->kind->fields[i];
        if (strlen(f->value) == letters && strncmp(f->value, name, letters) == 0)
            return f->slope != NULL ? 1 : 3;
        if (f->slope != NULL && strlen(f->slope) == letters
            && strncmp(f->slope, name, letters) == 0)
            return 1;
    }
    return 0;
}

/* *NAME, on the heap, where it is of a dof of the old mesh, becomes its place on the new one. */
static enum modal_status move_name(const struct remesh *r, char **name, struct modal_error *err)
{
    long node = 0;
    char text[NAME_MOST], *moved;
    int per = place_of(r, *name, &node);

    if (per == 0 || node > (long)per * r->from)
        return MODAL_OK;
    if (node * r->to % r->from != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "elements",
                                "%s of %d elements lies between the nodes of %d", *name, r->from,
                                r->to);
    snprintf(text, sizeof text, "%.*s%ld", (int)strcspn(*name, "0123456789"), *name,
             node * r->to / r->from);
    if ((moved = cJSON_malloc(strlen(text) + 1)) == NULL)
        return no_memory(err);
    cJSON_free(*name);
    *name = strcpy(moved, text);
    return MODAL_OK;
}

static enum modal_status move_names(const struct remesh *r, cJSON *list, struct modal_error *err);

/* VALUE, a dof's name, weights by such names, or a list of either. */
static enum modal_status move_places(const struct remesh *r, cJSON *value, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    cJSON *item;

    if (cJSON_IsString(value))
        return move_name(r, &value->valuestring, err);
    cJSON_ArrayForEach(item, value)
        if (rc == MODAL_OK)
            rc = item->string != NULL ? move_name(r, &item->string, err)
                                      : move_places(r, item, err);
    return rc;
}

/* VALUE, the member KEY of an effect, a load, a sensor or one of the things that these list. */
static enum modal_status move_member(const struct remesh *r, cJSON *value, const char *key,
                                     struct modal_error *err)
{
    static const char *const places[] = { "dof", "to", "on", "normal", "tangential", "direction",
                                          "powers" };

    if (strcmp(key, "terms") == 0 || strcmp(key, "nodes") == 0)
        return move_names(r, value, err);
    for (size_t k = 0; k < sizeof places / sizeof *places; k++)
        if (strcmp(key, places[k]) == 0)
            return move_places(r, value, err);
    return MODAL_OK;
}

static enum modal_status move_names(const struct remesh *r, cJSON *list, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    cJSON *item, *member;

    cJSON_ArrayForEach(item, list)
        cJSON_ArrayForEach(member, item)
            if (rc == MODAL_OK && member->string != NULL)
                rc = move_member(r, member, member->string, err);
    return rc;
}

/* Sensors under the names that their channels have now; without any, one for each dof. */
static enum modal_status name_sensors(cJSON *scene, const struct scene_arrays *arrays,
                                      struct modal_error *err)
{
    cJSON *list = cJSON_GetObjectItemCaseSensitive(scene, "sensors"), *item;
    bool listed = list != NULL;
    struct scene_options with = { .arrays = arrays };
    struct program *p = NULL;
    enum modal_status rc = scene_lower(scene, &with, &p, err);

    if (rc != MODAL_OK)
        return rc;
    if (!listed)
        list = cJSON_AddArrayToObject(scene, "sensors");
    for (int i = 0; i < p->outputs; i++) {
        if (listed)
            item = cJSON_GetArrayItem(list, i);
        else
            cJSON_AddItemToArray(list, item = cJSON_CreateObject());
        if (!listed)
            cJSON_AddStringToObject(item, "dof", p->output[i].name);
        if (!cJSON_HasObjectItem(item, "name"))
            cJSON_AddStringToObject(item, "name", p->output[i].name);
    }
    program_free(p);
    return MODAL_OK;
}

/* ---- the initial state ---- */

static double value_at(const cJSON *state, const char *letters, int node)
{
    char name[NAME_MOST];
    const cJSON *item;

    snprintf(name, sizeof name, "%s%d", letters, node);
    item = cJSON_GetObjectItemCaseSensitive(state, name);
    return cJSON_IsNumber(item) ? item->valuedouble : 0;
}

static void put_value(cJSON *state, const char *letters, int node, double value)
{
    char name[NAME_MOST];

    snprintf(name, sizeof name, "%s%d", letters, node);
    if (value != 0)
        cJSON_AddNumberToObject(state, name, value);
}

static void bend(const struct remesh *r, const struct field *f, const cJSON *old, cJSON *state)
{
    for (int j = 0; j <= r->to; j++) {
        int e = (int)((long)j * r->from / r->to) < r->from ? (int)((long)j * r->from / r->to)
                                                           : r->from - 1;
        double xi = (double)j * r->from / r->to - e, n[4], slope[4], u = 0, s = 0;

        hermite_shape(r->length / r->from, xi, n, slope);
        for (int i = 0; i < 4; i++) {
            double x = value_at(old, i % 2 ? f->slope : f->value, e + i / 2);
            u += n[i] * x;
            s += slope[i] * x;
        }
        put_value(state, f->value, j, u);
        put_value(state, f->slope, j, s);
    }
}

static void twist(const struct remesh *r, const struct field *f, const cJSON *old, cJSON *state)
{
    for (int j = 0; j <= 3 * r->to; j++) {
        double at = (double)j * r->from / r->to, sum = 0;          /* in thirds of old elements */
        int e = (int)(at / 3) < r->from ? (int)(at / 3) : r->from - 1;

        for (int a = 0; a < 4; a++) {
            double weight = value_at(old, f->value, 3 * e + a);
            for (int b = 0; b < 4; b++)
                weight *= a == b ? 1 : (at - 3 * e - b) / (a - b);
            sum += weight;
        }
        put_value(state, f->value, j, sum);
    }
}

/* Dofs of the old state by name keep their values; what lies between is interpolated. */
static enum modal_status move_state(const struct remesh *r, cJSON *initial, const char *key,
                                    struct modal_error *err)
{
    const cJSON *old = cJSON_GetObjectItemCaseSensitive(initial, key);
    cJSON *state = cJSON_CreateObject();

    if (old == NULL || state == NULL) {
        cJSON_Delete(state);
        return state != NULL ? MODAL_OK : no_memory(err);
    }
    for (int i = 0; i < FIELDS_MOST && r->kind->fields[i].value != NULL; i++)
        (r->kind->fields[i].slope != NULL ? bend : twist)(r, &r->kind->fields[i], old, state);
    return cJSON_ReplaceItemInObjectCaseSensitive(initial, key, state) ? MODAL_OK : no_memory(err);
}

/* ---- the scene ---- */

static enum modal_status find_mesh(const cJSON *scene, int elements, struct remesh *r,
                                   struct modal_error *err)
{
    const cJSON *structure = cJSON_GetObjectItemCaseSensitive(scene, "structure");
    const cJSON *type = cJSON_GetObjectItemCaseSensitive(structure, "type"),
                *model = cJSON_GetObjectItemCaseSensitive(structure, "model");

    *r = (struct remesh) { .to = elements };
    for (int i = 0; i < KINDS; i++)
        if (cJSON_IsString(type) && strcmp(type->valuestring, kinds[i].type) == 0)
            r->kind = &kinds[i];
    if (r->kind == NULL || (cJSON_IsString(model) && strcmp(model->valuestring, "massless") == 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "elements",
                                "the structure has no mesh: elements is of a beam, a wing, or a "
                                "shaft of finite elements");
    r->from = (int)cJSON_GetNumberValue(cJSON_GetObjectItemCaseSensitive(structure, "elements"));
    r->length = cJSON_GetNumberValue(cJSON_GetObjectItemCaseSensitive(structure, "length"));
    return MODAL_OK;
}

enum modal_status scene_mesh(cJSON *scene, const struct scene_arrays *arrays, int elements,
                             struct modal_error *err)
{
    static const char *const lists[] = { "sensors", "effects", "excitation" };
    cJSON *initial = cJSON_GetObjectItemCaseSensitive(scene, "initial");
    struct remesh r;
    enum modal_status rc = name_sensors(scene, arrays, err);

    if (rc == MODAL_OK)
        rc = find_mesh(scene, elements, &r, err);
    for (size_t i = 0; rc == MODAL_OK && i < sizeof lists / sizeof *lists; i++)
        rc = move_names(&r, cJSON_GetObjectItemCaseSensitive(scene, lists[i]), err);
    if (rc == MODAL_OK)
        rc = move_state(&r, initial, "x", err);
    if (rc == MODAL_OK)
        rc = move_state(&r, initial, "v", err);
    if (rc == MODAL_OK)
        cJSON_SetNumberValue(cJSON_GetObjectItemCaseSensitive(
                                 cJSON_GetObjectItemCaseSensitive(scene, "structure"), "elements"),
                             elements);
    return rc;
}

/* The airloads whose inflow has an order; NULL: none. */
static cJSON *airloads_of(const cJSON *scene, bool *whole_orders)
{
    cJSON *effect;

    cJSON_ArrayForEach(effect, cJSON_GetObjectItemCaseSensitive(scene, "effects")) {
        const char *type = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(effect, "type"));
        const char *inflow = cJSON_GetStringValue(
            cJSON_GetObjectItemCaseSensitive(effect, "inflow"));
        bool he = inflow != NULL && strcmp(inflow, "peters_he") == 0,
             two = inflow != NULL && strcmp(inflow, "peters_2d") == 0;

        *whole_orders = he;
        if (type != NULL && strcmp(type, "airloads") == 0 && (he || two))
            return effect;
    }
    return NULL;
}

enum modal_status scene_inflow(cJSON *scene, int states, struct modal_error *err)
{
    bool whole_orders;
    cJSON *airloads = airloads_of(scene, &whole_orders);

    if (airloads == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "inflow_states",
                                "the scene has no airloads with inflow peters_2d or peters_he");
    cJSON_DeleteItemFromObjectCaseSensitive(airloads, "inflow_states");
    cJSON_AddNumberToObject(airloads, "inflow_states", states);
    return MODAL_OK;
}

/* All (m, n), n = m + 1, m + 3, ... <= order + 1: the cosine states of a whole order. */
static int states_of(int order)
{
    int count = 0;

    for (int m = 0; m <= order; m++)
        count += (order - m) / 2 + 1;
    return count;
}

int scene_inflow_beside(const cJSON *scene, int step)
{
    bool whole_orders;
    const cJSON *airloads = airloads_of(scene, &whole_orders),
                *stated = cJSON_GetObjectItemCaseSensitive(airloads, "inflow_states");
    int states = cJSON_IsNumber(stated) ? (int)stated->valuedouble
                 : whole_orders         ? 30
                                        : 6,
        order = 1;

    if (airloads == NULL)
        return 0;
    if (!whole_orders)
        return states + 2 * step > 0 ? states + 2 * step : 0;
    while (states_of(order) < states)
        order++;
    return order + 2 * step > 0 ? states_of(order + 2 * step) : 0;
}
