/* bound.h - what missing samples and steps of unknown size cost the standard errors of poles */
#ifndef MODAL_BOUND_H
#define MODAL_BOUND_H
#include "base/error.h"
#include "modal/identify/prepare/rebuild.h"
#include "modal/identify/prepare/steps.h"
#include "modal/identify/prepare/wild.h"
#include "modal/linalg/matrix.h"

/*
 * FACTOR, 2 of each pole: the Cramer-Rao bounds of the poles' real and imaginary parts from the
 * samples of Y (L x S) that are not WILD, with the sizes of STEPS fitted, over those of Y as if all
 * of it were known (bound.c). Y has the wild samples rebuilt and is without the steps. 1 where the
 * poles are so ill determined that the bounds are not known. Fails with MODAL_NO_MEMORY,
 * MODAL_NO_CONVERGENCE.
 */
enum modal_status bound_factors(const struct rebuild_model *poles, const struct matrix *Y,
                                const struct wild *wild, const struct steps *steps,
                                double *factor, struct modal_error *err);
#endif
