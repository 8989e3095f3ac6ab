/* statespace.h - a program's linear part as y' = A(t) y + B p(t), in scaled modal coordinates
 *
 * With M_0 = positive definite, K_s the symmetric part of K_0 and K_s Phi = M_0 Phi diag(w2), Phi^T
 * M_0 Phi = I, the state is
 *
 *     y = (s_i q_i, q_i', z),   x = Phi q,   s_i = sqrt|w2_i| (bounded below),                  (1)
 *
 * so that every entry of y is the root of an energy and A is skew up to damping and what is
 * unsymmetric: exponentials and eigenvalues of stiff and soft modes are then as exact as each
 * other.
 */
#ifndef MODAL_STATESPACE_H
#define MODAL_STATESPACE_H
#include <stdbool.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

enum {
    STATESPACE_DOFS_MOST = 1500,      /* modes of the pair, 9 n^3: some seconds */
    STATESPACE_STATES_MOST = 4000,    /* a dense matrix of 128 MB */
};

/* Scale of a mode without stiffness, as a share of the largest: w^2 of 1e-14 is rounding of the
 * pair. */
#define STATESPACE_RIGID 1e-7

struct statespace {
    const struct program *p;     /* borrowed */
    int n, nz, N;                /* dofs, linear states, 2 n + nz */
    double *phi;                 /* n x n by columns */
    double *s;                   /* n, (1) */
    double *A;                   /* N x N by columns: the constant part */
    double *B;                   /* N x n: what a unit force on a dof does to y' */
    /* of A(t) = A + sum_h Ac_h cos(k_h Omega t) + As_h sin(k_h Omega t) */
    int harmonics;
    struct statespace_harmonic { int k; double *cosine, *sine; } *harmonic;    /* N x N each */
    struct workspace space;      /* of the arrays */
    /* A, the constant part, falls into n 2 x 2 blocks: rows and columns i, n + i */
    bool modal;
};

/* Fails with MODAL_TOO_LARGE, MODAL_NO_MEMORY, MODAL_BAD_INPUT (a singular E of linear states;
 * pulsating mass). */
enum modal_status statespace_new(const struct program *p, struct statespace **out,
                                 struct modal_error *err);
/* NULL is accepted. */
void statespace_free(struct statespace *ss);

/* The program's initial state; linear states start at 0. */
void statespace_start(const struct statespace *ss, double *y);
/* A at time t into OUT, N x N. */
void statespace_at(const struct statespace *ss, double t, double *out);
/* Displacements by dof. */
void statespace_motion(const struct statespace *ss, const double *y, double *x);

#endif
