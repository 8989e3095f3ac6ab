/*
 * stiffness.c - see stiffness.h
 *
 * S_k of (2) of condense.h, k = 0 .. H, each factored when it is first asked for: direct iteration
 * asks for all, a short matrix of Newton's method for those past HJ, Newton's whole one for none.
 * LAPACK's LU where every dof acts on every other, sparse factors (sparse_lu.h) else, of one
 * pattern for all k.  |S_k^-1| is bounded by Gershgorin's circles: with d_i = |S_ii| - sum_j
 * |S_ij|,
 *
 *     |S_k^-1| <= 1 / min_i d_i   in the norm of rows,   where every d_i > 0.                   (1)
 */
#include "modal/steady/stiffness.h"
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"
#include "modal/steady/pattern.h"

/* A pivot below so many roundings of the largest entry may be 0. */
static const double PIVOT = 16;

/* What is known of one harmonic's factors. */
enum made { NOT_YET, SINGULAR, FACTORED };

/* The matrices of one frequency, and their factors as far as they were asked for. */
struct stiffness {
    const struct pattern *pattern;
    const double complex *S;                            /* borrowed: the balance's */
    int q, H;
    double complex *LU, *scratch;     /* full: q x q for each k; q */
    int *pivot;                       /* full: q for each k */
    struct sparse_lu **factors;       /* sparse: for each k */
    enum made *made;
    struct workspace space;           /* of the arrays */
};

enum modal_status stiffness_new(const struct pattern *pattern, int H, struct stiffness **out,
                                struct modal_error *err)
{
    struct stiffness *s = calloc(1, sizeof *s);
    size_t q = (size_t)pattern->q, K = (size_t)H + 1;

    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "stiffness: no memory");
    *s = (struct stiffness) { .pattern = pattern, .q = pattern->q, .H = H };
    s->made = workspace_zeros(&s->space, K, sizeof *s->made);
    s->scratch = workspace_zeros(&s->space, q + 1, sizeof *s->scratch);
    if (pattern->full) {
        s->LU = workspace_zeros(&s->space, q * q * K + 1, sizeof *s->LU);
        s->pivot = workspace_zeros(&s->space, q * K + 1, sizeof *s->pivot);
    } else
        s->factors = workspace_zeros(&s->space, K, sizeof *s->factors);
    if (s->space.failed) {
        stiffness_free(s);
        return modal_fail(err, MODAL_NO_MEMORY, "stiffness: no memory for %d harmonics", H);
    }
    *out = s;
    return MODAL_OK;
}

void stiffness_free(struct stiffness *s)
{
    if (s == NULL)
        return;
    for (int k = 0; s->factors != NULL && k <= s->H; k++)
        sparse_lu_free(s->factors[k]);
    workspace_free(&s->space);
    free(s);
}

void stiffness_set(struct stiffness *s, const double complex *S)
{
    s->S = S;
    memset(s->made, 0, ((size_t)s->H + 1) * sizeof *s->made);  /* NOT_YET */
}

/* LU of S_k; false where its least pivot is rounding of its largest entry. */
static bool factor_full(struct stiffness *s, int k)
{
    int q = s->q;
    size_t size = (size_t)q * (size_t)q;
    double complex *A = s->LU + (size_t)k * size;
    double scale, least = HUGE_VAL;

    memcpy(A, s->S + (size_t)k * size, size * sizeof *A);  /* S itself is multiplied by later */
    scale = numbers_modulus(A, size);
    if (LAPACKE_zgetrf_work(LAPACK_COL_MAJOR, q, q, A, q, s->pivot + (size_t)k * (size_t)q) != 0)
        return false;
    for (int i = 0; i < q; i++)
        least = fmin(least, cabs(A[(size_t)i * ((size_t)q + 1)]));
    return least > PIVOT * DBL_EPSILON * scale;
}

/* The same of a sparse S_k; the order of elimination is that of its pattern. */
static bool factor_sparse(struct stiffness *s, int k)
{
    const struct pattern *p = s->pattern;

    if (s->factors[k] == NULL
        && sparse_lu_new(p->q, p->start, p->index, true, &s->factors[k], NULL) != MODAL_OK)
        return false;
    return sparse_lu_factor(s->factors[k], s->S + (size_t)k * (size_t)pattern_entries(p));
}

bool stiffness_solve(struct stiffness *s, int k, double complex *y)
{
    int q = s->q;

    if (q == 1 && s->S[k] != 0) {                       /* a number: nothing to factor */
        *y /= s->S[k];
        return true;
    }
    if (s->made[k] == NOT_YET)
        /* kept until another S is set */
        s->made[k] = (s->pattern->full ? factor_full : factor_sparse)(s, k) ? FACTORED : SINGULAR;
    if (s->made[k] == SINGULAR)
        return false;
    if (s->pattern->full)
        LAPACKE_zgetrs_work(LAPACK_COL_MAJOR, 'N', q, 1, s->LU + (size_t)k * (size_t)q * (size_t)q,
                            q, s->pivot + (size_t)k * (size_t)q, y, q);
    else {
        memcpy(s->scratch, y, (size_t)q * sizeof *y);   /* sparse_lu_solve wants two places */
        sparse_lu_solve(s->factors[k], s->scratch, y);
    }
    return true;
}

void stiffness_multiply_add(const struct pattern *p, const double complex *S, int k,
                            const double complex *x, int stride, double complex *y)
{
    const double complex *value = S + (size_t)k * (size_t)pattern_entries(p);

    if (p->q == 1) {
        y[0] += value[0] * x[0];                        /* one dof: its index is not looked up */
        return;
    }
    for (int j = 0; j < p->q; j++)
        for (int e = p->start[j]; e < p->start[j + 1]; e++)
            y[p->index[e]] += value[e] * x[(size_t)j * (size_t)stride];
}

double stiffness_least(const struct pattern *p, const double complex *S, int k)
{
    const double complex *value = S + (size_t)k * (size_t)pattern_entries(p);
    double *exceeds = p->q > 1 ? calloc((size_t)p->q + 1, sizeof *exceeds) : NULL, least = HUGE_VAL;

    if (exceeds == NULL)
        return p->q == 1 ? cabs(value[0]) : 0;
    for (int j = 0; j < p->q; j++)
        for (int e = p->start[j]; e < p->start[j + 1]; e++)
            /* Gershgorin: the diagonal over the row's rest */
            exceeds[p->index[e]] += p->index[e] == j ? cabs(value[e]) : -cabs(value[e]);
    for (int i = 0; i < p->q; i++)
        least = fmin(least, exceeds[i]);                /* (1) */
    free(exceeds);
    return least;
}
