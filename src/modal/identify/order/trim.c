/*
 * trim.c - which poles a set does without
 *
 * What the others lose by its absence is (1) of rise.h: all poles' from one inverse of a triangle.
 * The pole that goes takes its columns out of R; rotations make it a triangle again, carry Z
 * along, and leave in its last rows what (1) says. So the rows of the record are read once,
 * however many poles go: each costs q^2 (q/3 + S) multiplications.
 */
#include "modal/identify/order/trim.h"
#include "modal/identify/fit/rise.h"
#include "modal/identify/linear/exponents.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/qr.h"

struct trim {
    const struct refine_data *data;
    struct projected p;
    int ld;                      /* of p.R, p.Z and below */
    double *room;                /* rise.h: ld x (ld + columns) */
    double *rise;                /* per pole and signal: (1) of rise.h */
    double complex *lambda; int count;
};

static void drop_pole(struct trim *t, int j)
{
    t->count--;
    memmove(t->lambda + j, t->lambda + j + 1, (size_t)(t->count - j) * sizeof *t->lambda);
}

/* Column I out of R, and Z along. */
static void drop_column(struct trim *t, int i)
{
    int q = t->p.order, ld = t->ld, S = t->p.columns, phases = t->p.criterion.phases;
    double *R = t->p.R, *Z = t->p.Z;

    for (int j = i; j < q - 1; j++)
        memcpy(R + j * ld, R + (j + 1) * ld, (size_t)(j + 2) * sizeof *R);
    for (int j = i; j < q - 1; j++) {
        double a = R[j + j * ld], b = R[j + 1 + j * ld], c, s;
        /* without column i R is upper Hessenberg from there on: one rotation a row */
        cblas_drotg(&a, &b, &c, &s);
        R[j + j * ld] = a, R[j + 1 + j * ld] = 0;
        if (j + 1 < q - 1)
            cblas_drot(q - 2 - j, R + j + (j + 1) * ld, ld, R + j + 1 + (j + 1) * ld, ld, c, s);
        cblas_drot(S, Z + j, ld, Z + j + 1, ld, c, s);
    }
    for (int c = 0; c < S; c++)
        /* the direction that only the lost column had */
        t->p.rss[c / phases] += Z[q - 1 + (size_t)c * ld] * Z[q - 1 + (size_t)c * ld];
    t->p.order--;
}

/* By how much the criterion's first part rises with RISE. */
static double loss_of(const struct criterion *k, const double *rss, const double *rise)
{
    double sum = 0;

    for (int g = 0; g < k->groups; g++) {
        /* what is below rounding or the grid neither gains nor loses */
        double floor = fmax(k->floor2[g], DBL_MIN) * k->numbers;
        if (k->energy[g] > 0)
            sum += k->own * log(fmax(rss[g] + rise[g], floor) / fmax(rss[g], floor));
    }
    return sum;
}

/* The pole that may go and costs least; -1: none. */
static int cheapest(struct trim *t, const struct trim_options *opt)
{
    const struct criterion *k = &t->p.criterion;
    int q = t->p.order, rows = t->data->Y->m, at = -1;
    bool must = opt->order > 0 && q > opt->order;
    double least = HUGE_VAL, tau = t->data->tau;
    int apart = poles_apart(t->lambda, t->count, tau, rows);

    if (!rise_without(&t->p, t->ld, t->lambda, t->count, tau, t->room, t->rise))
        return -1;
    for (int j = 0; j < t->count; j++) {
        int n = pole_order(t->lambda[j], tau),
            left = apart - poles_apart(&t->lambda[j], 1, tau, rows);
        double price = criterion_price(k, apart, q, t->p.parameters)
                     - criterion_price(k, left, q - n, t->p.parameters - n), excess;
        /* < 0: its absence costs less than it */
        excess = loss_of(k, t->p.rss, t->rise + j * k->groups) - opt->share * price - opt->reach;
        if ((excess < 0 || must) && excess < least)
            least = excess, at = j;
    }
    return at;
}

/* Is column J in the span of those before it? */
static bool dependent(const struct projected *p, int j)
{
    return qr_dependent(p->R + (size_t)j * (size_t)p->order, j);
}

/* Poles whose columns those before them span are dropped, one stays; how many were. */
static int drop_dependent(struct trim *t)
{
    int dropped = 0;

    for (int j = 0, column = 0; j < t->count && t->count > 1;) {
        int n = pole_order(t->lambda[j], t->data->tau);
        /* of two that coincide the first stays */
        bool spanned = dependent(&t->p, column) || (n == 2 && dependent(&t->p, column + 1));
        column += n;
        if (spanned)
            drop_pole(t, j), dropped++;
        else
            j++;
    }
    return dropped;
}

/* The factorisation, of poles that are independent. */
static enum modal_status project(struct trim *t, double *work, struct modal_error *err)
{
    for (;;) {
        enum modal_status rc = refine_project(t->data, t->lambda, t->count, NULL, &t->p, err);
        if (rc != MODAL_OK)
            return rc;
        *work += t->p.work;
        if (!t->p.degenerate || drop_dependent(t) == 0)
            return MODAL_OK;
        projected_done(&t->p);
    }
}

static void leave_out(struct trim *t, const struct trim_options *opt)
{
    int start = t->count;

    while (t->count > 1 && (opt->most == 0 || start - t->count < opt->most)) {
        int j = cheapest(t, opt), first = 0, n;
        if (j < 0)
            return;
        for (int i = 0; i < j; i++)
            first += pole_order(t->lambda[i], t->data->tau);
        n = pole_order(t->lambda[j], t->data->tau);
        for (int i = n - 1; i >= 0; i--)
            drop_column(t, first + i);
        t->p.parameters -= n;
        drop_pole(t, j);
    }
}

enum modal_status trim_poles(const struct refine_data *data, double complex *lambda, int *count,
                             const struct trim_options *opt, double *work, struct modal_error *err)
{
    struct trim t = { .data = data, .lambda = lambda, .count = *count };
    double spent = 0;
    enum modal_status rc = project(&t, &spent, err);
    size_t q = (size_t)t.p.order, groups = (size_t)t.p.criterion.groups;

    if (rc != MODAL_OK)
        return rc;
    t.ld = t.p.order;
    t.room = calloc(q * (q + (size_t)t.p.columns) + 1, sizeof(double));
    t.rise = calloc(groups * (size_t)t.count + 1, sizeof(double));
    if (t.room == NULL || t.rise == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "trim: no memory for order %d", t.p.order);
    } else {
        if (!t.p.degenerate)
            leave_out(&t, opt);
        *count = t.count;
        if (work != NULL)
            *work += spent;
    }
    free(t.room), free(t.rise);
    projected_done(&t.p);
    return rc;
}
