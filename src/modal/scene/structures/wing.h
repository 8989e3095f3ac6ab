/* wing.h - the wing's mesh: what airloads read, and what they leave for sensors at stations
 *
 * Airloads may be listed once. Their linear states lie in one block of the program's, from `state`
 * on, in the order of the inflow model's.
 */
#ifndef MODAL_STRUCTURES_WING_H
#define MODAL_STRUCTURES_WING_H
#include <stdbool.h>
#include "modal/scene/wing_model.h"

struct wing_mesh {
    struct wing wing;  /* as the scene says */
    /* airloads are listed: `air` holds them, their states from `state` on */
    bool in_air;
    int state;  /* the first of the airloads' linear states */
    struct airloads_matrices air;
};

#endif
