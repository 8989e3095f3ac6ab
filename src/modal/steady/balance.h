/* balance.h - the equation of harmonic balance on the kept dofs, its residual and its derivative
 *
 *     R_k(X) = S_k X_k + F_k(X) + T_k(X) - p_k,   k = 0 .. H                                    (1)
 *
 * S and p of condense.h, F the laws' (aft.h), T the periodic matrices' of program.h (3), exact by
 * convolution. */
#ifndef MODAL_BALANCE_H
#define MODAL_BALANCE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/workspace.h"

struct aft;
struct blocks;
struct budget;
struct by_harmonic;
struct by_inputs;
struct condense;
struct joint;
struct pattern;
struct program;
struct stiffness;

/* One order's balance; what is not `borrowed` it owns.  Its fields are read by the solvers, set
 * here. */
struct balance {
    const struct program *p;         /* borrowed, as c is */
    struct condense *c;
    struct aft *aft;                 /* the laws, on H harmonics */
    int q, H, order;                 /* order = q (2H + 1) */
    double omega, level;             /* rad/s; what loads are multiplied by */
    const struct pattern *pattern;   /* of S */
    double complex *S, *load;        /* as condense_at gives them, with damping of */
    double damping;                  /* balance_set_damping in S */
    struct stiffness *stiffness;     /* S_k factored, those that were asked for */
    double complex *F;               /* F + T of the last residual, [i (H+1) + k] */
    double *R, *J, *row;             /* residual, derivative (then its factors), row scales */
    struct blocks *blocks;           /* the derivative, where the pattern is not full: no J then */
    struct by_harmonic *apart;       /* its harmonics' own factors; NULL: not yet asked for */
    struct joint *joint;             /* what laws read, the session's; NULL: not looked at */
    struct by_inputs *inputs;        /* the derivative, where that is what it is kept of */
    bool on_inputs;                  /* the last derivative is, and no blocks */
    bool whole;                      /* blocks are asked for: their columns, or their sign */
    bool iterates, direct;           /* the last factors are those; blocks of this order have been
                                      * found better factored whole */
    int *pivot;                      /* of J's factors */
    int HJ, small;                   /* J is of harmonics 0 .. HJ, order `small`; past HJ
                                      * balance_solve takes S_k alone */
    double *gather, *kept;           /* `small`: what J solves for; the same, kept */
    double complex *sum;             /* q */
    double forcing;                  /* what balance_solve may leave where it iterates */
    bool factored;                   /* J or blocks hold factors */
    double rcond;                  /* of the last factorization: the least pivot over the largest */
    struct workspace space;          /* of the arrays, but J: there where it is asked for */
    struct budget *budget;           /* where the work is counted, the caller's; NULL: nowhere */
};

/* LOCATED as aft_new's.  C is borrowed, and shared by balances of several H.  N > 2 H. */
enum modal_status balance_new(const struct program *p, struct condense *c, int H, int N,
                              bool located, struct balance **out, struct modal_error *err);
/* Frees B and all that it made, not what it borrows; NULL is none. */
void balance_free(struct balance *b);

/* Fix frequency and the loads' level; X, R, F become stale. */
enum modal_status balance_set(struct balance *b, double omega, double level,
                              struct modal_error *err);
/* Another level at the same frequency: loads only. */
void balance_set_level(struct balance *b, double level);
/* Dampers to the ground beside those of the structure, until balance_set: each kept dof's has at
 * omega SHARE of the dof's own stiffness, the larger of |S_0| and |S_1|. */
void balance_set_damping(struct balance *b, double share);
/* b->R of X, of any order; with DERIVATIVE b->J or b->blocks too, not yet factored:
 * MODAL_TOO_LARGE past 12000 unknowns of a full pattern. */
enum modal_status balance_residual(struct balance *b, const double complex *X, bool derivative,
                                   struct modal_error *err);
/* b->J at the X of the last residual, which had none yet. */
enum modal_status balance_derivative(struct balance *b, struct modal_error *err);
/* Whether derivatives are solved on what laws read (by_inputs.h): all harmonics for the cost of
 * one, and no blocks. */
bool balance_on_inputs(const struct balance *b);
/*
 * Keep harmonics past HJ out of the derivative: their rows are solved with S_k, as in [CG89] (7),
 * exact but for the laws' slope over |S_k|.  HJ = H undoes it.
 */
void balance_set_order(struct balance *b, int HJ);
/* Column C of block (i, j) of the derivative: entry r at [r]; of those that are there, see
 * blocks.h. */
double *balance_column(struct balance *b, int i, int j, int c);
/* Factor the derivative, rows scaled; false where it is singular to rounding.  The sign of its
 * determinant into *SIGN; NULL: not asked for, and balance_solve may iterate (by_harmonic.h). */
bool balance_factor(struct balance *b, int *sign);
/* The same of blocks, with MU times their largest entry added on the diagonal. */
bool balance_factor_stiffened(struct balance *b, double mu);
/* What a dense factorization of order n costs, its assembly included, in units of budget.h. */
double balance_dense_work(int n);
/* Whether the derivative last factored is singular to rounding, or nearly: there is a direction in
 * which nothing holds the motion, as the mean of a body that sliders alone hold. */
bool balance_open(const struct balance *b);
/* y <- J^-1 y, order entries. */
void balance_solve(struct balance *b, double *y);

/* y <- y through S and each law as a spring, `order` entries, to some percent, where derivatives
 * are solved on what laws read; else false, and y is lost. */
bool balance_solve_springs(struct balance *b, double *y);

/* The real vector of X (aft.h) into u, b->order entries, */
void balance_pack(const struct balance *b, const double complex *X, double *u);
/* and back. */
void balance_unpack(const struct balance *b, const double *u, double complex *X);
/* What rounding of X makes of the laws' forces, over the forces that act: near 1 nothing of them
 * is left. */
double balance_lost(const struct balance *b, const double complex *X);
/* max over dofs of max_k |step| / scale of the dof in X: a relative step; scales below FAINT of the
 * largest count as that, and below 1e-12. */
double balance_relative(const struct balance *b, double faint, const double *step,
                        const double complex *X);
/* max |R_k| over max(|p_k|, |S_k X_k|, |F_k|): a relative residual. */
double balance_relative_residual(struct balance *b, const double complex *X);

#endif
