/* rounding.h - channels that hold nothing but the rounding errors of the others */
#ifndef MODAL_ROUNDING_H
#define MODAL_ROUNDING_H
#include "base/error.h"
#include "modal/identify/prepare/record.h"

/* A channel of less rms than this beside the largest may be rounding: see rounding.c for when it
 * is. */
#define ROUNDING_RATIO 1e-13

/*
 * Make zero the channels of R, scaled already, that are below rounding: scale and column 0,
 * R->below true.  At least the largest stays. Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status rounding_channels(struct record *r, struct modal_error *err);
#endif
