/*
 * blocks.c - see blocks.h
 *
 * Kept as a sparse matrix of single numbers, by columns, dof after dof:
 *
 *     column j m + c: rows i m + r of block (i, j), i down column j of the pattern,             (1)
 *
 * r = 0 .. m - 1 where a law mixes harmonics between i and j; else the block is of S_k alone, which
 * couples Re X_k and Im X_k only, and has two rows a column, one for the mean: `thin`.  A border is
 * the last row of each column and the last column.  Factored by sparse_lu.h, whose order of
 * elimination is found once.
 */
#include "modal/steady/blocks.h"
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/lanes.h"
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"
#include "modal/steady/pattern.h"

struct blocks {
    const struct pattern *pattern;
    int HJ, m, order;             /* order = q m, or one more */
    bool bordered;                /* the last row and column are a border */
    int *start, *index;           /* by columns */
    int *full, *thin;   /* per entry of the pattern: blocks of either kind above it in its column */
    double *value, *stiffened, *scratch;
    struct workspace space;       /* of the arrays, but `stiffened`: made when it is asked for */
    struct sparse_lu *lu;         /* its symbolic part is made once */
    double work;                  /* operations of all factorizations */
};

/* Rows of a thin block in column c, */
static int thin_rows(int c) { return c == 0 ? 1 : 2; }
/* and the first of them: that of Re X_k. */
static int thin_first(int c) { return c == 0 ? 0 : 2 * ((c + 1) / 2) - 1; }

/* How many blocks of either kind lie above each in its column: where it begins follows by (1). */
static void count_above(struct blocks *b)
{
    const struct pattern *p = b->pattern;

    for (int j = 0; j < p->q; j++) {
        int full = 0, thin = 0;

        for (int e = p->start[j]; e < p->start[j + 1]; e++) {
            b->full[e] = full;
            b->thin[e] = thin;
            full += p->mixes[e];
            thin += !p->mixes[e];
        }
    }
}

/* Numbers in all; of a thin block 1 + 2 (m - 1). */
static size_t count_entries(const struct pattern *p, int m, bool bordered)
{
    size_t total = 0;

    for (int e = 0; e < pattern_entries(p); e++)
        total += p->mixes[e] ? (size_t)m * (size_t)m : 2 * (size_t)m - 1;
    return total + (bordered ? 2 * (size_t)p->q * (size_t)m + 1 : 0);
}

/* Rows and column starts of (1). */
static void fill_structure(struct blocks *b)
{
    const struct pattern *p = b->pattern;
    int at = 0;

    for (int j = 0; j < p->q; j++)
        for (int c = 0; c < b->m; c++) {
            b->start[j * b->m + c] = at;
            for (int e = p->start[j]; e < p->start[j + 1]; e++) {
                int rows = p->mixes[e] ? b->m : thin_rows(c);
                /* the block's first row in this column */
                int first = p->index[e] * b->m + (p->mixes[e] ? 0 : thin_first(c));

                for (int r = 0; r < rows; r++)
                    b->index[at++] = first + r;
            }
            if (b->bordered)
                b->index[at++] = b->order - 1;
        }
    for (int i = 0; b->bordered && i < b->order; i++) {
        b->start[b->order - 1] = i == 0 ? at : b->start[b->order - 1];
        b->index[at++] = i;                             /* the border column is full */
    }
    b->start[b->order] = at;
}

enum modal_status blocks_new(const struct pattern *pattern, int HJ, bool bordered,
                             struct blocks **out, struct modal_error *err)
{
    struct blocks *b = calloc(1, sizeof *b);
    int m = 2 * HJ + 1;
    size_t pairs = (size_t)pattern_entries(pattern);
    size_t entries = count_entries(pattern, m, bordered);
    size_t order = (size_t)pattern->q * (size_t)m + bordered;  /* one more with a border */
    enum modal_status rc = MODAL_OK;

    if (b == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "blocks: no memory");
    if (entries > INT_MAX / 2) {
        rc = modal_fail_field(err, MODAL_TOO_LARGE, "steady.harmonics",
                              "%d nonlinear dofs at %d harmonics have a derivative of %zu entries; "
                              "the most is %d", pattern->q, HJ, entries, INT_MAX / 2);
        goto out;
    }
    *b = (struct blocks) { .pattern = pattern, .HJ = HJ, .m = m, .order = (int)order,
                           .bordered = bordered };
    b->start = workspace_zeros(&b->space, order + 1, sizeof *b->start);
    b->index = workspace_zeros(&b->space, entries + 1, sizeof *b->index);
    b->full = workspace_zeros(&b->space, pairs + 1, sizeof *b->full);
    b->thin = workspace_zeros(&b->space, pairs + 1, sizeof *b->thin);
    b->value = workspace_zeros(&b->space, entries + 1, sizeof *b->value);
    b->scratch = workspace_zeros(&b->space, order + 1, sizeof *b->scratch);
    if (b->space.failed) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "blocks: no memory for %zu entries", entries);
        goto out;
    }
    count_above(b);
    fill_structure(b);
    rc = sparse_lu_new(b->order, b->start, b->index, false, &b->lu, err);
out:
    if (rc == MODAL_OK)
        *out = b;
    else
        blocks_free(b);
    return rc;
}

void blocks_free(struct blocks *b)
{
    if (b == NULL)
        return;
    free(b->stiffened);
    workspace_free(&b->space);
    sparse_lu_free(b->lu);
    free(b);
}

int blocks_harmonics(const struct blocks *b) { return b->HJ; }
double blocks_rcond(const struct blocks *b) { return sparse_lu_rcond(b->lu); }
double blocks_work(const struct blocks *b) { return b->work; }

void blocks_clear(struct blocks *b)
{
    memset(b->value, 0, (size_t)b->start[b->order] * sizeof *b->value);
}

double *blocks_column(struct blocks *b, int i, int j, int c)
{
    int e = pattern_find(b->pattern, i, j);
    int above = b->full[e] * b->m + b->thin[e] * thin_rows(c);  /* (1) */
    double *at = b->value + b->start[j * b->m + c] + above;

    /* so that entry r is at [r] in either kind */
    return b->pattern->mixes[e] ? at : at - thin_first(c);
}

void blocks_set_border(struct blocks *b, const struct blocks *a, double scale, const double *column,
                       const double *row, double corner)
{
    int n = b->order - 1;

    for (int j = 0; j < n; j++) {
        int count = a->start[j + 1] - a->start[j];

        for (int e = 0; e < count; e++)
            /* A's column, of the same rows */
            b->value[b->start[j] + e] = scale * a->value[a->start[j] + e];
        b->value[b->start[j] + count] = row[j];         /* the border is last in its column */
    }
    memcpy(b->value + b->start[n], column, (size_t)n * sizeof *column);
    b->value[b->start[n] + n] = corner;
}

/* Factor VALUE in this structure, its work counted. */
static bool factor(struct blocks *b, const double *value)
{
    bool ok = sparse_lu_factor(b->lu, value);

    b->work += sparse_lu_work(b->lu);                   /* of this factorization */
    return ok;
}

bool blocks_factor(struct blocks *b, int *sign)
{
    if (!factor(b, b->value))
        return false;
    if (sign != NULL)
        *sign = sparse_lu_sign(b->lu);
    return true;
}

bool blocks_factor_stiffened(struct blocks *b, double mu)
{
    size_t entries = (size_t)b->start[b->order];
    double most;

    /* The values themselves stay: they are asked for again with a larger MU. */
    if (b->stiffened == NULL)
        b->stiffened = malloc((entries + 1) * sizeof *b->stiffened);
    if (b->stiffened == NULL)
        return false;
    most = numbers_largest(b->value, entries);
    memcpy(b->stiffened, b->value, entries * sizeof *b->value);
    for (int j = 0; j < b->order; j++)
        for (int e = b->start[j]; e < b->start[j + 1]; e++)
            if (b->index[e] == j)
                b->stiffened[e] += mu * most;           /* on the diagonal, which every dof has */
    return isfinite(most) && most > 0 && factor(b, b->stiffened);
}

void blocks_solve(struct blocks *b, double *y)
{
    memcpy(b->scratch, y, (size_t)b->order * sizeof *y);  /* sparse_lu_solve wants two places */
    sparse_lu_solve(b->lu, b->scratch, y);
}

void blocks_within(const struct blocks *b, int k, double complex *T)
{
    const struct pattern *p = b->pattern;

    for (int j = 0; j < p->q; j++)
        for (int e = p->start[j]; e < p->start[j + 1]; e++) {
            int c = k > 0 ? 2 * k - 1 : 0, above = b->full[e] * b->m + b->thin[e] * thin_rows(c);
            /* the first of Re X_k's rows, and Im X_k's column has as many numbers above */
            int first = above + (p->mixes[e] ? c : 0);
            const double *re = b->value + b->start[j * b->m + c] + first;
            const double *im = k > 0 ? b->value + b->start[j * b->m + c + 1] + first : NULL;

            T[e] = k > 0 ? CMPLX((re[0] + im[1]) / 2, (re[1] - im[0]) / 2) : re[0];
        }
}

/* y += a x, M numbers. */
LANES_BODY void add_run(int m, double a, const double *x, double *y)
{
    int i = 0;

    for (; i + LANES <= m; i += LANES)
        *(lanes *)(y + i) += *(const lanes *)(x + i) * a;
    for (; i < m; i++)
        y[i] += x[i] * a;
}

/* y += B x, column by column of (1). */
LANES_BODY void multiply(const struct blocks *b, const double *x, double *y)
{
    const struct pattern *p = b->pattern;
    const double *value = b->value;

    for (int j = 0; j < p->q; j++)
        for (int c = 0; c < b->m; c++, x++) {
            for (int e = p->start[j]; e < p->start[j + 1]; e++) {
                double *to = y + p->index[e] * b->m + (p->mixes[e] ? 0 : thin_first(c));

                add_run(p->mixes[e] ? b->m : thin_rows(c), *x, value, to);
                value += p->mixes[e] ? b->m : thin_rows(c);
            }
            if (b->bordered)
                y[b->order - 1] += *value++ * *x;
        }
    if (b->bordered)
        add_run(b->order, *x, value, y);
}

LANES_NARROW void multiply_narrow(const struct blocks *b, const double *x, double *y)
{
    multiply(b, x, y);
}

LANES_WIDE void multiply_wide(const struct blocks *b, const double *x, double *y)
{
    multiply(b, x, y);
}

void blocks_multiply(const struct blocks *b, const double *x, double *y)
{
    memset(y, 0, (size_t)b->order * sizeof *y);
    (lanes_wide() ? multiply_wide : multiply_narrow)(b, x, y);
}

double blocks_entries(const struct blocks *b) { return b->start[b->order]; }
