/* pencil.h - poles of every order from one decomposition of a Hankel matrix that is never formed */
#ifndef MODAL_PENCIL_H
#define MODAL_PENCIL_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/lanczos.h"
#include "modal/linalg/matrix.h"

struct pencil_options {
    int rows;      /* of the Hankel matrix, per signal; 0: L/3 */
    int wanted;    /* leading singular triplets; 0: 16.  At most min(S rows, columns) are had */
    int sure;      /* so many leading ones are iterated until those above the edge of noise have
                    * converged within it; 0: none, the last may not have.  Without `products` */
    /* Y Y^T (lower triangle read), where what is PENCIL_SQUARES of the largest and less may be
     * lost; borrowed, NULL: Y itself is read */
    const struct matrix *products;
    /* without `products`: the iteration that a pencil of the same Y and rows with fewer triplets
     * began, to go on with (lanczos.h); NULL: none is kept */
    struct lanczos **run;
};

struct pencil {
    int count;     /* triplets */
    double *s;     /* singular values, descending; those amid noise are Ritz values, not converged:
                    * fit for a start */
    double *R;     /* count x count: triangle of V1 */
    double *W;     /* count x count: Q^T V2 */
    struct matrix VT;   /* count x columns: the right vectors */
    int rows, columns, steps;
    int height;    /* of H: S rows */
    double energy; /* Frobenius norm of H, squared */
};

/* Singular values that are known by their squares, of the largest: those round to DBL_EPSILON. */
#define PENCIL_SQUARES 1e-7

/* Of signals with this many rows and columns: do products cost less than transforms? */
bool pencil_products_pay(int rows, int columns);
/* Y Y^T, the lower triangle; the caller frees out->x. */
enum modal_status pencil_products(const struct matrix *Y, struct matrix *out,
                                  struct modal_error *err);

/*
 * Y is L x S, kept: its block Hankel matrix H, (S rows) x (L - rows + 1), has the leading right
 * singular vectors V; V1 is V without its last row, V2 without its first.  The caller frees *out
 * with pencil_done. Fails with MODAL_BAD_INPUT (`rows` out of 1 .. L-1, an empty Y),
 * MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status pencil_new(const struct matrix *Y, const struct pencil_options *opt,
                             struct pencil *out, struct modal_error *err);
void pencil_done(struct pencil *p);

/* The r eigenvalues of Z, V2 = V1 Z on the leading r columns: multipliers over one step. 1 <= r <=
 * count. */
enum modal_status pencil_multipliers(const struct pencil *p, int r, double complex *rho,
                                     struct modal_error *err);

/*
 * How many singular values exceed those of white noise. What the triplets leave of H's energy is
 * spread over its height x columns entries, and a matrix of such noise alone has no singular
 * value above sqrt(height) + sqrt(columns) times its deviation (the edge of Marchenko and
 * Pastur); PENCIL_EDGE allows for a Hankel matrix, whose entries repeat. A constant share of
 * signal that is below is not lost: it is found in what the fit leaves (order.c).
 */
#define PENCIL_EDGE 1.5
int pencil_signals(const struct pencil *p);

/* The Hankel matrix of Y as an operator, by FFT; the caller frees it with hankel_operator_done. */
struct hankel_operator;
enum modal_status hankel_operator_new(const struct matrix *Y, int rows,
                                      struct hankel_operator **out, struct linear_operator *op,
                                      struct modal_error *err);
void hankel_operator_done(struct hankel_operator *h);
/* A length no less than n: 2 times an odd number without prime factors past 7.  FFTW plans such a
 * one in about 1 ms, one with more factors of two in 3 to 6, which is more than all the transforms
 * of a small job take. */
int transform_length(int n);
#endif
