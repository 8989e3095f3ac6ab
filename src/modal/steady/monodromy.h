/* monodromy.h - the map of a steady state's disturbances over one period, (1) of stability.h */
#ifndef MODAL_MONODROMY_H
#define MODAL_MONODROMY_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/workspace.h"

struct budget;
struct law_pieces;
struct orbit;
struct program;
struct steady;
struct steady_point;

/* A motion, its laws' pieces along it, and the map under way. */
struct monodromy {
    struct steady *s;                  /* for the motion carried on */
    const struct program *p;           /* both borrowed */
    const struct steady_point *point;  /* the motion */
    int n, nz, sliders, order;         /* dofs, linear states, sliders; 2 n + nz + sliders */
    int *first_slider;                 /* per law */
    struct orbit *in;                  /* [law * INPUTS + input]: harmonics only */
    struct law_pieces *pieces;         /* per law; count 0: sampled */
    bool *exact;                       /* per law: it has pieces */
    double *Minv, *K, *C;              /* n x n: (omega^2 M)^-1, K, omega C */
    double *A[3], *work[6];            /* order^2 each */
    double *map;                       /* of the period, or of as much as is done */
    double *cut;                       /* theta, ascending, `cuts` of them and 2 pi */
    int cuts;
    bool varies, mass_varies;          /* A between cuts; M */
    double *z[4];                      /* linear states: what z, y, y' and y'' do to dz/dtheta,
                                        * nz x (nz, n, n, n) */
    int *pivot;                        /* order */
    struct workspace space;            /* of the arrays */
    const char *reason;                /* why there is no map; static text */
    struct budget *budget;             /* the steps are counted in it; spent, they end */
    int H;                             /* of the motion followed: the point's, or more for laws
                                        * with events */
    double complex *X;                 /* kept dofs, [i (H+1) + k] */
};

/*
 * Room and constant matrices of M, whose s, p, point, n, nz, varies and mass_varies are set, and
 * where the period is cut.  m->reason says why there is no map.  Fails with MODAL_NO_MEMORY,
 * MODAL_CANCELLED or as a law does; monodromy_done frees either way.
 */
enum modal_status monodromy_prepare(struct monodromy *m, struct modal_error *err);
/* m->map over one period, in STEPS where matrices vary; m->reason where there is none.  Fails as a
 * law does. */
enum modal_status monodromy_around(struct monodromy *m, int steps, struct modal_error *err);
/* Operations (budget.h) that it takes, at least. */
double monodromy_work(const struct monodromy *m, int steps);
/* Whether every entry of the map is finite. */
bool monodromy_is_finite(const struct monodromy *m);
/* The highest frequency of the constant matrices over omega, at most. */
double monodromy_fastest(const struct monodromy *m);
/* Frees what M holds, not M. */
void monodromy_done(struct monodromy *m);
#endif
