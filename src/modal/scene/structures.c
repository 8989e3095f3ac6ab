/* structures.c - the table of structures: one line each (lowering.h says how to add one)
 *
 * The order is that of the contracts' table: messages list the types in it, and manuals will.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/scene.h"

extern const struct scene_structure_kind structure_matrices, structure_chain, structure_beam,
    structure_shaft, structure_wing;

const struct scene_structure_kind *const scene_structures[] = {
    &structure_matrices,
    &structure_chain,
    &structure_beam,
    &structure_shaft,
    &structure_wing,
    NULL,
};
