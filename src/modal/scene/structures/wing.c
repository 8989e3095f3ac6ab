/*
 * wing.c - the wing as a structure: dofs w<i>, wp<i> (nodes 1 .. elements) and phi<i> (1 .. 3
 * elements), root clamped
 *
 * wing_model.c has the equations.  Sensors read dofs, the wing at a `position` along the span, and
 * what the airloads put on a `station`: lift and moment about the elastic axis, per length.
 */
#include "modal/scene/structures/wing.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/lowering.h"

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "wing: out of memory");
}

static const struct scene_key keys[] = {
    { "elements", SCENE_WHOLE, offsetof(struct wing, elements), "", 1, WING_ELEMENTS_MOST,
      .needed = true, .means = "of equal length", .example = "4" },
    { "length", SCENE_NUMBER, offsetof(struct wing, length), "m", SCENE_POSITIVE, SCENE_LARGE,
      .needed = true, .means = "from the clamped root to the tip", .example = "6" },
    { "chord", SCENE_NUMBER, offsetof(struct wing, chord), "m", SCENE_POSITIVE, SCENE_LARGE,
      .needed = true, .means = "2 b", .example = "1.8" },
    { "EI", SCENE_NUMBER, offsetof(struct wing, EI), "N m^2", SCENE_POSITIVE, SCENE_LARGE,
      .needed = true, .means = "bending stiffness", .example = "9.8e6" },
    { "GJ", SCENE_NUMBER, offsetof(struct wing, GJ), "N m^2", SCENE_POSITIVE, SCENE_LARGE,
      .needed = true, .means = "torsional stiffness", .example = "9.9e5" },
    { "mass_per_length", SCENE_NUMBER, offsetof(struct wing, mass_per_length), "kg/m",
      SCENE_POSITIVE, SCENE_LARGE, .needed = true, .means = "m", .example = "35.7" },
    { "I_rho", SCENE_NUMBER, offsetof(struct wing, I_rho), "kg m", SCENE_POSITIVE, SCENE_LARGE,
      .needed = true,
      .means = "mass moment of inertia per length about the elastic axis, > m x_cg^2",
      .example = "8.6" },
    { "x_cg", SCENE_NUMBER, offsetof(struct wing, x_cg), "m", -SCENE_LARGE, SCENE_LARGE,
      .needed = true, .means = "centre of gravity from the elastic axis, aft positive",
      .example = "0.18" },
    { 0 },
};

/* Bending first, then twist: the order of wing_model.h. */
static void add_dofs(struct lowering *l, const struct wing *w)
{
    char name[32];

    for (int i = 0; i < 2 * w->elements; i++) {  /* w1, wp1, w2, .. */
        snprintf(name, sizeof name, "%s%d", i % 2 ? "wp" : "w", i / 2 + 1);
        lowering_add_dof(l, name);
    }
    for (int i = 1; i <= 3 * w->elements; i++) {  /* its own nodes, three an element */
        snprintf(name, sizeof name, "phi%d", i);
        lowering_add_dof(l, name);
    }
}

/* One element matrix serves all; the root's dofs are absent. */
static enum modal_status lower(struct lowering *l, void *values, struct modal_error *err)
{
    const struct wing *w = values;  /* read into it by the rows above */
    struct wing_mesh *mesh = calloc(1, sizeof *mesh);
    double M[64], K[64], least = w->mass_per_length * w->x_cg * w->x_cg;
    int dof[8];  /* of one element */

    if ((l->mesh = mesh) == NULL)  /* freed by mesh_free, whatever follows */
        return no_memory(err);
    if (!(w->I_rho > least))  /* else M is not positive definite */
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.I_rho",
                                "I_rho = %g about the elastic "
                                "axis must exceed mass_per_length x_cg^2 = %g",
                                w->I_rho, least);
    mesh->wing = *w;  /* airloads read it */
    l->mass_per_length = w->mass_per_length;
    add_dofs(l, w);
    wing_element(w, M, K);
    for (int e = 0; e < w->elements; e++) {
        wing_element_dofs(w, e, dof);
        lowering_add_element(l, PROGRAM_M, 8, dof, M);  /* index -1, the root, adds nothing */
        lowering_add_element(l, PROGRAM_K, 8, dof, K);
    }
    return MODAL_OK;
}

/* scene_structure_kind.mesh_free: the airloads' matrices with it. */
static void mesh_free(void *mesh)
{
    if (mesh != NULL && ((struct wing_mesh *)mesh)->in_air)
        airloads_done(&((struct wing_mesh *)mesh)->air);
    free(mesh);
}

/* ---- sensors ---- */

struct station { int station, quantity; };
struct position { double position; int quantity, derivative; };

static const char *const loads[] = { "lift", "moment", NULL }, *const motions[] = { "w", "phi",
                                                                                    NULL };

static const struct scene_key station_keys[] = {
    { "station", SCENE_WHOLE, offsetof(struct station, station), "", 0, WING_STATIONS_MOST - 1,
      .needed = true, .means = "of the airloads, from the root, from 0", .example = "0" },
    { "quantity", SCENE_WORD, offsetof(struct station, quantity), .needed = true, .words = loads,
      .means = "per length: up; about the elastic axis, nose-up", .example = "\"lift\"" },
    { "name", SCENE_TEXT, SCENE_ELSEWHERE, .otherwise = "<quantity>_<station>",
      .means = "of the channel", .example = "\"root lift\"" },
    { 0 },
};
static const struct scene_key position_keys[] = {
    { "position", SCENE_NUMBER, offsetof(struct position, position), "m", 0, SCENE_LARGE,
      .needed = true, .means = "along the span from the root, at most its length",
      .example = "1.5" },
    { "quantity", SCENE_WORD, offsetof(struct position, quantity), .needed = true, .words = motions,
      .means = "bending, up; twist, nose-up", .example = "\"phi\"" },
    { "derivative", SCENE_WHOLE, offsetof(struct position, derivative), "", 0, 2,
      .means = "in time", .example = "1" },
    { "name", SCENE_TEXT, SCENE_ELSEWHERE, .otherwise = "<quantity>(<position>)",
      .means = "of the channel", .example = "\"tip\"" },
    { 0 },
};
static const char *const of_wing[] = { "wing", NULL };
static const struct scene_table sensors[] = {
    { .list = "sensors", .structures = of_wing, .keys = { station_keys },
      .law = "what the airloads put on a station, a Gauss point of the span" },
    { .list = "sensors", .structures = of_wing, .keys = { position_keys },
      .law = "the elastic axis at a place along the span" },
    { 0 },
};

/* Rows of the airloads at one station: on x, x', x'' and on the inflow's states. */
static enum modal_status station_sensor(struct lowering *l, const cJSON *json, const char *path,
                                        struct program_output *out, char name[96],
                                        struct modal_error *err)
{
    const struct wing_mesh *mesh = l->mesh;
    const struct airloads_matrices *air = &mesh->air;
    struct station s = { 0 };
    char where[128];
    enum modal_status rc = scene_keys_read(l, json, path, sensors[0].keys, &s, err);

    json_path(where, path, "station");
    if (rc != MODAL_OK)
        return rc;
    if (!mesh->in_air)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s: without airloads there are no stations", where);
    if (s.station >= air->ns)  /* how many there are the airloads say */
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s is %d; accepted: a whole number from 0 to "
                                "%d, the last of the airloads' stations",
                                where, s.station, air->ns - 1);
    for (int q = 0; q < 3; q++)  /* x, x', x'' */
        for (int j = 0; j < air->n; j++) {
            double value = (s.quantity == 0 ? air->lift : air->moment)[q][s.station * air->n + j];
            if (value != 0)
                lowering_add_term(l, out, q, j, value);
        }
    for (int j = 0; j < air->nz; j++) {
        double value = (s.quantity == 0 ? air->lift_z : air->moment_z)[s.station * air->nz + j];
        if (value != 0)
            lowering_add_term(l, out, 3, mesh->state + j, value);  /* quantity 3: a linear state */
    }
    snprintf(name, 96, "%s_%d", loads[s.quantity], s.station);
    return MODAL_OK;
}

/* Shape functions at a place, the rows of one derivative. */
static enum modal_status position_sensor(struct lowering *l, const cJSON *json, const char *path,
                                         struct program_output *out, char name[96],
                                         struct modal_error *err)
{
    const struct wing *wing = &((struct wing_mesh *)l->mesh)->wing;
    struct position s = { 0 };
    double *row;
    char where[128];
    enum modal_status rc = scene_keys_read(l, json, path, sensors[1].keys, &s, err);

    json_path(where, path, "position");
    if (rc == MODAL_OK && s.position > wing->length)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where,
                              "%s is %g; accepted: a number from 0 to %g, the "
                              "wing's length",
                              where, s.position, wing->length);
    if (rc != MODAL_OK)
        return rc;
    if ((row = calloc((size_t)l->p->n + 1, sizeof *row)) == NULL)  /* w or phi over all dofs */
        return no_memory(err);
    wing_rows(wing, s.position, s.quantity == 0 ? row : NULL, s.quantity == 1 ? row : NULL);
    for (int j = 0; j < l->p->n; j++)
        if (row[j] != 0)
            lowering_add_term(l, out, s.derivative, j, row[j]);
    snprintf(name, 96, "%s(%.12g)%s", motions[s.quantity], s.position,
             lowering_suffix[s.derivative]);
    free(row);  /* its terms are copied */
    return MODAL_OK;
}

/* Which of its two kinds an entry is, by the key it has. */
static enum modal_status sensor(struct lowering *l, const cJSON *json, const char *path,
                                struct program_output *out, struct modal_error *err)
{
    const char *name = NULL, *dof = NULL;
    char text[96] = "", where[128];
    enum modal_status rc = json_get_string(json, path, "name", &name, err);

    if (rc == MODAL_OK)
        rc = json_get_string(json, path, "dof", &dof, err);
    json_path(where, path,
              dof != NULL && cJSON_GetObjectItemCaseSensitive(json, "frame") != NULL ? "frame"
                                                                                     : "dof");
    if (rc == MODAL_OK && dof != NULL)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where,
                              "%s: no such dof or frame on a wing; its dofs run from %s to %s",
                              where, l->p->dofs[0], l->p->dofs[l->p->n - 1]);
    else if (rc == MODAL_OK && cJSON_GetObjectItemCaseSensitive(json, "station") != NULL)
        rc = station_sensor(l, json, path, out, text, err);
    else if (rc == MODAL_OK && cJSON_GetObjectItemCaseSensitive(json, "position") != NULL)
        rc = position_sensor(l, json, path, out, text, err);
    else if (rc == MODAL_OK)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where,
                              "%s needs \"dof\", \"station\" or \"position\"", path);
    if (rc != MODAL_OK)
        return rc;
    out->name = strdup(name != NULL ? name : text);
    return out->name != NULL ? MODAL_OK : no_memory(err);
}

const struct scene_structure_kind structure_wing = {
    .name = "wing",
    .keys = { scene_type_keys, keys },
    .size = sizeof(struct wing),
    .law = "w up, phi nose-up, clamped at y = 0: T = integral m w_t^2/2 - m x_cg w_t phi_t + "
           "I_rho phi_t^2/2 dy, V = integral EI w_yy^2/2 + GJ phi_y^2/2 dy",
    .sensors = sensors,
    .lower = lower,
    .sensor = sensor,
    .mesh_free = mesh_free,
};
