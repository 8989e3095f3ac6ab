/*
 * beam.c - an Euler-Bernoulli beam of equal Hermite elements
 *
 * Node i of 0..elements lies at i h; its dofs are w<i> [m] and th<i> = dw/dx.  `pinned` holds w, `clamped` w and th,
 * `free` nothing.  Consistent mass; the frequencies of pinned beams converge from above like h^4.
 */
#include "modal/scene/structures/beam.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/lowering.h"
#include "modal/scene/hermite.h"

enum support { PINNED, CLAMPED, FREE };

static enum modal_status read_supports(const cJSON *json, enum support ends[2], struct modal_error *err)
{
    static const char *const words[] = { "pinned", "clamped", "free" };
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(json, "supports");
    char where[48] = "structure.supports";

    for (int i = 0; list != NULL && i < 2; i++) {
        const cJSON *item = cJSON_IsArray(list) && cJSON_GetArraySize(list) == 2 ? cJSON_GetArrayItem(list, i) : NULL;
        int found = -1;
        for (int s = 0; s < 3; s++)
            if (item != NULL && cJSON_IsString(item) && strcmp(item->valuestring, words[s]) == 0)
                found = s;
        if (found < 0) {
            if (item != NULL)
                snprintf(where, sizeof where, "structure.supports[%d]", i);
            return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: accepted is a list of two of \"pinned\", \"clamped\", \"free\"", where);
        }
        ends[i] = (enum support)found;
    }
    return MODAL_OK;
}

static void add_nodes(struct lowering *l, struct beam_mesh *mesh, const enum support ends[2])
{
    char name[32];

    for (int i = 0; i <= mesh->elements; i++) {
        bool at_end = i == 0 || i == mesh->elements;
        enum support s = !at_end ? FREE : ends[i == 0 ? 0 : 1];
        mesh->dof[2 * i] = mesh->dof[2 * i + 1] = -1;
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

static enum modal_status lower(struct lowering *l, const cJSON *json, const char *path, struct modal_error *err)
{
    double length = 0, EI = 0, m = 0, Me[16], Ke[16];
    int elements = 0;
    enum support ends[2] = { PINNED, PINNED };
    struct beam_mesh *mesh;
    enum modal_status rc = json_need_number(json, path, "length", 1e-300, 1e300, &length, err);

    if (rc == MODAL_OK)
        rc = json_need_number(json, path, "elements", 1, BEAM_ELEMENTS_MOST, &m, err);
    if (rc == MODAL_OK)
        rc = json_get_int(json, path, "elements", 1, BEAM_ELEMENTS_MOST, &elements, err);
    if (rc == MODAL_OK)
        rc = json_need_number(json, path, "EI", 1e-300, 1e300, &EI, err);
    if (rc == MODAL_OK)
        rc = json_need_number(json, path, "mass_per_length", 1e-300, 1e300, &m, err);
    if (rc == MODAL_OK)
        rc = read_supports(json, ends, err);
    if (rc != MODAL_OK)
        return rc;
    if (elements == 1 && ends[0] == CLAMPED && ends[1] == CLAMPED)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.elements", "one element clamped at both ends has no dof; at least 2 elements");
    if ((l->mesh = mesh = calloc(1, sizeof *mesh)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    mesh->elements = elements;
    mesh->h = length / elements;
    l->mass_per_length = m;
    add_nodes(l, mesh, ends);
    hermite_mass(m, mesh->h, Me);
    hermite_stiffness(EI, mesh->h, Ke);
    for (int e = 0; e < elements; e++) {
        lowering_add_element(l, PROGRAM_M, 4, &mesh->dof[2 * e], Me);
        lowering_add_element(l, PROGRAM_K, 4, &mesh->dof[2 * e], Ke);
    }
    return MODAL_OK;
}

static const char *const keys[] = { "length", "elements", "EI", "mass_per_length", "supports", NULL };
const struct scene_structure_kind structure_beam = { .name = "beam", .keys = keys, .lower = lower };
