/*
 * steps.c - steps and lone spikes told by recurrences of differences; steps fitted beside the poles
 *
 * A step of size h is one number of the differences z of a column, and a recurrence of them,
 *
 *     e[l] = sum_j a_j z[l - j],   j = 0 .. p,   a_0 = 1,                                       (1)
 *
 * which leaves noise alone of modes, leaves h a_j of it at the p + 1 rows from its own on. Of white
 * e of size s then
 *
 *     h = sum_j a_j e[m + j] / sum_j a_j^2,   t = |h| sqrt(sum_j a_j^2) / s                     (2)
 *
 * is normal, and the largest of n is told where it exceeds wild_standing_out(n), by the largest of
 * the medians of the column's e, of the rows before and of those after, and so of e back in time:
 * what a recurrence leaves of a motion one way it does not the other; and the sums of (2) by their
 * own median: of little more than the motion's own order p e is noise that (1) filtered, white by
 * no means, and h has as many times the size that (2) says. What is told must explain what is
 * there: the sum of squares of e[m + j] - h a_j is chi-squared of p + 1 degrees of freedom, and
 * exceeds p + 1 + 2 sqrt((p + 1) x) + 2 x with a probability e^-x = ALARM at most [LM00]. An onset
 * or a motion struck anew leaves more.  A spike is one step up and one down at the next row, h (a_j
 * - a_{j-1}) of e; near the record's ends those rows of it that are there tell, more than SPIKE_ROW
 * of them.  A grid of step q makes differences of up to GRID_LEAVES q of what is smooth (stuck.c).
 *
 * The step beside poles whose basis is Q: with v = u - Q Q'u, u being 0 before its row and 1 from
 * there on, r what the poles leave of the record as it was sent,
 *
 *     h = v'r / v'v,   var h = s^2 / v'v,                                                       (3)
 *
 * at the row where (v'r)^2 / v'v is largest.  Poles that are fitted to the record without the steps
 * and steps by (3) in turn come to the least of both together, as their errors are nearly
 * independent but of slow real poles (bound.c has those of both).
 *
 * [LM00] Laurent and Massart, Ann. Statist. 28 (2000) 1302-1338.
 */
#include "modal/identify/prepare/steps.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/prepare/grid.h"
#include "modal/identify/prepare/recurrence.h"
#include "modal/identify/prepare/wild.h"
#include "modal/identify/result.h"
#include "modal/linalg/svd.h"
#include "modal/linalg/workspace.h"

enum {
    STEPS_MOST = 4,              /* of a channel, spikes as well: more are a motion of their own */
    LOOKS = 8,                   /* at a column: each sees one place */
    SETTLES = 4,                 /* fits without it until its row is the one */
    ABOUT = 64,                  /* rows before (2), and after: of p */
    SAMPLE = 8192,               /* numbers of a median */
    SPIKE_ROW = 2,               /* the first that may be one: with fewer rows before it, an
                                  * onset is as likely */
    REACH = 8,                   /* rows that (3) looks about: noise moves a step's own by some
                                  * s^2 / h^2 of them, and one that (2) tells is above s / 2 */
    ROWS_EACH = 2 * REACH + 1    /* where it may be */
};
static const double
    HALVES = 8;                  /* deviations that noise's halves may differ by, as colour.h has
                                  * them: no ordinary number of records exceeds them */

/* At difference M: a sample more is another from there on, or the next one alone. */
enum kind { STEP, SPIKE, KINDS };
struct place { enum kind kind; int m; };

struct look {
    int n, p;                    /* differences; order */
    double *z, *e;               /* z over its largest magnitude */
    double *h, *part;            /* room for sums of (2), and for a median */
    bool *out;                   /* differences that are none of motion */
    double a[2][RECURRENCE_MOST + 1];            /* (1), forward and back */
    double form[KINDS][RECURRENCE_MOST + 2];     /* what one leaves of e from its first row on */
    int sense;                   /* of e: 1 forward, -1 back */
    double limit;                /* t */
    double jump;                 /* least h */
};

void steps_done(struct steps *s)
{
    free(s->at);
    *s = (struct steps) { 0 };
}

/* ---- (1) and (2) ---- */

static bool fit(struct look *k, bool back)
{
    return recurrence_fit(k->z, k->out, k->n, k->p, k->a[0], back ? k->a[1] : NULL);
}

/* (1) forward, or back (SENSE -1). */
static void leave(struct look *k, int sense)
{
    const double *a = k->a[sense < 0];
    int p = k->p;

    k->sense = sense;
    recurrence_leaves(a, p, sense, k->z, k->n, k->e);
    for (int j = 0; j <= p + 1; j++) {
        k->form[STEP][j] = j <= p ? a[j] : 0;
        k->form[SPIKE][j] = sense * ((j <= p ? a[j] : 0) - (j > 0 ? a[j - 1] : 0));
    }
}

/* The rows of e that show it, COUNT of them from E on, SENSE apart, and its form there: near the
 * record's ends some of it is beyond. */
struct rows { const double *e, *form; int first, count; };

static struct rows rows_of(const struct look *k, struct place at)
{
    int low = k->sense > 0 ? k->p : 0, high = k->sense > 0 ? k->n : k->n - k->p,
        row = at.kind == SPIKE && k->sense < 0 ? at.m + 1 : at.m,
        end = k->p + 1 + (at.kind == SPIKE), j = 0;

    if (k->sense > 0) {
        j = row < low ? low - row : 0;
        end = row + end > high ? high - row : end;
    } else {
        j = row >= high ? row - high + 1 : 0;
        end = row - end < low - 1 ? row - low + 1 : end;
    }
    return (struct rows) { k->e + row + k->sense * j, k->form[at.kind] + j, row + k->sense * j,
                           end > j ? end - j : 0 };
}

static double square_of(const struct rows *r)
{
    return cblas_ddot(r->count, r->form, 1, r->form, 1);
}

static double size_of(const struct look *k, const struct rows *r)
{
    /* back, the first of both is the last that BLAS begins at */
    return r->count == 0 ? 0
         : cblas_ddot(r->count, r->form, 1, k->sense > 0 ? r->e : r->e - r->count + 1, k->sense)
               / square_of(r);
}

/* Of e about it, but not of it. */
static double size_about(const struct look *k, const struct rows *r)
{
    int first = k->sense > 0 ? k->p : 0, last = k->sense > 0 ? k->n : k->n - k->p,
        before = k->sense > 0 ? r->first : r->first - r->count + 1, after = before + r->count,
        begin = before - ABOUT > first ? before - ABOUT : first,
        end = after + ABOUT < last ? after + ABOUT : last;
    double size = before > begin ? wild_size(k->e + begin, before - begin, k->part) : 0;

    return fmax(size, end > after ? wild_size(k->e + after, end - after, k->part) : 0);
}

/* Of all e, by SAMPLE of them where they are more: it is then off by a hundredth. */
static double size_of_all(const struct look *k)
{
    int every = k->n / SAMPLE + 1, count = 0;

    for (int l = k->sense > 0 ? k->p : 0; l < (k->sense > 0 ? k->n : k->n - k->p); l += every)
        k->h[count++] = k->e[l];
    /* of the largest difference: (1) is solved by products */
    return fmax(wild_size(k->h, count, k->part), REFINE_HALVED);
}

static bool is_out(const struct look *k, struct place at)
{
    return k->out[at.m] || (at.kind == SPIKE && k->out[at.m + 1]);
}

/* The largest of t among COUNT sums of (2) from difference FIRST on, over *most; of e of SIZE.
 * Returns the size that their own median says. */
static double largest_sum(const struct look *k, enum kind kind, double size, int first, int count,
                        double *most, struct place *at)
{
    double norm = sqrt(cblas_ddot(k->p + 2, k->form[kind], 1, k->form[kind], 1));

    size = fmax(size, wild_size(k->h, count, k->part) / norm);
    for (int i = 0; i < count; i++) {
        struct place here = { kind, first + i };
        if (fabs(k->h[i]) > *most * size * norm && !is_out(k, here))
            *most = fabs(k->h[i]) / (size * norm), *at = here;
    }
    return size;
}

/* The same of spikes at differences FIRST to LAST - 1, some of whose rows are beyond the ends. */
static void largest_at_end(const struct look *k, double size, int first, int last, double *most,
                           struct place *at)
{
    for (int m = first; m < last; m++) {
        struct place here = { SPIKE, m };
        struct rows r = rows_of(k, here);
        double t = fabs(size_of(k, &r)) * sqrt(square_of(&r)) / size;
        if (r.count > SPIKE_ROW && t > *most && !is_out(k, here))
            *most = t, *at = here;
    }
}

/* Spikes among the first rows, by those after them. */
static void largest_at_begin(const struct look *k, double size, double *most, struct place *at)
{
    struct look head = *k;

    head.n = k->n < 5 * k->p ? k->n : 5 * k->p;
    head.e = k->h;
    leave(&head, -1);
    largest_at_end(&head, fmax(size, wild_size(head.e + 2 * k->p, head.n - 3 * k->p, k->part)),
                   SPIKE_ROW - 1, 2 * k->p, most, at);
}

/* Where t is largest, of e forward, and back where there are no rows before; false: nowhere over
 * its limit. */
static bool largest(const struct look *k, struct place *at)
{
    int first = 2 * k->p, count = k->n - 4 * k->p;      /* rows of noise on either side */
    double size = size_of_all(k), most = k->limit;

    if (count <= 0)
        return false;
    recurrence_leaves(k->a[0], k->p, -1, k->e + first, count + k->p, k->h);
    largest_sum(k, STEP, size, first, count, &most, at);
    for (int i = 0; i < count - 1; i++)
        k->h[i] -= k->h[i + 1];
    size = largest_sum(k, SPIKE, size, first, count - 1, &most, at);
    largest_at_end(k, size, first + count - 1, k->n - 1, &most, at);
    largest_at_begin(k, size, &most, at);
    return most > k->limit;
}

/* Is what is there, but for H of it, chi-squared? */
static bool leaves_chi(const struct rows *r, int sense, double h, double size)
{
    double sum = 0, x = -log(IDENTIFY_ALARM);
    int n = r->count;

    for (int j = 0; j < n; j++)
        sum += pow((r->e[sense * j] - h * r->form[j]) / size, 2);
    return sum < n + 2 * sqrt(n * x) + 2 * x;
}

/* Does one of *h explain what is there?  Of PART of its rows no more is asked than that it does. */
static bool explains(const struct look *k, struct place at, bool part, double *h)
{
    struct rows r = rows_of(k, at);
    double size = fmax(size_about(k, &r), size_of_all(k));

    if (!part)
        *h = size_of(k, &r);
    return leaves_chi(&r, k->sense, *h, size) && fabs(*h) > k->jump
        && (part || fabs(*h) * sqrt(square_of(&r)) > k->limit * size);
}

/* The sense in which more of its rows are in the record. */
static int sense_of(const struct look *k, struct place at)
{
    return at.m < 2 * k->p ? -1 : 1;
}

/* Either way it does, as what a recurrence leaves of motion in one it does not. */
static bool is_there(struct look *k, struct place at, double *h)
{
    int sense = sense_of(k, at);
    bool part = at.m < k->p || at.m >= k->n - k->p - 1;
    double other;

    leave(k, sense);
    if (!explains(k, at, false, h))
        return false;
    leave(k, -sense);
    other = *h;
    return explains(k, at, part, &other) && *h * other > 0;
}

static void set_out(struct look *k, struct place at, bool out)
{
    k->out[at.m] = out;
    if (at.kind == SPIKE)
        k->out[at.m + 1] = out;
}

/* The row about it where it is the largest of a recurrence that leaves it out: one that does not
 * is bent by it. False: too few rows. */
static bool settle(struct look *k, struct place *at)
{
    for (int again = 0; again < SETTLES; again++) {
        int least = at->kind == SPIKE ? SPIKE_ROW - 1 : k->p,
            beyond = at->kind == SPIKE ? k->n - 1 : k->n - k->p,
            first = at->m - k->p > least ? at->m - k->p : least,
            last = at->m + k->p < beyond ? at->m + k->p : beyond - 1;
        struct place best = *at;
        double most = 0;
        set_out(k, *at, true);
        if (!fit(k, true))
            return false;
        leave(k, sense_of(k, *at));
        for (int l = first; l <= last; l++) {
            struct place here = { at->kind, l };
            struct rows r = rows_of(k, here);
            double t = fabs(size_of(k, &r)) * sqrt(square_of(&r));
            if (t > most && r.count > SPIKE_ROW && (l == at->m || !is_out(k, here)))
                most = t, best = here;
        }
        if (best.m == at->m)
            break;
        set_out(k, *at, false), set_out(k, best, true), *at = best;
    }
    return true;
}

/* Without what was told, does (1) leave noise?  Of more modes than p / 2 it leaves
 * motion that dies away, in which nothing is told: its halves differ. Of n white numbers the sums
 * of squares of both halves differ by sqrt(2 n) variances in the standard deviation. */
static bool leaves_noise(struct look *k)
{
    int n = k->n - k->p, half = n / 2;
    const double *e = k->e + k->p;
    double first, last;

    if (!fit(k, false))
        return false;
    leave(k, 1);
    first = cblas_ddot(half, e, 1, e, 1), e += n - half;
    last = cblas_ddot(half, e, 1, e, 1);
    return fabs(first - last) <= HALVES * sqrt(2.0 * n) * (first + last) / n;
}

struct told { struct place at; double size; };

/* Up to STEPS_MOST of the column Y, sizes over z's UNIT. */
static int look_at_column(struct look *k, const double *y, double unit, struct told *found)
{
    int count = 0;

    for (int look = 0; look < LOOKS && count < STEPS_MOST && fit(k, true); look++) {
        struct place at;
        double h;
        leave(k, 1);
        if (!largest(k, &at))
            break;
        if (look == 0)
            k->jump = GRID_LEAVES * grid_of(y, 1, k->n + 1).step / unit;
        if (!settle(k, &at))
            break;
        if (!is_there(k, at, &h))
            continue;
        found[count++] = (struct told) { at, h };
        k->z[at.m] -= h;
        if (at.kind == SPIKE)
            k->z[at.m + 1] += h;
    }
    return count > 0 && leaves_noise(k) ? count : 0;
}

static enum modal_status add(struct steps *s, const struct told *found, int count, enum kind kind,
                             int channel, double unit, struct modal_error *err)
{
    struct step *at = realloc(s->at, sizeof *at * (size_t)(s->count + count));

    if (at == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steps: no memory for %d", count);
    s->at = at;
    for (int i = 0; i < count; i++)
        if (found[i].at.kind == kind)
            at[s->count++] = (struct step) { found[i].at.m + 1, channel, found[i].size * unit, 0 };
    return MODAL_OK;
}

enum modal_status steps_find(const struct matrix *Y, struct steps *out, struct steps *spikes,
                             struct modal_error *err)
{
    int n = Y->m - 1;
    int p = n / RECURRENCE_SPARE < RECURRENCE_MOST ? n / RECURRENCE_SPARE : RECURRENCE_MOST;
    struct workspace space = { 0 };
    struct look k = { .n = n, .p = p, .z = workspace_numbers(&space, (size_t)n, 1),
                      .e = workspace_numbers(&space, (size_t)n, 1),
                      .h = workspace_numbers(&space, (size_t)n, 1),
                      .part = workspace_numbers(&space, (size_t)n, 1),
                      .out = workspace_zeros(&space, (size_t)n, sizeof *k.out),
                      .limit = wild_standing_out((double)KINDS * n * Y->n) };
    enum modal_status rc = workspace_check(&space, "steps: no memory", err);

    *out = *spikes = (struct steps) { 0 };
    for (int c = 0; c < Y->n && rc == MODAL_OK && p > 1; c++) {
        const double *y = Y->x + (size_t)c * (size_t)Y->ld;
        struct told found[STEPS_MOST];
        double unit = 0;
        for (int l = 0; l < n; l++)
            unit = fmax(unit, fabs(y[l + 1] - y[l]));
        if (!(unit > 0 && isfinite(unit)))
            continue;
        for (int l = 0; l < n; l++)
            k.z[l] = (y[l + 1] - y[l]) / unit, k.out[l] = false;
        int count = look_at_column(&k, y, unit, found);
        if (count > 0 && (rc = add(out, found, count, STEP, c, unit, err)) == MODAL_OK)
            rc = add(spikes, found, count, SPIKE, c, unit, err);
    }
    workspace_free(&space);
    if (rc != MODAL_OK)
        steps_done(out), steps_done(spikes);
    return rc;
}

void steps_take(const struct steps *s, int sense, struct matrix *Y)
{
    for (int i = 0; i < s->count; i++)
        for (int l = s->at[i].row; l < Y->m; l++)
            Y->x[l + (size_t)s->at[i].channel * (size_t)Y->ld] -= sense * s->at[i].size;
}

/* ---- (3) ---- */

/* Columns COUNT x (2 REACH + 1) of V: each step, at each row it may be. */
static enum modal_status steps_columns(const struct rebuild_model *poles, const struct steps *s,
                                       struct matrix *V, struct modal_error *err)
{
    struct matrix F = matrix_new(V->m, V->n);
    struct synthesis fit = { 0 };
    int reach = s->count > 0 ? (V->n / s->count - 1) / 2 : 0;
    enum modal_status rc;

    for (int j = 0; j < V->n; j++)
        for (int l = 0, first = s->at[j / (2 * reach + 1)].row + j % (2 * reach + 1) - reach;
             l < V->m; l++)
            V->x[l + (size_t)j * (size_t)V->m] = l >= first;
    if (F.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steps: no memory for %d rows", V->m);
    rc = rebuild_record(poles, V, &F, &fit, err);
    for (size_t i = 0; i < (size_t)V->m * (size_t)V->n && rc == MODAL_OK; i++)
        V->x[i] -= F.x[i];
    synthesis_done(&fit);
    free(F.x);
    return rc;
}

static double dot(const double *x, const double *y, int n)
{
    return cblas_ddot(n, x, 1, y, 1);
}

/* One step, V its columns, e what is left in its channel of all; how far it moved, in its std. */
static double fit_one(struct step *s, const double *V, int L, double *e, double freedom)
{
    const double *own = V + (size_t)REACH * (size_t)L, *best = own;
    double most = -1, h = s->size, before = s->size;
    int row = s->row;

    for (int l = 0; l < L; l++)
        e[l] += before * own[l];
    for (int j = 0; j <= 2 * REACH; j++) {
        int at = s->row + j - REACH;
        const double *v = V + (size_t)j * (size_t)L;
        double vv = dot(v, v, L), ve = dot(v, e, L);
        if (at > 0 && at < L && vv > 0 && ve * ve / vv > most)
            most = ve * ve / vv, h = ve / vv, best = v, row = at;
    }
    for (int l = 0; l < L; l++)
        e[l] -= h * best[l];
    bool stays = row == s->row;
    s->row = row, s->size = h;
    s->std = sqrt(dot(e, e, L) / freedom / fmax(dot(best, best, L), DBL_MIN));
    return stays ? fabs(h - before) / fmax(s->std, DBL_MIN) : HUGE_VAL;
}

enum modal_status steps_fit(const struct rebuild_model *poles, const struct matrix *Y,
                            struct steps *s, double *moved, double *left, struct modal_error *err)
{
    size_t L = (size_t)Y->m;
    struct matrix V = matrix_new(Y->m, s->count * ROWS_EACH), F = matrix_new(Y->m, Y->n);
    struct synthesis fit = { 0 };
    double freedom = fmax(Y->m - rebuild_order(poles) - 1, 1);
    enum modal_status rc = V.x == NULL || F.x == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "steps: no memory for %d rows", Y->m)
        : steps_columns(poles, s, &V, err);

    *moved = *left = 0;
    if (rc == MODAL_OK)
        rc = rebuild_record(poles, Y, &F, &fit, err);
    for (size_t c = 0; c < (size_t)Y->n && rc == MODAL_OK; c++)
        for (size_t l = 0; l < L; l++)
            F.x[l + c * L] = Y->x[l + c * (size_t)Y->ld] - F.x[l + c * L];
    for (int i = 0; i < s->count && rc == MODAL_OK; i++)
        *moved = fmax(*moved, fit_one(&s->at[i], V.x + (size_t)i * ROWS_EACH * L, Y->m,
                                      F.x + (size_t)s->at[i].channel * L, freedom));
    for (size_t c = 0; c < (size_t)Y->n && rc == MODAL_OK; c++)
        *left += L * log(fmax(dot(F.x + c * L, F.x + c * L, Y->m), DBL_MIN));
    synthesis_done(&fit);
    free(V.x), free(F.x);
    return rc;
}
