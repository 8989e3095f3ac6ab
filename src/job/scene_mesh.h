/* scene_mesh.h - a scene on another mesh, or with another order of inflow: the same places, the
 * same names of its channels */
#ifndef JOB_SCENE_MESH_H
#define JOB_SCENE_MESH_H
#include "base/error.h"
#include "base/json.h"

struct scene_arrays;

/*
 * Give SCENE (its structure a beam, a shaft or a wing), behind whose text ARRAYS stand (NULL:
 * none), ELEMENTS elements in place of its own.  Dofs that it names keep their places and its
 * channels their names; the initial state is interpolated by the old elements.  Fails with
 * MODAL_BAD_INPUT: field "elements" where the structure has none or a place is no node of the new
 * mesh, else the scene's own fault.
 */
enum modal_status scene_mesh(cJSON *scene, const struct scene_arrays *arrays, int elements,
                             struct modal_error *err);

/* Give the scene's airloads STATES inflow states.  Fails with MODAL_BAD_INPUT, field
 * "inflow_states", where there are none. */
enum modal_status scene_inflow(cJSON *scene, int states, struct modal_error *err);

/* The states of the next order of the scene's inflow, up (+1) or down (-1); 0: there is none. */
int scene_inflow_beside(const cJSON *scene, int step);

#endif
