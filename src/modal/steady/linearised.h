/* linearised.h - a program whose laws are their slopes along a motion, each by its Fourier series
 *
 * What stability looks at: a periodic linear program without laws or loads, whose multipliers
 * floquet.h and hill.h find.  Exact but for where the series of slopes are cut.
 */
#ifndef MODAL_LINEARISED_H
#define MODAL_LINEARISED_H
#include <complex.h>
#include "base/error.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

struct period_channel;

/* D(theta) = Re sum_k harmonic_k e^(ik theta), k = 0 .. top, theta = Omega t: of a force that
 * CHANNEL pushes, by what it sees; N/m of a place, N s/m of a rate. */
struct linearised_slope {
    const struct period_channel *channel;
    int top;                     /* 0: the mean alone */
    const double complex *harmonic;  /* top + 1 of them, borrowed */
};

struct linearised {
    struct program program;      /* its laws and loads left out; the rest is borrowed, but for */
    struct workspace space;      /* the harmonics, and C_0 and K_0 */
};

/*
 * The program of P, whose matrices are borrowed, with COUNT slopes among its K and C at their
 * harmonics.  No channel sees a held number (period_map.h).  *out is the caller's, to
 * linearised_done, also where it fails: MODAL_NO_MEMORY.
 */
enum modal_status linearised_make(const struct program *p, const struct linearised_slope *slope,
                                  int count, struct linearised *out, struct modal_error *err);
/* *L becomes zeros. */
void linearised_done(struct linearised *l);
#endif
