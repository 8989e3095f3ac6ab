/* slip.h - does a record of a periodic system keep the period that it was given? */
#ifndef MODAL_SLIP_H
#define MODAL_SLIP_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * The record's own turns against those of its period, of which it has N: after x of these it has
 * turned
 *
 *     x + ends u + 4 bow u (1 - u),     u = x / N.                                              (1)
 *
 * A period that is too short by a share e has ends = -e N; where the speed falls evenly by a share
 * s from the first turn to the last, bow is s N / 8, and ends depends on which of them the period
 * is of.
 */
struct slip {
    double ends, bow;           /* turns; 0: none */
    double std_ends, std_bow;
    double gain;                /* of the logarithm of (2) of slip.c, over none; 0: none found */
    double turns;               /* N */
};

struct slip_record {
    const struct matrix *Y;     /* channels, borrowed */
    double each;                /* rows of a turn, by the period given */
    const double *noise;        /* per channel: what is no motion, rms */
    int order;                  /* real numbers of the motion, as found with that period */
};

/* *out of R.  Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE. */
enum modal_status slip_find(const struct slip_record *r, struct slip *out, struct modal_error *err);

/* turn[k], k < ROWS, EACH a turn of the period: what has turned by row k, (1). */
void slip_turns(const struct slip *s, double each, int rows, double *turn);
#endif
