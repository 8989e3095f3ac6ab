/* massless.h - dofs without mass eliminated exactly: the damped ones become first-order states, the
 * others vanish
 *
 * Of M q'' + C q' + K q = p, M and K n x n by rows, a dof whose row and column of M are zero
 * carries no mass; if its row and column of C are zero too it is static.  With x the dofs with
 * mass, b the massless damped ones, a the static ones, and no load on b and a, the motion is that
 * of
 *
 *     M x'' + C x' + K x = F b + p,      E b' = A b + Bx x + Bv x',      a = Rx x + Rb b.
 */
#ifndef MODAL_MASSLESS_H
#define MODAL_MASSLESS_H
#include "base/error.h"

/* of two nodes of a shaft, four each */
enum { CONDENSE_MOST = 8, CONDENSE_ROOM = CONDENSE_MOST * CONDENSE_MOST };

struct condensed {
    int nx, nb, na;  /* counts of x, b, a */
    int x[CONDENSE_MOST], b[CONDENSE_MOST], a[CONDENSE_MOST];        /* which dofs, ascending */
    /* nx x nx, by rows with nx a row; the others alike */
    double M[CONDENSE_ROOM], C[CONDENSE_ROOM], K[CONDENSE_ROOM];
    double F[CONDENSE_ROOM];                                         /* nx x nb */
    double E[CONDENSE_ROOM], A[CONDENSE_ROOM];                       /* nb x nb */
    double Bx[CONDENSE_ROOM], Bv[CONDENSE_ROOM];                     /* nb x nx */
    double Rx[CONDENSE_ROOM], Rb[CONDENSE_ROOM];                     /* na x nx, na x nb */
};

/* n <= CONDENSE_MOST.  Fails with MODAL_BAD_INPUT where a static dof has no stiffness or a damped
 * one no damping of its own (the block to be inverted is singular); *OUT is then left alone. */
enum modal_status condense_massless(int n, const double *M, const double *C, const double *K,
                                    struct condensed *out, struct modal_error *err);
#endif
