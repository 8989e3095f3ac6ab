/* collocation.h - the linear part of one exponential collocation step, reduced to the places where
 * forces act
 *
 * For y' = A y + B_s w + U phi(t), with phi (m channels) a polynomial in time through its values
 * phi_j at the nodes c_j h, variation of constants is exact:
 *
 *     y(c_i h) = E_i y(0) + G_i w(0) + sum_j W_ij phi_j                                         (1)
 *
 * and read through the rows R (r of them: displacements and rates where laws look)
 *
 *     R y(c_i h) = RE_i y(0) + RG_i w(0) + sum_j H_ij phi_j.                                    (2)
 *
 * The last node is the end, so (1) is kept for it alone.  Whoever iterates on phi sees only (2): m
 * STAGES unknowns, however many states there are.
 */
#ifndef MODAL_COLLOCATION_H
#define MODAL_COLLOCATION_H
#include "modal/scene/sources.h"
#include "modal/scene/statespace.h"

enum { COLLOCATION_STAGES = 4 };   /* of order 7: five digits more as steps are a fifth */

struct collocation;      /* the problem: A, S, U, R, nodes; makes maps and keeps the last ones */

struct collocation_map {
    double h;  /* s */
    /* end: N x N (4 n of 2 x 2 blocks where ss->modal), N x nw, N x (m STAGES) */
    double *E, *G, *W;
    /* node i: r x N at i r N; r x nw; (i, j): r x m at (i STAGES + j) r m */
    double *RE, *RG, *H;
    struct workspace space;  /* of these six */
};

/* SS, SRC are borrowed; U is N x m, R is r x N, both copied. */
enum modal_status collocation_new(const struct statespace *ss, const struct sources *src, int m,
                                  const double *U, int r, const double *R, struct collocation **out,
                                  struct modal_error *err);
/* NULL is accepted. */
void collocation_free(struct collocation *c);

/* The nodes c_1 .. c_STAGES = 1 (Radau) and their weights on f(0): p(0) = sum_j at_zero[j]
 * phi_j. */
const double *collocation_nodes(const struct collocation *c);
/* S weights, borrowed until collocation_free. */
const double *collocation_at_zero(const struct collocation *c);
/* The Lagrange polynomials of the nodes at theta = t / h: STAGES values. */
void collocation_lagrange(const struct collocation *c, double theta, double *l);

/* The map of h: one of those kept, or computed.  Valid until the next call. */
enum modal_status collocation_map(struct collocation *c, double h,
                                  const struct collocation_map **out, struct modal_error *err);
/* Exponentials computed so far, those since dropped included: what a step costs. */
int64_t collocation_maps_made(const struct collocation *c);

/* (1) at the end: y becomes y(h). */
void collocation_finish(const struct collocation *c, const struct collocation_map *map,
                        const double *w, const double *phi, double *y);

#endif
