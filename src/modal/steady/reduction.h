/* reduction.h - what a session that reduces its linear part leaves out, told by one that leaves out
 * less
 *
 * The point is solved again, from itself, with craig_bampton.h's `finer`; how far that moves the
 * counted dofs is the error of the reduction.  Harmonics of which finer's own statics know less
 * than half, those past its reach / sqrt(2), count as wrong by all of themselves.
 */
#ifndef MODAL_REDUCTION_H
#define MODAL_REDUCTION_H
#include "base/error.h"

struct steady;
struct steady_point;

/* Into point->reduction, and on top of point->error, of a converged POINT of S whose error is that
 * without: 0 where S does not reduce, NAN where no like motion is found. */
enum modal_status reduction_error(struct steady *s, struct steady_point *point,
                                  struct modal_error *err);
/* POINT's like of *FINER, which S owns; not converged where there is none, and then, as where S
 * does not reduce, there is nothing to compare with. */
enum modal_status reduction_solve(struct steady *s, const struct steady_point *point,
                                  struct steady **finer, struct steady_point *out,
                                  struct modal_error *err);
#endif
