/* grid.h - to what a converter, a printed table or single precision has rounded the samples */
#ifndef MODAL_GRID_H
#define MODAL_GRID_H
#include <stdbool.h>
#include <stddef.h>

/* What is asked of values, and of channels, that a grid is looked for in. */
enum {
    GRID_CHANNELS = 16,             /* asked of many: one converter is behind all */
    GRID_LEAVES = 4,                /* steps that it moves smooth differences by (stuck.c) */
    GRID_VALUES_LEAST = 8,          /* steps between values: fewer lie on some grid by chance */
    GRID_SAMPLES = 4096             /* looked at: they are sorted */
};

/*
 * The largest q such that all of x[0], x[stride], .. (L of them) differ by whole multiples of q, to
 * the rounding of double or, failing that, of single precision; 0 where there is none coarser than
 * 1e-10 of the largest difference, or fewer than GRID_VALUES_LEAST values, or no memory. Exact
 * numbers may lie on a grid too, whole ones say: whether q is noise is seen by what a fit leaves,
 * q^2 / 12 in the mean square where its rounding is uniform.
 */
double grid_step(const double *x, size_t stride, int L);

/* What the samples of a channel were rounded to. */
struct grid {
    double step;                 /* 0: to nothing coarser than double precision */
    bool floating;               /* to significant digits: each to a step that goes with its size,
                                  * and `step` is the root of their mean square */
};

/*
 * The steps of L samples of decimal digits, 13 at most, or of single precision, into q[0 .. L-1]
 * where that is not NULL, 0 of a sample that is 0.  Returns their root mean square; 0 where a
 * sample has more digits, or where fewer than GRID_VALUES_LEAST steps are coarser than LEAST: so
 * many end in a zero by chance.
 */
double floating_steps(const double *x, size_t stride, int L, double least, double *q);

/* So few samples, spread over a channel, say of nearly every one that it has no grid. */
enum { GRID_FIRST = 64 };
/* May a channel lie on a grid that has these N samples, GRID_FIRST at most? */
bool grid_may_be(const double *some, int n);

/* The grid of L samples, floating by those of every so many from the FIRST on. */
struct grid grid_of_rows(const double *x, size_t stride, int L, int first, int every);

/* The same, floating by GRID_SAMPLES of them or more, spread over all. */
struct grid grid_of(const double *x, size_t stride, int L);

/* Is a response of less than a step rounded to nothing? */
bool grid_ends(const struct grid *grid);

/* Mean square of a rounding error, over q^2: the most that a sine can have, one that just stays
 * below half a step and is rounded to nothing. */
#define GRID_NOISE_MOST (1.0 / 8)
#endif
