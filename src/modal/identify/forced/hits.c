/*
 * hits.c - see hits.h
 *
 * A hit is straight between samples, or what direct columns make of that (lines.c), as long as all
 * are alike: a force that lives between samples has another height and another time in each, by
 * where samples fall.  Half a sine of n samples, summed by them, is off by up to (pi / n)^2 / 12 of
 * itself, a hundredth where n is LONGEST; one shorter than a sample may show at any height or not
 * at all.  All of them being higher, or later, is in the modes' complex parts: poles are none the
 * worse for it.  One being higher or later than another is an input that nobody measured, and poles
 * make up for it where they can.
 *
 * The responses know: to the first order each hit may have been a_c times higher, b_c samples
 * later, but for the largest of an input.  The score of these, all else fitted anew (transfer.h),
 * over their information is chi-squared where samples tell all there is; (1) of ambient_order.c
 * bounds it for one in IDENTIFY_ALARM records.
 */
#include "modal/identify/forced/hits.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/result.h"
#include "modal/numbers.h"

enum {
    LONGEST = 9,                 /* samples of a hit: longer ones are told to a hundredth */
    MOST = 16,                   /* hits of an input: more are a load, and each asks for two sums */
    REST = 10,                   /* samples for each of a hit: nothing pushes in these */
    EACH = 2                     /* columns of a hit */
};
static const double
    PUSHES = 0.1,                /* of the largest: less is a sensor's noise */
    HELD = 1e-9;                 /* of the diagonal: where two hits tell no more than one */

struct hit { int first, end; double size; };

/* The hits of x about its rest, the largest first; 0: it is no such input. */
static int list_hits(const double *x, int L, double rest, struct hit *hit)
{
    double most = 0;
    int count = 0, all = 0, largest = 0;

    for (int k = 0; k < L; k++)
        most = fmax(most, fabs(x[k] - rest));
    for (int k = 0, first = 0; k <= L; k++) {
        double size = 0;
        if (k < L && fabs(x[k] - rest) > PUSHES * most)
            continue;
        for (int i = first; i < k; i++)
            size = fmax(size, fabs(x[i] - rest));
        if (k > first && (count == MOST || k - first > LONGEST))
            return 0;
        if (k > first)
            hit[count++] = (struct hit) { first, k, size }, all += k - first;
        first = k + 1;
    }
    for (int i = 1; i < count; i++)
        largest = hit[i].size > hit[largest].size ? i : largest;
    if (count > 0) {
        struct hit first = hit[0];
        hit[0] = hit[largest], hit[largest] = first;
    }
    return all > L / REST ? 0 : count;
}

/* What the hit adds to x by each share that it is higher, and by each sample that it is later. */
static void add_columns(const double *x, int L, double rest, const struct hit *h, double *higher,
                        double *later)
{
    int first = h->first > 1 ? h->first - 1 : 1, end = h->end + 1 < L - 1 ? h->end + 1 : L - 1;

    for (int k = first; k < end; k++) {
        higher[k] = x[k] - rest;
        later[k] = (x[k - 1] - x[k + 1]) / 2;
    }
}

/* Of M of transfer_gain(): twice what the logarithm of the likelihood gains. */
static double gain_of(double *M, int columns)
{
    int n = columns + 1;
    double *J = M + n + 1, g[EACH * MOST], scale[EACH * MOST];

    for (int c = 0; c < columns; c++) {
        double own = J[c + (size_t)n * c];
        scale[c] = own > 0 ? 1 / sqrt(own) : 0;
        g[c] = M[(size_t)n * (c + 1)] * scale[c];
    }
    for (int c = 0; c < columns; c++) {
        for (int k = c; k < columns; k++)
            J[k + (size_t)n * c] *= scale[k] * scale[c];
        J[c + (size_t)n * c] += scale[c] > 0 ? HELD : 1;
    }
    if (LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', columns, J, n) != 0)
        return 0;
    cblas_dtrsv(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, columns, J, n, g, 1);
    return cblas_ddot(columns, g, 1, g, 1);
}

/* *gain, of the COUNT hits of an input. */
static enum modal_status ask(const struct clipping_record *r, int input, double rest,
                             const struct hit *hit, int count, const struct lines *l,
                             struct transfer *t, double *gain, struct modal_error *err)
{
    int L = r->inputs->m, columns = EACH * (count - 1), to[EACH * MOST];
    size_t n = (size_t)columns + 1;
    const double *x = r->inputs->x + (size_t)r->inputs->ld * input;
    double *s = calloc((size_t)L * (size_t)columns, sizeof *s), *M = malloc(sizeof *M * n * n);
    struct matrix moved = { L, columns, L, s };
    struct lines own = { 0 };
    enum modal_status rc = MODAL_OK;

    if (s == NULL || M == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d hits", count);
    for (int i = 1; i < count && rc == MODAL_OK; i++)
        add_columns(x, L, rest, &hit[i], s + (size_t)L * EACH * (i - 1),
                    s + (size_t)L * (EACH * (i - 1) + 1));
    for (int c = 0; c < columns; c++)
        to[c] = input;
    if (rc == MODAL_OK)
        rc = lines_make(r->responses, &moved, &r->records, r->band, &own, err);
    for (int c = 0; c < columns && rc == MODAL_OK; c++)
        cblas_zdscal(own.count, own.size[c], own.W + (size_t)c * own.count, 1);
    if (rc == MODAL_OK)
        rc = transfer_gain(l, t, &(struct transfer_more) { columns, to, own.W }, M, err);
    *gain = rc == MODAL_OK ? gain_of(M, columns) : 0;
    lines_done(&own);
    free(s), free(M);
    return rc;
}

enum modal_status hits_find(const struct clipping_record *r, const struct lines *l,
                            struct transfer *t, struct hits *out, struct modal_error *err)
{
    const struct matrix *u = r->inputs;
    double *order = malloc(sizeof *order * (size_t)u->m), x = log(u->n / IDENTIFY_ALARM);
    enum modal_status rc = MODAL_OK;

    *out = (struct hits) { .input = -1 };
    if (order == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for hits");
    for (int j = 0; j < u->n && rc == MODAL_OK && out->input < 0 && t->poles > 0; j++) {
        const double *of = u->x + (size_t)u->ld * j;
        struct hit hit[MOST];
        double rest, gain, d;
        int count;
        memcpy(order, of, sizeof *order * (size_t)u->m);
        rest = numbers_ranked(order, (size_t)u->m, (size_t)u->m / 2);
        count = list_hits(of, u->m, rest, hit);
        d = EACH * (count - 1);
        if (count > 1)
            rc = ask(r, j, rest, hit, count, l, t, &gain, err);
        if (count < 2 || rc != MODAL_OK || !(gain > d + 2 * sqrt(d * x) + 2 * x))
            continue;
        *out = (struct hits) { j, count, 0 };
        for (int i = 0; i < count; i++)
            out->longest = hit[i].end - hit[i].first > out->longest ? hit[i].end - hit[i].first
                                                                    : out->longest;
    }
    free(order);
    return rc;
}
