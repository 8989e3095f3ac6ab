/* disturbance.h - the laws of a steady state's disturbances: their slopes along the motion, and
 * where these jump, (1) of stability.h
 */
#ifndef MODAL_DISTURBANCE_H
#define MODAL_DISTURBANCE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/law.h"

struct budget;
struct law_piece;
struct law_pieces;
struct orbit;
struct program;
struct steady;
struct steady_point;

/* A motion and its laws' pieces along it. */
struct disturbance {
    struct steady *s;                  /* for the motion carried on */
    const struct program *p;           /* both borrowed */
    const struct steady_point *point;  /* the motion */
    struct budget *budget;             /* what follows is counted in it */
    int n, nz, sliders;                /* dofs, linear states, sliders */
    int *first_slider;                 /* per law */
    struct orbit *in;                  /* [law * LAW_INPUTS_MOST + input]: harmonics only */
    struct law_pieces *pieces;         /* per law; count 0: sampled */
    bool *exact;                       /* per law: it has pieces */
    double *cut;                       /* theta, ascending, `cuts` of them and 2 pi */
    int cuts;
    bool varies;                       /* slopes or matrices between cuts */
    int H;                             /* of the motion followed: the point's, or more for laws
                                        * with events */
    double complex *X;                 /* kept dofs, [i (H+1) + k] */
    const char *reason;                /* why it is not linearised; static text */
    struct workspace space;            /* of the arrays */
};

/* Sizes of U, whose s, p, point and budget are set.  Fails with MODAL_NO_MEMORY; disturbance_done
 * frees either way. */
enum modal_status disturbance_begin(struct disturbance *u, struct modal_error *err);
/* The rest of U, or u->reason.  Fails with MODAL_NO_MEMORY, MODAL_CANCELLED or as a law does. */
enum modal_status disturbance_follow(struct disturbance *u, struct modal_error *err);
/* Slopes of law L at THETA in [0, 2 pi), and for each of its sliders whether it sticks there (its
 * gain, else 0).  Fails as the law does. */
enum modal_status disturbance_slopes(const struct disturbance *u, int l, double theta,
                                     double gd[][LAW_INPUTS_MOST],
                                     double gv[][LAW_INPUTS_MOST], double *held,
                                     struct modal_error *err);
/* Whether THETA, in [0, 2 pi), lies in a piece, which may run past 2 pi. */
bool disturbance_covers(const struct law_piece *piece, double theta);
/* theta in [0, 2 pi). */
double disturbance_wrap(double theta);
/* Frees what U holds, not U. */
void disturbance_done(struct disturbance *u);
#endif
