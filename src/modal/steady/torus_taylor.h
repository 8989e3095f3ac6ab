/* torus_taylor.h - a step of a motion as polynomials of time, while laws are lines
 *
 * With tau = t / h, 0 <= tau <= 1, dof i moves, in column c, by
 *
 *     x_i(tau) = sum_k a[(k n + i) columns + c] (tau - base)^k,   k = 0 .. used.                (1)
 *
 * Column 0 is the motion; the others are disturbances of it, which no load moves.  A law is the
 * force f = level + gain d.
 */
#ifndef MODAL_TORUS_TAYLOR_H
#define MODAL_TORUS_TAYLOR_H
#include "modal/linalg/sparse.h"
#include "modal/linalg/workspace.h"
#include "modal/steady/torus_state.h"

enum {
    TORUS_TERMS_MOST = 24,                /* of (1), and more than any step needs */
    TORUS_PAIR = 2,                       /* columns of a motion with its leading disturbance; */
    TORUS_WIDE = 2 + TORUS_EXPONENTS,     /* with several: an even number, as vectors want; what
                                           * there is none for is 0 */
};

/* Entries by owner: those of L are at start[l] .. start[l + 1] - 1. */
struct torus_ends { int *start, *dof; double *weight; };

/* What a change of one law reaches within a step, by rising hops from it: dof[0 .. dofs[r] - 1] are
 * r hops or less away, and so for the laws that look at them.  felt: how far the last was seen to
 * come; -1: none was. */
struct torus_reach { int hops, felt, *dofs, *dof, *laws, *law; };

struct torus_taylor {
    struct workspace space;
    int n, laws, waves, columns, terms, used;      /* used: at most terms */
    double leaves;                        /* of each column's motion: a term left out */
    double h;                             /* s */
    struct sparse K, C;                   /* M^-1 K h^2, M^-1 C h */
    struct torus_ends see, push;          /* what a law's d is; M^-1 of it, times h^2 */
    struct torus_ends pull[2];            /* of waves: M^-1 of cosines' and sines' loads, h^2 */
    double *omega;                        /* of waves, rad/s */
    double *gain, *level;                 /* of laws now; [law columns + c] */
    double *a, base;                      /* (1); base: where the step was begun last */
    double *u, *end, *wave;               /* of that: where it was, x and v, and where it ends; the
                                           * waves at the step's own begin */
    double *delta;                        /* as a, zeros between changes */
    struct torus_reach *reach;            /* of laws */
    double fast;                          /* rad/s: a bound of the fastest motion */
};

/*
 * Of S's program, in COLUMNS, 1, TORUS_PAIR or TORUS_WIDE; *SERVES false: masses are missing, and a
 * dof follows the others at once; or too many dofs share masses.  STEEPEST: each law's largest
 * gain.  Its step is 1 s, and wants to be set.  Fails with MODAL_NO_MEMORY; done takes what is half
 * made.
 */
enum modal_status torus_taylor_init(struct torus_taylor *t, const struct torus_solver *s,
                                    int columns, const double *steepest, bool *serves,
                                    struct modal_error *err);
void torus_taylor_done(struct torus_taylor *t);
/* T->reach of all laws, its entries known: a part of torus_taylor_init.  T's space fails. */
void torus_taylor_set_reach(struct torus_taylor *t);
/* Steps of H; false, and as it was: too long for the fastest motion that laws at their largest
 * gains make. */
bool torus_taylor_set_step(struct torus_taylor *t, double h);
/* From now on COLUMNS, 1 or as many as at first; states are the caller's to shorten. */
void torus_taylor_narrow(struct torus_taylor *t, int columns);

/* (1) of the whole step from U: x, then v, each [i columns + c], its level and gain those of laws
 * now, with WAVE's cosines and sines, [2 w] and [2 w + 1], at its begin; its end into TO, which is
 * not U. */
void torus_taylor_make(struct torus_taylor *t, const double *u, const double *wave, double *to);
/* The same but for the terms, for whoever has all of t->a otherwise: a step begins with WAVE; or
 * anew at TAU, where the motion is t->u and the waves are WAVE. */
void torus_taylor_begin(struct torus_taylor *t, const double *wave);
void torus_taylor_stop(struct torus_taylor *t, double tau, double *wave);
/* Law L's GAIN and LEVEL, columns of them, from here on. */
void torus_taylor_set_line(struct torus_taylor *t, int l, double gain, const double *level);
/* Law L's d of column C, its polynomial, into P: used + 1. */
void torus_taylor_sees(const struct torus_taylor *t, int l, int c, double *p);
/* A polynomial of T and its rate per tau, at TAU. */
double torus_taylor_at(const struct torus_taylor *t, const double *p, double tau, double *rate);
/* From TAU on law L has gain GAIN and levels LEVEL, columns of them: (1) of all that feel it within
 * the step, or of all from TAU on, where that costs less.  How many hops of t->reach[l] that is:
 * dofs[hops] dofs of it, which laws[hops] see. */
int torus_taylor_change(struct torus_taylor *t, int l, double tau, double gain,
                        const double *level);
/* The end of (1) of the first COUNT dofs of LIST, into TO as torus_taylor_make has it. */
void torus_taylor_end(const struct torus_taylor *t, const int *list, int count, double *to);
/* What torus_taylor_make costs, in budget.h's units, and a change of law L over HOPS. */
double torus_taylor_work(const struct torus_taylor *t);
double torus_taylor_change_work(const struct torus_taylor *t, int l, int hops);
#endif
