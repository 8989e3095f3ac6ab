/*
 * stuck.c - dropouts, held samples and cut peaks, told by exact equality alone
 *
 * Of n pairs of neighbours k were equal. With nothing else known of the share of such pairs, the
 * next m are all equal with a probability of [J03, (6.66)]
 *
 *     P(m) = prod_i (k + 1 + i) / (n + 2 + i),   i = 0 .. m - 1.                                (1)
 *
 * A run of m + 1 samples, of which L S may begin one, is stuck where L S P(m) < ALARM with the
 * pairs of the whole column and with those about the run. So a coarse grid has its equal
 * neighbours, and numbers of full precision have none.
 *
 * On a grid of step q a smooth motion dwells within a step where its derivatives vanish, whatever
 * (1) says of others. Where it does so for h samples on either side of such a place and goes as
 * t^d, it leaves by ((1 + 1/h)^d - 1) q at the next: under GRID_LEAVES q for all d to 4, of runs of
 * 5. What is stuck leaves by what the motion did meanwhile.
 *
 * The N samples at the column's least value, at its largest, or at both where they are the same but
 * for their sign, are cut where 2 S P(N - 1) < ALARM, n all pairs of others, neighbours or not:
 * numbers of full precision do not meet their extreme again. On a grid they do, at each crest; but
 * a crest is within its first step 1 / sqrt(1 + GRID_LEAVES) of the time that it is within 1 +
 * GRID_LEAVES, and noise makes that less: cut, where of N + M samples there N are in the first by
 *
 *     2 S C(N + M, N) (1 + GRID_LEAVES)^(-N / 2) < ALARM.
 *
 * A periodic motion may rest or meet a stop in each period: what it comes to in the last one of the
 * record is its own.
 *
 * In their place come the numbers that leave the least sum of squares in recurrences of the samples
 * forward and back, fitted to the others [JVV86],
 *
 *     e[k] = sum_j a_j z[k -+ j],   j = 0 .. p,   a_0 = 1,                                      (2)
 *
 * which is where the search for modes begins: the modes then rebuild them (wild.h). (2) is solved
 * by its products: half the digits are far more than are needed to begin with. What it has where it
 * was sent anyhow is let be: crests of exact sines.
 *
 * [J03] Jaynes, Probability Theory: The Logic of Science, 2003.
 * [JVV86] Janssen, Veldhuis, Vries, IEEE Trans. ASSP 34 (1986) 317-330.
 */
#include "modal/identify/prepare/stuck.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/prepare/grid.h"
#include "modal/identify/prepare/recurrence.h"
#include "modal/identify/result.h"
#include "modal/linalg/svd.h"
#include "modal/numbers.h"

enum {
    RUN_LEAST = 4,               /* samples: of 3, (1) of 2 ABOUT pairs is 3e-5: four rows are over
                                  * ALARM */
    ABOUT = 128,                 /* rows before and after a run, or twice its length */
    ORDER_MOST = 32,             /* p of (2): sixteen modes, or fewer in noise */
    ROUNDS = 3                   /* of (2): where peaks are cut few samples have p others before */
};

struct run { int begin, count; };

struct look {
    int L, p;
    int period;                  /* rows, at least; 0: none */
    double *z;                   /* a column about its mean, its largest magnitude 1 */
    double *e;
    const double *sent;          /* the column */
    bool *out;                   /* its rows that are stuck */
    struct run *run; int runs;   /* of RUN_LEAST or more */
    double step;                 /* of the column's grid; 0: none */
    double all;                  /* L S */
    int pairs, equal;            /* of neighbours that are not stuck; those that are equal */
    double a[2][ORDER_MOST + 1]; /* (2), forward and back */
};

/* ---- what is stuck ---- */

/* ln P(m) of (1). */
static double ln_chance(double equal, double pairs, int m)
{
    double sum = 0;

    for (int i = 0; i < m; i++)
        sum += log((equal + 1 + i) / (pairs + 2 + i));
    return sum;
}

static int longer_first(const void *a, const void *b)
{
    const struct run *x = a, *y = b;

    return x->count != y->count ? (x->count < y->count) - (x->count > y->count)
                                : (x->begin > y->begin) - (x->begin < y->begin);
}

/* The runs within the column, and its pairs. */
static void find_runs(struct look *k)
{
    const double *x = k->sent;

    k->runs = k->equal = 0, k->pairs = k->L - 1;
    for (int l = 1, begin = 0; l <= k->L; l++) {
        if (l < k->L && x[l] == x[begin])
            continue;
        if (begin > 0 && l < k->L) {
            k->equal += l - begin - 1;
            if (l - begin >= RUN_LEAST)
                k->run[k->runs++] = (struct run) { begin, l - begin };
        } else {
            k->pairs -= l - begin - 1;                /* of rest */
        }
        begin = l;
    }
    qsort(k->run, (size_t)k->runs, sizeof *k->run, longer_first);
}

/* Does the motion come to the run, or leave it, by more than grids make of a smooth one? */
static bool jumps(const struct look *k, struct run r)
{
    const double *x = k->sent, value = x[r.begin];

    return fmax(fabs(x[r.begin - 1] - value), fabs(x[r.begin + r.count] - value))
         > GRID_LEAVES * k->step;
}

/* Pairs of the rows FROM to TO - 1 that are not stuck, and the equal ones of them. */
static void count_pairs(const struct look *k, int from, int to, int *equal, int *pairs)
{
    from = from > 0 ? from : 0, to = to < k->L ? to : k->L;
    for (int l = from + 1; l < to; l++)
        if (!k->out[l - 1] && !k->out[l])
            ++*pairs, *equal += k->sent[l - 1] == k->sent[l];
}

/* Is VALUE the motion's own: one that it comes to in its last period? */
static bool returns(const struct look *k, double value)
{
    for (int l = k->L > k->period ? k->L - k->period : 0; l < k->L; l++)
        if (k->sent[l] == value)
            return k->period > 0;
    return false;
}

static bool is_stuck(const struct look *k, struct run r)
{
    int m = r.count - 1, about = 2 * r.count > ABOUT ? 2 * r.count : ABOUT, equal = 0, pairs = 0;
    double most = log(IDENTIFY_ALARM / k->all);

    if (!jumps(k, r) || returns(k, k->sent[r.begin])
        || !(ln_chance(k->equal - m, k->pairs - m, m) < most))
        return false;
    count_pairs(k, r.begin - about, r.begin, &equal, &pairs);
    count_pairs(k, r.begin + r.count, r.begin + r.count + about, &equal, &pairs);
    return ln_chance(equal, pairs, m) < most;
}

static void mark(struct look *k, struct run r)
{
    memset(k->out + r.begin, true, (size_t)r.count);
    if (r.begin > 0 && r.begin + r.count < k->L)
        k->equal -= r.count - 1, k->pairs -= r.count - 1;
}

/* X at the rail VALUE, or at the other one? They are one where they differ in sign alone. */
static bool at_rail(double x, double value, bool both)
{
    return x == value || (both && x == -value);
}

/* The run BEGIN to END - 1 is within the column, or its first by more than a grid makes of rest: a
 * record may begin in a crest. */
static bool is_within(const struct look *k, int begin, int end)
{
    return end < k->L && (begin > 0 || fabs(k->sent[end] - k->sent[0]) > GRID_LEAVES * k->step);
}

/* Rows within the column at a rail; *near: others within GRID_LEAVES steps of it. */
static int count_at(const struct look *k, double value, bool both, int *near)
{
    const double *x = k->sent;
    int at = 0;

    *near = 0;
    for (int l = 1, begin = 0; l <= k->L; l++) {
        double v = both ? fabs(x[begin]) : x[begin];
        if (l < k->L && x[l] == x[begin])
            continue;
        if (at_rail(x[begin], value, both) && !k->out[begin] && is_within(k, begin, l)) {
            at += l - begin;
        } else if (v != value && fabs(v - value) <= GRID_LEAVES * k->step) {
            *near += l - begin;
        }
        begin = l;
    }
    return at;
}

/* Pairs of the others, neighbours or not, that are equal. k->z has room for them. */
static double equal_others(struct look *k, double value, bool both, double *pairs)
{
    const double *x = k->sent;
    double equal = 0;
    int n = 0, first = 1, last = k->L - 2;

    while (first < last && x[first] == x[0])
        first++;
    while (last > first && x[last] == x[k->L - 1])
        last--;
    for (int l = first; l <= last; l++)
        if (!k->out[l] && !at_rail(x[l], value, both))
            k->z[n++] = both ? fabs(x[l]) : x[l];
    numbers_sort(k->z, (size_t)n);
    for (int i = 1, begin = 0; i <= n; i++)
        if (i == n || k->z[i] != k->z[begin]) {
            equal += (double)(i - begin) * (i - begin - 1) / 2;
            begin = i;
        }
    *pairs = (double)n * (n - 1) / 2;
    return equal;
}

/* What is at a rail is cut, or nothing of it is: at an end of the column as well, where the first
 * crest is the longest. */
static void mark_cut(struct look *k, double value, bool both)
{
    const double *x = k->sent;
    int near, at = count_at(k, value, both, &near);
    double chance, equal, pairs;

    if (at < 2 || returns(k, value) || (both && returns(k, -value)))
        return;
    equal = equal_others(k, value, both, &pairs);
    chance = k->step > 0 ? lgamma(at + near + 1.0) - lgamma(at + 1.0) - lgamma(near + 1.0)
                               - at * log(GRID_LEAVES + 1) / 2
                         : ln_chance(equal, pairs, at - 1);
    if (!(chance < log(IDENTIFY_ALARM * k->L / (2 * k->all))))
        return;
    for (int l = 1, begin = 0; l <= k->L; l++) {
        if (l < k->L && x[l] == x[begin])
            continue;
        if (at_rail(x[begin], value, both) && !k->out[begin])
            mark(k, (struct run) { begin, l - begin });
        begin = l;
    }
}

/* Has the column more values than a grid can be told by? */
static bool has_values(struct look *k)
{
    int values = 1;

    memcpy(k->z, k->sent, (size_t)k->L * sizeof *k->z);
    numbers_sort(k->z, (size_t)k->L);
    for (int l = 1; l < k->L; l++)
        values += k->z[l] > k->z[l - 1];
    return values > GRID_VALUES_LEAST;
}

/* The rows of a column that are stuck; none where they are most of it. */
static int mark_column(struct look *k)
{
    double low = k->sent[0], high = low;
    int count = 0, extremes = 0;

    memset(k->out, 0, (size_t)k->L * sizeof *k->out);
    find_runs(k);
    for (int l = 1; l < k->L; l++) {
        low = k->sent[l] < low ? k->sent[l] : low;
        high = k->sent[l] > high ? k->sent[l] : high;
    }
    for (int l = 0; l < k->L; l++)
        extremes += k->sent[l] == low || k->sent[l] == high;
    if ((k->runs == 0 && extremes == 2 && low != -high) || !has_values(k))
        return 0;
    k->step = grid_of(k->sent, 1, k->L).step;
    for (int i = 0; i < k->runs; i++)
        if (is_stuck(k, k->run[i]))
            mark(k, k->run[i]);
    mark_cut(k, high, high == -low);
    if (high != -low)
        mark_cut(k, low, false);
    for (int l = 0; l < k->L; l++)
        count += k->out[l];
    return 2 * count < k->L ? count : 0;
}

/* ---- what is in their place ---- */

/* What (2) says, forward or back (SENSE -1), of the COUNT rows u: onto B and x. */
static void add_equations(struct look *k, int sense, const int *u, int count, int kd, double *B,
                          double *x)
{
    const double *a = k->a[sense < 0];
    int p = k->p, first = sense > 0 ? p : 0, last = sense > 0 ? k->L - 1 : k->L - 1 - p;

    for (int l = first; l <= last; l++) {
        k->e[l] = 0;
        for (int j = 0; j <= p; j++)
            k->e[l] += a[j] * k->z[l - sense * j];
    }
    for (int i = 0; i < count; i++)
        for (int j = 0; j <= p; j++) {
            int l = u[i] + sense * j;
            if (l < first || l > last)
                continue;
            x[i] -= a[j] * k->e[l];
            for (int d = 0; d <= kd && d <= i; d++) {
                int other = j + sense * (u[i] - u[i - d]);
                if (other < 0 || other > p)
                    break;
                B[i * ((size_t)kd + 1) + d] += a[j] * a[other];
            }
        }
}

/* The COUNT stuck rows where they leave the least of (2). */
static enum modal_status fill(struct look *k, int count, struct modal_error *err)
{
    int *u = malloc(sizeof *u * (size_t)count), kd = 0;
    double *B = NULL, *x = calloc((size_t)count, sizeof *x);

    for (int l = 0, i = 0, j = 0; u != NULL && l < k->L; l++) {
        if (!k->out[l])
            continue;
        u[i] = l;
        while (l - u[j] > k->p)
            j++;
        kd = i - j > kd ? i - j : kd, i++;
    }
    B = calloc((size_t)count * ((size_t)kd + 1), sizeof *B);
    if (u != NULL && B != NULL && x != NULL) {
        add_equations(k, 1, u, count, kd, B, x);
        add_equations(k, -1, u, count, kd, B, x);
        if (recurrence_band_solve(B, count, kd, x))
            for (int i = 0; i < count; i++)
                k->z[u[i]] += x[i];
    }
    bool room = u != NULL && B != NULL && x != NULL;
    free(u), free(B), free(x);
    return room ? MODAL_OK
                : modal_fail(err, MODAL_NO_MEMORY, "stuck: no memory for %d rows", count);
}

/* Runs that (2) has where they are anyhow are of the motion; how many rows are not. SIZE is 1 of
 * k->z in the column's unit, MEAN its 0. */
static int acquit(struct look *k, double mean, double size)
{
    int count = 0;

    for (int l = 0, begin; l < k->L; l++) {
        double off = 0;
        for (begin = l; l < k->L && k->out[l]; l++)
            off = fmax(off, fabs(mean + k->z[l] * size - k->sent[l]));
        /* the rounding of (2) by its products */
        bool same = off <= GRID_LEAVES * k->step + REFINE_HALVED * size;
        if (same && l > begin)
            memset(k->out + begin, false, (size_t)(l - begin));
        count += same ? 0 : l - begin;
    }
    return count;
}

/* *count of the column's rows are stuck, and filled in k->z. */
static enum modal_status mend_column(struct look *k, int *count, double *mean, double *size,
                                     struct modal_error *err)
{
    double most = largest_magnitude(k->sent, (size_t)k->L);
    enum modal_status rc = MODAL_OK;

    *mean = *size = 0;
    for (int l = 0; l < k->L; l++)
        *mean += k->out[l] ? 0 : k->sent[l] / most / (k->L - *count);
    *mean *= most;
    for (int l = 0; l < k->L; l++)
        *size = fmax(*size, k->out[l] ? 0 : fabs(k->sent[l] - *mean));
    if (!(*size > 0)) {
        *count = 0;
        return MODAL_OK;
    }
    for (int l = 0; l < k->L; l++)
        k->z[l] = (k->sent[l] - *mean) / *size;
    for (int round = 0; round < ROUNDS && rc == MODAL_OK; round++) {
        if (!recurrence_fit(k->z, round > 0 ? NULL : k->out, k->L, k->p, k->a[0], k->a[1])) {
            *count = 0;
            return MODAL_OK;
        }
        rc = fill(k, *count, err);
    }
    if (rc == MODAL_OK)
        *count = acquit(k, *mean, *size);
    return rc;
}

/* ---- the columns ---- */

static void look_done(struct look *k)
{
    free(k->z), free(k->e), free(k->out), free(k->run);
}

/* Column C of Y, into OUT. */
static enum modal_status keep(const struct look *k, int c, int count, double mean, double size,
                              double *y, struct wild *out, struct modal_error *err)
{
    struct wild_sample *at = realloc(out->at, sizeof *at * ((size_t)(out->count + count)));

    if (at == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "stuck: no memory for %d samples", count);
    out->at = at;
    for (int l = 0; l < k->L; l++)
        if (k->out[l]) {
            double now = mean + k->z[l] * size;
            at[out->count++] = (struct wild_sample) { l, c, y[l] - now };
            y[l] = now;
        }
    return MODAL_OK;
}

enum modal_status stuck_mend(struct matrix *Y, int period, struct wild *out,
                             struct modal_error *err)
{
    size_t L = (size_t)Y->m;
    int p = Y->m / RECURRENCE_SPARE < ORDER_MOST ? Y->m / RECURRENCE_SPARE : ORDER_MOST;
    struct look k = { .L = Y->m, .p = p, .period = period, .all = (double)L * Y->n,
                      .z = malloc(L * sizeof(double)), .e = malloc(L * sizeof(double)),
                      .out = malloc(L * sizeof(bool)),
                      .run = malloc((L / RUN_LEAST + 1) * sizeof *k.run) };
    enum modal_status rc = k.z != NULL && k.e != NULL && k.out != NULL && k.run != NULL ? MODAL_OK
        : modal_fail(err, MODAL_NO_MEMORY, "stuck: no memory for %d rows", Y->m);

    *out = (struct wild) { 0 };
    for (int c = 0; c < Y->n && rc == MODAL_OK && p > 1; c++) {
        double *y = Y->x + (size_t)c * (size_t)Y->ld, mean, size;
        int count;
        k.sent = y;
        count = mark_column(&k);
        if (count > 0)
            rc = mend_column(&k, &count, &mean, &size, err);
        if (count > 0 && rc == MODAL_OK)
            rc = keep(&k, c, count, mean, size, y, out, err);
    }
    look_done(&k);
    if (rc != MODAL_OK)
        wild_done(out);
    return rc;
}
