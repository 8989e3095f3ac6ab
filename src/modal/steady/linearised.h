/* linearised.h - a program whose laws are their slopes along a motion, each by its Fourier series
 */
#ifndef MODAL_LINEARISED_H
#define MODAL_LINEARISED_H
#include <complex.h>
#include "base/error.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

struct period_channel;

/* D(theta) = Re sum_k harmonic_k e^(ik theta), k = 0 .. top, seen and pushed by CHANNEL. */
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
 * Of P and COUNT slopes, no channel of which is of a held number.  Fails with MODAL_NO_MEMORY;
 * linearised_done frees either way.
 */
enum modal_status linearised_make(const struct program *p, const struct linearised_slope *slope,
                                  int count, struct linearised *out, struct modal_error *err);
/* *L becomes zeros. */
void linearised_done(struct linearised *l);
#endif
