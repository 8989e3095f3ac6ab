/* monodromy.h - the map of a steady state's disturbances over one period, (1) of stability.h */
#ifndef MODAL_MONODROMY_H
#define MODAL_MONODROMY_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/workspace.h"

struct budget;
struct disturbance;
struct program;
struct steady_point;

/* The map under way. */
struct monodromy {
    struct disturbance *of;            /* borrowed; its reason where there is no map */
    const struct program *p;           /* these four are its own */
    const struct steady_point *point;
    struct budget *budget;             /* the steps are counted in it; spent, they end */
    int n, nz, order;                  /* dofs, linear states; 2 n + nz + sliders */
    double *Minv, *K, *C;              /* n x n: (omega^2 M)^-1, K, omega C */
    double *A[3], *work[6];            /* order^2 each */
    double *map;                       /* of the period, or of as much as is done */
    bool mass_varies;                  /* M does */
    double *z[4];                      /* linear states: what z, y, y' and y'' do to dz/dtheta,
                                        * nz x (nz, n, n, n) */
    int *pivot;                        /* order */
    struct workspace space;            /* of the arrays */
};

/* Room and constant matrices of M, whose `of` is set and followed; or its reason.  Fails with
 * MODAL_NO_MEMORY; monodromy_done frees either way. */
enum modal_status monodromy_prepare(struct monodromy *m, struct modal_error *err);
/* m->map over one period, in STEPS where matrices vary; its reason where there is none.  Fails as a
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
