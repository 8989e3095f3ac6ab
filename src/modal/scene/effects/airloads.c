/*
 * airloads.c - a wing in a stream: apparent mass, circulatory lift at stations, and an inflow model's states
 *
 * wing_model.c has the loads, inflow/ the models.  `speed`, `density`, `lift_slope` (2 pi), `x_qc` (aft positive from the
 * elastic axis), `stations` (9), `inflow` (none), `inflow_states` (the model's standard: see the rows of inflow/).
 */
#include <math.h>
#include <stdio.h>
#include "modal/scene/lowering.h"
#include "modal/scene/structures/wing.h"

static enum modal_status read_inflow(const struct scene_effect *e, struct airloads *a, struct modal_error *err)
{
    const char *names[8] = { NULL };
    char where[128];
    int which = 0;
    enum modal_status rc;

    for (int i = 0; inflow_kinds[i] != NULL; i++)
        names[i] = inflow_kinds[i]->name;
    rc = json_get_choice(e->json, e->path, "inflow", names, &which, err);
    a->inflow = inflow_kinds[which];
    a->inflow_states = a->inflow->standard;
    if (rc == MODAL_OK)
        rc = json_get_int(e->json, e->path, "inflow_states", 0, 1000000, &a->inflow_states, err);
    if (rc != MODAL_OK || a->inflow->valid(a->inflow_states))
        return rc;
    json_path(where, e->path, "inflow_states");
    return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s is %d; %s accepts %s", where, a->inflow_states, a->inflow->name, a->inflow->accepted);
}

static enum modal_status read_airloads(const struct scene_effect *e, struct airloads *a, struct modal_error *err)
{
    enum modal_status rc = json_need_number(e->json, e->path, "speed", 0, 1e300, &a->speed, err);

    a->lift_slope = 2 * M_PI;
    a->stations = 9;
    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "density", 0, 1e300, &a->density, err);
    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "lift_slope", 0, 1e300, &a->lift_slope, err);
    if (rc == MODAL_OK)
        rc = json_need_number(e->json, e->path, "x_qc", -1e300, 1e300, &a->x_qc, err);
    if (rc == MODAL_OK)
        rc = json_get_int(e->json, e->path, "stations", 1, WING_STATIONS_MOST, &a->stations, err);
    return rc == MODAL_OK ? read_inflow(e, a, err) : rc;
}

static void add_rows(struct lowering *l, int matrix, const double *rows, int n)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            if (rows[i * n + j] != 0)
                lowering_add(l, matrix, i, j, rows[i * n + j]);
}

static void add_block(struct lowering *l, enum lowering_block block, int i0, int j0, const double *rows, int m, int n)
{
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++)
            lowering_add_block(l, block, i0 + i, j0 + j, rows[i * n + j]);
}

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct wing_mesh *mesh = l->mesh;
    struct airloads_matrices *air = &mesh->air;
    struct airloads a = { 0 };
    enum modal_status rc = read_airloads(e, &a, err);

    if (rc == MODAL_OK && mesh->in_air)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, e->path, "%s: airloads are listed already", e->path);
    if (rc != MODAL_OK)
        return rc;
    mesh->in_air = true;                               /* from here on there is something to free */
    rc = airloads_new(&mesh->wing, &a, air, err);
    if (rc != MODAL_OK)
        return rc;
    mesh->state = air->nz > 0 ? lowering_add_states(l, air->nz) : 0;
    if (mesh->state < 0)
        return MODAL_OK;                               /* too many: scene_lower says so */
    add_rows(l, PROGRAM_M, air->M, air->n);
    add_rows(l, PROGRAM_C, air->C, air->n);
    add_rows(l, PROGRAM_K, air->K, air->n);
    add_block(l, LOWER_F, 0, mesh->state, air->F, air->n, air->nz);
    add_block(l, LOWER_BX, mesh->state, 0, air->Bx, air->nz, air->n);
    add_block(l, LOWER_BV, mesh->state, 0, air->Bv, air->nz, air->n);
    add_block(l, LOWER_BA, mesh->state, 0, air->Ba, air->nz, air->n);
    add_block(l, LOWER_E, mesh->state, mesh->state, air->flow.E, air->nz, air->nz);
    add_block(l, LOWER_A, mesh->state, mesh->state, air->flow.A, air->nz, air->nz);
    return MODAL_OK;
}

static const char *const keys[] = { "speed", "density", "lift_slope", "x_qc", "stations", "inflow", "inflow_states", NULL };
static const char *const structures[] = { "wing", NULL };
const struct scene_effect_kind effect_airloads = { "airloads", keys, structures, lower };
