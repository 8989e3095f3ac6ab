/* floquet.h - the exponents of a linear program: eigenvalues where it is constant, multipliers
 * where it is periodic
 *
 * Conventions: exponent lambda = sigma + i omega_d; multiplier rho = exp(lambda T); of a periodic
 * program lambda is the principal value, (ln|rho| + i arg rho) / T with arg in (-pi, pi].
 */
#ifndef MODAL_FLOQUET_H
#define MODAL_FLOQUET_H
#include <complex.h>
#include <stdbool.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

enum floquet_verdict { FLOQUET_UNSTABLE, FLOQUET_STABLE, FLOQUET_UNDECIDED };

struct floquet_options {
    double tolerance;            /* of the monodromy matrix, relative; 0: 1e-12 */
    int multipliers;             /* of a periodic program: so many of largest modulus; 0: all */
};

struct floquet {
    /* 2 n + linear states: both of each pair; or the leading ones, as `multipliers` and
     * FLOQUET_STATES_DENSE have it */
    int count;
    bool leading;                /* each bar is of a residual */
    bool unsettled;              /* and some residual misses its tolerance: the best so far */
    bool alike;                  /* others have the modulus of the last, to its bar */
    int periods;                 /* carried for it, of one vector each */
    int windows;                 /* of Hill's matrix looked through for it (hill_leading.h) */
    double sums_to;              /* as struct hill_leading's */
    int growing;                 /* the same */
    bool periodic;
    double period;               /* s; 0: constant without a period */
    /* descending in magnitude; of constant programs only where period > 0 */
    double complex *multiplier;
    double complex *exponent;    /* descending in real part */
    /* of each: on |multiplier| where periodic, else on the exponent, 1/s and rad/s */
    double *bar;
    /* false: the multiplier is below rounding, and its exponent not known */
    bool *resolved;
    struct workspace space;      /* of the arrays */
    /* undecided: the largest is within its error bar of the boundary */
    enum floquet_verdict stable;
    double max_multiplier;       /* |rho|; 0 where there is no period */
    double margin;               /* -max Re exponent, 1/s */
    double error;                /* estimated, relative, of the monodromy matrix */
    int substeps;                /* of a period, in Magnus steps */
};

/* A periodic program of more states than FLOQUET_STATES_DENSE, or of fewer where windows do not
 * find all and a map of them takes minutes, has its FLOQUET_LEADING multipliers of largest modulus
 * where `multipliers` is 0; fewer where the others vanish beside these. */
enum {
    FLOQUET_STATES_DENSE = 500,  /* chosen: their spectrum takes seconds */
    FLOQUET_LEADING = 10,        /* chosen: who asks for more says so */
};

/*
 * Fails with MODAL_BAD_INPUT (laws: "effects"; a periodic program's period does not fit),
 * MODAL_TOO_LARGE, MODAL_OVERFLOW (growth over one period leaves the range of doubles),
 * MODAL_NO_CONVERGENCE, MODAL_NO_MEMORY. floquet_done frees the arrays.
 */
enum modal_status floquet(const struct program *p, const struct floquet_options *opt,
                          struct floquet *out, struct modal_error *err);
/* F's arrays; F itself is the caller's and becomes zeros. */
void floquet_done(struct floquet *f);

#endif
