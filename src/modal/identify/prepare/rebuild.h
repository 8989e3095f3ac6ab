/* rebuild.h - what poles make of a record, of constant systems and of periodic ones alike */
#ifndef MODAL_REBUILD_H
#define MODAL_REBUILD_H
#include <complex.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

struct synthesis;

/* Poles with an amplitude for each channel or, of a system with a period of SHIFT samples, for each
 * sample of a period (fold.h). */
struct rebuild_model {
    const double complex *lambda; int count;           /* borrowed */
    double tau;            /* s, of SHIFT samples */
    int shift;             /* 1: constant */
};

/* Columns of the basis times what has an amplitude: of a channel so many numbers are not free. */
int rebuild_order(const struct rebuild_model *p);

/*
 * The fit of the poles to Y (L x S), into F, L x S, or NULL; rows that end in no whole period are
 * those of Y. *fit is the caller's to synthesis_done: its channels are those of Y, each with its
 * phases. Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status rebuild_record(const struct rebuild_model *p, const struct matrix *Y,
                                 struct matrix *F, struct synthesis *fit, struct modal_error *err);
#endif
