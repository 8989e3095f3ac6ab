/* session.h - what the files of one solution share: the session and its helpers (point.c) */
#ifndef MODAL_SESSION_H
#define MODAL_SESSION_H
#include "modal/steady/point.h"

struct iterate_options;
struct orbit_grid;
struct settled;               /* by_cycle.c */

/* Orders whose balances are kept: H doubles, and a way or a search asks for a few in between. */
enum { BALANCES = 24 };

/* A session: one program, its linear part, and a balance for each order tried. */
struct steady {
    const struct program *p;    /* as given, or reduced */
    struct craig_bampton *reduction;    /* NULL: none was asked for */
    int *counted;               /* of it: opt.dofs */
    struct steady *finer;       /* its other program's session (reduction.c); NULL: not yet */
    struct steady_options opt;  /* as given: 0 is resolved where it is used */
    struct condense *c;         /* of the laws' dofs, or of all where these resonate */
    bool exact, linear;         /* every law has pieces; there is none */
    int degree;                 /* the largest of polynomial laws; 0: none */
    bool sampled;               /* some law is neither */
    bool jumps;                 /* rigid friction, located */
    bool brief;                 /* fewer harmonics were tried and these are costly: Newton's
                                 * method from near, no ways round */
    bool current;               /* the last residual of the balance at hand was of the point's X */
    double slope;               /* the laws' largest, as the last rough start showed it; 0: not
                                 * yet */
    struct joint *joint;        /* of its balances (by_inputs.h); NULL: none */
    struct balance *balance[BALANCES];
    int balances;               /* of them */
    struct balance *wide;       /* of the last estimate, wider than its point; NULL: none yet */
    struct orbit_grid *peaks;   /* that its motions are looked at on, */
    int peak_samples;           /* of so many; 0: none yet */
    struct budget budget;       /* of the solution under way */
    double in_vain;             /* operations of stability that gave no verdict, by windows of
                                 * Hill's matrix, of all points so far */
    struct at_rest *rest;       /* made when first asked for; NULL: not yet, or it does not apply */
    bool rest_asked;
    bool rested;                /* the last solution was at rest */
    struct settled *settled;    /* a motion sought in time, of the solution under way; NULL: not
                                 * yet */
    bool searching;             /* for all solutions: motions at rest are found as the others are */
};

/* Frees S's balances, wide and other, as where its kept dofs change. */
void steady_drop_balances(struct steady *s);
/* Samples: the least power of 2 that is not below LEAST, at most 2^17. */
int steady_power_of_two(long least);
/* The options of one attempt by this session. */
struct iterate_options steady_iterate_options(const struct steady *s);
/* What a factorization costs at H, nearly, in operations of budget.h. */
double steady_factor_work(const struct steady *s, int H);
/* The budget of a solution begins. */
void steady_allow_work(struct steady *s);
/* The least that it is, of few dofs. */
double steady_least_work(void);
/* The I-th of the dofs whose errors count. */
int steady_counted_dof(const struct steady *s, int i);
/* The error asked for, relative to the largest displacement. */
double steady_target(const struct steady *s);

/* START's harmonics that balance B has into X, 0 elsewhere; NULL: rest. */
void start_write(const struct balance *b, const struct steady_start *start, double complex *X);
/* POINT, new or of an order before, becomes one of q kept dofs at H and N, X = 0, nothing known;
 * counts stay. */
enum modal_status point_init(struct steady *s, struct steady_point *point, int q, int H, int N,
                             struct modal_error *err);
/* OUT is POINT's motion, flags, multipliers and errors, its arrays its own, without evaluations;
 * what it had is freed. */
enum modal_status point_copy(const struct steady_point *point, struct steady_point *out,
                             struct modal_error *err);
/* Evaluations and transforms of B since BEFORE (per law) and FFTS_BEFORE into POINT, and which laws
 * act. */
void point_count(const struct balance *b, const long *before, long ffts_before,
                 struct steady_point *point);
#endif
