/* local_law.h - what the lowering of local nonlinear effects has in common */
#ifndef MODAL_LOCAL_LAW_H
#define MODAL_LOCAL_LAW_H
#include "modal/scene/lowering.h"

/* What the rows of a polynomial's effect are read into. */
struct local_polynomial { struct local_ends at; struct scene_numbers coefficients; };

/* Put LAW, of one input, at the ends; a failed construction (RC) passes through, its field
 * made a path of E. */
enum modal_status local_law_add(struct lowering *l, const struct scene_effect *e,
                                enum modal_status rc, struct scene_ends at, struct law *law,
                                struct modal_error *err);

/* Lower E, a polynomial's `coefficients` at its ends: of one coefficient that is not
 * zero it is linear and goes into MATRIX (PROGRAM_C, PROGRAM_K), of more it is the law that MAKE
 * constructs. */
enum modal_status local_law_polynomial(struct lowering *l, const struct scene_effect *e, int matrix,
                                       enum modal_status (*make)(const double *, int, struct law *,
                                                                 struct modal_error *),
                                       struct modal_error *err);

#endif
