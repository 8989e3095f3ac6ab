/* transfer.h - responses to measured inputs as a sum of modes, fitted by maximum likelihood */
#ifndef MODAL_TRANSFER_H
#define MODAL_TRANSFER_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/forced/lines.h"

/*
 * Response i at line z, drives W_j and direct columns X_k as in lines.h:
 *
 *   Y_i = sum_p sum_j [phi_ip q_jp / (z - e^s_p) + conj(phi_ip q_jp) / (z - e^conj(s_p))] W_j
 *         + sum_k D_ik X_k + white noise of variance v_i.
 *
 * Of each pair p: s its exponent over a sample, Im in (0, pi); phi its shape; q how the drives
 * reach it, 1 for the drive it is held by.  A pole that is real, s, phi and q too, is one of
 * Im s = 0 that stays so.
 */
struct transfer {
    int poles;
    double complex *s;           /* poles */
    double complex *q;           /* (j, p) at j + drives p */
    int *held;                   /* poles: a drive */
    double *x;                   /* (2 poles + direct) x responses: Re, Im of phi, then D */
    double *rss;                 /* responses: sum of squares left over */
    double *band;                /* bands of lines.h x responses: of that, each band's */
    double *variance;            /* responses: v_i */
    double *spread;              /* of Re s, Im s of each pole: standard deviations */
    double *energy;              /* poles: sum over responses of |part|^2, over all lines */
    double likelihood;           /* ln of it, but for a constant */
    bool converged, exact;       /* exact: nothing but rounding is left over, anywhere */
};

/* Of one model, each a pair or real. */
enum { TRANSFER_POLES_MOST = 40 };

struct transfer_limits {
    int steps;                   /* of Gauss and Newton */
    double enough;               /* converged where a step promises no more ln likelihood */
    double *work;                /* multiplications left; a fit takes from it, and ends where it is
                                    spent, with the best so far */
    bool (*cancelled)(void *context);    /* may be NULL */
    void *context;
};

/* A model of no poles, the direct columns alone, not fitted; room for TRANSFER_POLES_MOST. */
enum modal_status transfer_new(const struct lines *lines, struct transfer *out,
                               struct modal_error *err);
void transfer_done(struct transfer *t);
void transfer_copy(const struct lines *lines, const struct transfer *from, struct transfer *to);

/* The strongest of pole P's drives, which it is held by, is 1 again. */
void transfer_hold(const struct lines *lines, struct transfer *t, int pole);

/* One pole more, driven by Q; one less. */
void transfer_add(const struct lines *lines, struct transfer *t, double complex s,
                  const double complex *q);
void transfer_drop(const struct lines *lines, struct transfer *t, int pole);

/*
 * From where *T is to the maximum of its likelihood, by Levenberg and Marquardt's steps on s and q,
 * shapes and direct terms eliminated (Golub and Pereyra); at most LIMITS->steps, as far as the work
 * goes: not converged where either ends it.  Fails with
 * MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE, MODAL_CANCELLED.
 */
enum modal_status transfer_fit(const struct lines *lines, const struct transfer_limits *limits,
                               struct transfer *t, struct modal_error *err);

/* What is left over at all lines, count x responses, into R. */
enum modal_status transfer_rest(const struct lines *lines, const struct transfer *t,
                                double complex *R, struct modal_error *err);

/*
 * Frequency responses of the model at COUNT frequencies, radians a sample: entry (f, i, j),
 * response i to a unit of input j, at f + count (i + responses j) of H; SPREAD, the same, the
 * standard deviation of its distance from the true one, NAN where unknown.  *T is as transfer_fit
 * left it.
 */
enum modal_status transfer_frf(const struct lines *lines, struct transfer *t, const double *turn,
                               int count, double complex *H, double *spread,
                               struct modal_error *err);

/* More of inputs: of each column c lines added to INPUT[c], over sqrt(samples) as lines are; `fill`
 * tells, by `of`, those of a column from FIRST on into U. */
struct transfer_more {
    int count;
    const int *input;
    void (*fill)(const void *of, int column, int first, int rows, double complex *U);
    const void *of;
};

/*
 * What it takes off: at *T, as transfer_fit left it, with a_c times column c the likelihood's
 * logarithm changes by score . a - a . info a / 2, all else fitted anew, to the second order.  M is
 * (count + 1)^2: row 0 from entry 1 on the score, rows and columns from 1 on the information.
 * OWN, where it is not NULL, count^2: the score's covariance by what each line adds to it, which
 * holds whatever the noise of lines is (transfer_gain.c); as many more multiplications.
 */
enum modal_status transfer_gain(const struct lines *lines, struct transfer *t,
                                const struct transfer_more *more, double *M, double *own,
                                struct modal_error *err);

/* Of that, of so many COLUMNS, without OWN: multiplications of its products.  Its memory is the
 * model's, not the record's: it grows with no lines. */
double transfer_gain_work(const struct lines *lines, int poles, int columns);

/* Of one step of a fit of so many POLES: multiplications of its products. */
double transfer_work(const struct lines *lines, int poles);

/* Real unknowns of so many poles. */
int transfer_unknowns(const struct lines *lines, int poles);
#endif
