/*
 * clipping.c - see clipping.h
 *
 * A converter at its stop records the same extreme value whatever the input was; so does a force
 * that truly holds its extreme, a relay's or a generator's.  The responses know which.  A clipped
 * input u was u + a s in the mean, a > 0, with s a parabola over each run of samples at the input's
 * largest value, the negative of one at its smallest, and else 0.  How high each is beside others
 * is told by the input itself: where it is smooth, a run of n samples that is entered and left at
 * the slope r, r from the samples beside it, went on by r n / 4; where it is not, all went on by
 * the same.  A hit of few samples is more pointed than a parabola: its square is asked as well.  Of
 * each a is one unknown, for what was cut off reaches the responses by the same way as the rest.
 *
 * What went on beyond would be taken for modes, many of them, by an account of u alone.  So a is
 * found with the poles of that account, and all is searched for anew with u + a s.  That is
 * believed where its BIC is the lower, a charged for as one number more, and where its own poles
 * without a are worse by as much: two searches that go different ways prove nothing.
 *
 * An extreme value of continuous samples is met once, of coarse ones less often than the value next
 * to it; one that most samples have is where nothing pushes, between hits: none of these is asked.
 */
#include "modal/identify/forced/clipping.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    MET = 2,                     /* samples at an extreme at least */
    OF_ALL = 2,                  /* samples for each of those: where nothing pushes are more */
    DOUBLINGS = 3,               /* of a, from where as much was cut off as was not: from 8 */
    HALVINGS = 6,                /* times that to 3 % of it */
    FINER = 4,                   /* halvings of the distance between them */
    STEPS = 12                   /* of a fit that is one of many */
};
static const double ENOUGH = 0.1;        /* of ln likelihood: of such a fit */

enum {
    EQUAL = 1,                   /* peaks as high as each other, not as their slopes have them */
    POINTED = 2,                 /* not round */
    KINDS = 4                    /* of peaks: either, both or neither of these */
};

/* ---- what was cut off ---- */

/* How many of x hold its extreme in the direction of SIGN, *value; 0 where it is none that was cut
 * off. */
static int count_held(const double *x, int L, double sign, double *value)
{
    double next = -HUGE_VAL, most = -HUGE_VAL;
    int held = 0, beside = 0;

    for (int k = 0; k < L; k++)
        most = fmax(most, sign * x[k]);
    for (int k = 0; k < L; k++)
        if (sign * x[k] < most)
            next = fmax(next, sign * x[k]);
    for (int k = 0; k < L; k++)
        held += sign * x[k] == most, beside += sign * x[k] == next;
    *value = sign * most;
    /* a hit that is cut off all along has its rest next to it */
    beside *= beside <= L / OF_ALL;
    return held >= MET && held <= L / OF_ALL && held > beside ? held : 0;
}

/* By how much x went on over samples FIRST .. end - 1, by the slopes beside them. */
static double height_of(const double *x, int L, double sign, int first, int end)
{
    double rise = first > 0 ? sign * (x[first] - x[first - 1]) : 0;
    double fall = end < L ? sign * (x[end - 1] - x[end]) : 0;

    /* the step on to the extreme was cut off too; the one before was not */
    if (first > 1)
        rise = fmax(rise, sign * (x[first - 1] - x[first - 2]));
    if (end + 1 < L)
        fall = fmax(fall, sign * (x[end] - x[end + 1]));
    return (rise + fall) / 2 * (end - first + 1) / 4;
}

/* Adds to s a parabola for each run of VALUE in x, zero in the samples beside it. */
static void add_peaks(const double *x, int L, double value, double sign, int how,
                      double *s)
{
    for (int k = 0, first = 0; k <= L; k++)
        if (k == L || x[k] != value) {
            double n = k - first + 1, height = 0;
            if (first < k)
                height = how & EQUAL ? fabs(value) : height_of(x, L, sign, first, k);
            for (int i = first; i < k; i++) {
                double round = 4 * (i - first + 1) * (k - i) / (n * n);
                s[i] = sign * height * (how & POINTED ? round * round : round);
            }
            first = k + 1;
        }
}

/* s of x. */
static void mark(const double *x, int L, int how, struct clipping *c, double *s)
{
    int high = count_held(x, L, 1, &c->high), low = count_held(x, L, -1, &c->low);

    memset(s, 0, sizeof *s * (size_t)L);
    if (high > 0)
        add_peaks(x, L, c->high, 1, how, s);
    if (low > 0)
        add_peaks(x, L, c->low, -1, how, s);
    c->samples = high + low;
}

/* ---- do the responses know of it? ---- */

struct work {
    const struct clipping_record *record;
    const struct forced_search *own;
    const struct forced_limits *limits;
    struct matrix u, s;          /* u: inputs and so much of s as is asked for */
    double *a;                   /* of each input */
};

static enum modal_status set_lines(struct work *w, const double *a, struct lines *out,
                                   struct modal_error *err)
{
    const struct clipping_record *r = w->record;

    for (int j = 0; j < w->u.n; j++)
        for (int k = 0; k < w->u.m; k++)
            w->u.x[k + (size_t)w->u.ld * j] = r->inputs->x[k + (size_t)r->inputs->ld * j]
                + a[j] * w->s.x[k + (size_t)w->s.ld * j];
    return lines_make(r->responses, &w->u, &r->records, r->band, out, err);
}

/* *likelihood: what of the responses the poles of FROM explain, each moved a little, with A. */
static enum modal_status weigh(struct work *w, const struct transfer *from, const double *a,
                               double *likelihood, struct modal_error *err)
{
    struct lines lines = { 0 };
    struct transfer t = { 0 };
    double work = HUGE_VAL;
    struct transfer_limits limits = { STEPS, ENOUGH, &work, w->limits->cancelled,
                                      w->limits->context };
    enum modal_status rc = set_lines(w, a, &lines, err);

    if (rc == MODAL_OK)
        rc = transfer_new(&lines, &t, err);
    if (rc == MODAL_OK) {
        transfer_copy(&lines, from, &t);
        rc = transfer_fit(&lines, &limits, &t, err);
    }
    *likelihood = t.likelihood;
    transfer_done(&t);
    lines_done(&lines);
    return rc;
}

/* w->a[j], the likeliest, of the input J alone, *best its likelihood: that of no a before. */
static enum modal_status find_share(struct work *w, int j, double *best, struct modal_error *err)
{
    double found = 0, likelihood, factor = 2;
    enum modal_status rc = MODAL_OK;

    for (int i = -DOUBLINGS; rc == MODAL_OK && i < HALVINGS; i++) {
        w->a[j] = pow(factor, -i);
        rc = weigh(w, &w->own->model, w->a, &likelihood, err);
        if (rc == MODAL_OK && likelihood > *best)
            *best = likelihood, found = w->a[j];
    }
    for (int i = 0; rc == MODAL_OK && found > 0 && i < FINER; i++) {
        double middle = found;
        factor = sqrt(factor);
        for (int side = -1; rc == MODAL_OK && side <= 1; side += 2) {
            w->a[j] = middle * pow(factor, side);
            rc = weigh(w, &w->own->model, w->a, &likelihood, err);
            if (rc == MODAL_OK && likelihood > *best)
                *best = likelihood, found = w->a[j];
        }
    }
    w->a[j] = found;
    return rc;
}

/* Is the account of the inputs and w->a of what was cut off, COUNT numbers, the better one? */
static enum modal_status is_better(struct work *w, int count, bool *better, struct modal_error *err)
{
    double *none = calloc((size_t)w->u.n, sizeof *none), without = 0, price;
    struct lines lines = { 0 };
    struct forced_search found = { 0 };
    enum modal_status rc = none == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d inputs", w->u.n)
        : set_lines(w, w->a, &lines, err);

    /* as a number costs there */
    price = rc == MODAL_OK ? count * log(2.0 * lines.count * lines.responses) : 0;
    if (rc == MODAL_OK)
        rc = forced_search(&lines, w->limits, &found, err);
    *better = rc == MODAL_OK
        && found.rung[found.rungs - 1].bic + price < w->own->rung[w->own->rungs - 1].bic;
    if (*better) {
        rc = weigh(w, &found.model, none, &without, err);
        *better = rc == MODAL_OK && 2 * (found.model.likelihood - without) > price;
    }
    forced_search_done(&found);
    lines_done(&lines);
    free(none);
    return rc;
}

/* By heights of that kind; *cut: yes. */
static enum modal_status ask(struct work *w, int how, struct clipping *out, bool *cut,
                             struct modal_error *err)
{
    double best = w->own->model.likelihood;
    int count = 0;
    enum modal_status rc = MODAL_OK;

    memset(w->a, 0, sizeof *w->a * (size_t)w->u.n);
    for (int j = 0; j < w->u.n; j++)
        mark(w->record->inputs->x + (size_t)w->record->inputs->ld * j, w->u.m, how, &out[j],
             w->s.x + (size_t)w->s.ld * j);
    for (int j = 0; rc == MODAL_OK && j < w->u.n; j++)
        if (out[j].samples > 0)
            rc = find_share(w, j, &best, err);
    for (int j = 0; j < w->u.n; j++)
        count += w->a[j] > 0;
    if (rc == MODAL_OK && count > 0)
        rc = is_better(w, count, cut, err);
    for (int j = 0; j < w->u.n && *cut; j++)
        out[j].samples *= w->a[j] > 0;
    return rc;
}

enum modal_status clipping_find(const struct clipping_record *r, const struct forced_search *own,
                                const struct forced_limits *limits, struct clipping *out, bool *cut,
                                struct modal_error *err)
{
    int L = r->inputs->m, inputs = r->inputs->n;
    struct work w = { r, own, limits, matrix_new(L, inputs), matrix_new(L, inputs),
                      malloc(sizeof *w.a * (size_t)inputs) };
    enum modal_status rc = MODAL_OK;

    *cut = false;
    if (w.u.x == NULL || w.s.x == NULL || w.a == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d inputs", inputs);
    for (int how = 0; rc == MODAL_OK && how < KINDS && !*cut; how++)
        rc = ask(&w, how, out, cut, err);
    free(w.u.x), free(w.s.x), free(w.a);
    return rc;
}
