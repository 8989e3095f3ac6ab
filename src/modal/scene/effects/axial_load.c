/*
 * axial_load.c - an end load on a beam, mean + amplitude cos(omega t), compression positive
 *
 * A compression P does the work P/2 int w'^2 dx, so K gains -P G, G the geometric matrix int N'^T
 * N' dx.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/structures/beam.h"
#include "modal/scene/hermite.h"

/* -P G of each element; a mean of 0 adds no entries, so that the pattern of K stays the
 * structure's. */
static void add_elements(struct lowering *l, const struct beam_mesh *mesh, double mean,
                         double amplitude)
{
    double G[16];

    hermite_slope(mesh->h, G);  /* one for all: elements are equal */
    for (int e = 0; e < mesh->elements; e++)
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                int row = mesh->dof[2 * e + i], column = mesh->dof[2 * e + j];
                if (mean != 0)
                    lowering_add(l, PROGRAM_K, row, column, -mean * G[4 * i + j]);
                lowering_add_harmonic(l, PROGRAM_K, 1, row, column, -amplitude * G[4 * i + j], 0);
            }
}

struct axial { double mean, amplitude; };

static const struct scene_key keys[] = {
    { "mean", SCENE_NUMBER, offsetof(struct axial, mean), "N", -HUGE_VAL, HUGE_VAL,
      .means = "constant part, compression positive", .example = "10" },
    { "amplitude", SCENE_NUMBER, offsetof(struct axial, amplitude), "N", -HUGE_VAL, HUGE_VAL,
      .means = "of cos(omega t), compression positive; needs the scene's omega", .example = "5" },
    { 0 },
};

/* The pulsation is the harmonic k = 1 of omega. */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct axial *s = e->values;
    enum modal_status rc = MODAL_OK;

    if (s->amplitude != 0)
        rc = lowering_need_omega(l, "a pulsating axial_load", err);
    if (rc == MODAL_OK)
        add_elements(l, l->mesh, s->mean, s->amplitude);
    return rc;
}

static const char *const structures[] = { "beam", NULL };
const struct scene_effect_kind effect_axial_load = {
    .name = "axial_load",
    .keys = { scene_type_keys, keys },
    .size = sizeof(struct axial),
    .structures = structures,
    .law =
        "K gains -(mean + amplitude cos(omega t)) G, G the geometric matrix: compression softens",
    .lower = lower,
};
