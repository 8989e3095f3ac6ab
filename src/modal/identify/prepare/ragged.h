/* ragged.h - whether a spectrum is as ragged as that of a response which noise drives */
#ifndef MODAL_RAGGED_H
#define MODAL_RAGGED_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * *ragged: the record Y (samples x signals, borrowed) is no sum of exponentials that its spectrum
 * resolves, in white noise; of such sums less than 1 in 10^5 is (ragged.c). A short driven response
 * may not be told. Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status ragged_spectrum(const struct matrix *Y, bool *ragged, struct modal_error *err);
#endif
