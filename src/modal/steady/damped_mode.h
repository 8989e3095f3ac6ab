/* damped_mode.h - a mode of M x'' + C x' + K x = 0 with any C */
#ifndef MODAL_DAMPED_MODE_H
#define MODAL_DAMPED_MODE_H
#include <complex.h>
#include "base/error.h"

struct damped_mode {
    int swinging;                /* pairs of exponents that are not real */
    double omega, damping_ratio; /* |lambda| in rad/s, -Re lambda / |lambda| */
};

/*
 * Mode MODE (from 1) of those that swing, by ascending omega, of the N x N matrices; SHAPE: n, of
 * shape^H M shape = 1, its largest entry real and positive.  Where MODE is above out->swinging
 * SHAPE is left as it was.  K and C are destroyed.  Fails with MODAL_BAD_INPUT (M is singular),
 * MODAL_NO_CONVERGENCE, MODAL_NO_MEMORY.
 */
enum modal_status damped_mode(const double *M, double *K, double *C, int n, int mode,
                              double complex *shape, struct damped_mode *out,
                              struct modal_error *err);
#endif
