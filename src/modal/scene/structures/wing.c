/*
 * wing.c - the wing as a structure: dofs w<i>, wp<i> (nodes 1 .. elements) and phi<i> (1 .. 3 elements), root clamped
 *
 * wing_model.c has the equations.  Sensors read dofs, the wing at a `position` along the span, and what the airloads
 * put on a `station`: lift and moment about the elastic axis, per length.
 */
#include "modal/scene/structures/wing.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/lowering.h"

static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "wing: out of memory");
}

static enum modal_status read_wing(const cJSON *json, const char *path, struct wing *w, struct modal_error *err)
{
    const struct { const char *key; double low; double *out; } numbers[] = {
        { "length", 1e-300, &w->length },         { "chord", 1e-300, &w->chord }, { "EI", 1e-300, &w->EI },
        { "GJ", 1e-300, &w->GJ },                 { "mass_per_length", 1e-300, &w->mass_per_length },
        { "I_rho", 1e-300, &w->I_rho },           { "x_cg", -1e300, &w->x_cg },
    };
    enum modal_status rc = json_get_int(json, path, "elements", 1, WING_ELEMENTS_MOST, &w->elements, err);

    if (rc == MODAL_OK && w->elements == 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "structure.elements", "structure.elements is needed: 1 .. %d", WING_ELEMENTS_MOST);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers && rc == MODAL_OK; i++)
        rc = json_need_number(json, path, numbers[i].key, numbers[i].low, 1e300, numbers[i].out, err);
    if (rc == MODAL_OK && !(w->I_rho > w->mass_per_length * w->x_cg * w->x_cg))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "structure.I_rho", "I_rho = %g about the elastic axis must exceed mass_per_length x_cg^2 = %g",
                              w->I_rho, w->mass_per_length * w->x_cg * w->x_cg);
    return rc;
}

static void add_dofs(struct lowering *l, const struct wing *w)
{
    char name[32];

    for (int i = 0; i < 2 * w->elements; i++) {
        snprintf(name, sizeof name, "%s%d", i % 2 ? "wp" : "w", i / 2 + 1);
        lowering_add_dof(l, name);
    }
    for (int i = 1; i <= 3 * w->elements; i++) {
        snprintf(name, sizeof name, "phi%d", i);
        lowering_add_dof(l, name);
    }
}

static enum modal_status lower(struct lowering *l, const cJSON *json, const char *path, struct modal_error *err)
{
    struct wing_mesh *mesh = calloc(1, sizeof *mesh);
    double M[64], K[64];
    int dof[8];
    enum modal_status rc;

    if ((l->mesh = mesh) == NULL)
        return no_memory(err);
    rc = read_wing(json, path, &mesh->wing, err);
    if (rc != MODAL_OK)
        return rc;
    l->mass_per_length = mesh->wing.mass_per_length;
    add_dofs(l, &mesh->wing);
    wing_element(&mesh->wing, M, K);
    for (int e = 0; e < mesh->wing.elements; e++) {
        wing_element_dofs(&mesh->wing, e, dof);
        lowering_add_element(l, PROGRAM_M, 8, dof, M);
        lowering_add_element(l, PROGRAM_K, 8, dof, K);
    }
    return MODAL_OK;
}

static void mesh_free(void *mesh)
{
    if (mesh != NULL && ((struct wing_mesh *)mesh)->in_air)
        airloads_done(&((struct wing_mesh *)mesh)->air);
    free(mesh);
}

/* ---- sensors ---- */

/* {"station": i, "quantity": "lift" | "moment"} */
static enum modal_status station_sensor(struct lowering *l, const cJSON *json, const char *path, struct program_output *out,
                                        char name[96], struct modal_error *err)
{
    static const char *const keys[] = { "station", "quantity", "name", NULL }, *const words[] = { "lift", "moment", NULL };
    const struct wing_mesh *mesh = l->mesh;
    const struct airloads_matrices *air = &mesh->air;
    const char *word = NULL;
    char where[128];
    int station = 0, what = 0;
    enum modal_status rc = json_keys(json, path, keys, err);

    json_path(where, path, "station");
    if (rc == MODAL_OK && !mesh->in_air)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: without airloads there are no stations", where);
    if (rc == MODAL_OK)
        rc = json_get_int(json, path, "station", 0, air->ns - 1, &station, err);
    if (rc == MODAL_OK)
        rc = json_need_string(json, path, "quantity", &word, err);
    if (rc == MODAL_OK)
        rc = json_get_choice(json, path, "quantity", words, &what, err);
    if (rc != MODAL_OK)
        return rc;
    for (int q = 0; q < 3; q++)
        for (int j = 0; j < air->n; j++) {
            double value = (what == 0 ? air->lift : air->moment)[q][station * air->n + j];
            if (value != 0)
                lowering_add_term(l, out, q, j, value);
        }
    for (int j = 0; j < air->nz; j++) {
        double value = (what == 0 ? air->lift_z : air->moment_z)[station * air->nz + j];
        if (value != 0)
            lowering_add_term(l, out, 3, mesh->state + j, value);
    }
    snprintf(name, 96, "%s_%d", words[what], station);
    return MODAL_OK;
}

/* {"position": y, "quantity": "w" | "phi"} */
static enum modal_status position_sensor(struct lowering *l, const cJSON *json, const char *path, struct program_output *out,
                                         char name[96], struct modal_error *err)
{
    static const char *const keys[] = { "position", "quantity", "derivative", "name", NULL }, *const words[] = { "w", "phi", NULL };
    static const char *const suffix[] = { "", "_dot", "_ddot" };
    const struct wing_mesh *mesh = l->mesh;
    const char *word = NULL;
    double y = 0, *row = calloc((size_t)l->p->n + 1, sizeof *row);
    int what = 0, derivative = 0;
    enum modal_status rc = row == NULL ? no_memory(err) : json_keys(json, path, keys, err);

    if (rc == MODAL_OK)
        rc = json_need_number(json, path, "position", 0, mesh->wing.length, &y, err);
    if (rc == MODAL_OK)
        rc = json_need_string(json, path, "quantity", &word, err);
    if (rc == MODAL_OK)
        rc = json_get_choice(json, path, "quantity", words, &what, err);
    if (rc == MODAL_OK)
        rc = json_get_int(json, path, "derivative", 0, 2, &derivative, err);
    if (rc == MODAL_OK) {
        wing_rows(&mesh->wing, y, what == 0 ? row : NULL, what == 1 ? row : NULL);
        for (int j = 0; j < l->p->n; j++)
            if (row[j] != 0)
                lowering_add_term(l, out, derivative, j, row[j]);
        snprintf(name, 96, "%s(%.12g)%s", words[what], y, suffix[derivative]);
    }
    free(row);
    return rc;
}

static enum modal_status sensor(struct lowering *l, const cJSON *json, const char *path, struct program_output *out,
                                struct modal_error *err)
{
    const char *name = NULL, *dof = NULL;
    char text[96] = "", where[128];
    enum modal_status rc = json_get_string(json, path, "name", &name, err);

    if (rc == MODAL_OK)
        rc = json_get_string(json, path, "dof", &dof, err);
    json_path(where, path, dof != NULL && cJSON_GetObjectItemCaseSensitive(json, "frame") != NULL ? "frame" : "dof");
    if (rc == MODAL_OK && dof != NULL)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: no such dof or frame on a wing; its dofs run from %s to %s", where, l->p->dofs[0],
                              l->p->dofs[l->p->n - 1]);
    else if (rc == MODAL_OK && cJSON_GetObjectItemCaseSensitive(json, "station") != NULL)
        rc = station_sensor(l, json, path, out, text, err);
    else if (rc == MODAL_OK && cJSON_GetObjectItemCaseSensitive(json, "position") != NULL)
        rc = position_sensor(l, json, path, out, text, err);
    else if (rc == MODAL_OK)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s needs \"dof\", \"station\" or \"position\"", path);
    if (rc != MODAL_OK)
        return rc;
    out->name = strdup(name != NULL ? name : text);
    return out->name != NULL ? MODAL_OK : no_memory(err);
}

static const char *const keys[] = { "length", "chord", "elements", "EI", "GJ", "mass_per_length", "I_rho", "x_cg", NULL };
const struct scene_structure_kind structure_wing = {
    .name = "wing", .keys = keys, .lower = lower, .sensor = sensor, .mesh_free = mesh_free,
};
