/*
 * wild.c - spikes and dropouts, told by what poles leave
 *
 * Of n numbers of white noise of known size one exceeds t standard deviations with a probability of
 *
 *     n erfc(t / sqrt 2) = IDENTIFY_ALARM                                                       (1)
 *
 * at most. The size is that of the column's other numbers, nu = L - order of them free, and the
 * ratio then Student's: t of (1) becomes
 *
 *     T = sqrt(nu (exp((t (8 nu + 3) / (8 nu + 1))^2 / nu) - 1)),                               (2)
 *
 * to a few thousandths [W59]. A first look takes the size by the median, which half of the column
 * may spoil. Where what is left is larger in some part of the record, as motion that the poles
 * lack is, a number must stand as far out of the median of the rows about it.
 *
 * What is taken out is rebuilt by the poles, which is one step of expectation and maximisation
 * [DLR77]: with fixed poles the fit comes to that of the other samples as powers of the share that
 * is missing, and ever smaller ones then stand out.  Numbers between two that stand out are those
 * of one dropout, where it happens to cross the motion. What stands out from the first row on, or
 * to the last, may be a mode that is gone after a few of them.
 *
 * [W59] Wallace, Ann. Math. Statist. 30 (1959) 1121-1130.
 * [DLR77] Dempster, Laird, Rubin, J. R. Stat. Soc. B 39 (1977) 1-38.
 */
#include "modal/identify/prepare/wild.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/result.h"
#include "modal/linalg/svd.h"
#include "modal/numbers.h"

enum {
    ABOUT = 32,                  /* rows before and after */
    RUN_GAP = 3,                 /* rows from one that stands out to the next, of one dropout */
    BISECTIONS = 32,             /* of (1): eight digits */
    PASSES = 8,                  /* of (1): each lowers what stands out by the share missing */
    FEW = 20                     /* one of so many numbers, at most: the fit is that of the others
                                  * within their errors however the poles rebuild them */
};
static const double
    SETTLED = 1e-3,              /* of what is left: far less than its own error */
    MEDIAN = 1.4826;             /* standard deviations, of normal noise, to the median magnitude */

struct look {
    const struct matrix *Y;      /* with what was taken out rebuilt */
    struct matrix F;             /* what the poles rebuild */
    double *e, *part;            /* a column of what they leave; room for a median */
    bool *out;                   /* L x S */
    double limit;                /* (1) */
    double left;                 /* by the last fit */
    int order;                   /* numbers of each column that the fit has */
};

static void look_done(struct look *k)
{
    free(k->F.x), free(k->e), free(k->part), free(k->out);
}

double wild_standing_out(double n)
{
    double low = 0, high = 40;      /* erfc(40 / sqrt 2) underflows */

    for (int i = 0; i < BISECTIONS; i++)
        *(n * erfc((low + high) / 2 * M_SQRT1_2) > IDENTIFY_ALARM ? &low : &high) =
            (low + high) / 2;
    return high;
}

/* (2) */
static double of_student(double t, double nu)
{
    double z = t * (8 * nu + 3) / (8 * nu + 1);

    return sqrt(nu * expm1(z * z / nu));
}

double wild_size(const double *e, int count, double *room)
{
    for (int i = 0; i < count; i++)
        room[i] = fabs(e[i]);
    return MEDIAN * numbers_ranked(room, (size_t)count, (size_t)count / 2);
}

/* The size of what stands not out. */
static double size_of_others(const double *e, const bool *out, int L, int order)
{
    double sum = 0;
    int free_rows = L - order;

    for (int l = 0; l < L; l++) {
        sum += out[l] ? 0 : e[l] * e[l];
        free_rows -= out[l];
    }
    return free_rows > 0 ? sqrt(sum / free_rows) : HUGE_VAL;
}

static bool stands_out(const struct look *k, int l, int L, double t, double size)
{
    int first = l > ABOUT ? l - ABOUT : 0, last = l + ABOUT < L ? l + ABOUT : L - 1;

    return fabs(k->e[l]) > t * size
        && fabs(k->e[l]) > t * wild_size(k->e + first, last - first + 1, k->part);
}

/* Dropouts are filled; what reaches the first row or the last is let be. */
static void join_runs(bool *out, int L)
{
    for (int l = 0, last = -RUN_GAP - 1; l < L; l++) {
        if (!out[l])
            continue;
        for (int i = last + 1; l - last <= RUN_GAP && i < l; i++)
            out[i] = true;
        last = l;
    }
    for (int l = 0; l < L && out[l]; l++)
        out[l] = false;
    for (int l = L - 1; l >= 0 && out[l]; l--)
        out[l] = false;
}

/* Those of column C, as it was SENT, into k->out. */
static void look_at_column(struct look *k, int c)
{
    int L = k->Y->m, nu = L - k->order;
    bool *out = k->out + (size_t)c * (size_t)L;
    const double *f = k->F.x + (size_t)c * (size_t)L, *y = k->Y->x + (size_t)c * (size_t)k->Y->ld;
    double least = REFINE_EXACT * safe_norm(y, (size_t)L) / sqrt(L), size, t;

    for (int l = 0; l < L; l++)
        k->e[l] = k->part[l] - f[l];             /* k->part: the column as sent */
    memset(out, 0, (size_t)L * sizeof *out);
    t = of_student(k->limit, nu);
    /* one in t^2 that stands out by far makes the size of all 1/t of it: more are not few */
    if (largest_magnitude(k->e, (size_t)L) <= k->limit * safe_norm(k->e, (size_t)L) / sqrt(L))
        return;
    size = fmax(wild_size(k->e, L, k->part), least);
    for (int pass = 0; pass < 2; pass++) {
        bool any = false;
        for (int l = 0; l < L; l++)
            any |= out[l] = stands_out(k, l, L, t, size);
        if (!any)
            return;
        size = fmax(size_of_others(k->e, out, L, k->order), least);
    }
    join_runs(out, L);
}

/* The columns as they were sent, from Y and what is kept of it. */
static void sent_column(const struct matrix *Y, const struct wild *w, int c, double *x)
{
    memcpy(x, Y->x + (size_t)c * (size_t)Y->ld, (size_t)Y->m * sizeof *x);
    for (int i = 0; i < w->count; i++)
        if (w->at[i].channel == c)
            x[w->at[i].row] = w->at[i].sent;
}

/* None stand out where they are no few; what was known before is wild all the same. */
static void look_at_known(struct look *k, const struct wild *w)
{
    size_t L = (size_t)k->Y->m, all = L * (size_t)k->Y->n, count = 0;

    for (size_t i = 0; i < all; i++)
        count += k->out[i];
    if (w->no_others || count > all / FEW)
        memset(k->out, 0, all * sizeof *k->out);
    for (int i = 0; i < w->known_count; i++)
        k->out[(size_t)w->known[i].row + (size_t)w->known[i].channel * L] = true;
}

/* Y without what stands out. */
static enum modal_status take_out(const struct look *k, struct matrix *Y, struct wild *w,
                                  struct modal_error *err)
{
    size_t all = (size_t)Y->m * (size_t)Y->n;
    double in = 0, energy = 0;
    int count = 0;

    wild_put_back(Y, w);
    for (size_t i = 0; i < all; i++) {
        energy += k->F.x[i] * k->F.x[i];
        count += k->out[i], in += k->out[i] ? k->F.x[i] * k->F.x[i] : 0;
    }
    if (count == 0)
        return MODAL_OK;
    w->at = malloc((size_t)count * sizeof *w->at);
    if (w->at == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "wild: no memory for %d samples", count);
    w->share = fmax((double)count / all, energy > 0 ? in / energy : 0);
    for (int c = 0; c < Y->n; c++)
        for (int l = 0; l < Y->m; l++) {
            double *y = Y->x + l + (size_t)c * (size_t)Y->ld;
            if (!k->out[l + (size_t)c * (size_t)Y->m])
                continue;
            w->at[w->count++] = (struct wild_sample) { l, c, *y };
            *y = k->F.x[l + (size_t)c * (size_t)Y->m];
        }
    return MODAL_OK;
}

/* Once more of (1). False: no others stand out than before, and the fit has settled. */
static enum modal_status pass(const struct rebuild_model *poles, struct matrix *Y, struct look *k,
                              struct wild *w, bool *more, struct modal_error *err)
{
    struct synthesis s = { 0 };
    int before = w->count;
    double left = k->left;
    enum modal_status rc = rebuild_record(poles, Y, &k->F, &s, err);

    for (int c = 0; c < Y->n && rc == MODAL_OK; c++) {
        sent_column(Y, w, c, k->part);
        look_at_column(k, c);
    }
    if (rc == MODAL_OK) {
        look_at_known(k, w);
        rc = take_out(k, Y, w, err);
    }
    k->left = s.residual;
    *more = w->count != before || (w->count > 0 && left - s.residual > SETTLED * left);
    synthesis_done(&s);
    return rc;
}

enum modal_status wild_take(const struct rebuild_model *poles, struct matrix *Y, struct wild *w,
                            struct modal_error *err)
{
    size_t L = (size_t)Y->m, S = (size_t)Y->n;
    struct look k = { .Y = Y, .F = matrix_new(Y->m, Y->n), .e = malloc(L * sizeof(double)),
                      .part = malloc(L * sizeof(double)), .out = malloc(L * S),
                      .order = rebuild_order(poles),
                      .left = HUGE_VAL, .limit = wild_standing_out((double)L * Y->n) };
    bool more = true;
    enum modal_status rc = MODAL_OK;

    if (k.F.x == NULL || k.e == NULL || k.part == NULL || k.out == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "wild: no memory for %d rows", Y->m);
    /* of fewer free ones a median tells too little */
    if (Y->m - k.order < REFINE_ROWS_LEAST)
        more = false;
    for (int i = 0; i < PASSES && more && rc == MODAL_OK; i++)
        rc = pass(poles, Y, &k, w, &more, err);
    look_done(&k);
    return rc;
}

/* ---- poles that drew none ---- */

struct strength { double energy; double complex lambda; };

static int by_strength(const void *a, const void *b)
{
    const struct strength *x = a, *y = b;

    return (x->energy < y->energy) - (x->energy > y->energy);
}

/* The poles by their motion's energy in the record. */
static enum modal_status rank_poles(const struct rebuild_model *p, const struct matrix *Y,
                                    struct strength *rank, struct modal_error *err)
{
    struct synthesis s = { 0 };
    enum modal_status rc = rebuild_record(p, Y, NULL, &s, err);

    for (int j = 0; j < p->count && rc == MODAL_OK; j++) {
        double rate = 2 * fabs(creal(p->lambda[j])) * p->tau, sum = 0;
        for (int c = 0; c < Y->n * p->shift; c++)
            sum += pow(cabs(s.coefficient[j + (size_t)c * (size_t)p->count]), 2);
        /* of a column whose largest number is 1 */
        sum *= rate > 0 ? -expm1(-rate * (Y->m / p->shift)) / rate : Y->m / p->shift;
        rank[j] = (struct strength) { sum, p->lambda[j] };
    }
    synthesis_done(&s);
    qsort(rank, rc == MODAL_OK ? (size_t)p->count : 0, sizeof *rank, by_strength);
    return rc;
}

/* Bayes' criterion of COUNT poles, by medians. */
static enum modal_status robust_worth(const struct rebuild_model *p, const struct matrix *Y,
                                      struct matrix *F, double *room, double *worth,
                                      struct modal_error *err)
{
    struct synthesis s = { 0 };
    int L = Y->m, S = Y->n;
    enum modal_status rc = rebuild_record(p, Y, F, &s, err);

    *worth = (S * rebuild_order(p) + poles_order(p->lambda, p->count, p->tau)) * log((double)L * S);
    for (int c = 0; c < S && rc == MODAL_OK; c++) {
        const double *y = Y->x + (size_t)c * (size_t)Y->ld;
        double *e = F->x + (size_t)c * (size_t)L,
            least = REFINE_EXACT * safe_norm(y, (size_t)L) / sqrt(L);
        for (int l = 0; l < L; l++)
            e[l] -= y[l];
        *worth += least > 0 ? 2 * L * log(fmax(wild_size(e, L, room), least)) : 0;
    }
    synthesis_done(&s);
    return rc;
}

enum modal_status wild_strongest(const struct rebuild_model *poles, const struct matrix *Y,
                                 double complex *best, int *best_count, struct modal_error *err)
{
    struct matrix F = matrix_new(Y->m, Y->n);
    double *room = malloc((size_t)Y->m * sizeof *room), least = HUGE_VAL, worth;
    struct strength *rank = calloc((size_t)poles->count + 1, sizeof *rank);
    struct rebuild_model some = *poles;
    int count = poles->count;
    enum modal_status rc = F.x == NULL || room == NULL || rank == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "wild: no memory for %d rows", Y->m)
        : rank_poles(poles, Y, rank, err);

    *best_count = 0;
    for (int j = 0; j < count && rc == MODAL_OK; j++)
        best[j] = rank[j].lambda;
    /* numbers a third apart: all of the fits cost a few times the largest */
    for (int k = 1, step; k <= count && rc == MODAL_OK; k += step) {
        step = k < count && count - k < k / 3 + 1 ? count - k : k / 3 + 1;
        some.lambda = best, some.count = k;
        rc = robust_worth(&some, Y, &F, room, &worth, err);
        if (rc == MODAL_OK && worth < least)
            least = worth, *best_count = k;
    }
    free(F.x), free(room), free(rank);
    return rc;
}

void wild_put_back(struct matrix *Y, struct wild *w)
{
    for (int i = 0; i < w->count; i++)
        Y->x[w->at[i].row + (size_t)w->at[i].channel * (size_t)Y->ld] = w->at[i].sent;
    wild_done(w);
}

void wild_done(struct wild *w)
{
    free(w->at);
    w->at = NULL, w->count = 0, w->share = 0;
}
