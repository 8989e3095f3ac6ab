/* loads.h - the excitation of a scene, into program.load */
#ifndef MODAL_SCENE_LOADS_H
#define MODAL_SCENE_LOADS_H
#include "modal/scene/lowering.h"

/*
 * EXCITATION is the scene's list; NULL: none.  Each entry names its `dof` and is a harmonic (no type; k, cos, sin) or
 * of a `type`: impulse (amplitude in N s), half_sine, one_minus_cosine (amplitude (1 - cos(2 pi t / duration))), step
 * (duration optional), table (`points` [[t, f], ...], or `time` and `force`; times amplitude, default 1).  All but
 * harmonics take `start` [s], default 0.
 */
enum modal_status loads_lower(struct lowering *l, const cJSON *excitation, struct modal_error *err);

#endif
