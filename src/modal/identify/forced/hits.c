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
 * later, but for the largest of an input.  The score g of these d numbers, all else fitted anew
 * (transfer.h), over its covariance V obeys
 *
 *     P(g . V^-1 g > d + 2 sqrt(d x) + 2 x) <= exp(-x),                                    (1)
 *
 * where V is the information and what is left over white, by (1) of ambient_order.c.  It may be of
 * any colour: what line n adds to g is then the real part of r_n e^(i f_n), f_n by chance.  Let V
 * be the real part of sum_n r_n r_n^H / 2, and q all cos f_n and -sin f_n: g . V^-1 g is
 * 2 q . P q, P a projection on d directions.  As E exp(a . q), a product of I_0, is at most
 * exp(|a|^2 / 4), (1) holds again [HKZ12, theorem 2.1], whatever the noise of lines, and however
 * responses share it; but g . V^-1 g is at most twice the number of lines that count, so that of
 * few of them it tells nothing.  So responses are asked by the information, for one alarm in
 * 1 / IDENTIFY_ALARM records, and where what is left over is coloured that may be all that was
 * seen, but where r tells it as well.
 *
 * [HKZ12] Hsu, Kakade, Zhang, Electronic Communications in Probability 17 (2012) 52.
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

/* Of an input x of L samples and its hits: columns 2 i and 2 i + 1 are of hit i + 1. */
struct columns { const struct lines *l; const double *x; double rest; const struct hit *hit; };

/* What a hit adds to x by each share that it is higher, or by each sample that it is later. */
static void fill(const void *of, int column, int first, int rows, double complex *U)
{
    const struct columns *c = of;
    const struct hit *h = &c->hit[1 + column / EACH];
    const double *x = c->x;
    int L = c->l->samples, from = h->first > 1 ? h->first - 1 : 1;
    int end = h->end + 1 < L - 1 ? h->end + 1 : L - 1;
    double more[LONGEST + 2];

    for (int k = from; k < end; k++)
        more[k - from] = column % EACH == 0 ? x[k] - c->rest : (x[k - 1] - x[k + 1]) / 2;
    lines_pulse(c->l, more, end - from, from, first, rows, U);
}

/* g . V^-1 g, an entry of g each STEP, V overwritten. */
static double gain_of(const double *g, double *V, int step, int ld, int columns)
{
    double part[EACH * MOST], scale[EACH * MOST];

    for (int c = 0; c < columns; c++) {
        double own = V[c + (size_t)ld * c];
        scale[c] = own > 0 ? 1 / sqrt(own) : 0;
        part[c] = g[(size_t)step * c] * scale[c];
    }
    for (int c = 0; c < columns; c++) {
        for (int k = c; k < columns; k++)
            V[k + (size_t)ld * c] *= scale[k] * scale[c];
        V[c + (size_t)ld * c] += scale[c] > 0 ? HELD : 1;
    }
    if (LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', columns, V, ld) != 0)
        return 0;
    cblas_dtrsv(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, columns, V, ld, part, 1);
    return cblas_ddot(columns, part, 1, part, 1);
}

/* g . V^-1 g of the COUNT hits of an input, by either V. */
static enum modal_status ask(const struct columns *of, int input, int count, struct transfer *t,
                             double gain[2], struct modal_error *err)
{
    int columns = EACH * (count - 1), to[EACH * MOST];
    size_t n = (size_t)columns + 1;
    double *M = malloc(2 * sizeof *M * n * n);
    enum modal_status rc = M != NULL ? MODAL_OK
        : modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d hits", count);

    for (int c = 0; c < columns; c++)
        to[c] = input;
    if (rc == MODAL_OK)
        rc = transfer_gain(of->l, t, &(struct transfer_more) { columns, to, fill, of }, M,
                           M + n * n, err);
    if (rc == MODAL_OK) {
        gain[1] = gain_of(M + n, M + n * n, (int)n, columns, columns);
        gain[0] = gain_of(M + n, M + n + 1, (int)n, (int)n, columns);
    }
    free(M);
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
        double gain[2] = { 0, 0 }, d, most;
        struct columns columns = { l, of, 0, hit };
        int count;
        memcpy(order, of, sizeof *order * (size_t)u->m);
        columns.rest = numbers_ranked(order, (size_t)u->m, (size_t)u->m / 2);
        count = list_hits(of, u->m, columns.rest, hit);
        d = EACH * (count - 1);
        most = d + 2 * sqrt(d * x) + 2 * x;
        if (count > 1)
            rc = ask(&columns, j, count, t, gain, err);
        if (!(gain[0] > most))
            continue;
        *out = (struct hits) { .input = j, .count = count, .in_colour = gain[1] > most };
        for (int i = 0; i < count; i++)
            out->longest = hit[i].end - hit[i].first > out->longest ? hit[i].end - hit[i].first
                                                                    : out->longest;
    }
    free(order);
    return rc;
}
