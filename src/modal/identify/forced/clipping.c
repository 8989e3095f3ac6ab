/*
 * clipping.c - see clipping.h
 *
 * A converter at its stop records the same extreme value whatever the input was; so does a force
 * that truly holds its extreme, a relay's or a generator's.  The responses know which.  Let s have
 * a peak of height 1, a parabola, over each run of samples at the input's largest value, -1 at its
 * smallest, and else be 0.  A clipped input u was u + a s in the mean, a > 0.  What went on beyond
 * would be taken for modes, many of them, by an account of u alone; in one to which s is an input
 * too it is no mode.  Both are searched for, and that of the lower BIC is believed: s costs the
 * unknowns of an input, and pays by what it explains and by the modes that it makes needless.
 * What varies about a s stays noise in both.
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
    OF_ALL = 2                   /* samples for each of those: where nothing pushes are more */
};

/* The parabola over samples FIRST .. end - 1, zero in the samples beside them. */
static void set_peak(double *s, int first, int end, double sign)
{
    double n = end - first + 1;

    for (int k = first; k < end; k++)
        s[k] = sign * 4 * (k - first + 1) * (end - k) / (n * n);
}

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
    return held >= MET && held <= L / OF_ALL && held > beside ? held : 0;
}

/* Adds to s a peak for each run of VALUE in x. */
static void add_peaks(const double *x, int L, double value, double sign, double *s)
{
    for (int k = 0, first = 0; k <= L; k++)
        if (k == L || x[k] != value) {
            set_peak(s, first, k, sign);
            first = k + 1;
        }
}

/* s of x. */
static void mark(const double *x, int L, struct clipping *c, double *s)
{
    int high = count_held(x, L, 1, &c->high), low = count_held(x, L, -1, &c->low);

    memset(s, 0, sizeof *s * (size_t)L);
    if (high > 0)
        add_peaks(x, L, c->high, 1, s);
    if (low > 0)
        add_peaks(x, L, c->low, -1, s);
    c->samples = high + low;
}

/* Is the account of U, inputs and after them what was cut off, the better one? */
static enum modal_status is_better(const struct clipping_record *r, const struct matrix *u,
                                   double bic, const struct forced_limits *limits, bool *better,
                                   struct modal_error *err)
{
    struct lines lines = { 0 };
    struct forced_search found = { 0 };
    enum modal_status rc = lines_make(r->responses, u, &r->records, r->band, &lines, err);

    if (rc == MODAL_OK)
        rc = forced_search(&lines, limits, &found, err);
    *better = rc == MODAL_OK && found.rung[found.rungs - 1].bic < bic;
    forced_search_done(&found);
    lines_done(&lines);
    return rc;
}

enum modal_status clipping_find(const struct clipping_record *r, double bic,
                                const struct forced_limits *limits, struct clipping *out, bool *cut,
                                struct modal_error *err)
{
    int L = r->inputs->m, inputs = r->inputs->n;
    struct matrix u = matrix_new(L, 2 * inputs);
    enum modal_status rc = MODAL_OK;

    *cut = false;
    if (u.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d inputs", u.n);
    u.n = inputs;
    for (int j = 0; j < inputs; j++) {
        const double *x = r->inputs->x + (size_t)r->inputs->ld * j;
        memcpy(u.x + (size_t)u.ld * j, x, sizeof *x * (size_t)L);
        mark(x, L, &out[j], u.x + (size_t)u.ld * u.n);
        if (u.n + r->records.count == LINES_DRIVES_MOST)
            out[j].samples = 0;
        u.n += out[j].samples > 0;
    }
    if (u.n > inputs)
        rc = is_better(r, &u, bic, limits, cut, err);
    free(u.x);
    return rc;
}
