/* transfer_sums.h - the columns of a model of transfer.h, and their products over all lines */
#ifndef MODAL_TRANSFER_SUMS_H
#define MODAL_TRANSFER_SUMS_H
#include "modal/identify/forced/transfer.h"
#include "modal/linalg/workspace.h"

enum {
    SUMS_BLOCK = 256,            /* lines at a time: columns of a few poles stay in cache */
    SUMS_PARTS = 4               /* columns of C a pole and drive */
};
/* Of S's diagonal: what is not seen has 1e6 times its own error. */
#define SUMS_RIDGE 1e-12

/* By the letters of transfer_sums.c. */
struct sums {
    int K, V, g;                 /* columns of C and of V; unknowns in s and q */
    double *G, *B;               /* K x K; K x responses */
    double *GV, *A;              /* G V's columns; the inverse of V^T V */
    double *Q;                   /* K x V: V = C Q */
    double *S, *d;               /* g x g, g */
    double *block;               /* 2 SUMS_BLOCK x (K + V + 2 responses) */
    double spent, most;          /* work, and what a fit may take of it */
    struct workspace held;       /* the memory of all; workspace_free() */
};

/* VALUE into a column of ROWS lines, real parts above imaginary ones, at line n. */
void sums_put(double *column, int rows, int n, double complex value);

/* C, and all responses, at ROWS lines from FIRST on: 2 rows x K, and 2 rows x responses. */
void sums_columns(const struct lines *lines, const struct transfer *t, int first, int rows,
                  double *C);
void sums_responses(const struct lines *lines, int first, int rows, double *Y);

/* V's and C's rows at z for a unit of INPUT alone: V and K numbers. */
void sums_rows(const struct lines *lines, const struct transfer *t, double complex z, int input,
               double complex *v, double complex *c);

/* Room for those of so many poles, all zero.  Fails with MODAL_NO_MEMORY; `held` is freed in any
 * case. */
enum modal_status sums_new(const struct lines *lines, int poles, struct sums *s,
                           struct modal_error *err);

/* Q of *T: of the unit real and imaginary part of each phi, by q. */
void sums_mix(const struct lines *lines, const struct transfer *t, struct sums *s);

/* At *T: G, B, Q, GV and A.  Then T_i, K x g, of one response; and S and the right side d of (1),
 * by t's shapes.  They fail with MODAL_NO_MEMORY, sums_take with MODAL_NO_CONVERGENCE as well. */
enum modal_status sums_take(const struct lines *lines, const struct transfer *t, struct sums *s,
                            struct modal_error *err);
void sums_directions(const struct lines *lines, const struct transfer *t, int response, int K,
                     double *T);
enum modal_status sums_step(const struct lines *lines, const struct transfer *t, struct sums *s,
                            struct modal_error *err);

/* S := S^-1, g x g; false where it is not definite, S then destroyed, or memory is out. */
bool sums_covariance(double *S, int g);
#endif
