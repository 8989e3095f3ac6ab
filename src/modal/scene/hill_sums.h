/* hill_sums.h - pairs of motions that what pulsates makes grow by the sum of their frequencies
 *
 * Two motions of the constant part grow where their frequencies' sum is a harmonic's that couples
 * them by more than they are damped.  From their exponents and shapes it is known, to first order
 * in what pulsates, where that may be: there windows of Hill's matrix are worth their cost.  Shapes
 * are taken for the left ones too, as they are where all matrices are symmetric.
 */
#ifndef MODAL_HILL_SUMS_H
#define MODAL_HILL_SUMS_H
#include <complex.h>
#include <stdbool.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

struct hill_window;

struct hill_sums {
    const struct program *p;     /* borrowed */
    int ports, *port, *place;    /* dofs that something pulsating acts on or sees; of dof, or -1 */
    int count, room;
    double complex *exponent;    /* ascending in Im */
    double complex *shape;       /* ports x count: displacements, x^T (2 lambda M + C) x = 1 */
    double *weight;              /* of a window's starts (dofwise.h) */
    struct workspace space;      /* of the arrays but exponent and shape */
};

/* An exponent to first order; RAISED by so much above the least damped one of its motions. */
struct hill_sum { double complex exponent; double raised; };

/* For P over PERIOD.  Fails with MODAL_NO_MEMORY.  hill_sums_done frees, on failure too. */
enum modal_status hill_sums_new(const struct program *p, double period, struct hill_sums *out,
                                struct modal_error *err);
/* Those of CONSTANT, a window of no harmonics, with FROM < Im <= TO, which are above all so far.
 * Fails with MODAL_TOO_LARGE (HILL_SUMS_NUMBERS), MODAL_NO_MEMORY. */
enum modal_status hill_sums_add(struct hill_sums *s, const struct hill_window *constant,
                                double from, double to, struct modal_error *err);
/* The COUNT exponents whose real part would reach LEAST if they were raised by MARGIN times as much
 * more, descending in real part; the caller frees *OUT.  Fails with MODAL_NO_MEMORY,
 * MODAL_NO_CONVERGENCE. */
enum modal_status hill_sums_find(const struct hill_sums *s, double least, double margin,
                                 struct hill_sum **out, int *count, struct modal_error *err);
/* *S becomes zeros. */
void hill_sums_done(struct hill_sums *s);

enum { HILL_SUMS_NUMBERS = 10000000 };   /* of shapes, 160 MB: a fifth of what a worker may have */
#endif
