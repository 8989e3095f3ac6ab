/*
 * leading.c - see leading.h
 *
 * Carrying a vector over a large sparse system's period costs less than keeping it orthogonal to
 * some hundred others.  Arnoldi's operator is therefore Phi^j, of so many periods that both cost
 * alike: the subspace is smaller.  Its vectors' span is invariant under Phi, of which the
 * multipliers are the Ritz values there,
 *
 *     Q^T Phi Q s = rho s,   residual |Phi Q s - rho Q s|;                                      (1)
 *
 * where different multipliers have one j-th power the span may lack a vector, which the residual
 * shows: then j = 1.
 *
 * The bound: for a Gaussian matrix W of r columns and any A, by [HMT11, Lemma 4.1],
 *
 *     |A| <= 10 sqrt(2/pi) max_i |A w_i|   with probability 1 - 10^-r,                          (2)
 *
 * and every multiplier's j-th power is at most |Phi^j|.
 *
 * [HMT11] Halko, Martinsson, Tropp, SIAM Review 53 (2011) 217-288.
 */
#include "modal/scene/leading.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/eigen.h"
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"
#include "modal/scene/period_map.h"

static const double ALIKE = 1e-15;                    /* moduli of a pair, to rounding */
static const double LEAST_RADIUS = 1e-12;             /* a radius of 0 is reached in a period */
static const double BOUND_FACTOR = 7.9788456080286536;   /* 10 sqrt(2/pi), (2) */
enum {
    SUBSPACE = 200,              /* vectors at which both costs are weighed: chosen */
    PERIODS_MOST = 32,           /* a product: what settles first does so by then */
    LOOKS = 15,                  /* operations a cubed vector, all looks of arnoldi.c */
    DENSE = 4,                   /* dense operations in the time of one, as BUDGET_DENSE */
};

struct powers { struct period_map *map; int periods, carried; };

/* y = Phi^periods x */
static enum modal_status carry(void *context, const double *x, double *y, struct modal_error *err)
{
    struct powers *p = context;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < p->periods && rc == MODAL_OK; i++, p->carried++)
        rc = period_map_carry(p->map, i == 0 ? x : y, y, err);
    return rc;
}

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "multipliers: out of memory");
}

/* Orthonormal columns that span those of A's, n x count, real. */
static bool basis_of(const struct arnoldi *a, size_t n, double *Q)
{
    int count = a->count;
    double *tau = calloc((size_t)count + 1, sizeof *tau);
    bool ok = tau != NULL;

    for (int c = 0; c < count; c++)
        for (size_t i = 0; i < n; i++)       /* of a pair: the real part, then the imaginary */
            Q[i + (size_t)c * n] = cimag(a->w[c]) < 0 ? cimag(a->V[i + (size_t)c * n])
                                                      : creal(a->V[i + (size_t)c * n]);
    ok = ok && LAPACKE_dgeqrf(LAPACK_COL_MAJOR, (int)n, count, Q, (int)n, tau) == 0
         && LAPACKE_dorgqr(LAPACK_COL_MAJOR, (int)n, count, count, Q, (int)n, tau) == 0;
    free(tau);
    return ok;
}

/* The condition of the power nearest to W^PERIODS. */
static double condition_of(const struct arnoldi *a, double complex w, int periods)
{
    double complex power = cpow(w, periods);
    int best = 0;

    for (int i = 1; i < a->count; i++)
        if (cabs(a->w[i] - power) < cabs(a->w[best] - power))
            best = i;
    return a->condition[best];
}

/* (1) into L: values, residuals and conditions, descending in modulus; *WORST residual over the
 * largest modulus.  Q, PQ n x count. */
static enum modal_status take_ritz(struct leading *l, const struct powers *p, const double *Q,
                                   const double *PQ, double *worst, struct modal_error *err)
{
    struct arnoldi *a = &l->found;
    size_t n = (size_t)period_map_states(p->map);
    int count = a->count;
    size_t order = (size_t)count;
    struct workspace space = { 0 };
    double *H = workspace_zeros(&space, order * order, sizeof *H),
           *condition = workspace_zeros(&space, order, sizeof *condition),
           *residual = workspace_zeros(&space, order, sizeof *residual),
           *frequency = workspace_zeros(&space, order, sizeof *frequency);
    double complex *w = workspace_zeros(&space, order, sizeof *w),
                   *y = workspace_zeros(&space, n, sizeof *y),
                   *V = workspace_zeros(&space, order * order, sizeof *V);
    struct matrix small = { count, count, count, H };
    enum modal_status rc = space.failed ? no_memory(err) : MODAL_OK;

    if (rc == MODAL_OK) {
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, count, count, (int)n, 1, Q, (int)n, PQ,
                    (int)n, 0, H, count);
        rc = eigen_general(&small, w, NULL, V, err);
    }
    *worst = 0;
    for (int c = 0; rc == MODAL_OK && c < count; c++) {
        double off = 0;
        for (size_t i = 0; i < n; i++) {
            double complex sum = 0, here = 0;
            for (size_t k = 0; k < order; k++) {
                sum += PQ[i + k * n] * V[k + (size_t)c * order];
                here += Q[i + k * n] * V[k + (size_t)c * order];
            }
            sum -= w[c] * here;
            y[i] = here;
            off += numbers_square(sum);
        }
        residual[c] = sqrt(off);
        frequency[c] = period_map_frequency(p->map, y);
        condition[c] = condition_of(a, w[c], p->periods);
        *worst = fmax(*worst, residual[c]);
    }
    for (int done = 0; rc == MODAL_OK && done < count; done++) {
        int best = -1;                       /* a pair's first comes first, and equals its second */
        for (int c = 0; c < count; c++)
            if (residual[c] >= 0 && (best < 0 || cabs(w[c]) > cabs(w[best]) * (1 + ALIKE)))
                best = c;
        a->w[done] = w[best];
        a->condition[done] = condition[best];
        a->residual[done] = residual[best];
        l->frequency[done] = frequency[best];
        residual[best] = -1;
    }
    *worst /= rc == MODAL_OK ? cabs(a->w[0]) : 1;
    workspace_free(&space);
    return rc;
}

/* From the vectors of Phi^periods those of Phi. */
static enum modal_status refine(struct powers *p, struct leading *l, double *worst,
                                struct modal_error *err)
{
    size_t n = (size_t)period_map_states(p->map), count = (size_t)l->found.count;
    double *Q = calloc(n * count + 1, sizeof *Q), *PQ = calloc(n * count + 1, sizeof *PQ);
    struct powers one = { p->map, 1, 0 };
    enum modal_status rc;

    free(l->frequency);
    l->frequency = calloc(count + 1, sizeof *l->frequency);
    rc = Q != NULL && PQ != NULL && l->frequency != NULL ? MODAL_OK : no_memory(err);
    if (rc == MODAL_OK && !basis_of(&l->found, n, Q))
        rc = no_memory(err);
    for (size_t c = 0; rc == MODAL_OK && c < count; c++)
        rc = carry(&one, Q + c * n, PQ + c * n, err);
    p->carried += one.carried;
    if (rc == MODAL_OK)
        rc = take_ritz(l, p, Q, PQ, worst, err);
    free(Q);
    free(PQ);
    return rc;
}

/* Periods a product: carrying costs what orthogonalising does beside SUBSPACE vectors. */
static int periods_of(const struct period_map *m)
{
    double orthogonal = 2.0 * SUBSPACE * period_map_states(m), ratio;

    ratio = orthogonal / period_map_work(m);
    return ratio < 1 ? 1 : ratio > PERIODS_MOST ? PERIODS_MOST : (int)ratio;
}

double leading_vector_work(const struct period_map *m, int vectors)
{
    return vectors * (2.0 * period_map_states(m) + (double)LOOKS * vectors) / DENSE;
}

/* Vectors beside which one more costs what carrying one over PERIODS does. */
static int even_of(const struct period_map *m, int periods)
{
    int even = 1;

    while (even < ARNOLDI_MOST && leading_vector_work(m, even) < periods * period_map_work(m))
        even++;
    return even;
}

enum modal_status leading_multipliers(struct period_map *m, int wanted, double tolerance, int most,
                                      struct leading *out, struct modal_error *err)
{
    struct powers p = { .map = m, .periods = periods_of(m) };
    struct linear_operator A = { period_map_states(m), period_map_states(m), &p, carry, NULL };
    double worst = 0;
    enum modal_status rc;

    *out = (struct leading){ 0 };
    do {
        int products = most > 0 ? (most - p.carried) / p.periods : 0;
        if (most > 0 && products < wanted)
            products = wanted;
        /* the basis loses some, and more of a power's */
        rc = arnoldi(&A, wanted, tolerance / (p.periods > 1 ? 10 : 2), products,
                     even_of(m, p.periods), &out->found, err);
        if (rc == MODAL_OK)
            rc = refine(&p, out, &worst, err);
        out->periods = p.carried;
        if (rc != MODAL_OK) {
            leading_done(out);
            return rc;
        }
        if (p.periods == 1 || !out->found.settled || worst <= tolerance)
            break;
        arnoldi_done(&out->found);
        p.periods = 1;
    } while (true);
    out->found.settled = worst <= tolerance;
    return MODAL_OK;
}

void leading_done(struct leading *l)
{
    arnoldi_done(&l->found);
    free(l->frequency);
    *l = (struct leading){ 0 };
}

enum modal_status leading_residual(struct period_map *m, double complex w,
                                   const double complex *start, double *residual,
                                   struct modal_error *err)
{
    size_t n = (size_t)period_map_states(m);
    double *x = calloc(2 * n + 1, sizeof *x), off = 0;
    enum modal_status rc = x != NULL ? MODAL_OK : no_memory(err);

    for (size_t i = 0; rc == MODAL_OK && i < n; i++) {
        x[i] = creal(start[i]);
        x[n + i] = cimag(start[i]);
    }
    for (size_t part = 0; rc == MODAL_OK && part < 2; part++)
        rc = period_map_carry(m, x + part * n, x + part * n, err);
    for (size_t i = 0; rc == MODAL_OK && i < n; i++) {
        double complex d = CMPLX(x[i], x[n + i]) - w * start[i];
        off += numbers_square(d);
    }
    *residual = sqrt(off);
    free(x);
    return rc;
}

/* A Gaussian number, by a linear congruence and Box and Muller's way. */
static double gaussian(uint64_t *state)
{
    double u[2];

    for (int i = 0; i < 2; i++) {
        *state = *state * 6364136223846793005u + 1442695040888963407u;
        u[i] = ((double)(*state >> 11) + 0.5) / 9007199254740992.0;
    }
    return sqrt(-2 * log(u[0])) * cos(2 * M_PI * u[1]);
}

double leading_bound_periods(const struct period_map *m, double largest, double enough)
{
    /* 10 sqrt(2/pi) sqrt(n) largest^j <= enough^j */
    double start = log(BOUND_FACTOR * sqrt(period_map_states(m)));

    return LEADING_PROBES * ceil(start / log(enough / fmax(largest, LEAST_RADIUS)));
}

enum modal_status leading_bound(struct period_map *m, double enough, int most, double *bound,
                                int *periods, struct modal_error *err)
{
    size_t n = (size_t)period_map_states(m);
    double *x = calloc(n * LEADING_PROBES + 1, sizeof *x);
    uint64_t state = 1;
    enum modal_status rc = x != NULL ? MODAL_OK : no_memory(err);

    *bound = HUGE_VAL;
    *periods = 0;
    for (size_t i = 0; rc == MODAL_OK && i < n * LEADING_PROBES; i++)
        x[i] = gaussian(&state);
    for (int j = 1; rc == MODAL_OK && *bound > enough && *periods + LEADING_PROBES <= most; j++) {
        double largest = 0;
        for (size_t i = 0; rc == MODAL_OK && i < LEADING_PROBES; i++, ++*periods) {
            rc = period_map_carry(m, x + i * n, x + i * n, err);
            largest = fmax(largest, cblas_dnrm2((int)n, x + i * n, 1));
        }
        *bound = rc == MODAL_OK ? fmin(*bound, pow(BOUND_FACTOR * largest, 1.0 / j)) : *bound;
    }
    free(x);
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}
