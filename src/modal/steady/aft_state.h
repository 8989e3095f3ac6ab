/* aft_state.h - what aft.c, aft_events.c and aft_derivative.c share */
#ifndef MODAL_AFT_STATE_H
#define MODAL_AFT_STATE_H
#include "modal/linalg/workspace.h"
#include "modal/scene/law.h"
#include "modal/scene/orbit.h"
#include "modal/scene/pieces.h"
#include "modal/steady/aft.h"

static const double TWO_PI = 6.283185307179586477;   /* a period of theta */

/* One law: its motion, its force, and what its derivative is made of. */
struct aft_law {
    const struct law *law, *given;          /* now, and of the program */
    struct law soft;                        /* given's like with softer springs; else empty */
    int *place;                             /* of each end of the law: its retained dof */
    struct orbit in[LAW_INPUTS_MOST];
    struct law_pieces pieces;               /* of the last force, where exact */
    bool exact, acts, undetermined;         /* has pieces; in the last force: acted, one of many */
    bool sloped;                            /* fd and fv are of this motion */
    int rounds;                             /* periods until the memory repeated */
    bool stiff;                             /* its force is far smaller than its terms: no
                                             * samples */
    long evaluations;
    int memory;                             /* doubles that it remembers */
    double *f, *fd, *fv;                    /* samples: [i][N], [i][j][N] */
    double *z;                              /* memory, twice */
    double complex *F;                      /* [i][H+1] */
    double complex *gain, *damp;            /* [i][j][2H+1], two-sided m >= 0 */
    double complex *level, *cross;          /* pieces': [i][2H+1], [3H+1] */
    bool levels, gains, damps, crosses;     /* which of them are not 0 throughout */
    double complex *ends;                   /* e^{-i theta} where piece s begins, [2 s], and ends */
    int ends_room;                          /* pieces that `ends` has room for */
};

/* The laws of a program on H harmonics and N samples. */
struct aft {
    int q, H, N, laws, room, HJ;          /* HJ: of derivatives */
    bool located;                         /* pieces are asked for */
    double omega, summed;                 /* products of (2) of aft_events.c so far */
    struct orbit_grid *grid;              /* N instants, its transforms counted */
    struct aft_law *law;
    double complex *mask, *wave, *product;  /* `room` each */
    double complex *before, *after;         /* e^{-i m theta} where a piece begins and ends,
                                             * `room` each */
    double *block, *samples;                /* (2H+1)^2; N */
    double *inverse;                        /* 1 / (2 pi m) */
    struct workspace space;                 /* of these arrays and the laws', but `block`, `ends` */
};
#endif
