/* refine.h - exponents refined by variable projection, and their standard errors: the statistically
 * efficient estimate */
#ifndef MODAL_REFINE_H
#define MODAL_REFINE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/fit/criterion.h"
#include "modal/linalg/matrix.h"
#include "modal/linalg/workspace.h"

struct compressed;

enum { REFINE_ORDER_MOST = 1600 };      /* exponents: a triangle of 3200 columns is 80 MB */

/*
 * The data: Y, L rows a step tau apart, S columns, with the model of synthesis.h.  A periodic
 * system with Ns signals of p samples a period is L periods of Ns p columns and tau = T: column k +
 * p s is sample k of signal s, and `phases` = p. `phases` columns in a row share one noise level; S
 * is a multiple of it.
 */
struct refine_data {
    const struct matrix *Y;    /* borrowed; scaled so that squares neither overflow nor underflow */
    double tau;                  /* s */
    int phases;                  /* 0: 1 */
    double share;                /* noise that was filtered fills this share of the rows' freedom, 0
                                  * < share <= 1; 0: 1, white */
    const double *least;         /* borrowed, per signal (S / phases): variance that the samples'
                                  * own grid has, below which nothing is signal; NULL: none */
    bool exact;                  /* what no model explains is rounding, which is not white */
    int before;  /* rows of the record before these: rounding of a phase grows from its beginning */
    struct compressed *blocks;   /* borrowed, of Y (compressed.h): a fit reads it in place of Y, and
                                  * makes it hold where it does not; NULL: Y itself is read */
    double white;                /* of a periodic system: share of the columns that noise is free in
                                  * (criterion.c); 0: 1 */
    double omega;                /* rad/s, of a periodic system whose period is no whole number of
                                  * rows: poles that differ by multiples of i omega to rounding, as
                                  * they are or as conjugates, are lines of one multiplier: they
                                  * have one exponent, and move together; 0: each for itself */
};

/* The same to rounding: in parts of omega, of a pole, of a range of samples, of a sum of squares.
 * Of the twelve digits that REFINE_EXACT leaves three go with the condition of what is solved. */
#define REFINE_TIED 1e-9

struct refine_options {
    int iterations;              /* most Levenberg-Marquardt steps; 0: 60; < 0: none, only look:
                                  * residual, noise, bic */
    double step;                 /* converged once the next step is less than this times the
                                  * standard errors; 0: 1e-3 */
    double work;                 /* most multiplications (below) before another step; 0: no limit */
    double rival;                /* give up where the BIC will hardly fall below this (beside a
                                  * better candidate); 0: never */
    double gain;                 /* the same against the start: where the BIC will hardly fall by so
                                  * much below that of START; 0: never */
    bool equal_noise;            /* one noise level for all columns; else one for each signal, from
                                  * its own residual */
    bool settle;                 /* once converged go on to the minimum itself, so that the answer
                                  * does not tell where the search began */
};

enum refine_end {
    /* the next step is below options.step standard errors, or what it promises below the rounding
     * of signals that are exact */
    REFINE_CONVERGED,
    REFINE_ROUNDING,           /* the residual is rounding: as exact as the arithmetic lets it be */
    REFINE_STALLED,              /* no step lowers the residual, or too many steps: not converged */
    REFINE_BOUNDED,            /* a pole sits at the guard of growth or decay: the model is wrong */
    REFINE_DEGENERATE,           /* two poles coincide, or there are more unknowns than rows */
    REFINE_HOPELESS,             /* given up: options.rival */
    REFINE_STOPPED,              /* options.work is spent: not converged */
    REFINE_LOOKED     /* options.iterations < 0: the poles are the start, without standard errors */
};

/* Of the signals' norm, of a channel, of a multiplier: what is below it is rounding, 2.2e-16 of
 * each of some thousand terms of a sum or steps of a recursion. */
#define REFINE_EXACT 1e-12

/* Standard errors between a settled answer and the minimum, and what part of a pole a step may be
 * that is the last: its square is below rounding. */
#define REFINE_SETTLED 1e-10

/* rad over the record in a step: one line of its spectrum, within which the linear model that a
 * step rests on holds; a live window, which begins near, takes half of it at most, and is found
 * from nothing where it wants more. */
#define REFINE_TURN_MOST 6.0

/* What products or differences leave of a number, the half of its digits: sqrt(2.2e-16), in parts
 * of the largest. */
#define REFINE_HALVED 1e-8

/*
 * Levels that decide in many places, each by what it means and not by where it stands: a question
 * that is asked twice must not be answered by two numbers.  What is told of rounding is in parts of
 * the largest of its kind; what is told of noise, in standard errors, which a fit in white noise
 * knows to 1 / sqrt(2 n) of n numbers that it leaves free.  Whatever is judged in a single place,
 * with a reason that holds there alone, is named there.
 */

/* Standard errors that settle a question: of normal errors 0.3 % are larger. */
#define REFINE_CLEAR 3.0

/* Standard errors between two poles that are no doubt two, wherever in a record they may be: of
 * normal errors one in 3,500,000 is larger on one side. */
#define REFINE_APART 5.0

/* Numbers of a signal that a fit leaves free: of fewer it tells no noise of its own. */
enum { REFINE_FREEDOM_LEAST = 30 };

/* Equations beyond the unknowns: with fewer a residual is no noise, for its variance is known to
 * 1 / sqrt(2 n) of itself by n of them, and by one or two to nothing. */
enum { REFINE_SPARE_LEAST = 3 };

/* Multiplications that a question beside the answer may take, half a second: a half of the record,
 * another model, a first search of channels that have not been weighed yet, a last fit of all. */
#define REFINE_WORK_ASKED 1e9

/* Rows of what is asked for its noise, its colour or its recurrence, or cut to be identified alone:
 * 64 tell a level to 9 % (1 / sqrt(128)). */
enum { REFINE_ROWS_LEAST = 64 };

struct refined {
    int poles, order;            /* entries of lambda; columns of the basis */
    int parameters;              /* real unknowns in the exponents that are not fixed */
    double complex *lambda;      /* 1/s, as listed on the way in */
    double *covariance;          /* parameters x parameters, (1/s)^2; NAN where degenerate */
    int *first;            /* per pole: its first parameter (Re; then Im for a pair), -1 if fixed */
    int *turn;             /* per pole: 1; where it is a line of another's multiplier (omega) -1 if
                            * that one's conjugate, and 0 of a real multiplier, whose Im is fixed */
    double *std_re, *std_im;     /* per pole, 1/s; 0 for what is fixed or exact by kind (Im of a
                                  * real pole) */
    int groups;                  /* signals: S / phases */
    double *noise;       /* per signal: standard deviation of the residual, units of Y, unfloored */
    double *floor;               /* per signal: what rounding alone leaves */
    double residual, start;      /* Frobenius norm of Y - fit: at the end, at the start */
    double start_bic;            /* of START */
    double bic;                  /* Bayes information criterion of the fit, residuals floored at
                                  * rounding; see refine.c */
    int iterations, evaluations;
    double work;                 /* multiplications of all evaluations, about: rows x columns^2
                                  * each, or 2 rows x columns x S (doubling.h); it depends on sizes
                                  * and steps, not on the machine */
    enum refine_end end;
    struct workspace space;      /* of the arrays */
};

/*
 * Refine COUNT poles, listed as in exponents.h, from START.
 *
 *   fixed   COUNT flags, or NULL: poles that keep their value (the null exponent of an offset)
 *   out     on success the caller's, to refined_done; lambda holds the best iterate, whatever `end`
 *           says
 *
 * Everything is deterministic.  Fails with MODAL_BAD_INPUT (COUNT < 1, order past REFINE_ORDER_MOST
 * or not below L; a pole that is not finite; an empty Y), MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE
 * (LAPACK).
 */
enum modal_status refine_poles(const struct refine_data *data, const double complex *start,
                               int count, const bool *fixed, const struct refine_options *options,
                               struct refined *out, struct modal_error *err);
void refined_done(struct refined *r);

/* Multiplications of one evaluation of ORDER columns with their derivatives, about. */
double refine_work(const struct refine_data *data, int order);

/* Norms of Y and of a column: what its blocks know of them, else by a pass over all of it. */
double refine_norm(const struct refine_data *data);
double refine_column_norm(const struct refine_data *data, int column);

/* The data in the span of a set of poles: Phi = Q R, Z = Q^T Y, columns of Phi in the order of
 * the poles. */
struct projected {
    int order, parameters, columns;   /* q, of the exponents that are not fixed, of Y */
    double *R, *Z;               /* q x q, zeros below; q x columns */
    double *rss;                 /* per signal: what the span leaves */
    double *energy, *lowest;     /* per signal, for: */
    struct criterion criterion;
    bool degenerate;             /* Phi has not its full rank: Z and rss mean nothing */
    double work;                 /* as in struct refined */
    struct workspace space;      /* of the arrays */
};

/* One evaluation at LAMBDA; arguments and failures as refine_poles has them. The caller frees
 * *out with projected_done. */
enum modal_status refine_project(const struct refine_data *data, const double complex *lambda,
                                 int count, const bool *fixed,
                                 struct projected *out, struct modal_error *err);
void projected_done(struct projected *p);

/* Converged to the bound or to rounding? */
bool refined_converged(const struct refined *r);

/* Standard deviations that follow from a pole's 2 x 2 covariance: of |lambda| / 2 pi and of
 * the damping ratio. */
void refined_std(const struct refined *r, int pole, double *frequency_hz, double *damping_ratio);
#endif
