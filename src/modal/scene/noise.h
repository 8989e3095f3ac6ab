/* noise.h - a force of given spectrum, drawn at equal steps */
#ifndef MODAL_NOISE_H
#define MODAL_NOISE_H
#include "base/error.h"

struct noise {
    double psd;      /* one-sided, N^2/Hz */
    double corner;   /* Hz, > 0; HUGE_VAL: white */
    double step;     /* s, > 0 */
    int seed;        /* the same numbers for the same seed, step and count */
};

/*
 * COUNT values into VALUES, of a normal process p(t) that is linear between them and has the
 * one-sided density psd / (1 + (f / corner)^2) at 0 < f < 1 / (2 step).  Fails with
 * MODAL_NO_MEMORY.
 */
enum modal_status noise_draw(const struct noise *n, int count, double *values,
                             struct modal_error *err);

#endif
