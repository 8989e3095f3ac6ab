/*
 * beam.c - an Euler-Bernoulli beam of equal Hermite elements
 *
 * Node i of 0..elements lies at i h; its dofs are w<i> [m] and th<i> = dw/dx.  `pinned` holds w,
 * `clamped` w and th, `free` nothing.  Consistent mass; the frequencies of pinned beams converge
 * from above like h^4.
 */
#include "modal/scene/structures/beam.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/lowering.h"
#include "modal/scene/hermite.h"

enum support { PINNED, CLAMPED, FREE };

struct beam { double length, EI, mass_per_length; int elements; const cJSON *supports; };

static const struct scene_key keys[] = {
    { "length", SCENE_NUMBER, offsetof(struct beam, length), "m", SCENE_POSITIVE, SCENE_LARGE,
      .needed = true, .means = "between the ends", .example = "2" },
    { "elements", SCENE_WHOLE, offsetof(struct beam, elements), "", 1, BEAM_ELEMENTS_MOST,
      .needed = true, .means = "of equal length; errors of frequencies fall with their 4th power",
      .example = "8" },
    { "EI", SCENE_NUMBER, offsetof(struct beam, EI), "N m^2", SCENE_POSITIVE, SCENE_LARGE,
      .needed = true, .means = "bending stiffness", .example = "100" },
    { "mass_per_length", SCENE_NUMBER, offsetof(struct beam, mass_per_length), "kg/m",
      SCENE_POSITIVE, SCENE_LARGE, .needed = true, .means = "m of m w_tt + EI w_xxxx = p",
      .example = "1.5" },
    { "supports", SCENE_OWN, offsetof(struct beam, supports),
      .otherwise = "[\"pinned\", \"pinned\"]",
      .means = "of both ends: \"pinned\" holds w, \"clamped\" w and th, \"free\" nothing",
      .example = "[\"clamped\", \"free\"]" },
    { 0 },
};

/* LIST NULL: as ENDS says already. */
static enum modal_status read_supports(const cJSON *list, enum support ends[2],
                                       struct modal_error *err)
{
    static const char
        *const words[] = { [PINNED] = "pinned", [CLAMPED] = "clamped", [FREE] = "free" };
    char where[48] = "structure.supports";

    for (int i = 0; list != NULL && i < 2; i++) {
        const cJSON *item = cJSON_IsArray(list) && cJSON_GetArraySize(list) == 2
                                ? cJSON_GetArrayItem(list, i)
                                : NULL;
        int found = -1;
        for (int s = 0; s < 3; s++)
            if (item != NULL && cJSON_IsString(item) && strcmp(item->valuestring, words[s]) == 0)
                found = s;
        if (found < 0) {
            if (item != NULL)
                snprintf(where, sizeof where, "structure.supports[%d]", i);
            return modal_fail_field(
                err, MODAL_BAD_INPUT, where,
                "%s: accepted is a list of two of \"pinned\", \"clamped\", \"free\"", where);
        }
        ends[i] = (enum support)found;
    }
    return MODAL_OK;
}

/* Dofs from left to right, so that the bandwidth is an element's. */
static void add_nodes(struct lowering *l, struct beam_mesh *mesh, const enum support ends[2])
{
    char name[32];

    for (int i = 0; i <= mesh->elements; i++) {
        bool at_end = i == 0 || i == mesh->elements;
        enum support s = !at_end ? FREE : ends[i == 0 ? 0 : 1];
        mesh->dof[2 * i] = mesh->dof[2 * i + 1] = -1;  /* held, until it is not */
        if (s == FREE) {
            snprintf(name, sizeof name, "w%d", i);
            mesh->dof[2 * i] = lowering_add_dof(l, name);
        }
        if (s != CLAMPED) {
            snprintf(name, sizeof name, "th%d", i);
            mesh->dof[2 * i + 1] = lowering_add_dof(l, name);
        }
    }
}

/* One element matrix serves all: they are equal. */
static enum modal_status lower(struct lowering *l, void *values, struct modal_error *err)
{
    const struct beam *b = values;
    double Me[16], Ke[16];
    enum support ends[2] = { PINNED, PINNED };  /* the default */
    struct beam_mesh *mesh;
    enum modal_status rc = read_supports(b->supports, ends, err);

    if (rc != MODAL_OK)
        return rc;
    if (b->elements == 1 && ends[0] == CLAMPED && ends[1] == CLAMPED)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.elements",
                                "one element clamped at both ends has no dof; at least 2 elements");
    if ((l->mesh = mesh = calloc(1, sizeof *mesh)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    mesh->elements = b->elements;
    mesh->h = b->length / b->elements;  /* axial_load reads it */
    l->mass_per_length = b->mass_per_length;
    add_nodes(l, mesh, ends);
    hermite_mass(b->mass_per_length, mesh->h, Me);
    hermite_stiffness(b->EI, mesh->h, Ke);
    for (int e = 0; e < b->elements; e++) {
        lowering_add_element(l, PROGRAM_M, 4, &mesh->dof[2 * e], Me);
        lowering_add_element(l, PROGRAM_K, 4, &mesh->dof[2 * e], Ke);
    }
    return MODAL_OK;
}

const struct scene_structure_kind structure_beam = {
    .name = "beam", .keys = { scene_type_keys, keys }, .size = sizeof(struct beam),
    .law = "mass_per_length w_tt + EI w_xxxx = p, w and th = w_x at the nodes", .lower = lower,
};
