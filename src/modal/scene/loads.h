/* loads.h - the excitation of a scene, into program.load */
#ifndef MODAL_SCENE_LOADS_H
#define MODAL_SCENE_LOADS_H
#include "modal/scene/lowering.h"

/* The types, in the order of enum program_load_type, ended by one without `list`. */
extern const struct scene_table loads_types[];

/* EXCITATION is the scene's list, NULL: none; into l->p->load.  Fails with MODAL_BAD_INPUT,
 * MODAL_TOO_LARGE, MODAL_NO_MEMORY; what was read is the program's to free. */
enum modal_status loads_lower(struct lowering *l, const cJSON *excitation, struct modal_error *err);

#endif
