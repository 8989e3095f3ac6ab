/* ambient_drift.h - what moves more slowly than the record tells */
#ifndef MODAL_AMBIENT_DRIFT_H
#define MODAL_AMBIENT_DRIFT_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* Lines of a spectrum that polynomials of the degree that is taken off leave nothing of. */
enum { AMBIENT_DRIFT_LINES = 4 };

/*
 * Y (samples x channels, without means) less a polynomial in time, where that holds far more than
 * its neighbourhood in the spectrum explains.  *share: of all columns' mean square, how much was
 * taken off; 0: there is no drift and Y is as it was.  Fails with MODAL_NO_MEMORY, MODAL_BAD_INPUT
 * (too few samples; see spectrum.h).
 */
enum modal_status ambient_drift_take(struct matrix *Y, double *share, struct modal_error *err);
#endif
