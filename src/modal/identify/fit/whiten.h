/* whiten.h - noise that a sample's neighbours in its period tell of, made white */
#ifndef MODAL_WHITEN_H
#define MODAL_WHITEN_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * Y and E are L periods of S columns, `phases` samples of each signal in a row, E what a fit of
 * ORDER columns leaves of Y. Each signal's noise is predicted from the samples before it in its
 * period (whiten.c); where that lowers -2 ln(likelihood) of all signals by more than LEAST beside
 * its price, every sample of Y becomes what its neighbours do not tell, in its place. Rows are
 * multiplied by one matrix from the right: amplitudes change, multipliers do not.
 *
 *   told   the share of the noise's variance that was told, the signals alike; 0: Y is as it was
 *
 * Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status whiten_rows(const struct matrix *E, int phases, int order, double least,
                              struct matrix *Y, double *told, struct modal_error *err);
#endif
