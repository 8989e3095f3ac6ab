/* sources.h - excitation as the output of small linear systems, so that stepping integrates it
 * exactly
 *
 * Between its corners every load is a sum of solutions of constant equations: p(t) = P w, w' = S w,
 * with blocks
 *
 *     constant (1)   ramp (f, f')   oscillator (cos, sin)
 *     and their products with (cos, sin) of turning axes.
 *
 * w is known in closed form at every instant; corners (ends of pulses, points of tables) and
 * impulses are listed in time.
 */
#ifndef MODAL_SOURCES_H
#define MODAL_SOURCES_H
#include <stdbool.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

/* three states of a load, twice on turning axes */
enum { SOURCES_BLOCK_MOST = 6 };

struct source_block { int first, count; };       /* rows of w that S couples with each other only */

struct source_corner {
    double t;  /* s */
    /* an impulse: N s on this dof; -1: a corner only */
    int dof;
    double impulse;  /* 0 of a corner only */
};

struct sources {
    int n, nw;  /* dofs, rows of w */
    double *S;                                    /* nw x nw by columns, or NULL */
    double *P;                                    /* n x nw by columns, or NULL */
    int blocks;
    struct source_block *block;
    int corners;
    struct source_corner *corner;                 /* ascending in t, those at t >= 0 */
    const struct program *p;                      /* borrowed */
    double turns, turned_at, cosine, sine;        /* rad/s, s: of the last sources_force */
    int *first;                                   /* of each load: its first row of w; -1: none */
    struct workspace space;                       /* of the arrays */
};

/* P is borrowed until sources_free.  STEPPED: with S and P, which are dense; else they are NULL.
 * Fails with MODAL_NO_MEMORY. */
enum modal_status sources_new(const struct program *p, bool stepped, struct sources **out,
                              struct modal_error *err);
/* NULL is accepted. */
void sources_free(struct sources *s);

/* w just after t (at a corner: what holds from there on). */
void sources_at(const struct sources *s, double t, double *w);

/* The force of one of the program's loads just after t, on fixed axes; 0 of an impulse. */
double sources_force(struct sources *s, int load, double t);

#endif
