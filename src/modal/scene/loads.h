/* loads.h - the excitation of a scene, into program.load */
#ifndef MODAL_SCENE_LOADS_H
#define MODAL_SCENE_LOADS_H
#include "modal/scene/lowering.h"

struct scene_time;

/* The types, in the order of enum program_load_type, then those of entries only, ended by one
 * without `list`. */
extern const struct scene_table loads_types[];

/* EXCITATION is the scene's list, NULL: none; into l->p->load.  TIME is the scene's, of zeros where
 * it has none: noise is drawn by it.  Fails with MODAL_BAD_INPUT,
 * MODAL_TOO_LARGE, MODAL_NO_MEMORY; what was read is the program's to free. */
enum modal_status loads_lower(struct lowering *l, const cJSON *excitation,
                              const struct scene_time *time, struct modal_error *err);
/* The tones that STEADY, the scene's member, names, into P, which loads may name: whoever needs
 * them checks them. */
void loads_tones(const cJSON *steady, struct program *p);

#endif
