/*
 * assign.c - shortest augmenting paths, as in the Hungarian method [K55]
 *
 * Costs are what a pair is worth less than nothing, -worth; M further columns of cost 0, one a row,
 * stand for "with none".  With potentials u, v such that no reduced cost c_ij - u_i - v_j is
 * negative and those of the pairs made are 0, each row is brought in along the path of least
 * reduced cost to a column that is free, found as Dijkstra does.
 *
 * [K55] Kuhn, Naval Research Logistics Quarterly 2 (1955) 83-97.
 */
#include "modal/identify/live/assign.h"
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

/* Columns are counted from 1: column 0 is where the row that is brought in stands. */
struct search {
    const double *worth;
    int m, n;
    double *u, *v, *least;
    int *row, *before;
    bool *done;
};

static double cost(const struct search *s, int i, int j)
{
    double worth = j < s->n ? s->worth[i * s->n + j] : 0;

    /* columns past n stand for "to none", worth nothing */
    return worth > 0 || j >= s->n ? -worth : HUGE_VAL;
}

/* The next column of the path from the one J, whose distance is 0 by now. */
static int next_column(struct search *s, int j)
{
    int columns = s->n + s->m, best = 0;
    double step = HUGE_VAL;

    s->done[j] = true;
    for (int k = 1; k <= columns; k++) {
        /* the reduced cost, never negative: the shortest path is Dijkstra's */
        double c = cost(s, s->row[j] - 1, k - 1) - s->u[s->row[j]] - s->v[k];
        if (s->done[k])
            continue;
        if (c < s->least[k])
            s->least[k] = c, s->before[k] = j;
        if (s->least[k] < step)
            step = s->least[k], best = k;
    }
    for (int k = 0; k <= columns; k++)
        if (s->done[k])
            /* potentials follow, so that costs on the tree stay 0 */
            s->u[s->row[k]] += step, s->v[k] -= step;
        else
            s->least[k] -= step;
    return best;
}

static void bring_in(struct search *s, int i)
{
    int j = 0;

    for (int k = 0; k <= s->n + s->m; k++)
        s->least[k] = HUGE_VAL, s->done[k] = false;
    s->row[0] = i;
    do
        j = next_column(s, j);
    while (s->row[j] != 0);
    for (; j != 0; j = s->before[j])
        /* the path turned over: each column takes the row of the one before */
        s->row[j] = s->row[s->before[j]];
}

enum modal_status assign_best(const double *worth, int m, int n, int *column,
                              struct modal_error *err)
{
    size_t columns = (size_t)(m + n) + 1;
    struct search s = { .worth = worth, .m = m, .n = n,
                        .u = calloc((size_t)m + 1, sizeof *s.u),
                        .v = calloc(columns, sizeof *s.v),
                        .least = calloc(columns, sizeof *s.least),
                        .row = calloc(columns, sizeof *s.row),
                        .before = calloc(columns, sizeof *s.before),
                        .done = calloc(columns, sizeof *s.done) };
    bool there = s.u != NULL && s.v != NULL && s.least != NULL && s.row != NULL
        && s.before != NULL && s.done != NULL;

    for (int i = 0; i < m && there; i++)
        column[i] = -1;
    for (int i = 1; i <= m && there; i++)
        bring_in(&s, i);
    for (int j = 1; j <= n && there; j++)
        if (s.row[j] > 0)
            column[s.row[j] - 1] = j - 1;
    free(s.u), free(s.v), free(s.least), free(s.row), free(s.before), free(s.done);
    return there ? MODAL_OK
                 : modal_fail(err, MODAL_NO_MEMORY, "assign: no memory for %d x %d", m, n);
}
