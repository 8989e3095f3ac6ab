/* hill_window.h - the exponents of a large sparse periodic program that lie nearest to a point
 *
 * Where the period map of a stiff structure takes too many steps, or multipliers crowd on the
 * circle, they are found one neighbourhood after another, by sparse factors of Hill's matrix.
 */
#ifndef MODAL_HILL_WINDOW_H
#define MODAL_HILL_WINDOW_H
#include <complex.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

struct hill_window {
    int count;                   /* settled ones, ascending in distance; one copy of each pair */
    double radius;               /* within which of SHIFT none is missing */
    double complex *exponent;    /* not folded: with `middle` W in its imaginary part */
    double *residual;            /* of the multiplier, over its size: |Phi y - rho y| / |rho y| */
    /* what the multiplier may move by over its size, as the residual, as entries of P's matrices
     * are known to rounding: exact motions of these move so as well */
    double *rounding;
    double *condition;           /* of the exponent, >= 1 */
    double *edge;                /* share of the motion in the outermost harmonics that were kept */
    int *middle;                 /* the harmonic that its motion has most of */
    double complex *start;       /* 2 n x count: (x, x') at t = 0, unit norm in roots of energies */
    double work;                 /* operations (budget.h) that it took, nearly */
    double factors;              /* dense operations of one factorization */
    struct workspace space;      /* of the arrays */
};

/*
 * WANTED exponents next to SHIFT of P over PERIOD, laws and loads left out, from 2 HARMONICS + 1
 * terms of their Fourier series of W (hill_window_frequency).  HARMONICS 0: those of the constant
 * part.  SEED chooses where the search starts: a value that is double has its second vector from
 * another.  P is one that period_map_serves.  Fails with MODAL_TOO_LARGE (HILL_WINDOW_BYTES),
 * MODAL_NO_CONVERGENCE (SHIFT is an exponent), MODAL_NO_MEMORY.  hill_window_done frees.
 */
enum modal_status hill_window(const struct program *p, double period, double complex shift,
                              int harmonics, int wanted, int seed, struct hill_window *out,
                              struct modal_error *err);
/* W, rad/s: the largest of which all of P's harmonics are whole multiples.  PERIOD holds whole
 * cycles of it, one or more; of a P without harmonics one. */
double hill_window_frequency(const struct program *p, double period);
/* The highest harmonic of P, of W; 0: there is none. */
int hill_window_reach(const struct program *p);
/* Vectors at most for WANTED exponents. */
double hill_window_vectors(int wanted);
/* Operations (budget.h) of VECTORS with ENTRIES each, and of dense ones for FACTORS, nearly. */
double hill_window_work(double entries, double vectors, double factors);
/* *H becomes zeros. */
void hill_window_done(struct hill_window *h);

enum { HILL_WINDOW_BYTES = 400000000 };  /* of vectors: less than half of what a worker may have */
#endif
