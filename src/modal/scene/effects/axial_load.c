/*
 * axial_load.c - an end load on a beam, mean + amplitude cos(omega t), compression positive
 *
 * A compression P does the work P/2 int w'^2 dx, so K gains -P G, G the geometric matrix int N'^T N' dx.
 */
#include <math.h>
#include "modal/scene/lowering.h"
#include "modal/scene/structures/beam.h"
#include "modal/scene/hermite.h"

static void add_elements(struct lowering *l, const struct beam_mesh *mesh, double mean, double amplitude)
{
    double G[16];

    hermite_slope(mesh->h, G);
    for (int e = 0; e < mesh->elements; e++)
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                int row = mesh->dof[2 * e + i], column = mesh->dof[2 * e + j];
                if (mean != 0)
                    lowering_add(l, PROGRAM_K, row, column, -mean * G[4 * i + j]);
                lowering_add_harmonic(l, PROGRAM_K, 1, row, column, -amplitude * G[4 * i + j], 0);
            }
}

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    double mean = 0, amplitude = 0;
    enum modal_status rc = json_get_number(e->json, e->path, "mean", -HUGE_VAL, HUGE_VAL, &mean, err);

    if (rc == MODAL_OK)
        rc = json_get_number(e->json, e->path, "amplitude", -HUGE_VAL, HUGE_VAL, &amplitude, err);
    if (rc == MODAL_OK && amplitude != 0)
        rc = lowering_need_omega(l, "a pulsating axial_load", err);
    if (rc == MODAL_OK)
        add_elements(l, l->mesh, mean, amplitude);
    return rc;
}

static const char *const keys[] = { "mean", "amplitude", NULL };
static const char *const structures[] = { "beam", NULL };
const struct scene_effect_kind effect_axial_load = { "axial_load", keys, structures, lower };
