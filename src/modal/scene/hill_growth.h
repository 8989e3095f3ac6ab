/* hill_growth.h - how many motions of a large sparse periodic program grow faster than a rate
 *
 * Windows of Hill's matrix show what lies where they look.  This counts all exponents right of a
 * line, wherever they are, by what the program's pulsating dofs see of its constant part.
 */
#ifndef MODAL_HILL_GROWTH_H
#define MODAL_HILL_GROWTH_H
#include <stdbool.h>
#include "modal/scene/program.h"

/*
 * Into COUNT the multipliers of P over PERIOD, laws and loads left out, beyond e^(RATE PERIOD),
 * RATE > 0 in 1/s, for no more than MOST operations (budget.h), nearly; those taken are added to
 * WORK.  P is one that period_map_serves.  Fails with MODAL_TOO_LARGE (it takes more, or too many
 * dofs pulsate or push away from rest), MODAL_NO_CONVERGENCE (one lies on the line),
 * MODAL_NO_MEMORY.
 */
enum modal_status hill_growth(const struct program *p, double period, double rate, double most,
                              int *count, double *work, struct modal_error *err);

/*
 * *HELD: what holds P, pushed from rest or not, or its inertia at RATE is more than the stiffness
 * that pulsates, at all times and of whatever shape.  Where it is less, motions of slow growth are
 * no perturbations of those without.  Fails with MODAL_TOO_LARGE as hill_growth, MODAL_NO_MEMORY.
 */
enum modal_status hill_is_held(const struct program *p, double period, double rate, bool *held,
                               struct modal_error *err);
#endif
