/* point.h - a session of steady states of one program: its options, where it starts, and the point
 * it answers with */
#ifndef MODAL_POINT_H
#define MODAL_POINT_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/steady/budget.h"

struct balance;
struct condense;
struct craig_bampton;
struct program;

/* the last three: march.h */
enum steady_method {
    STEADY_AUTO,
    STEADY_DIRECT,
    STEADY_NEWTON,
    STEADY_RK4,
    STEADY_ADAPTIVE,
    STEADY_SHOOTING
};

struct steady_options {
    int harmonics;            /* H; 0: so many that the errors' estimate meets target_error */
    int samples;              /* N; 0: enough for the laws and H */
    enum steady_method method;
    double cutoff;            /* iterate.h; 0: none */
    double tolerance;         /* relative step; 0: 1e-12 */
    int max_iterations;       /* of one attempt; 0: 60 */
    bool unlocated;           /* sample every law: events fall between samples, as in 1989 */
    bool by_differences;      /* Newton's derivative by difference quotients, as in 1989 */
    double target_error;      /* relative to max |x|; 0: 1e-6 */
    double relaxation;        /* direct iteration; 0: 1 */
    bool estimate_later;      /* at given H: leave the errors to steady_estimate_point */
    bool prefers_stable;      /* beside an unstable answer a stable one is sought: part of the
                               * work is left for that until steady_refine */
    const int *dofs;          /* those whose errors count, `dofs_count` of them; NULL: all */
    int dofs_count;
    double krylov;            /* condense_share; 0: none at a point, SHARED (point.c) along a
                               * curve */
    int reduce;               /* modes of craig_bampton.h in place of all dofs but `keep`, among
                               * which `dofs` are, and those of laws and loads; 0: none */
    const int *keep;
    int keep_count;
    bool reduced;             /* the program is one of craig_bampton.h */
    bool (*cancelled)(void *context);
    void *context;
};

/* A motion of all kept dofs, to start from. */
struct steady_start {
    int q, H;
    const double complex *X;  /* [i (H+1) + k] */
};

struct steady_point {
    bool converged;
    const char *method;       /* "linear", "direct", "newton", ...: what found it */
    const char *reason;       /* where not converged */
    bool fewer;               /* not converged, for with more harmonics it does not close, or its
                               * error is larger than the motion; its errors are known */
    bool open;                /* nothing holds its mean (or some other direction), which is one
                               * of many; without error */
    bool wanting;             /* target_error asks for more work than is allowed */
    bool unsought;            /* the work allowed ended the search for others beside it */
    int iterations, attempts;
    struct budget work;       /* of the solution, and of what was sought beside it (budget.h) */
    double omega, level;
    int q, H, N;
    double complex *X;        /* kept dofs, [i (H+1) + k] */
    double residual, step;    /* relative */
    double truncation, sampling, solver;      /* max over time and dofs of the error each makes,
                                               * in the unit of x */
    double error;             /* of all three together, and `reduction` where it was asked for */
    double reduction;         /* what the modes left out make (reduction.h); 0: none are */
    double tail_rms, tail_max, load_max;      /* equation residual in time, N, at the kept dofs
                                               * (linear: at all); and the scale of it */
    double amplitude;         /* max |x(t)| over the dofs that count; open, about their means */
    long ffts;
    int laws;
    long *evaluations;        /* per law */
    bool *acts, *undetermined;
    bool followed;            /* through rigid friction's events (cycle.h), with `states`
                               * multipliers where they are known */
    int states;
    double complex *multiplier;
    double multiplier_error;
    struct condense *c;       /* to recover other dofs with: at omega, H; owned by the session */
    struct condense *linear;  /* of a motion at rest (at_rest.h), in place of it; else NULL */
};

struct steady;                /* a session: solve.h */

/* The session's linear part; the session owns it, and may make another where all dofs are kept. */
struct condense *steady_condense(struct steady *s);

/* POINTS frequencies follow, many: condense_share or condense_reduce where it pays. */
enum modal_status steady_reduce(struct steady *s, int points, struct modal_error *err);

/* The program that steady_new was given. */
const struct program *steady_program(const struct steady *s);

/* The balance for H harmonics of this session, made on first use and kept. */
enum modal_status steady_balance(struct steady *s, int H, struct balance **out,
                                 struct modal_error *err);

/* A point of X, the kept dofs' solution of balance B of this session, with its counts; errors are
 * left to steady_estimate_point. */
enum modal_status steady_point_of(struct steady *s, struct balance *b, const double complex *X,
                                    struct steady_point *point, struct modal_error *err);

/* The H that a solution of laws that act begins with, where the options name none. */
int steady_first_order(const struct steady *s);

/* Frees what POINT holds, and makes it 0. */
void steady_point_done(struct steady_point *point);

/* The reduction that the options ask for; NULL: none. */
const struct craig_bampton *steady_reduction(const struct steady *s);
/* Which of the program's dofs the session's I-th is, -1: a mode of a reduction. */
int steady_dof(const struct steady *s, int i);

/* X of dof DOF, harmonics 0 .. H of the point; of a reduction one that is kept. */
enum modal_status steady_recover(struct steady *s, const struct steady_point *point, int dof,
                                 double complex *X, struct modal_error *err);
#endif
