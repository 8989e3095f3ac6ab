/*
 * drift.c - groups of poles against modes that drift
 *
 * To any accuracy a mode whose exponent changes within the record is a sum of exponentials: a pole
 * more near the first for each digit.  The fit is adequate, what it leaves is white, and halves of
 * the record have the same poles; but they have one shape, and their sum
 *
 *     f_c(l) = sum_j C_jc e^{lambda_j tau l},     s_c e^{k0 + k1 x + k2 x^2},  x in [-1, 1]     (1)
 *
 * is one function, of a constant and an evenly changing exponent, in every signal c.  Of G poles in
 * S signals the second model has 2 (G - 1) columns and 2 (G - 1) - 2 exponents less.  It is the
 * better where what it leaves of the first, over the signals' noise and with no other pole
 * refitted, is less than the price of those (criterion.h).  Modes that are two need be parallel in
 * S signals, and beat as one does not, to the noise, to be taken for one; where S is 1 or few, and
 * lines overlap by so much that noise hides the beat, that may happen to some, but not to most.
 *
 * Sums over rows are taken at POINTS of them: (1) without its carrier turns by a radian a point at
 * most.
 */
#include "modal/identify/ask/drift.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/ask/trend.h"
#include "modal/identify/linear/exponents.h"
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"

enum {
    POINTS = 256,                    /* 40 turns of what (1) has without its carrier */
    GROUP_MOST = 12,                 /* poles of one mode: a pole a digit, of those noise leaves */
    TERMS = 3,                       /* k of (1) */
    ROUNDS = 4                       /* of Gauss and Newton, and of the power method */
};
static const double
    LIVES = 8,                       /* 1 / |Re lambda|: what is left then is below any noise */
    APART = 2;                       /* widths of a line: so far they overlap */

struct drift {
    const struct refine_data *data;
    const double complex *lambda;
    int count, S;
    double complex *C;               /* count x S: amplitudes over the signals' noise */
    double *size;                    /* per pole: their norm */
    bool *taken;                     /* per pole: in a group before */
    double complex *f;               /* POINTS x S: (1) of the group at hand */
    double complex *s;               /* S: its shape, of norm 1 */
    struct criterion criterion;
    int order, parameters;
    struct workspace space;
};

/* One group: its poles, the strongest first; rows from one point to the next. */
struct group { int pole[GROUP_MOST], count; double step; };

static double width(const struct drift *d, int j)
{
    return fmax(fabs(creal(d->lambda[j])), 2 * M_PI / (d->data->tau * d->data->Y->m));
}

/* The amplitudes of all poles. */
static void amplitudes(struct drift *d, struct projected *p, const double *noise)
{
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, p->order, d->S, 1,
                p->R, p->order, p->Z, p->order);
    for (int c = 0; c < d->S; c++) {
        const double *z = p->Z + (size_t)c * (size_t)p->order;
        for (int j = 0, i = 0; j < d->count; j++) {
            bool pair = pole_kind(d->lambda[j], d->data->tau) == POLE_PAIR;
            double re = z[i++], im = pair ? z[i++] : 0;
            d->C[j + (size_t)c * (size_t)d->count] =
                noise[c] > 0 ? CMPLX(re / noise[c], im / noise[c]) : 0;
        }
    }
    for (int j = 0; j < d->count; j++)
        d->size[j] = cblas_dznrm2(d->S, d->C + j, d->count);
}

/* Have two poles one shape? */
static bool alike(const struct drift *d, int i, int j)
{
    double complex ab = numbers_row_dot(d->S, d->C + i, d->count, d->C + j, d->count);
    double norm = d->size[i] * d->size[j];

    return norm > 0 && creal(ab * conj(ab)) > TREND_ONE_SHAPE * norm * norm;
}

/* The strongest pair that is in no group yet, and those that may be one mode with it. */
static bool next_group(struct drift *d, struct group *g)
{
    double slow = HUGE_VAL, L = d->data->Y->m;
    int at = -1;

    for (int j = 0; j < d->count; j++)
        if (!d->taken[j] && pole_kind(d->lambda[j], d->data->tau) == POLE_PAIR
            && (at < 0 || d->size[j] > d->size[at]))
            at = j;
    if (at < 0)
        return false;
    *g = (struct group) { .pole = { at }, .count = 1 };
    d->taken[at] = true;
    for (int j = 0; j < d->count && g->count < GROUP_MOST; j++) {
        if (d->taken[j] || pole_kind(d->lambda[j], d->data->tau) != POLE_PAIR || !alike(d, at, j)
            || cabs(d->lambda[j] - d->lambda[at]) > APART * fmax(width(d, at), width(d, j)))
            continue;
        g->pole[g->count++] = j, d->taken[j] = true;
    }
    for (int i = 0; i < g->count; i++)
        slow = fmin(slow, -creal(d->lambda[g->pole[i]]) * d->data->tau);
    g->step = (slow > 0 ? fmin(L, LIVES / slow) : L) / POINTS;
    return true;
}

/* d->f, without the carrier of the first pole. */
static void form(struct drift *d, const struct group *g)
{
    double tau = d->data->tau, last = d->data->Y->m - 1.0;

    memset(d->f, 0, sizeof *d->f * POINTS * (size_t)d->S);
    for (int i = 0; i < g->count; i++) {
        double complex z = (d->lambda[g->pole[i]] - I * cimag(d->lambda[g->pole[0]])) * tau;
        double grown = fmax(creal(z), 0) * last;
        for (int k = 0; k < POINTS; k++) {
            double l = (k + 0.5) * g->step;
            double complex u = cexp(z * l - grown);
            cblas_zaxpy(d->S, &u, d->C + g->pole[i], d->count, d->f + k, POINTS);
        }
    }
}

/* P = f conj s of the shape that has most of F; what others have. */
static double off_shape(struct drift *d, const struct group *g, double complex *P)
{
    double complex one = 1, zero = 0;
    double all = cblas_dznrm2(POINTS * d->S, d->f, 1), on = 0;

    for (int c = 0; c < d->S; c++)
        d->s[c] = conj(d->C[g->pole[0] + (size_t)c * (size_t)d->count]) / d->size[g->pole[0]];
    for (int round = 0; round < ROUNDS; round++) {
        cblas_zgemv(CblasColMajor, CblasNoTrans, POINTS, d->S, &one, d->f, POINTS, d->s, 1, &zero,
                    P, 1);
        on = cblas_dznrm2(POINTS, P, 1);
        if (round == ROUNDS - 1 || !(on > 0))
            break;
        cblas_zgemv(CblasColMajor, CblasConjTrans, POINTS, d->S, &one, d->f, POINTS, P, 1, &zero,
                    d->s, 1);
        cblas_zdscal(d->S, 1 / cblas_dznrm2(d->S, d->s, 1), d->s, 1);
    }
    return fmax(all * all - on * on, 0);
}

/* The polynomial K nearest to V by the weights W, over the points. */
static bool nearest(const double *w, const double complex *v, double complex *k)
{
    double M[TERMS][TERMS] = { { 0 } }, power[2 * TERMS - 1];
    double complex b[TERMS] = { 0 };

    for (int i = 0; i < POINTS; i++) {
        double x = (2 * i + 1.0) / POINTS - 1;
        power[0] = w[i];
        for (int n = 1; n < 2 * TERMS - 1; n++)
            power[n] = power[n - 1] * x;
        for (int n = 0; n < TERMS; n++) {
            b[n] += power[n] * v[i];
            for (int m = 0; m < TERMS; m++)
                M[n][m] += power[n + m];
        }
    }
    for (int n = 0; n < TERMS; n++) {           /* by Gauss, without pivots: positive definite */
        if (!(M[n][n] > 0))
            return false;
        for (int m = n + 1; m < TERMS; m++) {
            double r = M[m][n] / M[n][n];
            for (int j = n; j < TERMS; j++)
                M[m][j] -= r * M[n][j];
            b[m] -= r * b[n];
        }
    }
    for (int n = TERMS - 1; n >= 0; n--) {
        for (int m = n + 1; m < TERMS; m++)
            b[n] -= M[n][m] * k[m];
        k[n] = b[n] / M[n][n];
    }
    return true;
}

/* ln P, its phase followed from point to point, and the weights for it. */
static void logarithm(const double complex *P, double *w, double complex *v)
{
    double phase = 0;

    for (int i = 0; i < POINTS; i++) {
        double size = cabs(P[i]);
        phase += carg(i > 0 ? P[i] * conj(P[i - 1]) : P[i]);
        w[i] = size * size;
        v[i] = size > 0 ? CMPLX(log(size), phase) : 0;
    }
}

/* The sum of squares that the second of (1) leaves of P. */
static double off_function(const double complex *P)
{
    double w[POINTS], least = HUGE_VAL;
    double complex v[POINTS], k[TERMS] = { 0 }, more[TERMS] = { 0 };
    bool ok;

    logarithm(P, w, v);
    ok = nearest(w, v, k);
    for (int round = 0; round < ROUNDS && ok; round++) {
        double left = 0;
        for (int i = 0; i < POINTS; i++) {
            double x = (2 * i + 1.0) / POINTS - 1;
            double complex q = 0;
            for (int n = TERMS - 1; n >= 0; n--)
                q = q * x + k[n];
            q = cexp(q);
            left += pow(cabs(P[i] - q), 2);
            w[i] = pow(cabs(q), 2);
            v[i] = w[i] > 0 ? (P[i] - q) / q : 0;
        }
        least = fmin(least, left);
        ok = isfinite(left) && nearest(w, v, more);
        for (int n = 0; n < TERMS && ok; n++)
            k[n] += more[n];
    }
    return least;
}

/* Does one mode that drifts explain the group for less? */
static bool drifts(struct drift *d, const struct group *g)
{
    double complex P[POINTS];
    int fewer = 2 * (g->count - 1);
    double off, price;

    form(d, g);
    off = off_shape(d, g, P);
    /* the real part has half of it, a point stands for step rows */
    off = 0.5 * g->step * (off + off_function(P));
    price = criterion_price(&d->criterion, 0, d->order, d->parameters)
          - criterion_price(&d->criterion, 0, d->order - fewer, d->parameters - fewer + 2);
    return off < price;
}

static enum modal_status drift_new(struct drift *d, struct modal_error *err)
{
    size_t n = (size_t)d->count, S = (size_t)d->S;

    d->C = workspace_zeros(&d->space, n * S, sizeof *d->C);
    d->size = workspace_numbers(&d->space, n, 1);
    d->taken = workspace_zeros(&d->space, n, sizeof *d->taken);
    d->f = workspace_zeros(&d->space, POINTS * S, sizeof *d->f);
    d->s = workspace_zeros(&d->space, S, sizeof *d->s);
    return d->space.failed ? modal_fail(err, MODAL_NO_MEMORY, "drift: no memory for %d poles",
                                        d->count) : MODAL_OK;
}

enum modal_status drift_watch(const struct refine_data *data, const double complex *lambda,
                              int count, const double *noise, double hertz,
                              struct identify_result *result, struct modal_error *err)
{
    struct drift d = { .data = data, .lambda = lambda, .count = count, .S = data->Y->n };
    struct projected p = { 0 };
    struct group g;
    int groups = 0, found = 0;
    double first = 0;
    enum modal_status rc = drift_new(&d, err);

    if (rc == MODAL_OK)
        rc = refine_project(data, lambda, count, NULL, &p, err);
    if (rc == MODAL_OK && !p.degenerate) {
        d.criterion = p.criterion, d.order = p.order, d.parameters = p.parameters;
        amplitudes(&d, &p, noise);
        while (next_group(&d, &g)) {
            bool one = g.count > 1 && drifts(&d, &g);
            groups += g.count > 1, found += one;
            if (one && first == 0)
                first = cimag(lambda[g.pole[0]]) / (2 * M_PI);
        }
    }
    if (found >= DRIFT_LEAST && 2 * found > groups)
        identify_diagnose(result, "changes_in_record", -1, "%d groups of close modes of one shape, "
                          "the strongest at %.5g Hz, are as well one mode each whose frequency "
                          "changes evenly: not one system throughout, and these are no modes; "
                          "identify each part by `window`", found, first + hertz);
    workspace_free(&d.space);
    projected_done(&p);
    return rc;
}
