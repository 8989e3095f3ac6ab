/* torus_laws_state.h - what torus_laws.c and torus_slopes.c share */
#ifndef MODAL_TORUS_LAWS_STATE_H
#define MODAL_TORUS_LAWS_STATE_H
#include "modal/scene/program.h"
#include "modal/steady/torus_laws.h"

struct event { int line; double theta, slope[LAW_INPUTS_MOST], bend[LAW_INPUTS_MOST]; };

struct torus_law {
    const struct law *law;
    int *place;                         /* of each end: its dof among those that iterate */
    bool acts, undetermined;
    int lines, *turns;                  /* of history that sufficed last, of each line */
    long evaluations;
    struct event *event;
    int events, room;
    double *slopes;                     /* fd, then fv, [i][j][point], of the last forces */
};

struct torus_laws {
    struct torus_tones tones;
    int q, laws;
    struct torus_law *law;
    struct budget *work;
    bool held;                          /* torus_hold */
    size_t points;                      /* that the arrays below have room for */
    double *d, *v;                      /* [input][point]: of the turn at hand */
    double *f, *fd, *fv;                /* [i], [i][j]: of one law at the samples */
    double complex *D;                  /* a law's inputs' combinations */
    int combinations;                   /* that D has room for */
};
#endif
