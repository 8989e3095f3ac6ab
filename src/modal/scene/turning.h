/* turning.h - a shaft's program on fixed axes, periodic, as the constant program on turning axes
 * that it is equivalent to
 *
 * With x = R(W t) q, W = turn_speed, exponents on fixed axes are those on turning axes modulo i W,
 * exactly: no stiffness of the shaft has to be resolved in time.
 */
#ifndef MODAL_TURNING_H
#define MODAL_TURNING_H
#include "modal/scene/program.h"

/*
 * *OUT: the constant program over q, with p's outputs, loads, laws' effects and initial state, so
 * that its channels are p's own; program_free frees it.  NULL where p is not equivalent to a
 * constant one: not a shaft on fixed axes, a support that is not isotropic, a law that does not
 * turn, linear states.  The laws are borrowed: their data stays p's. Fails with MODAL_NO_MEMORY.
 */
enum modal_status program_turned(const struct program *p, struct program **out,
                                 struct modal_error *err);

/* Free what program_turned made. */
void program_turned_free(struct program *turned);

#endif
