/* leading.h - the multipliers of largest modulus of a period map, and a bound of all of them
 *
 * Both ask for carried vectors alone (period_map.h).
 */
#ifndef MODAL_LEADING_H
#define MODAL_LEADING_H
#include "modal/linalg/arnoldi.h"

struct period_map;

struct leading {
    struct arnoldi found;        /* of a period: residuals are those of the vectors carried once */
    double *frequency;           /* of each, rad/s: speeds over displacements of its vector */
    int periods;                 /* carried, of one vector each */
};

/*
 * WANTED multipliers of M, each to a residual of at most TOLERANCE times the largest modulus, by at
 * most MOST periods (0: as many as ARNOLDI_MOST products take); found.settled says whether they
 * are.  Fails as arnoldi or as period_map_carry.  leading_done frees.
 */
enum modal_status leading_multipliers(struct period_map *m, int wanted, double tolerance, int most,
                                      struct leading *out, struct modal_error *err);

/* Operations (budget.h) of one more vector beside VECTORS, orthogonal to them, and of looks. */
double leading_vector_work(const struct period_map *m, int vectors);

/* *L becomes zeros. */
void leading_done(struct leading *l);

/* *RESIDUAL: |Phi y - w y| of unit START y, measured on M.  Fails as period_map_carry. */
enum modal_status leading_residual(struct period_map *m, double complex w,
                                   const double complex *start, double *residual,
                                   struct modal_error *err);

enum { LEADING_PROBES = 10 };    /* vectors: the bound fails once in 10^10 */

/*
 * *BOUND: no multiplier of M exceeds it in modulus, but with a probability of 10^-LEADING_PROBES.
 * Vectors are carried until it is below ENOUGH, or MOST periods of one vector each are done, which
 * *PERIODS counts; HUGE_VAL where it says nothing.  Fails as period_map_carry but for overflow.
 */
enum modal_status leading_bound(struct period_map *m, double enough, int most, double *bound,
                                int *periods, struct modal_error *err);
/* How many periods it takes to be below ENOUGH, nearly, where LARGEST is the largest modulus. */
double leading_bound_periods(const struct period_map *m, double largest, double enough);
#endif
