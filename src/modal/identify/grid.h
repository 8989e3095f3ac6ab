/* grid.h - the step of the grid that a converter or a printed table rounds to */
#ifndef MODAL_GRID_H
#define MODAL_GRID_H
#include <stddef.h>

enum { GRID_VALUES_LEAST = 8, GRID_SAMPLES = 4096 };

/*
 * The largest q such that all of x[0], x[stride], .. (L of them) differ by whole multiples of q, to
 * the rounding of double or, failing that, of single precision; 0 where there is none coarser than
 * 1e-10 of the largest difference, or fewer than GRID_VALUES_LEAST values, or no memory. Exact
 * numbers may lie on a grid too, whole ones say: whether q is noise is seen by what a fit leaves
 * (GRID_NOISE).
 */
double grid_step(const double *x, size_t stride, int L);

/* Mean square of a rounding error, over q^2: uniform; and the most that a sine can have, one that
 * just stays below half a step and is rounded to nothing. */
#define GRID_NOISE (1.0 / 12)
#define GRID_NOISE_MOST (1.0 / 8)
#endif
