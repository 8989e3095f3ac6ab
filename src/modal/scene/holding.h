/* holding.h - the forces with which stuck rigid sliders hold, from the state alone
 *
 * A step's polynomial of forces is a fit: good enough to move by, off by its own error at any one
 * instant.  Whether a slider still holds is asked of the equation of motion.
 */
#ifndef MODAL_HOLDING_H
#define MODAL_HOLDING_H
#include "modal/scene/ports.h"
#include "modal/scene/sources.h"

struct holding;

/* For PORTS, which is borrowed.  Fails with MODAL_NO_MEMORY. */
enum modal_status holding_new(const struct ports *ports, const struct sources *src,
                              struct holding **out, struct modal_error *err);
/* NULL is accepted. */
void holding_free(struct holding *h);

/*
 * Into FORCE, where every other channel's is, those of the rigid sliders that stick (held 0) at
 * state Y under sources W.  false: two of them hold the same motion, so that neither share is
 * known; FORCE is left alone.
 */
bool holding_forces(struct holding *h, const double *y, const double *w, double *force);

/* The same at the start of a motion: one that cannot hold has its limit. */
void holding_within_limits(struct holding *h, const double *y, const double *w, double *force);
#endif
