/* craig_bampton.h - a program with few dofs kept and the others in the modes they have while those
 * are held fast
 *
 * With x = (x_b, x_i), b the dofs kept and i the others,
 *
 *     x_i = Psi x_b + Phi eta,   Psi = -K_ii^-1 K_ib,   K_ii Phi = M_ii Phi diag(lambda),       (1)
 *
 * [CB68]: static deflections and the modes of least frequency.  M, C and K become T^T M T and so
 * on, laws and loads stay as they are, on dofs that are kept.
 *
 * [CB68] Craig and Bampton, Coupling of substructures for dynamic analyses, AIAA J. 6 (1968)
 * 1313-1319. */
#ifndef MODAL_CRAIG_BAMPTON_H
#define MODAL_CRAIG_BAMPTON_H
#include "base/error.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

struct craig_bampton {
    int kept, modes;            /* b; at most as many as asked for, and as there are */
    int *dofs;                  /* of the program, ascending: those kept, first in both below */
    double highest, next;       /* rad/s: of the last mode kept, the first left out (HUGE_VAL:
                                 * none) */
    double reach;               /* rad/s of the last mode of `finer`; HUGE_VAL: it has all */
    /* Both borrow effects, laws' numbers and tables of loads from the program, and are not to be
     * freed by program_free. */
    struct program reduced;
    /* the like with twice the modes, and with the statics of all others under the inertia and
     * damping of (1): what it moves is what `reduced` lacks */
    struct program finer;
    struct workspace space;     /* of the arrays */
};

/*
 * Of P, which outlives *OUT, with MODES of them, and the COUNT dofs of DOFS kept besides those of
 * laws, loads and periodic matrices.  Fails with MODAL_BAD_INPUT, field "reduce": matrices that are
 * not symmetric, linear states, nothing left to reduce, dofs that are loose while the others are
 * held fast; MODAL_TOO_LARGE, MODAL_NO_CONVERGENCE, MODAL_NO_MEMORY.
 */
enum modal_status craig_bampton_new(const struct program *p, const int *dofs, int count, int modes,
                                    struct craig_bampton **out, struct modal_error *err);
void craig_bampton_free(struct craig_bampton *a);       /* NULL too */
/* The index among those kept of the program's DOF, or -1. */
int craig_bampton_find(const struct craig_bampton *a, int dof);
#endif
