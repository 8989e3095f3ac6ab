/* hill.h - the exponents of a linear periodic program by Hill's infinite determinant, cut off: a
 * second way to floquet.h */
#ifndef MODAL_HILL_H
#define MODAL_HILL_H
#include <complex.h>
#include "modal/scene/program.h"

/* of a dense matrix whose eigenvalues take seconds: 10 n^3 complex */
enum { HILL_SIZE_MOST = 1000 };

struct hill {
    int count;                   /* 2 n + linear states */
    int harmonics;               /* H: Fourier terms -H .. H of the Floquet modes were kept */
    double complex *exponent;    /* principal values, |Im| <= pi / T, descending in real part */
    /* the largest change of an exponent from a smaller H (by A's highest harmonic) to this one,
     * 1/s */
    double truncation;
};

/*
 * HARMONICS 0: 12, doubled while the truncation exceeds 1e-10 of 2 pi / T and count (2 H + 1) stays
 * within HILL_SIZE_MOST / 2 (fewer than 12 where that is passed at once).  Fails with
 * MODAL_BAD_INPUT (laws), MODAL_TOO_LARGE, MODAL_NO_CONVERGENCE, MODAL_NO_MEMORY.  hill_done frees.
 */
enum modal_status hill(const struct program *p, int harmonics, struct hill *out,
                       struct modal_error *err);
/* H's array; H itself is the caller's and becomes zeros. */
void hill_done(struct hill *h);

#endif
