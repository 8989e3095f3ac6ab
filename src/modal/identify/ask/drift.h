/* drift.h - are poles that stand close together modes, or modes that drift? */
#ifndef MODAL_DRIFT_H
#define MODAL_DRIFT_H
#include <complex.h>
#include "base/error.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/result.h"

/* Fewer groups may be so by chance. */
enum { DRIFT_LEAST = 3 };

/*
 * Of the COUNT poles LAMBDA of a fit to DATA of a constant system, with signals' NOISE (refine.h):
 * the groups of poles of one shape whose lines overlap, and those of them that one mode, its
 * frequency and its damping changing evenly, explains for less (drift.c).  Where DRIFT_LEAST and
 * more than half of the groups are such modes: the diagnostic changes_in_record, its frequency
 * raised by HERTZ.  So a record of so many modes is asked that no window shows them one by one.
 * Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status drift_watch(const struct refine_data *data, const double complex *lambda,
                              int count, const double *noise, double hertz,
                              struct identify_result *result, struct modal_error *err);
#endif
