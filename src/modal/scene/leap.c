/*
 * leap.c - see leap.h
 *
 * With K_i the slopes and theta = (t - t0) / h the interpolant of order 7 is [HNW93, II.6]
 *
 *     y0 + theta (F1 + (1 - theta)(F2 + theta (F3 + (1 - theta)(F4 + ...)))),                   (1)
 *     F1 = y1 - y0,  F2 = h K_0 - F1,  F3 = 2 F1 - h (K_0 + K_12),  F4.. = h sum_j d_j K_j
 *
 * and the error, from those of orders 5 and 3, E5^2 / sqrt(E5^2 + E3^2 / 100)             (2)
 *
 * [HNW93]: see dormand_prince.c.
 */
#include "modal/scene/leap.h"
#include <math.h>
#include <string.h>
#include "modal/scene/dofwise.h"

static const double THIRD_ORDER_SHARE = 0.01;    /* in (2), of [HNW93] */

void leap_init(struct leap *l, struct dofwise *of, double *stage, struct workspace *space)
{
    size_t states = 2 * (size_t)of->n;

    *l = (struct leap){ .of = of, .stage = stage };
    l->from = workspace_zeros(space, states, sizeof *l->from);
    l->to = workspace_zeros(space, states, sizeof *l->to);
    for (int i = 0; i < DORMAND_PRINCE_ALL; i++)
        l->slope[i] = workspace_zeros(space, states, sizeof **l->slope);
    for (int i = 0; i < DORMAND_PRINCE_DENSE; i++)
        l->part[i] = workspace_zeros(space, states, sizeof **l->part);
}

/* Is DOF in the leap's set? */
static bool leap_holds(const struct leap *l, int dof)
{
    int low = 0, high = l->set->runs;

    while (low < high) {             /* the first run that ends past it */
        int middle = (low + high) / 2;
        if (l->set->run[middle].to <= dof)
            low = middle + 1;
        else
            high = middle;
    }
    return low < l->set->runs && l->set->run[low].from <= dof;
}

double leap_at(const struct leap *l, int i, double theta)
{
    double value = 0;

    for (int k = DORMAND_PRINCE_DENSE - 1; k >= 0; k--)      /* (1) from within */
        value = (value + l->part[k][i]) * (k % 2 == 0 ? theta : 1 - theta);
    return l->from[i] + value;
}

double leap_value(const struct leap *l, int i, double t)
{
    while (l->around != NULL && !leap_holds(l, i % l->of->n))
        l = l->around;
    return leap_at(l, i, l->h > 0 ? (t - l->t) / l->h : 0);
}

/* Slopes and what each counts for, times h; those that count for nothing left out: many do. */
struct slopes {
    int count;
    const double *k[DORMAND_PRINCE_ALL];
    double by[DORMAND_PRINCE_ALL];
};

/* OUT = BASE + sum_j by[j] k[j], numbers FROM .. TO - 1; BASE may be NULL.  Four sums at a time
 * stay in registers, as two pairs where the machine has such; each adds in the order of j. */
static void combine(const struct slopes *s, const double *base, int from, int to, double *out)
{
    int at = from;

    for (; at + 4 <= to; at += 4) {
        double a = 0, b = 0, c = 0, d = 0;
        if (base != NULL)
            a = base[at], b = base[at + 1], c = base[at + 2], d = base[at + 3];
        for (int j = 0; j < s->count; j++) {
            const double *k = s->k[j] + at;
            double by = s->by[j];
            a += by * k[0];
            b += by * k[1];
            c += by * k[2];
            d += by * k[3];
        }
        out[at] = a, out[at + 1] = b, out[at + 2] = c, out[at + 3] = d;
    }
    for (; at < to; at++) {
        double sum = base != NULL ? base[at] : 0;
        for (int j = 0; j < s->count; j++)
            sum += s->by[j] * s->k[j][at];
        out[at] = sum;
    }
}

/* The same of COUNT slopes by WEIGHT, over the set's displacements and rates. */
static void combine_set(const struct leap *l, const double *weight, int count, const double *base,
                        double *out)
{
    struct slopes s = { 0 };
    int n = l->of->n;

    for (int j = 0; j < count; j++)
        if (weight[j] != 0) {
            s.k[s.count] = l->slope[j];
            s.by[s.count++] = l->h * weight[j];
        }
    for (int r = 0; r < l->set->runs; r++) {
        struct dof_run run = l->set->run[r];
        combine(&s, base, run.from, run.to, out);
        combine(&s, base, n + run.from, n + run.to, out);
    }
}

/* What the set looks at around it. */
static void fill_rim(const struct leap *l, double t, double *y)
{
    int n = l->of->n;

    for (int k = 0; k < l->set->rims; k++) {
        int dof = l->set->rim[k];
        y[dof] = leap_value(l, dof, t);
        y[n + dof] = leap_value(l, n + dof, t);
    }
}

enum modal_status leap_slope(const struct leap *l, double t, double *y, const double *memory,
                             double *slope, struct modal_error *err)
{
    int n = l->of->n;

    fill_rim(l, t, y);
    for (int r = 0; r < l->set->runs; r++)       /* x' = v */
        memcpy(slope + l->set->run[r].from, y + n + l->set->run[r].from,
               (size_t)(l->set->run[r].to - l->set->run[r].from) * sizeof *slope);
    return dofwise_accelerate(l->of, l->set, t, y, y + n, memory, slope + n, err);
}

/* (1)'s coefficients. */
static void interpolate(struct leap *l)
{
    int n = l->of->n;

    for (int k = 3; k < DORMAND_PRINCE_DENSE; k++)
        combine_set(l, dormand_prince_dense[k - 3], DORMAND_PRINCE_ALL, NULL, l->part[k]);
    for (int r = 0; r < 2 * l->set->runs; r++) {
        struct dof_run run = l->set->run[r / 2];
        int shift = r % 2 == 0 ? 0 : n;          /* displacements, then rates */
        for (int i = shift + run.from; i < shift + run.to; i++) {
            double whole = l->to[i] - l->from[i], first = l->h * l->slope[0][i],
                   last = l->h * l->slope[DORMAND_PRINCE_END][i];
            l->part[0][i] = whole;
            l->part[1][i] = first - whole;
            l->part[2][i] = 2 * whole - (first + last);
        }
    }
}

/* Stages FROM .. TO - 1. */
static enum modal_status make_stages(struct leap *l, int from, int to, const double *memory,
                                     struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int s = from; s < to && rc == MODAL_OK; s++) {
        double node = dormand_prince_node[s], end = l->t + l->h, t = l->t + node * l->h;
        double *y = s == DORMAND_PRINCE_END ? l->to : l->stage;
        combine_set(l, dormand_prince_weight[s], s, l->from, y);
        /* a load that changes at the end is the next leap's */
        rc = leap_slope(l, node == 1 ? nextafter(end, l->t) : t, y, memory, l->slope[s], err);
    }
    return rc;
}

/* From `from` and slope[0] at t over h: `to`, and the slopes as far as there. */
static enum modal_status leap_end(struct leap *l, const double *memory, struct modal_error *err)
{
    enum modal_status rc;

    fill_rim(l, l->t, l->from);
    rc = dofwise_watch(l->of, l->set, l->t, l->h, l->from, l->from + l->of->n, memory, err);
    return rc == MODAL_OK ? make_stages(l, 1, DORMAND_PRINCE_END + 1, memory, err) : rc;
}

enum modal_status leap_make(struct leap *l, const double *memory, struct modal_error *err)
{
    enum modal_status rc = leap_end(l, memory, err);

    if (rc == MODAL_OK)
        rc = make_stages(l, DORMAND_PRINCE_END + 1, DORMAND_PRINCE_ALL, memory, err);
    if (rc == MODAL_OK)
        interpolate(l);
    return rc;
}

/* The largest error by an embedded formula of those whose laws are not APART. */
static double largest(const struct leap *l, const double *formula, const double *weight,
                      const int *apart)
{
    int n = l->of->n;
    double most = 0;

    combine_set(l, formula, DORMAND_PRINCE_END + 1, NULL, l->stage);
    for (int r = 0; r < l->set->runs; r++)
        for (int i = l->set->run[r].from; i < l->set->run[r].to; i++)
            if (apart == NULL || apart[i] < 0)
                most = fmax(most, fmax(fabs(l->stage[i]) * weight[i],
                                       fabs(l->stage[n + i]) * weight[n + i]));
    return most;
}

double leap_error(const struct leap *l, const double *weight, const int *apart)
{
    double third = largest(l, dormand_prince_error3, weight, apart),
           fifth = largest(l, dormand_prince_error5, weight, apart);

    return fifth == 0 ? 0 : fifth * fifth / hypot(fifth, sqrt(THIRD_ORDER_SHARE) * third);
}
