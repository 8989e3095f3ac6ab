/*
 * by_harmonic.c - see by_harmonic.h
 *
 * J d = r by GMRES, preconditioned from the left, so that the norm is one of motions, with
 *
 *     P = the parts T_k of J that are of harmonic k in both rows and columns,                   (1)
 *
 * T_k of (3) of balance.c: S_k and the laws' mean slopes.  P^-1 J differs from 1 by what laws mix:
 * where few act, or all act weakly, in a few directions.  P of blocks before these serves as long
 * as a solution with it costs less than factors do.
 *
 * With F operations and L entries in the factors of one T_k those of the blocks, of m rows, have
 * m^3 F and m^2 L: nothing else of them need be known to tell which way is cheaper.
 */
#include "modal/steady/by_harmonic.h"
#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/gmres.h"
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/workspace.h"
#include "modal/steady/blocks.h"
#include "modal/steady/budget.h"
#include "modal/steady/pattern.h"

enum {
    VECTORS_MOST = 100,        /* of GMRES: orthogonalizing so many costs as much as the products */
    VECTORS_USUAL = 40         /* that joints in part slipping were seen to take */
};

struct by_harmonic {
    const struct pattern *pattern;
    int q, K, m;                          /* K = HJ + 1, m = 2 HJ + 1 */
    double complex *T;                    /* [k entries + e] */
    struct sparse_lu **factors;           /* of each k */
    double complex *in, *out;             /* q each */
    struct gmres *gmres;
    const struct blocks *blocks;          /* of the solution under way */
    double work, rcond, flops, fill;      /* F and L of the opening comment */
    double making, solving;               /* work of the factors there are; 0: none; of the last
                                           * solution */
    bool old;                             /* they are of blocks before these */
    struct workspace space;               /* of the arrays */
};

struct by_harmonic *by_harmonic_new(const struct pattern *pattern, int HJ)
{
    struct by_harmonic *s = calloc(1, sizeof *s);
    size_t entries = (size_t)pattern_entries(pattern), K = (size_t)HJ + 1;
    bool ok;

    if (s == NULL)
        return NULL;
    *s = (struct by_harmonic) { .pattern = pattern, .q = pattern->q, .K = HJ + 1, .m = 2 * HJ + 1 };
    s->T = workspace_zeros(&s->space, entries * K, sizeof *s->T);
    s->factors = workspace_zeros(&s->space, K, sizeof *s->factors);
    s->in = workspace_zeros(&s->space, (size_t)s->q, sizeof *s->in);
    s->out = workspace_zeros(&s->space, (size_t)s->q, sizeof *s->out);
    s->gmres = gmres_new((size_t)s->q * (size_t)s->m, VECTORS_MOST);
    ok = s->gmres != NULL && !s->space.failed;
    for (size_t k = 0; ok && k < K; k++)
        ok = sparse_lu_new(s->q, pattern->start, pattern->index, true, &s->factors[k], NULL)
             == MODAL_OK;
    if (ok)
        return s;
    by_harmonic_free(s);
    return NULL;
}

void by_harmonic_free(struct by_harmonic *s)
{
    if (s == NULL)
        return;
    for (int k = 0; s->factors != NULL && k < s->K; k++)
        sparse_lu_free(s->factors[k]);
    gmres_free(s->gmres);
    workspace_free(&s->space);
    free(s);
}

/* P of B. */
static bool factor_all(struct by_harmonic *s, const struct blocks *b)
{
    size_t entries = (size_t)pattern_entries(s->pattern);
    double before = s->work;

    gmres_forget(s->gmres);
    s->rcond = 1;
    s->old = false;
    s->making = s->solving = 0;
    for (int k = 0; k < s->K; k++) {
        double complex *T = s->T + (size_t)k * entries;

        blocks_within(b, k, T);
        if (!sparse_lu_factor(s->factors[k], T))
            return false;
        s->flops = sparse_lu_flops(s->factors[k]);
        s->fill = sparse_lu_fill(s->factors[k]);
        s->rcond = fmin(s->rcond, sparse_lu_rcond(s->factors[k]));
        s->work += sparse_lu_work(s->factors[k]) / BUDGET_DENSE;
    }
    s->making = s->work - before;
    return true;
}

bool by_harmonic_factor(struct by_harmonic *s, const struct blocks *b)
{
    gmres_forget(s->gmres);                             /* B is another, if P is not */
    s->old = s->making > 0 && s->solving < s->making;
    return s->old || factor_all(s, b);
}

double by_harmonic_rcond(const struct by_harmonic *s) { return s->rcond; }
double by_harmonic_work(const struct by_harmonic *s) { return s->work; }

/* Operations of a product with P^-1 J: four real ones a complex entry. */
static double product_work(const struct by_harmonic *s, const struct blocks *b)
{
    return 4 * s->K * s->fill + blocks_entries(b);
}

double by_harmonic_solution(const struct by_harmonic *s, const struct blocks *b)
{
    double sums = VECTORS_USUAL * (double)s->q * s->m / BUDGET_DENSE;     /* to orthogonalize */

    return VECTORS_USUAL * (product_work(s, b) + sums);
}

double by_harmonic_of_blocks(const struct by_harmonic *s)
{
    double m = s->m;

    /* of complex numbers: four times the operations, and as many entries */
    return (m * m * m * s->flops / 4 + m * m * SPARSE_LU_ENTRY * s->fill) / BUDGET_DENSE;
}

/* y <- P^-1 y */
static void precondition(struct by_harmonic *s, double *y)
{
    for (int k = 0; k < s->K; k++) {
        double *at = y + (k > 0 ? 2 * k - 1 : 0);

        for (int i = 0; i < s->q; i++)
            s->in[i] = CMPLX(at[i * s->m], k > 0 ? at[i * s->m + 1] : 0);
        sparse_lu_solve(s->factors[k], s->in, s->out);
        for (int i = 0; i < s->q; i++) {
            at[i * s->m] = creal(s->out[i]);
            if (k > 0)
                at[i * s->m + 1] = cimag(s->out[i]);
        }
    }
}

/* out <- P^-1 B in */
static void product(void *context, const double *in, double *out)
{
    struct by_harmonic *s = context;

    blocks_multiply(s->blocks, in, out);
    precondition(s, out);
}

/* y <- B^-1 y with the factors there are; false where it is not reached, or for want of memory. */
static bool solve(struct by_harmonic *s, const struct blocks *b, double left, double *y)
{
    bool ok;

    s->blocks = b;
    precondition(s, y);
    ok = gmres_solve(s->gmres, product, s, left, y);
    s->solving = gmres_vectors(s->gmres) * product_work(s, b)
               + gmres_work(s->gmres) / BUDGET_DENSE;
    s->work += s->solving;
    return ok;
}

bool by_harmonic_solve(struct by_harmonic *s, const struct blocks *b, double left, double *y)
{
    size_t n = (size_t)s->q * (size_t)s->m;
    double *given = s->old ? malloc((n + 1) * sizeof *given) : NULL;
    bool ok;

    if (given != NULL)
        memcpy(given, y, n * sizeof *y);
    ok = solve(s, b, left, y);
    if (!ok && given != NULL) {                         /* once more, with P of these blocks */
        memcpy(y, given, n * sizeof *y);
        ok = factor_all(s, b) && solve(s, b, left, y);
    }
    free(given);
    return ok;
}
