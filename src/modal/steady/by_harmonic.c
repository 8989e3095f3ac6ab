/*
 * by_harmonic.c - see by_harmonic.h
 *
 * J d = r by GMRES [SS86], preconditioned from the left, so that the norm is one of motions, with
 *
 *     P = the parts T_k of J that are of harmonic k in both rows and columns,                   (1)
 *
 * T_k of (3) of balance.c: S_k and the laws' mean slopes.  P^-1 J differs from 1 by what laws mix:
 * where few act, or all act weakly, in a few directions.  P of blocks before these serves as long
 * as a solution with it costs less than factors do.
 *
 * With F operations and L entries in the factors of one T_k those of the blocks, of m rows, have
 * m^3 F and m^2 L: nothing else of them need be known to tell which way is cheaper.
 *
 * [SS86] Saad and Schultz, SIAM J. Sci. Stat. Comput. 7 (1986) 856-869.
 */
#include "modal/steady/by_harmonic.h"
#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
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
    double *vector[VECTORS_MOST + 1];     /* of GMRES, q m each, made when first used */
    double work, rcond, flops, fill;      /* F and L of the opening comment */
    double making, solving;               /* work of the factors there are; 0: none; of the last
                                           * solution */
    bool old;                             /* they are of blocks before these */
    struct workspace space;               /* of the arrays but `vector` */
};

enum modal_status by_harmonic_new(const struct pattern *pattern, int HJ, struct by_harmonic **out,
                                  struct modal_error *err)
{
    struct by_harmonic *s = calloc(1, sizeof *s);
    size_t entries = (size_t)pattern_entries(pattern), K = (size_t)HJ + 1;
    enum modal_status rc = MODAL_OK;

    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "by harmonic: no memory");
    *s = (struct by_harmonic) { .pattern = pattern, .q = pattern->q, .K = HJ + 1, .m = 2 * HJ + 1 };
    s->T = workspace_zeros(&s->space, entries * K, sizeof *s->T);
    s->factors = workspace_zeros(&s->space, K, sizeof *s->factors);
    s->in = workspace_zeros(&s->space, (size_t)s->q, sizeof *s->in);
    s->out = workspace_zeros(&s->space, (size_t)s->q, sizeof *s->out);
    rc = workspace_check(&s->space, "by harmonic: no memory", err);
    for (size_t k = 0; rc == MODAL_OK && k < K; k++)
        rc = sparse_lu_new(s->q, pattern->start, pattern->index, true, &s->factors[k], err);
    if (rc == MODAL_OK)
        *out = s;
    else
        by_harmonic_free(s);
    return rc;
}

void by_harmonic_free(struct by_harmonic *s)
{
    if (s == NULL)
        return;
    for (int k = 0; s->factors != NULL && k < s->K; k++)
        sparse_lu_free(s->factors[k]);
    for (int i = 0; i <= VECTORS_MOST; i++)
        free(s->vector[i]);
    workspace_free(&s->space);
    free(s);
}

/* P of B. */
static bool factor_all(struct by_harmonic *s, const struct blocks *b)
{
    size_t entries = (size_t)pattern_entries(s->pattern);
    double before = s->work;

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

static double dot(size_t n, const double *a, const double *b)
{
    double sum = 0;

    for (size_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* y += factor x */
static void add(size_t n, double factor, const double *x, double *y)
{
    for (size_t i = 0; i < n; i++)
        y[i] += factor * x[i];
}

/* Vector I, there from now on; false: no memory. */
static bool have_vector(struct by_harmonic *s, int i)
{
    if (s->vector[i] == NULL)
        s->vector[i] = malloc(((size_t)s->q * (size_t)s->m + 1) * sizeof **s->vector);
    return s->vector[i] != NULL;
}

/* The least squares of Hessenberg's matrix, turned column by column: its triangle, the right side,
 * the turns. */
struct least { double R[VECTORS_MOST][VECTORS_MOST + 1], g[VECTORS_MOST + 1], c[VECTORS_MOST],
               s[VECTORS_MOST]; };

/* Column K of it is new. */
static void turn(struct least *l, int k)
{
    double *h = l->R[k], size;

    for (int j = 0; j < k; j++) {                       /* Givens' rotations of those before */
        double t = l->c[j] * h[j] + l->s[j] * h[j + 1];

        h[j + 1] = l->c[j] * h[j + 1] - l->s[j] * h[j];
        h[j] = t;
    }
    size = hypot(h[k], h[k + 1]);
    l->c[k] = size > 0 ? h[k] / size : 1;
    l->s[k] = size > 0 ? h[k + 1] / size : 0;
    h[k] = size;
    l->g[k + 1] = -l->s[k] * l->g[k];
    l->g[k] *= l->c[k];
}

/* y <- the combination of the first K vectors that leaves least. */
static void combine(struct by_harmonic *s, struct least *l, int k, double *y)
{
    size_t n = (size_t)s->q * (size_t)s->m;

    memset(y, 0, n * sizeof *y);
    for (int i = k - 1; i >= 0; i--) {
        for (int j = i + 1; j < k; j++)
            l->g[i] -= l->R[j][i] * l->g[j];
        l->g[i] = l->R[i][i] != 0 ? l->g[i] / l->R[i][i] : 0;
        add(n, l->g[i], s->vector[i], y);
    }
}

/* y <- B^-1 y with the factors there are; false where it is not reached, or for want of memory. */
static bool solve(struct by_harmonic *s, const struct blocks *b, double left, double *y)
{
    size_t n = (size_t)s->q * (size_t)s->m;
    struct least *l = calloc(1, sizeof *l);
    double first;
    bool ok = l != NULL && have_vector(s, 0);
    int k = 0;

    if (!ok) {
        free(l);
        return false;
    }
    s->solving = 0;
    precondition(s, y);
    first = l->g[0] = sqrt(dot(n, y, y));
    for (size_t i = 0; i < n; i++)
        s->vector[0][i] = first > 0 ? y[i] / first : 0;
    for (; fabs(l->g[k]) > left * first && k < VECTORS_MOST && have_vector(s, k + 1); k++) {
        double *w = s->vector[k + 1], size;

        blocks_multiply(b, s->vector[k], w);
        precondition(s, w);
        for (int j = 0; j <= k; j++) {                  /* modified Gram and Schmidt */
            l->R[k][j] = dot(n, s->vector[j], w);
            add(n, -l->R[k][j], s->vector[j], w);
        }
        l->R[k][k + 1] = size = sqrt(dot(n, w, w));
        for (size_t i = 0; size > 0 && i < n; i++)
            w[i] /= size;
        turn(l, k);
        s->solving += product_work(s, b) + k * (double)n / BUDGET_DENSE;
    }
    ok = isfinite(first) && fabs(l->g[k]) <= left * first;
    combine(s, l, k, y);
    free(l);
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
