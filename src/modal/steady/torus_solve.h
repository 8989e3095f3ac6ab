/* torus_solve.h - a steady state under several tones: balanced, grown, and its errors estimated
 *
 * Of a program (program.h) under loads at combinations of tones (torus.h), the motion (1) there
 * that balances its combinations,
 *
 *     S(Omega_k) X_k + F_k(X) = p_k,                                                            (1)
 *
 * S and p of condense.h at the frequency Omega_k.  The combinations are grown from the residual:
 * those whose motion matters at the error asked for, no box of them.
 */
#ifndef MODAL_TORUS_SOLVE_H
#define MODAL_TORUS_SOLVE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/steady/budget.h"
#include "modal/steady/torus.h"

struct program;
struct torus_point;

struct torus_options {
    int order;                /* all combinations of at most this order; 0: grown */
    double tolerance;         /* relative step of Newton's method; 0: 1e-10 */
    int max_iterations;       /* of one attempt; 0: 60 */
    bool stability;           /* wanted */
    double target_error;      /* relative to the largest motion; 0: 1e-6 */
    int free;                 /* 1 + the tone whose frequency is the motion's own; 0: none */
    const struct torus_point *start;      /* a motion near by, of as many tones and dofs of laws,
                                           * where it begins; NULL: at rest */
    bool near;                /* of the branch that START is on: balanced from there alone, no
                               * march and no other way in, which may lead to another */
    const int *dofs;          /* those reported, `dofs_count` of them */
    int dofs_count;
    bool (*cancelled)(void *context);
    void *context;
};

enum { TORUS_EXPONENTS = 4 };   /* leading ones of disturbances */

/* One OF-th of tone TONE, where motions repeat after as many of its turns; of 0: none. */
struct torus_part { int tone, of; };

struct torus_stability {
    const char *reason;       /* why not computed; NULL: it was */
    int verdict;              /* 1: disturbances decay, -1: one grows, 0: undecided */
    int count;
    double exponent[TORUS_EXPONENTS], errors[TORUS_EXPONENTS];   /* 1/s, by falling exponents */
    double margin, error;     /* 1/s: less the exponent that decides, and its error */
};

struct torus_point {
    bool converged, wanting;  /* wanting: the target asks for more than is allowed */
    bool open;                /* nothing holds its mean, which is one of many; the errors are of
                               * the motion about it */
    bool marched;             /* read from a march, not balanced: laws with events */
    bool from_start;          /* of a march from the scene's initial state */
    const char *reason;       /* where not converged */
    struct torus_tones tones;
    struct torus_part part;   /* that is one of `tones`, in the place of the tone given */
    int count, iterations;
    struct torus_index *index;       /* the combinations, k = 0 first, by rising order */
    double complex *X;        /* of the reported dofs, [i count + m], m */
    int q;                    /* dofs of laws, which iterate */
    double complex *start;    /* their motion, as X: where one near by may begin */
    double residual;          /* relative to the largest force of (1); NAN: marched */
    double truncation, sampling, solver, error;   /* max over time and reported dofs, in m */
    double line;              /* of a combination's motion, told or left out, at the most */
    double tone_error;        /* of the free tone's frequency, rad/s */
    double amplitude;         /* max |x| over the kept dofs */
    struct torus_stability stability;         /* of a converged motion */
    struct budget work;
    int laws, samples;        /* samples: of one evaluation, or of the record */
    long *evaluations;        /* per law */
    bool *acts, *undetermined;
};

/*
 * The steady state of P under COUNT tones OMEGA, rad/s, its loads at their `tone`.  OMEGA of a free
 * one is not read.  No convergence
 * is an answer: MODAL_OK with OUT->converged false and a reason.  Fails with MODAL_BAD_INPUT for
 * what several tones do not take: periodic matrices, loads that are no harmonics, laws of
 * torus_laws.h; MODAL_TOO_LARGE, MODAL_NO_MEMORY, MODAL_CANCELLED.  torus_point_done frees.
 */
enum modal_status torus_solve(const struct program *p, const double *omega, int count,
                              const struct torus_options *opt, struct torus_point *out,
                              struct modal_error *err);
void torus_point_done(struct torus_point *point);
#endif
