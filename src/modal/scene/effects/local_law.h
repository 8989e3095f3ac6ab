/* local_law.h - the end of every local nonlinear effect's lowering */
#ifndef MODAL_LOCAL_LAW_H
#define MODAL_LOCAL_LAW_H
#include "modal/scene/lowering.h"

/* Put LAW, of one input, between the ends; a failed construction (RC) passes through, its field made a path of E. */
enum modal_status local_law_add(struct lowering *l, const struct scene_effect *e, enum modal_status rc, struct local_ends at,
                                struct law *law, struct modal_error *err);

#endif
