/*
 * point.c - see point.h, and session.h for what the files of one solution share
 *
 * Samples.  Of a polynomial of degree p, N > (p + 1) H samples have exact harmonics (aft.c); laws
 * with pieces are exact by themselves, and their motion is seen between 4 H samples; others get 32
 * H, where aliasing of forces that fall as k^-2 is 1/1000 of the first harmonic left out.
 *
 * Work.  The least factorization costs 2/3 n^3 of n = q (2 H + 1) unknowns where the matrix is full
 * (balance_dense_work), and about 2 q m^3, m = 2 H + 1, of blocks of a chain.  A solution may cost
 *
 *     most = max(min(WORK (1 + q / WORK_DOFS), WORK_FEW (1 + (d / DOFS_FEW)^2)),
 *                ASKED factorizations at the H asked for),                                      (1)
 *
 * counted in operations (budget.h), so that it ends at the same place on every machine; d: the
 * dofs that are stepped, kept or not.
 */
#include "modal/steady/session.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/craig_bampton.h"
#include "modal/scene/program.h"
#include "modal/steady/aft.h"
#include "modal/steady/balance.h"
#include "modal/steady/condense.h"
#include "modal/steady/iterate.h"
#include "modal/steady/pattern.h"

/* The error of a solution whose options name none: a millionth of the largest displacement. */
static const double TARGET = 1e-6;
/* What a basis may leave of receptances where nobody said: a hundredth of what answers by factors
 * agree to (1e-8). */
static const double SHARED = 1e-10;
/* Operations that a solution of one dof may cost: seconds, at 1e9 of them in one. */
static const double WORK = 3e9;
/* Kept dofs that double it. */
static const double WORK_DOFS = 100;
/* Structures of few dofs are stepped and balanced for less, and are to be answered in a second:
 * chosen, a quarter of WORK.  A step takes 2 (2 d)^2 / BUDGET_DENSE operations beside some three
 * hundred of its laws and calls: twice as many from a dozen dofs on. */
static const double WORK_FEW = 0.75e9;
static const double DOFS_FEW = 12;
enum {
    REDUCE_LEAST = 48,    /* linear dofs below which factoring a band beats summing over their
                           * modes */
    H_LEAST = 8,             /* the first H where the loads are low */
    N_LEAST = 64,   /* where laws and H ask for fewer: kinks are seen to a 64th */
    N_MOST = 1 << 17,   /* 16 samples a harmonic of ORBIT_HARMONICS_MOST */
    N_PER_H = 4,          /* of the motion, */
    N_SAMPLED = 32,       /* and of laws that are neither polynomials nor of pieces */
    ASKED = 30               /* factorizations at the harmonics asked for: an attempt of twenty
                              * steps, and half as much for the ways from fewer */
};

/* A power of two transforms fastest. */
int steady_power_of_two(long least)
{
    int N = 1;

    while (N < least && N < N_MOST)
        N *= 2;
    return N;
}

/* A power of two, or three quarters of one, which transforms as fast a sample. */
static int short_product(long least)
{
    int N = steady_power_of_two(least);

    return N / 4 * 3 >= least && N > N_LEAST ? N / 4 * 3 : N;  /* a radix of 3 beside 2 */
}

/* Samples that H harmonics of these laws need, where the options name none. */
static int steady_samples(const struct steady *s, int H)
{
    long least = N_LEAST;

    if (s->opt.samples > 0)
        return s->opt.samples;
    least = N_PER_H * H + 2 > least ? N_PER_H * H + 2 : least;
    if (s->degree > 0 && (s->degree + 1) * H + 1 > least)
        least = (s->degree + 1) * H + 1;
    if (s->sampled && N_SAMPLED * H > least)
        least = N_SAMPLED * H;
    return short_product(least);
}

int steady_first_order(const struct steady *s)
{
    int both = 2 * condense_highest_load(s->c) + 1;

    return both > H_LEAST ? both : H_LEAST;
}

struct condense *steady_condense(struct steady *s) { return s->c; }
const struct program *steady_program(const struct steady *s) { return s->p; }

enum modal_status steady_reduce(struct steady *s, int points, struct modal_error *err)
{
    bool done;

    /* A basis or modes cost once, and pay over many frequencies. */
    if (condense_factors(s->c))
        return condense_share(s->c, s->opt.krylov > 0 ? s->opt.krylov : SHARED,
                              points, err);
    return s->p->n - condense_kept(s->c) < REDUCE_LEAST ? MODAL_OK
                                                        : condense_reduce(s->c, &done, err);
}

enum modal_status steady_balance(struct steady *s, int H, struct balance **out,
                                 struct modal_error *err)
{
    enum modal_status rc;

    for (int i = 0; i < s->balances; i++)
        if (s->balance[i]->H == H) {
            *out = s->balance[i];
            return MODAL_OK;
        }
    if (s->balances == BALANCES) {
        /* the oldest; orders grow, and are asked for again from the last */
        balance_free(s->balance[0]);
        memmove(s->balance, s->balance + 1, (BALANCES - 1) * sizeof s->balance[0]);
        s->balances--;
    }
    rc = balance_new(s->p, s->c, H, steady_samples(s, H), !s->opt.unlocated,
                     &s->balance[s->balances], err);
    if (rc == MODAL_OK) {
        /* all balances of a session count together */
        s->balance[s->balances]->budget = &s->budget;
        s->balance[s->balances]->joint = s->joint;
        *out = s->balance[s->balances++];
    }
    return rc;
}

void steady_drop_balances(struct steady *s)
{
    for (int i = 0; i < s->balances; i++)
        balance_free(s->balance[i]);
    s->balances = 0;
    balance_free(s->wide);
    s->wide = NULL;
}

struct iterate_options steady_iterate_options(const struct steady *s)
{
    return (struct iterate_options){ .tolerance = s->opt.tolerance,
                                     .most = s->opt.max_iterations,
                                     .relaxation = s->opt.relaxation,
                                     .by_differences = s->opt.by_differences,
                                     .cutoff = s->opt.cutoff,
                                     .slope = s->slope,
                                     .cancelled = s->opt.cancelled,
                                     .context = s->opt.context };
}

/* What a factorization costs at H, nearly. */
double steady_factor_work(const struct steady *s, int H)
{
    double q = condense_kept(s->c), m = 2.0 * H + 1;

    /* sparse: q blocks of order m */
    return condense_pattern(s->c)->full ? balance_dense_work((int)(q * m)) : 2 * q * m * m * m;
}

/* A solution's budget begins: a hundred dofs that iterate may spend twice what one may, and whoever
 * asks for many harmonics as much as an attempt at them takes. */
void steady_allow_work(struct steady *s)
{
    double q = condense_kept(s->c), d = s->p->n / DOFS_FEW,
           most = fmin(WORK * (1 + q / WORK_DOFS), WORK_FEW * (1 + d * d)),
           asked = s->opt.harmonics > 0 ? ASKED * steady_factor_work(s, s->opt.harmonics) : 0;

    s->budget = (struct budget){ .most = fmax(most, asked) };  /* from 0 */
}

double steady_least_work(void) { return WORK_FEW; }

int steady_counted_dof(const struct steady *s, int i)
{
    return s->opt.dofs != NULL ? s->opt.dofs[i] : i;
}

void start_write(const struct balance *b, const struct steady_start *start, double complex *X)
{
    memset(X, 0, (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
    for (int i = 0; start != NULL && i < b->q && i < start->q; i++)
        for (int k = 0; k <= b->H && k <= start->H; k++)
            X[i * (b->H + 1) + k] = start->X[i * (start->H + 1) + k];  /* the harmonics both have */
}

void steady_point_done(struct steady_point *point)
{
    free(point->X);
    free(point->evaluations);
    free(point->acts);
    free(point->undetermined);
    free(point->multiplier);
    memset(point, 0, sizeof *point);
}

enum modal_status point_init(struct steady *s, struct steady_point *point, int q, int H, int N,
                             struct modal_error *err)
{
    double complex *X = calloc((size_t)q * ((size_t)H + 1) + 1, sizeof *X);

    /* Of another order it has another size; counts and flags are of laws and stay. */
    free(point->X);
    point->X = X;
    point->q = q;
    point->H = H;
    point->N = N;
    point->c = s->c;
    point->linear = NULL;
    point->laws = s->p->laws;
    point->residual = -1;
    point->converged = false;
    if (point->evaluations == NULL) {
        point->evaluations = calloc((size_t)s->p->laws + 1, sizeof *point->evaluations);
        point->acts = calloc((size_t)s->p->laws + 1, sizeof *point->acts);
        point->undetermined = calloc((size_t)s->p->laws + 1, sizeof *point->undetermined);
    }
    if (X == NULL || point->evaluations == NULL || point->acts == NULL
        || point->undetermined == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a point");
    return MODAL_OK;
}

/* BEST is POINT's motion, flags, multipliers and errors, its arrays its own. */
enum modal_status point_copy(const struct steady_point *point, struct steady_point *best,
                                   struct modal_error *err)
{
    size_t size = (size_t)point->q * ((size_t)point->H + 1), laws = (size_t)point->laws;

    free(best->X);
    free(best->acts);
    free(best->undetermined);
    free(best->multiplier);
    *best = *point;
    best->evaluations = NULL;
    best->X = malloc((size + 1) * sizeof *best->X);
    best->acts = malloc((laws + 1) * sizeof *best->acts);
    best->undetermined = malloc((laws + 1) * sizeof *best->undetermined);
    best->multiplier = calloc((size_t)point->states + 1, sizeof *best->multiplier);
    if (best->X == NULL || best->acts == NULL || best->undetermined == NULL
        || best->multiplier == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a point");
    memcpy(best->X, point->X, size * sizeof *best->X);
    memcpy(best->acts, point->acts, laws * sizeof *best->acts);
    memcpy(best->undetermined, point->undetermined, laws * sizeof *best->undetermined);
    if (point->states > 0)
        memcpy(best->multiplier, point->multiplier,
               (size_t)point->states * sizeof *best->multiplier);
    return MODAL_OK;
}

void point_count(const struct balance *b, const long *before, long ffts_before,
                 struct steady_point *point)
{
    for (int l = 0; l < point->laws; l++) {
        point->evaluations[l] += aft_evaluations(b->aft, l) - before[l];
        point->acts[l] = aft_acts(b->aft, l);        /* of the last force, which was the answer's */
        point->undetermined[l] = aft_undetermined(b->aft, l);
    }
    point->ffts += aft_transforms(b->aft) - ffts_before;
}

enum modal_status steady_point_of(struct steady *s, struct balance *b, const double complex *X,
                                    struct steady_point *point, struct modal_error *err)
{
    long *before = calloc((size_t)s->p->laws + 1, sizeof *before), ffts = aft_transforms(b->aft);
    enum modal_status rc;

    memset(point, 0, sizeof *point);
    if (before == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    for (int l = 0; l < s->p->laws; l++)
        before[l] = aft_evaluations(b->aft, l);
    rc = point_init(s, point, b->q, b->H, aft_samples(b->aft), err);
    if (rc == MODAL_OK)
        rc = balance_residual(b, X, false, err);
    if (rc == MODAL_OK) {
        memcpy(point->X, X, (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
        point_count(b, before, ffts, point);
        point->residual = balance_relative_residual(b, X);
        point->omega = b->omega;
        point->level = b->level;
        point->converged = true;
        /* not known yet */
        point->error = point->truncation = point->sampling = point->solver = NAN;
    } else
        steady_point_done(point);
    free(before);
    return rc;
}

const struct craig_bampton *steady_reduction(const struct steady *s) { return s->reduction; }

int steady_dof(const struct steady *s, int i)
{
    return s->reduction == NULL ? i : i < s->reduction->kept ? s->reduction->dofs[i] : -1;
}

double steady_target(const struct steady *s)
{
    return s->opt.target_error > 0 ? s->opt.target_error : TARGET;
}

enum modal_status steady_recover(struct steady *s, const struct steady_point *point, int dof,
                                 double complex *X, struct modal_error *err)
{
    int own = s->reduction == NULL ? dof : craig_bampton_find(s->reduction, dof);

    return condense_recover(point->linear != NULL ? point->linear : s->c, own, point->H, point->X,
                            point->H, X, err);
}
